"""From HighD's image coordinates to road coordinates: direction, sign, box corner to centre, lane ids.

Road coordinates of a carriageway: x forward from the entry end of the section, y left from the right edge, box
centres, lane 1 = rightmost. With s = -1 in direction 1 and +1 in direction 2 every conversion is
``offset of the vehicle + s * value`` (x, vx, ax) or ``offset - s * value`` (y, vy, ay, lane id).

The two meta files of a HighD recording: the recording's line and one line a vehicle.

The rows of a HighD tracks file as they stand in it, ordered by vehicle and frame, each named vehicle known.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.kernels import kernel
from highd_lc.extraction.track_index import TrackIndex, find_rows
from highd_lc.io.highd_csv import Field, fault, read_columns
from highd_lc.io.plain_numbers import EVERY
from highd_lc.vocab import names

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

LARGEST_ID = 10_000_000
LARGEST_FRAME = 10_000_000
LOWEST_FRAME_RATE = 5
"""Below it [Hz] the narrowest window over which a lateral speed is taken, 0.4 s, does not hold three frames."""

_MARKINGS = ("upperLaneMarkings", "lowerLaneMarkings")
_RECORDING_FIELDS = (
    Field("frameRate", float, LOWEST_FRAME_RATE, 1000, why="lateral speeds take 3 frames or more in 0.4 s"),
    Field("locationId", int, -1, 1e6),
    *(Field(name, str, may_be_empty=True) for name in _MARKINGS),
)
_VEHICLE_FIELDS = (
    Field("id", int, 1, LARGEST_ID),
    Field("width", float, 0.1, 100),
    Field("height", float, 0.1, 20),
    Field("initialFrame", int, 1, LARGEST_FRAME),
    Field("finalFrame", int, 1, LARGEST_FRAME),
    Field("numFrames", int, 0, LARGEST_FRAME),
    Field("class", str),
    Field("drivingDirection", int, 1, 2),
    Field("traveledDistance", float, -1e6, 1e6, optional=True),
    Field("minDHW", float, optional=True),
    Field("minTHW", float, optional=True),
    Field("numLaneChanges", int, 0, LARGEST_FRAME),
)


@dataclass(frozen=True)
class RecordingMeta:
    """A recording's line. upper, lower: y of the markings in the image [m], ascending, shape (n,);
    empty = a carriageway that was not recorded.
    """

    frame_rate: float
    location: int
    upper: FloatArray
    lower: FloatArray


@dataclass(frozen=True)
class VehicleMetas:
    """A line a vehicle, ascending by id, each of shape (vehicles,).

    length, width [m] (HighD calls them width and height); vehicle_class: Car or Truck; travelled [m];
    min_gap [m], min_time_gap [s]: smallest of the track, -1 = never behind a leader. The last three serve
    cross-checks alone: NaN where the file has no such column.
    """

    id: IntArray
    length: FloatArray
    width: FloatArray
    first_frame: IntArray
    last_frame: IntArray
    n_frames: IntArray
    vehicle_class: NDArray[np.str_]
    direction: IntArray
    travelled: FloatArray
    min_gap: FloatArray
    min_time_gap: FloatArray
    n_lane_changes: IntArray


def read_recording_meta(path: Path) -> RecordingMeta:
    """Read ``RR_recordingMeta.csv``. Raises InputError if it is not one row of sound values."""
    columns = read_columns(path, _RECORDING_FIELDS)
    if len(columns["frameRate"]) != 1:
        raise fault(path, f"{len(columns['frameRate'])} rows, expected 1")
    upper, lower = (_markings(path, name, str(columns[name][0])) for name in _MARKINGS)
    if len(upper) == len(lower) == 0:
        raise fault(path, "no markings, and none of the lower carriageway", column=_MARKINGS[0], row=2)
    if len(upper) and len(lower) and upper[-1] > lower[0]:
        raise fault(path, "begins above the end of the upper carriageway", column=_MARKINGS[1], row=2)
    return RecordingMeta(
        frame_rate=float(columns["frameRate"][0]),
        location=int(columns["locationId"][0]),
        upper=upper,
        lower=lower,
    )


def _markings(path: Path, column: str, text: str) -> FloatArray:
    if text.strip(" ;").lower() in ("", "nan"):
        return np.empty(0)
    try:
        values = np.array([float(cell) for cell in text.strip().removesuffix(";").split(";")])
    except ValueError:
        raise fault(path, f"{text[:60]!r} is no list of numbers separated by ';'", column=column, row=2) from None
    if len(values) < 2 or not np.all(np.isfinite(values)) or not np.all(np.diff(values) > 0):
        raise fault(path, f"{text[:60]!r} is not two or more ascending numbers", column=column, row=2)
    return values


def read_vehicle_metas(path: Path) -> VehicleMetas:
    """Read ``RR_tracksMeta.csv``. Raises InputError if it names no vehicle, one twice, or a strange class."""
    columns = read_columns(path, _VEHICLE_FIELDS)
    if len(columns["id"]) == 0:
        raise fault(path, "no vehicles")
    order = np.argsort(columns["id"], kind="stable")
    doubled = np.flatnonzero(np.diff(columns["id"][order]) == 0)
    if len(doubled):
        row = int(order[doubled[0] + 1])
        raise fault(path, f"{columns['id'][row]} is there twice", column="id", row=row + 2)
    strange = np.flatnonzero(~np.isin(columns["class"], names.CLASSES))
    if len(strange):
        found, allowed = str(columns["class"][strange[0]])[:40], " or ".join(names.CLASSES)
        raise fault(path, f"{found!r} is not {allowed}", column="class", row=int(strange[0]) + 2)
    return VehicleMetas(*(columns[field.name][order] for field in _VEHICLE_FIELDS))


Columns = dict[str, NDArray[Any]]
"""Columns by HighD's names, float64 or int64 as their fields say."""

