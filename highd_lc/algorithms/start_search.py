"""Global search over plans with the moment of the start and the gap as further unknowns.

Fifty delays times three gaps times the planner's search would take a second and more. The best objective as a
function of the delay is smooth but for contacts, so: every fifth delay of every gap on a thin grid; from the most
promising ones of each goal, the planner's own refinement; then from delay to delay as long as a goal gains. The
planner's pool of the recorded gap without delay is among the starts: no policy loses to the one that it contains.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.algorithms.contacts import NO_CONTACT
from highd_lc.algorithms.dynamics import limits
from highd_lc.algorithms.gaps import Gap, before, find_gaps
from highd_lc.algorithms.planner import PlanningProblem
from highd_lc.algorithms.pool import Goal, Pool, Task
from highd_lc.algorithms.refinement import possible_durations, refine, zoom_rows
from highd_lc.algorithms.search import grid
from highd_lc.algorithms.waiting import Waiting, wait

IntArray = NDArray[np.int64]

_DELAY_STEP: Final = 5
_THIN: Final = {"x_nodes": 17, "v_nodes": 7}
_DURATION_STEP_FIXED: Final = 4
_DURATION_STEP_FREE: Final = 8
_LEADING: Final = 3
_PROMISING: Final = 1.25
"""How far above the best value on the thin grid a start may lie to be refined; the grid errs by less."""

Key = tuple[int, int]
"""A start: number of its gap, delay in samples."""
CONTAINED: Final = (0, 0)
"""The start of the policies without a choice: the recorded gap, no delay."""


@dataclass(frozen=True)
class StartProblem:
    """Every start of an event from sample ``earliest`` on: its gaps and the AV's waiting for them."""

    problem: PlanningProblem
    waiting: Waiting
    gaps: tuple[Gap, ...]
    earliest: int = 0

    @cached_property
    def latest(self) -> int:
        """The last sample at which a manoeuvre may end."""
        wanted = round(self.problem.settings.planner.latest_end_s / self.problem.packed.dt)
        return min(wanted, len(self.problem.packed.target_v) - 1)

    def delays(self, gap: int) -> IntArray:
        """The delays after which the AV may start for a gap [samples]: it has touched nobody, the gap is open."""
        planner, dt = self.problem.settings.planner, self.problem.packed.dt
        last = min(round(planner.max_delay_s / dt), self.latest - round(planner.T_min / dt))
        last = min(last, self.waiting.contact - 1) if self.waiting.contact < NO_CONTACT else last
        allowed = np.flatnonzero(self.gaps[gap].opens(self.waiting)[: last + 1])
        later: IntArray = allowed[allowed >= self.earliest]
        return later

    def task(self, key: Key) -> Task:
        """The search that a start poses."""
        gap, d = self.gaps[key[0]], key[1]
        scene = gap.delayed(d, self.waiting)
        limit = limits(scene.v0, self.problem.settings.constraints)
        return Task(scene, gap.terms, limit, self.problem.settings.planner, before(gap, d, self.latest))


@dataclass(frozen=True)
class Best:
    """The best candidate of a goal: its start, its place in that start's pool, its objective."""

    key: Key
    index: int
    objective: float


def pose_starts(problem: PlanningProblem) -> StartProblem:
    """The starts of an event, with the AV's waiting under the settings."""
    behind_leader = problem.settings.planner.waiting == "lcm"
    waiting = wait(problem.scene, problem.packed, behind_leader=behind_leader)
    return StartProblem(problem, waiting, tuple(find_gaps(problem.scene, problem.packed, problem.terms, waiting)))


def search_starts(
    posed: StartProblem, goals: list[Goal], known: Mapping[Key, Pool], *, free: bool
) -> dict[Key, Pool]:
    """The candidates of every start that was looked at.

    known: the planner's pool as that of the contained start; for a free end speed all pools of the fixed form.
    """
    pools = dict(known)
    for gap in range(len(posed.gaps)):
        for d in _coarse(posed.delays(gap)):
            if (gap, d) != CONTAINED:
                _add(pools, (gap, d), _thin_grid(posed.task((gap, d)), free))
    refined: dict[Key, set[Goal]] = {CONTAINED: set(goals)}
    for goal in goals:
        for key in _leading(pools, goal):
            _refine(posed, pools, key, goal, refined, free)
    for goal in goals:
        _descend(posed, pools, goal, refined, free)
    return pools


