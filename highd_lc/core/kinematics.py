"""Motion by samples: smoothing, rounding, resampling; and the kinematic bicycle.

- Smoothed derivatives: local polynomials over a window given in seconds, and their noise.
- Channels as rounded levels and their differences from sample to sample, as bytes, for the pages.
- Resampling from native frames to the 0.1 s grid (equations.md 9).
- The kinematic bicycle at the rear axle and its errors linearised at a reference (equations.md 8, [20-22]).

State psi = [x, y, phi], input mu = [v, delta]: xdot = v cos(phi), ydot = v sin(phi), phidot = v tan(delta) / l. A
held input closes a circle of radius l / tan(delta), so a step is an arc and needs no integrator.
"""

import math
from functools import lru_cache
from math import factorial

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.core.kernels import kernel

FloatArray = NDArray[np.float64]

# Median of the absolute value of a standard normal variable.
_MEDIAN_OF_NORMAL = 0.6745


def window_samples(window_s: float, rate: float) -> int:
    """Odd number of samples that span ``window_s`` [s] at ``rate`` [Hz], to the nearest pair."""
    return 2 * round(window_s * rate / 2) + 1


def local_polynomial(values: FloatArray, rate: float, *, window_s: float, order: int = 2) -> FloatArray:
    """Value and derivatives of the least-squares polynomial around each sample (Savitzky and Golay, 1964).

    values: shape (n,), n >= 1, free of NaN; rate: samples a second [Hz]; window_s: width of the fit [s],
    widened to order + 1 samples where it holds fewer. Within half a window of the ends the outermost full
    window's polynomial is evaluated, so that no sample is lost. Returns shape (order + 1, n): the value and
    its derivatives per s, s^2, ...; derivatives that fewer than order + 1 samples leave open are 0.
    """
    n = len(values)
    window, degree = _fitted(n, rate, window_s, order)
    result = np.zeros((order + 1, n))
    middle = slice((window - 1) // 2, n - window // 2)
    for k, (start, inside, stop) in enumerate(_filters(window, degree, rate)):
        result[k, middle] = np.correlate(values, inside, mode="valid")
        result[k, : middle.start] = start @ values[:window]
        result[k, middle.stop :] = stop @ values[n - window :]
    return result


def noise_gain(n: int, rate: float, *, window_s: float, order: int = 2) -> FloatArray:
    """Standard deviation of what ``local_polynomial`` makes of white noise of standard deviation 1.

    Shape (order + 1, n): constant inside, larger within half a window of the ends.
    """
    window, degree = _fitted(n, rate, window_s, order)
    result = np.zeros((order + 1, n))
    middle = slice((window - 1) // 2, n - window // 2)
    for k, (start, inside, stop) in enumerate(_gains(window, degree, rate)):
        result[k, : middle.start], result[k, middle], result[k, middle.stop :] = start, inside, stop
    return result


def white_noise(values: FloatArray) -> float:
    """Standard deviation of the white noise in samples of a smooth motion, from their second differences.

    values: shape (n,). The median keeps it free of jumps; the curvature of a motion between neighbouring samples
    is far below the noise that matters. 0 with fewer than three samples.
    """
    second = np.abs(values[2:] - 2 * values[1:-1] + values[:-2])
    if len(second) == 0:
        return 0.0
    middle = len(second) // 2
    return float(np.partition(second, middle)[middle]) / (_MEDIAN_OF_NORMAL * 6**0.5)


def narrowest_window(
    noise: float, rate: float, *, speed_noise: float, shortest_s: float, longest_s: float
) -> float:
    """Width [s] of the narrowest local quadratic whose speed has at most ``speed_noise`` [m/s], within limits.

    noise: standard deviation of the positions [m]; rate: samples a second [Hz]. The speed inside has noise times
    rate times sqrt(12 / (N (N^2 - 1))) for N samples, of which there are three at least.
    """
    samples, longest = (max(3, window_samples(width, rate)) for width in (shortest_s, longest_s))
    while samples < longest and noise * rate * (12 / (samples * (samples**2 - 1))) ** 0.5 > speed_noise:
        samples += 2
    return (samples - 1) / rate


def _fitted(n: int, rate: float, window_s: float, order: int) -> tuple[int, int]:
    """Samples of a window and degree of the polynomial that n samples allow."""
    half = max(window_samples(window_s, rate) // 2, (order + 1) // 2)
    window = min(2 * half + 1, n)
    return window, min(order, window - 1)


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


@lru_cache(maxsize=64)
def _gains(window: int, degree: int, rate: float) -> tuple[tuple[FloatArray, float, FloatArray], ...]:
    return tuple(
        (np.linalg.norm(start, axis=1), float(np.linalg.norm(inside)), np.linalg.norm(stop, axis=1))
        for start, inside, stop in _filters(window, degree, rate)
    )


IntArray = NDArray[np.int64]


@kernel()
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


@kernel()
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


@kernel(error_model="numpy")
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


# Below this half angle [rad] the next term of sin(h)/h, h^4/120, is under the rounding of 1.
_SMALL_HALF_ANGLE = 1e-4


@njit(inline="always")
def bicycle_step(
    x: float, y: float, phi: float, v: float, delta: float, dt: float, wheelbase: float
) -> tuple[float, float, float]:
    """State after the input (v, delta) was held for dt: the exact arc.

    x, y [m]; phi, delta [rad]; v [m/s]; dt [s]; wheelbase [m]. With h half the change of heading, the chord has
    length v dt sin(h)/h and direction phi + h.
    """
    half = 0.5 * v * dt * math.tan(delta) / wheelbase
    ratio = math.sin(half) / half if abs(half) > _SMALL_HALF_ANGLE else 1.0 - half * half / 6.0
    chord = v * dt * ratio
    return x + chord * math.cos(phi + half), y + chord * math.sin(phi + half), phi + 2.0 * half


@njit(inline="always")
def error_model_entries(
    v_r: float, phi_r: float, delta_r: float, dt: float, wheelbase: float
) -> tuple[float, float, float, float, float, float]:
    """Of the error psi - psi_r one sample on: the entries of A and B that are not 0 or 1 (equation 22).

    The linearisation at the reference (v_r [m/s], phi_r, delta_r [rad]), explicit Euler over dt [s]:
    A = [[1, 0, -v_r sin(phi_r) dt], [0, 1, v_r cos(phi_r) dt], [0, 0, 1]],
    B = [[cos(phi_r) dt, 0], [sin(phi_r) dt, 0], [tan(delta_r) dt / l, v_r dt / (l cos(delta_r)^2)]].
    Returned: A[0, 2], A[1, 2], B[0, 0], B[1, 0], B[2, 0], B[2, 1].
    """
    c, s = math.cos(phi_r), math.sin(phi_r)
    cos_delta = math.cos(delta_r)
    turn_by_v = math.tan(delta_r) * dt / wheelbase
    turn_by_delta = v_r * dt / (wheelbase * cos_delta * cos_delta)
    return -v_r * s * dt, v_r * c * dt, c * dt, s * dt, turn_by_v, turn_by_delta
