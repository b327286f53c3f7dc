"""From the recorded rows of a follower and its leader to the track that a fit reads."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.car_following import FollowingTrack
from highd_lc.core.car_following_kernel import TIME_STEP
from highd_lc.core.resampling import resample

FloatArray = NDArray[np.float64]

# Positions are snapped to this before anything is computed from them [m]: a mirrored recording differs in the
# last bits of its positions, and a fit amplifies bits (SPEC section 9).
_SNAP = 1e-4
_SAME_TIME = 1e-6


@dataclass(frozen=True)
class RecordedMotion:
    """Recorded rows of a vehicle, ascending in time: t [s], box centre x along travel [m], v [m/s], a [m/s^2],
    each of shape (n,); length [m].
    """

    t: FloatArray
    x: FloatArray
    v: FloatArray
    a: FloatArray
    length: float


def following_track(follower: RecordedMotion, leader: RecordedMotion) -> FollowingTrack:
    """The common time of both on the 0.1 s grid that counts from t = 0, in front-bumper coordinates.

    Only instants recorded for both count; a track without any has length zero.
    """
    first, last = _common_span(follower.t, leader.t)
    grid = np.arange(np.ceil(first / TIME_STEP - _SAME_TIME), np.floor(last / TIME_STEP + _SAME_TIME) + 1.0)
    if last <= first:
        grid = grid[:0]
    grid = np.clip(grid * TIME_STEP, first, last)
    x, v, a = _resampled(follower, grid)
    leader_x, leader_v, _ = _resampled(leader, grid)
    return FollowingTrack(leader_x + 0.5 * leader.length, leader_v, x + 0.5 * follower.length, v, a)


def _common_span(a: FloatArray, b: FloatArray) -> tuple[float, float]:
    if len(a) == 0 or len(b) == 0:
        return 0.0, 0.0
    return max(float(a[0]), float(b[0])), min(float(a[-1]), float(b[-1]))


def _resampled(motion: RecordedMotion, grid: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    if len(grid) == 0:
        return grid, grid, grid
    snapped = np.round(motion.x / _SNAP) * _SNAP
    return resample(motion.t, snapped, motion.v, motion.a, grid)
