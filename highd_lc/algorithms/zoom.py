"""Zooming in: ever finer clouds of candidates about many starts at once, each in a frame that follows its valley.

The objective is a sum of absolute values: its minima lie at the bottom of narrow, slanted valleys, and a window
that shrinks alike in all directions gets stuck on their walls. So after every level a start's frame is set to the
spread of its best candidates, and narrows across the valley before it narrows along.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.algorithms.contacts import LANES
from highd_lc.algorithms.dynamics import forward_interval
from highd_lc.algorithms.pool import Goal, Pool, Task

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_ELITE: Final = 4
"""Candidates of a level whose spread sets the next frame."""
_SPREAD: Final = 1.8
"""Half-width of a frame over the root mean square of that spread; sqrt(3) would keep an even one as it is."""
_NARROWEST, _WIDEST = 0.3, 0.8
"""Bounds of a frame's next width over its width."""


@dataclass(frozen=True)
class Starts:
    """S starts. n: durations [samples]; goal: index of each one's goal, both of shape (S,).

    centre, shape (S, 2): bend [m] and change [m/s] (see ``basins``). frame, shape (S, 2, 2): columns = half-axes.
    """

    n: IntArray
    goal: IntArray
    centre: FloatArray
    frame: FloatArray


def zoom(
    task: Task, pool: Pool, goals: list[Goal], starts: Starts, *, levels: int, free: bool
) -> tuple[Pool, IntArray]:
    """The pool with ever finer candidates about the starts, and the index of the best one of each start.

    -1 where no candidate of a start was feasible.
    """
    cloud = _SUNFLOWER if free else _LINE
    every, half_T = np.arange(len(starts.n)), task.seconds(starts.n) / 2.0
    centre, frame = starts.centre, starts.frame
    value, best = np.full(len(every), np.inf), np.full(len(every), -1)
    found, size = [], len(pool)
    for _ in range(levels):
        delta, change = _possible(task, starts.n, centre[:, None, :] + cloud @ frame.swapaxes(1, 2))
        found.append(task.simulate(starts.n, delta, change))
        objective = _of_rows(found[-1], goals, starts.goal)
        lowest = np.argmin(objective, axis=1)
        better = objective[every, lowest] < value
        value = np.where(better, objective[every, lowest], value)
        best = np.where(better, size + every * LANES + lowest, best)
        speed = change[every, lowest]
        there = np.stack([delta[every, lowest] - speed * half_T, speed], axis=1)
        centre = np.where(better[:, None], there, centre)
        origin = np.where(better[:, None], cloud[lowest], 0.0)
        frame = frame @ _narrowed(objective, origin) if free else frame * _LINE_SHRINK
        size += delta.size
    return pool.joined(*found), best


def _sunflower() -> FloatArray:
    """Evenly spread points on a disc that covers the unit square but for its corners, shape (LANES, 2)."""
    i = np.arange(LANES) + 0.5
    radius, angle = 1.2 * np.sqrt(i / LANES), i * np.pi * (3.0 - np.sqrt(5.0))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


_SUNFLOWER: Final = _sunflower()
_LINE: Final = np.stack([np.linspace(-1.0, 1.0, LANES), np.zeros(LANES)], axis=1)
_LINE_SHRINK: Final = 1.3 * 2.0 / (LANES - 1)
"""The next line reaches a step and a third of this one to either side."""


def _possible(task: Task, n: IntArray, moved: FloatArray) -> tuple[FloatArray, FloatArray]:
    """delta and change of bends and changes (S, LANES, 2), moved into the interval of what is possible."""
    T = task.seconds(n)[:, None]
    change = np.clip(moved[:, :, 1], task.limit.v_min - task.scene.v0, task.limit.v_max - task.scene.v0)
    low, high = forward_interval(T, change, task.scene.v0, task.limit)
    return np.clip(moved[:, :, 0] + change * T / 2.0, low, np.maximum(high, low)), change


def _of_rows(pool: Pool, goals: list[Goal], goal_of: IntArray) -> FloatArray:
    """Each start's candidates in its own goal's objective, shape (S, LANES)."""
    every = np.stack([pool.objective(goal).reshape(-1, LANES) for goal in goals])
    return every[goal_of, np.arange(len(goal_of))]


def _narrowed(objective: FloatArray, origin: FloatArray) -> FloatArray:
    """Axes of the next frames in units of the present ones, shape (S, 2, 2): the spread of the best candidates.

    objective: (S, LANES); origin: the next centres in the present frames, (S, 2).
    """
    elite = np.argsort(objective, axis=1, kind="stable")[:, :_ELITE]
    finite = np.isfinite(np.take_along_axis(objective, elite, axis=1))
    away = (_SUNFLOWER[elite] - origin[:, None, :]) * finite[:, :, None]
    squares, axes = np.linalg.eigh(away.swapaxes(1, 2) @ away)
    mean = np.maximum(squares, 0.0) / np.maximum(finite.sum(axis=1), 1)[:, None]
    narrowed: FloatArray = axes * np.clip(_SPREAD * np.sqrt(mean), _NARROWEST, _WIDEST)[:, None, :]
    return narrowed
