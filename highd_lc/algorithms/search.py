"""Global search over plans: every T on its grid, x_final (and v_end) on a grid, then zooming in.

The objective is not smooth and its feasible set has holes, so no single descent finds the best plan (SPEC section
7). One simulation of a candidate serves every accounting and every weight of the AV: all candidates that were
ever simulated form a pool, and each policy takes the best of it. So a policy cannot lose to another one in its
own objective.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.algorithms.candidates import LossTerms, evaluate
from highd_lc.algorithms.contacts import NO_CONTACT
from highd_lc.algorithms.dynamics import CONSTRAINTS, Limits, forward_interval, violations
from highd_lc.algorithms.packing import PackedScene
from highd_lc.core.losses import joint_objective
from highd_lc.core.quintic import Quintic
from highd_lc.vocab import names
from highd_lc.vocab.settings import PlannerSettings

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_NOMINAL_NODES: Final = 33
_ZOOM_FIXED: Final = 16
_ZOOM_FREE: Final = 8
_OVERLAP: Final = 1.3
_TIGHT: Final = 0.6
_DENSER: Final = 8


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

    def joined(self, other: "Pool") -> "Pool":
        """Both pools, this one first."""
        return Pool(*(np.concatenate([getattr(self, f), getattr(other, f)]) for f in self.__dataclass_fields__))

    def losses(self, accounting: str) -> tuple[FloatArray, FloatArray]:
        """Loss of the AV and of the followers under an accounting (SPEC section 4)."""
        if accounting == names.PAPER:
            return self.av_T, self.hv_T
        return (self.av_T if accounting == names.FOLLOWER_HORIZON else self.av_H), self.hv_H

    def feasible(self, accounting: str) -> NDArray[np.bool_]:
        """Which candidates keep every limit and touch nobody over the accounted time."""
        last = self.n if accounting == names.PAPER else np.full(len(self), NO_CONTACT - 1)
        return (self.violation == 0) & (self.contact > last)

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

    def quintic(self, n: int, delta: float, change: float) -> Quintic:
        """The plan of a candidate."""
        T, v0 = round(n * self.scene.dt, 10), self.scene.v0
        return Quintic(v0=v0, D=self.scene.D, T=T, x_final=v0 * T + delta, v_end=v0 + change)

    def simulate(self, n: IntArray, delta: FloatArray, change: FloatArray) -> Pool:
        """Candidates in rows of one duration each, as a flat pool; shapes as in ``evaluate``."""
        out = evaluate(n, delta, change, self.scene, self.terms)
        codes = violations(n * self.scene.dt, delta, change, self.scene.v0, self.scene.D, self.limit)
        columns = (np.repeat(n, delta.shape[1]), delta.ravel(), change.ravel(), *(a.ravel() for a in out))
        return Pool(*columns, codes.ravel())


def search(task: Task, goals: list[Goal], *, known: Pool | None = None) -> Pool:
    """All candidates of the search for the best plan of every goal.

    known: the pool of the fixed form, for a search with a free end speed; without it the form is fixed.
    """
    free = known is not None
    pool = _grid(task, free, 1)
    if _tight(pool, goals):
        pool = pool.joined(_grid(task, free, _DENSER))
    starts = _starts(task, pool, goals, free)
    while starts is not None:
        pool, before = _zoom(task, pool, goals, free, starts), pool
        starts = _neighbours(task, pool, before, goals, free)
    return pool if known is None else known.joined(pool)


def _possible(task: Task) -> IntArray:
    """Durations whose lateral motion keeps the limits: it does not depend on the rest."""
    n = task.durations
    zero = np.zeros((len(n), 1))
    codes = violations(n * task.scene.dt, zero, zero, task.scene.v0, task.scene.D, task.limit)
    return n[(codes[:, 0] != 1) & (codes[:, 0] != 2)]


def _tight(pool: Pool, goals: list[Goal]) -> bool:
    """Whether contacts leave so few plans that the slots between vehicles may fall between the nodes."""
    shares = [pool.feasible(goal.accounting).mean() for goal in goals] if len(pool) else [1.0]
    return bool(min(shares) < _TIGHT)


def _grid(task: Task, free: bool, denser: int) -> Pool:
    n = _possible(task)
    if free and len(n):
        n = n[np.unique(np.linspace(0, len(n) - 1, min(task.settings.T_nodes_free, len(n))).astype(int))]
    T = (n * task.scene.dt)[:, None, None]
    change = _changes(task, T, free)
    low, high = forward_interval(T, change, task.scene.v0, task.limit)
    # Dense about the smoothest motion, which is also a node: the jerk sum has a kink there.
    nodes = denser * (_x_nodes(task, free) - 1) + 1
    s = np.linspace(-1.0, 1.0, nodes) + np.zeros((len(n), 1, 1))
    # Every other duration has its nodes in between: the objective changes little from one to the next.
    s[1::2] = np.where(s[1::2] == 0.0, 0.0, s[1::2] - np.sign(s[1::2]) / (nodes - 1))
    centre = np.clip(change * T / 2.0, low, np.maximum(high, low))
    delta = centre + np.where(s < 0.0, centre - low, np.maximum(high - centre, 0.0)) * s * abs(s)
    shape = (len(n), -1)
    return task.simulate(n, delta.reshape(shape), np.broadcast_to(change, delta.shape).reshape(shape))


def _x_nodes(task: Task, free: bool) -> int:
    """Nodes over x_final: odd, so that the middle one is the smoothest motion."""
    return 2 * ((task.settings.x_nodes - 1) // (4 if free else 2)) + 1


def _changes(task: Task, T: FloatArray, free: bool) -> FloatArray:
    """Nodes of v_end - v0 [m/s], shape (rows, nodes, 1): the jerk at both ends leaves |change| <= j T^2 / 6."""
    if not free:
        return np.zeros((len(T), 1, 1))
    widest = task.limit.jerk * T**2 / 6.0
    low = np.maximum(task.limit.v_min - task.scene.v0, -widest)
    high = np.minimum(task.limit.v_max - task.scene.v0, widest)
    s = np.linspace(-1.0, 1.0, 2 * (task.settings.v_nodes // 2) + 1)[None, :, None]
    return np.where(s < 0.0, -low, high) * s * abs(s)


@dataclass(frozen=True)
class _Starts:
    """Where to zoom in: duration, centre, half-widths and goal of each start, all of shape (S,)."""

    n: IntArray
    delta: FloatArray
    change: FloatArray
    half_delta: FloatArray
    half_change: FloatArray
    goal: IntArray


def _starts(task: Task, pool: Pool, goals: list[Goal], free: bool) -> _Starts | None:
    """The best durations of each goal, each with its best candidate; None if nothing is feasible."""
    rows: list[tuple[int, int, int]] = []
    for g, goal in enumerate(goals):
        if len(pool):
            indices = _best_of_basins(pool, pool.objective(goal), task.settings.zoom_starts)
            rows += [(int(pool.n[i]), i, g) for i in indices]
    return _at(task, pool, free, rows)


def _neighbours(task: Task, pool: Pool, before: Pool, goals: list[Goal], free: bool) -> _Starts | None:
    """The durations next to each goal's best one; None when no goal has moved to another one."""
    rows: list[tuple[int, int, int]] = []
    for g, goal in enumerate(goals):
        best, old = pool.best(goal), before.best(goal)
        if best is not None and (len(before) == 0 or best != old):
            rows += [(n, best, g) for n in _around(task, int(pool.n[best]), free)]
    return _at(task, pool, free, rows)


