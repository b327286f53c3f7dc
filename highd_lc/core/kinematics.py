"""Smoothed derivatives of sampled motion: local polynomials over a window given in seconds."""

from functools import lru_cache
from math import factorial

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
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
    fits = sliding_window_view(np.asarray(values, dtype=np.float64), window) @ _projection(window, degree).T
    centres = np.clip(np.arange(n) - window // 2, 0, n - window)
    offset = np.arange(n) - centres - (window - 1) / 2
    result = np.zeros((order + 1, n))
    for k in range(degree + 1):
        for power in range(k, degree + 1):
            scale = factorial(power) / factorial(power - k)
            result[k] += scale * fits[centres, power] * offset ** (power - k)
        result[k] *= rate**k
    return result


@lru_cache(maxsize=64)
def _projection(window: int, degree: int) -> FloatArray:
    """Coefficients of the polynomial in the sample offset from the window's middle: (degree + 1, window)."""
    offsets = np.arange(window) - (window - 1) / 2
    return np.linalg.pinv(np.vander(offsets, degree + 1, increasing=True))
