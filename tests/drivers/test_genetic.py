from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_followers import NOISE_FREE, NOISY, follower
from pymoo.operators.crossover.sbx import cross_sbx
from pymoo.operators.mutation.pm import mut_pm
from scipy.stats import ks_2samp, mannwhitneyu

from highd_lc.core.car_following import fit_problem, new_scratch, objectives_of
from highd_lc.core.kernels import new_stream
from highd_lc.drivers import genetic
from highd_lc.drivers.genetic import (
    PAIRS,
    GeneticAlgorithm,
    PymooGeneticAlgorithm,
    breed,
    cross,
    mutate,
    mutated,
    spread_factor,
)
from highd_lc.vocab.driver import LOWER_BOUNDS, UPPER_BOUNDS

LOWER, UPPER = LOWER_BOUNDS.as_array(), UPPER_BOUNDS.as_array()


def problem_of(seed, noise=NOISY):
    track, _ = follower(np.random.default_rng(seed), n_samples=61, noise=noise)
    return fit_problem(track, LOWER, UPPER)


def random_population(rng, n):
    return LOWER[:, None] + rng.random((6, n)) * (UPPER - LOWER)[:, None]


@given(st.floats(1.0, 1e6), st.floats(0.0, 1.0, exclude_max=True))
@settings(max_examples=200, deadline=None)
def test_spread_factor_is_the_bounded_sbx(reach, u):
    alpha = 2.0 - reach**-16.0
    expected = (u * alpha) ** (1 / 16) if u <= 1 / alpha else (1 / (2 - u * alpha)) ** (1 / 16)
    assert spread_factor(reach, u) == pytest.approx(expected, rel=1e-9, abs=1e-9)


@given(st.floats(2.0, 10.0), st.floats(0.0, 1.0, exclude_max=True))
@settings(max_examples=200, deadline=None)
def test_mutation_stays_within_bounds_and_keeps_the_middle(x, u):
    assert 2.0 <= mutated(x, 2.0, 10.0, u) <= 10.0
    assert mutated(x, 2.0, 10.0, 0.5) == pytest.approx(x, abs=1e-9)


def test_mutation_has_pymoos_distribution():
    rng, n = np.random.default_rng(1), 20_000
    ours = [mutated(3.0, 2.0, 10.0, u) for u in rng.random(n)]
    args = (np.full((n, 1), 3.0), np.array([2.0]), np.array([10.0]), np.full(n, 20.0), np.ones(n), False)
    theirs = mut_pm(*args, random_state=np.random.default_rng(2))
    assert ks_2samp(ours, theirs[:, 0]).pvalue > 0.01


def test_crossover_has_pymoos_distribution():
    """First child of parents 3 and 4.5 in [2, 10]: crossed in half of the cases, values exchanged by a coin."""
    rng, rounds = np.random.default_rng(3), 200
    pairs, ours = np.empty(4 * PAIRS), []
    for _ in range(rounds):
        pairs[:PAIRS], pairs[PAIRS : 2 * PAIRS], pairs[2 * PAIRS :] = 3.0, 4.5, rng.random(2 * PAIRS)
        cross(PAIRS, 2.0, 10.0, pairs)
        ours.append(pairs[:PAIRS].copy())
    parents = np.repeat([[[3.0]], [[4.5]]], rounds * PAIRS, axis=1)
    eta, share = np.full((rounds * PAIRS, 1), 15.0), np.full((rounds * PAIRS, 1), 0.5)
    theirs = cross_sbx(
        parents, np.array([2.0]), np.array([10.0]), eta, 0.5, share, random_state=np.random.default_rng(4)
    )
    ours = np.concatenate(ours)
    assert np.mean(ours == 3.0) == pytest.approx(0.5, abs=0.015)
    assert ks_2samp(ours, theirs[0, :, 0]).pvalue > 0.01


def test_mutation_probability_is_a_variables():
    problem, n = problem_of(0), 0
    for round_ in range(200):
        pairs = np.full((6, 4 * PAIRS), 6.0)
        mutate(problem, PAIRS, 0.05, new_stream(np.random.default_rng(round_)), pairs)
        assert (pairs[:, 2 * PAIRS :] == 6.0).all()
        n += np.sum(pairs != 6.0)
    # binomial: standard deviation of the share is 0.0004
    assert n / (200 * 12 * PAIRS) == pytest.approx(0.05, abs=0.0016)


@pytest.mark.parametrize("n", [4, 5, 200, 301])
def test_children_are_within_bounds_and_no_copies(n):
    rng, problem = np.random.default_rng(n), problem_of(0)
    parents, children = random_population(rng, n), np.empty((6, n))
    pairs = np.empty((6, 4 * PAIRS))
    breed(problem, parents, rng.random(n), (0.95, 0.05), new_stream(rng), pairs, children)
    assert (children >= LOWER[:, None]).all()
    assert (children <= UPPER[:, None]).all()
    same = (children[:, :, None] == parents[:, None, :]).all(axis=0)
    assert not same.any()


