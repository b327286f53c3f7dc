"""The paper's genetic algorithm, compiled whole: breeding, evaluation, survival of the best.

Real-coded and elitist (equations.md 9): binary tournaments over random permutations, simulated binary crossover
(SBX, Deb and Agrawal 1995, bounded) and polynomial mutation (Deb and Goyal 1996). Children that are copies of a
parent are bred again. Its reference, which it is tested against, is the GA of the library pymoo with the same
operators (``PymooGeneticAlgorithm``).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.core.car_following import FitProblem, evaluate_population, new_scratch, objectives_of
from highd_lc.core.kernels import fill_uniform, kernel, new_stream, next_uniform

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Optimum:
    """Best parameters found, shape (6,), inside the bounds; their objective; objective evaluations spent."""

    parameters: FloatArray
    objective: float
    evaluations: int


class Optimiser(Protocol):
    """Searches the parameters (6,) of the LCM that minimise the objective of a problem."""

    def minimise(self, problem: FitProblem, rng: np.random.Generator) -> Optimum:
        """The best parameters found; all randomness comes from rng."""
        ...


IntArray = NDArray[np.int64]
Stream = NDArray[np.uint64]

ETA_CROSSOVER: Final = 15.0
"""Distribution index of SBX (equations.md 9)."""
ETA_MUTATION: Final = 20.0
"""Distribution index of the polynomial mutation (equations.md 9)."""
PAIRS: Final = 128
"""Pairs bred at once."""
PAIR_ROWS: Final = 4
"""Rows of a variable of the pairs in one flat array, PAIRS each."""
# These rows: the two parents, then children; the lot that decides whether and how they are crossed; the uniform
# of the spread factor.
_FIRST, _SECOND, _LOT, _SPREAD = range(4)
# Each variable of a crossed pair is exchanged with this probability; parents closer than this are not crossed.
_CROSSED_SHARE = 0.5
_TOO_CLOSE = 1e-14
# A population that cannot vary any more (no crossover, no mutation) keeps copies after half of these batches.
_MOST_BATCHES = 200


@njit(inline="always")
def spread_factor(reach: float, u: float) -> float:
    """SBX spread factor for a uniform u when the bound lies reach half-distances away (bounded form).

    (u alpha)^(1/16) or (1 / (2 - u alpha))^(1/16), alpha = 2 - reach^-16: powers of eta + 1 = 16 are squarings
    and roots, which vectorise.
    """
    reach_4 = (reach * reach) * (reach * reach)
    reach_16 = (reach_4 * reach_4) * (reach_4 * reach_4)
    value = u * (2.0 - 1.0 / reach_16)
    value = value if value <= 1.0 else 1.0 / (2.0 - value)
    return math.sqrt(math.sqrt(math.sqrt(math.sqrt(value))))


@kernel()
def mutated(x: float, lower: float, upper: float, u: float) -> float:
    """Polynomial mutation of a variable within its bounds for a uniform u."""
    width = upper - lower
    if u <= 0.5:
        room = 1.0 - (x - lower) / width
        value = 2.0 * u + (1.0 - 2.0 * u) * room ** (ETA_MUTATION + 1.0)
        shift = value ** (1.0 / (ETA_MUTATION + 1.0)) - 1.0
    else:
        room = 1.0 - (upper - x) / width
        value = 2.0 * (1.0 - u) + 2.0 * (u - 0.5) * room ** (ETA_MUTATION + 1.0)
        shift = 1.0 - value ** (1.0 / (ETA_MUTATION + 1.0))
    return float(min(max(x + shift * width, lower), upper))


@kernel()
def _shuffle(order: IntArray, stream: Stream) -> None:
    """Fisher-Yates."""
    for i in range(len(order) - 1, 0, -1):
        j = int(next_uniform(stream) * (i + 1))
        order[i], order[j] = order[j], order[i]


@kernel()
def _winner(a: int, b: int, objectives: FloatArray) -> int:
    """Binary tournament between two of a random permutation: between equals the first wins."""
    return a if objectives[a] <= objectives[b] else b


@kernel(error_model="numpy")
def cross(width: int, lower: float, upper: float, pairs: FloatArray) -> None:
    """SBX of one variable of the pairs whose lot is below the share; its half decides who gets which value.

    pairs: the rows of that variable, flat.
    """
    for i in range(width):
        x1, x2 = pairs[_FIRST * PAIRS + i], pairs[_SECOND * PAIRS + i]
        u, lot = pairs[_SPREAD * PAIRS + i], pairs[_LOT * PAIRS + i]
        low, high = min(x1, x2), max(x1, x2)
        distance = high - low
        near = low + high - distance * spread_factor(1.0 + 2.0 * (low - lower) / distance, u)
        far = low + high + distance * spread_factor(1.0 + 2.0 * (upper - high) / distance, u)
        near, far = max(0.5 * near, lower), min(0.5 * far, upper)
        crossed = (lot < _CROSSED_SHARE) & (distance > _TOO_CLOSE)
        swapped = lot < 0.5 * _CROSSED_SHARE
        pairs[_FIRST * PAIRS + i] = (far if swapped else near) if crossed else x1
        pairs[_SECOND * PAIRS + i] = (near if swapped else far) if crossed else x2


@kernel(error_model="numpy")
def mutate(problem: FitProblem, width: int, probability: float, stream: Stream, pairs: FloatArray) -> None:
    """Mutate each variable of both children of the pairs with the given probability.

    The gaps between mutated variables are drawn (geometric), not a number for every variable.
    """
    if probability <= 0.0:
        return
    scale = 1.0 / math.log1p(-probability) if probability < 1.0 else 0.0
    place = -1
    while True:
        place += 1 + int(min(math.log(1.0 - next_uniform(stream)) * scale, 1e9))
        if place >= 12 * width:
            return
        j, child, i = place // (2 * width), place // width % 2, place % width
        i += child * PAIRS
        pairs[j, i] = mutated(pairs[j, i], problem.lower[j], problem.upper[j], next_uniform(stream))


@kernel()
def _keep(
    pairs: FloatArray,
    width: int,
    mates: IntArray,
    parents: FloatArray,
    children: FloatArray,
    n: int,
    copies: bool,
) -> int:
    """Append the children that differ from their parent (copies: all) to the n kept so far; returns the new n.

    Without a branch on what is random: a copy is written all the same, and overwritten by the next child.
    """
    for child in range(2):
        for i in range(min(width, children.shape[1] - n)):
            parent, changed = mates[2 * i + child], copies
            for j in range(6):
                value = pairs[j, child * PAIRS + i]
                children[j, n] = value
                changed |= value != parents[j, parent]
            n += int(changed)
    return n


@kernel()
def breed(
    problem: FitProblem,
    parents: FloatArray,
    objectives: FloatArray,
    probabilities: tuple[float, float],
    stream: Stream,
    pairs: FloatArray,
    children: FloatArray,
) -> None:
    """Fill children (6, n) with offspring of tournament winners that differ from their parents."""
    n, kept, position = children.shape[1], 0, children.shape[1]
    order, mates, lots = np.arange(n), np.empty(2 * PAIRS, np.int64), np.empty(PAIRS)
    for attempt in range(_MOST_BATCHES):
        if kept == n:
            return
        width = min(PAIRS, (n - kept + 1) // 2)
        for i in range(2 * width):
            if position + 2 > n:
                _shuffle(order, stream)
                position = 0
            mates[i] = _winner(int(order[position]), int(order[position + 1]), objectives)
            position += 2
        fill_uniform(stream, lots, 0, width)
        for j in range(6):
            row = pairs[j]
            fill_uniform(stream, row, _LOT * PAIRS, width)
            fill_uniform(stream, row, _SPREAD * PAIRS, width)
            for i in range(width):
                row[_FIRST * PAIRS + i] = parents[j, mates[2 * i]]
                row[_SECOND * PAIRS + i] = parents[j, mates[2 * i + 1]]
                if lots[i] >= probabilities[0]:
                    row[_LOT * PAIRS + i] = 1.0
            cross(width, problem.lower[j], problem.upper[j], row)
        mutate(problem, width, probabilities[1], stream, pairs)
        kept = _keep(pairs, width, mates, parents, children, kept, attempt >= _MOST_BATCHES // 2)


@kernel()
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


@kernel()
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


@kernel()
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
    """The paper's GA (equations.md 9). Probabilities: crossover a pair, mutation a variable."""

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
        """pymoo's GA with the operators of this module."""
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
