"""The front of what AV and followers can have at once, beside the omega sweep: knee, hypervolume, comparison.

The sweep's optima minimise omega Loss_AV + (1 - omega) Loss_HV, so they lie on the convex hull of the true front.
Where a front that was found otherwise disagrees, one of the methods has failed, and ``compare`` says by how much.

NSGA-II and the sweep over omega_AV, of plans (T, x_final, v_end) and of plans with a chosen start and gap.

NSGA-II (pymoo) knows nothing of the global search: it starts from random plans.

The loss surface of an event over (T, x_final), with its feasible region and the plans' own points, as data.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.losses import joint_objective
from highd_lc.planning.contacts import WIDTH
from highd_lc.planning.limits import SAFETY, forward_interval
from highd_lc.planning.planner import PlanningProblem
from highd_lc.planning.pool import OVERTAKES, Goal, Pool, Task
from highd_lc.planning.search import possible_durations, search
from highd_lc.planning.start_search import search_starts
from highd_lc.planning.starts import CONTAINED, StartProblem, best_of
from highd_lc.vocab import names
from highd_lc.vocab.policy import PAIRS

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_BEYOND = 1.1  # the hypervolume's reference point over the worst losses of either method


@dataclass(frozen=True)
class Points:
    """Plans and their losses, each of shape (m,): n samples of T, delta [m], change [m/s] as in ``Pool``; gap:
    number of the gap, delay: samples before the start, both 0 where the start is not chosen.
    """

    gap: IntArray
    delay: IntArray
    n: IntArray
    delta: FloatArray
    change: FloatArray
    loss_av: FloatArray
    loss_hv: FloatArray

    def __len__(self) -> int:
        return len(self.n)

    def chosen(self, index: IntArray) -> "Points":
        """Some of the points."""
        return Points(*(getattr(self, name)[index] for name in self.__dataclass_fields__))


@dataclass(frozen=True)
class Comparison:
    """Front against sweep. behind, ahead: most by which the front's best joint objective exceeds the sweep's, or
    falls below it, relative. hypervolumes: shares of the box between the ideal of all points and ``reference``.
    """

    behind: float
    ahead: float
    hypervolume: float
    hypervolume_sweep: float
    reference: tuple[float, float]


def non_dominated(points: Points) -> Points:
    """The points that no other beats in both losses, by rising loss of the AV, equals once."""
    order = np.lexsort((points.loss_hv, points.loss_av))
    hv = points.loss_hv[order]
    before = np.concatenate([[np.inf], np.minimum.accumulate(hv)[:-1]]) if len(hv) else hv
    return points.chosen(order[hv < before])


def knee(front: Points) -> int | None:
    """The point farthest below the line between the front's ends, both losses scaled to 0..1; None without a bend.

    front: by rising loss of the AV.
    """
    if len(front) < 3:
        return None
    av, hv = ((loss - loss.min()) / (loss.max() - loss.min()) for loss in (front.loss_av, front.loss_hv))
    below = 1.0 - av - hv
    best = int(np.argmax(below))
    return best if below[best] > 1e-9 else None


def knee_weights(front: Points, k: int) -> tuple[float, float]:
    """The weights of the AV from and up to which point k minimises the joint objective over the front.

    NaN, NaN if it does so for no weight (it lies behind the hull). omega av_k + (1 - omega) hv_k is linear in
    omega, so every other point gives one bound.
    """
    low, high = 0.0, 1.0
    for av, hv in zip(front.loss_av - front.loss_av[k], front.loss_hv - front.loss_hv[k], strict=True):
        # omega av + (1 - omega) hv >= 0
        slope = av - hv
        if slope > 0.0:
            low = max(low, -hv / slope)
        elif slope < 0.0:
            high = min(high, -hv / slope)
    return (float(low), float(high)) if low <= high else (np.nan, np.nan)


def hypervolume(points: Points, ideal: tuple[float, float], reference: tuple[float, float]) -> float:
    """Share of the box from ideal to reference (av, hv) that the points dominate; NaN for an empty box."""
    width, height = reference[0] - ideal[0], reference[1] - ideal[1]
    if width <= 0.0 or height <= 0.0:
        return np.nan
    inside = (points.loss_av < reference[0]) & (points.loss_hv < reference[1])
    front = non_dominated(points.chosen(np.flatnonzero(inside)))
    right = np.append(front.loss_av[1:], reference[0])
    return float(np.sum((right - front.loss_av) * (reference[1] - front.loss_hv)) / (width * height))


def compare(front: Points, optima: Points, omegas: tuple[float, ...]) -> Comparison:
    """Front against sweep. optima: one point an omega; NaN where either is empty."""
    if not len(front) or not len(optima):
        return Comparison(np.nan, np.nan, np.nan, np.nan, (np.nan, np.nan))
    omega = np.array(omegas)[:, None]
    best = (omega * front.loss_av + (1.0 - omega) * front.loss_hv).min(axis=1)
    swept = (omega * optima.loss_av + (1.0 - omega) * optima.loss_hv).min(axis=1)
    av = np.concatenate([front.loss_av, optima.loss_av])
    hv = np.concatenate([front.loss_hv, optima.loss_hv])
    # Beyond the nadir, so that the ends of a front count, and so that a single point has a volume.
    ideal, reference = (av.min(), hv.min()), (_BEYOND * float(av.max()), _BEYOND * float(hv.max()))
    excess = best / swept - 1.0
    return Comparison(
        float(excess.max()),
        float(max(-excess.min(), 0.0)),
        hypervolume(front, ideal, reference),
        hypervolume(optima, ideal, reference),
        reference,
    )


# A violated limit of motion weighs more than the earliest contact, which lies in (0, 1].
_VIOLATED = 2.0

Simulated = tuple[Pool, IntArray]
"""Candidates and each one's start, shape (m, 2): number of the gap, delay in samples."""


