"""From HighD's image coordinates to road coordinates: direction, sign, box corner to centre, lane ids.

Road coordinates of a carriageway: x forward from the entry end of the section, y left from the right edge, box
centres, lane 1 = rightmost. With s = -1 in direction 1 and +1 in direction 2 every conversion is
``offset of the vehicle + s * value`` (x, vx, ax, -laneId) or ``offset - s * value`` (y, vy, ay).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from highd_lc.io.highd_metas import RecordingMeta, VehicleMetas
from highd_lc.io.highd_rows import Rows

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Tracks:
    """Rows of all vehicles in road coordinates, ordered by vehicle and frame, each of shape (rows,).

    vehicle: index into the vehicles; x, y [m], vx, vy [m/s], ax, ay [m/s^2]; lane, leader_id, follower_id:
    0 = outside the markings or none.
    """

    vehicle: IntArray
    frame: IntArray
    x: FloatArray
    y: FloatArray
    vx: FloatArray
    vy: FloatArray
    ax: FloatArray
    ay: FloatArray
    lane: IntArray
    leader_id: IntArray
    follower_id: IntArray


def to_road(rows: Rows, meta: RecordingMeta, vehicles: VehicleMetas) -> Tracks:
    """Rows of a recording in road coordinates."""
    columns, spread = rows.columns, _spreader(rows)
    upper = vehicles.direction == 1
    sign = spread(np.where(upper, -1.0, 1.0))
    end = section_end(rows, vehicles)
    x_offset = np.where(upper, end - vehicles.length / 2, vehicles.length / 2)
    y_offset = np.where(upper, vehicles.width / 2 - meta.upper[0], meta.lower[-1] - vehicles.width / 2)
    return Tracks(
        vehicle=spread(np.arange(len(vehicles.id))),
        frame=columns["frame"],
        x=spread(x_offset) + sign * columns["x"],
        y=spread(y_offset) - sign * columns["y"],
        vx=sign * columns["xVelocity"],
        vy=-sign * columns["yVelocity"],
        ax=sign * columns["xAcceleration"],
        ay=-sign * columns["yAcceleration"],
        lane=_lane(columns["laneId"], spread(upper), meta),
        leader_id=columns["precedingId"],
        follower_id=columns["followingId"],
    )


def _spreader(rows: Rows):
    return lambda values: np.repeat(values, rows.counts)


def _lane(lane_id: IntArray, upper: NDArray[np.bool_], meta: RecordingMeta) -> IntArray:
    """Lane from the right, 0 outside the carriageway: lane ids of the upper one start at 2, on its right."""
    n_upper, n_lower = len(meta.upper), len(meta.lower)
    lane = np.where(upper, lane_id - 1, n_upper + n_lower + 1 - lane_id)
    lanes = np.where(upper, n_upper, n_lower) - 1
    return np.where((lane >= 1) & (lane <= lanes), lane, 0)


def section_end(rows: Rows, vehicles: VehicleMetas) -> float:
    """Largest x of the image that a box reaches [m]: the entry end of direction 1."""
    return float(np.max(rows.columns["x"] + np.repeat(vehicles.length, rows.counts)))


def extent(rows: Rows, vehicles: VehicleMetas) -> FloatArray:
    """First and last x in road coordinates that a box of the recording reaches, a row a direction [m]."""
    end, begin = section_end(rows, vehicles), float(np.min(rows.columns["x"]))
    return np.array([[0.0, end - begin], [begin, end]])


def lane_mismatches(rows: Rows, meta: RecordingMeta, vehicles: VehicleMetas) -> IntArray:
    """Rows of each vehicle whose lane id is not that of their box centre, shape (vehicles,)."""
    markings = np.concatenate([meta.upper, meta.lower])
    centre = rows.columns["y"] + np.repeat(vehicles.width / 2, rows.counts)
    wrong = np.searchsorted(markings, centre) + 1 != rows.columns["laneId"]
    return np.bincount(np.repeat(np.arange(len(vehicles.id)), rows.counts)[wrong], minlength=len(vehicles.id))
