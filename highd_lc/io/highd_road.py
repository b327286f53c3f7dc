"""From HighD's image coordinates to road coordinates: direction, sign, box corner to centre, lane ids.

Road coordinates of a carriageway: x forward from the entry end of the section, y left from the right edge, box
centres, lane 1 = rightmost. With s = -1 in direction 1 and +1 in direction 2 every conversion is
``offset of the vehicle + s * value`` (x, vx, ax) or ``offset - s * value`` (y, vy, ay, lane id).
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.algorithms.track_index import TrackIndex
from highd_lc.io.highd_metas import RecordingMeta, VehicleMetas
from highd_lc.io.highd_rows import Rows

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

UPPER = 1


@dataclass(frozen=True)
class Tracks:
    """Rows of all vehicles in road coordinates, ordered by vehicle and frame, in the rows of ``index``.

    x, y [m], vx, vy [m/s], ax, ay [m/s^2]; lane, leader_id, follower_id: 0 = outside the markings or none; each
    of shape (rows,).
    """

    index: TrackIndex
    x: FloatArray
    y: FloatArray
    vx: FloatArray
    vy: FloatArray
    ax: FloatArray
    ay: FloatArray
    lane: IntArray
    leader_id: IntArray
    follower_id: IntArray


@dataclass(frozen=True)
class Road:
    """A recording in road coordinates.

    extent: first and last x that a box reaches, a row a direction [m]; lane_mismatches: rows of each vehicle
    whose lane id is not that of their box centre, shape (vehicles,).
    """

    tracks: Tracks
    extent: FloatArray
    lane_mismatches: IntArray


def to_road(rows: Rows, meta: RecordingMeta, vehicles: VehicleMetas) -> Road:
    """Rows of a recording in road coordinates. The arrays of ``rows`` are converted in place and reused."""
    columns, index = rows.columns, rows.index
    begin = float(np.min(columns["x"]))
    end = float(np.max(np.maximum.reduceat(columns["x"], index.starts[:-1]) + vehicles.length))
    if not (len(meta.upper) and len(meta.lower)):
        _count_lanes_from_top(columns["laneId"], columns["y"] + np.repeat(vehicles.width, index.counts) / 2, meta)
    names = ("x", "y", "xVelocity", "yVelocity", "xAcceleration", "yAcceleration", "laneId")
    mismatches = _convert(
        index.starts,
        np.where(vehicles.direction == UPPER, -1.0, 1.0),
        _offsets(meta, vehicles, end),
        np.concatenate([meta.upper, meta.lower]),
        vehicles.width,
        *(columns[name] for name in names),
    )
    tracks = Tracks(
        index,
        *(columns[name] for name in names),
        leader_id=columns["precedingId"],
        follower_id=columns["followingId"],
    )
    return Road(tracks, np.array([[0.0, end - begin], [begin, end]]), mismatches)


def _count_lanes_from_top(lane: IntArray, centre: FloatArray, meta: RecordingMeta) -> None:
    """Shift lane ids in place so that 1 is above the first marking, as most of the rows say, shape (rows,) each.

    Where a carriageway is left out, its lanes may or may not be counted.
    """
    above = np.searchsorted(np.concatenate([meta.upper, meta.lower]), centre)
    shifts, counts = np.unique(lane - above - 1, return_counts=True)
    lane -= shifts[np.argmax(counts)]


def _offsets(meta: RecordingMeta, vehicles: VehicleMetas, end: float) -> FloatArray:
    """Offsets of x, y and lane, and the number of lanes, of each vehicle: shape (4, vehicles).

    Lane ids count from 1 above the first marking: those of the upper carriageway begin at 2, on its right; those
    of the lower one end at the number of all markings, on its right.
    """
    upper = vehicles.direction == UPPER
    n_upper, n_lower = len(meta.upper), len(meta.lower)
    # Nobody drives on a carriageway without markings.
    right_of_upper = meta.upper[0] if n_upper else np.nan
    right_of_lower = meta.lower[-1] if n_lower else np.nan
    return np.stack(
        [
            np.where(upper, end - vehicles.length / 2, vehicles.length / 2),
            np.where(upper, vehicles.width / 2 - right_of_upper, right_of_lower - vehicles.width / 2),
            np.where(upper, -1.0, n_upper + n_lower + 1.0),
            np.where(upper, n_upper, n_lower) - 1.0,
        ]
    )


@njit(cache=True, nogil=True)
def _convert(starts, signs, offsets, markings, widths, x, y, vx, vy, ax, ay, lane):
    """Convert every row in place; returns the rows of each vehicle whose lane id contradicts its y."""
    mismatches = np.zeros(len(signs), dtype=np.int64)
    for vehicle in range(len(signs)):
        sign = signs[vehicle]
        for row in range(starts[vehicle], starts[vehicle + 1]):
            centre, interval = y[row] + widths[vehicle] / 2, 1
            while interval <= len(markings) and markings[interval - 1] < centre:
                interval += 1
            mismatches[vehicle] += interval != lane[row]
            x[row] = offsets[0, vehicle] + sign * x[row]
            y[row] = offsets[1, vehicle] - sign * y[row]
            # Adding 0 turns -0 into 0, so that mirrored recordings give the same bytes.
            vx[row] = sign * vx[row] + 0.0
            vy[row] = -sign * vy[row] + 0.0
            ax[row] = sign * ax[row] + 0.0
            ay[row] = -sign * ay[row] + 0.0
            from_right = int(offsets[2, vehicle] - sign * lane[row])
            lane[row] = from_right if 1 <= from_right <= offsets[3, vehicle] else 0
    return mismatches
