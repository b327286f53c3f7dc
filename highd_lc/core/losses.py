"""Losses of comfort and efficiency (paper, equations 5 to 7 and 12 to 19, conventions: equations.md 4).

``charge`` charges a whole motion; ``charged`` adds a sample in the kernels that simulate many motions at once.

Sums run over the samples t_k = k dt, both ends included. Cumulative sums are returned, so that one motion serves
every accounting: the value at index k is the loss charged over 0 .. t_k.
"""

from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.core.kernels import fused

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

    def upto(self: "Charge[FloatArray]", last: int) -> "Charge[Any]":
        """Of a charge over 0 .. t_k the one over the samples 0 .. last: a number for each vehicle."""
        return Charge(self.comfort[..., last], self.efficiency[..., last])

    def weighted(self: "Charge[FloatArray]", weights: FloatArray) -> "Charge[float]":
        """The followers' charge from that of each, shape (p,). weights: of the followers (equation 17), (p,)."""
        return Charge(float(weights @ self.comfort), float(weights @ self.efficiency))


def speed_difference(v: FloatArray, v_ref: float | FloatArray, *, one_sided: bool = False) -> FloatArray:
    """Distance of each speed from the reference speed (equations.md 4.2).

    Args:
        v: speeds [m/s], any shape.
        v_ref: reference speed [m/s], a number or of a shape that v's takes.
        one_sided: only speeds below v_ref count.

    Returns:
        |v - v_ref|, or max(v_ref - v, 0) if one-sided [m/s], the shape of v.
    """
    return np.maximum(v_ref - v, 0.0) if one_sided else np.abs(v - v_ref)


def cumulative_efficiency(
    v: FloatArray, v_ref: float | FloatArray, *, scale: float, one_sided: bool = False
) -> FloatArray:
    """Normalised efficiency charged over 0 .. t_k (equations 6 and 13).

    Args:
        v: speeds [m/s], shape (..., N + 1).
        v_ref: reference speed [m/s], a number or of a shape that v's takes.
        scale: N_e [m/s].
        one_sided: only speeds below v_ref count.

    Returns:
        sum_0^k |v - v_ref| / N_e along the last axis, the shape of v.
    """
    return np.cumsum(speed_difference(v, v_ref, one_sided=one_sided), axis=-1) / scale


def cumulative_comfort(jerk: FloatArray, *, scale: float) -> FloatArray:
    """Normalised comfort charged over 0 .. t_k (equations 5 and 12).

    Args:
        jerk: [m/s^3], shape (..., N + 1).
        scale: N_c [m/s^3].

    Returns:
        sum_0^k |j| / N_c along the last axis, the shape of jerk.
    """
    return np.cumsum(np.abs(jerk), axis=-1) / scale


def command_jerk(a: FloatArray, dt: float) -> FloatArray:
    """Jerk of commanded accelerations (equation 12).

    The step onto the first sample is not counted: it comes from before the motion.

    Args:
        a: commanded accelerations [m/s^2], shape (..., N + 1).
        dt: step [s].

    Returns:
        |a_k - a_(k-1)| / dt [m/s^3] along the last axis, 0 at the first sample, the shape of a.
    """
    jerk = np.zeros(a.shape)
    jerk[..., 1:] = np.abs(a[..., 1:] - a[..., :-1]) / dt
    return jerk


def follower_weights(v: FloatArray, spacing: FloatArray, v_av: float) -> FloatArray:
    """Weights of the followers at t_start (equations 16 and 17).

    sigma_i = |v_i - v_AV| / sqrt(spacing_i), omega_i = sigma_i / sum; equal weights if every sigma is 0, or if the
    front of one is not behind the AV's, which leaves its sigma open (equations.md 4.3).

    Args:
        v: speeds of the followers [m/s], shape (p,).
        spacing: front to front to the AV [m], shape (p,).
        v_av: speed of the AV [m/s].

    Returns:
        The weights, sum 1, shape (p,).
    """
    sigma = np.abs(v - v_av) / np.sqrt(np.where(spacing > 0.0, spacing, np.nan))
    total = float(np.sum(sigma))
    return sigma / total if total > 0.0 else np.full(len(v), 1.0 / max(len(v), 1))


def joint_objective(loss_av: Value, loss_hv: Value, omega_av: float) -> Value:
    """What a policy minimises: omega_AV Loss_AV + (1 - omega_AV) Loss_HV (equations 18 and 19).

    Args:
        loss_av: of the AV, any shape.
        loss_hv: of the followers, the same shape.
        omega_av: weight of the AV, 0 to 1.

    Returns:
        The objective, the same shape.
    """
    return omega_av * loss_av + (1.0 - omega_av) * loss_hv


class LossTerms(NamedTuple):
    """What a speed is compared with and how losses are scaled and added.

    av_ref [m/s]; hv_ref (p,) [m/s]; one_sided: charge only speeds below the reference; comfort, efficiency:
    0.5 / N_c and 0.5 / N_e; weights (p,): of the followers' losses.
    """

    av_ref: float
    hv_ref: FloatArray
    one_sided: bool
    comfort: float
    efficiency: float
    weights: FloatArray


def charge(v: FloatArray, jerk: FloatArray, v_ref: float | FloatArray, terms: LossTerms) -> Charge[FloatArray]:
    """What a motion is charged over 0 .. t_k (equations 5, 6, 12 and 13).

    Args:
        v: speeds [m/s], shape (..., N + 1).
        jerk: [m/s^3], the shape of v.
        v_ref: reference speed [m/s], a number or of a shape that v's takes.
        terms: scales, and whether only speeds below v_ref count.

    Returns:
        Normalised comfort and efficiency, of the shape of v.
    """
    efficiency = cumulative_efficiency(v, v_ref, scale=0.5 / terms.efficiency, one_sided=terms.one_sided)
    return Charge(cumulative_comfort(jerk, scale=0.5 / terms.comfort), efficiency)


@njit(inline="always")
def charged(
    loss: float, jerk: float, v: float, v_ref: float, comfort: float, efficiency: float, both_sides: float
) -> float:
    """A loss with a sample more: what ``charge`` and ``Charge.loss`` make of it, in kernels.

    Args:
        loss: before the sample.
        jerk: magnitude [m/s^3], or the step of a command [m/s^2] with ``comfort`` over dt.
        v, v_ref: speed and its reference [m/s].
        comfort, efficiency: factors of ``LossTerms``.
        both_sides: 0 if only speeds below v_ref count, else 1.

    Returns:
        loss + comfort jerk + efficiency |v - v_ref| (equations 5 to 7, 12, 13).
    """
    short = v_ref - v
    more: float = fused(comfort, jerk, fused(efficiency, max(short, -both_sides * short), loss))
    return more
