"""Where TGSIM trajectories lie, and which recordings one file holds.

US DOT's Third Generation Simulation data: a CSV a site, with hyphens (``xloc-kf``) or, from its portal,
underscores (``xloc_kf``) in the names. ``run_index`` numbers the flights in a file; each is a recording.
Recordings are numbered from 1 in the order of files and runs.
"""

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final, NoReturn

import numpy as np
import pyarrow as pa
from pyarrow import csv as arrow_csv

from highd_lc.io import plain_numbers
from highd_lc.io.highd_csv import Field, fault, first_line, raise_first_fault
from highd_lc.io.highd_files import tables_of
from highd_lc.io.unmarked import Block
from highd_lc.vocab.errors import InputError

PLACE_OF: Final = {
    "laneId": "lane_kf", "xVelocity": "speed_kf", "xAcceleration": "acceleration_kf", "x": "xloc_kf",
    "y": "yloc_kf", "yVelocity": "yloc_kf", "yAcceleration": "yloc_kf", "width": "length_smoothed",
    "height": "width_smoothed", "class": "type_most_common", "numFrames": "time", "initialFrame": "time",
    "finalFrame": "time", "drivingDirection": "xloc_kf", "upperLaneMarkings": "lane_kf",
    "lowerLaneMarkings": "lane_kf", "precedingId": "id", "followingId": "id", "dhw": "id",
}  # fmt: skip
"""The column that takes the place of each of HighD's; neighbours and gaps are worked out."""

_FAR, _LARGEST = 1e5, 10_000_000
FIELDS: Final = (
    Field("id", int, 0, _LARGEST),
    Field("time", float, 0, 1e6),
    Field("xloc_kf", float, -_FAR, _FAR),
    Field("yloc_kf", float, -_FAR, _FAR),
    Field("lane_kf", int, -1000, 1000),
    Field("speed_kf", float, -100, 200),
    Field("acceleration_kf", float, -500, 500),
    Field("length_smoothed", float, 0.1, 100),
    Field("width_smoothed", float, 0.1, 20),
)
TYPE: Final = "type_most_common"
RUN: Final = "run_index"
_TELLING = {"id", "time", "xloc_kf", "yloc_kf"}
_OF_STREETS = "speed_kf_x"
"""Foggy Bottom, streets with signals and pedestrians, has speeds by axis."""
_TABLES = (".csv", ".gz")


@dataclass(frozen=True)
class Layout:
    """The names of a file's columns as they stand there."""

    names: tuple[str, ...]

    def there(self, name: str) -> list[str]:
        """All names in the file that mean this column; empty if it has none."""
        return [one for one in self.names if _plain(one) == name]

    @property
    def is_street(self) -> bool:
        """Whether the file is of streets."""
        return bool(self.there(_OF_STREETS))


@dataclass(frozen=True)
class Run:
    """One recording within a file. number: of the run, None where the file does not number them."""

    path: Path
    layout: Layout
    number: float | None


def _plain(name: str) -> str:
    return name.strip().lower().replace("-", "_")


def layout_of(path: Path) -> Layout | None:
    """How a file of TGSIM trajectories is written; None of any other file."""
    try:
        line = first_line(path)
    except InputError:
        return None
    names = tuple(cell.strip() for cell in next(csv.reader([line]), []))
    return Layout(names) if set(map(_plain, names)) >= _TELLING else None


def find_files(data: Path) -> dict[Path, Layout]:
    """The files of TGSIM trajectories in a folder; if there is none, in the nearest folder below that has any."""
    return tables_of(data, _TABLES, layout_of)


def runs(data: Path) -> list[Run]:
    """The recordings of a folder on motorways. Raises InputError if there is none, or a file cannot be read."""
    found: list[Run] = []
    files = {path: layout for path, layout in find_files(data).items() if not layout.is_street}
    for path, layout in files.items():
        about = path.stat()
        found += _runs_of(path, layout, about.st_size, about.st_mtime_ns)
    if not found:
        raise fault(data, "no rows of TGSIM trajectories on motorways")
    return found


def run(data: Path, recording: int) -> Run:
    """The recording of that number. Raises InputError if there is none."""
    found = runs(data)
    if not 1 <= recording <= len(found):
        raise fault(data, f"no recording {recording}: there are {len(found)}")
    return found[recording - 1]


def left_out(data: Path) -> list[str]:
    """The files of streets, which are no recordings of motorways, in words."""
    streets = [path for path, layout in find_files(data).items() if layout.is_street]
    return [f"{path.name} is left out: streets with signals (speeds by axis)" for path in streets]


@lru_cache(maxsize=64)
def _runs_of(path: Path, layout: Layout, size: int, changed: int) -> tuple[Run, ...]:
    """The runs of a file. size, changed: of the file, so that another one is read anew."""
    if not layout.there(RUN):
        return (Run(path, layout, None),)
    numbers = {float(n) for block in blocks(path, layout, (RUN,), ()) for n in np.unique(block[RUN]).tolist()}
    return tuple(Run(path, layout, number) for number in sorted(numbers))


def blocks(path: Path, layout: Layout, numbers: Sequence[str], words: Sequence[str]) -> Iterator[Block]:
    """The rows of a file, some at a time: columns of numbers, NaN where a cell is empty, and of words.

    Raises InputError naming file, column and row if a column is missing or a cell is no number.
    """
    there = {name: _one(path, layout, name) for name in (*numbers, *words)}
    types = {there[name]: pa.float64() for name in numbers} | {there[name]: pa.string() for name in words}
    try:
        with plain_numbers.open_bytes(path) as file:
            reader = arrow_csv.open_csv(
                file,
                read_options=arrow_csv.ReadOptions(
                    use_threads=False, column_names=list(layout.names), skip_rows=1, block_size=1 << 23
                ),
                convert_options=arrow_csv.ConvertOptions(
                    column_types=types, include_columns=list(types), null_values=[""], strings_can_be_null=False
                ),
            )
            for batch in reader:
                columns: Block = {n: batch[there[n]].to_numpy(zero_copy_only=False) for n in (*numbers, *words)}
                yield columns | {n: columns[n].astype(np.str_) for n in words}
    except (pa.ArrowInvalid, ValueError, *plain_numbers.FAULTS) as error:
        first_fault(path, layout, numbers, " ".join(str(error).split())[:200])


def _one(path: Path, layout: Layout, name: str) -> str:
    found = layout.there(name)
    if len(found) != 1:
        expected = ", ".join(field.name for field in FIELDS)
        text = "is there more than once" if found else f"is missing; TGSIM's are {expected}, {TYPE} and {RUN}"
        raise fault(path, text, column=name)
    return found[0]


def first_fault(path: Path, layout: Layout, wanted: Sequence[str], otherwise: str) -> NoReturn:
    """Read a file again, cell by cell, and raise InputError with the first fault of the columns asked for."""
    known = {field.name: field for field in (*FIELDS, Field(RUN, float, -1e6, 1e6))}
    fields = [
        Field(layout.there(name)[0], known[name].kind, known[name].low, known[name].high)
        for name in wanted
        if name != "lane_kf"  # which may be empty
    ]
    raise_first_fault(path, fields, otherwise)
