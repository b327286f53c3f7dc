"""The tracks artefact as arrays: written and read without a data frame, for it is the one large table.

Values are not looked at again here: what is written comes from ``highd``, which has refused every value out of
range, and types and provenance are checked on reading. A value check of two million rows would cost as much as
reading them.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from highd_lc.io import artefacts, row_groups
from highd_lc.io.highd import Recording
from highd_lc.vocab.errors import ArtefactError
from highd_lc.vocab.job import Provenance
from highd_lc.vocab.tables import TRACKS

FloatArray = NDArray[np.float64]
SingleArray = NDArray[np.float32]
IntArray = NDArray[np.int64]
_NULL_IF_ZERO = ("lane", "leader_id", "follower_id")


@dataclass(frozen=True)
class TrackArrays:
    """Rows of the tracks artefact that extraction needs, ordered by vehicle and frame, (rows,) each; 0 = null.

    x, y [m], vx, vy [m/s], ax, ay [m/s^2] in road coordinates (see ``vocab.tables.TRACKS``).
    """

    vehicle_id: IntArray
    frame: IntArray
    x: FloatArray
    y: FloatArray
    vx: SingleArray
    vy: SingleArray
    ax: SingleArray
    ay: SingleArray
    lane: IntArray
    leader_id: IntArray


def path_of(work: Path, recording: int) -> Path:
    """The file of a recording's tracks."""
    return artefacts.tracks_folder(work, recording) / "part-0.parquet"


def write(work: Path, recording: Recording, provenance: Provenance) -> int:
    """Write a recording's tracks. Returns the number of rows."""
    values = _columns(recording)
    columns = {field.name: _to_arrow(field, values[field.name]) for field in artefacts.arrow_schema("tracks")}
    return artefacts.write_columns(path_of(work, recording.number), "tracks", columns, provenance)


def _columns(recording: Recording) -> dict[str, FloatArray | IntArray]:
    tracks, vehicles = recording.road.tracks, recording.vehicles
    of_vehicle = {"vehicle_id": vehicles.id, "length": vehicles.length, "width": vehicles.width}
    frame = tracks.index.frame
    return {
        **{name: getattr(tracks, name) for name in TRACKS.column_names if hasattr(tracks, name)},
        **{name: np.repeat(values, tracks.index.counts) for name, values in of_vehicle.items()},
        "recording_id": np.full(len(frame), recording.number),
        "frame": frame,
        "t": (frame - 1) / recording.meta.frame_rate,
    }


def _to_arrow(field: pa.Field, values: FloatArray | IntArray) -> pa.Array:
    empty = values == 0 if field.name in _NULL_IF_ZERO else None
    return pa.array(values.astype(field.type.to_pandas_dtype(), copy=False), mask=empty)


def read(work: Path, recording: int) -> TrackArrays:
    """Read a recording's tracks. Raises ArtefactError if they are missing, damaged or of another schema."""
    path = path_of(work, recording)
    names = list(TrackArrays.__dataclass_fields__)
    try:
        artefacts.provenance_of(path)
        with row_groups.opened(path) as source:
            table = pq.read_table(source, columns=names, partitioning=None, use_threads=False)
    except FileNotFoundError as error:
        raise ArtefactError(f"{path}: not found; run the stage ingest") from error
    except (pa.ArrowInvalid, OSError) as error:
        raise ArtefactError(f"{path}: cannot be read: {error}") from error
    return TrackArrays(*(_to_numpy(table[name]) for name in names))


def _to_numpy(column: pa.ChunkedArray) -> NDArray[np.generic]:
    values = column.chunk(0) if column.num_chunks == 1 else column.combine_chunks()
    return (values.fill_null(0) if values.null_count else values).to_numpy(zero_copy_only=False)
