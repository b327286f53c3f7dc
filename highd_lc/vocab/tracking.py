"""Tracking: the reference that a plan gives, the settings of the controller, what a closed loop returns.

Angles in rad, left positive; heading 0 along travel. Positions are those of the rear axle (equations.md 8.1).
"""

from dataclasses import dataclass
from typing import Annotated, Final

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from highd_lc.vocab.errors import ShapeError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Statuses of a closed loop, from best to worst.
TRACKED: Final = "tracked"
SOFTENED: Final = "softened"
QP_FAILED: Final = "qp_failed"
LOST: Final = "lost"
INVALID_REFERENCE: Final = "invalid_reference"

# Plants.
KINEMATIC: Final = "kinematic"
MULTI_BODY: Final = "multi_body"
PLANTS: Final = (KINEMATIC, MULTI_BODY)

# Below this speed [m/s] a path has no curvature that a steering angle could follow.
_STANDSTILL = 1e-6


@dataclass(frozen=True)
class Reference:
    """A planned motion of the rear axle on the samples t_k = k dt, k = 0 .. n.

    dt [s]; x, y [m]; xdot, ydot [m/s]; xddot, yddot [m/s^2], each of shape (n + 1,), n >= 1.
    Raises ShapeError when the shapes differ.
    """

    dt: float
    x: FloatArray
    y: FloatArray
    xdot: FloatArray
    ydot: FloatArray
    xddot: FloatArray
    yddot: FloatArray

    def __post_init__(self) -> None:
        shape = np.shape(self.x)
        for name in ("y", "xdot", "ydot", "xddot", "yddot"):
            if np.shape(getattr(self, name)) != shape:
                raise ShapeError(f"Reference.{name} has shape {np.shape(getattr(self, name))}, x has {shape}")
        if len(shape) != 1 or shape[0] < 2:
            raise ShapeError(f"Reference.x has shape {shape}; one axis with at least two samples is needed")

    @property
    def n_steps(self) -> int:
        """Number of intervals n."""
        return len(self.x) - 1

    @property
    def speed(self) -> FloatArray:
        """v_r = hypot(xdot, ydot) [m/s], shape (n + 1,)."""
        return np.hypot(self.xdot, self.ydot)

    @property
    def heading(self) -> FloatArray:
        """phi_r = atan2(ydot, xdot) without jumps of 2 pi [rad], shape (n + 1,)."""
        angles = np.arctan2(self.ydot, self.xdot)
        # Of a car that hardly turns none jumps, and looking costs a tenth of unwrapping.
        jumps = np.abs(angles[1:] - angles[:-1]).max() > np.pi
        return np.unwrap(angles) if jumps else angles

    @property
    def curvature(self) -> FloatArray:
        """kappa_r = (xdot yddot - ydot xddot) / v_r^3 [1/m], shape (n + 1,); 0 at standstill."""
        speed = self.speed
        moving = speed > _STANDSTILL
        cubed = np.where(moving, speed, 1.0) ** 3
        return np.where(moving, (self.xdot * self.yddot - self.ydot * self.xddot) / cubed, 0.0)

    def steering(self, wheelbase: float) -> FloatArray:
        """delta_r = atan(l kappa_r) [rad], shape (n + 1,), l the wheelbase [m]."""
        return np.arctan(wheelbase * self.curvature)


