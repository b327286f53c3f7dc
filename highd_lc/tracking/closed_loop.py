"""Closed loop of the MPC on the kinematic bicycle, compiled from the measured error to the next state.

``track`` drives one reference. Every step measures, solves the QP, applies the first move and lets the nonlinear
plant integrate. An unsolved QP holds the last input and is counted. Reference rows, disturbances, the log and the
figures made of it serve the step-by-step loop of ``controllers`` too.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.core.kernels import kernel
from highd_lc.core.kinematics import bicycle_step
from highd_lc.tracking.daqp_call import check_daqp
from highd_lc.tracking.mpc import (
    HEADING,
    SPEED,
    STEERING,
    STEERING_STOP,
    MpcMemory,
    MpcParameters,
    assemble,
    kkt_residuals,
    mpc_parameters,
    new_memory,
    solve,
)
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
    rows[: n + 1, HEADING], rows[: n + 1, SPEED] = reference.heading, reference.speed
    rows[: n + 1, STEERING] = reference.steering(wheelbase)
    _, _, heading, speed, _ = rows[n]
    ahead = np.arange(1, horizon + 1) * reference.dt * speed
    rows[n + 1 :, 0] = rows[n, 0] + ahead * math.cos(heading)
    rows[n + 1 :, 1] = rows[n, 1] + ahead * math.sin(heading)
    rows[n + 1 :, HEADING], rows[n + 1 :, SPEED] = heading, speed
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
    c, s = np.cos(rows[: len(states), HEADING]), np.sin(rows[: len(states), HEADING])
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
    rmse_along, rmse_across, rmse_heading = np.sqrt(np.mean(errors**2, axis=0)).tolist()
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
        rmse_longitudinal_m=rmse_along,
        rmse_lateral_m=rmse_across,
        rmse_heading_rad=rmse_heading,
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


@njit(inline="always")
def control(
    measured: FloatArray,
    last_input: FloatArray,
    rows: FloatArray,
    k: int,
    wheelbase: float,
    p: MpcParameters,
    memory: MpcMemory,
) -> int:
    """One control step at sample k: overwrite last_input with the next one; the solver's flag.

    measured, shape (3,): x, y [m], heading [rad]; last_input, shape (2,): v [m/s], delta [rad] held until now;
    rows: see ``reference_rows``. An unsolved QP leaves last_input as it is.
    """
    error = np.empty(3)
    for c in range(3):
        error[c] = measured[c] - rows[k, c]
    before = max(k - 1, 0)
    input_error = np.empty(2)
    for a in range(2):
        input_error[a] = last_input[a] - rows[before, SPEED + a]
    assemble(error, input_error, rows, k, wheelbase, p, memory)
    flag = solve(memory)
    if flag > 0:
        for a in range(2):
            last_input[a] = rows[k, SPEED + a] + input_error[a] + memory.z[a]
        last_input[1] = min(max(last_input[1], -STEERING_STOP), STEERING_STOP)
    return flag


@kernel()
def drive_mpc(
    rows: FloatArray,
    wheelbases: tuple[float, float],
    offset: FloatArray,
    noise: FloatArray,
    p: MpcParameters,
    memory: MpcMemory,
    log: Log,
) -> None:
    """The closed loop over the log's samples; wheelbases: of the controller and of the plant [m].

    offset, shape (3,), and noise, shape (n + 1, 3): see ``Disturbance``. The car arrives with the reference's
    first input.
    """
    held = np.empty(2)
    held[0], held[1] = rows[0, SPEED], rows[0, STEERING]
    for c in range(3):
        log.states[0, c] = rows[0, c] + offset[c]
    span = (np.int64(0), log.inputs.shape[0])  # a literal 0 would be another kind, with a machine code of its own
    drive_span(span, held, rows, wheelbases, noise, p, memory, log)  # type: ignore[arg-type]


@kernel()
def drive_span(
    span: tuple[int, int],
    held: FloatArray,
    rows: FloatArray,
    wheelbases: tuple[float, float],
    noise: FloatArray,
    p: MpcParameters,
    memory: MpcMemory,
    log: Log,
) -> None:
    """The closed loop over the samples first .. stop - 1, from the log's state at the first one on.

    held, shape (2,): speed [m/s] and steering [rad] held until then; at the end those of the last sample. The
    rest: see ``drive_mpc``. Rows beyond the span may be written anew before it goes on.
    """
    model_wheelbase, plant_wheelbase = wheelbases
    measured, last = np.empty(3), log.inputs.shape[0] - 1
    for k in range(span[0], span[1]):
        for c in range(3):
            measured[c] = log.states[k, c] + noise[k, c]
        flag = control(measured, held, rows, k, model_wheelbase, p, memory)
        log.flags[k] = flag
        if flag > 0:
            log.slack[k] = memory.z[-1] if memory.z[-1] > 0.0 else 0.0
            for r in range(memory.lam.shape[0]):
                log.active_bounds[k] += memory.lam[r] > 0.0
            stationarity, feasibility, complementarity = kkt_residuals(
                memory.H, memory.f, memory.A, memory.upper, memory.z, memory.lam
            )
            log.residual[k] = max(stationarity, max(feasibility, complementarity))
        log.inputs[k, 0], log.inputs[k, 1] = held[0], held[1]
        if k < last:
            x, y, phi = log.states[k, 0], log.states[k, 1], log.states[k, 2]
            x, y, phi = bicycle_step(x, y, phi, held[0], held[1], p.dt, plant_wheelbase)
            log.states[k + 1, 0], log.states[k + 1, 1], log.states[k + 1, 2] = x, y, phi


class Controller(NamedTuple):
    """What plans of one control interval share: the MPC's parameters, and memory that every step overwrites."""

    parameters: MpcParameters
    memory: MpcMemory


