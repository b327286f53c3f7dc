"""How good a recording is: biases, contradictions between its columns, and facts to hold against its metas."""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.algorithms.track_index import TrackIndex, find_row

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
    counts, gaps = _facts(index.starts, index.frame, x, vx, lane, leader_id, ids, length)
    travelled = x[index.starts[1:] - 1] - x[index.starts[:-1]]
    return VehicleFacts(counts[0], counts[1], counts[2], gaps[0], gaps[1], travelled)


@njit(cache=True, nogil=True)
def _facts(
    starts: IntArray,
    frame: IntArray,
    x: FloatArray,
    vx: FloatArray,
    lane: IntArray,
    leader_id: IntArray,
    ids: IntArray,
    length: FloatArray,
) -> tuple[IntArray, FloatArray]:
    counts = np.zeros((3, len(ids)), dtype=np.int64)
    gaps = np.full((2, len(ids)), np.nan)
    for vehicle in range(len(ids)):
        known, leader = 0, -1
        for row in range(starts[vehicle], starts[vehicle + 1]):
            if row > starts[vehicle]:
                counts[0, vehicle] += frame[row] != frame[row - 1] + 1
                counts[1, vehicle] += lane[row] != lane[row - 1]
            counts[2, vehicle] += lane[row] == 0
            if leader_id[row] == 0:
                continue
            if leader_id[row] != known:
                known = leader_id[row]
                place = np.searchsorted(ids, known)
                leader = place if place < len(ids) and ids[place] == known else -1
            ahead = find_row(starts, frame, leader, frame[row]) if leader >= 0 else -1
            if ahead >= 0:
                gap = x[ahead] - x[row] - (length[leader] + length[vehicle]) / 2
                if not gaps[0, vehicle] <= gap:
                    gaps[0, vehicle] = gap
                if vx[row] > _STANDING_MPS and not gaps[1, vehicle] <= gap / vx[row]:
                    gaps[1, vehicle] = gap / vx[row]
    return counts, gaps


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
    places = np.array([extent[0], extent[0] + trim, extent[1] - trim])
    _disagree(index.starts, index.frame, x, vx, vehicles, half, rate, places, zones, bins)
    return Disagreement(_mean(zones), _mean(bins))


@njit(cache=True, nogil=True)
def _disagree(
    starts: IntArray,
    frame: IntArray,
    x: FloatArray,
    vx: FloatArray,
    vehicles: IntArray,
    half: int,
    rate: float,
    places: FloatArray,
    zones: FloatArray,
    bins: FloatArray,
) -> None:
    for vehicle in vehicles:
        for row in range(starts[vehicle] + half, starts[vehicle + 1] - half):
            if frame[row + half] - frame[row - half] != 2 * half:
                continue
            difference = (x[row + half] - x[row - half]) * rate / (2 * half) - vx[row]
            zone = ENTRY if x[row] < places[1] else (EXIT if x[row] > places[2] else INNER)
            zones[0, zone] += abs(difference)
            zones[1, zone] += 1
            place = min(max(int((x[row] - places[0]) / PROFILE_BIN_M), 0), bins.shape[1] - 1)
            bins[0, place] += difference
            bins[1, place] += 1


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
