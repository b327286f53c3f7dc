"""Losses of comfort and efficiency (paper, equations 5 to 7 and 12 to 19, conventions: equations.md 4).

Sums run over the samples t_k = k dt, both ends included. Cumulative sums are returned, so that one motion serves
every accounting: the value at index k is the loss charged over 0 .. t_k.
"""

from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Value = TypeVar("Value", float, FloatArray)


@dataclass(frozen=True)
class Charge(Generic[Value]):
    """What a side is charged: its normalised comfort and efficiency, numbers or arrays of one shape."""

    comfort: Value
    efficiency: Value

    @property
    def loss(self) -> Value:
        """0.5 comfort + 0.5 efficiency (equation 7)."""
        return 0.5 * self.comfort + 0.5 * self.efficiency


def speed_difference(v: FloatArray, v_ref: float, *, one_sided: bool = False) -> FloatArray:
    """|v - v_ref| [m/s] of each sample, or max(v_ref - v, 0) if one-sided; any shape."""
    return np.maximum(v_ref - v, 0.0) if one_sided else np.abs(v - v_ref)


def cumulative_efficiency(v: FloatArray, v_ref: float, *, scale: float, one_sided: bool = False) -> FloatArray:
    """sum_0^k |v - v_ref| / N_e along the last axis (equations 6 and 13). v in m/s, shape (..., N + 1)."""
    return np.cumsum(speed_difference(v, v_ref, one_sided=one_sided), axis=-1) / scale


def cumulative_comfort(jerk: FloatArray, *, scale: float) -> FloatArray:
    """sum_0^k |j| / N_c along the last axis (equation 5). jerk [m/s^3], shape (..., N + 1)."""
    return np.cumsum(np.abs(jerk), axis=-1) / scale


def command_jerk(a: FloatArray, dt: float) -> FloatArray:
    """|a_k - a_(k-1)| / dt [m/s^3] along the last axis, 0 at the first sample (equation 12).

    a: commanded accelerations [m/s^2], shape (..., N + 1). The step onto the first sample is not counted: it
    comes from before the motion.
    """
    return np.abs(np.diff(a, axis=-1, prepend=a[..., :1])) / dt


def follower_weights(v: FloatArray, spacing: FloatArray, v_av: float) -> FloatArray:
    """Weights of the followers, shape (p,), sum 1 (equations 16 and 17).

    sigma_i = |v_i - v_AV| / sqrt(spacing_i), omega_i = sigma_i / sum; equal weights if every sigma is 0.
    v: speeds of the followers [m/s]; spacing: front to front to the AV [m], positive; v_av [m/s]; all at t_start.
    """
    sigma = np.abs(v - v_av) / np.sqrt(spacing)
    total = float(np.sum(sigma))
    return sigma / total if total > 0.0 else np.full(len(v), 1.0 / max(len(v), 1))


def joint_objective(loss_av: FloatArray, loss_hv: FloatArray, omega_av: float) -> FloatArray:
    """omega_AV Loss_AV + (1 - omega_AV) Loss_HV (equations 18 and 19)."""
    return omega_av * loss_av + (1.0 - omega_av) * loss_hv
