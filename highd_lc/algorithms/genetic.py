"""The paper's genetic algorithm, compiled whole: breeding, evaluation, survival of the best.

Real-coded and elitist (SPEC section 9); its reference is the GA of pymoo (``algorithms.genetic_pymoo``).
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.algorithms.genetic_operators import PAIR_ROWS, PAIRS, Stream, breed
from highd_lc.algorithms.optimisation import Optimum
from highd_lc.core.car_following_kernel import FitProblem, evaluate_population, new_scratch
from highd_lc.core.random_stream import new_stream

FloatArray = NDArray[np.float64]


@njit(cache=True, nogil=True)
def _select(values: FloatArray, rank: int) -> float:
    """The value of the given rank (0 = smallest); values are reordered (Hoare's quickselect)."""
    low, high = 0, len(values) - 1
    while low < high:
        pivot = values[(low + high) // 2]
        i, j = low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if rank <= j:
            high = j
        elif rank >= i:
            low = i
        else:
            break
    return float(values[rank])


@njit(cache=True, nogil=True)
def _survive(
    parents: FloatArray,
    objectives: FloatArray,
    children: FloatArray,
    child_objectives: FloatArray,
    pool: FloatArray,
) -> None:
    """Put the children among the best n of parents and children in the places of the parents that are not."""
    n = len(objectives)
    for i in range(n):
        pool[i], pool[n + i] = objectives[i], child_objectives[i]
    limit = _select(pool, n - 1)
    ties, donor = n, 0
    for i in range(2 * n):
        ties -= int(pool[i] < limit)
    for place in range(n):
        if objectives[place] < limit:
            continue
        if objectives[place] == limit and ties > 0:
            ties -= 1
            continue
        while child_objectives[donor] > limit or (child_objectives[donor] == limit and ties <= 0):
            donor += 1
        ties -= int(child_objectives[donor] == limit)
        objectives[place] = child_objectives[donor]
        for j in range(6):
            parents[j, place] = children[j, donor]
        donor += 1


@njit(cache=True, nogil=True)
def _evolve(
    problem: FitProblem,
    parents: FloatArray,
    generations: int,
    probabilities: tuple[float, float],
    stream: Stream,
    scratch: FloatArray,
    states: FloatArray,
) -> FloatArray:
    """Run the GA on the initial population parents (6, n), in place; returns the objectives (n,)."""
    n = parents.shape[1]
    objectives, child_objectives, pool = np.empty(n), np.empty(n), np.empty(2 * n)
    children, pairs = np.empty((6, n)), np.empty((6, PAIR_ROWS * PAIRS))
    evaluate_population(problem, parents, scratch, states, objectives)
    for _ in range(generations - 1):
        breed(problem, parents, objectives, probabilities, stream, pairs, children)
        evaluate_population(problem, children, scratch, states, child_objectives)
        _survive(parents, objectives, children, child_objectives, pool)
    return objectives


@dataclass(frozen=True)
class GeneticAlgorithm:
    """The paper's GA (SPEC section 9). Probabilities: crossover a pair, mutation a variable."""

    population: int = 200
    generations: int = 200
    crossover_probability: float = 0.95
    mutation_probability: float = 0.05

    def minimise(self, problem: FitProblem, rng: np.random.Generator) -> Optimum:
        """The best of the last generation; elitist, so the best of all."""
        start = rng.random((6, self.population))
        parents = problem.lower[:, None] + start * (problem.upper - problem.lower)[:, None]
        scratch, states = new_scratch(problem.track.shape[1])
        probabilities = (self.crossover_probability, self.mutation_probability)
        objectives = _evolve(problem, parents, self.generations, probabilities, new_stream(rng), scratch, states)
        best = int(np.argmin(objectives))
        evaluations = self.population * self.generations
        return Optimum(parents[:, best].copy(), float(objectives[best]), evaluations)
