"""What columns of the tracks say of each other, vehicle by vehicle: the evidence of the cross-checks.

Motion is compared over a second, not from frame to frame: white noise of 0.05 m in positions at 25 Hz makes their
differences disagree with the speeds by 1.2 m/s, but the way of a second by 0.07 m.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.algorithms.track_index import TrackIndex, find_rows

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_WINDOW_S = 1.0
# The trapezoidal rule misses what happens between samples that are a second apart.
_FEWEST_FRAMES = 3


@dataclass(frozen=True)
class Seconds:
    """A quantity and its rate in windows of a second, none across a hole; each of shape (windows,).

    first, last: rows at its ends; measured: change of the quantity a second; recorded: mean of the column that
    holds its rate.
    """

    first: IntArray
    last: IntArray
    measured: FloatArray
    recorded: FloatArray


def over_seconds(
    index: TrackIndex, quantity: FloatArray, rate_column: FloatArray, *, frame_rate: float
) -> Seconds:
    """Change of a quantity beside the mean of its recorded rate; both of shape (rows,), frame_rate [Hz]."""
    step = max(_FEWEST_FRAMES, int(np.ceil(_WINDOW_S * frame_rate - 1e-9)))
    most = int(np.sum(np.maximum(index.counts - 1, 0) // step))
    first, means = np.empty(most, dtype=np.int64), np.empty(most)
    n = _over_seconds(index.starts, index.frame, rate_column, step, first, means)
    first, last = first[:n], first[:n] + step
    return Seconds(first, last, (quantity[last] - quantity[first]) * (frame_rate / step), means[:n])


@njit(cache=True, nogil=True)
def _over_seconds(
    starts: IntArray, frame: IntArray, rate_column: FloatArray, step: int, windows: IntArray, means: FloatArray
) -> int:
    """Fill in windows that follow one another; the mean is that of the trapezoidal rule. Returns how many."""
    n = 0
    for vehicle in range(len(starts) - 1):
        first = starts[vehicle]
        while first + step < starts[vehicle + 1]:
            last = first + step
            if frame[last] - frame[first] != step:
                first += 1
                continue
            total = (rate_column[first] + rate_column[last]) / 2
            for row in range(first + 1, last):
                total += rate_column[row]
            windows[n], means[n] = first, total / step
            n += 1
            first = last
    return n


@dataclass(frozen=True)
class Neighbours:
    """Who is next on the lane, by the file and by the positions, in one frame a second; ids, 0 = nobody.

    row, recorded_leader, recorded_follower, leader, follower: of shape (n,).
    """

    row: IntArray
    recorded_leader: IntArray
    recorded_follower: IntArray
    leader: IntArray
    follower: IntArray


def neighbours(
    index: TrackIndex, x: FloatArray, lane: IntArray, leader_id: IntArray, follower_id: IntArray,
    *, ids: IntArray, direction: IntArray, frame_rate: float,
) -> Neighbours:  # fmt: skip
    """Neighbours of every vehicle on a lane. x [m], lane, leader_id, follower_id: of shape (rows,); ids, direction
    (1 or 2): of shape (vehicles,).
    """
    every = max(1, round(_WINDOW_S * frame_rate))
    rows = np.flatnonzero(index.frame % every == 0)
    rows = rows[lane[rows] > 0]
    vehicle = np.searchsorted(index.starts, rows, side="right") - 1
    place = (index.frame[rows] * 3 + direction[vehicle]) * (int(lane.max(initial=0)) + 1) + lane[rows]
    order = np.lexsort((x[rows], place))
    rows, vehicle, place = rows[order], vehicle[order], place[order]
    together = place[1:] == place[:-1]
    leader, follower = np.zeros(len(rows), dtype=np.int64), np.zeros(len(rows), dtype=np.int64)
    leader[:-1][together] = ids[vehicle[1:]][together]
    follower[1:][together] = ids[vehicle[:-1]][together]
    return Neighbours(rows, leader_id[rows], follower_id[rows], leader, follower)


def gaps_to(
    index: TrackIndex, x: FloatArray, rows: IntArray, leader_id: IntArray, *, ids: IntArray, length: FloatArray
) -> FloatArray:
    """Gap of some rows to the leader that they name [m], NaN where it is nobody or not in view. x [m]: of shape
    (rows,); leader_id: of shape (n,); ids, length [m]: of shape (vehicles,).
    """
    vehicle = np.searchsorted(index.starts, rows, side="right") - 1
    leader = np.minimum(np.searchsorted(ids, leader_id), len(ids) - 1)
    ahead = find_rows(index.starts, index.frame, leader, index.frame[rows])
    gap = x[ahead] - x[rows] - (length[leader] + length[vehicle]) / 2
    return np.where((ids[leader] == leader_id) & (ahead >= 0), gap, np.nan)


def crossing_offsets(
    index: TrackIndex, y: FloatArray, lane: IntArray, *, markings: dict[int, FloatArray], direction: IntArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Where box centres are as lane ids change by one, left of the marking [m], beside half the way of that frame.

    y [m], lane: of shape (rows,); markings: of each direction, from the right; direction: of shape (vehicles,).
    Returns vehicle index, offset, and half way, each of shape (changes,).
    """
    rows = 1 + np.flatnonzero((np.abs(np.diff(lane)) == 1) & (np.minimum(lane[1:], lane[:-1]) > 0))
    vehicle = np.searchsorted(index.starts, rows, side="right") - 1
    inside = (rows > index.starts[vehicle]) & (index.frame[rows] - index.frame[rows - 1] == 1)
    rows, vehicle = rows[inside], vehicle[inside]
    right = np.minimum(lane[rows], lane[rows - 1])
    marking = np.array([markings[d][m] for d, m in zip(direction[vehicle].tolist(), right.tolist(), strict=True)])
    return vehicle, (y[rows] + y[rows - 1]) / 2 - marking, np.abs(y[rows] - y[rows - 1]) / 2
