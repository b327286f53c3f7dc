"""A fast CSV writer for tables of integers and of numbers with two decimals, as HighD prints them."""

from pathlib import Path
from typing import BinaryIO

import numpy as np
import pandas as pd
from numba import njit
from numpy.typing import NDArray

from highd_lc.io.whole_file import whole_file

_ROWS_A_CHUNK = 32768
_LONGEST_FIELD = 13  # sign, ten digits of an int32, decimal point, separator
_MINUS, _POINT, _ZERO, _COMMA, _NEWLINE = 45, 46, 48, 44, 10


def write_table(path: Path, header: str, table: NDArray[np.int32], *, decimals: NDArray[np.bool_]) -> None:
    """Write a table, shape (rows, columns); columns with decimals hold hundredths and print two decimals."""
    with whole_file(path) as file:
        file.write(header.encode() + b"\n")
        _write_rows(file, table, decimals)


def write_frame(path: Path, frame: pd.DataFrame, *, float_format: str) -> None:
    """Write a small table as CSV."""
    with whole_file(path) as file:
        file.write(frame.to_csv(index=False, float_format=float_format).encode())


def _write_rows(file: BinaryIO, table: NDArray[np.int32], decimals: NDArray[np.bool_]) -> None:
    buffer = np.empty(_ROWS_A_CHUNK * table.shape[1] * _LONGEST_FIELD, np.uint8)
    for start in range(0, len(table), _ROWS_A_CHUNK):
        size = _format_rows(table[start : start + _ROWS_A_CHUNK], decimals, buffer)
        file.write(buffer[:size].data)


@njit(cache=True, nogil=True)
def _format_rows(table: NDArray[np.int32], decimals: NDArray[np.bool_], buffer: NDArray[np.uint8]) -> int:
    """Print the rows into the buffer; returns the number of bytes."""
    at = 0
    for row in range(table.shape[0]):
        for column in range(table.shape[1]):
            value = np.int64(table[row, column])
            if value < 0:
                buffer[at] = _MINUS
                at += 1
                value = -value
            if decimals[column]:
                at = _put_digits(value // 100, buffer, at)
                buffer[at] = _POINT
                buffer[at + 1] = _ZERO + value // 10 % 10
                buffer[at + 2] = _ZERO + value % 10
                at += 3
            else:
                at = _put_digits(value, buffer, at)
            buffer[at] = _COMMA
            at += 1
        buffer[at - 1] = _NEWLINE
    return at


@njit(cache=True, nogil=True)
def _put_digits(value: np.int64, buffer: NDArray[np.uint8], at: int) -> int:
    """Print a number that is not negative; returns where it ends."""
    digits, limit = 1, 10
    while value >= limit:
        digits += 1
        limit *= 10
    for place in range(at + digits - 1, at - 1, -1):
        buffer[place] = _ZERO + value % 10
        value //= 10
    return at + digits
