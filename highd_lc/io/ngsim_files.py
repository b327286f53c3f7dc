"""Where NGSIM trajectories lie, and which recordings one file holds.

US DOT publishes them twice: as a file a period of 15 minutes (text with blanks between columns and no header, or
CSV), and all in one CSV with a column ``Location``. Frames and vehicle ids begin anew with every period, and
Global_Time [ms] less Frame_ID times 100 ms is the moment at which a period began: rows of one location and one
beginning are one recording. Recordings are numbered from 1 in the order of files, locations and beginnings.
"""

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, NoReturn

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import csv as arrow_csv

from highd_lc.io import plain_numbers
from highd_lc.io.highd_csv import Field, fault, first_line, raise_first_fault, read_columns
from highd_lc.io.highd_files import tables_of
from highd_lc.vocab.errors import InputError

Block = dict[str, NDArray[Any]]
"""Columns of some rows of a file, by NGSIM's names as US DOT documents them."""

PLACE_OF: Final = {
    "laneId": "Lane_ID", "precedingId": "Preceding", "followingId": "Following", "dhw": "Space_Headway",
    "xVelocity": "v_Vel", "xAcceleration": "v_Acc", "x": "Local_Y", "y": "Local_X", "yVelocity": "Local_X",
    "yAcceleration": "Local_X", "width": "v_Length", "height": "v_Width", "class": "v_Class",
    "numFrames": "Total_Frames", "initialFrame": "Frame_ID", "finalFrame": "Frame_ID",
    "drivingDirection": "Local_Y", "upperLaneMarkings": "Local_X", "lowerLaneMarkings": "Local_X",
}  # fmt: skip
"""The column that takes the place of each of HighD's: there x is along the road, and a box's width its length."""

FRAME_MS = 100
"""Milliseconds between two frames: 10 Hz."""
_FAR, _LARGEST = 1e5, 10_000_000
FIELDS = (
    Field("Vehicle_ID", int, 1, _LARGEST),
    Field("Frame_ID", int, 1, _LARGEST),
    Field("Total_Frames", int, 0, _LARGEST),
    Field("Global_Time", int, 0, 1e15),
    Field("Local_X", float, -_FAR, _FAR),
    Field("Local_Y", float, -_FAR, _FAR),
    Field("v_Length", float, 0.3, 300),
    Field("v_Width", float, 0.3, 60),
    Field("v_Class", int, 1, 3),
    Field("v_Vel", float, -600, 600),
    Field("v_Acc", float, -1600, 1600),
    Field("Lane_ID", int, 0, 1000),
    Field("Preceding", int, 0, _LARGEST),
    Field("Following", int, 0, _LARGEST),
    Field("Space_Headway", float),
)
# Columns of the text files in their order: they have no header.
_OF_TEXT = (
    "Vehicle_ID", "Frame_ID", "Total_Frames", "Global_Time", "Local_X", "Local_Y", "Global_X", "Global_Y",
    "v_Length", "v_Width", "v_Class", "v_Vel", "v_Acc", "Lane_ID", "Preceding", "Following", "Space_Headway",
    "Time_Headway",
)  # fmt: skip
_OTHER_NAMES = {"preceeding": "Preceding", "space_hdwy": "Space_Headway"}
_BY_NAME = {field.name.lower(): field.name for field in FIELDS} | _OTHER_NAMES
_LOCATION = "Location"
_TABLES = (".csv", ".txt", ".gz")
_STREETS = ("lankershim", "peachtree")
"""Locations with traffic signals: streets, no motorways."""
_ROWS = 1 << 18
_WHOLE_BYTES = 400_000_000
"""Largest file that is read at once: a period of 15 minutes has 140 to 200 MB."""


@dataclass(frozen=True)
class Layout:
    """How a file is written. names: of its columns as they stand there; text: blanks between cells, no header."""

    names: tuple[str, ...]
    text: bool

    @property
    def known(self) -> dict[str, str]:
        """US DOT's name of each column that is read, by the name that it has here."""
        return {name: _BY_NAME[name.lower()] for name in self.names if name.lower() in _BY_NAME}

    @property
    def location(self) -> str | None:
        """The column of the location, if there is one."""
        return next((name for name in self.names if name.lower() == _LOCATION.lower()), None)


