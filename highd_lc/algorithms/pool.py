"""The pool of simulated candidates: who is feasible, what each goal makes of them, which is best."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from highd_lc.algorithms.candidates import LossTerms, evaluate
from highd_lc.algorithms.contacts import NO_CONTACT
from highd_lc.algorithms.dynamics import Limits, violations
from highd_lc.algorithms.packing import PackedScene
from highd_lc.core.losses import joint_objective
from highd_lc.core.quintic import Quintic
from highd_lc.vocab import names
from highd_lc.vocab.settings import PlannerSettings

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Goal:
    """What a policy minimises: its accounting and the AV's weight omega_AV."""

    accounting: str
    omega_av: float


@dataclass(frozen=True)
class Pool:
    """All simulated candidates, each array of shape (M,).

    n: samples of T; delta [m], change [m/s]: see ``candidates.evaluate``; av_T, av_H, hv_T, hv_H: losses
    charged to T and to H; contact: first sample of contact; role: with whom; violation: code of ``dynamics``.
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
        """All pools in one, this one first."""
        pools = (self, *others)
        return Pool(*(np.concatenate([getattr(p, f) for p in pools]) for f in self.__dataclass_fields__))

    def losses(self, accounting: str) -> tuple[FloatArray, FloatArray]:
        """Loss of the AV and of the followers under an accounting (SPEC section 4)."""
        if accounting == names.PAPER:
            return self.av_T, self.hv_T
        return (self.av_T if accounting == names.FOLLOWER_HORIZON else self.av_H), self.hv_H

    def feasible(self, accounting: str) -> NDArray[np.bool_]:
        """Which candidates keep every limit and touch nobody over the accounted time."""
        last = self.n if accounting == names.PAPER else np.full(len(self), NO_CONTACT - 1)
        kept: NDArray[np.bool_] = (self.violation == 0) & (self.contact > last)
        return kept

    def objective(self, goal: Goal) -> FloatArray:
        """Joint objective of each candidate, infinite where infeasible."""
        value = joint_objective(*self.losses(goal.accounting), goal.omega_av)
        return np.where(self.feasible(goal.accounting), value, np.inf)

    def best(self, goal: Goal) -> int | None:
        """Index of the best feasible candidate, the first of equals; None if there is none."""
        objective = self.objective(goal)
        index = int(np.argmin(objective))
        return index if np.isfinite(objective[index]) else None


@dataclass(frozen=True)
class Task:
    """A search: the packed scene, its loss terms, dynamic limits and settings."""

    scene: PackedScene
    terms: LossTerms
    limit: Limits
    settings: PlannerSettings

    @property
    def durations(self) -> IntArray:
        """The grid of T in samples."""
        dt = self.scene.dt
        last = min(round(self.settings.T_max / dt), len(self.scene.target_v) - 1)
        return np.arange(round(self.settings.T_min / dt), last + 1)

    def seconds(self, n: IntArray) -> FloatArray:
        """Durations of n samples [s], of n's shape."""
        return n.astype(np.float64) * self.scene.dt

    def quintic(self, n: int, delta: float, change: float) -> Quintic:
        """The plan of a candidate."""
        T, v0 = round(n * self.scene.dt, 10), self.scene.v0
        return Quintic(v0=v0, D=self.scene.D, T=T, x_final=v0 * T + delta, v_end=v0 + change)

    def simulate(self, n: IntArray, delta: FloatArray, change: FloatArray) -> Pool:
        """Candidates in rows of one duration each, as a flat pool; shapes as in ``evaluate``."""
        out = evaluate(n, delta, change, self.scene, self.terms)
        codes = violations(self.seconds(n), delta, change, self.scene.v0, self.scene.D, self.limit)
        return Pool(
            n=np.repeat(n, delta.shape[1]),
            delta=delta.ravel(),
            change=change.ravel(),
            av_T=out.av_T.ravel(),
            av_H=out.av_H.ravel(),
            hv_T=out.hv_T.ravel(),
            hv_H=out.hv_H.ravel(),
            contact=out.contact.ravel(),
            role=out.role.ravel(),
            violation=codes.ravel(),
        )
