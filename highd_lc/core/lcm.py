"""Car-following laws. The Longitudinal Control Model (LCM): paper, equations 10, 11, 14, 15.

a = A (1 - v / v_desire - exp(1 - s / s*)),   s* = max(v^2 / (2b) - v_leader^2 / (2B) + v tau + L, L)

s is the spacing, front bumper to front bumper. Without a leader the exponential term is zero; in the compiled
functions an infinite spacing says so.

The Intelligent Driver Model (IDM) is another opinion on how followers react (Treiber, Hennecke and Helbing 2000):

a = A (1 - (v / v_desire)^4 - (s* / s)^2),   s* = s0 + max(0, v T + v (v - v_leader) / (2 sqrt(A b)))

Its s is the *gap*, bumper to bumper. Without a leader the interaction term is zero; an infinite gap says so.

The exponential is the whole cost of the LCM. ``math.exp`` is a call that stops LLVM from vectorising the loop
around it (numba's wheels carry no vector math library), so the hot kernels use this polynomial instead.
"""

from typing import Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.core.kernels import bits_of, float_of, fused
from highd_lc.vocab.driver import REPLAY_L_BOUNDS

_LOG2_E = 1.4426950408889634
_LN2_HIGH = 6.93147180369123816490e-01
_LN2_LOW = 1.90821492927058770002e-10
# Adding 1.5 * 2**52 leaves the nearest integer in the low bits of the mantissa.
_ROUND = 6755399441055744.0
_C2, _C3, _C4, _C5, _C6, _C7 = 1 / 2, 1 / 6, 1 / 24, 1 / 120, 1 / 720, 1 / 5040
_C8, _C9, _C10, _C11, _C12 = 1 / 40320, 1 / 362880, 1 / 3628800, 1 / 39916800, 1 / 479001600


@njit(inline="always")
def vector_exp(x: float) -> float:
    """exp(x) for -700 <= x <= 700, relative error below 1e-15; outside that range the result is undefined.

    exp(x) = 2**n exp(r), n the integer nearest x / ln 2, |r| <= ln(2)/2, exp(r) by its Taylor series to r**12
    (remainder 2e-16) in Estrin's order.
    """
    shifted = fused(x, _LOG2_E, _ROUND)
    n = shifted - _ROUND
    r = fused(-n, _LN2_LOW, fused(-n, _LN2_HIGH, x))
    r2 = r * r
    r4 = r2 * r2
    low = fused(r2, fused(_C3, r, _C2), 1.0 + r)
    middle = fused(r2, fused(_C7, r, _C6), fused(_C5, r, _C4))
    high = fused(r4, _C12, fused(r2, fused(_C11, r, _C10), fused(_C9, r, _C8)))
    scale: float = float_of((bits_of(shifted) + np.int64(1023)) << np.int64(52))
    value: float = fused(r4, fused(r4, high, middle), low) * scale
    return value


# exp(40) = 2e17 m/s^2 is far outside anything that a simulation survives with positive speed; the cap only
# keeps sums finite when a search tries parameters that let vehicles run through each other.
_LARGEST_EXPONENT = 40.0
# exp(-700) = 1e-304: indistinguishable from a free road, and inside the range of vector_exp.
_SMALLEST_EXPONENT = -700.0


@njit(inline="always")
def _desired_spacing(
    v: float, v_leader: float, half_inverse_b: float, half_inverse_B: float, tau: float, L: float
) -> float:
    wanted: float = fused(v, fused(v, half_inverse_b, tau), -(v_leader * v_leader * half_inverse_B)) + L
    return max(wanted, L)


@njit(inline="always")
def lcm_of_inverses(
    v: float,
    spacing: float,
    v_leader: float,
    inverse_v_desire: float,
    A: float,
    half_inverse_b: float,
    half_inverse_B: float,
    tau: float,
    L: float,
) -> float:
    """``lcm_acceleration`` from 1 / v_desire, 1 / (2 b) and 1 / (2 B): a loop divides by parameters once."""
    wanted = _desired_spacing(v, v_leader, half_inverse_b, half_inverse_B, tau, L)
    exponent = min(max(1.0 - spacing / wanted, _SMALLEST_EXPONENT), _LARGEST_EXPONENT)
    a: float = A * (fused(-v, inverse_v_desire, 1.0) - vector_exp(exponent))
    return a


