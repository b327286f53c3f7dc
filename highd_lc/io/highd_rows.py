"""The rows of a HighD tracks file as they stand in it, ordered by vehicle and frame, each named vehicle known."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from highd_lc.io.highd_csv import Field, read_columns
from highd_lc.io.highd_metas import LARGEST_FRAME, LARGEST_ID, VehicleMetas
from highd_lc.vocab.errors import InputError

IntArray = NDArray[np.int64]
Columns = dict[str, NDArray[np.float64] | IntArray]

# Far beyond anything on a road, so that a slipped decimal point or a torn number is not taken for motion.
_FARTHEST, _FASTEST, _STRONGEST = 1e5, 200.0, 500.0
_FIELDS = (
    Field("frame", int, 0, LARGEST_FRAME),
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
)


@dataclass(frozen=True)
class Rows:
    """Rows in HighD's own conventions. columns: by HighD's names, each of shape (rows,).

    counts: rows of each vehicle, shape (vehicles,); duplicates: identical rows that were dropped, for each
    vehicle.
    """

    columns: Columns
    counts: IntArray
    duplicates: IntArray


def read_rows(path: Path, vehicles: VehicleMetas) -> Rows:
    """Read ``RR_tracks.csv``: rows in any order, identical duplicates dropped and counted.

    Raises InputError if a cell is not what it should be, a vehicle has no line in the metas or no row here, or
    two rows contradict each other.
    """
    columns = read_columns(path, _FIELDS)
    vehicle = _vehicle_of_rows(path, columns["id"], vehicles)
    columns, vehicle, line = _ordered(columns, vehicle)
    doubled = _doubled(path, columns, vehicle, line)
    if doubled.any():
        columns = {name: values[~doubled] for name, values in columns.items()}
    counts = np.bincount(vehicle[~doubled], minlength=len(vehicles.id))
    _refuse_missing(path, counts, vehicles)
    return Rows(columns, counts, np.bincount(vehicle[doubled], minlength=len(vehicles.id)))


def _vehicle_of_rows(path: Path, ids: IntArray, vehicles: VehicleMetas) -> IntArray:
    """Index of each row's vehicle; looked up once for each run of equal ids."""
    if len(ids) == 0:
        raise InputError(f"{path}: no rows")
    starts = np.flatnonzero(np.diff(ids, prepend=-1))
    index = np.searchsorted(vehicles.id, ids[starts]).clip(max=len(vehicles.id) - 1)
    unknown = np.flatnonzero(vehicles.id[index] != ids[starts])
    if len(unknown):
        row = starts[unknown[0]]
        raise InputError(
            f"{path}: row {row + 2}, column 'id': vehicle {ids[row]} has no row in the tracksMeta file"
        )
    return np.repeat(index, np.diff(starts, append=len(ids)))


def _ordered(columns: Columns, vehicle: IntArray) -> tuple[Columns, IntArray, IntArray | None]:
    """Rows by vehicle and frame; their places in the file if they were in another order."""
    key = vehicle * np.int64(1 << 32) + columns["frame"]
    if np.all(key[1:] >= key[:-1]):
        return columns, vehicle, None
    order = np.argsort(key, kind="stable")
    return {name: values[order] for name, values in columns.items()}, vehicle[order], order


def _doubled(path: Path, columns: Columns, vehicle: IntArray, place: IntArray | None) -> NDArray[np.bool_]:
    """Rows that repeat the row before them. Raises InputError if they differ in any column."""
    frame = columns["frame"]
    doubled = np.zeros(len(frame), dtype=bool)
    again = 1 + np.flatnonzero((frame[1:] == frame[:-1]) & (vehicle[1:] == vehicle[:-1]))
    doubled[again] = True
    for name, values in columns.items():
        different = again[values[again] != values[again - 1]]
        if len(different):
            row = different[0] if place is None else place[different[0]]
            raise InputError(
                f"{path}: row {row + 2}, column {name!r}: contradicts another row of vehicle "
                f"{columns['id'][different[0]]} in frame {frame[different[0]]}"
            )
    return doubled


def _refuse_missing(path: Path, counts: IntArray, vehicles: VehicleMetas) -> None:
    absent = np.flatnonzero(counts == 0)
    if len(absent):
        raise InputError(
            f"{path}: column 'id': no row of vehicle {vehicles.id[absent[0]]}, one of {len(absent)} that the "
            "tracksMeta file lists"
        )
