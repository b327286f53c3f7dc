"""The two meta files of a HighD recording: the recording's line and one line a vehicle."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from highd_lc.io.highd_csv import Field, fault, read_columns
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
