"""Refinement of a pool: across edges, about the best basins of each goal, along T, and to the last digits."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.algorithms.basins import Head, basins, node_step, widest, x_nodes
from highd_lc.algorithms.contacts import LANES
from highd_lc.algorithms.dynamics import violations
from highd_lc.algorithms.edges import hides_better, refine_edges
from highd_lc.algorithms.pool import Goal, Pool, Task, distinct
from highd_lc.algorithms.zoom import Starts, zoom

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_RIVAL: Final = 0.01
"""Basins that are relatively worse by less than this are followed along T beside the best one."""
_STEPS: Final = (-4, -3, -2, -1, 1, 2, 3, 4)
"""Durations that are tried from each duration reached [samples]."""
_STEPS_UNACCELERATED: Final = {True: (-2, 2), False: ()}
_UNDECIDED: Final = 0.002
_FINALISTS: Final = 3
_BESIDE: Final = 0.5
"""Window of the zoom at a duration beside the one reached, over a step of the grid."""
_FINEST: Final = {True: 0.02, False: 0.03}
"""Window of the last zoom over that of the first, of the free and of the fixed form."""

Row = tuple[int, int, int]
"""A start: duration in samples, index of the candidate that is moved there, goal."""
Place = tuple[int, bool, bool, int]
"""A goal, whether plans of a basin get ahead of the smoothest motion, whether they end faster, a duration."""


def refine(task: Task, pool: Pool, goals: list[Goal], *, free: bool) -> Pool:
    """The pool with finer candidates about the best of each goal."""
    pool = refine_edges(task, pool, goals)
    pool, heads = _zoom_heads(task, pool, goals, basins(task, pool, goals, free=free), free=free)
    explored: set[Place] = set()
    while rows := _beside(task, pool, _leading(pool, goals, heads), explored, free=free):
        pool, starts = _into_slots(task, pool, goals, rows) if free else (pool, rows)
        pool, found = zoom_rows(task, pool, goals, starts, free=free, window=_BESIDE)
        heads = _stepped(pool, goals, rows, found)
    return _zoom_heads(task, pool, goals, _finalists(pool, goals), free=free, window=_FINEST[free])[0]


def possible_durations(task: Task) -> IntArray:
    """Durations whose lateral motion keeps the limits: it does not depend on the rest."""
    n = task.durations
    zero = np.zeros((len(n), 1))
    codes = violations(task.seconds(n), zero, zero, task.scene.v0, task.scene.D, task.limit)[:, 0]
    possible: IntArray = n[(codes != 1) & (codes != 2)]
    return possible


def zoom_rows(
    task: Task, pool: Pool, goals: list[Goal], rows: list[Row], *, free: bool, window: float = 1.0
) -> tuple[Pool, IntArray]:
    """The pool with ever finer candidates about those of the rows, and the best one of each row, -1 for none.

    window: width of the first cloud over a step of the grid.
    """
    if not rows:
        return pool, np.empty(0, np.int64)
    n, index, goal = (np.array(column) for column in zip(*rows, strict=True))
    starts = Starts(n, goal, *_window(task, pool, n, index, free=free, window=window))
    levels = task.settings.zoom_levels_free if free else task.settings.zoom_levels
    return zoom(task, pool, goals, starts, levels=levels, free=free)


def _zoom_heads(
    task: Task, pool: Pool, goals: list[Goal], heads: list[Head], *, free: bool, window: float = 1.0
) -> tuple[Pool, list[Head]]:
    rows = [(int(pool.n[i]), i, g) for i, g in heads]
    pool, found = zoom_rows(task, pool, goals, rows, free=free, window=window)
    return pool, _stepped(pool, goals, rows, found)


def _window(
    task: Task, pool: Pool, n: IntArray, index: IntArray, *, free: bool, window: float
) -> tuple[FloatArray, FloatArray]:
    """Centres and frames about candidates that are moved to durations n: as wide as the grid's steps there."""
    change = pool.change[index]
    bend = pool.delta[index] - change * task.seconds(pool.n[index]) / 2.0
    largest = widest(task, task.seconds(n))
    frame = np.zeros((len(n), 2, 2))
    frame[:, 0, 0] = window * node_step(bend, largest.bend, x_nodes(task, free))
    frame[:, 1, 1] = window * node_step(change, largest.change, task.settings.v_nodes)
    return np.stack([bend, change], axis=1), frame