# Far beyond anything on a road, so that a slipped decimal point or a torn number is not taken for motion.
_FARTHEST, _FASTEST, _STRONGEST = 1e5, 200.0, 500.0
FIELDS = (
    Field("frame", int, 1, LARGEST_FRAME),
    Field("id", int, 1, LARGEST_ID),
    Field("x", float, -_FARTHEST, _FARTHEST),
    Field("y", float, -_FARTHEST, _FARTHEST),
    Field("xVelocity", float, -_FASTEST, _FASTEST),
    Field("yVelocity", float, -_FASTEST, _FASTEST),
    Field("xAcceleration", float, -_STRONGEST, _STRONGEST),
    Field("yAcceleration", float, -_STRONGEST, _STRONGEST),
    Field("precedingId", int, 0, LARGEST_ID),
    Field("followingId", int, 0, LARGEST_ID),
    Field("laneId", int, -1, 1000),
    *(Field(name, float, optional=True, sampled=True) for name in ("width", "height", "dhw")),
)


@dataclass(frozen=True)
class Samples:
    """What a few rows say of columns that serve cross-checks alone, each of shape (n,); NaN = not there.

    vehicle: index; row: place in the ordered rows; length, width [m] (HighD calls them width and height); gap [m]:
    to the leader, 0 = none.
    """

    vehicle: IntArray
    row: IntArray
    length: FloatArray
    width: FloatArray
    gap: FloatArray


@dataclass(frozen=True)
class Rows:
    """Rows in HighD's own conventions, ordered by vehicle and frame. columns: by HighD's names, (rows,) each;
    duplicates: identical rows of each vehicle that were dropped, shape (vehicles,).
    """

    columns: Columns
    index: TrackIndex
    duplicates: IntArray
    samples: Samples


