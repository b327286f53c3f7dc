"""Closed loop of the MPC on the multi-body car, the open counterpart of the paper's CarSim (equations.md 8).

The plant is parameter set 2 of ``commonroad-vehicle-models``. The MPC's model remains
the kinematic bicycle: what tyres, suspension and servos add is a disturbance to it. It commands [v, delta].
Proportional servos, cut to the car's limits, turn these into acceleration and steering rate.

The car is compiled from the package's own code (Althoff, Wuersching: CommonRoad Vehicle Models, 2020, section 10;
29 states, inputs steering rate and acceleration). The package's functions are plain Python on plain numbers, 35 us
an evaluation. Here their code objects are bound to compiled callees and compiled as they are (2 us): no equation
is written a second time, and the tests compare both to the last bit.
"""

import types
from collections import namedtuple
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray
from vehiclemodels import vehicle_dynamics_mb as package
from vehiclemodels.init_mb import init_mb
from vehiclemodels.parameters_vehicle2 import parameters_vehicle2
from vehiclemodels.utils import tire_model
from vehiclemodels.utils.acceleration_constraints import acceleration_constraints
from vehiclemodels.utils.steering_constraints import steering_constraints
from vehiclemodels.utils.vehicle_dynamics_ks_cog import vehicle_dynamics_ks_cog

from highd_lc.core.kernels import kernel
from highd_lc.tracking.closed_loop import Disturbance, invalid_result, noise_rows, reference_rows, summarise
from highd_lc.tracking.controllers import Controller, MpcController, drive
from highd_lc.vocab.tracking import Reference, TrackingResult, TrackingSettings

FloatArray = NDArray[np.float64]

# Peak factors of the tyre formulas: friction scales them.
_FRICTION = ("p_dx1", "p_dy1")

_SET_2 = parameters_vehicle2()


def _numbers(part: Any) -> dict[str, float]:
    return {name: float(value) for name, value in vars(part).items() if isinstance(value, int | float)}


def _record(name: str, fields: list[str]) -> Any:
    return namedtuple(name, fields)


# The package's parameter objects as named tuples, which compiled code can read.
Steering = _record("Steering", list(_numbers(_SET_2.steering)))
Longitudinal = _record("Longitudinal", list(_numbers(_SET_2.longitudinal)))
Tire = _record("Tire", list(_numbers(_SET_2.tire)))
Car = _record("Car", [*_numbers(_SET_2), "steering", "longitudinal", "tire"])

WHEELBASE = float(_SET_2.a + _SET_2.b)
"""Wheelbase of parameter set 2, a BMW 320i [m]."""
REAR_AXLE = float(_SET_2.b)
"""From the centre of mass back to the rear axle [m]."""


def car(friction: float = 1.0) -> Any:
    """Parameter set 2 with the tyres' peak friction times ``friction`` (1 = the package's dry road)."""
    tire = {k: v * friction if k in _FRICTION else v for k, v in _numbers(_SET_2.tire).items()}
    return Car(
        **_numbers(_SET_2),
        steering=Steering(**_numbers(_SET_2.steering)),
        longitudinal=Longitudinal(**_numbers(_SET_2.longitudinal)),
        tire=Tire(**tire),
    )


def start_state(speed: float, heading: float) -> FloatArray:
    """The 29 states of a car that rolls straight on at speed [m/s], heading [rad], centre of mass at (0, 0)."""
    return np.array(init_mb([0.0, 0.0, 0.0, speed, heading, 0.0, 0.0], _SET_2), dtype=np.float64)


def _bound(function: Any, **callees: Any) -> Any:
    """The package's function, compiled, with some of the names that it looks up bound to other things."""
    names = dict(function.__globals__) | callees
    compiled = njit(nogil=True, error_model="numpy")
    return compiled(types.FunctionType(function.__code__, names, function.__name__))


def _compiled_tire_model() -> types.ModuleType:
    model = types.ModuleType("tire_model")
    sign = njit(nogil=True)(tire_model.sign)
    for name in (
        "formula_longitudinal",
        "formula_lateral",
        "formula_longitudinal_comb",
        "formula_lateral_comb",
    ):
        setattr(model, name, _bound(getattr(tire_model, name), sign=sign))
    return model


