"""Smoothed derivatives of sampled motion: local polynomials over a window given in seconds."""

from functools import lru_cache
from math import factorial

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def window_samples(window_s: float, rate: float) -> int:
    """Odd number of samples nearest to a window of ``window_s`` [s] at ``rate`` [Hz]."""
    return 2 * max(0, round((window_s * rate - 1) / 2)) + 1


def local_polynomial(values: FloatArray, rate: float, *, window_s: float, order: int = 2) -> FloatArray:
    """Value and derivatives of the least-squares polynomial around each sample (Savitzky and Golay, 1964).

    values: shape (n,), n >= 1, free of NaN; rate: samples a second [Hz]; window_s: width of the fit [s],
    widened to order + 1 samples where it holds fewer. Within half a window of the ends the outermost full
    window's polynomial is evaluated, so that no sample is lost. Returns shape (order + 1, n): the value and
    its derivatives per s, s^2, ...; derivatives that fewer than order + 1 samples leave open are 0.
    """
    n = len(values)
    half = max(window_samples(window_s, rate) // 2, (order + 1) // 2)
    window = min(2 * half + 1, n)
    degree = min(order, window - 1)
    result = np.zeros((order + 1, n))
    middle = slice((window - 1) // 2, n - window // 2)
    for k, (start, inside, stop) in enumerate(_filters(window, degree, rate)):
        result[k, middle] = np.correlate(values, inside, mode="valid")
        result[k, : middle.start] = start @ values[:window]
        result[k, middle.stop :] = stop @ values[n - window :]
    return result


@lru_cache(maxsize=64)
def _filters(window: int, degree: int, rate: float) -> tuple[tuple[FloatArray, FloatArray, FloatArray], ...]:
    """For each derivative: weights of the window's samples for those before its middle one, for the middle one,
    and for those after it, of shapes (window // 2, window), (window,), (window // 2, window).
    """
    offsets = np.arange(window) - float((window - 1) // 2)
    projection = np.linalg.pinv(np.vander(offsets, degree + 1, increasing=True))
    filters = []
    for k in range(degree + 1):
        powers = np.arange(k, degree + 1)
        scale = np.array([factorial(p) / factorial(p - k) for p in powers]) * rate**k
        weights = (offsets[:, None] ** (powers - k) * scale) @ projection[k:]
        middle = (window - 1) // 2
        filters.append((weights[:middle], weights[middle], weights[middle + 1 :]))
    return tuple(filters)
