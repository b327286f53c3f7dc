"""HighD recordings, in road coordinates. The only modules that know HighD's conventions are highd*.

Files of recording RR: RR_recordingMeta.csv, RR_tracksMeta.csv, RR_tracks.csv. In them (x, y) is the upper-left
corner of a box in the image, y grows down, "width" is the length; direction 1 (upper carriageway) drives to -x
with its left at larger y, direction 2 (lower) drives to +x with its left at smaller y; lane ids count the
intervals between all markings from the top; id 0 means none. Here: x forward from the entry end of the
section, y left from the carriageway's right edge, box centres, lane 1 = rightmost, 0 = none or outside.

One vehicle an unbroken track: ids that have holes or jumps are split, so that nothing is filled in across them.

A tracker that loses a vehicle, mixes up two, or gives an id again later leaves rows that belong to several
vehicles or to one that nobody saw in between. From each break on the rows are a vehicle of their own, with an id
above all ids of the recording; neighbour ids follow.

The tracks artefact as arrays: written and read without a data frame, for it is the one large table.

Values are not looked at again here: what is written comes from ``highd``, which has refused every value out of
range, and types and provenance are checked on reading. A value check of two million rows would cost as much as
reading them.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from highd_lc.extraction.track_index import TrackIndex, breaks
from highd_lc.io import artefacts
from highd_lc.io.highd_csv import fault
from highd_lc.io.highd_files import input_files
from highd_lc.io.highd_tables import (
    RecordingMeta,
    Road,
    Samples,
    Tracks,
    VehicleMetas,
    read_recording_meta,
    read_rows,
    read_vehicle_metas,
    to_road,
)
from highd_lc.vocab.errors import ArtefactError
from highd_lc.vocab.job import Provenance
from highd_lc.vocab.tables import TRACKS

IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Recording:
    """A recording in road coordinates. duplicates: identical rows of each vehicle that were dropped; samples: a
    few rows of columns that serve cross-checks alone; notes: what reading left out or changed, in words.
    """

    number: int
    meta: RecordingMeta
    vehicles: VehicleMetas
    road: Road
    duplicates: IntArray
    samples: Samples
    notes: tuple[str, ...] = ()


def read_recording(data: Path, recording: int) -> Recording:
    """Read a recording's three files. Raises InputError naming file, column and row of the first fault."""
    meta_path, vehicles_path, tracks_path = input_files(data, recording)
    meta = read_recording_meta(meta_path)
    vehicles = read_vehicle_metas(vehicles_path)
    _refuse_unmarked(vehicles_path, meta, vehicles)
    rows = read_rows(tracks_path, vehicles)
    return Recording(recording, meta, vehicles, to_road(rows, meta, vehicles), rows.duplicates, rows.samples)


def _refuse_unmarked(path: Path, meta: RecordingMeta, vehicles: VehicleMetas) -> None:
    """A carriageway without markings may not have vehicles: which lane they are in could not be told."""
    for direction, markings, column in ((1, meta.upper, "upper"), (2, meta.lower, "lower")):
        lost = vehicles.id[vehicles.direction == direction]
        if len(markings) == 0 and len(lost):
            text = f"vehicle {lost[0]} drives in direction {direction}, and {column}LaneMarkings has no markings"
            raise fault(path, text, column="drivingDirection")


_LISTED = 5


@dataclass(frozen=True)
class Break:
    """A place at which an id was split. frame: the first of the later part; missing: frames before it that are
    missing, 0 = it jumps; part_id: the later part's id.
    """

    vehicle_id: int
    direction: int
    frame: int
    missing: int
    part_id: int

    def in_words(self) -> str:
        """What happened to the vehicle, for a reader."""
        what = f"misses {self.missing} frame{'s' * (self.missing > 1)} before" if self.missing else "jumps at"
        return f"vehicle {self.vehicle_id} {what} frame {self.frame} (vehicle {self.part_id} from there on)"


@dataclass(frozen=True)
class Parts:
    """A recording of unbroken tracks. recorded_id: id in the file of each vehicle, shape (vehicles,)."""

    recording: Recording
    recorded_id: IntArray
    breaks: tuple[Break, ...]

    def jumps(self, direction: int) -> int:
        """How many of the breaks of a carriageway are jumps."""
        return sum(one.direction == direction and not one.missing for one in self.breaks)

    def in_words(self) -> str:
        """All breaks in a sentence, the first few one by one; empty without any."""
        if not self.breaks:
            return ""
        listed = "; ".join(one.in_words() for one in self.breaks[:_LISTED])
        more = f"; and {len(self.breaks) - _LISTED} more" if len(self.breaks) > _LISTED else ""
        why = "tracks are split where frames are missing or a position jumps"
        return f"recording {self.recording.number:02d}: {why}: {listed}{more}"


