"""The Longitudinal Control Model (LCM): acceleration, equilibrium and jerk (paper, equations 10, 11, 14, 15).

a = A (1 - v / v_desire - exp(1 - s / s*)),   s* = max(v^2 / (2b) - v_leader^2 / (2B) + v tau + L, L)

s is the spacing, front bumper to front bumper. Without a leader the exponential term is zero; in the compiled
functions an infinite spacing says so.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.core.exponential import vector_exp
from highd_lc.vocab.lcm_parameters import REPLAY_L_BOUNDS

# exp(40) = 2e17 m/s^2 is far outside anything that a simulation survives with positive speed; the cap only
# keeps sums finite when a search tries parameters that let vehicles run through each other.
_LARGEST_EXPONENT = 40.0
# exp(-700) = 1e-304: indistinguishable from a free road, and inside the range of vector_exp.
_SMALLEST_EXPONENT = -700.0


@njit(inline="always", fastmath={"contract"})
def desired_spacing(v: float, v_leader: float, b: float, B: float, tau: float, L: float) -> float:
    """Desired spacing s* [m] of the LCM with its floor L (equation 11; the floor: SPEC section 3).

    v, v_leader in m/s; b, B in m/s^2; tau in s; L in m.
    """
    wanted = v * v / (2.0 * b) - v_leader * v_leader / (2.0 * B) + v * tau + L
    return max(wanted, L)


@njit(inline="always", fastmath={"contract"})
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
    """Acceleration [m/s^2] commanded by the LCM (equation 10 without delay).

    v, v_leader, v_desire in m/s; spacing (front to front; infinite = no leader) and L in m; A, b, B in m/s^2;
    tau in s. The exponent is capped at 40.
    """
    ratio = 1.0 - spacing / desired_spacing(v, v_leader, b, B, tau, L)
    exponent = min(max(ratio, _SMALLEST_EXPONENT), _LARGEST_EXPONENT)
    return A * (1.0 - v / v_desire - vector_exp(exponent))


def moved_behind(L: float, leader_length: float, new_leader_length: float) -> float:
    """L moved from the leader it was fitted behind to the leader of a replay [m] (SPEC section 3).

    NaN for the length of a leader that nobody knows, as with published parameters, leaves L as it is.
    """
    if np.isnan(leader_length):
        return L
    return float(np.clip(L - leader_length + new_leader_length, *REPLAY_L_BOUNDS))


def equilibrium_spacing(v: float, parameters: NDArray[np.float64]) -> float:
    """Spacing [m] at which a follower and its leader both drive at v [m/s]: s* (1 - ln(1 - v / v_desire)).

    parameters: shape (6,), order of ``vocab.lcm_parameters.PARAMETERS``. NaN from v_desire on: no equilibrium
    exists there.
    """
    v_desire, _, b, B, tau, L = parameters
    if v >= v_desire:
        return float("nan")
    return float(desired_spacing(v, v, b, B, tau, L) * (1.0 - np.log1p(-v / v_desire)))


def lcm_jerk(
    v: float,
    a: float,
    spacing: float,
    v_leader: float,
    a_leader: float,
    parameters: NDArray[np.float64],
) -> float:
    """Closed-form jerk [m/s^3] of the LCM in continuous time (equations 14 and 15, corrected).

    j = A (-a / v_desire + (sdot / s* - s sdot* / s*^2) exp(1 - s / s*)),
    sdot* = v a / b - v_leader a_leader / B + a tau, and 0 on the floor. Units: m/s, m/s^2, m;
    parameters: shape (6,).
    """
    v_desire, A, b, B, tau, L = parameters
    wanted = v * v / (2 * b) - v_leader * v_leader / (2 * B) + v * tau + L
    s_star = max(wanted, L)
    s_star_rate = v * a / b - v_leader * a_leader / B + a * tau if wanted > L else 0.0
    spacing_rate = v_leader - v
    closeness = np.exp(1.0 - spacing / s_star)
    return float(A * (-a / v_desire + (spacing_rate / s_star - spacing * s_star_rate / s_star**2) * closeness))
