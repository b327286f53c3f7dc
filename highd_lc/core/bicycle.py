"""The kinematic bicycle at the rear axle and its errors linearised at a reference (equations.md 8, [20-22]).

State psi = [x, y, phi], input mu = [v, delta]:
xdot = v cos(phi), ydot = v sin(phi), phidot = v tan(delta) / l. A held input closes a circle of radius
l / tan(delta), so a step is an arc and needs no integrator.
"""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

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
    """The six entries of A and B that are not 0 or 1: A[0, 2], A[1, 2], B[0, 0], B[1, 0], B[2, 0], B[2, 1]."""
    c, s = math.cos(phi_r), math.sin(phi_r)
    cos_delta = math.cos(delta_r)
    turn_by_v = math.tan(delta_r) * dt / wheelbase
    turn_by_delta = v_r * dt / (wheelbase * cos_delta * cos_delta)
    return -v_r * s * dt, v_r * c * dt, c * dt, s * dt, turn_by_v, turn_by_delta


def error_model(
    v_r: float, phi_r: float, delta_r: float, *, dt: float, wheelbase: float
) -> tuple[FloatArray, FloatArray]:
    """A, shape (3, 3), and B, shape (3, 2), of the error psi - psi_r one sample on (equation 22).

    The linearisation at the reference (v_r [m/s], phi_r, delta_r [rad]), explicit Euler over dt [s]:
    A = [[1, 0, -v_r sin(phi_r) dt], [0, 1, v_r cos(phi_r) dt], [0, 0, 1]],
    B = [[cos(phi_r) dt, 0], [sin(phi_r) dt, 0], [tan(delta_r) dt / l, v_r dt / (l cos(delta_r)^2)]].
    """
    a02, a12, b00, b10, b20, b21 = error_model_entries(v_r, phi_r, delta_r, dt, wheelbase)
    A = np.array([[1.0, 0.0, a02], [0.0, 1.0, a12], [0.0, 0.0, 1.0]])
    B = np.array([[b00, 0.0], [b10, 0.0], [b20, b21]])
    return A, B
