"""The starts of an event: which moments and gaps are open to the AV, and the search that each of them poses."""

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
from highd_lc.algorithms.waiting import Waiting, wait

IntArray = NDArray[np.int64]

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
        allowed = np.flatnonzero(self.gaps[gap].opens(self.waiting)[: max(last + 1, 0)])
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


def best_of(pools: Mapping[Key, Pool], goal: Goal) -> Best | None:
    """The best candidate of all starts, the earliest start of equals; None if none is feasible."""
    found = [best for key, pool in pools.items() if (best := best_at(key, pool, goal)) is not None]
    return min(found, key=lambda best: (best.objective, best.key), default=None)


def best_at(key: Key, pool: Pool, goal: Goal) -> Best | None:
    """The best candidate of one start, the first of equals; None if none is feasible."""
    if not len(pool):
        return None
    value = pool.objective(goal)
    index = int(np.argmin(value))
    return Best(key, index, float(value[index])) if np.isfinite(value[index]) else None
