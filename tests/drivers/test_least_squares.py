import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_followers import NOISE_FREE, NOISY, follower
from scipy.optimize import approx_fprime, least_squares

from highd_lc.core.car_following import fit_problem, objectives_of
from highd_lc.drivers import least_squares as kernel
from highd_lc.drivers.least_squares import STARTS, Screening, curvature, descend, screen
from highd_lc.vocab.driver import LOWER_BOUNDS, TABLE3_MEANS, UPPER_BOUNDS

LOWER, UPPER = LOWER_BOUNDS.as_array(), UPPER_BOUNDS.as_array()
MODES = [(open_loop, delayed) for open_loop in (False, True) for delayed in (False, True)]


def problem_of(seed, *, noise=NOISY, open_loop=False, delayed=False):
    track, _ = follower(np.random.default_rng(seed), n_samples=61, noise=noise)
    return fit_problem(track, LOWER, UPPER, open_loop=open_loop, delayed=delayed)


def random_starts(seed, n=STARTS):
    return LOWER[:, None] + np.random.default_rng(seed).random((6, n)) * (UPPER - LOWER)[:, None]


@pytest.mark.parametrize(("open_loop", "delayed"), MODES)
def test_gradient_of_the_majorant_is_the_objectives(open_loop, delayed):
    problem = problem_of(1, open_loop=open_loop, delayed=delayed)
    strength = np.array([1e-4, 1e-3, 1e-3, 1e-3, 1e-2, 1e-3])
    problem = problem._replace(centre=TABLE3_MEANS.as_array(), strength=strength)
    points = 0.5 * (random_starts(2, 8) + TABLE3_MEANS.as_array()[:, None])
    for point in points.T:
        gradient, hessian = curvature(problem, point)
        assert (np.linalg.eigvalsh(hessian) > -1e-9 * np.abs(hessian).max()).all()
        expected = approx_fprime(point, lambda p: objectives_of(problem, p[:, None])[0], 1e-7)
        np.testing.assert_allclose(gradient, expected, rtol=2e-3, atol=2e-5 * np.abs(expected).max())


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 1.0, 1e5]))
@settings(max_examples=200, deadline=None)
def test_step_stays_in_the_box_and_solves_what_is_free(seed, damping):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(6, 6))
    hessian, gradient = root @ root.T + 0.1 * np.eye(6), 30.0 * rng.normal(size=6)
    point = LOWER + np.where(rng.random(6) < 0.3, 0.0, rng.random(6)) * (UPPER - LOWER)
    step, equations = np.empty(6), np.concatenate([hessian[np.tril_indices(6)], gradient])
    kernel._bounded_step(problem_of(0), equations, damping, point, -1, step)
    target = point + step
    assert (target >= LOWER - 1e-9).all()
    assert (target <= UPPER + 1e-9).all()
    free = (target > LOWER + 1e-9) & (target < UPPER - 1e-9)
    damped = hessian + damping * np.diag(np.diag(hessian))
    np.testing.assert_allclose((damped @ step + gradient)[free], 0.0, atol=1e-6)
    if damping > 1e3:
        assert gradient @ step <= 0.0


@pytest.mark.parametrize(("open_loop", "delayed"), MODES)
def test_starts_improve_within_bounds_and_report_their_objective(open_loop, delayed):
    problem = problem_of(3, open_loop=open_loop, delayed=delayed)
    starts = random_starts(4)
    before = objectives_of(problem, starts)
    points, objectives = descend(problem, starts, iterations=15)
    assert (objectives <= before).all()
    assert (points >= LOWER[:, None]).all()
    assert (points <= UPPER[:, None]).all()
    np.testing.assert_allclose(objectives, objectives_of(problem, points), rtol=1e-12)
    assert np.median(objectives / before) < 0.5


def test_starts_do_not_influence_each_other():
    problem, starts = problem_of(5), random_starts(6)
    together, _ = descend(problem, starts, iterations=10)
    for s in (0, 13, 31):
        alone, _ = descend(problem, starts[:, s : s + 1], iterations=10)
        np.testing.assert_array_equal(alone[:, 0], together[:, s])


def test_no_iteration_leaves_the_starts():
    problem, starts = problem_of(5), random_starts(6, 3)
    points, objectives = descend(problem, starts, iterations=0)
    np.testing.assert_array_equal(points, starts)
    np.testing.assert_array_equal(objectives, objectives_of(problem, starts))


@pytest.mark.parametrize("seed", range(5))
def test_open_loop_optimum_is_scipys(seed):
    """The paper's objective is a sum of squares: scipy's bounded least squares is the reference."""
    problem = problem_of(seed, open_loop=True)
    track, scale = problem.track, np.sqrt(problem.weights[2] / np.maximum(np.abs(problem.track[4]), 0.1))
    v, leader_v, spacing = track[3], track[1], track[0] - track[2]

    def residuals(p):
        desired = np.maximum(v**2 / (2 * p[2]) - leader_v**2 / (2 * p[3]) + v * p[4] + p[5], p[5])
        closeness = np.exp(np.minimum(1 - spacing / desired, 40.0))
        return scale * (p[1] * (1 - v / p[0] - closeness) - track[4])

    starts = screen(problem, np.random.default_rng(0), count=2048, keep=4)
    theirs = min(2 * least_squares(residuals, s, bounds=(LOWER, UPPER), x_scale=UPPER).cost for s in starts.T)
    ours = Screening().minimise(problem, np.random.default_rng(0)).objective
    assert ours <= theirs * (1 + 1e-6)


def test_screening_finds_the_best_known_of_noisy_fits():
    for seed in range(10):
        problem = problem_of(seed)
        found = Screening().minimise(problem, np.random.default_rng(seed)).objective
        wide = screen(problem, np.random.default_rng(seed + 100), count=8192, keep=STARTS)
        best = min(found, descend(problem, wide, iterations=100)[1].min())
        assert found <= 1.02 * best


def test_screening_solves_noise_free_fits():
    found = [
        Screening().minimise(problem_of(seed, noise=NOISE_FREE), np.random.default_rng(seed)).objective
        for seed in range(20)
    ]
    assert max(found) < 1e-3


def test_screen_keeps_the_best_of_a_seeded_sequence():
    problem = problem_of(0)
    found = objectives_of(problem, screen(problem, np.random.default_rng(1), count=500, keep=7))
    everything = objectives_of(problem, screen(problem, np.random.default_rng(1), count=500, keep=500))
    np.testing.assert_array_equal(found, np.sort(everything)[:7])


@pytest.mark.parametrize("pinned", range(6))
def test_a_pinned_parameter_keeps_each_starts_value(pinned):
    problem, starts = problem_of(7), random_starts(8)
    points, objectives = descend(problem, starts, iterations=10, pinned=pinned)
    np.testing.assert_array_equal(points[pinned], starts[pinned])
    assert (objectives < objectives_of(problem, starts)).any()
