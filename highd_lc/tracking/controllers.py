"""Any controller on any plant: the protocols, the generic closed loop, the MPC as a part of it.

The loop asks a controller for an input at each sample and lets a plant carry it out. It is slower than
``closed_loop.track``, which is the MPC on the bicycle compiled as a whole. It serves the multi-body car, the
baselines and a second QP solver; the compiled loop is tested against it.
"""

import math
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from highd_lc.tracking.closed_loop import Log, new_log
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
from highd_lc.vocab.tracking import TrackingSettings

FloatArray = NDArray[np.float64]

_INPUTS = ("speed", "steering")
_SIDES = ("upper bound", "lower bound", "largest rise", "largest fall")


@dataclass(frozen=True)
class Command:
    """A controller's command for the next interval: v [m/s] and delta [rad], shape (2,).

    For the MPC also its QP's solution (status, residuals, multipliers, solve time), the slack, and the bounds
    that bind, in words.
    """

    input: FloatArray
    solution: QpSolution | None = None
    slack: float = math.nan
    active_bounds: tuple[str, ...] = ()


class Controller(Protocol):
    """Computes an input from the measured pose and the reference; it does not know the plant."""

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
