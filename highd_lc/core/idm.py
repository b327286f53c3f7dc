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


@njit(inline="always")
def idm_acceleration(v: float, gap: float, v_leader: float, driver: IdmParameters) -> float:
    """Acceleration [m/s^2] of the IDM. v, v_leader in m/s; gap in m, counted as 0.1 m where it is smaller."""
    dynamic = v * driver.T + v * (v - v_leader) / (2.0 * np.sqrt(driver.A * driver.b))
    closeness = (driver.s0 + max(0.0, dynamic)) / max(gap, _SMALLEST_GAP)
    speed = v / driver.v_desire
    wanted: float = driver.A * (1.0 - speed * speed * speed * speed - closeness * closeness)
    return max(wanted, -driver.hardest)
