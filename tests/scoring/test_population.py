"""Population statistics against their definitions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from highd_lc.scoring.population import (
    Bootstrap,
    hodges_lehmann,
    mean_interval,
    ratio_interval,
    recording_sums,
    shares,
)

DRAWS = Bootstrap(samples=4000, confidence=0.95, seed=3)


@given(arrays(float, st.integers(1, 30), elements=st.floats(-100, 100)))
def test_hodges_lehmann_is_the_median_of_pair_means(values):
    i, j = np.triu_indices(len(values))
    assert hodges_lehmann(values) == pytest.approx(np.median((values[i] + values[j]) / 2), abs=1e-9)


def test_hodges_lehmann_of_nothing_is_unavailable():
    assert np.isnan(hodges_lehmann(np.empty(0)))


def test_a_shift_moves_it_and_an_outlier_hardly_does():
    values = np.random.default_rng(0).normal(size=201)
    assert hodges_lehmann(values + 5.0) == pytest.approx(hodges_lehmann(values) + 5.0)
    spoilt = values.copy()
    spoilt[0] = 1e6
    assert hodges_lehmann(spoilt) == pytest.approx(hodges_lehmann(values), abs=0.05)


def test_shares_add_up_and_ties_lie_within_the_band():
    better, worse, tied = shares(np.array([-0.1, -0.0005, 0.0, 0.0009, 0.5]), 0.001)
    assert (better, worse) == (0.2, 0.2)
    assert tied == pytest.approx(0.6)
    assert np.isnan(shares(np.empty(0), 0.001)).all()


def test_sums_by_recording():
    found = recording_sums(np.array([7, 2, 7]), np.array([1.0, 2.0, 3.0]), np.ones(3))
    np.testing.assert_array_equal(found, [[2.0, 4.0], [1.0, 2.0]])


def test_intervals_cover_the_truth_as_often_as_they_say():
    rng, hits = np.random.default_rng(1), 0
    recordings = np.repeat(np.arange(30), 10)
    for _ in range(200):
        effect = np.repeat(rng.normal(0.0, 1.0, 30), 10) + rng.normal(0.0, 0.5, 300)
        interval = mean_interval(recordings, 2.0 + effect, Bootstrap(400, 0.9, 1))
        hits += interval.low <= 2.0 <= interval.high
    # 90 % of 200, less what the bootstrap of 30 recordings is known to lose, three standard errors wide.
    assert 0.80 <= hits / 200 <= 0.96


def test_events_of_one_recording_stand_and_fall_together():
    rng = np.random.default_rng(2)
    values = np.repeat(rng.normal(size=20), 25)
    together = mean_interval(np.repeat(np.arange(20), 25), values, DRAWS)
    apart = mean_interval(np.arange(500), values, DRAWS)
    assert together.high - together.low > 3 * (apart.high - apart.low)


def test_a_ratio_of_sums_is_not_a_mean_of_ratios():
    interval = ratio_interval(np.array([1, 2]), np.array([1.0, 90.0]), np.array([2.0, 100.0]), DRAWS)
    assert interval.low == pytest.approx(0.5)
    assert interval.high == pytest.approx(0.9)


def test_one_recording_says_nothing_about_its_spread():
    interval = mean_interval(np.ones(5, int), np.arange(5.0), DRAWS)
    assert np.isnan([interval.low, interval.high]).all()


def test_the_same_seed_draws_the_same():
    recordings, values = np.arange(10), np.random.default_rng(0).normal(size=10)
    assert mean_interval(recordings, values, DRAWS) == mean_interval(recordings[::-1], values[::-1], DRAWS)
    other = mean_interval(recordings, values, Bootstrap(4000, 0.95, 4))
    assert other != mean_interval(recordings, values, DRAWS)
