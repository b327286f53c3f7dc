"""Where an id stops being one vehicle seen without a break: frames are missing, or it is suddenly elsewhere.

Positions alone decide. Speeds may be noisy, biased or in another unit, and a check of its own holds them against
positions; a step that is far from the steps around it is a jump whatever they say.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.algorithms.track_index import TrackIndex

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# A step is held against the median of the steps around it, over this time to either side.
_AROUND_S = 0.5
# What a vehicle's own motion adds to the difference: forward at most 12 m/s^2 over that time, sideways a lateral
# speed of 2 m/s that sets in or ends at once.
_FORWARD_MPS2, _LATERAL_MPS = 12.0, 2.0
# What a tracker adds: noise of 0.05 m makes 0.07 m a step, us101's conversion reaches 0.92 m. A lane is 2.5 m wide
# and more, a vehicle longer than that.
_NOISE_M = 1.5


def breaks(index: TrackIndex, x: FloatArray, y: FloatArray, *, rate: float) -> IntArray:
    """Rows before which a track is broken, ascending: frames are missing there, or the position jumps.

    x, y: forward and lateral position [m], shape (rows,); rate: frames a second [Hz].
    """
    half = max(1, round(_AROUND_S * rate))
    forward = _NOISE_M + _FORWARD_MPS2 * half / rate**2
    lateral = _NOISE_M + _LATERAL_MPS / rate
    found = np.zeros(len(x), dtype=np.bool_)
    _mark(index.starts, index.frame, x, half, forward, found)
    _mark(index.starts, index.frame, y, half, lateral, found)
    return np.flatnonzero(found)


@njit(cache=True, nogil=True)
def _mark(
    starts: IntArray, frame: IntArray, x: FloatArray, half: int, limit: float, found: NDArray[np.bool_]
) -> None:
    """Mark the rows before which frames are missing or x jumps by more than the limit [m]."""
    for vehicle in range(len(starts) - 1):
        first = starts[vehicle]
        while first < starts[vehicle + 1]:
            stop = first + 1
            while stop < starts[vehicle + 1] and frame[stop] == frame[stop - 1] + 1:
                stop += 1
            if first > starts[vehicle]:
                found[first] = True
            _mark_jumps(x, first, stop, half, limit, found)
            first = stop


@njit(cache=True, nogil=True)
def _mark_jumps(x: FloatArray, first: int, stop: int, half: int, limit: float, found: NDArray[np.bool_]) -> None:
    """Mark the rows of an unbroken run before which x jumps."""
    for row in range(first + 1, stop):
        step = x[row] - x[row - 1]
        before = abs(step - (x[row - 1] - x[row - 2])) if row - 2 >= first else 0.0
        after = abs(step - (x[row + 1] - x[row])) if row + 1 < stop else 0.0
        # Few steps differ so from a neighbour: the median is worked out for these alone.
        if max(before, after) <= _NOISE_M:
            continue
        low, high = max(first + 1, row - half), min(stop, row + half + 1)
        if high - low > 2 and abs(step - np.median(x[low:high] - x[low - 1 : high - 1])) > limit:
            found[row] = True
