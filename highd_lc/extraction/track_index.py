"""Tracks of many vehicles as arrays, and finding their rows by vehicle and frame.

``breaks`` finds where an id is no longer one vehicle seen without interruption: frames are missing, or its
position jumps. Positions alone decide: a step that is far from the steps around it is a jump. Speeds may be noisy,
biased or in another unit, which a check of its own finds.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.kernels import kernel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

ABSENT = -1
# Positions are sums of numbers rounded to 0.01: a difference below this is rounding of the sum. Comparisons allow
# for it, so that a tie falls to the same side however the sum was formed, as in a mirrored recording.
TIE = 1e-6


@kernel()
def find_row(starts: IntArray, frames: IntArray, vehicle: int, frame: int) -> int:
    """Row of a vehicle in a frame, -1 if it is not in view.

    starts: first row of each vehicle and the number of rows, shape (vehicles + 1,); frames: of each row.
    """
    first, last = starts[vehicle], starts[vehicle + 1] - 1
    if frame < frames[first] or frame > frames[last]:
        return -1
    row = first + frame - frames[first]
    # Only a track with holes has its row elsewhere than the frame number says.
    if row > last or frames[row] != frame:
        row = first + np.searchsorted(frames[first : last + 1], frame)
    return row if frames[row] == frame else -1


@kernel()
def find_rows(starts: IntArray, frames: IntArray, vehicles: IntArray, wanted: IntArray) -> IntArray:
    """Rows of vehicles in a frame each, -1 where one is not in view; all of shape (n,)."""
    rows = np.empty(len(vehicles), dtype=np.int64)
    for k in range(len(vehicles)):
        rows[k] = find_row(starts, frames, vehicles[k], wanted[k])
    return rows


def unbroken(frame: IntArray, sample: int) -> tuple[int, int]:
    """First and last sample of the run of consecutive frames around a sample. frame: ascending, shape (n,)."""
    if frame[-1] - frame[0] == len(frame) - 1:
        return 0, len(frame) - 1
    holes = 1 + np.flatnonzero(frame[1:] != frame[:-1] + 1)
    place = int(np.searchsorted(holes, sample, side="right"))
    first = int(holes[place - 1]) if place else 0
    last = int(holes[place]) - 1 if place < len(holes) else len(frame) - 1
    return first, last


@dataclass(frozen=True)
class TrackIndex:
    """Rows ordered by vehicle and frame. frame: of each row, shape (rows,); starts: first row of each vehicle
    and the number of rows, shape (vehicles + 1,). Every vehicle has a row.
    """

    frame: IntArray
    starts: IntArray

    @classmethod
    def of(cls, vehicle: IntArray, frame: IntArray) -> "TrackIndex":
        """Index rows ordered by vehicle and frame; vehicle: any number that tells them apart, (rows,)."""
        changes = 1 + np.flatnonzero(vehicle[1:] != vehicle[:-1])
        return cls(frame, np.concatenate([[0], changes, [len(vehicle)]]))

    @property
    def counts(self) -> IntArray:
        """Rows of each vehicle, shape (vehicles,)."""
        return np.diff(self.starts)

    def span(self, vehicle: int) -> slice:
        """The rows of a vehicle."""
        return slice(int(self.starts[vehicle]), int(self.starts[vehicle + 1]))

    def run(self, vehicle: int, frame: int) -> slice:
        """The rows of a vehicle without a break around a frame; empty if it is not in view then."""
        row = self.row(vehicle, frame)
        if row == ABSENT:
            return slice(0, 0)
        span = self.span(vehicle)
        first, last = unbroken(self.frame[span], row - span.start)
        return slice(span.start + first, span.start + last + 1)

    def row(self, vehicle: int, frame: int) -> int:
        """The row of a vehicle in a frame, -1 if it is not in view."""
        return int(find_row(self.starts, self.frame, vehicle, frame))

    def rows(self, vehicles: IntArray, frame: int) -> IntArray:
        """Rows of vehicles in a frame, -1 where one is not in view; shape (n,)."""
        return find_rows(self.starts, self.frame, vehicles, np.full(len(vehicles), frame))

    def in_view(self, frame: int) -> tuple[IntArray, IntArray]:
        """Vehicles in view in a frame, and their rows."""
        first, last = self.frame[self.starts[:-1]], self.frame[self.starts[1:] - 1]
        candidates = np.flatnonzero((first <= frame) & (last >= frame))
        rows = self.rows(candidates, frame)
        return candidates[rows >= 0], rows[rows >= 0]


@dataclass(frozen=True)
class Traffic:
    """All vehicles of a recording in road coordinates.

    x, y: box centres [m]; vy: lateral speed [m/s]; lane: 0 = outside the markings; leader_id: recorded leader,
    0 = none; each of shape (rows,), in the rows of ``index``. ids, direction (1 or 2), length [m]: of shape
    (vehicles,). markings: y of the lane markings from the right edge on [m], of each direction; entry, stop: first
    and last x used for calibration [m], indexed by direction. rate: frames a second [Hz].
    """

    index: TrackIndex
    x: FloatArray
    y: FloatArray
    vy: NDArray[np.float32]
    lane: IntArray
    leader_id: IntArray
    ids: IntArray
    direction: IntArray
    length: FloatArray
    markings: dict[int, FloatArray]
    entry: FloatArray
    stop: FloatArray
    rate: float

    def id_of(self, vehicle: int) -> int:
        """The id of a vehicle index, 0 = nobody."""
        return 0 if vehicle == ABSENT else int(self.ids[vehicle])


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


@kernel()
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


@kernel()
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
