import numpy as np
import pytest
from made_followers import NOISE_FREE, NOISY, follower

from highd_lc.core.car_following import objectives_of
from highd_lc.drivers.calibration import Prior, common_driver, fit_follower, penalised, pool_of, pose
from highd_lc.drivers.identifiability import (
    EVERYBODY,
    STRENGTHS,
    FittedDrivers,
    _judge,
    pool_drivers,
    refit,
    split,
    study_pooling,
)
from highd_lc.vocab.driver import LOWER_BOUNDS, TABLE3_MEANS, UPPER_BOUNDS
from highd_lc.vocab.settings import CalibrateSettings

SETTINGS = CalibrateSettings(optimiser="screen", screened=512)
TRACKS = [follower(np.random.default_rng(seed), n_samples=81, noise=NOISY)[0] for seed in range(8)]


def drivers(n=8):
    fits = [fit_follower(track, SETTINGS, seed=i) for i, track in enumerate(TRACKS[:n])]
    classes = tuple("Truck" if i % 3 == 2 else "Car" for i in range(n))
    return FittedDrivers(tuple(TRACKS[:n]), np.array([f.parameters for f in fits]), classes, tuple(range(n)))


def test_pool_is_the_median_and_the_normals_quartile_range():
    fits = TABLE3_MEANS.as_array() * (1 + 0.1 * np.random.default_rng(0).normal(size=(20_001, 6)))
    prior = pool_of(fits, 0.5)
    np.testing.assert_allclose(prior.centre, TABLE3_MEANS.as_array(), rtol=5e-3)
    floor = 0.05 * (UPPER_BOUNDS.as_array() - LOWER_BOUNDS.as_array())
    np.testing.assert_allclose(prior.scale, np.maximum(0.1 * TABLE3_MEANS.as_array(), floor), rtol=0.03)
    assert prior.strength == 0.5


def test_penalty_is_the_squared_distance_in_scales():
    problem, centre = pose(TRACKS[0], SETTINGS), TABLE3_MEANS.as_array()
    scale = np.arange(1.0, 7.0)
    drawn = penalised(problem, Prior(centre, scale, 0.3))
    away = centre + 0.5 * scale * np.array([1, 1, -1, 1, 1, 0])
    added = objectives_of(drawn, away[:, None]) - objectives_of(problem, away[:, None])
    assert added[0] == pytest.approx(0.3 * 5 * 0.25)


def test_common_driver_has_the_least_mean_objective():
    pool = drivers()
    problems = [pose(track, SETTINGS) for track in pool.tracks]
    table = np.array([[objectives_of(p, q[:, None])[0] for q in pool.parameters] for p in problems])
    assert common_driver(problems, pool.parameters) == np.argmin(table.mean(axis=0))


def test_pools_are_driven_by_members_of_the_class():
    pool = drivers()
    elected = pool_drivers(pool, SETTINGS, rng=np.random.default_rng(0))
    assert set(elected) == {"Car", "Truck", EVERYBODY}
    assert pool.classes[elected["Truck"]] == "Truck"
    assert pool.classes[elected["Car"]] == "Car"
    nobody = FittedDrivers((), np.empty((0, 6)), (), ())
    assert pool_drivers(nobody, SETTINGS, rng=np.random.default_rng(0)) == {}


def test_split_keeps_every_sample_once():
    first, last = split(TRACKS[0])
    np.testing.assert_array_equal(np.concatenate([first.x, last.x]), TRACKS[0].x)
    assert len(last.x) == 27


def test_refit_with_strength_zero_is_the_own_fit():
    pool = drivers(3)
    for fit, own in zip(refit(pool, SETTINGS, strength=0.0), pool.parameters, strict=True):
        np.testing.assert_array_equal(fit.parameters, own)


def test_refits_move_towards_the_pool_with_the_strength():
    pool = drivers()
    own = pool_of(pool.parameters, 1.0)
    distances = []
    for strength in (0.0, 1e-3, 1.0):
        fits = refit(pool, SETTINGS, strength=strength)
        distances.append(np.mean([np.abs((f.parameters - own.centre) / own.scale) for f in fits]))
        assert all((f.parameters >= LOWER_BOUNDS.as_array()).all() for f in fits)
    assert distances == sorted(distances, reverse=True)


def test_study_compares_the_strengths_out_of_sample():
    study = study_pooling(TRACKS, SETTINGS, rng=np.random.default_rng(1))
    assert study.errors.shape == (8, len(STRENGTHS))
    assert np.isfinite(study.errors).all()
    assert sorted(study.fold.tolist()) == [0, 0, 1, 1, 2, 2, 3, 4]
    assert len(study.chosen) == 5
    assert study.best_strength in STRENGTHS[:-1]
    again = study_pooling(TRACKS, SETTINGS, rng=np.random.default_rng(1))
    np.testing.assert_array_equal(study.errors, again.errors)


def test_identical_drivers_without_noise_gain_nothing_and_lose_nothing():
    """Exact data of exact models: the own fit predicts the held-out third, so nothing can be gained."""
    tracks = [follower(np.random.default_rng(s), n_samples=81, noise=NOISE_FREE)[0] for s in range(4)]
    study = study_pooling(tracks, SETTINGS, rng=np.random.default_rng(1))
    assert np.median(study.errors[:, 0]) < 5e-3
    assert study.errors[:, -1].mean() > study.errors[:, 0].mean()


def test_strength_is_chosen_without_the_fold_it_is_judged_on():
    errors = np.full((4, len(STRENGTHS)), 9.0)
    errors[:2, 1], errors[2:, 3] = 1.0, 1.0
    study = _judge(errors, np.array([0, 0, 1, 1]))
    assert study.chosen == (STRENGTHS[3], STRENGTHS[1])
