"""Extrema of quintics that start under way: an axis as a polynomial in u = t / T (equations.md 2.6).

    p(u) = c0 + c1 u + .. + c5 u^5,   c3 = 10 D - 4 V + A/2,   c4 = -15 D + 7 V - A,   c5 = 6 D - 3 V + A/2

with D = p_end - p - v T - a T^2/2, V = (v_end - v) T - a T^2 and A = -a T^2. The acceleration vanishes at u = 1,
so that its other roots, like those of the jerk, are those of a quadratic: but for the speed's magnitude every
extremum is a closed form.
"""

import math

import numpy as np
from numba import njit

from highd_lc.core.kernels import kernel

Axis = tuple[float, float, float, float, float, float]
"""Coefficients of 1, u, .., u^5 of a motion along an axis [m]."""
_PARTS = 64
_HALVINGS = 40


@kernel()
def axis(p: float, v: float, a: float, p_end: float, v_end: float, T: float) -> Axis:
    """The motion from place p [m], speed v [m/s], acceleration a [m/s^2] to p_end, v_end and none within T [s]."""
    rest, faster, gone = p_end - p - v * T - 0.5 * a * T * T, (v_end - v) * T - a * T * T, -a * T * T
    return (
        p,
        v * T,
        0.5 * a * T * T,
        10.0 * rest - 4.0 * faster + 0.5 * gone,
        -15.0 * rest + 7.0 * faster - gone,
        6.0 * rest - 3.0 * faster + 0.5 * gone,
    )


@kernel()
def rates(c: Axis, u: float, T: float) -> tuple[float, float, float]:
    """Speed [m/s], acceleration [m/s^2] and jerk [m/s^3] at u."""
    v = c[1] + u * (2.0 * c[2] + u * (3.0 * c[3] + u * (4.0 * c[4] + u * 5.0 * c[5])))
    a = 2.0 * c[2] + u * (6.0 * c[3] + u * (12.0 * c[4] + u * 20.0 * c[5]))
    j = 6.0 * c[3] + u * (24.0 * c[4] + u * 60.0 * c[5])
    return v / T, a / (T * T), j / (T * T * T)


@kernel()
def _roots(a: float, b: float, c: float) -> tuple[float, float]:
    """Real roots of a u^2 + b u + c; -1 where there is none."""
    discriminant = b * b - 4.0 * a * c
    if discriminant < 0.0 or (a == 0.0 and b == 0.0):
        return -1.0, -1.0
    if a == 0.0:
        return -c / b, -1.0
    # The stable pair: no cancellation in either root.
    w = -0.5 * (b + math.copysign(math.sqrt(discriminant), b))
    return w / a, (c / w if w != 0.0 else -1.0)


@kernel()
def axis_extrema(c: Axis, T: float) -> tuple[float, float, float, float]:
    """Exact extrema over 0 <= u <= 1: lowest and highest speed [m/s], highest |acceleration|, highest |jerk|."""
    v_low, a_high, j_high = rates(c, 0.0, T)
    v_high, a_high, j_high = v_low, abs(a_high), abs(j_high)
    last = 20.0 * c[5] + 12.0 * c[4]
    of_speed = _roots(20.0 * c[5], last, last + 6.0 * c[3])
    of_acceleration = _roots(60.0 * c[5], 24.0 * c[4], 6.0 * c[3])
    of_jerk = -0.2 * c[4] / c[5] if c[5] != 0.0 else -1.0
    for u in (1.0, of_speed[0], of_speed[1], of_acceleration[0], of_acceleration[1], of_jerk):
        if 0.0 < u <= 1.0:
            v, a, j = rates(c, u, T)
            v_low, v_high = min(v_low, v), max(v_high, v)
            a_high, j_high = max(a_high, abs(a)), max(j_high, abs(j))
    return v_low, v_high, a_high, j_high


@kernel()
def speed_range(x: Axis, y: Axis, T: float) -> tuple[float, float]:
    """Extrema of the speed [m/s], by bisection between the changes of sign of its slope on 64 intervals."""
    low, high = np.inf, 0.0
    before = _slope(x, y, 0.0, T)
    for i in range(_PARTS + 1):
        right = i / _PARTS
        after = _slope(x, y, right, T)
        at = right
        if i and (before < 0.0) != (after < 0.0):
            left = (i - 1) / _PARTS
            for _ in range(_HALVINGS):
                middle = 0.5 * (left + right)
                if (_slope(x, y, middle, T) < 0.0) == (before < 0.0):
                    left = middle
                else:
                    right = middle
            speed = _speed(x, y, left, T)
            low, high = min(low, speed), max(high, speed)
        if at in (0.0, 1.0):
            speed = _speed(x, y, at, T)
            low, high = min(low, speed), max(high, speed)
        before = after
    return low, high


@njit(inline="always")
def _speed(x: Axis, y: Axis, u: float, T: float) -> float:
    return math.hypot(rates(x, u, T)[0], rates(y, u, T)[0])


@njit(inline="always")
def _slope(x: Axis, y: Axis, u: float, T: float) -> float:
    """Half the derivative of the squared speed."""
    vx, ax, _ = rates(x, u, T)
    vy, ay, _ = rates(y, u, T)
    return vx * ax + vy * ay


@kernel(error_model="numpy")
def sharpest_turns(x: Axis, y: Axis, T: float) -> tuple[float, float]:
    """Largest |curvature| [1/m] and |yaw rate| [rad/s], at both ends and 63 moments between."""
    curvature, yaw_rate = 0.0, 0.0
    for i in range(_PARTS + 1):
        vx, ax, _ = rates(x, i / _PARTS, T)
        vy, ay, _ = rates(y, i / _PARTS, T)
        turned, square = abs(vx * ay - vy * ax), vx * vx + vy * vy
        if turned > 0.0:
            yaw_rate = max(yaw_rate, turned / square if square > 0.0 else np.inf)
            curvature = max(curvature, turned / (square * math.sqrt(square)) if square > 0.0 else np.inf)
    return curvature, yaw_rate
