"""HighD recordings, in road coordinates. The only modules that know HighD's conventions are highd*.

Files of recording RR: RR_recordingMeta.csv, RR_tracksMeta.csv, RR_tracks.csv. In them (x, y) is the upper-left
corner of a box in the image, y grows down, "width" is the length; direction 1 (upper carriageway) drives to -x
with its left at larger y, direction 2 (lower) drives to +x with its left at smaller y; lane ids count the
intervals between all markings from the top; id 0 means none. Here: x forward from the entry end of the
section, y left from the carriageway's right edge, box centres, lane 1 = rightmost, 0 = none or outside.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from highd_lc.io.highd_csv import fault
from highd_lc.io.highd_files import input_files
from highd_lc.io.highd_metas import RecordingMeta, VehicleMetas, read_recording_meta, read_vehicle_metas
from highd_lc.io.highd_road import Road, to_road
from highd_lc.io.highd_rows import Samples, read_rows

IntArray = NDArray[np.int64]


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
        lost = vehicles.id[vehicles.direction == direction] if len(markings) == 0 else ()
        if len(lost):
            text = f"vehicle {lost[0]} drives in direction {direction}, and {column}LaneMarkings has no markings"
            raise fault(path, text, column="drivingDirection")
