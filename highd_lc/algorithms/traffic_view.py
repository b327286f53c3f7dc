"""What a camera makes of the traffic in view: lane keeping and tracking errors added, neighbours found."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.algorithms.traffic_state import FloatArray, IntArray

LEADER, FOLLOWER = 0, 1
LEFT_LEADER, LEFT_ALONGSIDE, LEFT_FOLLOWER = 2, 3, 4
RIGHT_LEADER, RIGHT_ALONGSIDE, RIGHT_FOLLOWER = 5, 6, 7
NEIGHBOURS = 8
"""Columns of ``find_neighbours``."""


class Frames(NamedTuple):
    """Vehicles in view, frame by frame. first: first row of each frame, shape (frames + 1,); x: centre along
    travel [m]; length [m]; lane: increasing to the driver's left."""

    first: IntArray
    x: FloatArray
    length: FloatArray
    lane: IntArray


def add_sines(
    motion: FloatArray, time: FloatArray, *, driver: IntArray, sines: FloatArray, deviation: float
) -> None:
    """Add a sum of K equal sines of the given standard deviation [m] to position, speed and acceleration.

    motion: (n, 3), changed in place; time [s] and driver (index into sines): (n,); sines: (N, K, 2), angular
    frequency [rad/s] and phase [rad].
    """
    if deviation > 0:
        _add_sines(motion, time, driver, sines, deviation * np.sqrt(2 / sines.shape[1]))


@njit(cache=True, nogil=True)
def _add_sines(
    motion: FloatArray, time: FloatArray, driver: IntArray, sines: FloatArray, amplitude: float
) -> None:
    for row in range(len(time)):
        for k in range(sines.shape[1]):
            omega = sines[driver[row], k, 0]
            angle = omega * time[row] + sines[driver[row], k, 1]
            sine, cosine = amplitude * np.sin(angle), amplitude * np.cos(angle)
            motion[row, 0] += sine
            motion[row, 1] += omega * cosine
            motion[row, 2] -= omega * omega * sine


def find_neighbours(frames: Frames) -> NDArray[np.int64]:
    """Rows of the eight neighbours of every row, shape (n, 8), -1 where there is none.

    On the own lane the nearest centre ahead and behind; on the lanes beside, alongside is who overlaps
    lengthwise (the nearest centre), ahead and behind are the nearest of the others.
    """
    return _find_neighbours(frames.first, frames.x, frames.length, frames.lane)


@njit(cache=True, nogil=True)
def _find_neighbours(first: IntArray, x: FloatArray, length: FloatArray, lane: IntArray) -> NDArray[np.int64]:
    found = np.empty((len(x), 8), np.int64)
    nearest = np.empty(8)
    for frame in range(len(first) - 1):
        for i in range(first[frame], first[frame + 1]):
            for column in range(8):
                nearest[column] = np.inf
                found[i, column] = -1
            for j in range(first[frame], first[frame + 1]):
                side = lane[j] - lane[i]
                if j == i or abs(side) > 1:
                    continue
                distance = x[j] - x[i]
                column = _relation(side, distance, 0.5 * (length[i] + length[j]))
                if abs(distance) < nearest[column]:
                    nearest[column] = abs(distance)
                    found[i, column] = j
    return found


@njit(cache=True, nogil=True)
def _relation(side: int, distance: float, overlap: float) -> int:
    """Column of a neighbour at a distance ahead, on the own lane (0), to the left (1) or right (-1)."""
    if side == 0:
        return LEADER if distance > 0 else FOLLOWER
    column = LEFT_LEADER if side == 1 else RIGHT_LEADER
    if abs(distance) < overlap:
        return column + 1
    return column if distance > 0 else column + 2