def _at(task: Task, pool: Pool, free: bool, rows: list[tuple[int, int, int]]) -> _Starts | None:
    """Starts from rows of duration, index of the candidate that is moved there, and goal."""
    if not rows:
        return None
    n, index, goal_of = (np.array(column) for column in zip(*rows, strict=True))
    T = n * task.scene.dt
    change = pool.change[index]
    # The same shape at another T: delta grows with T through the change of speed only.
    delta = pool.delta[index] + change * (T - pool.n[index] * task.scene.dt) / 2.0
    widest = np.minimum(task.limit.jerk * T**3 / 60.0, (task.limit.v_max - task.limit.v_min) * T / 1.875)
    fastest = np.minimum(task.limit.jerk * T**2 / 6.0, task.limit.v_max - task.limit.v_min)
    return _Starts(
        n=n,
        delta=delta,
        change=change,
        half_delta=_spacing(delta - change * T / 2.0, widest, _x_nodes(task, free)),
        half_change=_spacing(change, fastest, task.settings.v_nodes) if free else np.zeros(len(n)),
        goal=goal_of,
    )


def _spacing(value: FloatArray, widest: FloatArray, nodes: int) -> FloatArray:
    """Distance to the next node of the first grid, whose nodes lie at widest s |s|."""
    step = 2.0 / (nodes - 1)
    return widest * step * (2.0 * np.sqrt(np.minimum(np.abs(value) / widest, 1.0)) + step)


def _around(task: Task, n: int, free: bool) -> list[int]:
    """Durations next to n; farther ones too where the grid skipped some."""
    allowed = set(_possible(task).tolist())
    steps = (-4, -3, -2, -1, 1, 2, 3, 4) if free else (-2, -1, 1, 2)
    return [n + step for step in steps if n + step in allowed]


