"""Plans of who does not know the followers: the local optimum for a crowd of drivers (equations.md 7.4)."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from highd_lc.planning.crowd import Crowd
from highd_lc.planning.planner import (
    Plan,
    PlanningProblem,
    best_plan,
    goals,
    infeasible_at_start,
    overlap_at_start,
)
from highd_lc.planning.pool import Goal, Pool, Task
from highd_lc.planning.search import nominal_rejections, search
from highd_lc.vocab import names
from highd_lc.vocab.policy import POLICIES

FORM_OF_ROBUST = {policy.name: policy.form for policy in POLICIES.values() if policy.robust}


@dataclass(frozen=True)
class RobustProblem:
    """An event whose followers are one of a crowd. problem: with the drivers of the crowd's first draw."""

    problem: PlanningProblem
    crowd: Crowd

    @cached_property
    def _searched(self) -> dict[str, Pool]:
        # A crowd of one are the drivers that the problem has: nothing is searched twice.
        return {} if len(self.crowd.first_L) > 1 else dict(self.problem.pools)

    def pool(self, form: str) -> Pool:
        """The candidates of a form under the crowd, searched once.

        The plain optima are among them: no robust plan is worse for the crowd than the plain one.
        """
        if form not in self._searched:
            task, wanted = replace(self.problem.task, crowd=self.crowd), self._goals
            known = self.pool(names.FIXED) if form == names.FREE else None
            found = search(task, wanted, known=known)
            self._searched[form] = found.joined(_again(task, self.problem.pool(form), wanted))
        return self._searched[form]

    @property
    def _goals(self) -> list[Goal]:
        return [goal for goal in goals(self.problem) if goal.omega_av < 1.0]


def _again(task: Task, pool: Pool, wanted: list[Goal]) -> Pool:
    """The best candidates of a plain search, simulated once more for a task."""
    best = sorted({i for goal in wanted if (i := pool.best(goal)) is not None})
    chosen = pool.chosen(np.array(best, np.int64))
    return task.simulate(chosen.n, chosen.delta[:, None], chosen.change[:, None])


def plan_robust(posed: RobustProblem) -> list[Plan]:
    """The plans of the robust policies under every accounting.

    Replays are those among the problem's drivers, objectives those of the crowd. An event whose ellipses
    overlap at t_start already gives plans with that status.
    """
    free = posed.problem.settings.planner.free_form
    asked = [policy for policy, form in FORM_OF_ROBUST.items() if free or form == names.FIXED]
    return [plan_one_robust(posed, policy, accounting) for policy in asked for accounting in names.ACCOUNTINGS]


def plan_one_robust(posed: RobustProblem, policy: str, accounting: str) -> Plan:
    """The plan of one robust policy, as ``plan_robust`` has it; only its form is searched."""
    problem, form = posed.problem, FORM_OF_ROBUST[policy]
    if overlap_at_start(problem):
        return next(p for p in infeasible_at_start(problem, [policy]) if p.accounting == accounting)
    goal = Goal(accounting, POLICIES[policy].omega_av(problem.settings.loss.omega_av))
    nominal = nominal_rejections(problem.task, free=form == names.FREE)
    return best_plan(problem, posed.pool(form), goal, policy, nominal, {})
