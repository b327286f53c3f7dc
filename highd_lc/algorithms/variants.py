"""The same event posed with one thing changed, and what the planner finds then."""

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.algorithms import starts
from highd_lc.algorithms.planner import PlanningProblem, goals
from highd_lc.algorithms.pool import Goal, Pool
from highd_lc.algorithms.start_planner import FORM_OF_START, start_pools
from highd_lc.vocab import names

FloatArray = NDArray[np.float64]

Losses = tuple[float, float]
"""Loss of the AV and of the followers; NaN if no plan is feasible."""
_NOTHING: Final = ((np.nan, np.nan), np.nan)


def with_horizon(problem: PlanningProblem, horizon_s: float) -> PlanningProblem:
    """The event accounted over H = horizon_s only, at most the scene's own; plans are at most as long."""
    samples = round(horizon_s / problem.packed.dt) + 1
    packed = problem.packed._replace(
        target_front=problem.packed.target_front[:samples].copy(),
        target_v=problem.packed.target_v[:samples].copy(),
        leader_x=np.ascontiguousarray(problem.packed.leader_x[:, :samples]),
        leader_y=np.ascontiguousarray(problem.packed.leader_y[:, :samples]),
    )
    return replace(problem, packed=packed)


def with_parameters(problem: PlanningProblem, parameters: FloatArray) -> PlanningProblem:
    """The event with other LCM parameters of its followers, shape (p, 6).

    L of the first follower behind the target leader moves with its L behind the AV.
    """
    packed = problem.packed
    first_L = packed.first_L + float(parameters[0, 5] - packed.parameters[0, 5])
    return replace(problem, packed=packed._replace(parameters=np.ascontiguousarray(parameters), first_L=first_L))


def weight_of(problem: PlanningProblem, policy: str) -> float:
    """omega_AV of an optimal policy."""
    return 1.0 if policy.startswith(names.BENCHMARK) else problem.settings.loss.omega_av


def best_of(problem: PlanningProblem) -> dict[tuple[str, str], tuple[Losses, float]]:
    """Losses and T [s] of every optimal policy under every accounting, searched anew; NaN where infeasible."""
    found = {}
    pools = problem.pools
    for form, policies in ((names.FIXED, names.FIXED_POLICIES), (names.FREE, names.FREE_POLICIES)):
        for policy in policies if form in pools else ():
            for accounting in names.ACCOUNTINGS:
                losses, n = _optimum(pools[form], Goal(accounting, weight_of(problem, policy)))
                found[policy, accounting] = losses, n * problem.packed.dt
    return found


def best_starts(problem: PlanningProblem) -> dict[tuple[str, str], tuple[Losses, float]]:
    """The same of every policy that chooses its start."""
    found = {}
    pools = start_pools(starts.pose_starts(problem), goals(problem))
    for policy, form in FORM_OF_START.items():
        for accounting in names.ACCOUNTINGS if form in pools else ():
            goal = Goal(accounting, weight_of(problem, policy))
            best = starts.best_of(pools[form], goal)
            one = pools[form][best.key].chosen(np.array([best.index])) if best else None
            losses, n = _optimum(one, goal) if one else _NOTHING
            found[policy, accounting] = losses, n * problem.packed.dt
    return found


def optima(problem: PlanningProblem) -> dict[tuple[str, str], Losses]:
    """The losses alone of ``best_of``."""
    return {cell: losses for cell, (losses, _) in best_of(problem).items()}


def _optimum(pool: Pool, goal: Goal) -> tuple[Losses, float]:
    best = pool.best(goal) if len(pool) else None
    if best is None:
        return _NOTHING
    av, hv = pool.losses(goal.accounting)
    return (float(av[best]), float(hv[best])), float(pool.n[best])