class TrackingSettings(BaseModel):
    """The model predictive controller and its car (equations.md 8; equations 20 to 24).

    R, Q and rho are not printed in the paper; the defaults come from the sweep and the sensitivity table that are
    recorded in docs/tracking.md.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    horizon: Annotated[
        int, Field(ge=1, le=60, description="N_p: prediction horizon [samples of 0.1 s] (paper: 6)")
    ] = 6
    control_horizon: Annotated[
        int, Field(ge=1, le=60, description="N_c: increments decided [samples], at most N_p (paper: 4)")
    ] = 4
    weight_longitudinal: Annotated[
        float,
        Field(gt=0, le=1e6, description="R: weight of the error along the road [1/m^2] (the unit of Q's speed)"),
    ] = 1.0
    weight_lateral: Annotated[
        float,
        Field(
            gt=0,
            le=1e6,
            description="R: weight of the error across the road [1/m^2] (unit of the lateral weights)",
        ),
    ] = 1.0
    weight_heading: Annotated[
        float, Field(gt=0, le=1e6, description="R: weight of v_r times the heading error [s^2/m^2] (sweep)")
    ] = 0.5
    weight_speed_increment: Annotated[
        float, Field(gt=0, le=1e6, description="Q: weight of the speed error's increment [s^2/m^2] (sweep)")
    ] = 0.3
    weight_steering_increment: Annotated[
        float, Field(gt=0, le=1e9, description="Q: weight of the steering error's increment [1/rad^2] (sweep)")
    ] = 3.0
    slack_penalty: Annotated[
        float,
        Field(
            gt=0, le=1e12, description="rho: weight of the squared slack (form: paper; value: sensitivity table)"
        ),
    ] = 1e4
    speed_min: Annotated[float, Field(ge=0, le=50, description="lowest commanded speed [m/s] (no reversing)")] = (
        0.0
    )
    speed_max: Annotated[
        float, Field(gt=0, le=100, description="highest commanded speed [m/s] (equations.md 8.4)")
    ] = 60.0
    acceleration_max: Annotated[
        float,
        Field(gt=0, le=50, description="largest increment of the speed per second [m/s^2] (equations.md 8.4)"),
    ] = 10.0
    steering_max: Annotated[
        float, Field(gt=0, le=1.2, description="largest steering angle of the wheels [rad] (cars: 30-40 deg)")
    ] = 0.6
    steering_rate_max: Annotated[
        float, Field(gt=0, le=10, description="largest steering rate [rad/s] (commonroad-vehicle-models, set 2)")
    ] = 0.4
    steering_softening: Annotated[
        float,
        Field(gt=0, le=1, description="radians of steering bound that one unit of slack gives; speed: 1 m/s"),
    ] = 0.1
    wheelbase_ratio: Annotated[
        float, Field(gt=0.2, lt=1, description="wheelbase over length where none is given (equations.md 8.1)")
    ] = 0.6
    slack_tolerance: Annotated[
        float, Field(gt=0, le=1, description="slack from which a bound counts as softened (status `softened`)")
    ] = 1e-3
    lost_lateral_m: Annotated[
        float, Field(gt=0, le=50, description="lateral error at which the car has left its lane [m] (half a lane)")
    ] = 1.75
    lost_longitudinal_m: Annotated[
        float,
        Field(gt=0, le=500, description="error along the road at which the car counts as lost [m] (a length)"),
    ] = 5.0

    @model_validator(mode="after")
    def _consistent(self) -> "TrackingSettings":
        if self.control_horizon > self.horizon:
            raise ValueError(f"control_horizon {self.control_horizon} must be <= horizon {self.horizon}")
        if self.speed_min >= self.speed_max:
            raise ValueError(f"speed_min {self.speed_min} must be < speed_max {self.speed_max}")
        return self


@dataclass(frozen=True)
class TrackingResult:
    """A closed loop over one reference at the samples 0 .. n of dt [s].

    status: ``tracked``, ``softened``, ``qp_failed``, ``lost`` or ``invalid_reference``; reason: of one other than
    ``tracked``.
    states: x, y [m], heading [rad] of the rear axle, shape (n + 1, 3); inputs: speed [m/s] and steering angle
    [rad] commanded from each sample on, shape (n + 1, 2), the last at the end of the reference; velocity: of the
    rear axle along and across the road [m/s], shape (n + 1, 2); errors: longitudinal, lateral [m] and heading
    [rad] in the reference's frame, shape (n + 1, 3). Of each sample's QP, shape (n + 1,): slack, in units in which
    1 softens the speed's bounds by 1 m/s; active_bounds, how many bind; flags, positive = solved; residual, the
    largest KKT residual. Slack and residual are NaN where a QP was not solved or there is none; for an invalid
    reference all arrays and figures are NaN, the flags 0.
    """

    status: str
    reason: str
    dt: float
    states: FloatArray
    inputs: FloatArray
    velocity: FloatArray
    errors: FloatArray
    slack: FloatArray
    active_bounds: IntArray
    flags: IntArray
    residual: FloatArray
    qp_failures: int
    rmse_lateral_m: float
    max_lateral_m: float
    rmse_longitudinal_m: float
    rmse_heading_rad: float
    max_slack: float