def controller(settings: TrackingSettings, dt: float) -> Controller:
    """The MPC of the settings for a control interval dt [s]."""
    p = mpc_parameters(settings, dt)
    return Controller(p, new_memory(p))


def track(
    reference: Reference,
    *,
    wheelbase: float,
    settings: TrackingSettings,
    disturbance: Disturbance | None = None,
    shared: Controller | None = None,
) -> TrackingResult:
    """Drive the kinematic bicycle along the reference under the MPC (equations.md 8).

    Args:
        reference: the planned motion; its dt is the control interval.
        wheelbase: of the car [m].
        settings: of the controller.
        disturbance: what the controller does not know; None = nothing.
        shared: a controller of these settings and dt, for callers with many plans; None = a new one.

    Returns:
        The closed loop with its errors and its status. A plan outside the car's ability, or one with numbers that
        are not finite, ends in a status and raises nothing.
    """
    shared = shared or controller(settings, reference.dt)
    rows, log = _drive(reference, wheelbase, disturbance or Disturbance(), settings=settings, shared=shared)
    if log is None:
        return invalid_result(reference)
    return summarise(log, bicycle_velocity(log), rows=rows, dt=reference.dt, settings=settings)


def errors_and_inputs(
    reference: Reference, *, wheelbase: float, settings: TrackingSettings, shared: Controller
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """What ``track`` drives, without its figures, for drawing.

    Longitudinal, lateral [m] and heading [rad] errors, shape (n + 1, 3); inputs v [m/s] and delta [rad], shape
    (n + 1, 2); x, y [m] and heading [rad] of the rear axle, shape (n + 1, 3). NaN where the reference has numbers
    that are not finite.
    """
    rows, log = _drive(reference, wheelbase, Disturbance(), settings=settings, shared=shared)
    if log is None:
        invalid = invalid_result(reference)
        return invalid.errors, invalid.inputs, invalid.states
    return tracking_errors(log.states, rows), log.inputs, log.states


def _drive(
    reference: Reference,
    wheelbase: float,
    disturbance: Disturbance,
    *,
    settings: TrackingSettings,
    shared: Controller,
) -> tuple[FloatArray, Log | None]:
    """The reference's rows and the log of the loop that was closed around them; None if they are not finite."""
    check_daqp()
    rows = reference_rows(reference, wheelbase, settings.horizon)
    if not np.all(np.isfinite(rows)):
        return rows, None
    log = new_log(reference.n_steps)
    noise = noise_rows(disturbance, reference.n_steps)
    wheelbases = (wheelbase, wheelbase * disturbance.wheelbase_factor)
    drive_mpc(rows, wheelbases, np.array(disturbance.offset), noise, shared.parameters, shared.memory, log)
    return rows, log
