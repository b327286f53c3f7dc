"""Artefacts: parquet tables with a checked schema and their provenance, written atomically.

Layout below the work folder: ``<table>.parquet`` for finished artefacts, ``<table>/recording=NN/`` for the two
that are too large to combine (tracks, trajectories), and ``parts/<stage>/<NN>/<table>.parquet`` for what a stage
made of one recording. A finished artefact holds one row group a recording, so that a recording is read alone.

Values are checked against the columns of ``vocab.tables`` by arrow, which takes microseconds a column.
"""

import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from highd_lc.io import atomic
from highd_lc.vocab.errors import ArtefactError
from highd_lc.vocab.job import Job, Provenance
from highd_lc.vocab.tables import SCHEMA_VERSION, TABLES
from highd_lc.vocab.tables.columns import Column, Table


def check_values(table: Table, data: pa.Table) -> None:
    """Check ranges and allowed words of the columns present.

    Raises ArtefactError naming table, column and the first value that is not allowed.
    """
    for column in limited(table):
        if data.num_rows and column.name in data.column_names and not _is_within(column, data[column.name]):
            value = next((v for v in data[column.name].to_pylist() if not _is_allowed(column, v)), None)
            if value is not None or not column.nullable:
                raise ArtefactError(f"{table.name}: {column.name} = {value!r}: {_limits_of(column)}")


def _is_allowed(column: Column, value: Any) -> bool:
    if value is None or value != value:
        return column.nullable
    if column.allowed:
        return value in column.allowed
    low, high = column.minimum, column.maximum
    return (low is None or value >= low) and (high is None or value <= high)


def _limits_of(column: Column) -> str:
    """What a column may hold, in words."""
    if column.allowed:
        return f"one of {', '.join(map(repr, column.allowed))} is needed"
    ends = ((column.minimum, "at least"), (column.maximum, "at most"))
    needed = " and ".join(f"{word} {end:g}" for end, word in ends if end is not None)
    return f"{needed} is needed"


def limited(table: Table) -> list[Column]:
    """The columns of a table that may not hold every value of their type."""
    return [c for c in table.columns if c.allowed or c.minimum is not None or c.maximum is not None]


def _is_within(column: Column, values: pa.ChunkedArray) -> bool:
    """Whether all values are certainly allowed; nulls are checked elsewhere, NaN may stand where a null may."""
    if values.null_count == len(values):
        return column.nullable
    if column.nullable:
        values = values.drop_null()
    if column.allowed and not pc.all(pc.is_in(values, value_set=pa.array(column.allowed))).as_py():
        return False
    if column.minimum is None and column.maximum is None:
        return True
    if pa.types.is_floating(values.type) and pc.any(pc.is_nan(values)).as_py():
        if not column.nullable:
            return False
        values = values.filter(pc.invert(pc.is_nan(values)))
    ends = pc.min_max(values)
    low = column.minimum is None or ends["min"].as_py() is None or ends["min"].as_py() >= column.minimum
    high = column.maximum is None or ends["max"].as_py() is None or ends["max"].as_py() <= column.maximum
    return bool(low and high)


_COLUMN = "recording_id"


def opened(path: Path) -> pa.NativeFile:
    """A file to be read by arrow, which takes a path only if its name is UTF-8. Raises OSError."""
    return pa.OSFile(os.fsencode(path))


def of_recording(path: Path, recording: int, columns: list[str] | None) -> pa.Table | None:
    """A recording's rows; None if it shares a row group, or the file does not tell.

    Half the time of looking through the file for rows that meet a condition.
    """
    with opened(path) as source, pq.ParquetFile(source) as file:
        chosen = _chosen(file.metadata, recording) if _COLUMN in file.schema_arrow.names else None
        return None if chosen is None else file.read_row_groups(chosen, columns=columns)


def _chosen(about: pq.FileMetaData, recording: int) -> list[int] | None:
    place = about.schema.names.index(_COLUMN)
    chosen = []
    for k in range(about.num_row_groups):
        held = about.row_group(k).column(place).statistics
        if held is None or not held.has_min_max:
            return None
        if held.min <= recording <= held.max:
            if held.min < held.max:
                return None
            chosen.append(k)
    return chosen


Condition = tuple[str, str, Any]
"""Column, comparison (as in ``pyarrow.parquet.read_table``) and value that rows must have to be read."""

_METADATA = b"highd_lc"
_ARROW = {
    "int64": pa.int64(),
    "int32": pa.int32(),
    "float64": pa.float64(),
    "float32": pa.float32(),
    "string": pa.string(),
    "bool": pa.bool_(),
    "list<int64>": pa.list_(pa.int64()),
    "list<string>": pa.list_(pa.string()),
    "list<float64>": pa.list_(pa.float64()),
    "map<string,float64>": pa.map_(pa.string(), pa.float64()),
    "map<string,int64>": pa.map_(pa.string(), pa.int64()),
}