@dataclass(frozen=True)
class Period:
    """One recording within a file. location: as the file says, or as its path does, or ""; first, last: bounds of
    the moment at which it began [ms], both included.
    """

    path: Path
    layout: Layout
    location: str
    first: int
    last: int


def layout_of(path: Path) -> Layout | None:
    """How a file of NGSIM trajectories is written; None of any other file."""
    try:
        line = first_line(path)
    except InputError:
        return None
    cells = line.split()
    if len(cells) == len(_OF_TEXT) and "," not in line and all(map(_is_number, cells)):
        return Layout(_OF_TEXT, text=True)
    names = tuple(cell.strip() for cell in next(csv.reader([line]), []))
    lower = {name.lower() for name in names}
    return Layout(names, text=False) if {"vehicle_id", "local_x", "local_y"} <= lower else None


def _is_number(text: str) -> bool:
    try:
        return bool(np.isfinite(float(text)))
    except ValueError:
        return False


def find_files(data: Path) -> dict[Path, Layout]:
    """The files of NGSIM trajectories in a folder; if there is none, in the nearest folder below that has any."""
    return tables_of(data, _TABLES, layout_of)


def periods(data: Path) -> list[Period]:
    """The recordings of a folder on motorways. Raises InputError if there is none, or a file cannot be read."""
    found = _all_periods(data)
    chosen = [one for one in found if not _is_street(one)]
    if not chosen:
        text = f"only {', '.join(sorted({one.location for one in found}))}: streets with signals" if found else ""
        raise fault(data, text or "no rows of NGSIM trajectories")
    return chosen


def period(data: Path, recording: int) -> Period:
    """The recording of that number. Raises InputError if there is none."""
    found = periods(data)
    if not 1 <= recording <= len(found):
        raise fault(data, f"no recording {recording}: there are {len(found)}")
    return found[recording - 1]


def left_out(data: Path) -> list[str]:
    """The periods of streets, which are no recordings of motorways, in words."""
    streets = [one for one in _all_periods(data) if _is_street(one)]
    return [f"{one.path.name}: a period of {one.location} is left out: a street with signals" for one in streets]


def _is_street(one: Period) -> bool:
    return any(name in one.location for name in _STREETS)


def _all_periods(data: Path) -> list[Period]:
    found: list[Period] = []
    for path, layout in find_files(data).items():
        about = path.stat()
        found += _periods_of(path, layout, about.st_size, about.st_mtime_ns)
    return found


@lru_cache(maxsize=64)
def _periods_of(path: Path, layout: Layout, size: int, changed: int) -> tuple[Period, ...]:
    """The periods of a file. size, changed: of the file, so that another one is read anew."""
    begun: dict[str, set[int]] = {}
    names = ("Frame_ID", "Global_Time")
    for block, location in blocks(path, layout, names):
        seconds = (block["Global_Time"] - FRAME_MS * block["Frame_ID"]) // 1000
        for place in np.unique(location) if location is not None else [_location_in(path)]:
            own = seconds if location is None else seconds[location == place]
            begun.setdefault(str(place), set()).update(np.unique(own).tolist())
    return tuple(
        Period(path, layout, place, 1000 * first, 1000 * last + 999)
        for place in sorted(begun)
        for first, last in _clusters(sorted(begun[place]))
    )


def _location_in(path: Path) -> str:
    """The location that the path of a file without a column for it speaks of."""
    plain = str(path).lower().replace("_", "-")
    known = {"us-101": ("us-101", "us101"), "i-80": ("i-80", "i80")} | {name: (name,) for name in _STREETS}
    return next((name for name, texts in known.items() if any(text in plain for text in texts)), "")


def _clusters(seconds: Sequence[int]) -> Iterator[tuple[int, int]]:
    """First and last of each run of moments less than a minute apart."""
    ends = [k for k in range(1, len(seconds)) if seconds[k] - seconds[k - 1] > 60]
    for first, last in zip([0, *ends], [*ends, len(seconds)], strict=True):
        if last > first:
            yield seconds[first], seconds[last - 1]


