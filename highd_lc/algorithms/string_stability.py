"""String stability of the LCM: how a speed oscillation grows from leader to follower, linearised at equilibrium.

With a = f(s, v, v_l) at equilibrium the transfer from leader's to follower's speed is
Gamma(i w) = (f_s + i w f_l) / (f_s - w^2 - i w f_v). No frequency grows if f_v^2 - f_l^2 - 2 f_s >= 0.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.lcm import desired_spacing, equilibrium_spacing

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Response:
    """Linear response of a driver at an equilibrium.

    f_s [1/s^2], f_v, f_l [1/s]: derivatives of the acceleration by spacing, own speed and leader's speed. gain:
    largest |Gamma|, 1 at least (frequency 0); frequency [Hz] at which it is reached.
    """

    speed: float
    spacing: float
    f_s: float
    f_v: float
    f_l: float
    gain: float
    frequency: float

    @property
    def stable(self) -> bool:
        """Whether no frequency grows."""
        return self.gain <= 1.0


def response(v: float, parameters: FloatArray) -> Response | None:
    """Response of a driver who follows at v [m/s] in equilibrium; None from v_desire on. parameters: (6,)."""
    spacing = equilibrium_spacing(v, parameters)
    if not math.isfinite(spacing):
        return None
    v_desire, A, b, B, tau, L = (float(value) for value in parameters)
    s_star = float(desired_spacing(v, v, b, B, tau, L))
    closeness = A * math.exp(1.0 - spacing / s_star)
    floor = s_star <= L
    by_s_star = -closeness * spacing / s_star**2
    f_s = closeness / s_star
    f_v = -A / v_desire + (0.0 if floor else by_s_star * (v / b + tau))
    f_l = 0.0 if floor else -by_s_star * v / B
    gain, omega = _largest_gain(f_s, f_v, f_l)
    return Response(v, spacing, f_s, f_v, f_l, gain, omega / (2.0 * math.pi))


def _largest_gain(f_s: float, f_v: float, f_l: float) -> tuple[float, float]:
    """Largest |Gamma| and its angular frequency [rad/s].

    With u = w^2, |Gamma|^2 = (f_s^2 + f_l^2 u) / (u^2 + (f_v^2 - 2 f_s) u + f_s^2): one stationary point u > 0 if
    f_l^2 > f_v^2 - 2 f_s, else it falls from 1.
    """
    a, b, c = f_s**2, f_l**2, f_v**2 - 2.0 * f_s
    if b <= c:
        return 1.0, 0.0
    u = a * (b - c) / (a + math.sqrt(a * a + a * b * (b - c)))
    return math.sqrt((a + b * u) / (u * u + c * u + a)), math.sqrt(u)