@dataclass(frozen=True)
class Space:
    """What NSGA-II searches: points of a unit cube of so many dimensions, shape (m, dimensions), as candidates.

    samples: of the accounted time.
    """

    dimensions: int
    samples: int
    simulate: Callable[[FloatArray], Simulated]


def plan_space(task: Task) -> Space | None:
    """Plans (T, v_end, x_final) of one start; None if no duration keeps the limits."""
    durations = possible_durations(task)
    if not len(durations):
        return None
    return Space(3, len(task.scene.target_v), partial(_simulate_plans, task, durations))


def _simulate_plans(task: Task, durations: IntArray, x: FloatArray) -> Simulated:
    return simulate_single(task, *decode(task, durations, x)), np.zeros((len(x), 2), np.int64)


def start_space(posed: StartProblem) -> Space | None:
    """Plans (gap, delay, T, v_end, x_final); None if no start has a duration that keeps the limits."""

    @cache
    def at(gap: int, d: int) -> tuple[Task, IntArray]:
        task = posed.task((gap, d))
        return task, possible_durations(task)

    delays = [
        np.array([d for d in posed.delays(gap) if len(at(gap, int(d))[1])]) for gap in range(len(posed.gaps))
    ]
    gaps = np.array([gap for gap, of in enumerate(delays) if len(of)])
    if not len(gaps):
        return None

    def simulate(x: FloatArray) -> Simulated:
        gap = gaps[_nth(x[:, 0], len(gaps))]
        d = np.array([delays[g][_nth(u, len(delays[g]))] for g, u in zip(gap, x[:, 1], strict=True)])
        start = np.stack([gap, d], axis=1)
        keys, of = np.unique(start, axis=0, return_inverse=True)
        members = [np.flatnonzero(of == k) for k in range(len(keys))]
        pools = []
        for (g, delay), rows in zip(keys.tolist(), members, strict=True):
            task, durations = at(g, delay)
            pools.append(simulate_single(task, *decode(task, durations, x[rows, 2:])))
        return pools[0].joined(*pools[1:]).chosen(np.argsort(np.concatenate(members))), start

    return Space(5, len(posed.problem.packed.target_v), simulate)


def _nth(u: Any, count: int) -> Any:
    return np.minimum((u * count).astype(int), count - 1)


def points_of(pool: Pool, index: IntArray, accounting: str, start: IntArray) -> Points:
    """Candidates of a pool with their losses under an accounting. start: of these candidates, shape (m, 2)."""
    av, hv = pool.losses(accounting)
    shape = pool.n[index], pool.delta[index], pool.change[index]
    return Points(start[:, 0], start[:, 1], *shape, av[index], hv[index])


def sweep(task: Task, accounting: str, omegas: tuple[float, ...]) -> Points:
    """The global optimum for each weight of the AV, free end speed; empty if no plan is feasible."""
    goals = [Goal(accounting, omega) for omega in omegas]
    pool = search(task, goals, known=search(task, goals))
    best = [pool.best(goal) for goal in goals] if len(pool) else [None]
    index = np.array([i for i in best if i is not None], dtype=np.int64)
    return points_of(pool, index, accounting, np.zeros((len(index), 2), np.int64))