def best_of(pools: Mapping[Key, Pool], goal: Goal) -> Best | None:
    """The best candidate of all starts, the earliest start of equals; None if none is feasible."""
    found = []
    for key, pool in pools.items():
        index = pool.best(goal) if len(pool) else None
        if index is not None:
            found.append(Best(key, index, float(pool.objective(goal)[index])))
    return min(found, key=lambda best: (best.objective, best.key), default=None)


def _coarse(delays: IntArray) -> list[int]:
    """Every fifth delay, and the first and the last of each stretch."""
    if not len(delays):
        return []
    edge = np.flatnonzero(np.diff(delays) > 1)
    ends = {int(delays[0]), int(delays[-1]), *delays[edge].tolist(), *delays[edge + 1].tolist()}
    return sorted(ends | set(delays[delays % _DELAY_STEP == 0].tolist()))


def _thin_grid(task: Task, free: bool) -> Pool:
    thin = Task(task.scene, task.terms, task.limit, task.settings.model_copy(update=_THIN), task.before)
    step = _DURATION_STEP_FREE if free else _DURATION_STEP_FIXED
    return grid(thin, possible_durations(thin)[::step], free=free)


def _leading(pools: dict[Key, Pool], goal: Goal) -> list[Key]:
    """The most promising starts of a goal, no two of them neighbours on the coarse grid."""
    value = {key: float(pool.objective(goal).min()) for key, pool in pools.items() if len(pool)}
    value = {key: lowest for key, lowest in value.items() if np.isfinite(lowest)}
    chosen: list[Key] = []
    for key in sorted(value, key=lambda key: (value[key], key)):
        near = any(key[0] == gap and abs(key[1] - d) <= _DELAY_STEP for gap, d in chosen)
        if not value[key] <= _PROMISING * min(value.values()):
            break
        if not near:
            chosen.append(key)
        if len(chosen) == _LEADING:
            break
    return chosen


def _refine(
    posed: StartProblem, pools: dict[Key, Pool], key: Key, goal: Goal, refined: dict[Key, set[Goal]], free: bool
) -> None:
    """Bring a start's pool to the planner's precision for a goal, once."""
    if goal not in refined.setdefault(key, set()):
        refined[key].add(goal)
        pools[key] = refine(posed.task(key), pools[key], [goal], free=free)


def _descend(
    posed: StartProblem, pools: dict[Key, Pool], goal: Goal, refined: dict[Key, set[Goal]], free: bool
) -> None:
    """Look at the delays next to a goal's best start, and move there as long as the goal gains."""
    seen: set[Key] = set()
    while (best := best_of(pools, goal)) is not None and best.key not in seen:
        seen.add(best.key)
        _refine(posed, pools, best.key, goal, refined, free)
        best = best_of(pools, goal) or best
        allowed = set(posed.delays(best.key[0]).tolist())
        for step in range(1 - _DELAY_STEP, _DELAY_STEP):
            key = (best.key[0], best.key[1] + step)
            if step and key[1] in allowed:
                _look(posed, pools, key, best, goal, free)


def _look(posed: StartProblem, pools: dict[Key, Pool], key: Key, best: Best, goal: Goal, free: bool) -> None:
    """Try the best plan's shape at another delay: with about the same duration, with the same end, and with
    durations that change faster than the delay, as where a vehicle has to pass first.
    """
    task, there = posed.task(key), pools[best.key]
    n = int(there.n[best.index])
    durations = set(possible_durations(task).tolist())
    earlier = best.key[1] - key[1]
    wanted = {n - 1, n, n + 1} | {n + k * earlier for k in (1, 2, 3, 4)}
    rows = [(m, 0, 0) for m in sorted(wanted & durations)]
    if rows:
        seed = there.chosen(np.array([best.index]))
        found, _ = zoom_rows(task, seed, [goal], rows, free=free)
        found = found.chosen(np.arange(len(seed), len(found)))
        _add(pools, key, found)


def _add(pools: dict[Key, Pool], key: Key, found: Pool) -> None:
    pools[key] = pools[key].joined(found) if key in pools else found
