"""How the comparison of the policies depends on followers' parameters that nobody knows exactly."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from highd_lc.algorithms import rescoring
from highd_lc.algorithms.contacts import NO_CONTACT
from highd_lc.algorithms.planner import Plan, PlanningProblem
from highd_lc.algorithms.rescoring import Charged
from highd_lc.algorithms.sampling import event_generator, parameter_draws
from highd_lc.algorithms.variants import best_of, best_starts, with_parameters
from highd_lc.vocab import names

FloatArray = NDArray[np.float64]

Cell = tuple[str, str]
"""A policy and an accounting."""


@dataclass(frozen=True)
class Replanned:
    """What each draw leads to when it is planned and scored with: by policy and accounting.

    av, hv: losses; T [s]; each of shape (K,), NaN where no plan is feasible.
    """

    av: dict[Cell, FloatArray]
    hv: dict[Cell, FloatArray]
    T: dict[Cell, FloatArray]

    def total(self, cell: Cell) -> FloatArray:
        """Loss of the AV and of the followers together, shape (K,)."""
        return self.av[cell] + self.hv[cell]


def draws_of(problem: PlanningProblem, count: int, *, seed: int) -> FloatArray:
    """The event's drawn LCM parameters, shape (count, p, 6): the first ones stay the same with more draws."""
    followers = problem.scene.followers
    spread = np.zeros_like(followers.parameters) if followers.spread is None else followers.spread
    rng = event_generator(seed, problem.scene.event_id, purpose="draws")
    return parameter_draws(problem.packed.parameters, spread, count, rng)


def replan(problem: PlanningProblem, draws: FloatArray, *, chooses_start: bool = False) -> Replanned:
    """Plan every optimal policy with each draw, shape (K, p, 6); those that choose their start only if wanted."""
    posed = [with_parameters(problem, drawn) for drawn in draws]
    found = [best_of(one) | (best_starts(one) if chooses_start else {}) for one in posed]
    cells = list(found[0]) if found else []
    return Replanned(
        {cell: np.array([one[cell][0][0] for one in found]) for cell in cells},
        {cell: np.array([one[cell][0][1] for one in found]) for cell in cells},
        {cell: np.array([one[cell][1] for one in found]) for cell in cells},
    )


def rescore(problem: PlanningProblem, plan: Plan, draws: FloatArray) -> Charged:
    """Followers' loss under each draw while the AV keeps to a plan made without knowing it; shape (K,)."""
    if plan.replay is None:
        nothing = np.full(len(draws), np.nan)
        return Charged(nothing, nothing, np.full(len(draws), NO_CONTACT), 0)
    return rescoring.lcm_followers(plan.replay.av, problem.packed, problem.terms, draws, plan.replay.entry)


def av_loss(problem: PlanningProblem, plan: Plan) -> tuple[float, float]:
    """The AV's loss of a plan charged to T and to H; NaN without a plan."""
    if plan.replay is None:
        return np.nan, np.nan
    return rescoring.av_charged(plan.replay.av, problem.terms)


def charged_by(accounting: str, av: tuple[float, float], hv: Charged) -> tuple[float, FloatArray]:
    """Loss of the AV and of the followers, shape (K,), under an accounting."""
    return (av[1] if accounting == names.EQUAL else av[0]), (hv.to_T if accounting == names.PAPER else hv.to_H)


def relative_gain(local: FloatArray, benchmark: FloatArray) -> FloatArray:
    """1 - local / benchmark of each pair of totals; NaN where one is missing or the benchmark's is 0."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(benchmark > 0.0, 1.0 - local / benchmark, np.nan)
