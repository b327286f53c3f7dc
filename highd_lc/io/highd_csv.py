"""Typed reading of HighD's CSV files: only the columns asked for, and every fault named by file, column, row.

Files that are taken for HighD's and are not: what their first line says they are.

Sources of the columns: the documentation of exiD, inD, rounD and uniD (levelXdata), AD4CHE, NGSIM and TGSIM
(US DOT open data), CitySim (UCF SST), INTERACTION, and pNEUMA (EPFL).
"""

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray
from pyarrow import csv as arrow_csv

from highd_lc.io import plain_numbers
from highd_lc.io.plain_numbers import EVERY, FIRST_FLOAT, FIRST_SAMPLED, read_plain
from highd_lc.vocab.errors import InputError

# The first that has all its columns, in whatever case, is the answer: the special before the general.
_SETS = (
    ("NGSIM", ("Vehicle_ID", "Local_X")),
    ("TGSIM", ("xloc_kf", "yloc_kf")),
    ("TGSIM", ("xloc-kf", "yloc-kf")),
    ("exiD", ("trackId", "xCenter", "laneletId")),
    ("exiD", ("trackId", "xCenter", "leadId")),
    ("inD, rounD, uniD or exiD", ("trackId", "xCenter")),
    ("inD, rounD, uniD or exiD", ("recordingId", "locationId", "orthoPxToMeter")),
    ("inD, rounD, uniD or exiD", ("recordingId", "trackId", "numFrames")),
    ("AD4CHE", ("laneMarkings",)),
    ("CitySim", ("carId", "carCenterX")),
    ("INTERACTION", ("track_id", "timestamp_ms")),
    ("pNEUMA", ("track_id", "traveled_d")),
)
_SEPARATORS = {";": "';'", "\t": "tabs", "|": "'|'"}
_DECIMAL_COMMAS = " (as spreadsheets save it in languages with decimal commas)"


def lookalike(line: str) -> str:
    """What a file with this first line looks like, as in "it looks like ..."; empty if nothing is known of it."""
    if line.startswith(("\\xff\\xfe", "\\xfe\\xff")) or "\0" in line:
        return "UTF-16 text"
    if line.lstrip().lower().startswith(("<!doctype", "<html", "<?xml")):
        return "a web page, not a download of data"
    if line.startswith("version https://git-lfs"):
        return "a pointer of Git LFS, whose data was not fetched"
    separator = max([",", *_SEPARATORS], key=line.count)
    cells = [cell.strip().strip('"').lower() for cell in line.split(separator)]
    names = [name for name, columns in _SETS if {column.lower() for column in columns} <= set(cells)]
    known = f"one of {names[0]}" if names else ""
    if separator in _SEPARATORS:
        apart = f"{_SEPARATORS[separator]} between cells"
        return (
            f"{known}, with {apart}" if known else f"a table with {apart}" + _DECIMAL_COMMAS * (separator == ";")
        )
    return known or ("rows without a header line" if _all_numbers(cells) else "")


def _all_numbers(cells: Sequence[str]) -> bool:
    try:
        return bool([float(cell) for cell in cells])
    except ValueError:
        return False


Array = NDArray[Any]
"""A column: float64, int64 or text, as its field says."""


@dataclass(frozen=True)
class Field:
    """A column of a CSV file: whole number, number or text, and the range that a sane file keeps.

    optional: a number that the file may lack; it is NaN then. may_be_empty: a text that may have no letter. why:
    what needs the range, if that is not plain. sampled: a number that serves cross-checks alone, read in the first
    of every ``EVERY`` rows; NaN where it is none.
    """

    name: str
    kind: type[int] | type[float] | type[str]
    low: float = -np.inf
    high: float = np.inf
    optional: bool = False
    may_be_empty: bool = False
    why: str = ""
    sampled: bool = False

    def fault(self, text: str) -> str | None:
        """Why the text cannot be this field's value, or None."""
        if self.kind is str:
            return None if text or self.may_be_empty else "is empty"
        try:
            # Python would read 1_000 and foreign digits too.
            value = float(text) if text.isascii() and "_" not in text else None
        except ValueError:
            value = None
        if value is None:
            return f"{text[:40]!r} is not a number"
        if not isfinite(value):
            return f"{text[:40]!r} is not a finite number"
        if self.kind is int and value != int(value):
            return f"{text[:40]!r} is not a whole number"
        if not self.low <= value <= self.high:
            return f"{text[:40]} is outside [{self.low:g}, {self.high:g}]{self.why and ': ' + self.why}"
        return None