def sweep_starts(posed: StartProblem, accounting: str, omegas: tuple[float, ...]) -> Points:
    """The same with the start and the gap chosen."""
    goals, task = [Goal(accounting, omega) for omega in omegas], posed.problem.task
    known = search(task, goals)
    fixed = search_starts(posed, goals, {CONTAINED: known}, free=False)
    contained = fixed[CONTAINED].joined(search(task, goals, known=known))
    pools = search_starts(posed, goals, fixed | {CONTAINED: contained}, free=True)
    best = [one for goal in goals if (one := best_of(pools, goal)) is not None]
    if not best:
        return nothing()
    rows = [pools[one.key].chosen(np.array([one.index])) for one in best]
    chosen = rows[0].joined(*rows[1:])
    return points_of(chosen, np.arange(len(best)), accounting, np.array([one.key for one in best]))


def nsga2_front(
    space: Space | None, accounting: str, *, population: int, generations: int, rng: np.random.Generator
) -> Points:
    """Non-dominated feasible plans after NSGA-II, by rising loss of the AV; empty if there are none."""
    if space is None:
        return nothing()
    # pymoo takes half a second to import: only those who use it pay.
    from pymoo.algorithms.moo.nsga2 import NSGA2
    from pymoo.optimize import minimize

    result = minimize(
        _problem(space, accounting),
        NSGA2(pop_size=population, eliminate_duplicates=False),
        ("n_gen", generations),
        seed=int(rng.integers(2**31)),
        copy_algorithm=False,
    )
    if result.X is None:
        return nothing()
    pool, start = space.simulate(np.atleast_2d(result.X))
    feasible = np.flatnonzero(pool.feasible(accounting))
    return non_dominated(points_of(pool, feasible, accounting, start[feasible]))


def nothing() -> Points:
    """No points."""
    none, number = np.zeros(0), np.zeros(0, np.int64)
    return Points(number, number, number, none, none, none, none)


def _problem(space: Space, accounting: str) -> Any:
    from pymoo.core.problem import Problem

    class _Plans(Problem):  # type: ignore[misc]  # pymoo has no types
        def __init__(self) -> None:
            m = space.dimensions
            super().__init__(n_var=m, n_obj=2, n_ieq_constr=1, xl=np.zeros(m), xu=np.ones(m))

        def _evaluate(self, x: FloatArray, out: dict[str, FloatArray], *_: Any, **__: Any) -> None:
            pool, _start = space.simulate(x)
            out["F"] = np.stack(pool.losses(accounting), axis=1)
            early = 1.0 - np.minimum(pool.contact, space.samples) / space.samples
            violated = np.where(pool.violation > 0, _VIOLATED, np.maximum(early, 1e-3))
            out["G"] = np.where(pool.feasible(accounting), 0.0, violated)[:, None]

    return _Plans()