# Small tables are packed tightly. The two large ones are written three times as fast without dictionaries and
# statistics, which their columns of measured values gain little from; recording_id keeps its statistics, by
# which a recording's row group is found.
_SMALL = {"compression": "zstd", "compression_level": 1}
_LARGE_TABLES = ("tracks", "event_tracks", "trajectories")


def _parquet_options(name: str) -> dict[str, Any]:
    if name not in _LARGE_TABLES:
        return _SMALL
    words = [column.name for column in TABLES[name].columns if column.kind == "string"]
    return {
        "compression": "lz4",
        "use_dictionary": words or False,
        "write_statistics": [c for c in ("recording_id", "event_id") if c == TABLES[name].order[0]],
        "write_batch_size": 1 << 17,
    }


_NULLABLE = {pa.int64(): pd.Int64Dtype(), pa.int32(): pd.Int32Dtype()}


@cache
def arrow_schema(name: str) -> pa.Schema:
    """The arrow schema of a table, column meanings and units as field metadata."""
    return pa.schema([_field(column) for column in TABLES[name].columns])


def _field(column: Column) -> pa.Field:
    about = {"meaning": column.meaning, "unit": column.unit}
    return pa.field(column.name, _ARROW[column.kind], nullable=column.nullable, metadata=about)


def path_of(work: Path, name: str) -> Path:
    """Where a finished artefact lies."""
    return work / f"{name}.parquet"


def part_folder(work: Path, stage: str, recording: int) -> Path:
    """Folder of what a stage made of one recording."""
    return work / "parts" / stage / f"{recording:02d}"


def partition(work: Path, name: str, recording: int) -> Path:
    """A recording's file of an artefact that stays divided (see ``vocab.tables.PARTITIONED``)."""
    return work / name / f"recording={recording:02d}" / "part-0.parquet"


def to_arrow(name: str, frame: pd.DataFrame, provenance: Provenance) -> pa.Table:
    """A frame as the arrow table of an artefact: ordered, typed, checked, with its provenance.

    Raises ArtefactError naming table and column if a column is missing or holds what it may not.
    """
    table = TABLES[name]
    missing = [column for column in table.column_names if column not in frame.columns]
    if missing:
        raise ArtefactError(f"{name}: column {missing[0]!r} is missing")
    arrays = [_to_array(name, column, frame[column.name]) for column in table.columns]
    result = pa.Table.from_arrays(arrays, schema=arrow_schema(name))
    check(table, result)
    return result.replace_schema_metadata(_about(provenance))


def _to_array(name: str, column: Column, values: pd.Series) -> pa.Array:
    kind = _ARROW[column.kind]
    try:
        if column.kind.startswith("map"):
            return pa.array([None if v is None else list(dict(v).items()) for v in values], type=kind)
        array = pa.array(values, type=kind, from_pandas=True)
    except (pa.ArrowInvalid, pa.ArrowTypeError) as error:
        raise ArtefactError(f"{name}: column {column.name!r}: {error}") from error
    return array.combine_chunks() if isinstance(array, pa.ChunkedArray) else array


def write(path: Path, table: pa.Table, *, options: Mapping[str, Any] = _SMALL) -> None:
    """Write a table: whole or not at all. Raises StorageError if it cannot be written."""
    with atomic.replacing(path) as sink:
        pq.write_table(table, sink, **options)


def write_part(job: Job, stage: str, name: str, frame: pd.DataFrame) -> int:
    """Write what a stage made of a recording; rows are put in the table's order. Returns their number."""
    ordered = frame.sort_values(list(TABLES[name].order), kind="stable")
    path = part_folder(job.work, stage, job.recording) / f"{name}.parquet"
    write(path, to_arrow(name, ordered, job.provenance), options=_parquet_options(name))
    return len(ordered)


def write_columns(path: Path, name: str, columns: Mapping[str, pa.Array], provenance: Provenance) -> int:
    """Write a large artefact from arrow arrays in the table's order, without a data frame.

    Types and nulls are checked, values are not: the caller guarantees them. Returns the number of rows.
    """
    table = pa.Table.from_arrays([columns[c] for c in TABLES[name].column_names], schema=arrow_schema(name))
    for problem in _type_problems(TABLES[name], table):
        raise ArtefactError(f"{name}: {problem}")
    write(path, table.replace_schema_metadata(_about(provenance)), options=_parquet_options(name))
    return len(table)


def _about(provenance: Provenance) -> dict[bytes, bytes]:
    about = {"schema_version": SCHEMA_VERSION, **asdict(provenance)}
    return {_METADATA: json.dumps(about, sort_keys=True).encode()}


def concatenate(work: Path, stage: str, name: str, recordings: Iterable[int], provenance: Provenance) -> int:
    """Join a stage's parts into the finished artefact, one row group a recording. Returns its rows."""
    paths = [part_folder(work, stage, recording) / f"{name}.parquet" for recording in sorted(recordings)]
    return write_groups(work, name, (pq.read_table(opened(path)) for path in paths), provenance)


def write_groups(work: Path, name: str, groups: Iterable[pa.Table], provenance: Provenance) -> int:
    """Write a finished artefact from its row groups, one at a time. Returns the number of rows."""
    return write_file(path_of(work, name), name, groups, provenance)


