"""The Intelligent Driver Model (IDM): another opinion on how followers react (Treiber, Hennecke and Helbing 2000).

a = A (1 - (v / v_desire)^4 - (s* / s)^2),   s* = s0 + max(0, v T + v (v - v_leader) / (2 sqrt(A b)))

s is the *gap*, bumper to bumper. Without a leader the interaction term is zero; an infinite gap says so.
"""

from typing import Final, NamedTuple

import numpy as np
from numba import njit

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
dry road: the model alone asks for any deceleration when the gap vanishes.
"""


@njit(inline="always", fastmath={"contract"})
def idm_command(
    v: float, gap: float, v_leader: float, v_desire: float, A: float, b: float, T: float, s0: float
) -> float:
    """What the IDM alone asks for [m/s^2]. v, v_leader in m/s; gap in m, counted as 0.1 m where it is smaller."""
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
