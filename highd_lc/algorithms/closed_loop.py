"""What every closed loop shares: reference rows, disturbances, the log, and the figures drawn from it."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from highd_lc.vocab.errors import ShapeError
from highd_lc.vocab.tracking import (
    INVALID_REFERENCE,
    LOST,
    QP_FAILED,
    SOFTENED,
    TRACKED,
    Reference,
    TrackingResult,
    TrackingSettings,
)

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Disturbance:
    """What the controller does not know: nothing, by default.

    offset: x, y [m], heading [rad] of the car minus the reference at t = 0; wheelbase_factor: the plant's
    wheelbase over the controller's; noise: x, y [m], heading [rad] added to what is measured at each sample,
    shape (n + 1, 3) or more rows; None = none.
    """

    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    wheelbase_factor: float = 1.0
    noise: FloatArray | None = None


class Log(NamedTuple):
    """What a closed loop writes: fields as in ``TrackingResult``."""

    states: FloatArray
    inputs: FloatArray
    slack: FloatArray
    active_bounds: NDArray[np.int64]
    flags: NDArray[np.int64]
    residual: FloatArray


def new_log(n_steps: int) -> Log:
    """An empty log of the samples 0 .. n_steps."""
    return Log(
        states=np.zeros((n_steps + 1, 3)),
        inputs=np.zeros((n_steps + 1, 2)),
        slack=np.full(n_steps + 1, np.nan),
        active_bounds=np.zeros(n_steps + 1, np.int64),
        flags=np.zeros(n_steps + 1, np.int64),
        residual=np.full(n_steps + 1, np.nan),
    )


def reference_rows(reference: Reference, wheelbase: float, horizon: int) -> FloatArray:
    """Rows [x, y, phi, v, delta] at the samples 0 .. n and for ``horizon`` more: straight on at the end speed.

    Shape (n + 1 + horizon, 5); wheelbase [m].
    """
    n = reference.n_steps
    rows = np.zeros((n + 1 + horizon, 5))
    rows[: n + 1, 0], rows[: n + 1, 1] = reference.x, reference.y
    rows[: n + 1, 2], rows[: n + 1, 3] = reference.heading, reference.speed
    rows[: n + 1, 4] = reference.steering(wheelbase)
    _, _, heading, speed, _ = rows[n]
    ahead = np.arange(1, horizon + 1) * reference.dt * speed
    rows[n + 1 :, 0] = rows[n, 0] + ahead * math.cos(heading)
    rows[n + 1 :, 1] = rows[n, 1] + ahead * math.sin(heading)
    rows[n + 1 :, 2], rows[n + 1 :, 3] = heading, speed
    return rows


def bicycle_velocity(log: Log) -> FloatArray:
    """Velocity along and across the road [m/s] of a rear axle that rolls as commanded, shape (n + 1, 2)."""
    speed, heading = log.inputs[:, 0], log.states[:, 2]
    return np.column_stack([speed * np.cos(heading), speed * np.sin(heading)])


def noise_rows(disturbance: Disturbance, n_steps: int) -> FloatArray:
    """The disturbance's measurement noise at the samples 0 .. n, zeros where there is none."""
    if disturbance.noise is None:
        return np.zeros((n_steps + 1, 3))
    noise = np.ascontiguousarray(disturbance.noise, dtype=np.float64)
    if noise.ndim != 2 or noise.shape[0] <= n_steps or noise.shape[1] != 3:
        raise ShapeError(f"Disturbance.noise has shape {noise.shape}; ({n_steps + 1}, 3) is needed")
    return noise[: n_steps + 1]


def tracking_errors(states: FloatArray, rows: FloatArray) -> FloatArray:
    """Longitudinal, lateral [m] and heading [rad] errors in the reference's frame, shape of states (n + 1, 3)."""
    difference = states - rows[: len(states), :3]
    c, s = np.cos(rows[: len(states), 2]), np.sin(rows[: len(states), 2])
    along = c * difference[:, 0] + s * difference[:, 1]
    across = c * difference[:, 1] - s * difference[:, 0]
    return np.column_stack([along, across, difference[:, 2]])


def summarise(
    log: Log, velocity: FloatArray, *, rows: FloatArray, dt: float, settings: TrackingSettings
) -> TrackingResult:
    """The log of a closed loop with its errors against the reference rows, figures and status.

    velocity: of the rear axle [m/s], shape (n + 1, 2); dt [s].
    """
    errors = tracking_errors(log.states, rows)
    rms = np.sqrt(np.mean(errors**2, axis=0))
    failures = int(np.sum(log.flags <= 0))
    along, across = (float(worst) for worst in np.max(np.abs(errors[:, :2]), axis=0))
    slack = _largest(log.slack)
    status, reason = _status(along, across, failures=failures, slack=slack, settings=settings)
    return TrackingResult(
        status=status,
        reason=reason,
        dt=dt,
        **log._asdict(),
        velocity=velocity,
        errors=errors,
        qp_failures=failures,
        rmse_longitudinal_m=float(rms[0]),
        rmse_lateral_m=float(rms[1]),
        rmse_heading_rad=float(rms[2]),
        max_lateral_m=across,
        max_slack=slack,
    )


def _largest(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.max(known)) if known.size else float("nan")


def _status(
    along: float, across: float, *, failures: int, slack: float, settings: TrackingSettings
) -> tuple[str, str]:
    if across > settings.lost_lateral_m:
        return LOST, f"lateral error {across:.2f} m exceeds {settings.lost_lateral_m} m"
    if along > settings.lost_longitudinal_m:
        return LOST, f"longitudinal error {along:.2f} m exceeds {settings.lost_longitudinal_m} m"
    if failures:
        return QP_FAILED, f"{failures} unsolved QPs, the last input held"
    if slack > settings.slack_tolerance:
        return SOFTENED, f"input bounds softened by up to {slack:.3g}"
    return TRACKED, ""


def invalid_result(reference: Reference) -> TrackingResult:
    """The result for a reference that holds numbers which are not finite: nothing was driven."""
    n, nan = reference.n_steps, float("nan")
    return TrackingResult(
        status=INVALID_REFERENCE,
        reason="the reference holds numbers that are not finite",
        dt=reference.dt,
        states=np.full((n + 1, 3), nan),
        inputs=np.full((n + 1, 2), nan),
        velocity=np.full((n + 1, 2), nan),
        errors=np.full((n + 1, 3), nan),
        slack=np.full(n + 1, nan),
        active_bounds=np.zeros(n + 1, np.int64),
        flags=np.zeros(n + 1, np.int64),
        residual=np.full(n + 1, nan),
        qp_failures=0,
        rmse_longitudinal_m=nan,
        rmse_lateral_m=nan,
        rmse_heading_rad=nan,
        max_lateral_m=nan,
        max_slack=nan,
    )
