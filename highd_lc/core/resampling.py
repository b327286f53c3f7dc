"""From native frames to the 0.1 s grid (SPEC section 9)."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@njit(cache=True, nogil=True, error_model="numpy")
def hermite(t: FloatArray, x: FloatArray, v: FloatArray, grid: FloatArray) -> FloatArray:
    """Positions at grid times by cubic Hermite interpolation with the recorded speeds.

    t: ascending sample times [s], x: positions [m], v: speeds [m/s], each of shape (n,), n >= 2; grid: times
    within t [s], shape (m,). Returns positions [m], shape (m,).
    """
    positions = np.empty(len(grid))
    for k in range(len(grid)):
        i = min(max(np.searchsorted(t, grid[k], side="right") - 1, 0), len(t) - 2)
        h = t[i + 1] - t[i]
        u = (grid[k] - t[i]) / h
        w = 1.0 - u
        recorded = x[i] * w * w * (1.0 + 2.0 * u) + x[i + 1] * u * u * (3.0 - 2.0 * u)
        positions[k] = recorded + h * u * w * (v[i] * w - v[i + 1] * u)
    return positions


def resample(
    t: FloatArray, x: FloatArray, v: FloatArray, a: FloatArray, grid: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Position, speed and acceleration at grid times: cubic Hermite for positions, linear for the others.

    Shapes and units as in ``hermite``; a in m/s^2.
    """
    return hermite(t, x, v, grid), np.interp(grid, t, v), np.interp(grid, t, a)
