"""Compiled reading of plain decimal columns from a CSV file: digits, a sign, a point, commas, nothing else.

It reads several times as fast as a general reader because it looks only at the columns asked for, steps over
the others eight bytes at a time, and knows only what HighD writes. At the first byte that is anything else it
gives up, and a general reader takes over.

Files that may be packed with gzip: read as a stream, so that no unpacked copy is written or held.
"""

import gzip
import io
import os
import zlib
from pathlib import Path
from typing import Any, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.core.kernels import kernel

IntArray = NDArray[np.int64]
FloatArray = NDArray[np.float64]
_Bytes = NDArray[np.uint8]
_Words = NDArray[np.uint64]
_Int = int | np.signedinteger[Any]

FAULTS = (OSError, EOFError, zlib.error)
"""What reading a packed file raises if it is torn, or not packed at all."""


def open_bytes(path: Path) -> io.BufferedReader:
    """The bytes of a file, unpacked if its name ends in .gz, in whatever case."""
    return cast(io.BufferedReader, gzip.open(path)) if path.suffix.lower() == ".gz" else path.open("rb")


def size_of(path: Path) -> int:
    """Number of bytes that ``open_bytes`` gives. A packed file is read once for it: the size that it states is
    modulo 4 GiB, and wrong where files were joined.
    """
    with open_bytes(path) as file:
        return file.seek(0, os.SEEK_END)


SKIPPED = -1
FIRST_FLOAT = 64
FIRST_SAMPLED = 128
EVERY = 64

_CHUNK = 1 << 20
_WORD = 8
_POWERS = 10.0 ** np.arange(16, dtype=np.float64)
_MINUS, _POINT, _COMMA, _ZERO, _LINE_FEED, _RETURN = 45, 46, 44, 48, 10, 13
# Up to here every whole number is a float64, so that number / power of ten is the nearest float64.
_MOST_DIGITS = 15
_GAVE_UP = -1

# Constants of the arithmetic on eight bytes at a time; the first character is the lowest byte.
_EACH_BYTE = np.uint64(0x0101010101010101)
_LOW_BITS = np.uint64(0x7F7F7F7F7F7F7F7F)
_COMMAS = np.uint64(0x2C2C2C2C2C2C2C2C)
_ONE, _SEVEN, _TOP_BYTE = np.uint64(1), np.uint64(7), np.uint64(56)


