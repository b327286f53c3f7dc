"""Tracks of many vehicles as arrays, and finding their rows by vehicle and frame."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class TrackIndex:
    """Rows ordered by vehicle and frame. frame: of each row, shape (rows,); starts: first row of each vehicle
    and the number of rows, shape (vehicles + 1,). Every vehicle has a row.
    """

    frame: IntArray
    starts: IntArray

    @classmethod
    def of(cls, vehicle: IntArray, frame: IntArray) -> "TrackIndex":
        """Index rows ordered by vehicle (0, 1, ... without a gap) and frame, each of shape (rows,)."""
        starts = np.flatnonzero(np.diff(vehicle, prepend=-1, append=vehicle[-1] + 1))
        return cls(frame, starts)

    def span(self, vehicle: int) -> slice:
        """The rows of a vehicle."""
        return slice(int(self.starts[vehicle]), int(self.starts[vehicle + 1]))

    def row(self, vehicle: int, frame: int) -> int:
        """The row of a vehicle in a frame, -1 if it is not in view."""
        return int(self.rows(np.array([vehicle]), frame)[0])

    def rows(self, vehicles: IntArray, frame: int | IntArray) -> IntArray:
        """Rows of vehicles in a frame (or a frame each), -1 where a vehicle is not in view; shape as given."""
        first, last = self.starts[vehicles], self.starts[vehicles + 1] - 1
        guess = first + (frame - self.frame[first])
        inside = (guess >= first) & (frame <= self.frame[last])
        rows = np.where(inside, np.minimum(guess, last), -1)
        # Only a track with holes has its row elsewhere than the frame number says.
        astray = np.flatnonzero(inside & (self.frame[rows] != frame))
        frames = np.broadcast_to(frame, rows.shape)
        for place in astray:
            rows[place] = self._search(int(vehicles[place]), int(frames[place]))
        return rows

    def _search(self, vehicle: int, frame: int) -> int:
        span = self.span(vehicle)
        row = span.start + int(np.searchsorted(self.frame[span], frame))
        return row if row < span.stop and self.frame[row] == frame else -1

    def in_view(self, frame: int) -> tuple[IntArray, IntArray]:
        """Vehicles in view in a frame, and their rows."""
        candidates = np.flatnonzero(
            (self.frame[self.starts[:-1]] <= frame) & (self.frame[self.starts[1:] - 1] >= frame)
        )
        rows = self.rows(candidates, frame)
        return candidates[rows >= 0], rows[rows >= 0]


@dataclass(frozen=True)
class Traffic:
    """All vehicles of a recording in road coordinates.

    x, y: box centres [m]; lane: 0 = outside the markings; leader: vehicle index of the recorded leader, -1 =
    none; each of shape (rows,), in the rows of ``index``. direction: 1 or 2; length [m]: of shape (vehicles,).
    entry, stop: first and last x used for calibration, indexed by direction [m]. rate: frames a second [Hz].
    """

    index: TrackIndex
    x: FloatArray
    y: FloatArray
    lane: IntArray
    leader: IntArray
    direction: IntArray
    length: FloatArray
    entry: FloatArray
    stop: FloatArray
    rate: float