_LIMITS = {
    "steering_constraints": njit(nogil=True)(steering_constraints),
    "acceleration_constraints": njit(nogil=True)(acceleration_constraints),
}
rate = _bound(
    package.vehicle_dynamics_mb,
    vehicle_dynamics_ks_cog=_bound(vehicle_dynamics_ks_cog, **_LIMITS),
    tireModel=_compiled_tire_model(),
    **_LIMITS,
)
"""The time derivative of the 29 states: rate(states, (steering rate, acceleration), car)."""


@kernel()
def advance(
    states: FloatArray, held: FloatArray, servo: tuple[float, float], dt: float, substeps: int, p: Any
) -> None:
    """Carry out v [m/s], delta [rad] (held, shape (2,)) for dt [s]: overwrite the 29 states.

    The low-level map: acceleration = servo[0] (v - speed), steering rate = servo[1] (delta - steering), gains in
    1/s, both cut to the car's limits inside the model. Runge-Kutta of order 4 in equal substeps; p: see ``car``.
    """
    h = dt / substeps
    stage, total = states.copy(), states.copy()
    for _ in range(substeps):
        for weight, reach in ((h / 6.0, 0.5 * h), (h / 3.0, 0.5 * h), (h / 3.0, h), (h / 6.0, 0.0)):
            order = (servo[1] * (held[1] - stage[2]), servo[0] * (held[0] - stage[3]))
            slope = rate(stage, order, p)
            for i in range(states.shape[0]):
                total[i] += weight * slope[i]
                stage[i] = states[i] + reach * slope[i]
        for i in range(states.shape[0]):
            states[i] = stage[i] = total[i]


SERVO = (10.0, 25.0)
"""Gains of the low-level map [1/s]: speed, steering."""
SUBSTEPS = 50
"""Integration steps in a control interval of 0.1 s: 2 ms. Against an eighth of it the pose of a tracked plan
differs by under 0.1 mm from 3 m/s up and by 5 mm at 1 m/s, where the wheels' spin is stiffest."""


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
        x, y, heading = self.start
        self._car = car(self.friction)
        self._states = start_state(self.speed, heading)
        self._states[0] = x + REAR_AXLE * np.cos(heading)
        self._states[1] = y + REAR_AXLE * np.sin(heading)

    def pose(self) -> FloatArray:
        """x, y [m], heading [rad] of the rear axle, shape (3,)."""
        x, y, heading = self._states[0], self._states[1], self._states[4]
        return np.array([x - REAR_AXLE * np.cos(heading), y - REAR_AXLE * np.sin(heading), heading])

    def velocity(self) -> FloatArray:
        """Velocity of the rear axle along and across the road [m/s], shape (2,)."""
        forward, heading, yaw_rate, left = self._states[[3, 4, 5, 10]]
        left = left - REAR_AXLE * yaw_rate
        c, s = np.cos(heading), np.sin(heading)
        return np.array([forward * c - left * s, forward * s + left * c])

    def advance(self, held: FloatArray, dt: float) -> None:
        """Carry out v [m/s], delta [rad] for dt [s]; a car that spins out of the model's range stays there."""
        after = self._states.copy()
        advance(after, held, SERVO, dt, self.substeps, self._car)
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
    rows = reference_rows(reference, WHEELBASE, settings.horizon)
    if not np.all(np.isfinite(rows)):
        return invalid_result(reference)
    given = disturbance or Disturbance()
    plant = MultiBodyPlant(rows[0, :3] + np.array(given.offset), rows[0, 3], friction, substeps)
    chosen = controller or MpcController(settings, WHEELBASE, reference.dt)
    noise = noise_rows(given, reference.n_steps)
    log, velocity = drive(plant, chosen, rows=rows, noise=noise, dt=reference.dt)
    return summarise(log, velocity, rows=rows, dt=reference.dt, settings=settings)