def fault(path: Path, text: str, *, column: str = "", row: int = 0) -> InputError:
    """The error for a fault in an input file. row: line of the file, 1 = header, 0 = none."""
    place = ", ".join([*([f"row {row}"] if row else []), *([f"column {column!r}"] if column else [])])
    return InputError(f"{path}: {place}: {text}" if place else f"{path}: {text}")


_TYPES = {int: pa.int64(), float: pa.float64(), str: pa.string()}


def _type(field: Field) -> pa.DataType:
    return pa.string() if field.sampled else _TYPES[field.kind]


def read_columns(path: Path, fields: Sequence[Field]) -> dict[str, Array]:
    """Read the columns of a CSV file as arrays, in the order of ``fields``; each of shape (rows,), those that are
    sampled (rows / EVERY,).

    Raises InputError naming file, column and row (line of the file, 1 = header) if the file is missing, empty
    or torn, a column is missing or doubled, or a cell is not what its field says.
    """
    header = _checked_header(path, fields)
    present = [field for field in fields if field.name in header]
    try:
        columns = _read_plain(path, header, present) or _read_general(path, header, present)
    except plain_numbers.FAULTS as error:
        raise fault(path, f"cannot be read: {error}") from error
    unknown = np.full(max(len(values) for values in columns.values()), np.nan)
    return {f.name: columns.get(f.name, unknown[::EVERY] if f.sampled else unknown) for f in fields}


def _read_plain(path: Path, header: list[str], fields: Sequence[Field]) -> dict[str, Array] | None:
    """The fast way, for files that hold plain numbers only in the columns asked for."""
    if any(field.kind is str for field in fields):
        return None
    kinds, limits = np.full(len(header), -1), np.zeros((len(header), 2))
    whole = [field for field in fields if field.kind is int]
    decimal = [field for field in fields if field.kind is float and not field.sampled]
    sampled = [field for field in fields if field.sampled]
    for first, group in ((0, whole), (FIRST_FLOAT, decimal), (FIRST_SAMPLED, sampled)):
        for place, field in enumerate(group):
            kinds[header.index(field.name)] = first + place
            limits[header.index(field.name)] = field.low, field.high
    arrays = read_plain(path, kinds, limits)
    if arrays is None:
        return None
    values = (row for array in arrays for row in array)
    by_name = dict(zip((f.name for f in (*whole, *decimal, *sampled)), values, strict=True))
    return {field.name: by_name[field.name] for field in fields}


def _read_general(path: Path, header: list[str], fields: Sequence[Field]) -> dict[str, Array]:
    """The way that knows quotes, exponents and text, and that names what is wrong."""
    try:
        table = _read(path, header, {f.name: _type(f) for f in fields})
    except (pa.ArrowInvalid, OSError) as error:
        table = _read_leniently(path, header, fields, error)
    columns = {f.name: _to_numpy(table[f.name], f) for f in fields}
    if any(_is_faulty(columns[f.name], f) for f in fields):
        raise_first_fault(path, fields, "holds values out of range")
    # Arrow's own memory is read-only; what is read here belongs to the caller.
    return {f.name: columns[f.name].astype(np.int64 if f.kind is int else columns[f.name].dtype) for f in fields}


def _read(path: Path, header: list[str], types: Mapping[str, pa.DataType]) -> pa.Table:
    """One thread: the engine runs recordings side by side, and one thread costs 30 % less CPU time."""
    with plain_numbers.open_bytes(path) as file:
        return arrow_csv.read_csv(
            file,
            read_options=arrow_csv.ReadOptions(use_threads=False, column_names=header, skip_rows=1),
            convert_options=arrow_csv.ConvertOptions(
                column_types=types, include_columns=list(types), strings_can_be_null=False
            ),
        )


