"""The step of a follower, once for every kernel: command by its model, bounded braking, semi-implicit Euler.

    a = max(model(v, spacing, v_leader), -hardest),   v <- max(0, v + a dt),   x <- x + v dt

Everybody moves on the states of the same instant. A model alone asks for any braking when the spacing vanishes:
the LCM for up to exp(40) m/s^2. ``hardest`` [m/s^2, positive] is what the road gives; infinite = unbounded.
"""

from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.core.idm import IdmParameters, idm_acceleration
from highd_lc.core.lcm import lcm_acceleration

FloatArray = NDArray[np.float64]

UNBOUNDED: Final = float("inf")
"""The hardest braking of followers whose braking nothing bounds."""


def hardest_braking(b_max: float) -> float:
    """The bound of the kernels from the setting ``b_max`` [m/s^2], in which 0 stands for unbounded."""
    return b_max if b_max > 0.0 else UNBOUNDED


@njit(inline="always", fastmath={"contract"})
def bounded(a: float, hardest: float) -> float:
    """A command a [m/s^2] that brakes by ``hardest`` at most."""
    return max(a, -hardest)


@njit(inline="always", fastmath={"contract"})
def advance(x: float, v: float, a: float, dt: float) -> tuple[float, float]:
    """Position [m] and speed [m/s] a step dt [s] later under the command a [m/s^2]; nobody drives backwards."""
    faster = max(v + a * dt, 0.0)
    return x + faster * dt, faster


@njit(inline="always", fastmath={"contract"})
def lcm_command(
    v: float,
    spacing: float,
    v_leader: float,
    v_desire: float,
    A: float,
    b: float,
    B: float,
    tau: float,
    L: float,
    hardest: float,
) -> float:
    """What an LCM driver commands [m/s^2]: ``core.lcm.lcm_acceleration``, bounded."""
    return bounded(lcm_acceleration(v, spacing, v_leader, v_desire, A, b, B, tau, L), hardest)


@njit(inline="always", fastmath={"contract"})
def lcm_step(
    x: float,
    v: float,
    leader_x: float,
    v_leader: float,
    v_desire: float,
    A: float,
    b: float,
    B: float,
    tau: float,
    L: float,
    hardest: float,
    dt: float,
) -> tuple[float, float, float]:
    """The step of an LCM driver: its command [m/s^2], and front [m] and speed [m/s] a step later.

    x, leader_x: front bumpers [m] (an infinite leader_x is a free road); the rest as in ``lcm_command``; dt [s].
    """
    a = lcm_command(v, leader_x - x, v_leader, v_desire, A, b, B, tau, L, hardest)
    later, faster = advance(x, v, a, dt)
    return a, later, faster


@njit(inline="always")
def idm_step(
    x: float, v: float, leader_rear: float, v_leader: float, driver: IdmParameters, hardest: float, dt: float
) -> tuple[float, float, float]:
    """The step of an IDM driver: as ``lcm_step``, behind the rear bumper of its leader [m]."""
    a = bounded(idm_acceleration(v, leader_rear - x, v_leader, driver), hardest)
    later, faster = advance(x, v, a, dt)
    return a, later, faster


@njit(cache=True, nogil=True)
def drive_behind(
    x: float,
    v: float,
    leader_x: FloatArray,
    leader_v: FloatArray,
    parameters: FloatArray,
    hardest: float,
    dt: float,
) -> tuple[FloatArray, FloatArray]:
    """Fronts [m] and speeds [m/s] of one LCM driver at all samples of its leader's, shape (N,), from x and v on.

    leader_x: front bumper [m], infinite = a free road; parameters: LCM, shape (6,).
    """
    v_desire, A, b, B, tau, L = parameters
    front, speed = np.empty(len(leader_x)), np.empty(len(leader_x))
    for k in range(len(leader_x)):
        front[k], speed[k] = x, v
        _, x, v = lcm_step(x, v, leader_x[k], leader_v[k], v_desire, A, b, B, tau, L, hardest, dt)
    return front, speed
