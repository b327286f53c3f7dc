"""Quintic trajectories of a lane change (paper, equations 1 to 4, corrected: equations.md 2.1 and 10.1).

With u = t / T, z = 6u^5 - 15u^4 + 10u^3 and q = -4u^3 + 7u^4 - 3u^5,

    x = v0 t + (x_final - v0 T) z + T (v_end - v0) q,    y = D z.

Both end accelerations are 0. In the algebra below alpha = (x_final - v0 T) / T^2 and beta = (v_end - v0) / T,
so that ax = alpha z'' + beta q'' with primes by u; this makes every extremum but that of the speed's magnitude
a closed form.

A manoeuvre planned anew while it is under way starts with an acceleration, off the middle of its lane, moving
sideways (equations.md 2.6). With r = u^2 (1 - u)^3 / 2 and s = u (1 - u)^3 (1 + 3u),

    x = v0 t + (x_final - v0 T) z + T (v_end - v0) q + T^2 ax r,   y = y0 + (D - y0) z + T vy s + T^2 ay r.
"""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple, TypeVar

import numpy as np
from numba import njit
from numba.extending import register_jitable
from numpy.typing import NDArray

from highd_lc.core.kernels import kernel

FloatArray = NDArray[np.float64]
Real = TypeVar("Real", float, FloatArray)
"""The shapes below serve numpy arrays as they are, and single numbers inside compiled kernels."""

PEAK_AY = 10.0 / math.sqrt(3.0)
END_JY = 60.0
"""Peaks of |yddot| T^2/D and |ydddot| T^3/D of y = D z."""
SHARE_TOLERANCE = 1e-9
"""A share of the lateral way counts as made from this much below it on."""


class StartState(NamedTuple):
    """How a manoeuvre starts beside its speed: forward acceleration ax [m/s^2]; y [m], vy [m/s], ay [m/s^2]."""

    ax: float
    y: float
    vy: float
    ay: float


AT_REST: Final = StartState(0.0, 0.0, 0.0, 0.0)
"""The start in the middle of a lane, at constant speed."""


@dataclass(frozen=True)
class Quintic:
    """A planned manoeuvre: duration T [s], forward distance x_final [m], end speed v_end [m/s].

    v0: start speed [m/s]; D: y at its end, left positive [m]; start: its state at the start.
    """

    v0: float
    D: float
    T: float
    x_final: float
    v_end: float
    start: StartState = AT_REST


@dataclass(frozen=True)
class Samples:
    """A trajectory at samples t [s]: x, y [m] and their first three time derivatives, each of shape (n,)."""

    t: FloatArray
    x: FloatArray
    y: FloatArray
    vx: FloatArray
    vy: FloatArray
    ax: FloatArray
    ay: FloatArray
    jx: FloatArray
    jy: FloatArray


@register_jitable
def z_shape(u: Real) -> Real:
    """z(u) = 6u^5 - 15u^4 + 10u^3: from 0 to 1 with no speed or acceleration at either end."""
    return u * u * u * (10.0 + u * (6.0 * u - 15.0))


@kernel()
def first_past(share: float, n: int) -> int:
    """First of the samples 0 .. n at which a plan has made that share of its lateral way: z(k / n) >= share.

    Half of the way is the crossing, n // 2 by convention also where n is odd.
    """
    if share == 0.5:
        return n // 2
    k = 0
    while k < n and z_shape(k / n) < share - SHARE_TOLERANCE:
        k += 1
    return k


@register_jitable
def z_rate(u: Real) -> Real:
    """z'(u) = 30 u^2 (1 - u)^2."""
    return 30.0 * u * u * (1.0 - u) * (1.0 - u)


@register_jitable
def z_curvature(u: Real) -> Real:
    """z''(u) = 60 u (2u - 1)(u - 1)."""
    return 60.0 * u * (2.0 * u - 1.0) * (u - 1.0)


@register_jitable
def z_third(u: Real) -> Real:
    """z'''(u) = 60 - 360 u + 360 u^2."""
    return 60.0 + 360.0 * u * (u - 1.0)


@register_jitable
def q_shape(u: Real) -> Real:
    """q(u) = -4u^3 + 7u^4 - 3u^5: returns to 0 with slope 1."""
    return u * u * u * (u * (7.0 - 3.0 * u) - 4.0)


@register_jitable
def q_rate(u: Real) -> Real:
    """q'(u) = -12u^2 + 28u^3 - 15u^4; q'(1) = 1."""
    return u * u * (u * (28.0 - 15.0 * u) - 12.0)


@register_jitable
def q_curvature(u: Real) -> Real:
    """q''(u) = -12 u (5u - 2)(u - 1)."""
    return -12.0 * u * (5.0 * u - 2.0) * (u - 1.0)


@register_jitable
def q_third(u: Real) -> Real:
    """q'''(u) = -24 + 168 u - 180 u^2."""
    return -24.0 + u * (168.0 - 180.0 * u)


