"""How good a recording is: biases, contradictions between its columns, and what its metas say of it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from highd_lc.algorithms.track_index import TrackIndex

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

PROFILE_BIN_M = 10.0
# Positions are rounded to 0.01 m: differences over this time keep the rounding below 0.03 m/s.
_DIFFERENCE_S = 0.4


@dataclass(frozen=True)
class VehicleFacts:
    """What the tracks say of each vehicle, to be compared with the metas, each of shape (vehicles,).

    min_gap [m], min_time_gap [s]: smallest to the leader, NaN without one; travelled [m].
    """

    n_frames: IntArray
    lane_changes: IntArray
    min_gap: FloatArray
    min_time_gap: FloatArray
    travelled: FloatArray


def vehicle_facts(
    index: TrackIndex, *, x: FloatArray, vx: FloatArray, lane: IntArray, leader: IntArray, length: FloatArray
) -> VehicleFacts:
    """Facts of each vehicle. x [m], vx [m/s], lane, leader (vehicle index, -1 = none): of shape (rows,);
    length [m]: of shape (vehicles,).
    """
    starts, counts = index.starts[:-1], np.diff(index.starts)
    gap = _gaps(index, x, leader, length=length)
    slow = np.abs(vx) < 1e-3
    time_gap = gap / np.where(slow, np.nan, np.abs(vx))
    change = np.diff(lane, append=lane[-1]) != 0
    change[index.starts[1:] - 1] = False
    return VehicleFacts(
        n_frames=counts,
        lane_changes=np.add.reduceat(change, starts, dtype=np.int64),
        min_gap=np.fmin.reduceat(gap, starts),
        min_time_gap=np.fmin.reduceat(time_gap, starts),
        travelled=x[index.starts[1:] - 1] - x[starts],
    )


def _gaps(index: TrackIndex, x: FloatArray, leader: IntArray, *, length: FloatArray) -> FloatArray:
    """Bumper-to-bumper gap to the leader in each row [m], NaN without one."""
    gap = np.full(len(x), np.nan)
    behind = np.flatnonzero(leader >= 0)
    rows = index.rows(leader[behind], index.frame[behind])
    behind, rows = behind[rows >= 0], rows[rows >= 0]
    half = np.repeat(length / 2, np.diff(index.starts))
    gap[behind] = x[rows] - x[behind] - half[rows] - half[behind]
    return gap


def holes(index: TrackIndex) -> IntArray:
    """Places where a vehicle's track misses frames, shape (vehicles,)."""
    missing = np.diff(index.frame, append=index.frame[-1] + 1) != 1
    missing[index.starts[1:] - 1] = False
    return np.add.reduceat(missing, index.starts[:-1], dtype=np.int64)


def disagreement(index: TrackIndex, x: FloatArray, vx: FloatArray, *, rate: float) -> FloatArray:
    """Difference quotient of the position minus recorded speed [m/s], shape (rows,); NaN near holes and ends.

    rate: frames a second [Hz]. The quotient spans 0.4 s around the row.
    """
    half = max(1, round(_DIFFERENCE_S * rate / 2))
    result = np.full(len(x), np.nan)
    if len(x) <= 2 * half:
        return result
    early, late = slice(None, -2 * half), slice(2 * half, None)
    vehicle = np.repeat(np.arange(len(index.starts) - 1), np.diff(index.starts))
    sound = (vehicle[early] == vehicle[late]) & (index.frame[late] - index.frame[early] == 2 * half)
    quotient = (x[late] - x[early]) * (rate / (2 * half)) - vx[half:-half]
    result[half:-half][sound] = quotient[sound]
    return result


def profile(difference: FloatArray, x: FloatArray, *, entry: float, stop: float) -> FloatArray:
    """Mean disagreement in bins of 10 m from entry to stop [m/s]; NaN in an empty bin."""
    n_bins = max(1, int(np.ceil((stop - entry) / PROFILE_BIN_M)))
    known = np.isfinite(difference)
    place = np.clip(((x[known] - entry) / PROFILE_BIN_M).astype(np.int64), 0, n_bins - 1)
    total = np.bincount(place, weights=difference[known], minlength=n_bins)
    counts = np.bincount(place, minlength=n_bins)
    return np.divide(total, counts, out=np.full(n_bins, np.nan), where=counts > 0)


def mean_where(values: FloatArray, chosen: BoolArray) -> float:
    """Mean of the chosen values that are known, NaN if there is none."""
    known = chosen & np.isfinite(values)
    return float(values[known].mean()) if known.any() else float("nan")


def mean_speed_change(index: TrackIndex, vx: FloatArray, rate: float) -> FloatArray:
    """Change of forward speed from a track's first row to its last [m/s] and its time [s]: (2, vehicles)."""
    first, last = index.starts[:-1], index.starts[1:] - 1
    return np.stack([vx[last] - vx[first], (index.frame[last] - index.frame[first]) / rate])