def write_frame(work: Path, name: str, frame: pd.DataFrame, provenance: Provenance) -> None:
    """Write a finished artefact from a frame in the table's order.

    One row group a recording where the order begins with it. Raises ArtefactError as ``to_arrow`` does.
    """
    divided = len(frame) and TABLES[name].order[0] == _COLUMN
    parts = (part for _, part in frame.groupby(_COLUMN)) if divided else [frame]
    write_groups(work, name, (to_arrow(name, part, provenance) for part in parts), provenance)


def write_file(path: Path, name: str, groups: Iterable[pa.Table], provenance: Provenance) -> int:
    """Write an artefact's file from its row groups, one at a time. Returns the number of rows."""
    schema = arrow_schema(name).with_metadata(_about(provenance))
    rows = 0
    with (
        atomic.replacing(path) as sink,
        pq.ParquetWriter(sink, schema, **_parquet_options(name)) as writer,
    ):
        for group in groups:
            rows += group.num_rows
            writer.write_table(group.cast(schema), row_group_size=max(group.num_rows, 1))
    return rows


def read(
    work: Path,
    name: str,
    *,
    recording: int | None = None,
    columns: list[str] | None = None,
    where: Sequence[Condition] = (),
) -> pd.DataFrame:
    """Read a finished artefact, all of it, one recording's rows, or those that meet all conditions.

    Nullable integers come as Int64, maps as dicts. Raises ArtefactError if it is missing, of another schema
    version, or damaged.
    """
    return read_file(path_of(work, name), name, recording=recording, columns=columns, where=where)


def read_tracks(work: Path, recording: int, *, columns: list[str] | None = None) -> pd.DataFrame:
    """Read the tracks of one recording."""
    return read_partition(work, "tracks", recording, columns=columns)


def read_partition(
    work: Path,
    name: str,
    recording: int,
    *,
    columns: list[str] | None = None,
    where: Sequence[Condition] = (),
) -> pd.DataFrame:
    """Read one recording of an artefact that stays divided (see ``vocab.tables.PARTITIONED``, ``read``)."""
    return read_file(partition(work, name, recording), name, columns=columns, where=where)


def read_part(
    work: Path, stage: str, name: str, recording: int, *, columns: list[str] | None = None
) -> pd.DataFrame:
    """Read what a stage made of one recording."""
    return read_file(part_folder(work, stage, recording) / f"{name}.parquet", name, columns=columns)


def read_file(
    path: Path,
    name: str,
    *,
    recording: int | None = None,
    columns: list[str] | None = None,
    where: Sequence[Condition] = (),
) -> pd.DataFrame:
    """Read an artefact's file and check it against its schema (see ``read``)."""
    filters = [*where] if recording is None else [("recording_id", "==", recording), *where]
    try:
        provenance_of(path)
        table = of_recording(path, recording, columns) if recording is not None and not where else None
        if table is None:
            with opened(path) as source:
                table = pq.read_table(source, columns=columns, filters=filters or None, partitioning=None)
    except FileNotFoundError as error:
        raise ArtefactError(f"{path}: not found; `highd-lc run` makes it") from error
    except (pa.ArrowInvalid, OSError) as error:
        raise ArtefactError(f"{path}: cannot be read: {error}") from error
    check(TABLES[name], table)
    return _to_frame(TABLES[name], table)


def _to_frame(table: Table, data: pa.Table) -> pd.DataFrame:
    frame: pd.DataFrame = data.to_pandas(maps_as_pydicts="strict")
    for column in table.columns:
        if column.nullable and column.kind in ("int64", "int32") and column.name in frame:
            frame[column.name] = data[column.name].to_pandas(types_mapper=_NULLABLE.get)
    return frame


def provenance_of(path: Path) -> dict[str, Any]:
    """The provenance that an artefact carries. Raises ArtefactError if its schema version is another."""
    with opened(path) as source:
        about: dict[str, Any] = json.loads((pq.read_schema(source).metadata or {}).get(_METADATA, b"{}"))
    version = about.get("schema_version")
    if version != SCHEMA_VERSION:
        raise ArtefactError(f"{path}: schema version {version}, this code reads {SCHEMA_VERSION}")
    return about


def check(table: Table, data: pa.Table) -> None:
    """Check types, nulls and value ranges of the columns present. Raises ArtefactError at the first fault."""
    for problem in _type_problems(table, data):
        raise ArtefactError(f"{table.name}: {problem}")
    check_values(table, data)


def _type_problems(table: Table, data: pa.Table) -> Iterator[str]:
    for column in table.columns:
        if column.name not in data.column_names:
            continue
        found = data.schema.field(column.name).type
        if found != _ARROW[column.kind]:
            yield f"column {column.name!r} is {found}, expected {_ARROW[column.kind]}"
        if not column.nullable and data[column.name].null_count:
            yield f"column {column.name!r} holds {data[column.name].null_count} nulls"
