"""One plan of an AV under way: the best from its state on, or the way back to the lane that it came from."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.quintic import Quintic
from highd_lc.driving.world import keeping_lane
from highd_lc.planning.crowd import Crowd
from highd_lc.planning.limits import started_violation
from highd_lc.planning.planner import PlanningProblem, rejections
from highd_lc.planning.pool import Goal, Pool, Task
from highd_lc.planning.replay import AvMotion, av_charge, clearances, drive_on, follow, plan_motion
from highd_lc.planning.safety import binding
from highd_lc.planning.scene import NOT_YET, Motion, PackedScene
from highd_lc.planning.search import search
from highd_lc.vocab import names

FloatArray = NDArray[np.float64]

SHORTEST: Final = 0.5
"""Shortest duration of a plan under way [s]; what is shorter is driven to its end."""
_BACK_S: Final = tuple(0.5 * half for half in range(2, 13))
_BACK_CHANGES: Final = (-8.0, -6.0, -4.0, -3.0, -2.0, -1.0, 0.0, 1.0, 2.0)
"""Durations [s] and changes of speed [m/s] of the ways back that are looked at."""


@dataclass(frozen=True)
class Tail:
    """What is left of the plan that is driven: samples, x_final - v T [m], v_end - v [m/s] from the present on."""

    n: int
    delta: float
    change: float


@dataclass(frozen=True)
class Chosen:
    """What a search found: the plan, whether it is the one that is driven already, and its objective.

    plan None: no permitted one; binding: the constraint that forbids them.
    """

    plan: Quintic | None
    kept: bool = False
    objective: float = np.nan
    binding: str = ""


@dataclass(frozen=True)
class Posed:
    """The search from a moment on. problem: with the scene as the AV knows it then; elapsed: since the manoeuvre
    began [s]; tail: of the plan that is driven, None before there is one; change: v_end - v of the fixed form.
    """

    problem: PlanningProblem
    elapsed: float
    tail: Tail | None
    change: float
    crowd: Crowd | None = None

    @property
    def task(self) -> Task:
        """The search, over what is left of the durations that the settings allow."""
        settings, own = self.problem.settings.search, self.problem.task
        shortest = max(settings.T_min - self.elapsed, SHORTEST)
        limits = {"T_min": shortest, "T_max": settings.T_max - self.elapsed}
        return replace(own, settings=settings.model_copy(update=limits), crowd=self.crowd, change=self.change)

    def ellipses_alone(self) -> "Posed":
        """The same without what the safety profile asks of a plan; the AV stays bounded after T."""
        scene = self.problem.packed
        asked = scene.safety._replace(asked=False, clearance=0.0)
        return replace(self, problem=replace(self.problem, packed=scene._replace(safety=asked)))

    def best(self, omega_av: float) -> Chosen:
        """The plan with the least loss under the accounting ``equal``. omega_av: weight of the AV's.

        The plan that is driven is one of the candidates and the first of equals.
        """
        goal = self._goal(omega_av)
        pool = self._pool(goal, free=False)
        best = pool.best(goal)
        if best is None:
            _, rejected = rejections(self.problem, pool, goal.accounting, {})
            return Chosen(None, binding=binding(self.problem.packed, rejected))
        return self._chosen(pool, goal, best)

    def best_freed(self, omega_av: float, *, or_latest: bool) -> tuple[Chosen, bool]:
        """The same with the end speed as an unknown as well, and whether it is permitted.

        or_latest: without a permitted one, the plan within the limits of motion that touches somebody latest.
        """
        goal = self._goal(omega_av)
        pool = self._pool(goal, free=True)
        best = pool.best(goal)
        if best is not None:
            return self._chosen(pool, goal, best), True
        moving = np.flatnonzero(pool.within_limits)
        if not (or_latest and len(moving)):
            return Chosen(None), False
        order = np.lexsort((pool.unconstrained(goal)[moving], -pool.contact[moving]))
        return self._chosen(pool, goal, int(moving[order[0]])), False

    def _goal(self, omega_av: float) -> Goal:
        return Goal(names.PRIMARY_ACCOUNTING, omega_av)

    def _pool(self, goal: Goal, *, free: bool) -> Pool:
        """The candidates, the plan that is driven first."""
        task = self.task
        pool = search(task, [goal])
        if free:
            pool = search(task, [goal], known=pool)
        if self.tail is None:
            return pool
        n, delta, change = self.tail.n, self.tail.delta, self.tail.change
        return task.simulate(np.array([n]), np.array([[delta]]), np.array([[change]])).joined(pool)

    def _chosen(self, pool: Pool, goal: Goal, i: int) -> Chosen:
        plan = self.task.quintic(int(pool.n[i]), float(pool.delta[i]), float(pool.change[i]))
        return Chosen(plan, self.tail is not None and i == 0, float(pool.objective(goal)[i]))


def way_back(posed: Posed, origin_leader: Motion | None) -> Quintic | None:
    """The way back to the middle of the lane that the AV came from with the least loss of its own; None: none.

    It keeps the limits of motion and the distances to everybody to H, behind the origin leader, whose motion as
    predicted is given; the followers react to the target leader again.
    """
    problem, best, least = posed.problem, None, np.inf
    scene = problem.packed
    lane = keeping_lane(scene, origin_leader)
    for T in _BACK_S:
        n = round(T / scene.dt)
        for change in _BACK_CHANGES if n < len(scene.target_v) else ():
            delta = change * T / 2.0
            if started_violation(T, delta, change, scene.v0, 0.0, scene.start, problem.limit):
                continue
            plan = Quintic(scene.v0, 0.0, T, scene.v0 * T + delta, scene.v0 + change, scene.start)
            av = _back(plan, lane)
            loss = float(av_charge(av, problem.terms).loss[-1])
            if loss < least and _clear(av, scene, lane):
                best, least = plan, loss
    return best


def _back(plan: Quintic, lane: PackedScene) -> AvMotion:
    av = replace(plan_motion(plan, lane), crossing=len(lane.target_v))
    drive_on(av.x, av.y, av.vx, av.ax, av.jerk, av.n, lane)
    return av


def _clear(av: AvMotion, scene: PackedScene, lane: PackedScene) -> bool:
    """Whether the AV keeps its distances to everybody, and its leader's rear ahead of its front."""
    rear = lane.target_front - lane.target_length
    if (av.x + scene.length / 2.0 > rear).any():
        return False
    x, v, a = (np.empty((len(scene.follower_x), len(av.x))) for _ in range(3))
    alone = scene._replace(joined=scene.joined._replace(since=NOT_YET))
    follow(av.x + scene.length / 2.0, av.vx, NOT_YET, alone, x, v, a)
    last = len(av.x) - 1
    to_T, _ = clearances(av.x, av.y, av.vx, av.vy, last, last, scene, x)
    return bool((to_T >= scene.safety.clearance).all())
