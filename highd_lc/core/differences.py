"""Channels as rounded levels and their differences from sample to sample, as bytes: what a page carries."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@njit(cache=True, nogil=True)
def known_spans(values: FloatArray) -> tuple[IntArray, FloatArray]:
    """Where the channels are known, and how fast they move there.

    values: shape (m, n), NaN only at the ends of a channel (elsewhere it counts as 0). Returns the first known
    sample and the number from there to the last, shape (m, 2), both 0 where there is none; and the largest
    difference between two neighbours among them, shape (m,).
    """
    m, n = values.shape
    spans, fastest = np.zeros((m, 2), np.int64), np.zeros(m)
    for row in range(m):
        first, last = 0, n - 1
        while first < n and not np.isfinite(values[row, first]):
            first += 1
        while last > first and not np.isfinite(values[row, last]):
            last -= 1
        if first == n:
            continue
        spans[row, 0], spans[row, 1] = first, last + 1 - first
        for k in range(first + 1, last + 1):
            fastest[row] = max(fastest[row], abs(_known(values[row, k]) - _known(values[row, k - 1])))
    return spans, fastest


@njit(cache=True, nogil=True)
def level_differences(values: FloatArray, spans: IntArray, steps: FloatArray) -> tuple[IntArray, NDArray[np.int8]]:
    """The first level of each channel, shape (m,), and the differences of all, one channel after the other.

    values, spans: see ``known_spans``; steps: of the levels, shape (m,), so large that every difference fits a
    byte. The first difference of a channel is 0; their number is that of the known samples.
    """
    bases, differences = np.zeros(len(steps), np.int64), np.zeros(spans[:, 1].sum(), np.int8)
    at = 0
    for row in range(len(steps)):
        first, count = spans[row]
        if count == 0:
            continue
        before = np.rint(_known(values[row, first]) / steps[row])
        bases[row] = np.int64(before)
        for k in range(first + 1, first + count):
            level = np.rint(_known(values[row, k]) / steps[row])
            differences[at + k - first] = np.int8(level - before)
            before = level
        at += count
    return bases, differences


@njit(inline="always")
def _known(value: float) -> float:
    return value if np.isfinite(value) else 0.0
