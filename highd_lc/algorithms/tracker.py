"""Closed loop of the MPC on the kinematic bicycle, compiled from the measured error to the next state.

``track`` drives one reference, ``track_many`` a batch; both run the same kernel, so that a plan's result does not
depend on its neighbours. Every step measures, solves the QP, applies the first move and lets the nonlinear plant
integrate. An unsolved QP holds the last input and is counted.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.algorithms.closed_loop import (
    Disturbance,
    Log,
    bicycle_velocity,
    invalid_result,
    new_log,
    noise_rows,
    reference_rows,
    summarise,
    tracking_errors,
)
from highd_lc.algorithms.daqp_call import check_daqp
from highd_lc.algorithms.mpc import (
    STEERING_STOP,
    MpcMemory,
    MpcParameters,
    assemble,
    kkt_residuals,
    mpc_parameters,
    new_memory,
    solve,
)
from highd_lc.core.bicycle import bicycle_step
from highd_lc.vocab.errors import ShapeError
from highd_lc.vocab.tracking import Reference, TrackingResult, TrackingSettings

FloatArray = NDArray[np.float64]


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
        input_error[a] = last_input[a] - rows[before, 3 + a]
    assemble(error, input_error, rows, k, wheelbase, p, memory)
    flag = solve(memory)
    if flag > 0:
        for a in range(2):
            last_input[a] = rows[k, 3 + a] + input_error[a] + memory.z[a]
        last_input[1] = min(max(last_input[1], -STEERING_STOP), STEERING_STOP)
    return flag


@njit(cache=True, nogil=True)
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
    model_wheelbase, plant_wheelbase = wheelbases
    held, measured = np.empty(2), np.empty(3)
    held[0], held[1] = rows[0, 3], rows[0, 4]
    for c in range(3):
        log.states[0, c] = rows[0, c] + offset[c]
    last = log.inputs.shape[0] - 1
    for k in range(last + 1):
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
    """Drive the kinematic bicycle along the reference under the MPC (SPEC section 8).

    wheelbase [m] of the car; the reference's dt [s] is the control interval; shared: the controller of these
    settings and dt, for callers with many plans. Never raises for what the reference holds: a plan outside the
    car's ability, or one with numbers that are not finite, ends in a status.
    """
    shared = shared or controller(settings, reference.dt)
    return _track(reference, wheelbase, disturbance or Disturbance(), settings=settings, shared=shared)


def errors_and_inputs(
    reference: Reference, *, wheelbase: float, settings: TrackingSettings, shared: Controller
) -> tuple[FloatArray, FloatArray]:
    """What ``track`` drives, without its figures, for drawing.

    Longitudinal, lateral [m] and heading [rad] errors, shape (n + 1, 3); inputs v [m/s] and delta [rad], shape
    (n + 1, 2). NaN where the reference holds numbers that are not finite.
    """
    rows, log = _drive(reference, wheelbase, Disturbance(), settings=settings, shared=shared)
    if log is None:
        invalid = invalid_result(reference)
        return invalid.errors, invalid.inputs
    return tracking_errors(log.states, rows), log.inputs


def track_many(
    references: Sequence[Reference], *, wheelbases: Sequence[float], settings: TrackingSettings
) -> list[TrackingResult]:
    """``track`` for each reference with its wheelbase [m], in the same order; all have the same dt.

    The plans share one controller's memory, which every step overwrites; the compiled part runs without the
    interpreter's lock.
    """
    if len(references) != len(wheelbases):
        raise ShapeError(f"{len(wheelbases)} wheelbases for {len(references)} references")
    if len({reference.dt for reference in references}) > 1:
        raise ShapeError(f"the references have intervals of {sorted({r.dt for r in references})} s; one is needed")
    if not references:
        return []
    shared = controller(settings, references[0].dt)
    nothing = Disturbance()
    return [
        _track(reference, wheelbase, nothing, settings=settings, shared=shared)
        for reference, wheelbase in zip(references, wheelbases, strict=True)
    ]


def _track(
    reference: Reference,
    wheelbase: float,
    disturbance: Disturbance,
    *,
    settings: TrackingSettings,
    shared: Controller,
) -> TrackingResult:
    rows, log = _drive(reference, wheelbase, disturbance, settings=settings, shared=shared)
    if log is None:
        return invalid_result(reference)
    return summarise(log, bicycle_velocity(log), rows=rows, dt=reference.dt, settings=settings)


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
