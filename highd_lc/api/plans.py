"""Plans of policies, their losses, and how a car drives them."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from highd_lc.api.scenes import Scene
from highd_lc.planning import planner
from highd_lc.planning.other_planners import Planner, ask, plans_of
from highd_lc.stages.event_report import play_of
from highd_lc.stages.scenes import surrounding
from highd_lc.stages.tracking_tables import tracking_row
from highd_lc.stages.validate import loss_row
from highd_lc.stages.validate_samples import plan_row
from highd_lc.vocab import names
from highd_lc.vocab.errors import UsageError
from highd_lc.vocab.tracking import KINEMATIC, PLANTS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NOT_RECORDED = "not_recorded"
"""Status of the policy ``human`` in a scene that nobody recorded."""
_OF_PLAN = ("status", "T", "x_final", "v_end", "delay_s", "gap", "min_clearance_m")
_OF_LOSS = (
    "loss_av",
    "loss_hv",
    "loss_total",
    "loss_hv_increment",
    "min_gap_m",
    "min_ttc_s",
    "max_drac",
    "contact",
)

_LOSSES = {
    "av": "loss_av",
    "followers": "loss_hv",
    "total": "loss_total",
    "av_comfort": "av_comfort",
    "av_efficiency": "av_efficiency",
    "followers_comfort": "hv_comfort",
    "followers_efficiency": "hv_efficiency",
    "increment": "loss_hv_increment",
}
"""Columns of ``losses`` by the fields of ``Loss``."""


@dataclass(frozen=True)
class Loss:
    """What a plan costs, over the time that its accounting charges; NaN without a plan or after a contact.

    loss = 0.5 comfort + 0.5 efficiency, both without a unit (equations 5 to 7; equations.md 4).

    Attributes:
        av: of the ego.
        followers: of the followers, weighted (equation 17).
        total: av + followers.
        av_comfort: sum of |jerk| over N_c.
        av_efficiency: sum of the speed's distance from its reference over N_e.
        followers_comfort: the same of the followers, weighted.
        followers_efficiency: the same of the followers, weighted.
        increment: followers' loss beyond that without a lane change.
        each: loss of each follower, nearest first.
        weights: of the followers, nearest first.
    """

    av: float
    followers: float
    total: float
    av_comfort: float
    av_efficiency: float
    followers_comfort: float
    followers_efficiency: float
    increment: float
    each: tuple[float, ...]
    weights: tuple[float, ...]


@dataclass(frozen=True)
class Plan:
    """The plan of a policy in a scene, or the status that says why there is none.

    Attributes:
        scene: where.
        policy: who decides.
        accounting: over which time each side is charged.
        found: the plan as the planner gives it, with all samples.
        columns: its columns of ``plans`` and ``losses`` in a run.
        reason: why somebody else's planner has no plan, or "".
    """

    scene: Scene = field(repr=False)
    policy: str
    accounting: str
    found: planner.Plan = field(repr=False)
    columns: Mapping[str, Any] = field(repr=False)
    reason: str = ""

    @property
    def status(self) -> str:
        """``solved``; ``reference`` or ``contact`` of a policy that is not searched; ``infeasible`` and
        ``infeasible_at_start``; ``faulty`` of somebody else's planner.
        """
        return self.found.status

    @property
    def T(self) -> float:
        """Duration of the lane change [s]; NaN without a plan."""
        return float(self.columns["T"])

    @property
    def x_final(self) -> float:
        """Way forward during the lane change [m]; NaN without a plan."""
        return float(self.columns["x_final"])

    @property
    def v_end(self) -> float:
        """Speed at its end [m/s]; NaN without a plan."""
        return float(self.columns["v_end"])

    @property
    def delay_s(self) -> float:
        """Wait before the lane change [s]; NaN without a plan."""
        return float(self.columns["delay_s"])

    @property
    def gap(self) -> str:
        """The gap on the target lane that is taken; "" without a plan."""
        return str(self.columns["gap"])

    @property
    def contact(self) -> str:
        """Who drives through whom, or ""."""
        return self.found.contact

    @property
    def margins(self) -> dict[str, float]:
        """How far the plan stays inside each constraint, in its unit; negative = violated. Of an infeasible scene
        the best that any candidate reaches.
        """
        return dict(self.columns["margins"])

    @property
    def rejected_by(self) -> dict[str, int]:
        """How many candidates each constraint rejected."""
        return dict(self.found.rejected_by)

    @property
    def loss(self) -> Loss:
        """Losses of the ego and of the followers."""
        value = {to: float(self.columns.get(column, np.nan)) for to, column in _LOSSES.items()}
        each, weights = (tuple(self.columns[name]) for name in ("loss_hv_each", "follower_weights"))
        return Loss(**value, each=each, weights=weights)

    @property
    def safety(self) -> dict[str, float]:
        """Smallest gap [m], time headway [s] and time to collision [s], largest DRAC and braking of a follower
        [m/s^2] over the accounted time; NaN where there is none.
        """
        known = ("min_gap_m", "min_time_headway_s", "min_ttc_s", "max_drac", "peak_follower_decel")
        return {name: float(self.columns.get(name, np.nan)) for name in known}

    @cached_property
    def motion(self) -> pd.DataFrame:
        """A row a role and sample of 0.1 s over the horizon; empty without a plan.

        Columns: role, t [s], box centre x, y from the ego's at t = 0 [m], v [m/s], a [m/s^2].
        """
        paths: dict[str, Any] = {}
        replay = self.found.replay
        if replay is not None:
            followers = (replay.x, replay.v, replay.a)
            play = play_of(self.scene.problem, self.policy, replay.av, followers, delay_s=0.0)
            paths[names.EGO] = play.ego
            paths |= {names.target_follower(i): one for i, one in enumerate(play.followers, start=1)}
            paths |= surrounding(self.scene.planned)
        frames = [_frame(role, path, self.scene.planned.dt) for role, path in paths.items()]
        columns = ["role", "t", "x", "y", "v", "a"]
        return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame(columns=columns)

    def plot(self) -> "Figure":
        """The ego's way across, and everybody's speed, over time.

        Returns:
            A matplotlib figure, which a notebook shows.

        Raises:
            UsageError: there is no plan.

        Example:
            >>> import highd_lc as lc
            >>> scene = lc.Scene.of(lc.Vehicle(v=28.0), followers=[lc.Vehicle(x=-40.0, v=30.0)])
            >>> len(lc.plan(scene).plot().axes)
            2
        """
        from highd_lc.reporting.figures_space_time import plan_figure  # matplotlib, which plans do without

        if self.found.replay is None:
            raise UsageError(f"{self.policy}: the plan is {self.status}, there is no motion to draw")
        return plan_figure(self.motion, policy=self.policy, T=self.T)


def _frame(role: str, path: Any, dt: float) -> pd.DataFrame:
    columns = {name: getattr(path, name) for name in ("x", "y", "v", "a")}
    return pd.DataFrame({"role": role, "t": np.arange(len(path.x)) * dt, **columns})


def plan(
    scene: Scene, policy: str | Planner = names.LOCAL_OPTIMUM, *, accounting: str = names.PRIMARY_ACCOUNTING
) -> Plan:
    """The plan of one policy, or of somebody else's planner, in a scene. Other policies are not planned.

    A policy that is searched minimises J = omega_AV loss_AV + (1 - omega_AV) loss_followers over quintic lane
    changes that keep every limit (equations.md 2, 4, 5); ``BENCHMARK`` has omega_AV = 1.

    Args:
        scene: of an event or made by hand.
        policy: one of ``POLICIES``, or a function of ``scene.planned`` that returns a ``PlannedMotion``, or a text
            that says why there is none (docs/planners.md).
        accounting: ``paper``, ``follower_horizon`` or ``equal``: over which time the ego and the followers are
            charged, to T or to the horizon.

    Returns:
        The plan; what cannot be planned has a status that says so, and NaN for its numbers. Of a planner that
        raises an error or returns what is no lane change the status is ``faulty`` and ``reason`` says why.

    Raises:
        UsageError: policy or accounting is unknown, or the policy is ``human`` and nobody recorded one.

    Example:
        >>> import highd_lc as lc
        >>> scene = lc.Scene.of(lc.Vehicle(v=28.0), followers=[lc.Vehicle(x=-40.0, v=30.0)])
        >>> mine, ours = (lc.plan(scene, policy) for policy in (lc.BENCHMARK, lc.LOCAL_OPTIMUM))
        >>> ours.loss.total <= mine.loss.total + 1e-9
        True
    """
    if callable(policy):
        return _plan_by(scene, policy, accounting)
    found = scene.found(policy, accounting)
    columns = {**plan_row(scene.problem, found), **loss_row(scene.problem, found, scene.scores)}
    return Plan(scene, policy, accounting, found, columns)


def _plan_by(scene: Scene, function: Planner, accounting: str) -> Plan:
    """The plan of somebody else's planner, under the function's name."""
    scene.refuse_unknown(accounting=accounting)
    name = planner_name(function)
    given = ask(function, scene.planned)
    found = next(one for one in plans_of(scene.problem, name, given) if one.accounting == accounting)
    columns = {**plan_row(scene.problem, found), **loss_row(scene.problem, found, scene.scores)}
    return Plan(scene, name, accounting, found, columns, given.reason)


def planner_name(function: Planner) -> str:
    """The name under which a planner's plans go. Raises UsageError if a policy has it."""
    name = str(getattr(function, "__name__", type(function).__name__))
    if name in names.POLICIES:
        raise UsageError(f"the planner is called {name!r}, as a policy is: give it another name")
    return name


