"""Zooming in: ever finer clouds of candidates about many starts at once, each in a frame that follows its valley.

The objective is a sum of absolute values: its minima lie at the bottom of narrow, slanted valleys, and a window
that shrinks alike in all directions gets stuck on their walls. So after every level a start's frame is set to the
spread of its best candidates, and narrows across the valley before it narrows along.

Edges of what is feasible: where neighbouring candidates differ in what stands in their way.

Beside a contact the best plan lies on an edge, or in a slot between two vehicles that no node of a grid falls
into. Losses are known of infeasible candidates as well, so an interval is worth a look only if its ends promise
less than the best feasible plan: best-first bisection, many intervals at a time.
"""

import math
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.core.kernels import UNALIASED, kernel
from highd_lc.core.losses import LossTerms
from highd_lc.planning.candidates import Outcomes, evaluate_into, new_outcomes
from highd_lc.planning.contacts import NO_CONTACT, WIDTH
from highd_lc.planning.crowd import Crowd, own_crowd
from highd_lc.planning.limits import Limits, forward_interval, started_violation
from highd_lc.planning.pool import NOTHING_BEFORE, OVERTAKES, Before, Goal, Pool, Task
from highd_lc.planning.scene import PackedScene
from highd_lc.vocab import names

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_ELITE: Final = 4
"""Candidates of a level whose spread sets the next frame."""
_SPREAD: Final = 1.8
"""Half-width of a frame over the root mean square of that spread; sqrt(3) would keep an even one as it is."""
_NARROWEST, _WIDEST = 0.3, 0.8
"""Bounds of a frame's next width over its width."""


def _sunflower() -> FloatArray:
    """Evenly spread points on a disc that covers the unit square but for its corners, shape (WIDTH, 2)."""
    i = np.arange(WIDTH) + 0.5
    radius, angle = 1.2 * np.sqrt(i / WIDTH), i * np.pi * (3.0 - np.sqrt(5.0))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


_SUNFLOWER: Final = _sunflower()
_LINE: Final = np.stack([np.linspace(-1.0, 1.0, WIDTH), np.zeros(WIDTH)], axis=1)
_LINE_SHRINK: Final = 1.3 * 2.0 / (WIDTH - 1)
"""The next line reaches a step and a third of this one to either side."""


@dataclass(frozen=True)
class Starts:
    """S starts. n: durations [samples]; goal: index of each one's goal, both of shape (S,).

    centre, shape (S, 2): bend [m] and change [m/s] (see ``basins``). frame, shape (S, 2, 2): columns = half-axes.
    """

    n: IntArray
    goal: IntArray
    centre: FloatArray
    frame: FloatArray


@dataclass(frozen=True)
class Clouds:
    """What was simulated: delta, change, outcomes and violation codes of shape (levels, S, WIDTH)."""

    delta: FloatArray
    change: FloatArray
    outcomes: Outcomes
    codes: IntArray


def zoom(
    task: Task, pool: Pool, goals: list[Goal], starts: Starts, *, levels: int, free: bool
) -> tuple[Pool, IntArray]:
    """The pool with ever finer candidates about the starts, and the index of the best one of each start.

    -1 where no candidate of a start was feasible.
    """
    clouds, best = follow_valleys(task, goals, starts, levels=levels, free=free)
    found = Pool(
        n=np.tile(np.repeat(starts.n, WIDTH), levels),
        delta=clouds.delta.ravel(),
        change=clouds.change.ravel(),
        **{name: values.ravel() for name, values in clouds.outcomes._asdict().items() if name != "unsafe"},
        violation=clouds.codes.ravel(),
    )
    return pool.joined(found), np.where(best >= 0, best + len(pool), -1)


def follow_valleys(
    task: Task, goals: list[Goal], starts: Starts, *, levels: int, free: bool
) -> tuple[Clouds, IntArray]:
    """Simulate the clouds about the starts; the place of each start's best candidate among them, or -1."""
    shape = (levels, len(starts.n), WIDTH)
    clouds = Clouds(np.empty(shape), np.empty(shape), new_outcomes(shape), np.empty(shape, np.int64))
    best = np.full(len(starts.n), -1)
    asked = [goals[g] for g in starts.goal]
    accounting = np.array([names.ACCOUNTINGS.index(goal.accounting) for goal in asked], np.int64)
    omega = np.array([goal.omega_av for goal in asked])
    _follow_valleys(
        starts.n, accounting, omega, starts.centre.copy(), starts.frame.copy(), _SUNFLOWER if free else _LINE,
        free, task.scene, task.crowd or own_crowd(task.scene), task.terms, task.limit,
        task.before or NOTHING_BEFORE, task.before is not None,
        clouds.delta, clouds.change, clouds.outcomes, clouds.codes, best,
    )  # fmt: skip
    return clouds, best


