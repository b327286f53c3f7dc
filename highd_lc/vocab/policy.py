"""Policies and accountings: who plans a motion, and over which time each side is charged."""

from dataclasses import dataclass
from typing import Final

from highd_lc.vocab import names


@dataclass(frozen=True)
class Accounting:
    """Over which time each side is charged (equations.md 4.6): to T, or to the horizon H."""

    name: str
    av_to_horizon: bool
    followers_to_horizon: bool

    def charged(self, n: int, last: int) -> tuple[int, int]:
        """Last charged sample of the AV and of the followers. n: sample of T; last: sample of H."""
        return (last if self.av_to_horizon else n), (last if self.followers_to_horizon else n)


ACCOUNTINGS: Final = {
    accounting.name: accounting
    for accounting in (
        Accounting(names.PAPER, av_to_horizon=False, followers_to_horizon=False),
        Accounting(names.FOLLOWER_HORIZON, av_to_horizon=False, followers_to_horizon=True),
        Accounting(names.EQUAL, av_to_horizon=True, followers_to_horizon=True),
    )
}


@dataclass(frozen=True)
class Policy:
    """Who plans a motion (equations.md 6).

    form: end speed fixed or free; "" for a reference, which is not searched. weighs_followers: whether the
    followers' loss counts beside the AV's (omega_AV below 1). chooses_start: whether moment and gap are unknowns
    as well. robust: whether the followers are unknown, so that their loss is one over a crowd of drivers
    (equations.md 7.4). replans: whether it plans anew while it drives (equations.md 7.5).
    """

    name: str
    form: str = ""
    weighs_followers: bool = False
    chooses_start: bool = False
    robust: bool = False
    replans: bool = False

    @property
    def searched(self) -> bool:
        """Whether the planner looks for its motion."""
        return bool(self.form)

    @property
    def comparison(self) -> str:
        """Its form in the tables, the choice of the start included; "" for a reference."""
        if self.robust:
            return _FORM_OF_ROBUST[self.form]
        return _FORM_OF_START[self.form] if self.chooses_start else self.form

    def omega_av(self, joint: float) -> float:
        """Weight of the AV's loss. joint: that of the policies that weigh their followers' loss as well."""
        return joint if self.weighs_followers else 1.0

    @property
    def counterpart(self) -> str:
        """With which policy of the same form it is compared: benchmark with local optimum; "" for a reference."""
        plain = self.name.replace(names.LOCAL_OPTIMUM_ROBUST, names.LOCAL_OPTIMUM)
        pair = (names.BENCHMARK, names.LOCAL_OPTIMUM)
        mine, other = pair[::-1] if self.weighs_followers else pair
        return plain.replace(mine, other) if self.searched else ""

    @property
    def planned_once(self) -> str:
        """The policy that plans as this one does, once and for all."""
        return next(
            other.name
            for other in POLICIES.values()
            if not other.chooses_start
            and (other.form, other.weighs_followers, other.robust)
            == (self.form, self.weighs_followers, self.robust)
        )

    @property
    def without_choice(self) -> str:
        """The policy of the same form and weight whose manoeuvre starts at t_start, into the recorded gap."""
        return next(
            other.name
            for other in POLICIES.values()
            if not other.chooses_start
            and (other.form, other.weighs_followers) == (self.form, self.weighs_followers)
        )


_FORM_OF_ROBUST: Final = {names.FIXED: names.ROBUST, names.FREE: names.ROBUST_FREE}
_FORM_OF_START: Final = {names.FIXED: names.START, names.FREE: names.FREE_START}
POLICIES: Final = {
    policy.name: policy
    for policy in (
        Policy(names.NO_LANE_CHANGE),
        Policy(names.CONSTANT),
        Policy(names.HUMAN),
        Policy(names.BENCHMARK, names.FIXED),
        Policy(names.LOCAL_OPTIMUM, names.FIXED, weighs_followers=True),
        Policy(names.BENCHMARK_FREE, names.FREE),
        Policy(names.LOCAL_OPTIMUM_FREE, names.FREE, weighs_followers=True),
        Policy(names.BENCHMARK_START, names.FIXED, chooses_start=True),
        Policy(names.LOCAL_OPTIMUM_START, names.FIXED, weighs_followers=True, chooses_start=True),
        Policy(names.BENCHMARK_FREE_START, names.FREE, chooses_start=True),
        Policy(names.LOCAL_OPTIMUM_FREE_START, names.FREE, weighs_followers=True, chooses_start=True),
        Policy(names.LOCAL_OPTIMUM_ROBUST, names.FIXED, weighs_followers=True, robust=True),
        Policy(names.LOCAL_OPTIMUM_ROBUST_FREE, names.FREE, weighs_followers=True, robust=True),
    )
}

OPTIMAL_POLICIES: Final = tuple(name for name, policy in POLICIES.items() if policy.searched)
"""Whose motions are searched."""
CHOOSING_START: Final = tuple(name for name, policy in POLICIES.items() if policy.chooses_start)
"""Of these, those that choose when to start and into which gap."""
_PAIRS: Final = {
    policy.comparison: (policy.counterpart, policy.name) for policy in POLICIES.values() if policy.weighs_followers
}
PAIRS: Final = {form: pair for form, pair in _PAIRS.items() if form not in names.ROBUST_FORMS}
"""The policies that each form compares: benchmark, local optimum."""
ROBUST_PAIRS: Final = {form: pair for form, pair in _PAIRS.items() if form in names.ROBUST_FORMS}
"""The same of plans for unknown followers, which are made on a sample of the events."""

REPLANNED: Final = {
    policy.name: policy
    for policy in (
        Policy(names.BENCHMARK_REPLANNED, names.FIXED, replans=True),
        Policy(names.LOCAL_OPTIMUM_REPLANNED, names.FIXED, weighs_followers=True, replans=True),
        Policy(
            names.LOCAL_OPTIMUM_ROBUST_REPLANNED, names.FIXED, weighs_followers=True, robust=True, replans=True
        ),
    )
}
"""The policies of the closed loop, which no other table holds."""