def compare(
    scene: Scene, policies: Iterable[str | Planner] = names.POLICIES, *, accounting: str = names.PRIMARY_ACCOUNTING
) -> pd.DataFrame:
    """Policies side by side in one scene.

    Args:
        scene: of an event or made by hand.
        policies: some of ``POLICIES``, and planners as in ``plan``.
        accounting: see ``plan``.

    Returns:
        A row a policy, in the order asked for: status, T [s], x_final [m], v_end [m/s], delay_s, gap, losses
        without unit, gaps [m], time to collision [s], DRAC [m/s^2]; NaN where there is nothing. The status of
        ``human`` is ``not_recorded`` in a scene made by hand.

    Raises:
        UsageError: a policy or the accounting is unknown.

    Example:
        >>> import highd_lc as lc
        >>> scene = lc.Scene.of(lc.Vehicle(v=28.0), followers=[lc.Vehicle(x=-40.0, v=30.0)])
        >>> list(lc.compare(scene, [lc.CONSTANT, lc.BENCHMARK]).index)
        ['constant', 'benchmark']
    """
    rows = [_compared(scene, policy, accounting) for policy in policies]
    return pd.DataFrame(rows, columns=["policy", *_OF_PLAN, *_OF_LOSS]).set_index("policy")


def _compared(scene: Scene, policy: str | Planner, accounting: str) -> dict[str, Any]:
    if policy == names.HUMAN and scene.planned.human is None:
        return {"policy": policy, "status": NOT_RECORDED, "gap": "", "contact": ""}
    columns = plan(scene, policy, accounting=accounting).columns
    word = planner_name(policy) if callable(policy) else policy
    return {"policy": word} | {name: columns[name] for name in (*_OF_PLAN, *_OF_LOSS) if name in columns}


