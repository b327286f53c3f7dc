"""Scenes: what the planner sees, of a recorded event or made by hand."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from os import PathLike

import numpy as np
import pandas as pd

from highd_lc.api.fits import Driver, columns_of, fit_drivers
from highd_lc.api.recordings import Event, settings_of
from highd_lc.drivers.population import PRIOR, behaviours
from highd_lc.planning import planner, scene
from highd_lc.planning.crowd import crowd_of, event_generator
from highd_lc.planning.planner import PlanningProblem
from highd_lc.planning.pool import Pool
from highd_lc.planning.robust import RobustProblem, plan_one_robust
from highd_lc.planning.scene import Followers, Motion
from highd_lc.planning.start_planner import plan_start
from highd_lc.planning.starts import Key, StartProblem, pose_starts
from highd_lc.scoring.charges import Scores
from highd_lc.stages.responses import Traffic, response_rows, responses_of
from highd_lc.stages.scenes import (
    TIME_STEP,
    SceneTables,
    of_own_fits,
    read_scene_tables,
    scene_makers,
)
from highd_lc.tracking.plan_tracking import PlanTracker
from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS, TABLE3_MEANS
from highd_lc.vocab.errors import UsageError
from highd_lc.vocab.policy import ACCOUNTINGS, POLICIES
from highd_lc.vocab.settings import ValidateSettings


@dataclass(frozen=True)
class Vehicle:
    """A vehicle at the start of a scene made by hand; everybody but the ego and its followers keeps the speed.

    Attributes:
        x: box centre ahead of the ego's [m], negative behind it; 0 for the ego.
        v: speed [m/s].
        length: of the box [m].
        width: of the box [m].
        driver: of a follower; None = the published means of Table 3. Its L is the spacing at standstill behind
            whoever is ahead here.
    """

    x: float = 0.0
    v: float = 25.0
    length: float = 5.0
    width: float = 2.0
    driver: Driver | None = None

    def __post_init__(self) -> None:
        for name in ("x", "v", "length", "width"):
            value = getattr(self, name)
            lowest = {"x": -np.inf, "v": 0.0}.get(name, 0.1)
            if not np.isfinite(value) or value < lowest:
                raise UsageError(f"Vehicle.{name} = {value}: a finite number of at least {lowest:g} is needed")


@dataclass(frozen=True)
class Scene:
    """A lane change at its start: all vehicles at t = 0, and the known motion of those that no policy moves.

    Made by ``Event.scene`` or by ``Scene.of``. The candidates that were searched are kept with it, so that
    policies of the same form share them.

    Attributes:
        planned: the arrays that the planner reads.
        settings: of the planner, losses, limits and the controller.
    """

    planned: scene.Scene
    settings: ValidateSettings

    @classmethod
    def of(
        cls,
        ego: Vehicle,
        *,
        followers: Sequence[Vehicle],
        leader: Vehicle | None = None,
        origin_leader: Vehicle | None = None,
        origin_follower: Vehicle | None = None,
        lateral_shift: float = 3.75,
        pipeline: str | PathLike[str] = "highd",
    ) -> "Scene":
        """A scene from a few vehicles. It has no recorded human, so the policy ``human`` is not available.

        Args:
            ego: the vehicle that changes lane, its x is 0.
            followers: on the target lane, nearest first, at least one.
            leader: on the target lane; None = nobody.
            origin_leader: ahead of the ego on its own lane.
            origin_follower: behind the ego on its own lane.
            lateral_shift: D, to the target lane's middle, left positive [m].
            pipeline: TOML file with settings, or the name of a shipped one.

        Returns:
            The scene on a grid of 0.1 s up to the pipeline's horizon.

        Raises:
            UsageError: no follower, vehicles of the target lane in another order, or one inside another.
            SettingsError: there is no such pipeline, or it holds what it may not.

        Example:
            >>> import highd_lc as lc
            >>> scene = lc.Scene.of(
            ...     lc.Vehicle(v=28.0),
            ...     leader=lc.Vehicle(x=45.0, v=27.0),
            ...     followers=[lc.Vehicle(x=-45.0, v=30.0), lc.Vehicle(x=-90.0, v=30.0, driver=lc.SIMULATION)],
            ... )
            >>> lc.plan(scene, lc.BENCHMARK).status
            'solved'
        """
        settings = settings_of(pipeline).validation
        _refuse(ego, followers, leader, lateral_shift)
        H = settings.loss.horizon_s
        made = scene.Scene(
            event_id="made by hand",
            v0=ego.v,
            a0=0.0,
            lateral_shift=lateral_shift,
            length=ego.length,
            width=ego.width,
            wheelbase=settings.tracking.wheelbase_ratio * ego.length,
            dt=TIME_STEP,
            horizon=H,
            target_leader=_steady(leader, lateral_shift, H),
            origin_leader=_steady(origin_leader, 0.0, H),
            origin_follower=_steady(origin_follower, 0.0, H),
            followers=_followers(followers, lateral_shift),
        )
        return cls(made, settings)

    @property
    def drivers(self) -> pd.DataFrame:
        """Parameters of each follower behind its leader in this scene: a row a follower, nearest first."""
        found = pd.DataFrame(self.planned.followers.parameters, columns=list(PARAMETERS))
        found.index = pd.Index([names.target_follower(i + 1) for i in range(len(found))], name="role")
        return found

    @cached_property
    def problem(self) -> PlanningProblem:
        """The planning problem that the scene poses."""
        return planner.pose(self.planned, self.settings)

    @cached_property
    def scores(self) -> Scores:
        """Losses and safety of what was replayed."""
        return Scores(self.problem, planner.plan_one(self.problem, names.NO_LANE_CHANGE, names.EQUAL))

    @cached_property
    def tracker(self) -> PlanTracker:
        """Who drives the plans of this scene."""
        return PlanTracker(self.problem)

    def found(self, policy: str, accounting: str) -> planner.Plan:
        """A policy's plan as the planner gives it; nothing but its form is searched. Raises UsageError."""
        self.refuse_unknown(policy=policy, accounting=accounting)
        if POLICIES[policy].chooses_start:
            return plan_start(self._starts, policy, accounting, self._searched)
        if POLICIES[policy].robust:
            return plan_one_robust(self.unknown, policy, accounting)
        return planner.plan_one(self.problem, policy, accounting)

    def refuse_unknown(self, **words: str) -> None:
        """Raises UsageError if a ``policy`` or an ``accounting`` is none that there is."""
        known: dict[str, tuple[str, ...]] = {"policy": tuple(POLICIES), "accounting": tuple(ACCOUNTINGS)}
        for word, value in words.items():
            if value not in known[word]:
                raise UsageError(f"{word} {value!r} is unknown; one of: {', '.join(known[word])}")

    @cached_property
    def unknown(self) -> RobustProblem:
        """The scene of who knows no more of the followers than how much their drivers differ.

        That is the population's spread where its prior drives them, else that of each follower's fit. Published
        parameters have none: the robust plan is then the plain one.
        """
        robust, problem = self.settings.robust, self.problem
        rng = event_generator(0, self.planned.event_id, purpose="crowd")
        spread = self.planned.followers.spread
        crowd = crowd_of(problem.packed, spread, [], robust=robust, rng=rng)
        return RobustProblem(problem, crowd)

    @cached_property
    def _starts(self) -> StartProblem:
        return pose_starts(self.problem)

    @cached_property
    def _searched(self) -> dict[str, dict[Key, Pool]]:
        return {}