_PAPER: Final = names.ACCOUNTINGS.index(names.PAPER)
_EQUAL: Final = names.ACCOUNTINGS.index(names.EQUAL)
_forward_interval: Any = njit(cache=True)(forward_interval)


@kernel(error_model="numpy", **UNALIASED)
def _follow_valleys(
    n: IntArray,
    accounting: IntArray,
    omega: FloatArray,
    centre: FloatArray,
    frame: FloatArray,
    cloud: FloatArray,
    free: bool,
    scene: PackedScene,
    crowd: Crowd,
    terms: LossTerms,
    limit: Limits,
    before: Before,
    starts_later: bool,
    delta: FloatArray,
    change: FloatArray,
    outcomes: Outcomes,
    codes: IntArray,
    best: IntArray,
) -> None:
    """Fill delta .. best (see ``follow_valleys``); centre and frame move on with the levels."""
    starts, value, row = len(n), np.full(len(n), np.inf), np.empty(WIDTH)
    for level in range(len(delta)):
        at = Outcomes(
            outcomes.av_T[level], outcomes.av_H[level], outcomes.hv_T[level], outcomes.hv_H[level],
            outcomes.contact[level], outcomes.role[level], outcomes.unsafe[level],
        )  # fmt: skip
        for s in range(starts):
            _place_cloud(
                n[s] * scene.dt, centre[s], frame[s], cloud, scene, limit, delta[level, s], change[level, s]
            )
        evaluate_into(n, delta[level], change[level], scene, crowd, terms, at)
        for s in range(starts):
            T = n[s] * scene.dt
            for w in range(WIDTH):
                d, c = delta[level, s, w], change[level, s, w]
                code = started_violation(T, d, c, scene.v0, scene.D, scene.start, limit)
                if starts_later:
                    front = scene.length / 2.0 + scene.v0 * T + d
                    code = OVERTAKES if code == 0 and front >= scene.target_front[n[s]] else code
                    at.av_T[s, w] += before.av
                    at.av_H[s, w] += before.av
                    at.hv_T[s, w] += before.hv + before.hv_passed[n[s]]
                    at.hv_H[s, w] += before.hv + before.hv_passed[-1]
                if code == 0 and at.unsafe[s, w] > 0:
                    code = OVERTAKES + at.unsafe[s, w]
                codes[level, s, w] = code
                own = at.av_H[s, w] if accounting[s] == _EQUAL else at.av_T[s, w]
                others = at.hv_T[s, w] if accounting[s] == _PAPER else at.hv_H[s, w]
                last = n[s] if accounting[s] == _PAPER else NO_CONTACT - 1
                feasible = code == 0 and at.contact[s, w] > last
                row[w] = omega[s] * own + (1.0 - omega[s]) * others if feasible else np.inf
            lowest = np.argmin(row)
            origin_0, origin_1 = 0.0, 0.0
            if row[lowest] < value[s]:
                value[s], best[s] = row[lowest], (level * starts + s) * WIDTH + lowest
                centre[s, 1] = change[level, s, lowest]
                centre[s, 0] = delta[level, s, lowest] - centre[s, 1] * T / 2.0
                origin_0, origin_1 = cloud[lowest]
            if free:
                _narrow(row, cloud, origin_0, origin_1, frame[s])
            else:
                frame[s] *= _LINE_SHRINK


@kernel(error_model="numpy", **UNALIASED)
def _place_cloud(
    T: float,
    centre: FloatArray,
    frame: FloatArray,
    cloud: FloatArray,
    scene: PackedScene,
    limit: Limits,
    delta: FloatArray,
    change: FloatArray,
) -> None:
    """Fill delta and change of a start's candidates, moved into the interval of what is possible."""
    for w in range(WIDTH):
        bend = centre[0] + frame[0, 0] * cloud[w, 0] + frame[0, 1] * cloud[w, 1]
        wanted = centre[1] + frame[1, 0] * cloud[w, 0] + frame[1, 1] * cloud[w, 1]
        change[w] = min(max(wanted, limit.v_min - scene.v0), limit.v_max - scene.v0)
        low, high = _forward_interval(T, change[w], scene.v0, limit, scene.start.ax)
        delta[w] = min(max(bend + change[w] * T / 2.0, low), max(high, low))


