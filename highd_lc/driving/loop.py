"""The closed loop of one event: plan, drive half a second, look, plan again (equations.md 7.5)."""

import time
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.quintic import Quintic, StartState, reaches, sample
from highd_lc.driving.knowledge import joined_since, known_scene
from highd_lc.driving.replanning import SHORTEST, Chosen, Posed, Tail, way_back
from highd_lc.driving.tracker import Tracker
from highd_lc.driving.world import (
    NOWHERE,
    Way,
    coming_over,
    drive_after,
    followers,
    keeping_lane,
    led_by,
    origin_follower,
)
from highd_lc.planning.crowd import Crowd
from highd_lc.planning.later import Around, AvState, later_scene
from highd_lc.planning.limits import contacts
from highd_lc.planning.planner import Plan, PlanningProblem, plan_one
from highd_lc.planning.replay import AvMotion, Replay, clearances, drive_on, free_motion
from highd_lc.planning.robust import RobustProblem, plan_one_robust
from highd_lc.planning.scene import NOT_YET, Motion, PackedScene, Scene, leaders_of, obstacle_roles
from highd_lc.vocab import names
from highd_lc.vocab.policy import REPLANNED, Policy
from highd_lc.vocab.sections import RECORDED_LEADERS, ClosedLoopSettings

FloatArray = NDArray[np.float64]

ONCE: Final = float("inf")
"""``every_s`` of who never plans again."""


@dataclass(frozen=True)
class Case:
    """One drive. problem: as the run poses it, with recorded leaders and the followers that the AV believes in.

    world: the same scene with the followers that there are. policy: of ``vocab.policy.REPLANNED``. crowd: of the
    robust one.
    """

    problem: PlanningProblem
    world: PackedScene
    policy: str
    settings: ClosedLoopSettings
    crowd: Crowd | None = None

    @property
    def asked(self) -> Policy:
        """The policy."""
        return REPLANNED[self.policy]

    def foreseen(self) -> "Case":
        """The same drive of who knows all that comes, and plans once."""
        problem = self.problem
        if self.world is not problem.packed:
            problem = replace(problem, packed=self.world)
        known = self.settings.model_copy(update={"leaders": RECORDED_LEADERS, "every_s": ONCE})
        return replace(self, problem=problem, settings=known)


@dataclass(frozen=True)
class Replan:
    """A decision. k: its sample; verdict: of ``names.VERDICTS``; plan: what is driven then, None = it waits.

    x, y: where the planned point is then [m]; scene: as the AV knew it; binding: what forbade a plan; seconds: how
    long the decision took.
    """

    k: int
    verdict: str
    plan: Quintic | None
    x: float
    scene: PackedScene
    objective: float = np.nan
    binding: str = ""
    seconds: float = 0.0


@dataclass(frozen=True)
class ClosedLoop:
    """A drive over 0 .. H. status: of ``names.DRIVE_STATUSES``, reason: what forbade the lane change, or "".

    replay: what really happened; replans: every decision; began, ended: samples of the manoeuvre's start and end,
    ``NOT_YET`` without one. met: who touched whom (see ``contacts_of``). max_lateral_m: largest tracking error,
    NaN where none was tracked.
    """

    status: str
    reason: str
    replay: Replay
    replans: tuple[Replan, ...]
    began: int
    ended: int
    met: tuple[str, ...]
    max_lateral_m: float


def contacts_of(replay: Replay, scene: Scene, packed: PackedScene, *, joins: bool, last: int) -> tuple[str, ...]:
    """Who drives through whom (``names.through``), and ``clearance_<role>`` of whose ellipse meets the AV's.

    Up to sample ``last``; the clearances are those of the whole replay.
    """
    through = contacts(replay, packed, joins=joins, last=last, origin_leader=scene.origin_leader)
    nearest = np.minimum(replay.clearance_to_T, replay.clearance_after_T)
    roles = zip(obstacle_roles(scene), nearest, strict=True)
    touched = [f"clearance_{role}" for role, clearance in roles if clearance < 0.0]
    return (*dict.fromkeys(name for _, name in sorted(through)), *touched)


