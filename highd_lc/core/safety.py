"""Distances and decelerations by which safety is judged (equations.md 5.7 and 5.8), once for all."""

import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@register_jitable
def approach(v_rear: float, v: float) -> float:
    """By how much a rear vehicle is faster [m/s]; 0 where it is not."""
    return max(v_rear - v, 0.0)


@register_jitable
def critical_gap(v_rear: float, v: float, braking: float, delay: float, left: float) -> float:
    """Gap [m] below which a lane change ahead of an approaching vehicle is critical (UN R79, ACSF category C).

    v_rear, v: speeds of that vehicle and of the AV [m/s]; braking: what may be asked of it [m/s^2]; delay: t_B;
    left: t_G, time gap that is left then [s]. 0 where it does not approach.
    """
    closing = approach(v_rear, v)
    return closing * delay + closing * closing / (2.0 * braking) + v * left if closing > 0.0 else 0.0


@register_jitable
def braking_asked(gap: float, v_rear: float, v: float, delay: float, left: float) -> float:
    """The braking for which a gap [m] is just the critical one [m/s^2]; infinite where none would do."""
    closing = approach(v_rear, v)
    way = gap - closing * delay - v * left
    if closing <= 0.0:
        return 0.0
    return closing * closing / (2.0 * way) if way > 0.0 else np.inf


def rss_gaps(
    v_rear: FloatArray, v_front: FloatArray, response: float, acceleration: float, weakest: float, hardest: float
) -> FloatArray:
    """Safe longitudinal gaps [m] of responsibility-sensitive safety (Shalev-Shwartz et al. 2017), shape (n,).

    The rear vehicle accelerates for its response time [s], then brakes by ``weakest`` at least; the front one
    brakes by ``hardest`` at most [m/s^2]. v_rear, v_front: speeds, shape (n,) [m/s].
    """
    faster = v_rear + response * acceleration
    way = v_rear * response + 0.5 * acceleration * response**2 + faster**2 / (2.0 * weakest)
    return np.asarray(np.maximum(way - v_front**2 / (2.0 * hardest), 0.0))
