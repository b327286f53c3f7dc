"""The plans of an event as a car drives them under the MPC: limits checked and losses computed again.

The car carries the event's own box along the tracked rear axle, on either plant. The followers react to the
tracked motion.

The tracked motion is known by samples only, so its accelerations and jerks are finite differences. The
acceleration between two samples is the difference of their velocities over dt. The jerk at a sample is the
difference of the two accelerations beside it over dt. At both ends the acceleration is 0 (equations.md 2), half an
interval away. ``planned_motion`` samples a plan in the same way, so that both are differenced alike.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.losses import Charge, LossTerms, charge
from highd_lc.core.quintic import Quintic, sample
from highd_lc.planning.limits import contacts
from highd_lc.planning.planner import Plan, PlanningProblem, clearance_margins, unchanged_contacts
from highd_lc.planning.replay import AvMotion, Replay, replay
from highd_lc.planning.start_planner import key_of, replay_behind
from highd_lc.planning.starts import StartProblem, pose_starts
from highd_lc.scoring import charges
from highd_lc.tracking.closed_loop import Controller, controller, track
from highd_lc.tracking.multibody import track_multibody
from highd_lc.vocab import names
from highd_lc.vocab.policy import ACCOUNTINGS
from highd_lc.vocab.tracking import INVALID_REFERENCE, MULTI_BODY, Reference, TrackingResult

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class SampledMotion:
    """A motion by samples of dt [s]: velocity [m/s], forward and lateral, shape (n + 1, 2)."""

    dt: float
    velocity: FloatArray

    @cached_property
    def speed(self) -> FloatArray:
        """Speed [m/s], shape (n + 1,)."""
        return np.hypot(self.velocity[:, 0], self.velocity[:, 1])

    @cached_property
    def acceleration(self) -> FloatArray:
        """Acceleration between the samples [m/s^2], forward and lateral, shape (n, 2)."""
        return np.diff(self.velocity, axis=0) / self.dt

    @cached_property
    def jerk(self) -> FloatArray:
        """Jerk at the samples [m/s^3], forward and lateral, shape (n + 1, 2)."""
        acceleration = self.acceleration
        jerk = np.empty_like(self.velocity)
        jerk[1:-1] = np.diff(acceleration, axis=0) / self.dt
        jerk[0], jerk[-1] = 2.0 * acceleration[0] / self.dt, -2.0 * acceleration[-1] / self.dt
        return jerk

    @property
    def charged_jerk(self) -> FloatArray:
        """|jx| + |jy| at the samples [m/s^3], shape (n + 1,) (equation 5)."""
        return np.asarray(np.abs(self.jerk).sum(axis=1))


def tracked_motion(result: TrackingResult) -> SampledMotion:
    """The motion that a closed loop drove."""
    return SampledMotion(result.dt, result.velocity)


def planned_motion(reference: Reference) -> SampledMotion:
    """The planned motion, known by its samples as the tracked one is."""
    return SampledMotion(reference.dt, np.column_stack([reference.xdot, reference.ydot]))


def plan_reference(plan: Quintic, dt: float) -> Reference:
    """A plan as the controller's reference, from the start of its manoeuvre on. dt [s]."""
    s = sample(plan, np.arange(round(plan.T / dt) + 1, dtype=np.float64) * dt)
    return Reference(dt, s.x, s.y, s.vx, s.vy, s.ax, s.ay)


def loss_av(motion: SampledMotion, terms: LossTerms) -> Charge[float]:
    """What the AV is charged for a motion over its samples (equations 5 to 7; equations.md 4).

    Args:
        motion: as planned or as driven.
        terms: reference speed and scales.

    Returns:
        Comfort and efficiency, normalised.
    """
    return charge(motion.speed, motion.charged_jerk, terms.av_ref, terms).upto(-1)


