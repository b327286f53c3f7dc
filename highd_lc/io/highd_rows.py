"""The rows of a HighD tracks file as they stand in it, ordered by vehicle and frame, each named vehicle known."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from highd_lc.algorithms.track_index import TrackIndex, find_rows
from highd_lc.io.highd_csv import Field, fault, read_columns
from highd_lc.io.highd_metas import LARGEST_FRAME, LARGEST_ID, VehicleMetas
from highd_lc.io.plain_numbers import EVERY

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Columns = dict[str, NDArray[np.float64] | IntArray]

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
