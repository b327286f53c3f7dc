"""Any controller on any plant: the protocols, the generic closed loop, the MPC and the bicycle as parts of it.

The loop asks a controller for an input at each sample and lets a plant carry it out. It is slower than
``closed_loop.track``, which is the MPC on the bicycle compiled as a whole; it serves the multi-body car, the
baselines and a second QP solver, and it is the twin that the compiled loop is tested against.
"""

import math
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.kinematics import bicycle_step
from highd_lc.tracking.closed_loop import (
    Disturbance,
    Log,
    invalid_result,
    new_log,
    noise_rows,
    reference_rows,
    summarise,
)
from highd_lc.tracking.mpc import (
    BOUNDS_PER_SAMPLE,
    STEERING_STOP,
    Qp,
    QpSolution,
    assemble,
    mpc_parameters,
    new_memory,
    solve_qp,
)
from highd_lc.vocab.tracking import Reference, TrackingResult, TrackingSettings

FloatArray = NDArray[np.float64]

_INPUTS = ("speed", "steering")
_SIDES = ("upper bound", "lower bound", "largest rise", "largest fall")


@dataclass(frozen=True)
class Command:
    """What a controller orders for the next interval: v [m/s] and delta [rad], shape (2,).

    For the MPC also its QP's solution (status, residuals, multipliers, solve time), the slack, and the bounds
    that bind, in words.
    """

    input: FloatArray
    solution: QpSolution | None = None
    slack: float = math.nan
    active_bounds: tuple[str, ...] = ()


class Controller(Protocol):
    """Orders an input from what is measured; knows the reference, not the plant."""

    def command(self, measured: FloatArray, last_input: FloatArray, *, rows: FloatArray, k: int) -> Command:
        """The input from sample k on; measured: x, y [m], heading [rad]; rows: see ``reference_rows``."""


class Plant(Protocol):
    """A car that carries out inputs: pose and velocity of its rear axle."""

    def pose(self) -> FloatArray:
        """x, y [m], heading [rad], shape (3,)."""

    def velocity(self) -> FloatArray | None:
        """Along and across the road [m/s], shape (2,); None where the axle rolls exactly as commanded."""

    def advance(self, held: FloatArray, dt: float) -> None:
        """Carry out v [m/s], delta [rad] for dt [s]."""


@dataclass
class KinematicPlant:
    """The kinematic bicycle as a plant; start: pose at t = 0, shape (3,); wheelbase [m]."""

    start: FloatArray
    wheelbase: float

    def pose(self) -> FloatArray:
        """x, y [m], heading [rad], shape (3,)."""
        return self.start

    def velocity(self) -> None:
        """None: the rear axle rolls as commanded."""

    def advance(self, held: FloatArray, dt: float) -> None:
        """The exact arc of the held input."""
        x, y, phi = self.start
        self.start = np.array(bicycle_step(x, y, phi, held[0], held[1], dt, self.wheelbase))


@dataclass(frozen=True)
class MpcController:
    """The MPC of the tracker, one Python call a step; wheelbase [m] of its model, dt [s]."""

    settings: TrackingSettings
    wheelbase: float
    dt: float
    solver: Literal["daqp", "osqp"] = "daqp"

    def command(self, measured: FloatArray, last_input: FloatArray, *, rows: FloatArray, k: int) -> Command:
        """Assemble and solve the QP of sample k; an unsolved one holds the last input."""
        p = mpc_parameters(self.settings, self.dt)
        memory = new_memory(p)
        input_error = last_input - rows[max(k - 1, 0), 3:]
        assemble(measured - rows[k, :3], input_error, rows, k, self.wheelbase, p, memory)
        solution = solve_qp(Qp(memory.H, memory.f, memory.A, memory.upper), solver=self.solver)
        if not solution.solved:
            return Command(last_input, solution)
        ordered = rows[k, 3:] + input_error + solution.z[:2]
        ordered[1] = np.clip(ordered[1], -STEERING_STOP, STEERING_STOP)
        return Command(ordered, solution, max(0.0, float(solution.z[-1])), bound_names(solution.active))


def bound_names(rows: tuple[int, ...]) -> tuple[str, ...]:
    """Rows of the MPC's bounds in words: which side of which input, how many samples ahead."""
    return tuple(
        f"{_SIDES[row % 4]} of {_INPUTS[row % BOUNDS_PER_SAMPLE // 4]} at +{row // BOUNDS_PER_SAMPLE}"
        for row in rows
    )


def drive(
    plant: Plant, controller: Controller, *, rows: FloatArray, noise: FloatArray, dt: float
) -> tuple[Log, FloatArray]:
    """The closed loop over the samples of ``noise`` (n + 1, 3): its log and the velocities, shape (n + 1, 2).

    rows: see ``reference_rows``; dt [s]. The car arrives with the reference's first input.
    """
    n = len(noise) - 1
    log, held = new_log(n), rows[0, 3:].copy()
    velocity = np.empty((n + 1, 2))
    for k in range(n + 1):
        log.states[k] = plant.pose()
        order = controller.command(log.states[k] + noise[k], held, rows=rows, k=k)
        held = order.input
        _note(log, order, k)
        own = plant.velocity()
        heading = log.states[k, 2]
        rolled = held[0] * np.array([math.cos(heading), math.sin(heading)])
        velocity[k] = rolled if own is None else own
        if k < n:
            plant.advance(held, dt)
    return log, velocity


def _note(log: Log, order: Command, k: int) -> None:
    log.inputs[k] = order.input
    solution = order.solution
    log.flags[k] = 1 if solution is None or solution.solved else 0
    if solution is not None and solution.solved:
        log.slack[k] = order.slack
        log.active_bounds[k] = len(solution.active)
        log.residual[k] = max(solution.stationarity, solution.feasibility, solution.complementarity)


def track_kinematic(
    reference: Reference,
    *,
    controller: Controller,
    wheelbase: float,
    settings: TrackingSettings,
    disturbance: Disturbance | None = None,
) -> TrackingResult:
    """Drive the kinematic bicycle along the reference under any controller; wheelbase [m] that it believes in.

    With the MPC the same as ``closed_loop.track``, step by step in Python.
    """
    rows = reference_rows(reference, wheelbase, settings.horizon)
    if not np.all(np.isfinite(rows)):
        return invalid_result(reference)
    given = disturbance or Disturbance()
    plant = KinematicPlant(rows[0, :3] + np.array(given.offset), wheelbase * given.wheelbase_factor)
    noise = noise_rows(given, reference.n_steps)
    log, velocity = drive(plant, controller, rows=rows, noise=noise, dt=reference.dt)
    return summarise(log, velocity, rows=rows, dt=reference.dt, settings=settings)