@njit(inline="always")
def desired_spacing(v: float, v_leader: float, b: float, B: float, tau: float, L: float) -> float:
    """Desired spacing s* of the LCM with its floor L (equation 11; the floor: equations.md 3.2).

    Args:
        v: own speed [m/s].
        v_leader: speed of the leader [m/s].
        b: own deceleration [m/s^2, positive].
        B: expected deceleration of the leader [m/s^2, positive].
        tau: reaction time [s].
        L: spacing at standstill [m].

    Returns:
        max(v^2 / (2 b) - v_leader^2 / (2 B) + v tau + L, L) [m], front to front.
    """
    return _desired_spacing(v, v_leader, 0.5 / b, 0.5 / B, tau, L)


@njit(inline="always")
def lcm_acceleration(
    v: float,
    spacing: float,
    v_leader: float,
    v_desire: float,
    A: float,
    b: float,
    B: float,
    tau: float,
    L: float,
) -> float:
    """Acceleration commanded by the LCM (equation 10 without delay).

    Args:
        v: own speed [m/s].
        spacing: front to front [m]; infinite = no leader.
        v_leader: speed of the leader [m/s].
        v_desire: desired speed [m/s].
        A: maximum acceleration [m/s^2].
        b, B, tau, L: see ``desired_spacing``.

    Returns:
        A (1 - v / v_desire - exp(1 - spacing / s*)) [m/s^2], the exponent capped at 40.
    """
    return lcm_of_inverses(v, spacing, v_leader, 1.0 / v_desire, A, 0.5 / b, 0.5 / B, tau, L)


def moved_behind(L: float, leader_length: float, new_leader_length: float) -> float:
    """L moved from the leader it was fitted behind to the leader of a replay (equations.md 3.5).

    Args:
        L: fitted spacing at standstill [m].
        leader_length: of the leader of the fit [m]; NaN = unknown, as with published parameters.
        new_leader_length: of the leader of the replay [m].

    Returns:
        L moved by the difference of the lengths, within ``REPLAY_L_BOUNDS`` [m]; unchanged if it is unknown.
    """
    if np.isnan(leader_length):
        return L
    return float(np.clip(L - leader_length + new_leader_length, *REPLAY_L_BOUNDS))


def equilibrium_spacing(v: float, parameters: NDArray[np.float64]) -> float:
    """Spacing at which a follower and its leader drive at the same constant speed (equations.md 3.8).

    Args:
        v: speed of both [m/s].
        parameters: LCM, shape (6,), order of ``vocab.driver.PARAMETERS``.

    Returns:
        s* (1 - ln(1 - v / v_desire)) [m], front to front; NaN from v_desire on, where no equilibrium exists.
    """
    v_desire, _, b, B, tau, L = parameters
    if v >= v_desire:
        return float("nan")
    return float(desired_spacing(v, v, b, B, tau, L) * (1.0 - np.log1p(-v / v_desire)))


_SMALLEST_GAP = 0.1


class IdmParameters(NamedTuple):
    """Parameters of the IDM: desired speed [m/s], time gap T [s], gap at standstill s0 [m], acceleration A
    [m/s^2], comfortable deceleration b [m/s^2, positive], hardest braking that is possible [m/s^2, positive].
    """

    v_desire: float
    T: float
    s0: float
    A: float
    b: float
    hardest: float


MOTORWAY: Final = IdmParameters(v_desire=120.0 / 3.6, T=1.0, s0=2.0, A=1.0, b=1.5, hardest=9.0)
"""Typical values for motorways (Treiber and Kesting, Traffic Flow Dynamics, 2013, table 11.2), braking bounded by
the friction of a dry road: the model alone commands unlimited braking as the gap vanishes.
"""


@njit(inline="always")
def idm_command(
    v: float, gap: float, v_leader: float, v_desire: float, A: float, b: float, T: float, s0: float
) -> float:
    """Command of the IDM before bounding [m/s^2]. v, v_leader in m/s; gap in m, counted as 0.1 m where smaller."""
    wanted = s0 + max(0.0, v * T + v * (v - v_leader) / (2.0 * np.sqrt(A * b)))
    closeness = wanted / max(gap, _SMALLEST_GAP)
    speed = v / v_desire
    a: float = A * (1.0 - speed * speed * speed * speed - closeness * closeness)
    return a


@njit(inline="always")
def idm_acceleration(v: float, gap: float, v_leader: float, driver: IdmParameters) -> float:
    """Acceleration [m/s^2] of a driver by the IDM, its hardest braking at most. v, v_leader in m/s; gap in m."""
    wanted: float = idm_command(v, gap, v_leader, driver.v_desire, driver.A, driver.b, driver.T, driver.s0)
    return max(wanted, -driver.hardest)
