"""Closed loop of the MPC on the multi-body car, the open counterpart of the paper's CarSim (equations.md 8).

The plant is parameter set 2 of ``commonroad-vehicle-models``. The MPC still believes in the
kinematic bicycle: what tyres, suspension and servos add is a disturbance to it. It orders [v, delta]; a low-level
map makes acceleration and steering rate of that: proportional servos, cut to the car's limits.
"""

from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from highd_lc.tracking.closed_loop import Disturbance, invalid_result, noise_rows, reference_rows, summarise
from highd_lc.tracking.controllers import Controller, MpcController, drive
from highd_lc.vocab.tracking import Reference, TrackingResult, TrackingSettings

FloatArray = NDArray[np.float64]

SERVO = (10.0, 25.0)
"""Gains of the low-level map [1/s]: speed, steering."""
SUBSTEPS = 50
"""Integration steps in a control interval of 0.1 s: 2 ms. Against an eighth of it the pose of a tracked plan
differs by under 0.1 mm from 3 m/s up and by 5 mm at 1 m/s, where the wheels' spin is stiffest."""


def dynamics() -> ModuleType:
    """The module of the compiled car, imported when a car is needed: its import compiles the package's code."""
    from highd_lc.tracking import multibody_dynamics

    return multibody_dynamics


@dataclass
class MultiBodyPlant:
    """The multi-body car as a plant, at a pose of its rear axle and rolling straight on.

    start: x, y [m], heading [rad], shape (3,); speed [m/s]; friction: factor on the tyres' peak friction;
    substeps: integration steps a control interval.
    """

    start: FloatArray
    speed: float
    friction: float = 1.0
    substeps: int = SUBSTEPS
    _states: FloatArray = field(init=False)
    _car: Any = field(init=False)

    def __post_init__(self) -> None:
        model = dynamics()
        x, y, heading = self.start
        self._car = model.car(self.friction)
        self._states = model.start_state(self.speed, heading)
        self._states[0] = x + model.REAR_AXLE * np.cos(heading)
        self._states[1] = y + model.REAR_AXLE * np.sin(heading)

    def pose(self) -> FloatArray:
        """x, y [m], heading [rad] of the rear axle, shape (3,)."""
        x, y, heading = self._states[0], self._states[1], self._states[4]
        back = dynamics().REAR_AXLE
        return np.array([x - back * np.cos(heading), y - back * np.sin(heading), heading])

    def velocity(self) -> FloatArray:
        """Velocity of the rear axle along and across the road [m/s], shape (2,)."""
        forward, heading, yaw_rate, left = self._states[[3, 4, 5, 10]]
        left = left - dynamics().REAR_AXLE * yaw_rate
        c, s = np.cos(heading), np.sin(heading)
        return np.array([forward * c - left * s, forward * s + left * c])

    def advance(self, held: FloatArray, dt: float) -> None:
        """Carry out v [m/s], delta [rad] for dt [s]; a car that spins out of the model's range stays there."""
        after = self._states.copy()
        dynamics().advance(after, held, SERVO, dt, self.substeps, self._car)
        if np.all(np.isfinite(after)):
            self._states = after


def track_multibody(
    reference: Reference,
    *,
    settings: TrackingSettings,
    disturbance: Disturbance | None = None,
    friction: float = 1.0,
    controller: Controller | None = None,
    substeps: int = SUBSTEPS,
) -> TrackingResult:
    """Drive the multi-body car along the reference; the MPC unless another controller is given.

    friction: factor on the tyres' peak friction; substeps: see ``MultiBodyPlant``. The disturbance's wheelbase
    factor has no meaning here: the car is what it is.
    """
    wheelbase = dynamics().WHEELBASE
    rows = reference_rows(reference, wheelbase, settings.horizon)
    if not np.all(np.isfinite(rows)):
        return invalid_result(reference)
    given = disturbance or Disturbance()
    plant = MultiBodyPlant(rows[0, :3] + np.array(given.offset), rows[0, 3], friction, substeps)
    chosen = controller or MpcController(settings, wheelbase, reference.dt)
    noise = noise_rows(given, reference.n_steps)
    log, velocity = drive(plant, chosen, rows=rows, noise=noise, dt=reference.dt)
    return summarise(log, velocity, rows=rows, dt=reference.dt, settings=settings)
