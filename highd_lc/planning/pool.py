"""The pool of simulated candidates: who is feasible, what each goal makes of them, which is best."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.kernels import plain
from highd_lc.core.losses import LossTerms, joint_objective
from highd_lc.core.quintic import Quintic
from highd_lc.planning.candidates import evaluate
from highd_lc.planning.contacts import NO_CONTACT
from highd_lc.planning.crowd import Crowd
from highd_lc.planning.limits import CONSTRAINTS, SAFETY, Limits, violations
from highd_lc.planning.scene import PackedScene
from highd_lc.vocab import names
from highd_lc.vocab.settings import PlannerSettings

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

OVERTAKES = len(CONSTRAINTS) + 1
"""Code of a violation beside those of ``limits``: the plan ends ahead of the leader of its gap.

The codes above it, up to ``OVERTAKES + len(SAFETY)``, are those of a safety profile.
"""


class Goal(NamedTuple):
    """What a policy minimises: its accounting and the AV's weight omega_AV."""

    accounting: str
    omega_av: float


@dataclass(frozen=True)
class Pool:
    """All simulated candidates, each array of shape (M,).

    n: samples of T; delta [m], change [m/s]: see ``candidates.evaluate``; av_T, av_H, hv_T, hv_H: losses
    charged to T and to H; contact: first sample of contact; role: which; violation: code of ``dynamics``.
    """

    n: IntArray
    delta: FloatArray
    change: FloatArray
    av_T: FloatArray
    av_H: FloatArray
    hv_T: FloatArray
    hv_H: FloatArray
    contact: IntArray
    role: IntArray
    violation: IntArray

    def __len__(self) -> int:
        return len(self.n)

    def joined(self, *others: "Pool") -> "Pool":
        """All pools in one, this one first. Its candidates' feasibility and losses are not worked out again."""
        pools = (self, *others)
        pool = Pool(*(np.concatenate([getattr(p, f) for p in pools]) for f in self.__dataclass_fields__))
        for accounting, kept in self._feasible.items():
            pool._feasible[accounting] = np.concatenate([kept, *(p.feasible(accounting) for p in others)])
        for goal, value in self._unconstrained.items():
            pool._unconstrained[goal] = np.concatenate([value, *(p.unconstrained(goal) for p in others)])
        return pool

    @cached_property
    def _feasible(self) -> dict[str, NDArray[np.bool_]]:
        return {}

    @cached_property
    def _unconstrained(self) -> dict[Goal, FloatArray]:
        return {}

    @cached_property
    def _objective(self) -> dict[Goal, FloatArray]:
        return {}

    def chosen(self, index: IntArray) -> "Pool":
        """Some of the candidates."""
        return Pool(*(getattr(self, f)[index] for f in self.__dataclass_fields__))

    def losses(self, accounting: str) -> tuple[FloatArray, FloatArray]:
        """Loss of the AV and of the followers under an accounting (equations.md 4)."""
        if accounting == names.PAPER:
            return self.av_T, self.hv_T
        return (self.av_T if accounting == names.FOLLOWER_HORIZON else self.av_H), self.hv_H

    def feasible(self, accounting: str) -> NDArray[np.bool_]:
        """Which candidates keep every limit and touch nobody over the accounted time."""
        if accounting not in self._feasible:
            self._feasible[accounting] = (self.violation == 0) & ~self.touches(accounting)
        return self._feasible[accounting]

    @property
    def within_limits(self) -> NDArray[np.bool_]:
        """Which candidates keep the limits of motion, whatever else they break."""
        moving: NDArray[np.bool_] = (self.violation == 0) | (self.violation >= OVERTAKES)
        return moving

    def unsafe(self, counted: NDArray[np.bool_], scene: PackedScene) -> dict[str, int]:
        """How many of the counted candidates each constraint of the scene's safety profile rejects."""
        if not scene.safety.asked:
            return {}
        found = self.violation[counted] - OVERTAKES - 1
        return {name: int((found == i).sum()) for i, name in enumerate(SAFETY)}

    def touches(self, accounting: str) -> NDArray[np.bool_]:
        """Which candidates meet somebody over the accounted time."""
        met: NDArray[np.bool_] = self.contact <= (self.n if accounting == names.PAPER else NO_CONTACT - 1)
        return met

    def obstacle(self, accounting: str, index: IntArray) -> IntArray:
        """What stands in some candidates' way: -1 nothing, the role of the first contact, or -1 - violation."""
        violation = self.violation[index]
        blocked = np.where(violation > 0, -1 - violation, self.role[index])
        return np.where(self.feasible(accounting)[index], -1, blocked)

    def unconstrained(self, goal: Goal) -> FloatArray:
        """Joint objective of each candidate, feasible or not."""
        if goal not in self._unconstrained:
            self._unconstrained[goal] = joint_objective(*self.losses(goal.accounting), goal.omega_av)
        return self._unconstrained[goal]

    def objective(self, goal: Goal) -> FloatArray:
        """Joint objective of each candidate, infinite where infeasible."""
        if goal not in self._objective:
            self._objective[goal] = np.where(self.feasible(goal.accounting), self.unconstrained(goal), np.inf)
        return self._objective[goal]

    def best(self, goal: Goal) -> int | None:
        """Index of the best feasible candidate, the first of equals; None if there is none."""
        if not len(self):
            return None
        objective = self.objective(goal)
        index = int(np.argmin(objective))
        return index if np.isfinite(objective[index]) else None