def _read_leniently(path: Path, header: list[str], fields: Sequence[Field], first_error: Exception) -> pa.Table:
    """Whole numbers written as 1.0 are read too; anything else is named and refused."""
    try:
        return _read(path, header, {f.name: pa.float64() if f.kind is int else _type(f) for f in fields})
    except (pa.ArrowInvalid, OSError):
        raise_first_fault(path, fields, " ".join(str(first_error).split())[:200])


def _to_numpy(column: pa.ChunkedArray, field: Field) -> Array:
    if field.sampled:
        return np.array([_lenient(text) for text in column[::EVERY].to_pylist()], dtype=np.float64)
    if field.kind is str:
        texts: Array = pc.utf8_trim_whitespace(column).to_numpy().astype(np.str_)
        return texts
    if pa.types.is_floating(column.type):
        column = pc.fill_null(column, np.nan)
    elif pa.types.is_integer(column.type) and column.null_count:
        column = column.cast(pa.float64())
    numbers: Array = column.to_numpy()
    return numbers


def _lenient(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return float("nan")


def _is_faulty(values: Array, field: Field) -> bool:
    if field.sampled:
        return False
    if field.kind is str:
        return not field.may_be_empty and bool(np.any(values == ""))
    if len(values) == 0:
        return False
    low, high = values.min(), values.max()  # NaN is contagious and fails the comparison
    whole = field.kind is float or values.dtype.kind == "i" or bool(np.all(values == np.floor(values)))
    return not (np.isfinite(low) and np.isfinite(high) and field.low <= low and high <= field.high and whole)


def _checked_header(path: Path, fields: Sequence[Field]) -> list[str]:
    header = next(_lines(path), (0, []))[1]
    if not any(header):
        raise fault(path, "empty file")
    for field in fields:
        if header.count(field.name) != 1 and not (field.optional and field.name not in header):
            text = "is there more than once" if field.name in header else "is missing" + _instead(path, fields)
            raise fault(path, text, column=field.name)
    return header


def _instead(path: Path, fields: Sequence[Field]) -> str:
    """What a file without a column that it must have looks like, and what is expected, as an end of a sentence."""
    if not (text := lookalike(first_line(path))):
        return ""
    columns = ", ".join(field.name for field in fields if not field.optional)
    wanted = f"',' between cells, decimal points, the columns {columns}"
    return f"; the file looks like {text}; expected is HighD's format: {wanted}"


def first_line(path: Path) -> str:
    """The first line of a file as text, at most 4096 characters; bytes that are no UTF-8 are shown escaped.

    Raises InputError if the file cannot be read.
    """
    try:
        with plain_numbers.open_bytes(path) as file:
            line = file.readline(4096)
    except plain_numbers.FAULTS as error:
        raise fault(path, f"cannot be read: {error}") from error
    return line.decode("utf-8-sig", errors="backslashreplace").strip()


def _lines(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Line numbers and cells. A byte order mark is dropped; bytes that are no UTF-8 are shown escaped."""
    try:
        with plain_numbers.open_bytes(path) as file:
            reader = csv.reader(io.TextIOWrapper(file, "utf-8-sig", errors="backslashreplace", newline=""))
            for cells in reader:
                yield reader.line_num, [cell.strip() for cell in cells]
    except FileNotFoundError:
        raise fault(path, "not found") from None
    except (*plain_numbers.FAULTS, csv.Error) as error:
        raise fault(path, f"cannot be read: {error}") from error


def raise_first_fault(path: Path, fields: Sequence[Field], otherwise: str) -> NoReturn:
    """Read a file again, cell by cell, and raise InputError with the first fault, else with ``otherwise``."""
    lines = _lines(path)
    header = next(lines)[1]
    places = [(header.index(field.name), field) for field in fields if not field.sampled]
    for row, cells in lines:
        if not any(cells):
            continue
        if len(cells) != len(header):
            raise fault(path, f"{len(cells)} cells, the header has {len(header)}", row=row)
        for place, field in places:
            if text := field.fault(cells[place]):
                raise fault(path, text, column=field.name, row=row)
    raise fault(path, otherwise)
