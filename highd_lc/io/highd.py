"""HighD recordings, in road coordinates. The only modules that know HighD's conventions are highd*.

Files of recording RR: RR_recordingMeta.csv, RR_tracksMeta.csv, RR_tracks.csv. In them (x, y) is the upper-left
corner of a box in the image, y grows down, "width" is the length; direction 1 (upper carriageway) drives to -x
with its left at larger y, direction 2 (lower) drives to +x with its left at smaller y; lane ids count the
intervals between all markings from the top; id 0 means none. Here: x forward from the entry end of the
section, y left from the carriageway's right edge, box centres, lane 1 = rightmost, 0 = none or outside.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from highd_lc.io.highd_csv import fault
from highd_lc.io.highd_metas import RecordingMeta, VehicleMetas, read_recording_meta, read_vehicle_metas
from highd_lc.io.highd_road import Road, to_road
from highd_lc.io.highd_rows import Samples, read_rows

IntArray = NDArray[np.int64]

_KINDS = ("recordingMeta", "tracksMeta", "tracks")
_FILE = re.compile(r"(\d+)_(recordingMeta|tracksMeta|tracks)\.csv")


@dataclass(frozen=True)
class Recording:
    """A recording in road coordinates. duplicates: identical rows of each vehicle that were dropped; samples: a
    few rows of columns that serve cross-checks alone.
    """

    number: int
    meta: RecordingMeta
    vehicles: VehicleMetas
    road: Road
    duplicates: IntArray
    samples: Samples


def discover(data: Path) -> list[int]:
    """Numbers of the recordings in a folder, ascending: any file of a triple announces its recording.

    Raises InputError if the folder is missing or holds none.
    """
    if not data.is_dir():
        raise fault(data, "not a folder")
    found = {int(match[1]) for path in data.iterdir() if (match := _FILE.fullmatch(path.name))}
    if not found:
        raise fault(data, "no file named like 01_tracks.csv")
    return sorted(found)


def input_files(data: Path, recording: int) -> tuple[Path, Path, Path]:
    """The recordingMeta, tracksMeta and tracks file of a recording; 1 may be written 1, 01 or 001.

    Raises InputError naming the file that is missing.
    """
    paths = [_file(data, recording, kind) for kind in _KINDS]
    return paths[0], paths[1], paths[2]


def _file(data: Path, recording: int, kind: str) -> Path:
    usual = data / f"{recording:02d}_{kind}.csv"
    candidates = [usual, data / f"{recording}_{kind}.csv", data / f"{recording:03d}_{kind}.csv"]
    found = [path for path in candidates if path.is_file()]
    if not found:
        raise fault(usual, "not found")
    return found[0]


def read_recording(data: Path, recording: int) -> Recording:
    """Read a recording's three files. Raises InputError naming file, column and row of the first fault."""
    meta_path, vehicles_path, tracks_path = input_files(data, recording)
    meta = read_recording_meta(meta_path)
    vehicles = read_vehicle_metas(vehicles_path)
    rows = read_rows(tracks_path, vehicles)
    return Recording(recording, meta, vehicles, to_road(rows, meta, vehicles), rows.duplicates, rows.samples)