class Before(NamedTuple):
    """What a manoeuvre that starts later inherits: losses of the AV and the followers charged before its start.

    hv_passed: loss charged to the followers ahead of the gap, over 0 .. k of the manoeuvre's samples, shape
    (N + 1,). latest: the longest duration that ends in time [samples]. contact, role: first contact among the
    vehicles ahead of the gap, in samples of the manoeuvre, and which (see ``contacts.contact_words``).
    """

    av: float
    hv: float
    hv_passed: FloatArray
    latest: int
    contact: int = NO_CONTACT
    role: int = -1


NOTHING_BEFORE: Final = Before(0.0, 0.0, np.zeros(1), 0)
"""For kernels that take a manoeuvre which starts at once."""


def distinct(pool: Pool, goals: list[Goal]) -> list[int]:
    """Places of the goals that do not make the same of every candidate as one before them."""
    places: list[int] = []
    for g, goal in enumerate(goals):
        if not any(np.array_equal(pool.objective(goal), pool.objective(goals[before])) for before in places):
            places.append(g)
    return places


@dataclass(frozen=True)
class Task:
    """A search: the packed scene, its loss terms, dynamic limits and settings.

    before: only of a later start. crowd: who the followers may be; None = those of the scene. change: v_end - v0
    of the fixed form [m/s]: 0 at the start of a manoeuvre.
    """

    scene: PackedScene
    terms: LossTerms
    limit: Limits
    settings: PlannerSettings
    before: Before | None = None
    crowd: Crowd | None = None
    change: float = 0.0

    @property
    def durations(self) -> IntArray:
        """The grid of T in samples."""
        dt = self.scene.dt
        last = min(round(self.settings.T_max / dt), len(self.scene.target_v) - 1)
        if self.before is not None:
            last = min(last, self.before.latest)
        return np.arange(round(self.settings.T_min / dt), last + 1)

    def seconds(self, n: IntArray) -> FloatArray:
        """Durations of n samples [s], of n's shape."""
        return n.astype(np.float64) * self.scene.dt

    def quintic(self, n: int, delta: float, change: float) -> Quintic:
        """The plan of a candidate."""
        T, v0 = round(n * self.scene.dt, 10), self.scene.v0
        start = self.scene.start
        return Quintic(v0=v0, D=self.scene.D, T=T, x_final=v0 * T + delta, v_end=v0 + change, start=start)

    def simulate(self, n: IntArray, delta: FloatArray, change: FloatArray) -> Pool:
        """Candidates in rows of one duration each, as a flat pool; shapes as in ``evaluate``."""
        delta, change = plain(delta), plain(change)
        out = evaluate(n, delta, change, self.scene, self.terms, self.crowd)
        codes = self._violations(n, delta, change).ravel()
        pool = Pool(
            n=np.repeat(n, delta.shape[1]),
            delta=delta.ravel(),
            change=change.ravel(),
            av_T=out.av_T.ravel(),
            av_H=out.av_H.ravel(),
            hv_T=out.hv_T.ravel(),
            hv_H=out.hv_H.ravel(),
            contact=out.contact.ravel(),
            role=out.role.ravel(),
            violation=codes,
        )
        if self.before is not None:
            pool = self._of_later_start(pool, self.before)
        unsafe, kept = out.unsafe.ravel(), pool.violation == 0
        if not (self.scene.safety.asked and kept.any()):
            return pool
        return replace(pool, violation=np.where(kept & (unsafe > 0), OVERTAKES + unsafe, pool.violation))

    def _violations(self, n: IntArray, delta: FloatArray, change: FloatArray) -> IntArray:
        scene = self.scene
        return violations(self.seconds(n), delta, change, scene.v0, scene.D, self.limit, scene.start)

    def _of_later_start(self, pool: Pool, before: Before) -> Pool:
        """The pool with the losses before its start, without the plans that end ahead of the gap's leader."""
        front = self.scene.length / 2.0 + self.scene.v0 * self.seconds(pool.n) + pool.delta
        overtakes = (pool.violation == 0) & (front >= self.scene.target_front[pool.n])
        return replace(
            pool,
            av_T=pool.av_T + before.av,
            av_H=pool.av_H + before.av,
            hv_T=pool.hv_T + before.hv + before.hv_passed[pool.n],
            hv_H=pool.hv_H + before.hv + before.hv_passed[-1],
            violation=np.where(overtakes, OVERTAKES, pool.violation),
            contact=np.minimum(pool.contact, before.contact),
            role=np.where(before.contact < pool.contact, before.role, pool.role),
        )