def _leading(pool: Pool, goals: list[Goal], heads: list[Head]) -> list[Head]:
    """Whose durations to vary next: each goal's best candidate, and the heads of basins that are hardly worse.

    A goal that makes the same of every candidate as one before it needs nothing of its own.
    """
    leading: list[Head] = []
    for g in distinct(pool, goals):
        value, best = pool.objective(goals[g]), pool.best(goals[g])
        if best is not None:
            rivals = [i for i, of in heads if of == g and value[i] <= value[best] * (1.0 + _RIVAL)]
            leading += [(i, g) for i in [best, *rivals]]
    return leading


def _beside(task: Task, pool: Pool, heads: list[Head], explored: set[Place], *, free: bool) -> list[Row]:
    """The heads moved to the durations about theirs, each basin to each duration once.

    The grid has an unaccelerated plan at every duration. With a free end speed it may hide a better one close by.
    """
    allowed, rows = set(possible_durations(task).tolist()), []
    for i, g in heads:
        n, delta, change = int(pool.n[i]), float(pool.delta[i]), float(pool.change[i])
        steps = _STEPS if delta or change else _STEPS_UNACCELERATED[free]
        basin = (g, delta > change * n * task.scene.dt / 2.0, change > 0.0)
        explored.add((*basin, n))
        wanted = [n + step for step in steps if n + step in allowed and (*basin, n + step) not in explored]
        rows += [(m, i, g) for m in wanted]
        explored.update((*basin, m) for m in wanted)
    return rows


def _into_slots(task: Task, pool: Pool, goals: list[Goal], rows: list[Row]) -> tuple[Pool, list[Row]]:
    """Where contacts hide better plans: each row on the best candidate of a line over x_final at its duration.

    A slot between two vehicles is thin across x_final: a line finds it where a cloud falls on either side.
    """
    tight = [hides_better(pool, goal) for goal in goals]
    moved = [row for row in rows if tight[row[2]]]
    if not moved:
        return pool, rows
    n, index, _ = (np.array(column) for column in zip(*moved, strict=True))
    centre, frame = _window(task, pool, n, index, free=True, window=1.0)
    bend = centre[:, :1] + frame[:, 0, :1] * np.linspace(-1.0, 1.0, LANES)
    change = np.repeat(centre[:, 1:], LANES, axis=1)
    lines = task.simulate(n, bend + change * task.seconds(n)[:, None] / 2.0, change)
    found = refine_edges(task, pool.joined(lines), goals)
    return found, [_on_its_line(found, goals, row, len(pool)) if tight[row[2]] else row for row in rows]


def _on_its_line(pool: Pool, goals: list[Goal], row: Row, first: int) -> Row:
    """The row from the best feasible candidate of its line, if there is one; lines begin at ``first``."""
    n, i, g = row
    line = first + np.flatnonzero((pool.n[first:] == n) & (pool.change[first:] == pool.change[i]))
    value = pool.objective(goals[g])[line]
    return (n, int(line[np.argmin(value)]), g) if np.isfinite(value).any() else row


def _finalists(pool: Pool, goals: list[Goal]) -> list[Head]:
    """Each goal's best candidates of its best durations, as long as the last digits may decide between them."""
    heads: list[Head] = []
    for g in distinct(pool, goals):
        value = pool.objective(goals[g])
        near = np.flatnonzero(value <= (1.0 + _UNDECIDED) * value.min(initial=np.inf))
        near = near[np.argsort(value[near], kind="stable")]
        _, first = np.unique(pool.n[near], return_index=True)
        heads += [(int(i), g) for i in near[np.sort(first)][:_FINALISTS] if np.isfinite(value[i])]
    return heads


def _stepped(pool: Pool, goals: list[Goal], rows: list[Row], found: IntArray) -> list[Head]:
    """Each head's candidate, or the best one that its rows have led to where that is better."""
    value = [pool.objective(goal) for goal in goals]
    reached: dict[Head, int] = {}
    for (_, head, g), i in zip(rows, found.tolist(), strict=True):
        last = reached.setdefault((head, g), head)
        if i >= 0 and value[g][i] < value[g][last]:
            reached[head, g] = i
    return [(i, g) for (_, g), i in reached.items()]
