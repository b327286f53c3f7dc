"""What a closed loop drove, judged as a plan is: limits checked again and the AV's loss recomputed.

The tracked motion is known by samples only, so its accelerations and jerks are finite differences: the
acceleration between two samples is that of their velocities over dt, the jerk at a sample that of the two
accelerations beside it. At both ends the acceleration is 0 (SPEC section 2), half an interval away.
``planned_motion`` samples a plan in the same way, so that planned against tracked compares motions and not ways
of differencing.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.losses import cumulative_comfort, cumulative_efficiency
from highd_lc.core.quintic import Quintic, sample
from highd_lc.vocab.tracking import Reference, TrackingResult

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class SampledMotion:
    """A motion by samples of dt [s]: speed [m/s], shape (n + 1,); acceleration [m/s^2] between the samples,

    forward and lateral, shape (n, 2); jerk [m/s^3] at the samples, forward and lateral, shape (n + 1, 2).
    """

    dt: float
    speed: FloatArray
    acceleration: FloatArray
    jerk: FloatArray


@dataclass(frozen=True)
class AvLoss:
    """The AV's loss and its normalised terms (equations 5 to 7): loss = 0.5 comfort + 0.5 efficiency."""

    comfort: float
    efficiency: float

    @property
    def loss(self) -> float:
        """0.5 comfort + 0.5 efficiency."""
        return 0.5 * self.comfort + 0.5 * self.efficiency


def motion_of(velocity: FloatArray, dt: float) -> SampledMotion:
    """Accelerations and jerks of velocities [m/s], forward and lateral, shape (n + 1, 2), sampled at dt [s]."""
    acceleration = np.diff(velocity, axis=0) / dt
    jerk = np.empty_like(velocity)
    jerk[1:-1] = np.diff(acceleration, axis=0) / dt
    jerk[0], jerk[-1] = 2.0 * acceleration[0] / dt, -2.0 * acceleration[-1] / dt
    return SampledMotion(dt, np.hypot(velocity[:, 0], velocity[:, 1]), acceleration, jerk)


def tracked_motion(result: TrackingResult) -> SampledMotion:
    """The motion that a closed loop drove."""
    return motion_of(result.velocity, result.dt)


def planned_motion(reference: Reference) -> SampledMotion:
    """The planned motion, known by its samples as the tracked one is."""
    return motion_of(np.column_stack([reference.xdot, reference.ydot]), reference.dt)


def plan_reference(plan: Quintic, dt: float) -> Reference:
    """A plan as the controller's reference, from the start of its manoeuvre on. dt [s]."""
    s = sample(plan, np.arange(round(plan.T / dt) + 1, dtype=np.float64) * dt)
    return Reference(dt, s.x, s.y, s.vx, s.vy, s.ax, s.ay)


def loss_av(
    motion: SampledMotion,
    *,
    v_ref: float,
    comfort_scale: float,
    efficiency_scale: float,
    one_sided: bool = False,
    after: AvLoss | None = None,
) -> AvLoss:
    """The AV's loss of a motion over its samples (equations 5 to 7; SPEC section 4).

    v_ref: reference speed [m/s]; comfort_scale: N_c [m/s^3]; efficiency_scale: N_e [m/s]; one_sided: only slower
    than v_ref counts; after: terms of the drive after T, where the accounting charges them (`equal`).
    """
    comfort = cumulative_comfort(np.abs(motion.jerk).sum(axis=1), scale=comfort_scale)[-1]
    efficiency = cumulative_efficiency(motion.speed, v_ref, scale=efficiency_scale, one_sided=one_sided)[-1]
    rest = after or AvLoss(0.0, 0.0)
    return AvLoss(float(comfort) + rest.comfort, float(efficiency) + rest.efficiency)


def violations(
    motion: SampledMotion,
    *,
    v_min: float,
    v_max: float,
    acceleration: float,
    jerk: float,
    tolerance: float = 0.01,
) -> dict[str, float]:
    """Limits (SPEC section 5) that a motion breaks, each with its worst value, in the order speed to jerk.

    v_min, v_max [m/s]; acceleration [m/s^2] and jerk [m/s^3] of either axis; tolerance: share of a limit that
    counts as on it, since plans often lie exactly on a limit.
    """
    names = ("acceleration_x", "acceleration_y", "jerk_x", "jerk_y")
    worst = [*np.max(np.abs(motion.acceleration), axis=0), *np.max(np.abs(motion.jerk), axis=0)]
    limits = (acceleration, acceleration, jerk, jerk)
    slowest, fastest = float(np.min(motion.speed)), float(np.max(motion.speed))
    found = {}
    if slowest < v_min * (1.0 - tolerance):
        found["speed_min"] = slowest
    if fastest > v_max * (1.0 + tolerance):
        found["speed_max"] = fastest
    for name, value, limit in zip(names, worst, limits, strict=True):
        if value > limit * (1.0 + tolerance):
            found[name] = float(value)
    return found