def read_plain(path: Path, kinds: IntArray, limits: FloatArray) -> tuple[IntArray, FloatArray, FloatArray] | None:
    """Read whole-number and decimal columns of a file whose first line is the header.

    kinds: for each column of the file -1 = skip, k = k-th whole-number column, 64 + k = k-th decimal column,
    128 + k = k-th sampled column; limits: smallest and largest value of each column, shape (columns, 2). Returns
    arrays of shape (whole-number columns, rows), (decimal columns, rows), and (sampled columns, rows / EVERY):
    decimal columns of which the first of every ``EVERY`` rows is read, NaN where it is not plain. None if a line
    is torn, or a cell of the others not plain or out of its limits. A line break inside a skipped cell goes
    unnoticed.
    """
    n_integers = int(np.sum((kinds >= 0) & (kinds < FIRST_FLOAT)))
    n_floats = int(np.sum((kinds >= FIRST_FLOAT) & (kinds < FIRST_SAMPLED)))
    sampled_at = np.flatnonzero(kinds >= FIRST_SAMPLED)
    sampled_at = sampled_at[np.argsort(kinds[sampled_at])]
    # The shortest line: a comma or line feed a column, a digit a column that is read. Pages of an array that
    # nothing is written to take no memory, so the bound may be generous.
    most_rows = size_of(path) // (len(kinds) + n_integers + n_floats) + 1
    integers = np.empty((n_integers, most_rows), dtype=np.int64)
    floats = np.empty((n_floats, most_rows))
    sampled = np.empty((len(sampled_at), most_rows // EVERY + 1))
    dense = np.where(kinds >= FIRST_SAMPLED, SKIPPED, kinds)
    rows = _read_chunks(
        path, dense, limits, integers=integers, floats=floats, sampled=sampled, sampled_at=sampled_at
    )
    if rows == _GAVE_UP:
        return None
    return integers[:, :rows], floats[:, :rows], sampled[:, : -(-rows // EVERY)]


def _read_chunks(
    path: Path,
    kinds: IntArray,
    limits: FloatArray,
    *,
    integers: IntArray,
    floats: FloatArray,
    sampled: FloatArray,
    sampled_at: IntArray,
) -> int:
    """Parse the file chunk by chunk of whole lines. Returns the number of rows, or that it gave up."""
    buffer = np.zeros(_CHUNK + _WORD, dtype=np.uint8)
    words = np.ndarray(shape=_CHUNK + 1, dtype=np.uint64, buffer=buffer, strides=1)
    runs, lines = _runs(kinds), np.empty(_CHUNK // EVERY + 1, dtype=np.int64)
    row = kept = 0
    with open_bytes(path) as file:
        file.readline()
        while got := file.readinto(buffer.data[kept:_CHUNK]):
            filled = int(kept) + int(got)
            first = -(-row // EVERY)
            row, used = _parse(buffer, words, filled, kinds, runs, limits, integers, floats, row, _POWERS, lines)
            if used <= 0:
                return _GAVE_UP
            _sample(buffer, words, lines[: -(-row // EVERY) - first], sampled_at, sampled[:, first:], _POWERS)
            kept = filled - used
            buffer[:kept] = buffer[used:filled]
    return row if kept == 0 else _GAVE_UP


def _runs(kinds: IntArray) -> IntArray:
    """How many columns from each one on are skipped together; the last column never is one of them."""
    runs = np.zeros(len(kinds), dtype=np.int64)
    for column in range(len(kinds) - 2, -1, -1):
        runs[column] = runs[column + 1] + 1 if kinds[column] == SKIPPED else 0
    return runs


@njit(inline="always")
def _after_commas(words: _Words, at: _Int, commas: _Int, stop: _Int) -> _Int:
    """Place after the given number of commas, eight bytes a step; ``stop`` if there are not as many.

    A byte of ``marks`` has its top bit set where the byte is a comma (exact: no borrow between bytes).
    """
    while at < stop:
        other = words[at] ^ _COMMAS
        marks = ~(((other & _LOW_BITS) + _LOW_BITS) | other | _LOW_BITS)
        found = np.int64(((marks >> _SEVEN) * _EACH_BYTE) >> _TOP_BYTE)
        if found >= commas:
            for _ in range(commas - 1):
                marks &= marks - _ONE
            below = (marks & (~marks + _ONE)) - _ONE
            return at + np.int64(((below & _EACH_BYTE) * _EACH_BYTE) >> _TOP_BYTE)
        commas -= found
        at += _WORD
    return stop


@njit(inline="always")
def _number(buffer: _Bytes, at: _Int, decimal: bool) -> tuple[_Int, _Int, _Int]:
    """Number from ``at`` on without its point, its decimals, and the place after it, -1 if it is not plain."""
    byte = buffer[at]
    negative = byte == _MINUS
    if negative:
        at += 1
        byte = buffer[at]
    number, digits, decimals = np.int64(0), 0, 0
    digit = np.uint8(byte - _ZERO)
    while digit < 10:
        number = number * 10 + np.int64(digit)
        digits += 1
        at += 1
        byte = buffer[at]
        digit = np.uint8(byte - _ZERO)
    if byte == _POINT and decimal and digits > 0:
        at += 1
        digit = np.uint8(buffer[at] - _ZERO)
        while digit < 10:
            number = number * 10 + np.int64(digit)
            decimals += 1
            at += 1
            digit = np.uint8(buffer[at] - _ZERO)
    plain = 0 < digits + decimals <= _MOST_DIGITS
    return (-number if negative else number), decimals, (at if plain else _GAVE_UP)


@kernel()
def _parse(
    buffer: _Bytes,
    words: _Words,
    filled: int,
    kinds: IntArray,
    runs: IntArray,
    limits: FloatArray,
    integers: IntArray,
    floats: FloatArray,
    row: int,
    powers: FloatArray,
    lines: IntArray,
) -> tuple[int, int]:
    """Parse the whole lines of a buffer. Returns the next row and the bytes used, or that it gave up.

    words: the eight bytes from each byte of the buffer on; lines: where the sampled lines begin, filled in.
    """
    stop = filled
    while stop > 0 and buffer[stop - 1] != _LINE_FEED:
        stop -= 1
    last = len(kinds) - 1
    at: _Int = 0
    n_lines = 0
    while at < stop:
        if row % EVERY == 0:
            lines[n_lines] = at
            n_lines += 1
        column = 0
        while column <= last:
            if runs[column] > 0:
                at = _after_commas(words, at, runs[column], stop)
                column += runs[column]
                if at >= stop:
                    return row, _GAVE_UP
            kind = kinds[column]
            if kind == SKIPPED:  # the last column
                while buffer[at] != _LINE_FEED and buffer[at] != _COMMA:
                    at += 1
            else:
                decimal = kind >= FIRST_FLOAT
                number, decimals, at = _number(buffer, at, decimal)
                if at == _GAVE_UP:
                    return row, _GAVE_UP
                value = number / powers[decimals]
                if not limits[column, 0] <= value <= limits[column, 1]:
                    return row, _GAVE_UP
                if decimal:
                    floats[kind - FIRST_FLOAT, row] = value
                else:
                    integers[kind, row] = number
            if column == last and buffer[at] == _RETURN:
                at += 1
            if buffer[at] != (_LINE_FEED if column == last else _COMMA):
                return row, _GAVE_UP
            at += 1
            column += 1
        row += 1
    return row, int(at)


@kernel()
def _sample(
    buffer: _Bytes, words: _Words, lines: IntArray, columns: IntArray, sampled: FloatArray, powers: FloatArray
) -> None:
    """Parse some columns of some lines, NaN where a cell is not plain. columns: of the file; the last one too."""
    for place in range(len(lines)):
        for k in range(len(columns)):
            at: _Int = lines[place]
            if columns[k] > 0:
                at = _after_commas(words, at, columns[k], len(buffer))
            number, decimals, end = _number(buffer, at, True)
            plain = end != _GAVE_UP and (
                buffer[end] == _COMMA or buffer[end] == _LINE_FEED or buffer[end] == _RETURN
            )
            sampled[k, place] = number / powers[decimals] if plain else np.nan
