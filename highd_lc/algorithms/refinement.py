"""Refinement of a pool: from the best candidates of each goal ever finer grids, along T step by step."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.algorithms.dynamics import forward_interval, violations
from highd_lc.algorithms.pool import Goal, Pool, Task

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_ZOOM_FIXED: Final = 16
_ZOOM_FREE: Final = 8
_OVERLAP: Final = 1.3
_FIRST_LEVELS: Final = 2
"""Levels that tell basins apart, and durations in the fixed form; only the best one is refined further."""
_STEPS_FIXED: Final = (-4, -3, -2, -1, 1, 2, 3, 4)
_STEPS_FREE: Final = (-2, -1, 0, 1, 2)
"""Durations explored about the best one [samples]; 0: that one once more."""
_MOST_ROUNDS: Final = 30
"""Bound on the walk along T; it ends by itself after a few rounds."""


@dataclass(frozen=True)
class Starts:
    """Where to zoom in: duration, centre, half-widths and goal of each start, all of shape (S,)."""

    n: IntArray
    delta: FloatArray
    change: FloatArray
    half_delta: FloatArray
    half_change: FloatArray
    goal: IntArray


Row = tuple[int, int, int]
"""A start: duration in samples, index of the candidate that is moved there, goal."""


def refine(task: Task, pool: Pool, goals: list[Goal], *, free: bool) -> Pool:
    """The pool with finer candidates about the best of each goal: basins, then durations, then the last digits."""
    pool = zoom(task, pool, goals, _basins(task, pool, goals), free=free)
    if free:
        # Two unknowns settle slowly: durations can be told apart only once the last digits are there.
        pool = zoom(task, pool, goals, _best(pool, goals), free=free, finest=True)
    explored: set[int] = set()
    for _ in range(_MOST_ROUNDS):
        rows = _neighbours(task, pool, goals, explored, _STEPS_FREE if free else _STEPS_FIXED)
        pool = zoom(task, pool, goals, rows, free=free, finest=free)
        if not rows:
            break
    return pool if free else zoom(task, pool, goals, _best(pool, goals), free=free, finest=True)


def _best(pool: Pool, goals: list[Goal]) -> list[Row]:
    """The best candidate of each goal that has one."""
    best = [(g, pool.best(goal)) for g, goal in enumerate(goals)] if len(pool) else []
    return [(int(pool.n[i]), i, g) for g, i in best if i is not None]


def possible_durations(task: Task) -> IntArray:
    """Durations whose lateral motion keeps the limits: it does not depend on the rest."""
    n = task.durations
    zero = np.zeros((len(n), 1))
    codes = violations(task.seconds(n), zero, zero, task.scene.v0, task.scene.D, task.limit)[:, 0]
    possible: IntArray = n[(codes != 1) & (codes != 2)]
    return possible


def x_nodes(task: Task, free: bool) -> int:
    """Nodes over x_final: odd, so that the middle one is the smoothest motion."""
    return 2 * ((task.settings.x_nodes - 1) // (4 if free else 2)) + 1


def _basins(task: Task, pool: Pool, goals: list[Goal]) -> list[Row]:
    """The best durations of each goal, each with its best candidate; goals with the same ones once."""
    rows: dict[tuple[float, tuple[int, ...]], int] = {}
    for g, goal in enumerate(goals):
        if len(pool):
            chosen = _best_of_basins(pool, pool.objective(goal), task.settings.zoom_starts)
            rows.setdefault((goal.omega_av, tuple(chosen)), g)
    return [(int(pool.n[i]), i, g) for (_, chosen), g in rows.items() for i in chosen]


def _neighbours(
    task: Task, pool: Pool, goals: list[Goal], explored: set[int], steps: tuple[int, ...]
) -> list[Row]:
    """The durations ``steps`` from each goal's best candidate, unless that one's have been explored."""
    rows: list[Row] = []
    allowed = set(possible_durations(task).tolist())
    for n, best, g in _best(pool, goals):
        if best not in explored:
            explored.add(best)
            rows += [(n + step, best, g) for step in steps if n + step in allowed]
    return rows


def _at(task: Task, pool: Pool, free: bool, rows: list[Row]) -> Starts:
    """Where to zoom in for each row."""
    n, index, goal_of = (np.array(column) for column in zip(*rows, strict=True))
    T = task.seconds(n)
    change = pool.change[index]
    # The same shape at another T: delta grows with T through the change of speed only.
    delta = pool.delta[index] + change * (T - task.seconds(pool.n[index])) / 2.0
    widest = np.minimum(task.limit.jerk * T**3 / 60.0, (task.limit.v_max - task.limit.v_min) * T / 1.875)
    fastest = np.minimum(task.limit.jerk * T**2 / 6.0, task.limit.v_max - task.limit.v_min)
    return Starts(
        n=n,
        delta=delta,
        change=change,
        half_delta=_spacing(delta - change * T / 2.0, widest, x_nodes(task, free)),
        half_change=_spacing(change, fastest, task.settings.v_nodes) if free else np.zeros(len(n)),
        goal=goal_of,
    )


def _spacing(value: FloatArray, widest: FloatArray, nodes: int) -> FloatArray:
    """Distance to the next node of the first grid, whose nodes lie at widest s |s|."""
    step = 2.0 / (nodes - 1)
    return widest * step * (2.0 * np.sqrt(np.minimum(np.abs(value) / widest, 1.0)) + step)


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


def zoom(task: Task, pool: Pool, goals: list[Goal], rows: list[Row], *, free: bool, finest: bool = False) -> Pool:
    """The pool with ever finer grids about each row's best candidate so far.

    finest: go on where the first levels have ended.
    """
    if not rows:
        return pool
    starts = _at(task, pool, free, rows)
    shrink = _OVERLAP * 2.0 / ((_ZOOM_FREE if free else _ZOOM_FIXED) - 1)
    levels = task.settings.zoom_levels_free if free else task.settings.zoom_levels
    scale = shrink**_FIRST_LEVELS if finest else 1.0
    half = (starts.half_delta * scale, starts.half_change * scale)
    centre, best, found = (starts.delta.copy(), starts.change.copy()), np.full(len(rows), np.inf), []
    for _ in range(levels - _FIRST_LEVELS if finest else _FIRST_LEVELS):
        deltas, changes = _around_centres(task, starts.n, centre, half, _offsets(free))
        found.append(task.simulate(starts.n, deltas, changes))
        objective = _of_rows(found[-1], goals, starts.goal, deltas.shape[1])
        i = np.argmin(objective, axis=1)
        better = np.flatnonzero(np.take_along_axis(objective, i[:, None], 1)[:, 0] < best)
        best[better] = objective[better, i[better]]
        centre[0][better], centre[1][better] = deltas[better, i[better]], changes[better, i[better]]
        half = (half[0] * shrink, half[1] * shrink)
    return pool.joined(*found)


def _of_rows(pool: Pool, goals: list[Goal], goal_of: IntArray, width: int) -> FloatArray:
    """Each row's candidates in the row's own objective, shape (rows, width)."""
    every = np.stack([pool.objective(goal).reshape(-1, width) for goal in goals])
    return every[goal_of, np.arange(len(goal_of))]


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
    T = task.seconds(n)[:, None]
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