def violations(
    motion: SampledMotion,
    *,
    v_min: float,
    v_max: float,
    acceleration: float,
    jerk: float,
    tolerance: float = 0.01,
) -> dict[str, float]:
    """Limits that a motion breaks, each with its worst value, in the order speed to jerk (equations.md 5).

    Args:
        motion: as planned or as driven.
        v_min: lowest speed [m/s].
        v_max: highest speed [m/s].
        acceleration: largest magnitude on either axis [m/s^2].
        jerk: largest magnitude on either axis [m/s^3].
        tolerance: share of a limit by which it may be passed, since plans often lie exactly on a limit.

    Returns:
        The worst value of each broken limit by its name; empty if all are kept.
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


@dataclass(frozen=True)
class DrivenPlan:
    """A plan as a plant drove it: the closed loop, its motion by samples, and everybody around it over 0 .. H.

    planned: what happens under the plan; replay: around the tracked motion, None where nothing was driven.
    """

    plan: Plan
    planned: Replay
    reference: Reference
    result: TrackingResult
    motion: SampledMotion
    replay: Replay | None


@dataclass(frozen=True)
class PlanTracker:
    """Drives the plans of one event."""

    problem: PlanningProblem

    @cached_property
    def starts(self) -> StartProblem:
        """Gaps and waiting of the plans that chose their start."""
        return pose_starts(self.problem)

    @cached_property
    def _controller(self) -> Controller:
        return controller(self.problem.settings.tracking, self.problem.scene.dt)

    def drive(self, plan: Plan, plant: str) -> DrivenPlan | None:
        """The plan on a plant; None where there is no plan.

        The multi-body car steers its own wheelbase, 2.58 m, the bicycle the event's (equations.md 8).
        """
        if plan.replay is None:
            return None
        reference = reference_of(self.problem, plan, plan.replay)
        result = self._result(reference, plant)
        motion = tracked_motion(result)
        around = None
        if result.status != INVALID_REFERENCE:
            around = self.around(plan, tracked_av(plan.replay.av, result, motion))
        return DrivenPlan(plan, plan.replay, reference, result, motion, around)

    def _result(self, reference: Reference, plant: str) -> TrackingResult:
        settings = self.problem.settings.tracking
        if plant == MULTI_BODY:
            return track_multibody(reference, settings=settings)
        wheelbase = self.problem.scene.wheelbase
        return track(reference, wheelbase=wheelbase, settings=settings, shared=self._controller)

    def around(self, plan: Plan, av: AvMotion) -> Replay:
        """Everybody around another motion of the AV for a plan that has one; what the AV drives after it is filled
        into ``av``.
        """
        if plan.replay is not None and plan.replay.entry is not None:
            return replay_behind(self.starts, key_of(self.starts, plan.gap, plan.delay_s), av)
        packed = self.problem.packed
        # The recorded path is that of the box centre.
        return replay(av, packed._replace(rear_to_centre=0.0) if plan.policy == names.HUMAN else packed)

    def clearances(self, plan: Plan, played: Replay) -> dict[str, float]:
        """``clearance_<role>`` [m] over the plan's accounted time, of the roles that count."""
        found = clearance_margins(self.problem, played, plan.accounting)
        return {name: value for name, value in found.items() if np.isfinite(value)}

    def violations(self, driven: DrivenPlan) -> list[str]:
        """Constraints (equations.md 5) that the tracked motion breaks: limits of motion, then contacts."""
        limit = self.problem.limit
        limits = {"v_min": limit.v_min, "v_max": limit.v_max}
        broken = violations(driven.motion, **limits, acceleration=limit.acceleration, jerk=limit.jerk)
        clear = self.clearances(driven.plan, driven.replay) if driven.replay else {}
        return [*broken, *(name for name, value in clear.items() if value < 0.0)]

    def cause(self, plan: Plan, contact: str) -> str:
        """Why the drive of a plan has a contact (``names.through``), of ``names.TRACKING_CAUSES``; "" without one.

        That of a searched plan, which touches nobody, is always the tracking's.
        """
        if not contact or plan.replay is None:
            return ""
        joins = plan.policy != names.NO_LANE_CHANGE
        planned = contacts(plan.replay, self.problem.packed, joins=joins, last=len(plan.replay.av.x) - 1)
        if contact not in [name for _, name in planned]:
            return names.BY_TRACKING
        return names.BY_FOLLOWER_MODEL if contact in self._unchanged else names.BY_PLAN

    @cached_property
    def _unchanged(self) -> frozenset[str]:
        return unchanged_contacts(self.problem)

    def loss_hv(self, plan: Plan, played: Replay) -> float:
        """The followers' loss around a motion over the plan's accounted time."""
        losses = charges.cumulative_losses(played, self.problem.terms, self.problem.scene.dt)
        _, last = ACCOUNTINGS[plan.accounting].charged(played.av.n, len(played.av.x) - 1)
        return losses.of_hv(self.problem.terms, last).loss


def reference_of(problem: PlanningProblem, plan: Plan, planned: Replay) -> Reference:
    """The planned motion over 0 .. T as the controller's reference, a wait before it left out."""
    if plan.quintic is not None:
        return plan_reference(plan.quintic, problem.scene.dt)
    if plan.motion is not None:
        given = plan.motion
        columns = (given.x, given.y, given.vx, given.vy, given.ax, given.ay)
        return Reference(problem.scene.dt, *(np.asarray(column) for column in columns))
    human, av, used = problem.scene.driver, planned.av, slice(0, planned.av.n + 1)
    columns = (av.x, av.y, av.vx, av.vy, human.ax, human.ay)
    return Reference(problem.scene.dt, *(column[used] for column in columns))


def tracked_av(planned: AvMotion, result: TrackingResult, motion: SampledMotion) -> AvMotion:
    """The tracked motion in the place of the planned one, a wait before it kept; unfinished after T.

    Velocities are the forward speed along the car's heading, so that the ellipse turns with the car and not with
    its course. motion: the result's, by samples.
    """
    first = planned.n - len(result.states) + 1
    heading = result.states[:, 2]
    cos, sin = np.cos(heading), np.sin(heading)
    forward = result.velocity[:, 0] * cos + result.velocity[:, 1] * sin
    # The reference of a delayed plan counts x from the end of the wait.
    x = result.states[:, 0] + (planned.x[first] if first else 0.0)
    columns = {
        "x": x,
        "y": result.states[:, 1],
        "vx": forward * cos,
        "vy": forward * sin,
        "ax": np.append(motion.acceleration[:, 0], 0.0),
        "jerk": motion.charged_jerk,
    }
    whole = {name: _replaced(getattr(planned, name), first, column) for name, column in columns.items()}
    # The human's car goes on as recorded from where it was driven to.
    seen = slice(planned.n + 1, planned.recorded + 1)
    for name, column in whole.items():
        shift = column[planned.n] - getattr(planned, name)[planned.n] if name in ("x", "y") else 0.0
        column[seen] = getattr(planned, name)[seen] + shift
    return AvMotion(**whole, n=planned.n, crossing=planned.crossing, recorded=planned.recorded)


def _replaced(planned: FloatArray, first: int, column: FloatArray) -> FloatArray:
    """``planned`` with a column from sample ``first`` on, and zeros after it."""
    out = np.zeros(len(planned))
    out[:first] = planned[:first]
    out[first : first + len(column)] = column
    return out
