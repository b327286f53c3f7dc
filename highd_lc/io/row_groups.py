"""A recording's rows of an artefact by the row groups that it has to itself."""

import os
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

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