def drive_closed_loop(case: Case, tracker: Tracker) -> ClosedLoop:
    """Drive an event. tracker: of its AV; its log is overwritten."""
    drive = _Drive(case, tracker)
    k = 0
    while not drive.over(k):
        drive.decide(k)
        k = drive.go(k)
    return drive.result()


@dataclass
class _Drive:
    """A drive under way. av: as driven so far; plan: what is driven, from sample ``start``, x = ``place`` on."""

    case: Case
    tracker: Tracker
    way: Way = NOWHERE
    plan: Quintic | None = None
    start: int = 0
    place: float = 0.0
    replans: list[Replan] = field(default_factory=list)
    av: AvMotion = field(init=False)

    def __post_init__(self) -> None:
        self.av = free_motion(self.case.world)
        self._keep_lane(0)

    @cached_property
    def _all_that_comes(self) -> PackedScene:
        """The scene of who knows it: behind the origin leader, where that comes over ahead of the planned AV."""
        problem = self.case.problem
        planned = _planned(self.case, problem).replay
        if planned is None:
            return problem.packed
        leads = coming_over(self.scene, problem.packed, planned.av, planned.av.n)
        return led_by(problem.packed, self.scene.origin_leader, leads)

    @property
    def scene(self) -> Scene:
        """The event."""
        return self.case.problem.scene

    @property
    def last(self) -> int:
        """Sample of H."""
        return len(self.av.x) - 1

    @property
    def end(self) -> int:
        """Sample at which the plan ends."""
        return self.last if self.plan is None else self.start + round(self.plan.T / self.scene.dt)

    @property
    def every(self) -> int:
        """Samples from one decision to the next."""
        wanted = self.case.settings.every_s / self.scene.dt
        return round(wanted) if wanted < self.last else self.last

    def over(self, k: int) -> bool:
        """Whether nothing is left to decide."""
        waited = self.case.problem.settings.planner.max_delay_s / self.scene.dt
        return k >= self.end if self.plan is not None else k >= self.last or k > waited

    def decide(self, k: int) -> None:
        """Plan at sample k, where there is something to plan."""
        begun = time.perf_counter()
        if self.plan is None:
            decision = self._begin(k)
        elif self.way.turns_back <= k or (self.end - k) * self.scene.dt < SHORTEST:
            return
        else:
            decision = self._again(k)
        self.replans.append(replace(decision, seconds=time.perf_counter() - begun))

    def go(self, k: int) -> int:
        """Drive on from sample k to the next decision, whose sample is returned."""
        stop = min(k + self.every, self.end)
        if self.plan is not None:
            self.tracker.drive(self.av, k, stop)
        return stop

    def _begin(self, k: int) -> Replan:
        state = AvState(float(self.av.x[k]), float(self.av.vx[k]), _straight(self.av, k))
        known = self._known(k)
        posed = self._posed(k, state, known, began=k)
        if k == 0:
            chosen = _first_plan(self.case, replace(self.case.problem, packed=known))
        else:
            chosen = posed.best(self._omega)
        if chosen.plan is None:
            return Replan(k, names.WAITED, None, state.x, posed.problem.packed, binding=chosen.binding)
        self.way = Way(begins=k)
        return self._take(k, state.x, chosen, posed.problem.packed, names.REPLANNED)

    def _again(self, k: int) -> Replan:
        assert self.plan is not None
        moment = sample(self.plan, np.array([(k - self.start) * self.scene.dt]))
        numbers = (float(getattr(moment, name)[0]) for name in ("ax", "y", "vy", "ay"))
        state = AvState(self.place + float(moment.x[0]), float(moment.vx[0]), StartState(*numbers))
        known = self._known(k)
        posed = self._posed(k, state, known, began=self.way.begins)
        chosen = posed.best(self._omega)
        if chosen.kept:
            return Replan(k, names.KEPT, chosen.plan, state.x, posed.problem.packed, chosen.objective)
        if chosen.plan is not None:
            return self._take(k, state.x, chosen, posed.problem.packed, names.REPLANNED)
        return self._without_permitted(k, state, posed, chosen.binding)

    def _without_permitted(self, k: int, state: AvState, posed: Posed, binding: str) -> Replan:
        """What an AV does under way that may not do what its policy asks. binding: what forbids it."""
        scene = posed.problem.packed
        back = way_back(posed, self._origin_leader(scene)) if k < self.av.crossing else None
        if back is not None:
            self.way = replace(self.way, turns_back=k)
            return self._take(k, state.x, Chosen(back, binding=binding), scene, names.TURNED_BACK)
        for verdict, allowed in ((names.FREED, posed), (names.RELAXED, posed.ellipses_alone())):
            last = verdict == names.RELAXED
            chosen, permitted = allowed.best_freed(self._omega, or_latest=last)
            if chosen.plan is not None and not chosen.kept:
                how = verdict if permitted else names.LATEST
                return self._take(k, state.x, replace(chosen, binding=binding), scene, how)
            if permitted:
                return Replan(k, verdict, chosen.plan, state.x, scene, chosen.objective, binding)
        return Replan(k, names.HELD, self._left(k, state), state.x, scene, binding=binding)

    @property
    def _omega(self) -> float:
        return self.case.asked.omega_av(self.case.problem.settings.loss.omega_av)

    def _known(self, k: int) -> PackedScene:
        crossed = self.plan is not None and k >= self.av.crossing
        front = float(self.av.x[k]) + self.scene.length / 2.0 if crossed else np.inf
        packed, how = self.case.problem.packed, self.case.settings.leaders
        if how == RECORDED_LEADERS:
            return self._all_that_comes
        return known_scene(self.scene, packed, k, how, av_front=front)

    def _origin_leader(self, known: PackedScene) -> Motion | None:
        """The origin leader as a known scene has it."""
        leader = self.scene.origin_leader
        if leader is None:
            return None
        x = known.leader_x[list(leaders_of(self.scene)).index(names.ORIGIN_LEADER)]
        return replace(leader, x=x, v=np.gradient(x, self.scene.dt))

    def _posed(self, k: int, state: AvState, known: PackedScene, *, began: int) -> Posed:
        problem, underway = self.case.problem, self.plan is not None
        x, v, _ = followers(self.case.world, self.av, self.way, k=k)
        first = x[0], v[0]
        joined = joined_since(
            known, known.parameters[0], known.reactions[0], first, av=self.av, k=k, since=self.way.begins
        )
        crossed = underway and k >= self.av.crossing
        origin = None if crossed else origin_follower(self.case.world, self.av, k=k)
        scene = later_scene(known, k, state, Around(x[:, k].copy(), v[:, k].copy(), origin, joined))
        if underway:
            scene = scene._replace(safety=scene.safety._replace(braking=np.inf))
        roles = tuple(r for r in problem.roles if origin is not None or r != names.ORIGIN_FOLLOWER)
        own = replace(problem, packed=scene, roles=roles)
        tail = self._tail(k, state) if underway else None
        change = tail.change if tail is not None else 0.0
        crowd = self._crowd(known, first, k)
        return Posed(own, (k - began) * self.scene.dt, tail, change, crowd)

    def _crowd(self, known: PackedScene, first: tuple[FloatArray, FloatArray], k: int) -> Crowd | None:
        """The crowd by now: each of its first followers has had the AV as leader since its own moment."""
        crowd = self.case.crowd
        if crowd is None or not self.case.asked.robust:
            return None
        drivers = zip(crowd.parameters[:, 0], crowd.reactions[:, 0], strict=True)
        joined = [
            joined_since(known, own, reacts, first, av=self.av, k=k, since=self.way.begins)
            for own, reacts in drivers
        ]
        return crowd._replace(joined=np.array(joined, dtype=np.float64))

    def _tail(self, k: int, state: AvState) -> Tail:
        left = self._left(k, state)
        n = self.end - k
        return Tail(n, left.x_final - left.v0 * n * self.scene.dt, left.v_end - left.v0)

    def _left(self, k: int, state: AvState) -> Quintic:
        """What is left of the plan, as a plan from the present state on."""
        assert self.plan is not None
        T = round((self.end - k) * self.scene.dt, 10)
        x_final = self.place + self.plan.x_final - state.x
        return Quintic(state.v, self.plan.D, T, x_final, self.plan.v_end, state.start)

    def _take(self, k: int, place: float, chosen: Chosen, scene: PackedScene, verdict: str) -> Replan:
        """Drive a plan from sample k on."""
        plan = chosen.plan
        assert plan is not None
        self.plan, self.start, self.place = plan, k, place
        n, dt = self.end - k, self.scene.dt
        crossing = self.av.crossing
        if verdict == names.TURNED_BACK:
            crossing = self.last + 1
        elif k < crossing:
            crossing = k + reaches(0.5, n, dt, plan.D, plan.start)
        self.av = replace(self.av, crossing=crossing)
        self.tracker.take(plan, k, place, fresh=k == self.way.begins)
        return Replan(k, verdict, plan, place, scene, chosen.objective, chosen.binding)

    def _keep_lane(self, k: int) -> None:
        """Fill the AV's motion from sample k on: by the LCM in its own lane."""
        av = self.av
        lane = keeping_lane(self.case.world, self.scene.origin_leader)
        drive_on(av.x, av.y, av.vx, av.ax, av.jerk, k, lane)

    def result(self) -> ClosedLoop:
        """The whole drive, once the manoeuvre is over."""
        world, av, end, joins = self.case.world, self.av, 0, False
        if self.plan is not None:
            end, joins = self.end, self.way.turns_back == NOT_YET
            self.tracker.finish(av, self.way.begins, end)
            if joins:
                drive_after(self.scene, world, av, end)
            else:
                self._keep_lane(end)
        x, v, a = followers(world, av, self.way, k=self.last)
        n = end if joins else self.last
        crossing = av.crossing if joins else self.last
        to_T, after_T = clearances(av.x, av.y, av.vx, av.vy, n, crossing, world, x)
        replay = Replay(replace(av, n=n), x, v, a, to_T, after_T)
        met = contacts_of(replay, self.scene, world, joins=joins, last=self.last)
        return ClosedLoop(
            status=names.CHANGED if joins else names.ABORTED if self.plan is not None else names.NEVER_BEGUN,
            reason="" if joins else self.replans[-1].binding,
            replay=replay,
            replans=tuple(self.replans),
            began=self.way.begins,
            ended=end if self.plan is not None else NOT_YET,
            met=met,
            max_lateral_m=self.tracker.largest_error(self.way.begins, end),
        )


def _straight(av: AvMotion, k: int) -> StartState:
    """The state of an AV that has kept its lane until sample k."""
    return StartState(float(av.ax[k - 1]) if k else 0.0, 0.0, 0.0, 0.0)


def _first_plan(case: Case, problem: PlanningProblem) -> Chosen:
    """The plan at t_start, as it stands in ``plans`` where everything is known."""
    plan = _planned(case, problem)
    return Chosen(plan.quintic, objective=plan.objective, binding=plan.binding)


def _planned(case: Case, problem: PlanningProblem) -> Plan:
    once, accounting = case.asked.planned_once, names.PRIMARY_ACCOUNTING
    if case.asked.robust:
        assert case.crowd is not None, "of a robust policy"
        return plan_one_robust(RobustProblem(problem, case.crowd), once, accounting)
    return plan_one(case.problem if problem.packed is case.problem.packed else problem, once, accounting)
