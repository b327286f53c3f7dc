import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from highd_lc.scoring.uncertainty import event_generator, parameter_draws, stratified_sample
from highd_lc.vocab.driver import LOWER_BOUNDS, REPLAY_L_BOUNDS, TABLE3_MEANS, UPPER_BOUNDS

STRATA = {f"{k % 7:02d}-{k:04d}-00100": ("Truck" if k % 5 == 0 else "Car", k % 2) for k in range(200)}


def test_generator_belongs_to_seed_event_and_purpose():
    first = event_generator(1, "a", purpose="x").random(3)
    assert np.array_equal(first, event_generator(1, "a", purpose="x").random(3))
    for other in (event_generator(2, "a", purpose="x"), event_generator(1, "b", purpose="x"),
                  event_generator(1, "a", purpose="y")):  # fmt: skip
        assert not np.array_equal(first, other.random(3))


def test_sample_gives_every_stratum_its_share():
    chosen = stratified_sample(STRATA, 50, seed=3)
    assert len(chosen) == 50
    for stratum in set(STRATA.values()):
        members = [event for event, own in STRATA.items() if own == stratum]
        assert abs(len(chosen & set(members)) - 50 * len(members) / len(STRATA)) < 1.0


def test_sample_does_not_depend_on_the_order_but_on_the_seed():
    backwards = dict(reversed(list(STRATA.items())))
    assert stratified_sample(backwards, 50, seed=3) == stratified_sample(STRATA, 50, seed=3)
    assert stratified_sample(STRATA, 50, seed=4) != stratified_sample(STRATA, 50, seed=3)


@given(st.dictionaries(st.text(min_size=1, max_size=4), st.integers(0, 3), max_size=30), st.integers(0, 40))
def test_sample_has_the_size_asked_for(strata, size):
    assert len(stratified_sample(strata, size, seed=1)) == min(size, len(strata))


def test_draws_stay_inside_the_bounds_and_have_the_spread():
    parameters = np.tile(TABLE3_MEANS.as_array(), (2, 1))
    spread = np.array([[1.0, 0.2, 0.2, 0.2, 0.1, 0.3], [50.0] * 6])
    drawn = parameter_draws(parameters, spread, 4000, np.random.default_rng(1))
    low, high = LOWER_BOUNDS.as_array(), UPPER_BOUNDS.as_array()
    low[-1], high[-1] = REPLAY_L_BOUNDS
    assert (drawn >= low).all()
    assert (drawn <= high).all()
    assert drawn[:, 0].std(axis=0) == pytest.approx(spread[0], rel=0.05)
    assert drawn[:, 0].mean(axis=0) == pytest.approx(parameters[0], rel=0.01)


def test_without_spread_nothing_is_drawn_even_beyond_the_bounds():
    parameters = np.tile(TABLE3_MEANS.as_array(), (1, 1))
    parameters[0, 0] = 80.0
    drawn = parameter_draws(parameters, np.zeros((1, 6)), 5, np.random.default_rng(1))
    assert np.array_equal(drawn, np.tile(parameters, (5, 1, 1)))


def test_more_draws_leave_the_first_ones_as_they_are():
    parameters, spread = np.tile(TABLE3_MEANS.as_array(), (3, 1)), np.full((3, 6), 0.1)
    few = parameter_draws(parameters, spread, 4, np.random.default_rng(5))
    many = parameter_draws(parameters, spread, 9, np.random.default_rng(5))
    assert np.array_equal(few, many[:4])
