"""The best plan of every goal on a very fine grid: what the search is measured against.

Nothing of the search's grids, intervals or refinement is used, only the candidates' simulation and the limits.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from highd_lc.planning.limits import violations
from highd_lc.planning.pool import Goal, Task

FloatArray = NDArray[np.float64]

_LOOKED_AT_AGAIN = 12


class Cell(NamedTuple):
    """A candidate and its distance to the next ones of its grid; the lowest objective comes first."""

    value: float
    n: int
    delta: float
    change: float
    delta_step: float
    change_step: float


def fine_grid(task: Task, goals: Sequence[Goal], *, nodes: int, changes: int = 1) -> list[float]:
    """The lowest objective of each goal over every T, ``nodes`` x_final and ``changes`` v_end; infinite if none.

    changes = 1: the fixed form, v_end = v0. The best cells are looked at once more, far finer, and the best once
    again.
    """
    cells: list[list[Cell]] = [[] for _ in goals]
    for n in task.durations.tolist():
        delta, change = _first_grid(task, n, nodes, changes)
        for found, value in zip(cells, objectives(task, goals, n, delta, change), strict=True):
            found += _minima(value, n, delta, change)
    return [_lowest(task, goal, found) for goal, found in zip(goals, cells, strict=True)]


def _lowest(task: Task, goal: Goal, cells: list[Cell]) -> float:
    closer = [_closer(task, goal, cell) for cell in sorted(cells)[:_LOOKED_AT_AGAIN]]
    return _closer(task, goal, min(closer)).value if closer else np.inf


def _first_grid(task: Task, n: int, nodes: int, changes: int) -> tuple[FloatArray, FloatArray]:
    """delta and change, shape (changes, nodes), over more than the limits of jerk and speed leave."""
    T, free = n * task.scene.dt, changes > 1
    widest = min(task.limit.jerk * T**2 / 6.0, task.limit.v_max) if free else 0.0
    change = np.linspace(-widest, widest, changes)[:, None] if free else np.zeros((1, 1))
    reach = np.minimum((task.limit.jerk * T**3 + 36.0 * abs(change) * T) / 60.0, task.limit.v_max * T)
    return reach * np.linspace(-1.0, 1.0, nodes), change + np.zeros(nodes)


def objectives(
    task: Task, goals: Sequence[Goal], n: int, delta: FloatArray, change: FloatArray
) -> list[FloatArray]:
    """Every goal's objective of candidates of one duration, infinite where not feasible; of delta's shape."""
    T, flat = n * task.scene.dt, (delta.reshape(1, -1), change.reshape(1, -1))
    keep = violations(np.array([T]), *flat, task.scene.v0, task.scene.D, task.limit)[0] == 0
    values = [np.full(delta.size, np.inf) for _ in goals]
    if keep.any():
        pool = task.simulate(np.array([n]), *(np.ascontiguousarray(column[:, keep]) for column in flat))
        for value, goal in zip(values, goals, strict=True):
            value[keep] = pool.objective(goal)
    return [value.reshape(delta.shape) for value in values]


def _minima(value: FloatArray, n: int, delta: FloatArray, change: FloatArray) -> Iterator[Cell]:
    """The finite minima along the last axis."""
    padded = np.pad(value, ((0, 0), (1, 1)), constant_values=np.inf)
    lowest = np.isfinite(value) & (value <= padded[:, :-2]) & (value <= padded[:, 2:])
    change_step = float(change[-1, 0] - change[0, 0]) / max(len(change) - 1, 1)
    for row, i in zip(*np.nonzero(lowest), strict=True):
        step = float(delta[row, 1] - delta[row, 0])
        yield Cell(float(value[row, i]), n, float(delta[row, i]), float(change[row, i]), step, change_step)


def _closer(task: Task, goal: Goal, cell: Cell) -> Cell:
    """The best of a fine grid about a cell, or the cell itself."""
    across = np.linspace(-1.0, 1.0, 61 if cell.change_step else 601)
    down = np.linspace(-1.0, 1.0, 61)[:, None] if cell.change_step else np.zeros((1, 1))
    delta = cell.delta + across * cell.delta_step + down * cell.change_step * cell.n * task.scene.dt / 2.0
    change = cell.change + down * cell.change_step + np.zeros(len(across))
    value = objectives(task, [goal], cell.n, delta, change)[0]
    row, i = np.unravel_index(np.argmin(value), value.shape)
    finer = 2.0 / (len(across) - 1)
    best = (float(value[row, i]), cell.n, float(delta[row, i]), float(change[row, i]))
    return min(Cell(*best, cell.delta_step * finer, cell.change_step * finer), cell)
