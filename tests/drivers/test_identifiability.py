import numpy as np
import pytest
from made_followers import NOISE_FREE, NOISY, follower

from highd_lc.core.car_following import objectives_of
from highd_lc.drivers.calibration import fit_follower, pose
from highd_lc.drivers.identifiability import (
    TOLERANCE,
    _interval,
    _partners,
    correlations,
    identifiability,
    profile,
    spread_over_seeds,
    verdict,
)
from highd_lc.drivers.least_squares import curvature, descend
from highd_lc.vocab.settings import CalibrateSettings

SETTINGS = CalibrateSettings(optimiser="screen")


def fitted(seed, noise=NOISY):
    track, truth = follower(np.random.default_rng(seed), n_samples=81, noise=noise)
    return track, pose(track, SETTINGS), fit_follower(track, SETTINGS, seed=seed), truth


@pytest.mark.parametrize("parameter", range(6))
def test_profile_is_least_at_the_fit_and_is_reached(parameter):
    _, problem, fit, _ = fitted(1)
    found = profile(problem, fit.parameters, parameter, rng=np.random.default_rng(0))
    assert (np.diff(found.values) >= 0).all()
    assert len(found.values) == 17
    at_fit = found.objectives[np.searchsorted(found.values, fit.parameters[parameter])]
    assert at_fit <= fit.objective * (1 + 1e-9)
    assert found.objectives.min() >= 0.98 * at_fit
    assert found.low <= fit.parameters[parameter] <= found.high
    # Never above the objective with only this parameter moved.
    moved = np.repeat(fit.parameters[:, None], len(found.values), axis=1)
    moved[parameter] = found.values
    assert (found.objectives <= objectives_of(problem, moved) * (1 + 1e-9)).all()


def test_interval_ends_where_the_profile_leaves_the_tolerance():
    values = np.linspace(-3.0, 3.0, 13)
    limit = np.sqrt(TOLERANCE)
    low, high = _interval(values, 1.0 + values**2, 6)
    # Linear between the values: from 0 to 0.5 the objective rises by 0.25.
    assert -low == high == pytest.approx(0.5 * TOLERANCE / 0.25)
    assert high < limit
    assert _interval(values, np.ones(13), 6) == (-3.0, 3.0)
    flat_left = np.where(values <= 0, 1.0, 2.0)
    assert _interval(values, flat_left, 6) == (-3.0, pytest.approx(0.5 * TOLERANCE))


def test_interval_of_an_exact_fit_holds_the_truth():
    """Noise-free data determine all of v_desire, A, b, B, and tau against L only through their sum."""
    _, problem, fit, truth = fitted(2, NOISE_FREE)
    for j in range(4):
        found = profile(problem, fit.parameters, j, rng=np.random.default_rng(0))
        nearest = np.diff(np.linspace(problem.lower[j], problem.upper[j], 16))[0]
        assert found.low - nearest <= truth[j] <= found.high + nearest


def test_correlations_are_those_of_the_curvature():
    _, problem, fit, _ = fitted(3, NOISE_FREE)
    inside = np.clip(fit.parameters, problem.lower + 0.05, problem.upper - 0.05)
    found = correlations(problem, inside)
    np.testing.assert_allclose(np.diag(found), 1.0)
    np.testing.assert_allclose(found, found.T, atol=1e-5)
    assert (np.abs(found) <= 1 + 1e-9).all()
    _, hessian = curvature(problem, inside)
    scale = problem.upper - problem.lower
    scaled = hessian * np.outer(scale, scale)
    covariance = np.linalg.inv(scaled + 1e-12 * np.trace(scaled) * np.eye(6))
    deviation = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(found, covariance / np.outer(deviation, deviation), atol=1e-5)


def test_parameters_on_a_bound_have_no_correlation():
    _, problem, fit, _ = fitted(3)
    on_bound = fit.parameters.copy()
    on_bound[[1, 5]] = problem.upper[1], problem.lower[5]
    found = correlations(problem, on_bound)
    assert np.isnan(found[[1, 5]]).all()
    assert np.isnan(found[:, [1, 5]]).all()


def test_partner_is_the_most_correlated_where_it_is_known():
    matrices = np.full((3, 6, 6), np.nan)
    matrices[:, 0, 1] = matrices[:, 1, 0] = [0.5, 0.7, np.nan]
    matrices[0, 0, 2] = matrices[0, 2, 0] = 0.9
    partner, correlation = _partners(matrices)
    assert partner.tolist() == [2, 0, 0, -1, -1, -1]
    np.testing.assert_allclose(correlation[:3], [0.9, 0.6, 0.9])
    assert np.isnan(correlation[3:]).all()


def test_the_ga_spreads_over_seeds_where_the_data_say_little():
    _, problem, _, _ = fitted(4)
    spread = spread_over_seeds(problem, range(4))
    assert spread.shape == (6,)
    assert (spread > 0).all()
    assert (spread == spread_over_seeds(problem, range(4))).all()


def test_study_of_a_sample():
    sample = [fitted(seed) for seed in range(4)]
    study = identifiability(
        [track for track, *_ in sample],
        [fit.parameters for _, _, fit, _ in sample],
        SETTINGS,
        seeds=range(4),
        repeats=2,
    )
    assert study.n == 4
    for values in (study.width, study.share_open):
        assert ((values >= 0) & (values <= 1)).all()
    # tau is worth v tau metres of spacing, L the spacing itself: they trade against each other.
    assert study.width[4] < study.width[5]


def test_a_parameter_is_believed_only_if_narrow_and_off_its_bounds():
    assert verdict(0.1, 0.05) == "believed"
    assert verdict(0.1, 0.2) == "weak"
    assert verdict(0.5, 0.0) == "weak"
    assert verdict(0.1, 0.5) == "not identifiable"
    assert verdict(0.9, 0.0) == "not identifiable"


def test_pinned_descent_is_what_the_profile_uses():
    _, problem, fit, _ = fitted(5)
    points, _ = descend(problem, fit.parameters[:, None], iterations=5, pinned=4)
    assert points[4, 0] == fit.parameters[4]