def decode(task: Task, durations: IntArray, x: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Plans (n, delta, change) from points of the unit cube, shape (m, 3).

    The second coordinate spans the end speeds and the third the distances that the limits leave at each T.
    """
    n = durations[_nth(x[:, 0], len(durations))]
    T, v0, limit = n * task.scene.dt, task.scene.v0, task.limit
    widest = limit.jerk * T**2 / 6.0
    low, high = np.maximum(limit.v_min - v0, -widest), np.minimum(limit.v_max - v0, widest)
    change = low + x[:, 1] * (high - low)
    low, high = forward_interval(T, change, v0, limit)
    return n, low + x[:, 2] * np.maximum(high - low, 0.0), change


def simulate_single(task: Task, n: IntArray, delta: FloatArray, change: FloatArray) -> Pool:
    """Single plans through the kernel: those of one duration share its tiles."""
    order = np.argsort(n, kind="stable")
    _, start, count = np.unique(n[order], return_index=True, return_counts=True)
    firsts = np.concatenate([np.arange(s, s + c, WIDTH) for s, c in zip(start, count, strict=True)])
    ends = np.minimum(firsts + WIDTH, np.repeat(start + count, -(-count // WIDTH)))
    # Rows are filled up with their last plan.
    place = np.minimum(firsts[:, None] + np.arange(WIDTH), ends[:, None] - 1)
    pool = task.simulate(n[order[firsts]], delta[order[place]], change[order[place]])
    back = np.empty(len(n), np.int64)
    back[order[place].ravel()] = np.arange(place.size)
    return Pool(*(getattr(pool, name)[back] for name in Pool.__dataclass_fields__))


OFFSETS: Final = 31
"""Nodes over x_final - v0 T; odd, so that constant speed is one, and just below two tiles of candidates."""
EVERY: Final = 2
"""Every second duration of the planner's grid has a row."""
ON_SURFACE: Final = (names.CONSTANT, names.HUMAN, *PAIRS[names.FIXED])
"""The policies that are points of the surface: end speed = start speed, or nearly so (human)."""
MOTION, CONTACT = "motion", "contact"
BLOCKERS: Final = ("", MOTION, CONTACT, *SAFETY)
"""What may stand in a candidate's way: nothing, limits of motion, somebody, a constraint of the safety profile."""
_SMALLEST_HALF_WIDTH_M: Final = 12.0
_MARGIN: Final = 1.25


@dataclass(frozen=True)
class SurfacePoint:
    """Where a policy lies: T [s] (human: duration) and x_final - v0 T [m] (human: x at the end)."""

    policy: str
    accounting: str
    T: float
    x_offset: float


@dataclass(frozen=True)
class LossSurface:
    """Losses of the fixed form (end speed = start speed) over a grid of T and x_final.

    T [s], shape (m,); x_offset: x_final - v0 T [m], shape (n,), the same for every T; v0 [m/s]. By accounting:
    loss_av, loss_hv, shape (m, n), also where a limit is violated (NaN where vehicles run through each other
    without bound); feasible: boolean, shape (m, n); blocked: place in ``BLOCKERS`` of what a candidate
    breaks first, 0 = nothing, shape (m, n). points: optima, human and constant speed.
    """

    T: FloatArray
    x_offset: FloatArray
    v0: float
    loss_av: Mapping[str, FloatArray]
    loss_hv: Mapping[str, FloatArray]
    feasible: Mapping[str, NDArray[np.bool_]]
    points: tuple[SurfacePoint, ...]
    blocked: Mapping[str, NDArray[np.uint8]] = field(default_factory=dict)

    @property
    def x_final(self) -> FloatArray:
        """Forward distance at T [m], shape (m, n)."""
        return self.v0 * self.T[:, None] + self.x_offset

    def joint(self, accounting: str, omega_av: float) -> FloatArray:
        """Joint objective under an accounting, NaN where infeasible; shape (m, n)."""
        value = joint_objective(self.loss_av[accounting], self.loss_hv[accounting], omega_av)
        return np.where(self.feasible[accounting], value, np.nan)


def loss_surface(problem: PlanningProblem, points: tuple[SurfacePoint, ...]) -> LossSurface:
    """The surface of an event, wide enough for the points."""
    n = problem.task.durations[::EVERY]
    width = max([_MARGIN * abs(point.x_offset) for point in points] + [_SMALLEST_HALF_WIDTH_M])
    x = np.linspace(-width, width, OFFSETS)
    delta = np.tile(x, (n.size, 1))
    pool = problem.task.simulate(n, delta, np.zeros_like(delta))
    # Arrays are shared between accountings that charge a side over the same time.
    av_T, av_H, hv_T, hv_H = (_table(pool, name, n.size) for name in ("av_T", "av_H", "hv_T", "hv_H"))
    return LossSurface(
        T=np.asarray(n * problem.packed.dt, np.float64),
        x_offset=x,
        v0=problem.packed.v0,
        loss_av={names.PAPER: av_T, names.FOLLOWER_HORIZON: av_T, names.EQUAL: av_H},
        loss_hv={names.PAPER: hv_T, names.FOLLOWER_HORIZON: hv_H, names.EQUAL: hv_H},
        feasible={a: pool.feasible(a).reshape(n.size, -1) for a in names.ACCOUNTINGS},
        points=points,
        blocked={a: blocked(pool, a).reshape(n.size, -1) for a in names.ACCOUNTINGS},
    )


def blocked(pool: Pool, accounting: str) -> NDArray[np.uint8]:
    """What each candidate breaks first, by its place in ``BLOCKERS``."""
    moving, code = pool.within_limits, pool.violation
    found = np.where(code > OVERTAKES, BLOCKERS.index(SAFETY[0]) + code - OVERTAKES - 1, 0)
    found = np.where(moving & pool.touches(accounting), BLOCKERS.index(CONTACT), found)
    return np.where(moving, found, BLOCKERS.index(MOTION)).astype(np.uint8)


def _table(pool: Pool, name: str, rows: int) -> FloatArray:
    values: FloatArray = np.asarray(getattr(pool, name)).reshape(rows, -1)
    return np.where(np.isfinite(values), values, np.nan)