def blocks(path: Path, layout: Layout, wanted: Sequence[str]) -> Iterator[tuple[Block, NDArray[Any] | None]]:
    """The rows of a file, some at a time: columns by US DOT's names, and the locations if it has them.

    Raises InputError naming file, column and row if a column is missing or a cell is no number.
    """
    _refuse_missing(path, layout, wanted)
    chosen = {there: name for there, name in layout.known.items() if name in wanted}
    try:
        if layout.text:
            yield from ((block, None) for block in _text_blocks(path, chosen))
        elif layout.location is None and plain_numbers.size_of(path) <= _WHOLE_BYTES:
            yield _whole(path, chosen), None
        else:
            yield from _csv_blocks(path, layout, chosen)
    except (pa.ArrowInvalid, ValueError, *plain_numbers.FAULTS) as error:
        first_fault(path, layout, wanted, " ".join(str(error).split())[:200])


def _refuse_missing(path: Path, layout: Layout, wanted: Sequence[str]) -> None:
    known = list(layout.known.values())
    for name in wanted:
        if known.count(name) != 1:
            text = "is there more than once" if name in known else f"is missing; NGSIM's are {', '.join(_OF_TEXT)}"
            raise fault(path, text, column=name)


def _whole(path: Path, chosen: dict[str, str]) -> Block:
    """A file without text at once, by the reader of plain numbers: three times as fast."""
    fields = {field.name: field for field in FIELDS}
    found = read_columns(path, [_renamed(fields[name], there) for there, name in chosen.items()])
    return {name: found[there] for there, name in chosen.items()}


def _csv_blocks(path: Path, layout: Layout, chosen: dict[str, str]) -> Iterator[tuple[Block, NDArray[Any] | None]]:
    place = layout.location
    words_type = pa.dictionary(pa.int32(), pa.string())
    types = dict.fromkeys(chosen, pa.float64()) | ({place: words_type} if place else {})
    with plain_numbers.open_bytes(path) as file:
        reader = arrow_csv.open_csv(
            file,
            read_options=arrow_csv.ReadOptions(
                use_threads=False, column_names=list(layout.names), skip_rows=1, block_size=1 << 23
            ),
            convert_options=arrow_csv.ConvertOptions(
                column_types=types, include_columns=list(types), null_values=[], strings_can_be_null=False
            ),
        )
        for batch in reader:
            columns = {name: batch[there].to_numpy() for there, name in chosen.items()}
            words = batch[place].dictionary_decode().to_numpy(zero_copy_only=False) if place else None
            yield columns, None if words is None else np.char.lower(words.astype(np.str_))


def _text_blocks(path: Path, chosen: dict[str, str]) -> Iterator[Block]:
    with plain_numbers.open_bytes(path) as file:
        import pandas as pd  # a quarter of a second that readers of other formats need not wait

        chunks = pd.read_csv(
            file, sep=r"\s+", header=None, names=list(_OF_TEXT), usecols=list(chosen), dtype=np.float64,
            chunksize=_ROWS, na_filter=False,
        )  # fmt: skip
        for chunk in chunks:
            yield {name: chunk[there].to_numpy() for there, name in chosen.items()}


def first_fault(path: Path, layout: Layout, wanted: Sequence[str], otherwise: str) -> NoReturn:
    """Read a file again, cell by cell, and raise InputError with the first fault of the columns asked for."""
    fields = {field.name: field for field in FIELDS if field.name in wanted}
    if layout.text:
        _first_fault_of_text(path, fields)
        raise fault(path, otherwise)
    named = {there: fields[name] for there, name in layout.known.items() if name in fields}
    raise_first_fault(path, [_renamed(field, there) for there, field in named.items()], otherwise)


def _renamed(field: Field, name: str) -> Field:
    return Field(name, field.kind, field.low, field.high)


def _first_fault_of_text(path: Path, fields: dict[str, Field]) -> None:
    with plain_numbers.open_bytes(path) as file:
        for row, line in enumerate(file, start=1):
            cells = line.decode("utf-8", errors="backslashreplace").split()
            if cells and len(cells) != len(_OF_TEXT):
                raise fault(path, f"{len(cells)} cells, expected {len(_OF_TEXT)}", row=row)
            for name, cell in zip(_OF_TEXT, cells, strict=bool(cells)) if cells else ():
                if name in fields and (text := fields[name].fault(cell)):
                    raise fault(path, text, column=name, row=row)