@kernel(error_model="numpy", **UNALIASED)
def _narrow(value: FloatArray, cloud: FloatArray, origin_0: float, origin_1: float, frame: FloatArray) -> None:
    """Turn and narrow a frame to the spread of its best candidates about the next centre (in this frame)."""
    count, xx, xy, yy = 0, 0.0, 0.0, 0.0
    for w in np.argsort(value, kind="mergesort")[:_ELITE]:
        if np.isfinite(value[w]):
            x, y = cloud[w, 0] - origin_0, cloud[w, 1] - origin_1
            count, xx, xy, yy = count + 1, xx + x * x, xy + x * y, yy + y * y
    # Eigenvectors of a symmetric matrix of two rows: the spread along and across the valley.
    angle, half = 0.5 * np.arctan2(2.0 * xy, xx - yy), np.hypot(0.5 * (xx - yy), xy)
    middle, cos, sin = 0.5 * (xx + yy), np.cos(angle), np.sin(angle)
    along = _next_width((middle + half) / max(count, 1))
    across = _next_width((middle - half) / max(count, 1))
    for i in range(2):
        first, second = frame[i]
        frame[i, 0] = across * (second * cos - first * sin)
        frame[i, 1] = along * (first * cos + second * sin)


@njit(inline="always")
def _next_width(mean_square: float) -> float:
    return min(max(_SPREAD * math.sqrt(max(mean_square, 0.0)), _NARROWEST), _WIDEST)


_LEVELS: Final = 6
_AT_ONCE: Final = 24
"""Intervals of each goal that are divided at a level."""
_NARROW_M: Final = 2e-3
_WORTHWHILE: Final = 2e-4
"""Relative gain that an interval must promise."""


def refine_edges(task: Task, pool: Pool, goals: list[Goal]) -> Pool:
    """The pool with finer candidates across the edges that promise more than the best of some goal."""
    between = np.linspace(0.0, 1.0, WIDTH + 2)[1:-1]
    low, high = _intervals(pool, goals)
    for _ in range(_LEVELS):
        chosen = _promising(pool, goals, low, high)
        if not len(chosen):
            break
        start, end = pool.delta[low[chosen]][:, None], pool.delta[high[chosen]][:, None]
        change = np.repeat(pool.change[low[chosen]][:, None], WIDTH, axis=1)
        found = task.simulate(pool.n[low[chosen]], start + (end - start) * between, change)
        low, high = _divided(low, high, chosen, len(pool))
        pool = pool.joined(found)
    return pool


def _intervals(pool: Pool, goals: list[Goal]) -> tuple[IntArray, IntArray]:
    """The candidates at both ends of the intervals of the lines over x_final on which one promises something."""
    wanted = np.logical_or.reduce([pool.unconstrained(goal) < _target(pool, goal) for goal in goals])
    if not wanted.any():
        return np.empty(0, np.int64), np.empty(0, np.int64)
    durations = np.zeros(pool.n.max() + 1, np.bool_)
    durations[pool.n[wanted]] = True
    on = np.flatnonzero(durations[pool.n])
    changes = np.unique(pool.change[wanted])
    change = np.searchsorted(changes[:-1], pool.change[on])
    same = changes[change] == pool.change[on]
    on, change = on[same], change[same]
    several = np.bincount(change)[change] > 1  # of a cloud each candidate has a change of its own
    on, change = on[several], change[several]
    on = on[np.lexsort((pool.delta[on], change, pool.n[on]))]
    one_line = np.flatnonzero((np.diff(pool.n[on]) == 0) & (np.diff(pool.change[on]) == 0.0))
    return on[one_line], on[one_line + 1]


def _promising(pool: Pool, goals: list[Goal], low: IntArray, high: IntArray) -> IntArray:
    """Places of the intervals to divide: the most promising of each goal that hold an edge."""
    wide, chosen = pool.delta[high] - pool.delta[low] > _NARROW_M, np.zeros(len(low), np.bool_)
    for goal in goals:
        value, obstacle = pool.unconstrained(goal), partial(pool.obstacle, goal.accounting)
        promise = np.minimum(value[low], value[high])
        where = np.flatnonzero(wide & (promise < _target(pool, goal)))
        where = where[obstacle(low[where]) != obstacle(high[where])]
        chosen[where[np.argsort(promise[where], kind="stable")[:_AT_ONCE]]] = True
    return np.flatnonzero(chosen)


def _divided(low: IntArray, high: IntArray, chosen: IntArray, first: int) -> tuple[IntArray, IntArray]:
    """The intervals in the same order, the chosen ones divided at WIDTH candidates each, from ``first`` on."""
    inner = first + np.arange(len(chosen) * WIDTH).reshape(-1, WIDTH)
    starts = np.insert(low, np.repeat(chosen + 1, WIDTH), inner.ravel())
    ends = np.insert(high, np.repeat(chosen, WIDTH), inner.ravel())
    return starts, ends


def _target(pool: Pool, goal: Goal) -> float:
    best = pool.best(goal)
    return np.inf if best is None else float(pool.objective(goal)[best]) * (1.0 - _WORTHWHILE)


def hides_better(pool: Pool, goal: Goal) -> bool:
    """Whether some infeasible candidate promises more than the best feasible one."""
    return bool((pool.unconstrained(goal) < _target(pool, goal)).any())
