"""Quality of a recording: biases, contradictions between its columns, and facts to compare with its metas.

Motion is compared over a second, not from frame to frame. White noise of 0.05 m in positions at 25 Hz makes
differences of neighbouring positions disagree with the speeds by 1.2 m/s, but the way of a second by 0.07 m.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.kernels import kernel
from highd_lc.extraction.track_index import TrackIndex, find_row, find_rows

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

PROFILE_BIN_M = 10.0
# Positions are rounded to 0.01 m: a difference over this time keeps the rounding below 0.03 m/s.
_DIFFERENCE_S = 0.4
_STANDING_MPS = 1e-3
ENTRY, INNER, EXIT = 0, 1, 2


@dataclass(frozen=True)
class VehicleFacts:
    """What the tracks say of each vehicle, each of shape (vehicles,).

    holes: places where frames are missing; outside: rows outside the markings; min_gap [m], min_time_gap [s]:
    smallest to the leader, NaN without one; travelled: from the first to the last row [m].
    """

    holes: IntArray
    lane_changes: IntArray
    outside: IntArray
    min_gap: FloatArray
    min_time_gap: FloatArray
    travelled: FloatArray


def vehicle_facts(
    index: TrackIndex,
    x: FloatArray,
    *,
    vx: FloatArray,
    lane: IntArray,
    leader_id: IntArray,
    ids: IntArray,
    length: FloatArray,
) -> VehicleFacts:
    """Facts of each vehicle. x [m], vx [m/s], lane, leader_id (0 = none): of shape (rows,); ids (ascending) and
    length [m]: of shape (vehicles,).
    """
    found = _facts(index.starts, index.frame, x, vx, lane, leader_id, ids, length)
    return VehicleFacts(*found, travelled=x[index.starts[1:] - 1] - x[index.starts[:-1]])


@kernel()
def _facts(
    starts: IntArray,
    frame: IntArray,
    x: FloatArray,
    vx: FloatArray,
    lane: IntArray,
    leader_id: IntArray,
    ids: IntArray,
    length: FloatArray,
) -> tuple[IntArray, IntArray, IntArray, FloatArray, FloatArray]:
    """The columns of ``VehicleFacts`` but the last."""
    n = len(ids)
    holes, changes, outside = np.zeros(n, np.int64), np.zeros(n, np.int64), np.zeros(n, np.int64)
    least_gap, least_time_gap = np.full(n, np.nan), np.full(n, np.nan)
    for vehicle in range(n):
        known, leader = 0, -1
        for row in range(starts[vehicle], starts[vehicle + 1]):
            if row > starts[vehicle]:
                holes[vehicle] += frame[row] != frame[row - 1] + 1
                changes[vehicle] += lane[row] != lane[row - 1]
            outside[vehicle] += lane[row] == 0
            if leader_id[row] == 0:
                continue
            if leader_id[row] != known:
                known = leader_id[row]
                place = np.searchsorted(ids, known)
                leader = place if place < len(ids) and ids[place] == known else -1
            ahead = find_row(starts, frame, leader, frame[row]) if leader >= 0 else -1
            if ahead >= 0:
                gap = x[ahead] - x[row] - (length[leader] + length[vehicle]) / 2
                if not least_gap[vehicle] <= gap:
                    least_gap[vehicle] = gap
                if vx[row] > _STANDING_MPS and not least_time_gap[vehicle] <= gap / vx[row]:
                    least_time_gap[vehicle] = gap / vx[row]
    return holes, changes, outside, least_gap, least_time_gap


@dataclass(frozen=True)
class Disagreement:
    """Difference quotient of position minus recorded speed along the section [m/s].

    size: mean absolute value in the first ``trim`` metres, between them, and in the last; profile: mean value in
    bins of 10 m from the entry; NaN where nothing was measured.
    """

    size: FloatArray
    profile: FloatArray


def disagreement(
    index: TrackIndex,
    x: FloatArray,
    vx: FloatArray,
    *,
    vehicles: IntArray,
    rate: float,
    extent: tuple[float, float],
    trim: float,
) -> Disagreement:
    """Position against speed of some vehicles, over 0.4 s around each row that has both ends in view.

    x [m], vx [m/s]: of shape (rows,); rate [Hz]; extent: first and last x of the section [m]; trim [m].
    """
    half = max(1, round(_DIFFERENCE_S * rate / 2))
    n_bins = max(1, int(np.ceil((extent[1] - extent[0]) / PROFILE_BIN_M)))
    zones, bins = np.zeros((2, 3)), np.zeros((2, n_bins))
    places = extent[0], extent[0] + trim, extent[1] - trim
    _disagree(index.starts, index.frame, x, vx, vehicles, half, rate, places, zones, bins)
    return Disagreement(_mean(zones), _mean(bins))


_SUM, _COUNT = range(2)


@kernel()
def _disagree(
    starts: IntArray,
    frame: IntArray,
    x: FloatArray,
    vx: FloatArray,
    vehicles: IntArray,
    half: int,
    rate: float,
    places: tuple[float, float, float],
    zones: FloatArray,
    bins: FloatArray,
) -> None:
    """Add up into zones and bins, rows ``_SUM`` and ``_COUNT``. places: of the entry, where the ends begin [m]."""
    entry, inner, exit_from = places
    for vehicle in vehicles:
        for row in range(starts[vehicle] + half, starts[vehicle + 1] - half):
            if frame[row + half] - frame[row - half] != 2 * half:
                continue
            difference = (x[row + half] - x[row - half]) * rate / (2 * half) - vx[row]
            zone = ENTRY if x[row] < inner else (EXIT if x[row] > exit_from else INNER)
            zones[_SUM, zone] += abs(difference)
            zones[_COUNT, zone] += 1
            place = min(max(int((x[row] - entry) / PROFILE_BIN_M), 0), bins.shape[1] - 1)
            bins[_SUM, place] += difference
            bins[_COUNT, place] += 1


def _mean(sums_and_counts: FloatArray) -> FloatArray:
    sums, counts = sums_and_counts
    means: FloatArray = np.full(len(sums), np.nan)
    np.divide(sums, counts, out=means, where=counts > 0)
    return means


def mean_speed_change(index: TrackIndex, vx: FloatArray, *, vehicles: IntArray, rate: float) -> float:
    """Forward acceleration of some vehicles from their speeds: change of speed from the first row to the last,
    summed, over the summed time in view [m/s^2]; NaN if none was in view for longer than one frame.
    """
    first, last = index.starts[vehicles], index.starts[vehicles + 1] - 1
    seconds = float((index.frame[last] - index.frame[first]).sum()) / rate
    return float((vx[last] - vx[first]).sum()) / seconds if seconds > 0 else float("nan")


BoolArray = NDArray[np.bool_]

# What holds for nearly all vehicles shows in every other second too: the checks may cost a few percent of ingest.
_WINDOW_S = 1.0
# The trapezoidal rule misses what happens between samples that are a second apart.
_FEWEST_FRAMES = 3


@dataclass(frozen=True)
class Seconds:
    """Windows of a second or, at low frame rates, of three frames, in every other one, none across a hole.

    vehicle: index; first, last: rows at the ends; each of shape (windows,). frames: of a window.
    """

    vehicle: IntArray
    first: IntArray
    last: IntArray
    frames: int

    def chosen(self, which: BoolArray) -> "Seconds":
        """Some of the windows; which: of shape (windows,)."""
        return Seconds(self.vehicle[which], self.first[which], self.last[which], self.frames)


def seconds_of(index: TrackIndex, *, frame_rate: float) -> Seconds:
    """Every other second of every track. frame_rate [Hz]."""
    frames = max(_FEWEST_FRAMES, int(np.ceil(_WINDOW_S * frame_rate - 1e-9)))
    most = int(np.sum(np.maximum(index.counts - 1, 0) // frames))
    vehicle, first = np.empty(most, dtype=np.int64), np.empty(most, dtype=np.int64)
    n = _seconds(index.starts, index.frame, frames, vehicle, first)
    return Seconds(vehicle[:n], first[:n], first[:n] + frames, frames)


@kernel()
def _seconds(starts: IntArray, frame: IntArray, frames: int, vehicles: IntArray, windows: IntArray) -> int:
    """Fill in the windows. Returns how many."""
    n = 0
    for vehicle in range(len(starts) - 1):
        first = starts[vehicle]
        while first + frames < starts[vehicle + 1]:
            if frame[first + frames] - frame[first] == frames:
                vehicles[n], windows[n] = vehicle, first
                n += 1
                first += 2 * frames
            else:
                first += 1
    return n


@kernel()
def means(column: FloatArray, first: IntArray, frames: int) -> FloatArray:
    """Mean of a column over windows by the trapezoidal rule. column: of shape (rows,); first: first row of each
    window, shape (windows,); frames: of a window. Returns shape (windows,).
    """
    found = np.empty(len(first))
    for k in range(len(first)):
        total = (column[first[k]] + column[first[k] + frames]) / 2
        for row in range(first[k] + 1, first[k] + frames):
            total += column[row]
        found[k] = total / frames
    return found


@dataclass(frozen=True)
class Neighbours:
    """Who is next on the lane by the positions, in one frame of two seconds; ids, 0 = nobody.

    vehicle: index; row; leader, follower: each of shape (n,).
    """

    vehicle: IntArray
    row: IntArray
    leader: IntArray
    follower: IntArray


def neighbours(
    index: TrackIndex, x: FloatArray, lane: IntArray, *, ids: IntArray, direction: IntArray, frame_rate: float
) -> Neighbours:
    """Neighbours of every vehicle on a lane. x [m], lane: of shape (rows,); ids, direction (1 or 2): of shape
    (vehicles,).
    """
    every = max(1, round(2 * _WINDOW_S * frame_rate))
    most = int(np.sum(index.counts // every + 1))
    vehicle, row = np.empty(most, dtype=np.int64), np.empty(most, dtype=np.int64)
    n = _rows_of_frames(index.starts, index.frame, lane, every, vehicle, row)
    vehicle, row = vehicle[:n], row[:n]
    place = (index.frame[row] // every * 3 + direction[vehicle]) * (int(lane[row].max(initial=0)) + 1) + lane[row]
    # One number for place and x is sorted twice as fast as two.
    order = np.argsort(place * (2 * np.abs(x[row]).max(initial=0.0) + 1.0) + x[row], kind="stable")
    vehicle, row, place = vehicle[order], row[order], place[order]
    together = place[1:] == place[:-1]
    leader, follower = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64)
    leader[:-1][together] = ids[vehicle[1:]][together]
    follower[1:][together] = ids[vehicle[:-1]][together]
    return Neighbours(vehicle, row, leader, follower)


@kernel()
def _rows_of_frames(
    starts: IntArray, frame: IntArray, lane: IntArray, every: int, vehicles: IntArray, rows: IntArray
) -> int:
    """Fill in rows on a lane whose frame is a multiple of ``every``; some behind holes are passed by. Returns how
    many.
    """
    n = 0
    for vehicle in range(len(starts) - 1):
        row = starts[vehicle]
        while row < starts[vehicle + 1]:
            if frame[row] % every:
                row += 1
                continue
            if lane[row] > 0:
                vehicles[n], rows[n] = vehicle, row
                n += 1
            row += every
    return n


def gaps_to(
    index: TrackIndex,
    x: FloatArray,
    *,
    vehicle: IntArray,
    row: IntArray,
    leader_id: IntArray,
    ids: IntArray,
    length: FloatArray,
) -> FloatArray:
    """Gap of some rows to the leader that they name [m], NaN where it is nobody or not in view. x [m]: of shape
    (rows,); vehicle, row, leader_id: of shape (n,); ids, length [m]: of shape (vehicles,).
    """
    leader = np.minimum(np.searchsorted(ids, leader_id), len(ids) - 1)
    ahead = find_rows(index.starts, index.frame, leader, index.frame[row])
    gap = x[ahead] - x[row] - (length[leader] + length[vehicle]) / 2
    return np.where((ids[leader] == leader_id) & (ahead >= 0), gap, np.nan)


def crossing_offsets(
    index: TrackIndex, y: FloatArray, lane: IntArray, *, markings: dict[int, FloatArray], direction: IntArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Where box centres are as lane ids change by one, left of the marking [m], beside half the way of that frame.

    y [m], lane: of shape (rows,); markings: of each direction, from the right; direction: of shape (vehicles,).
    Returns vehicle index, offset, and half way, each of shape (changes,).
    """
    rows = 1 + np.flatnonzero(lane[1:] != lane[:-1])
    right, left = np.minimum(lane[rows], lane[rows - 1]), np.maximum(lane[rows], lane[rows - 1])
    vehicle = np.searchsorted(index.starts, rows, side="right") - 1
    inside = (rows > index.starts[vehicle]) & (index.frame[rows] - index.frame[rows - 1] == 1)
    chosen = inside & (right > 0) & (left - right == 1)
    rows, vehicle, right = rows[chosen], vehicle[chosen], right[chosen]
    marking = np.array([markings[d][m] for d, m in zip(direction[vehicle].tolist(), right.tolist(), strict=True)])
    return vehicle, (y[rows] + y[rows - 1]) / 2 - marking, np.abs(y[rows] - y[rows - 1]) / 2