def split_tracks(recording: Recording) -> Parts:
    """Split the ids of a recording at every hole and jump; the same recording where there is none.

    What is known of a vehicle by its file alone (metas, dropped rows, rows in another lane) stays with the first
    of its parts.
    """
    tracks, metas = recording.road.tracks, recording.vehicles
    places = breaks(tracks.index, tracks.x, tracks.y, rate=recording.meta.frame_rate)
    if not len(places):
        return Parts(recording, metas.id, ())
    owner = np.searchsorted(tracks.index.starts, places, side="right") - 1
    new_ids = metas.id[-1] + 1 + np.arange(len(places))
    found = tuple(_break(recording, *place) for place in zip(places, owner, new_ids, strict=True))
    vehicles = _with_parts(metas, owner, new_ids)
    nothing = np.zeros(len(places), dtype=np.int64)
    road = replace(
        recording.road,
        tracks=_moved(tracks, metas, places, new_ids),
        lane_mismatches=np.concatenate([recording.road.lane_mismatches, nothing]),
    )
    duplicates = np.concatenate([recording.duplicates, nothing])
    whole = replace(recording, vehicles=vehicles, road=road, duplicates=duplicates)
    return Parts(whole, np.concatenate([metas.id, metas.id[owner]]), found)


def _break(recording: Recording, place: int, owner: int, new_id: int) -> Break:
    frame, metas = recording.road.tracks.index.frame, recording.vehicles
    missing = int(frame[place] - frame[place - 1] - 1)
    return Break(int(metas.id[owner]), int(metas.direction[owner]), int(frame[place]), missing, int(new_id))


def _with_parts(metas: VehicleMetas, owner: IntArray, new_ids: IntArray) -> VehicleMetas:
    """The metas with a line for every later part, that of its owner under the new id."""
    columns = {name: getattr(metas, name) for name in VehicleMetas.__dataclass_fields__}
    longer = {name: np.concatenate([values, values[owner]]) for name, values in columns.items()}
    return VehicleMetas(**{**longer, "id": np.concatenate([metas.id, new_ids])})


def _moved(tracks: Tracks, metas: VehicleMetas, places: IntArray, new_ids: IntArray) -> Tracks:
    """The tracks with the later parts after all others, in the order of their ids; neighbours with new ids."""
    index, rows = tracks.index, len(tracks.index.frame)
    part = np.searchsorted(places, np.arange(rows), side="right") - 1
    vehicle = np.repeat(np.arange(len(metas.id)), index.counts)
    is_later = (part >= 0) & (places[np.maximum(part, 0)] >= index.starts[vehicle])
    ids = np.where(is_later, new_ids[np.maximum(part, 0)], metas.id[vehicle])
    order = np.argsort(is_later, kind="stable")
    leader, follower = (
        _renamed(values, index, metas, places, new_ids) for values in (tracks.leader_id, tracks.follower_id)
    )
    columns = {name: getattr(tracks, name)[order] for name in ("x", "y", "vx", "vy", "ax", "ay", "lane")}
    return Tracks(
        TrackIndex.of(ids[order], index.frame[order]),
        **columns,
        leader_id=leader[order],
        follower_id=follower[order],
    )


def _renamed(
    neighbour: IntArray, index: TrackIndex, metas: VehicleMetas, places: IntArray, new_ids: IntArray
) -> IntArray:
    """Neighbour ids of each row, those of split vehicles as of the part that is there in the row's frame."""
    owner = np.searchsorted(index.starts, places, side="right") - 1
    renamed = neighbour.copy()
    for vehicle in np.unique(owner):
        rows = np.flatnonzero(neighbour == metas.id[vehicle])
        own = owner == vehicle
        names = np.concatenate([metas.id[vehicle : vehicle + 1], new_ids[own]])
        renamed[rows] = names[np.searchsorted(index.frame[places[own]], index.frame[rows], side="right")]
    return renamed


FloatArray = NDArray[np.float64]
SingleArray = NDArray[np.float32]
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
    return artefacts.partition(work, "tracks", recording)


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
        with artefacts.opened(path) as source:
            table = pq.read_table(source, columns=names, partitioning=None, use_threads=False)
    except FileNotFoundError as error:
        raise ArtefactError(f"{path}: not found; `highd-lc ingest` makes it") from error
    except (pa.ArrowInvalid, OSError) as error:
        raise ArtefactError(f"{path}: cannot be read: {error}") from error
    return TrackArrays(*(_to_numpy(table[name]) for name in names))


def _to_numpy(column: pa.ChunkedArray) -> NDArray[Any]:
    values = column.chunk(0) if column.num_chunks == 1 else column.combine_chunks()
    known: NDArray[Any] = (values.fill_null(0) if values.null_count else values).to_numpy(zero_copy_only=False)
    return known
