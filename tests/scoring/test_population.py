"""Population statistics against their definitions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import stats

from highd_lc.scoring.population import (
    Bootstrap,
    gain_of_added,
    hodges_lehmann,
    mean_interval,
    ratio_interval,
    recording_sums,
    share_carried,
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


def skewed(rng, clusters, events=40):
    """Savings and losses of events: half save nothing, few save most; clusters of unequal size."""
    sizes = rng.integers(events // 3, 2 * events, clusters)
    recordings = np.repeat(np.arange(clusters), sizes)
    saved = np.where(rng.random(len(recordings)) < 0.5, 0.0, rng.lognormal(0.0, 1.18, len(recordings)))
    return (
        recordings,
        saved * rng.lognormal(0.0, 0.3, clusters)[recordings],
        rng.lognormal(3.0, 0.5, len(recordings)),
    )


def coverage(method, clusters, draws=300):
    rng, hits = np.random.default_rng(1), 0
    truth = 0.5 * np.exp(1.18**2 / 2 + 0.3**2 / 2) / np.exp(3.0 + 0.5**2 / 2)
    for _ in range(draws):
        found = ratio_interval(*skewed(rng, clusters), Bootstrap(499, 0.95, 1, method))
        hits += found.low <= truth <= found.high
    return hits / draws


def test_intervals_of_eight_clusters_cover_the_truth_as_often_as_they_say():
    # Two and a half standard errors of 300 draws about 95 %.
    assert 0.92 <= coverage("bootstrap_t", 8) <= 0.98


def test_percentiles_of_eight_clusters_do_not():
    assert coverage("percentile", 8) < 0.91


@pytest.mark.parametrize("confidence", [0.8, 0.95])
def test_student_s_interval_of_a_mean_is_scipy_s(confidence):
    rng = np.random.default_rng(5)
    each = rng.normal(3.0, 1.0, 7)
    found = mean_interval(np.repeat(np.arange(7), 4), np.repeat(each, 4), Bootstrap(100, confidence, 1, "t"))
    low, high = stats.t.interval(confidence, 6, loc=each.mean(), scale=stats.sem(each))
    assert (found.low, found.high) == (pytest.approx(low), pytest.approx(high))


def test_the_default_is_never_shorter_than_student_s_over_the_jackknife():
    rng = np.random.default_rng(6)
    recordings, saved, losses = skewed(rng, 12)
    found = ratio_interval(recordings, saved, losses, DRAWS)
    above, below = recording_sums(recordings, saved, losses)
    ratio = saved.sum() / losses.sum()
    pseudo = 12 * ratio - 11 * (above.sum() - above) / (below.sum() - below)
    reach = stats.t.ppf(0.975, 11) * stats.sem(pseudo)
    assert found.low <= ratio - reach + 1e-12
    assert found.high > ratio + reach  # the tail lies above


@pytest.mark.parametrize("method", ["bootstrap_t", "t"])
def test_below_five_clusters_there_is_no_interval(method):
    draws = Bootstrap(200, 0.95, 1, method)
    values = np.random.default_rng(0).normal(size=20)
    four, five = (mean_interval(np.arange(20) % n, values, draws) for n in (4, 5))
    assert np.isnan([four.low, four.high]).all()
    assert five.low < values.mean() < five.high


def test_a_sum_that_may_be_nothing_has_no_interval_below_the_line():
    one = np.arange(1.0, 9.0)
    found = ratio_interval(np.arange(8), one, np.array([9.0, -1.0, -1.0, -1.0, -1.0, -1.0, -1.0, -1.0]), DRAWS)
    assert np.isnan([found.low, found.high]).all()


def test_the_gain_of_what_is_added():
    clusters = np.arange(6)
    gain, low, high = gain_of_added(np.full(6, 4.0), np.array([3.0, 3.1, 2.9, 3.0, 3.2, 2.8]), clusters, DRAWS)
    assert gain == pytest.approx(0.25)
    assert low < 0.25 < high
    assert np.isnan(gain_of_added(np.array([1.0, -1.0] * 3), np.ones(6), clusters, DRAWS)).all()


def test_what_the_largest_carry():
    assert share_carried(np.array([46.0, *np.full(19, 54.0 / 19)])) == pytest.approx(0.46)
    assert share_carried(np.array([3.0, 1.0])) == pytest.approx(0.75)
    assert np.isnan(share_carried(np.zeros(4)))
    assert np.isnan(share_carried(np.empty(0)))


def test_events_of_one_recording_stand_and_fall_together():
    rng = np.random.default_rng(2)
    values = np.repeat(rng.normal(size=20), 25)
    together = mean_interval(np.repeat(np.arange(20), 25), values, DRAWS)
    apart = mean_interval(np.arange(500), values, DRAWS)
    assert together.high - together.low > 3 * (apart.high - apart.low)


def test_a_ratio_of_sums_is_not_a_mean_of_ratios():
    percentile = Bootstrap(4000, 0.95, 3, "percentile")
    interval = ratio_interval(np.array([1, 2]), np.array([1.0, 90.0]), np.array([2.0, 100.0]), percentile)
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


def test_a_sum_that_mostly_cancels_has_no_share():
    """Of 10 added in some events 9.5 are taken away in others: a ratio to the rest could be anything."""
    benchmark = np.array([5.0, 5.0, -4.75, -4.75, 0.0])
    found = gain_of_added(benchmark, benchmark - 1.0, np.arange(5), Bootstrap(200, 0.95, 1))
    assert np.isnan(found).all()
    kept = np.array([5.0, 5.0, -1.0, -1.0, 0.0])
    assert gain_of_added(kept, 0.5 * kept, np.arange(5), Bootstrap(200, 0.95, 1))[0] == pytest.approx(0.5)


def test_one_cluster_that_carries_everything_has_no_interval():
    """Draws without it do not vary at all: the studentised deviations, and so the ends, would be of any size."""
    above = np.array([1.0, 1e-6, 1.1e-6, 0.9e-6, 1.05e-6, 0.95e-6])
    found = ratio_interval(np.arange(6), above, np.ones(6), Bootstrap(500, 0.95, 1))
    assert np.isnan([found.low, found.high]).all()
    even = ratio_interval(np.arange(6), 1.0 + 0.1 * np.arange(6), np.ones(6), Bootstrap(500, 0.95, 1))
    assert even.low < 1.25 < even.high