def scene_of_event(event: Event, drivers: Sequence[Driver] | None) -> Scene:
    """See ``Event.scene``."""
    chosen = fit_drivers(event) if drivers is None else list(drivers)
    if len(chosen) != len(event.followers):
        raise UsageError(f"{event.event_id}: {len(chosen)} drivers for {len(event.followers)} followers")
    rows = [
        {"event_id": event.event_id, "follower": rank, **columns_of(driver)}
        for rank, driver in enumerate(chosen, start=1)
    ]
    recording = event.recording
    settings = of_own_fits(recording.settings.validation)
    tables = read_scene_tables(recording.work, recording.number, settings, fits=pd.DataFrame(rows))
    made = next(make for event_id, make in scene_makers(tables, settings) if event_id == event.event_id)()
    if drivers is None:
        made = replace(made, followers=_by_the_population(made.followers, event, tables, settings))
    return Scene(made, settings)


def _by_the_population(
    followers: Followers, event: Event, tables: SceneTables, settings: ValidateSettings
) -> Followers:
    """The followers by the population's stated prior: its constants cannot be fitted to one recording."""
    alone = replace(tables, events=tables.events[tables.events["event_id"] == event.event_id])
    found = pd.DataFrame(list(response_rows(alone, settings, Traffic(tables.vehicles, {}), location=0, failed=[])))
    drivers = behaviours(PRIOR.constants, responses_of(found), PRIOR.moment)
    lcm = (drivers.v_desire, drivers.A, drivers.b, drivers.B, drivers.tau, drivers.L)
    return replace(
        followers, parameters=np.stack(lcm, axis=1), L_no_change=float(drivers.L_before[0]), family=names.LCM,
        memory=drivers.memory, relaxation=drivers.relaxation, need=drivers.need, a_0=drivers.a_0,
        drift=drivers.drift, moment=drivers.moment, spread=np.tile(PRIOR.spread, (len(drivers.tau), 1)),
    )  # fmt: skip


