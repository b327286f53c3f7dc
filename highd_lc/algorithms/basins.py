"""Basins: the candidates of a pool that are lower than all around them, in the coordinates of the search's grid.

A plan is described by its duration, by ``change`` = v_end - v0 and by its bend = delta - change T / 2: how far it
falls behind or gets ahead of the plan whose speed changes smoothly. Bend and change are nearly independent of each
other. The grid's nodes over each lie at widest s |s|, evenly spaced in s.
"""

from typing import Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.algorithms.pool import Goal, Pool, Task, distinct

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_LOOKED_AT: Final = 150
"""Lowest candidates, each the lowest of its line over x_final, among which basins are told apart."""
_DURATIONS: Final = 2
_NODES: Final = 1.6
"""How far around a basin's candidate is the lowest: in durations of the pool, in nodes of the grid."""

Head = tuple[int, int]
"""The best candidate of a basin and the goal whose basin it is."""


class Widest(NamedTuple):
    """Largest bend [m] and change [m/s] that the limits of jerk and speed leave, each of the durations' shape."""

    bend: FloatArray
    change: FloatArray


def widest(task: Task, T: FloatArray) -> Widest:
    """What the limits leave at durations T [s]: |bend| <= j T^3 / 60, |change| <= j T^2 / 6."""
    span = task.limit.v_max - task.limit.v_min
    return Widest(
        np.minimum(task.limit.jerk * T**3 / 60.0, span * T / 1.875),
        np.minimum(task.limit.jerk * T**2 / 6.0, span),
    )


def x_nodes(task: Task, free: bool) -> int:
    """Nodes over x_final: odd, so that the middle one is the smoothest motion."""
    return 2 * ((task.settings.x_nodes - 1) // (4 if free else 2)) + 1


def node_step(value: FloatArray, largest: FloatArray, nodes: int) -> FloatArray:
    """Distance from a value to the next node of a grid with that many nodes at largest s |s|, s in [-1, 1]."""
    step = 2.0 / (nodes - 1)
    return largest * step * (2.0 * np.sqrt(np.minimum(np.abs(value) / largest, 1.0)) + step)


def basins(task: Task, pool: Pool, goals: list[Goal], *, free: bool) -> list[Head]:
    """The best basins of each goal that is not like one before it, at most ``zoom_starts`` of them, best first."""
    order = np.lexsort((pool.delta, pool.change, pool.n))
    new_line = (np.diff(pool.n[order]) != 0) | (np.diff(pool.change[order]) != 0)
    place = _places(task, pool, free)
    heads: list[Head] = []
    for g in distinct(pool, goals):
        value = pool.objective(goals[g])
        lowest = order[_line_minima(value[order], new_line)]
        lowest = lowest[np.argsort(value[lowest], kind="stable")][:_LOOKED_AT]
        heads += [(int(i), g) for i in lowest[_alone(place[lowest])][: task.settings.zoom_starts]]
    return heads


def _places(task: Task, pool: Pool, free: bool) -> FloatArray:
    """Each candidate's place, shape (M, 3): neighbours are less than 1 apart in every coordinate."""
    T = task.seconds(pool.n)
    largest = widest(task, T)
    _, row = np.unique(pool.n, return_inverse=True)
    bend = _evenly(pool.delta - pool.change * T / 2.0, largest.bend, x_nodes(task, free))
    change = _evenly(pool.change, largest.change, task.settings.v_nodes)
    return np.stack([row / (_DURATIONS + 0.5), bend / _NODES, change / _NODES], axis=1)


def _evenly(value: FloatArray, largest: FloatArray, nodes: int) -> FloatArray:
    """A value counted in nodes of the grid from the middle one."""
    s: FloatArray = np.sign(value) * np.sqrt(np.abs(value) / largest) * (nodes - 1) / 2.0
    return s


def _line_minima(value: FloatArray, new_line: NDArray[np.bool_]) -> IntArray:
    """Indices of the finite values that are not above their neighbours on the same line."""
    if not len(value):
        return np.empty(0, np.int64)
    edge = np.where(new_line, np.inf, 0.0)
    before = np.concatenate([[np.inf], value[:-1] + edge])
    after = np.concatenate([value[1:] + edge, [np.inf]])
    return np.flatnonzero(np.isfinite(value) & (value <= before) & (value <= after))


@njit(cache=True, nogil=True)
def _alone(place: FloatArray) -> NDArray[np.bool_]:
    """Which places, best first, have no better neighbour."""
    alone = np.ones(len(place), np.bool_)
    for i in range(len(place)):
        for j in range(i):
            near = True
            for axis in range(place.shape[1]):
                near &= abs(place[i, axis] - place[j, axis]) < 1.0
            if near:
                alone[i] = False
                break
    return alone