def read_rows(path: Path, vehicles: VehicleMetas) -> Rows:
    """Read ``RR_tracks.csv``: rows in any order, identical duplicates dropped and counted.

    Raises InputError if a cell is not what it should be, a vehicle has no line in the metas or no row here, or
    two rows contradict each other.
    """
    columns = read_columns(path, FIELDS)
    if len(columns["id"]) == 0:
        raise fault(path, "no rows")
    sampled = [columns.pop(field.name) for field in FIELDS if field.sampled]
    sampled_id, sampled_frame = columns["id"][::EVERY], columns["frame"][::EVERY]
    dropped = np.zeros(len(vehicles.id), dtype=np.int64)
    index = TrackIndex.of(columns["id"], columns["frame"])
    _refuse_strangers(path, columns["id"], index.starts[:-1], vehicles=vehicles)
    if not _is_ordered(columns["id"], index):
        columns, place = _ordered(columns)
        doubled = _doubled(path, columns, place)
        np.add.at(dropped, np.searchsorted(vehicles.id, columns["id"][doubled]), 1)
        columns = {name: np.delete(values, doubled) for name, values in columns.items()}
        index = TrackIndex.of(columns["id"], columns["frame"])
    _refuse_absent(path, columns["id"][index.starts[:-1]], vehicles)
    vehicle = np.searchsorted(vehicles.id, sampled_id)
    places = find_rows(index.starts, index.frame, vehicle, sampled_frame)
    return Rows(columns, index, dropped, Samples(vehicle, places, *sampled))


def _refuse_strangers(path: Path, ids: IntArray, runs: IntArray, *, vehicles: VehicleMetas) -> None:
    unknown = runs[~np.isin(ids[runs], vehicles.id)]
    if len(unknown):
        row = int(unknown[0])
        raise fault(path, f"vehicle {ids[row]} has no row in the tracksMeta file", column="id", row=row + 2)


def _refuse_absent(path: Path, ids: IntArray, vehicles: VehicleMetas) -> None:
    absent = np.setdiff1d(vehicles.id, ids)
    if len(absent):
        text = f"no row of vehicle {absent[0]}, one of {len(absent)} that the tracksMeta file lists"
        raise fault(path, text, column="id")


def _is_ordered(ids: IntArray, index: TrackIndex) -> bool:
    """Whether ids ascend from run to run and frames within each run, none twice."""
    rising = index.frame[1:] > index.frame[:-1]
    rising[index.starts[1:-1] - 1] = True
    return bool(rising.all() and np.all(np.diff(ids[index.starts[:-1]]) > 0))


def _ordered(columns: Columns) -> tuple[Columns, IntArray]:
    """Rows by vehicle and frame, and their places in the file."""
    place = np.lexsort((columns["frame"], columns["id"]))
    return {name: values[place] for name, values in columns.items()}, place


def _doubled(path: Path, columns: Columns, place: IntArray) -> IntArray:
    """Rows that repeat the row before them. Raises InputError if they differ in any column."""
    ids, frames = columns["id"], columns["frame"]
    again = 1 + np.flatnonzero((frames[1:] == frames[:-1]) & (ids[1:] == ids[:-1]))
    for name, values in columns.items():
        different = again[values[again] != values[again - 1]]
        if len(different):
            vehicle, moment = ids[different[0]], frames[different[0]]
            text = f"contradicts another row of vehicle {vehicle} in frame {moment}"
            raise fault(path, text, column=name, row=int(place[different[0]]) + 2)
    return again


UPPER, LOWER = 1, 2


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
        *(columns[name] for name in (*names, "precedingId", "followingId")),
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


@kernel()
def _convert(
    starts: IntArray,
    signs: FloatArray,
    offsets: FloatArray,
    markings: FloatArray,
    widths: FloatArray,
    x: FloatArray,
    y: FloatArray,
    vx: FloatArray,
    vy: FloatArray,
    ax: FloatArray,
    ay: FloatArray,
    lane: IntArray,
) -> IntArray:
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