def test_a_population_that_cannot_vary_ends():
    optimum = GeneticAlgorithm(10, 5, 0.0, 0.0).minimise(problem_of(0), np.random.default_rng(0))
    assert np.isfinite(optimum.objective)


@given(st.integers(2, 60), st.integers(0, 2**32 - 1), st.integers(1, 20))
@settings(max_examples=100, deadline=None)
def test_the_best_of_parents_and_children_survive(n, seed, distinct):
    rng = np.random.default_rng(seed)
    objectives, child_objectives = rng.integers(0, distinct, (2, n)).astype(float)
    parents, children = np.tile(objectives, (6, 1)), np.tile(child_objectives, (6, 1))
    expected = np.sort(np.concatenate([objectives, child_objectives]))[:n]
    genetic._survive(parents, objectives, children, child_objectives, np.empty(2 * n))
    np.testing.assert_array_equal(np.sort(objectives), expected)
    np.testing.assert_array_equal(parents, np.tile(objectives, (6, 1)))


def test_the_best_never_gets_worse():
    problem, n = problem_of(1), 40
    found = []
    for generations in (1, 2, 5, 10, 40):
        rng = np.random.default_rng(7)
        population, stream = random_population(rng, n), new_stream(rng)
        scratch = new_scratch(problem.track.shape[1])
        found.append(genetic._evolve(problem, population, generations, (0.95, 0.05), stream, *scratch).min())
    assert found == sorted(found, reverse=True)
    assert found[-1] < found[0]


def test_the_same_seed_gives_the_same_optimum_in_any_thread():
    problems = [problem_of(seed) for seed in range(6)]
    method = GeneticAlgorithm(50, 20)

    def fit(seed):
        return method.minimise(problems[seed], np.random.default_rng(seed)).parameters

    alone = [fit(seed) for seed in range(6)]
    with ThreadPoolExecutor(4) as threads:
        together = list(threads.map(fit, reversed(range(6))))
    np.testing.assert_array_equal(alone, together[::-1])


def test_optimum_is_its_parameters_objective():
    problem = problem_of(2)
    for method in (GeneticAlgorithm(30, 10), PymooGeneticAlgorithm(30, 10)):
        optimum = method.minimise(problem, np.random.default_rng(1))
        assert optimum.objective == objectives_of(problem, optimum.parameters[:, None])[0]
        assert optimum.evaluations == 300


def test_parents_are_winners_of_two_tournaments_each():
    """Without crossover and mutation the children are the winners: the best twice, the worst never."""
    n, rng = 100, np.random.default_rng(0)
    parents, children = random_population(rng, n), np.empty((6, n))
    pairs = np.empty((6, 4 * PAIRS))
    breed(problem_of(0), parents, np.arange(n) * 1.0, (0.0, 0.0), new_stream(rng), pairs, children)
    wins = [(children == parents[:, i : i + 1]).all(axis=0).sum() for i in range(n)]
    assert sum(wins) == n
    assert max(wins) == wins[0] == 2
    assert wins[-1] == 0
    # Two tournaments against random rivals: the median individual wins one on average.
    assert np.mean(wins[: n // 2]) == pytest.approx(1.5, abs=0.15)


# A problem and a size at which a wrong operator shows in the final objectives; seeds are fixed.
_TELLING, _SIZE = (4, NOISE_FREE), (60, 60)


def final_objectives(method, problem, runs):
    return [method.minimise(problem, np.random.default_rng(run)).objective for run in range(runs)]


@pytest.mark.parametrize(("problem", "runs"), [(_TELLING, 30), ((3, NOISY), 12)])
def test_final_objectives_have_pymoos_distribution(problem, runs):
    problem = problem_of(*problem)
    ours = final_objectives(GeneticAlgorithm(*_SIZE), problem, 200)
    theirs = final_objectives(PymooGeneticAlgorithm(*_SIZE), problem, runs)
    assert mannwhitneyu(ours, theirs).pvalue > 0.01
    assert ks_2samp(ours, theirs).pvalue > 0.01


def test_the_rank_test_notices_a_missing_operator():
    problem = problem_of(*_TELLING)
    ours = final_objectives(GeneticAlgorithm(*_SIZE), problem, 200)
    theirs = final_objectives(GeneticAlgorithm(*_SIZE, mutation_probability=0.0), problem, 30)
    assert mannwhitneyu(ours, theirs).pvalue < 1e-3
