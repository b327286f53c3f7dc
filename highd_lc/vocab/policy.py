"""Who decides, and over which time each side is charged: the tables that everything else asks."""

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

    form: end speed fixed or free; "" for a reference, which is not searched. minds: whether the followers' loss
    counts beside the AV's (omega_AV below 1). chooses_start: whether moment and gap are unknowns as well.
    """

    name: str
    form: str = ""
    minds: bool = False
    chooses_start: bool = False

    @property
    def searched(self) -> bool:
        """Whether the planner looks for its motion."""
        return bool(self.form)

    def omega_av(self, joint: float) -> float:
        """Weight of the AV; joint: that of the policies that mind their followers."""
        return joint if self.minds else 1.0

    @property
    def counterpart(self) -> str:
        """The policy of the same form that minds nobody, with which one that minds its followers is compared."""
        return self.name.replace(names.LOCAL_OPTIMUM, names.BENCHMARK) if self.minds else ""


POLICIES: Final = {
    policy.name: policy
    for policy in (
        Policy(names.NO_LANE_CHANGE),
        Policy(names.CONSTANT),
        Policy(names.HUMAN),
        Policy(names.BENCHMARK, names.FIXED),
        Policy(names.LOCAL_OPTIMUM, names.FIXED, minds=True),
        Policy(names.BENCHMARK_FREE, names.FREE),
        Policy(names.LOCAL_OPTIMUM_FREE, names.FREE, minds=True),
        Policy(names.BENCHMARK_START, names.FIXED, chooses_start=True),
        Policy(names.LOCAL_OPTIMUM_START, names.FIXED, minds=True, chooses_start=True),
        Policy(names.BENCHMARK_FREE_START, names.FREE, chooses_start=True),
        Policy(names.LOCAL_OPTIMUM_FREE_START, names.FREE, minds=True, chooses_start=True),
    )
}
