"""The front of what AV and followers can have at once: NSGA-II over (T, x_final, v_end), beside the omega sweep.

NSGA-II (pymoo) knows nothing of the global search: it starts from random plans. The sweep's optima minimise
omega Loss_AV + (1 - omega) Loss_HV, so they lie on the convex hull of the true front. Where the two disagree, one
of the methods has failed, and ``compare`` says by how much.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from highd_lc.algorithms.contacts import LANES
from highd_lc.algorithms.dynamics import forward_interval
from highd_lc.algorithms.pool import Goal, Pool, Task
from highd_lc.algorithms.refinement import possible_durations
from highd_lc.algorithms.search import search

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# A violated limit of motion weighs more than the earliest contact, which lies in (0, 1].
_VIOLATED = 2.0
# The hypervolume's reference point over the worst losses of either method.
_BEYOND = 1.1


@dataclass(frozen=True)
class Points:
    """Plans and their losses, each of shape (m,): n samples of T, delta [m], change [m/s] as in ``Pool``."""

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


def points_of(pool: Pool, index: IntArray, accounting: str) -> Points:
    """Candidates of a pool with their losses under an accounting."""
    av, hv = pool.losses(accounting)
    return Points(pool.n[index], pool.delta[index], pool.change[index], av[index], hv[index])


def sweep(task: Task, accounting: str, omegas: tuple[float, ...]) -> Points:
    """The global optimum for each weight of the AV, free form; empty if no plan is feasible."""
    goals = [Goal(accounting, omega) for omega in omegas]
    pool = search(task, goals, known=search(task, goals))
    best = [pool.best(goal) for goal in goals] if len(pool) else [None]
    index = np.array([i for i in best if i is not None], dtype=np.int64)
    return points_of(pool, index, accounting)


def nsga2_front(
    task: Task, accounting: str, *, population: int, generations: int, rng: np.random.Generator
) -> Points:
    """Non-dominated feasible plans after NSGA-II, by rising loss of the AV; empty if there are none."""
    durations = possible_durations(task)
    if not len(durations):
        return _nothing()
    # pymoo takes half a second to import: only those who use it pay.
    from pymoo.algorithms.moo.nsga2 import NSGA2
    from pymoo.optimize import minimize

    result = minimize(
        _problem(task, durations, accounting),
        NSGA2(pop_size=population, eliminate_duplicates=False),
        ("n_gen", generations),
        seed=int(rng.integers(2**31)),
        copy_algorithm=False,
    )
    if result.X is None:
        return _nothing()
    plans = decode(task, durations, np.atleast_2d(result.X))
    pool = _simulate(task, *plans)
    return non_dominated(points_of(pool, np.flatnonzero(pool.feasible(accounting)), accounting))


def _nothing() -> Points:
    return Points(np.zeros(0, np.int64), *(np.zeros(0) for _ in range(4)))


def _problem(task: Task, durations: IntArray, accounting: str) -> Any:
    from pymoo.core.problem import Problem

    class _Plans(Problem):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__(n_var=3, n_obj=2, n_ieq_constr=1, xl=np.zeros(3), xu=np.ones(3))

        def _evaluate(self, x: FloatArray, out: dict[str, FloatArray], *_: Any, **__: Any) -> None:
            pool = _simulate(task, *decode(task, durations, x))
            out["F"] = np.stack(pool.losses(accounting), axis=1)
            early = 1.0 - np.minimum(pool.contact, len(task.scene.target_v)) / len(task.scene.target_v)
            violated = np.where(pool.violation > 0, _VIOLATED, np.maximum(early, 1e-3))
            out["G"] = np.where(pool.feasible(accounting), 0.0, violated)[:, None]

    return _Plans()


def decode(task: Task, durations: IntArray, x: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Plans (n, delta, change) from points of the unit cube, shape (m, 3).

    The second coordinate spans the end speeds and the third the distances that the limits leave at each T.
    """
    n = durations[np.minimum((x[:, 0] * len(durations)).astype(int), len(durations) - 1)]
    T, v0, limit = n * task.scene.dt, task.scene.v0, task.limit
    widest = limit.jerk * T**2 / 6.0
    low, high = np.maximum(limit.v_min - v0, -widest), np.minimum(limit.v_max - v0, widest)
    change = low + x[:, 1] * (high - low)
    low, high = forward_interval(T, change, v0, limit)
    return n, low + x[:, 2] * np.maximum(high - low, 0.0), change


def _simulate(task: Task, n: IntArray, delta: FloatArray, change: FloatArray) -> Pool:
    """Single plans through the kernel: those of one duration share its tiles."""
    order = np.argsort(n, kind="stable")
    _, start, count = np.unique(n[order], return_index=True, return_counts=True)
    firsts = np.concatenate([np.arange(s, s + c, LANES) for s, c in zip(start, count, strict=True)])
    ends = np.minimum(firsts + LANES, np.repeat(start + count, -(-count // LANES)))
    # Rows are filled up with their last plan.
    place = np.minimum(firsts[:, None] + np.arange(LANES), ends[:, None] - 1)
    pool = task.simulate(n[order[firsts]], delta[order[place]], change[order[place]])
    back = np.empty(len(n), np.int64)
    back[order[place].ravel()] = np.arange(place.size)
    return Pool(*(getattr(pool, name)[back] for name in Pool.__dataclass_fields__))


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
