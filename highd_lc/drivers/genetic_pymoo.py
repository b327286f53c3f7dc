"""The GA of the library pymoo with the same operators: the reference that the compiled GA is tested against."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from highd_lc.core.car_following import FitProblem, objectives_of
from highd_lc.drivers.genetic import ETA_CROSSOVER, ETA_MUTATION, FloatArray, Optimum

Objective = Callable[[FitProblem, FloatArray], FloatArray]


@dataclass(frozen=True)
class PymooGeneticAlgorithm:
    """pymoo's real-coded elitist GA (equations.md 9). Probabilities: crossover a pair, mutation a variable."""

    population: int = 200
    generations: int = 200
    crossover_probability: float = 0.95
    mutation_probability: float = 0.05

    def minimise(self, problem: FitProblem, rng: np.random.Generator) -> Optimum:
        """The best of all generations; the objective is compiled and evaluated a population at a time."""
        return minimise_with_pymoo(problem, self, rng, lambda p, x: objectives_of(p, x.T))

    def algorithm(self) -> Any:
        """pymoo's GA with the operators of ``drivers.genetic``."""
        from pymoo.algorithms.soo.nonconvex.ga import GA
        from pymoo.operators.crossover.sbx import SBX
        from pymoo.operators.mutation.pm import PM

        return GA(
            pop_size=self.population,
            crossover=SBX(prob=self.crossover_probability, eta=ETA_CROSSOVER),
            # prob is the share of individuals that are touched at all; the paper's 0.05 is a variable's.
            mutation=PM(prob=1.0, prob_var=self.mutation_probability, eta=ETA_MUTATION),
        )


def minimise_with_pymoo(
    problem: FitProblem, settings: PymooGeneticAlgorithm, rng: np.random.Generator, objective: Objective
) -> Optimum:
    """Run pymoo's GA on an objective of candidates (n, 6)."""
    # pymoo takes half a second to import: only those who use it pay.
    from pymoo.optimize import minimize

    result = minimize(
        _pymoo_problem(problem, objective),
        settings.algorithm(),
        ("n_gen", settings.generations),
        seed=int(rng.integers(2**31)),
        copy_algorithm=False,
    )
    evaluations = int(result.algorithm.evaluator.n_eval)
    return Optimum(np.asarray(result.X, dtype=float), float(result.F[0]), evaluations)


def _pymoo_problem(problem: FitProblem, objective: Objective) -> Any:
    from pymoo.core.problem import Problem

    class CarFollowingFit(Problem):  # type: ignore[misc]  # pymoo has no types
        def __init__(self) -> None:
            super().__init__(n_var=6, n_obj=1, xl=problem.lower, xu=problem.upper)

        def _evaluate(self, x: FloatArray, out: dict[str, FloatArray], *_: Any, **__: Any) -> None:
            out["F"] = objective(problem, x)[:, None]

    return CarFollowingFit()