@register_jitable
def r_shape(u: Real) -> Real:
    """r(u) = u^2 (1 - u)^3 / 2: what an acceleration at the start leaves of itself; r''(0) = 1."""
    return 0.5 * u * u * (1.0 - u) * (1.0 - u) * (1.0 - u)


@register_jitable
def r_rate(u: Real) -> Real:
    """r'(u) = u - 4.5u^2 + 6u^3 - 2.5u^4."""
    return u * (1.0 - u * (4.5 - u * (6.0 - 2.5 * u)))


@register_jitable
def r_curvature(u: Real) -> Real:
    """r''(u) = 1 - 9u + 18u^2 - 10u^3."""
    return 1.0 - u * (9.0 - u * (18.0 - 10.0 * u))


@register_jitable
def r_third(u: Real) -> Real:
    """r'''(u) = -9 + 36u - 30u^2."""
    return -9.0 + u * (36.0 - 30.0 * u)


@register_jitable
def s_shape(u: Real) -> Real:
    """s(u) = u - 6u^3 + 8u^4 - 3u^5: what a speed at the start leaves of itself; s'(0) = 1."""
    return u * (1.0 - u * u * (6.0 - u * (8.0 - 3.0 * u)))


@register_jitable
def s_rate(u: Real) -> Real:
    """s'(u) = 1 - 18u^2 + 32u^3 - 15u^4."""
    return 1.0 - u * u * (18.0 - u * (32.0 - 15.0 * u))


@register_jitable
def s_curvature(u: Real) -> Real:
    """s''(u) = -36u + 96u^2 - 60u^3."""
    return -u * (36.0 - u * (96.0 - 60.0 * u))


@register_jitable
def s_third(u: Real) -> Real:
    """s'''(u) = -36 + 192u - 180u^2."""
    return -36.0 + u * (192.0 - 180.0 * u)


@register_jitable
def lateral(u: float, T: float, D: float, start: StartState) -> tuple[float, float]:
    """y [m] and ydot [m/s] at u = t / T."""
    way = D - start.y
    if start.vy == 0.0 and start.ay == 0.0:
        return start.y + way * z_shape(u), way * (z_rate(u) / T)
    y = start.y + way * z_shape(u) + T * start.vy * s_shape(u) + T * T * start.ay * r_shape(u)
    return y, way * (z_rate(u) / T) + start.vy * s_rate(u) + T * start.ay * r_rate(u)


@register_jitable
def lateral_jerk(u: float, T: float, D: float, start: StartState) -> float:
    """ydddot [m/s^3] at u = t / T."""
    way = D - start.y
    if start.vy == 0.0 and start.ay == 0.0:
        return way * (z_third(u) / (T * T * T))
    own = start.vy / (T * T) * s_third(u) + start.ay / T * r_third(u)
    return way * (z_third(u) / (T * T * T)) + own


@kernel(error_model="numpy")
def reaches(share: float, n: int, dt: float, D: float, start: StartState) -> int:
    """First of the samples 0 .. n, of dt [s], at which a plan has made that share of the way to y = D; n at last.

    Half of the way is the crossing: the sample nearest to it, the earlier one of two. At rest that is
    ``first_past``.
    """
    if start.y == 0.0 and start.vy == 0.0 and start.ay == 0.0:
        return first_past(share, n)
    half = 0.5 if share == 0.5 else 0.0
    for k in range(n):
        y, _ = lateral((k + half) / n, n * dt, D, start)
        if y / D >= share - SHARE_TOLERANCE:
            return k
    return n


def sample(plan: Quintic, t: FloatArray) -> Samples:
    """The trajectory at times t [s] within 0 .. T, shape (n,)."""
    v0, D, T, x_final, v_end = (float(value) for value in (plan.v0, plan.D, plan.T, plan.x_final, plan.v_end))
    return Samples(t, *_sampled(np.asarray(t, np.float64), v0, D, T, x_final, v_end, plan.start))


@kernel(error_model="numpy")
def _sampled(
    t: FloatArray, v0: float, D: float, T: float, x_final: float, v_end: float, start: StartState
) -> FloatArray:
    """Rows x, y, vx, vy, ax, ay, jx, jy of ``Samples`` at times t [s], shape (8, n)."""
    delta, change, way = x_final - v0 * T, v_end - v0, D - start.y
    alpha, beta, gamma, slope = delta / T**2, change / T, way / T**2, start.vy / T
    rows = np.empty((8, len(t)))
    for k in range(len(t)):
        u = t[k] / T
        rows[0, k] = v0 * t[k] + delta * z_shape(u) + T * change * q_shape(u) + T * T * start.ax * r_shape(u)
        rows[1, k] = start.y + way * z_shape(u) + T * start.vy * s_shape(u) + T * T * start.ay * r_shape(u)
        rows[2, k] = v0 + T * (alpha * z_rate(u) + beta * q_rate(u) + start.ax * r_rate(u))
        rows[3, k] = T * (gamma * z_rate(u) + slope * s_rate(u) + start.ay * r_rate(u))
        rows[4, k] = alpha * z_curvature(u) + beta * q_curvature(u) + start.ax * r_curvature(u)
        rows[5, k] = gamma * z_curvature(u) + slope * s_curvature(u) + start.ay * r_curvature(u)
        rows[6, k] = (alpha * z_third(u) + beta * q_third(u) + start.ax * r_third(u)) / T
        rows[7, k] = (gamma * z_third(u) + slope * s_third(u) + start.ay * r_third(u)) / T
    return rows