@dataclass(frozen=True)
class Tracked:
    """How a car under the model predictive controller drives a plan (equations 18 to 24; equations.md 8).

    Attributes:
        plan: the plan that was driven.
        plant: ``kinematic`` or ``multi_body``.
        columns: its columns of ``tracking`` in a run.
        motion: of the rear axle by samples of 0.1 s: t [s], x, y [m], heading [rad], commanded speed [m/s] and
            steering [rad], and the errors along [m], across [m] and of the heading [rad].
    """

    plan: Plan = field(repr=False)
    plant: str
    columns: Mapping[str, Any] = field(repr=False)
    motion: pd.DataFrame = field(repr=False)

    @property
    def status(self) -> str:
        """``tracked``, or what went wrong."""
        return str(self.columns["status"])

    @property
    def rmse_lateral_m(self) -> float:
        """Root mean square of the error across the road [m]."""
        return self._number("rmse_lateral_m")

    @property
    def max_lateral_m(self) -> float:
        """Largest error across the road [m]."""
        return self._number("max_lateral_m")

    @property
    def rmse_longitudinal_m(self) -> float:
        """Root mean square of the error along the road [m]."""
        return self._number("rmse_longitudinal_m")

    @property
    def rmse_heading_rad(self) -> float:
        """Root mean square of the heading's error [rad]."""
        return self._number("rmse_heading_rad")

    @property
    def loss_av(self) -> float:
        """The ego's loss of the motion that was driven."""
        return self._number("loss_av_tracked")

    @property
    def violations(self) -> tuple[str, ...]:
        """Constraints that the driven motion breaks."""
        return tuple(self.columns.get("violations", ()))

    def _number(self, name: str) -> float:
        return float(self.columns.get(name, np.nan))


def track(plan: Plan, *, plant: str = KINEMATIC) -> Tracked:
    """Drive a plan with the model predictive controller.

    Args:
        plan: of a policy that changes lane.
        plant: the car: ``kinematic`` (a bicycle) or ``multi_body``.

    Returns:
        Errors, losses and the driven motion; NaN, a status and an empty motion where there is nothing to drive.

    Raises:
        UsageError: the plant is unknown, or the policy does not change lane.

    Example:
        >>> import highd_lc as lc
        >>> scene = lc.Scene.of(lc.Vehicle(v=28.0), followers=[lc.Vehicle(x=-40.0, v=30.0)])
        >>> lc.track(lc.plan(scene)).rmse_lateral_m < 0.1
        True
    """
    if plant not in PLANTS:
        raise UsageError(f"plant {plant!r} is unknown; one of: {', '.join(PLANTS)}")
    if plan.policy == names.NO_LANE_CHANGE:
        raise UsageError(f"{plan.policy}: there is no lane change to track")
    tracker = plan.scene.tracker
    driven = tracker.drive(plan.found, plant)
    return Tracked(plan, plant, tracking_row(tracker, plan.found, plant), _driven_motion(driven))


def _driven_motion(driven: Any) -> pd.DataFrame:
    columns = ["x", "y", "heading", "speed", "steering", "error_along_m", "error_across_m", "error_heading_rad"]
    if driven is None:
        return pd.DataFrame(columns=["t", *columns])
    result = driven.result
    frame = pd.DataFrame(np.hstack([result.states, result.inputs, result.errors]), columns=columns)
    frame.insert(0, "t", np.arange(len(frame)) * result.dt)
    return frame