def _refuse(ego: Vehicle, followers: Sequence[Vehicle], leader: Vehicle | None, shift: float) -> None:
    if ego.x != 0.0 or not np.isfinite(shift) or shift == 0.0:
        raise UsageError(f"ego.x = {ego.x}, lateral_shift = {shift}: 0 and a finite shift other than 0 are needed")
    if not followers:
        raise UsageError("followers: at least one vehicle on the target lane is needed")
    lane = [*([] if leader is None else [leader]), *followers]
    for place, (ahead, behind) in enumerate(pairwise(lane)):
        gap = ahead.x - behind.x - (ahead.length + behind.length) / 2.0
        if gap <= 0.0:
            who = f"vehicle {place + 2} of the target lane, foremost first"
            raise UsageError(f"{who}, at x = {behind.x:g}: its gap to the one ahead is {gap:g} m")


def _steady(vehicle: Vehicle | None, y: float, horizon: float) -> Motion | None:
    """A vehicle that keeps its speed."""
    if vehicle is None:
        return None
    t = np.arange(round(horizon / TIME_STEP) + 1) * TIME_STEP
    still = np.zeros(len(t))
    x, v = vehicle.x + vehicle.v * t, still + vehicle.v
    return Motion(np.asarray(x, dtype=np.float64), still + y, v, still, vehicle.length, vehicle.width, observed=1)


def _followers(vehicles: Sequence[Vehicle], y: float) -> Followers:
    drivers = [columns_of(TABLE3_MEANS if one.driver is None else one.driver) for one in vehicles]
    parameters = np.array([[driver[name] for name in PARAMETERS] for driver in drivers])
    spread = np.array([[driver["spread"].get(name, 0.0) for name in PARAMETERS] for driver in drivers])
    return Followers(
        x=np.array([one.x for one in vehicles]),
        y=np.full(len(vehicles), y),
        v=np.array([one.v for one in vehicles]),
        length=np.array([one.length for one in vehicles]),
        width=np.array([one.width for one in vehicles]),
        parameters=parameters,
        L_no_change=float(parameters[0, -1]),
        recorded=(),
        spread=spread,
    )