@kernel()
def forward_extrema(alpha: float, beta: float, v0: float, T: float) -> tuple[float, float, float, float]:
    """Exact extrema over 0 <= t <= T: lowest and highest xdot [m/s], highest |xddot|, highest |xdddot|.

    alpha, beta in m/s^2 (see the module); v0 in m/s; T in s. The acceleration has the roots u = 0, 1 and one
    more, the jerk two, its slope one.
    """
    v_low = min(v0, v0 + T * beta)
    v_high = max(v0, v0 + T * beta)
    slope = 120.0 * alpha - 60.0 * beta
    if slope != 0.0:
        u = (60.0 * alpha - 24.0 * beta) / slope
        if 0.0 < u < 1.0:
            v = v0 + T * (alpha * z_rate(u) + beta * q_rate(u))
            v_low, v_high = min(v_low, v), max(v_high, v)
    a_high = 0.0
    first, second = _jerk_roots(alpha, beta)
    for u in (first, second):
        if 0.0 < u < 1.0:
            a_high = max(a_high, abs(alpha * z_curvature(u) + beta * q_curvature(u)))
    j_high = max(abs(60.0 * alpha - 24.0 * beta), abs(60.0 * alpha - 36.0 * beta))
    bend = 720.0 * alpha - 360.0 * beta
    if bend != 0.0:
        u = (360.0 * alpha - 168.0 * beta) / bend
        if 0.0 < u < 1.0:
            j_high = max(j_high, abs(alpha * z_third(u) + beta * q_third(u)))
    return v_low, v_high, a_high, j_high / T


@kernel()
def _jerk_roots(alpha: float, beta: float) -> tuple[float, float]:
    """The u at which alpha z''' + beta q''' = 0; -1 where there is none."""
    a = 360.0 * alpha - 180.0 * beta
    b = 168.0 * beta - 360.0 * alpha
    c = 60.0 * alpha - 24.0 * beta
    discriminant = b * b - 4.0 * a * c
    if discriminant < 0.0 or (a == 0.0 and b == 0.0):
        return -1.0, -1.0
    if a == 0.0:
        return -c / b, -1.0
    # The stable pair: no cancellation in either root.
    w = -0.5 * (b + math.copysign(math.sqrt(discriminant), b))
    return w / a, (c / w if w != 0.0 else -1.0)


@kernel()
def speed_extrema(alpha: float, beta: float, v0: float, D: float, T: float) -> tuple[float, float]:
    """Extrema over 0 <= t <= T of the speed hypot(xdot, ydot) [m/s].

    Between the zeros of d(speed^2)/du, a polynomial of degree 5 besides its factor u (u - 1), found by bisection
    between the sign changes on 64 intervals.
    """
    gamma = D / (T * T)
    low = high = v0
    end = abs(v0 + T * beta)
    low, high = min(low, end), max(high, end)
    before = _speed_slope(0.0, alpha, beta, gamma, v0, T)
    for i in range(64):
        left, right = i / 64.0, (i + 1) / 64.0
        after = _speed_slope(right, alpha, beta, gamma, v0, T)
        if (before < 0.0) != (after < 0.0):
            rising = before < 0.0
            for _ in range(40):
                middle = 0.5 * (left + right)
                if (_speed_slope(middle, alpha, beta, gamma, v0, T) < 0.0) == rising:
                    left = middle
                else:
                    right = middle
            vx = v0 + T * (alpha * z_rate(left) + beta * q_rate(left))
            speed = math.hypot(vx, T * gamma * z_rate(left))
            low, high = min(low, speed), max(high, speed)
        before = after
    return low, high


@njit(inline="always")
def _speed_slope(u: float, alpha: float, beta: float, gamma: float, v0: float, T: float) -> float:
    """d(speed^2)/du over 2 T u (u - 1): keeps the sign changes inside, drops the zeros at the ends."""
    vx = v0 + T * (alpha * z_rate(u) + beta * q_rate(u))
    vy = T * gamma * z_rate(u)
    return vx * (60.0 * alpha * (2.0 * u - 1.0) - 12.0 * beta * (5.0 * u - 2.0)) + vy * 60.0 * gamma * (
        2.0 * u - 1.0
    )