def _best_of_basins(pool: Pool, objective: FloatArray, count: int) -> list[int]:
    """Indices of the best candidates of the best durations: ``count`` overall, two slowing, two speeding up.

    The unaccelerated plan is often a basin of its own (the jerk sum has a kink there) and hides the others.
    """
    order = np.argsort(objective, kind="stable")
    order = order[np.isfinite(objective[order])]
    _, first = np.unique(pool.n[order], return_index=True)
    chosen = [int(i) for i in order[np.sort(first)[:count]]]
    for side in (-1.0, 1.0):
        beyond = order[side * pool.delta[order] > 1e-6]
        _, first = np.unique(pool.n[beyond] // 20, return_index=True)
        chosen += [int(i) for i in beyond[np.sort(first)[:2]]]
    return list(dict.fromkeys(chosen))


def _zoom(task: Task, pool: Pool, goals: list[Goal], free: bool, starts: _Starts) -> Pool:
    """Ever finer grids about each start's best candidate so far."""
    across, down = _offsets(free)
    shrink = _OVERLAP * 2.0 / ((_ZOOM_FREE if free else _ZOOM_FIXED) - 1)
    delta, change = starts.delta.copy(), starts.change.copy()
    half_delta, half_change = starts.half_delta.copy(), starts.half_change.copy()
    found = [pool]
    best = np.full(len(delta), np.inf)
    for _ in range(task.settings.zoom_levels_free if free else task.settings.zoom_levels):
        deltas, changes = _around_centres(
            task, starts.n, (delta, change), (half_delta, half_change), (across, down)
        )
        part = task.simulate(starts.n, deltas, changes)
        found.append(part)
        for s, g in enumerate(starts.goal):
            row = slice(s * deltas.shape[1], (s + 1) * deltas.shape[1])
            objective = _objective_of(part, row, goals[g])
            i = int(np.argmin(objective))
            if objective[i] < best[s]:
                best[s], delta[s], change[s] = objective[i], deltas[s, i], changes[s, i]
        half_delta, half_change = half_delta * shrink, half_change * shrink
    return _joined(found)


def _objective_of(pool: Pool, row: slice, goal: Goal) -> FloatArray:
    return Pool(*(getattr(pool, f)[row] for f in pool.__dataclass_fields__)).objective(goal)


def _joined(pools: list[Pool]) -> Pool:
    return Pool(*(np.concatenate([getattr(p, f) for p in pools]) for f in Pool.__dataclass_fields__))


def _offsets(free: bool) -> tuple[FloatArray, FloatArray]:
    """Offsets of a zoom grid in half-widths of delta and of change, shape (candidates,)."""
    if not free:
        return np.linspace(-1.0, 1.0, _ZOOM_FIXED), np.zeros(_ZOOM_FIXED)
    line = np.linspace(-1.0, 1.0, _ZOOM_FREE)
    across, down = np.meshgrid(line, line)
    return across.ravel(), down.ravel()


def _around_centres(
    task: Task,
    n: IntArray,
    centre: tuple[FloatArray, FloatArray],
    half: tuple[FloatArray, FloatArray],
    offsets: tuple[FloatArray, FloatArray],
) -> tuple[FloatArray, FloatArray]:
    """Candidates (S, candidates) about the centres, moved into the interval of what is possible."""
    T = (n * task.scene.dt)[:, None]
    change = np.clip(
        centre[1][:, None] + half[1][:, None] * offsets[1],
        task.limit.v_min - task.scene.v0,
        task.limit.v_max - task.scene.v0,
    )
    # The mean of start and end speed moves x_final along: the two unknowns are nearly independent then.
    drift = (change - centre[1][:, None]) * T / 2.0
    low, high = forward_interval(T, change, task.scene.v0, task.limit)
    delta = np.clip(centre[0][:, None] + drift + half[0][:, None] * offsets[0], low, np.maximum(high, low))
    # The first candidate of every row is the unaccelerated one: the kink of the jerk sum, missed by any grid.
    delta[:, 0], change[:, 0] = 0.0, 0.0
    return delta, change


def nominal_rejections(task: Task, free: bool) -> dict[str, int]:
    """How many plans of a plain grid each dynamic constraint rejects; key "candidates" holds their number.

    The grid spans every T, mean speeds from v_min to v_max and, in the free form, end speeds from v_min to
    v_max; a plan counts for the first constraint that it violates.
    """
    n, scene, limit = task.durations, task.scene, task.limit
    T = (n * scene.dt)[:, None, None]
    speeds = np.linspace(limit.v_min - scene.v0, limit.v_max - scene.v0, _NOMINAL_NODES)
    changes = speeds if free else np.zeros(1)
    shape = (len(n), len(speeds), len(changes))
    delta = np.broadcast_to(speeds[None, :, None] * T, shape).reshape(len(n), -1)
    change = np.broadcast_to(changes[None, None, :], shape).reshape(len(n), -1)
    codes = violations(
        n * scene.dt, np.ascontiguousarray(delta), np.ascontiguousarray(change), scene.v0, scene.D, limit
    )
    counts = np.bincount(codes.ravel(), minlength=len(CONSTRAINTS) + 1)
    return {"candidates": codes.size, **{name: int(counts[i + 1]) for i, name in enumerate(CONSTRAINTS)}}
