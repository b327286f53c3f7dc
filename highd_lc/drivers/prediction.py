"""How well follower models predict: errors behind the recorded ego, against models in which nothing happens.

Only what both tracks show is scored. Braking, comfort and loss are those of the speed smoothed over 1 s, recorded
and simulated alike, so that a tracker's noise is not held against a driver.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from highd_lc.drivers.responses import TIME_STEP, Responses, Simulated

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

HORIZONS: Final = (1.0, 2.0, 3.0, 5.0, 8.0)
"""Times after t_start at which followers are judged [s]."""
EXTERNALITY_HORIZONS: Final = (5.0, 8.0)
"""Times over which the cost of a lane change to HV_1 is counted [s]."""
SMOOTHING: Final = 1.0
"""Width of the moving mean over speeds before braking and comfort are read [s]."""
SPACINGS: Final = (20.0, 35.0, 60.0)
"""Bounds of the classes of spacing [m]."""
CLOSINGS: Final = (-2.0, 0.0, 2.0, 5.0)
"""Bounds of the classes of closing speed [m/s]."""


@dataclass(frozen=True)
class Scales:
    """Reference speed of the followers [m/s], N_c [m/s^3] and N_e [m/s] of the losses (equations.md 4)."""

    v_ref: float
    comfort: float
    efficiency: float


class Judged(NamedTuple):
    """A model's prediction of R followers at one horizon, each of shape (R,); NaN where that is not in view."""

    error_speed: FloatArray
    error_position: FloatArray
    rmse_speed: FloatArray
    change_simulated: FloatArray
    change_recorded: FloatArray
    peak_decel_simulated: FloatArray
    peak_decel_recorded: FloatArray
    comfort_simulated: FloatArray
    comfort_recorded: FloatArray
    loss_simulated: FloatArray
    loss_recorded: FloatArray
    contact: BoolArray


def in_view(responses: Responses, horizon: float) -> BoolArray:
    """Which responses are recorded up to the horizon [s], shape (R,)."""
    return responses.n > round(horizon / TIME_STEP)


def judge(simulated: Simulated, responses: Responses, horizon: float, scales: Scales) -> Judged:
    """Compare simulated with recorded followers up to a horizon [s]."""
    last = round(horizon / TIME_STEP)
    seen = np.where(in_view(responses, horizon), 0.0, np.nan)
    v, recorded = simulated.v[: last + 1], responses.v[: last + 1]
    error = v - recorded
    drifted = responses.drift * horizon
    gap = responses.x_ahead[: last + 1] - responses.ahead_length - simulated.x[: last + 1]
    own, theirs = _smooth_motion(v, scales), _smooth_motion(recorded, scales)
    return Judged(
        error_speed=error[-1] + seen,
        error_position=(simulated.x - responses.x)[last] + seen,
        rmse_speed=np.sqrt((error**2).mean(axis=0)) + seen,
        change_simulated=v[-1] - v[0] - drifted + seen,
        change_recorded=recorded[-1] - recorded[0] - drifted + seen,
        peak_decel_simulated=own.peak + seen,
        peak_decel_recorded=theirs.peak + seen,
        comfort_simulated=own.comfort + seen,
        comfort_recorded=theirs.comfort + seen,
        loss_simulated=own.loss + seen,
        loss_recorded=theirs.loss + seen,
        contact=np.asarray(((gap < 0.0) & (responses.progress[: last + 1] >= 0.5)).any(axis=0)),
    )


class _Smooth(NamedTuple):
    peak: FloatArray
    comfort: FloatArray
    loss: FloatArray


def _smooth_motion(v: FloatArray, scales: Scales) -> _Smooth:
    """Peak braking [m/s^2], comfort sum and loss of speeds (K, R), smoothed."""
    width = round(SMOOTHING / TIME_STEP) + 1
    padded = np.concatenate([np.zeros((1, v.shape[1])), np.cumsum(v, axis=0)])
    smooth = (padded[width:] - padded[:-width]) / width
    if len(smooth) < 3:  # too short for a jerk
        unknown = np.full(v.shape[1], np.nan)
        return _Smooth(unknown, unknown, unknown)
    a = np.diff(smooth, axis=0) / TIME_STEP
    comfort = np.abs(np.diff(a, axis=0)).sum(axis=0) / TIME_STEP / scales.comfort
    efficiency = np.abs(v - scales.v_ref).sum(axis=0) / scales.efficiency
    peak = np.maximum(-a.min(axis=0), 0.0)
    return _Smooth(peak, comfort, 0.5 * comfort + 0.5 * efficiency)


def loss_change(v: FloatArray, scales: Scales) -> FloatArray:
    """Loss of speeds (K, R) beyond that of keeping the first one, smoothed; shape (R,)."""
    kept = len(v) * np.abs(v[0] - scales.v_ref) / scales.efficiency
    return np.asarray(_smooth_motion(v, scales).loss - 0.5 * kept)


def class_labels(bounds: tuple[float, ...], unit: str) -> tuple[str, ...]:
    """Words of the classes between bounds, the open ends included."""
    inner = [f"{low:g} .. {high:g} {unit}" for low, high in pairwise(bounds)]
    return (f"< {bounds[0]:g} {unit}", *inner, f"> {bounds[-1]:g} {unit}")
