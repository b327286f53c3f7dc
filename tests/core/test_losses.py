"""Losses: sums over samples, weights of scenario 3, what counts and what does not."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from highd_lc.core.losses import (
    command_jerk,
    cumulative_comfort,
    cumulative_efficiency,
    follower_weights,
    joint_objective,
    speed_difference,
)


def test_weights_of_scenario_3():
    spacing, difference = np.array([24.23, 59.73, 107.26]), np.array([5.27, 5.43, 4.56])
    weights = follower_weights(20.0 + difference, spacing, 20.0)
    np.testing.assert_allclose(weights, [0.48367, 0.31741, 0.19891], atol=5e-6)


def test_slower_followers_weigh_like_faster_ones():
    spacing, difference = np.array([24.23, 59.73, 107.26]), np.array([5.27, 5.43, 4.56])
    faster, slower = (follower_weights(20.0 + sign * difference, spacing, 20.0) for sign in (1, -1))
    np.testing.assert_allclose(faster, slower)


def test_followers_at_the_same_speed_weigh_alike():
    np.testing.assert_array_equal(
        follower_weights(np.full(3, 25.0), np.array([10.0, 20.0, 30.0]), 25.0), [1 / 3] * 3
    )


@pytest.mark.parametrize("spacing", [[0.0, 30.0], [-5.75, 30.0]])
def test_a_follower_beside_the_av_leaves_all_weights_equal(spacing):
    np.testing.assert_array_equal(follower_weights(np.array([20.0, 25.0]), np.array(spacing), 22.0), [0.5, 0.5])


@given(
    arrays(float, 4, elements=st.floats(0, 50)), arrays(float, 4, elements=st.floats(0.1, 200)), st.floats(0, 50)
)
def test_weights_are_shares(v, spacing, v_av):
    weights = follower_weights(v, spacing, v_av)
    assert weights.sum() == pytest.approx(1.0)
    assert (weights >= 0).all()


def test_both_ends_of_the_interval_are_charged():
    v = np.array([30.0, 32.0, 33.54, 35.54])
    found = cumulative_efficiency(v, 33.54, scale=2.0)
    np.testing.assert_allclose(found, np.array([3.54, 5.08, 5.08, 7.08]) / 2.0)
    np.testing.assert_allclose(cumulative_comfort(np.array([1.0, -2.0, 0.5]), scale=0.5), [2.0, 6.0, 7.0])


def test_one_sided_charges_only_slower_speeds():
    np.testing.assert_allclose(speed_difference(np.array([30.0, 40.0]), 33.0, one_sided=True), [3.0, 0.0])
    np.testing.assert_allclose(speed_difference(np.array([30.0, 40.0]), 33.0), [3.0, 7.0])


def test_the_step_onto_the_first_sample_does_not_count():
    a = np.array([[5.0, 4.0, 4.5], [0.0, 0.0, -1.0]])
    np.testing.assert_allclose(command_jerk(a, 0.1), [[0.0, 10.0, 5.0], [0.0, 0.0, 10.0]])


def test_a_constant_motion_at_the_reference_costs_nothing():
    assert cumulative_efficiency(np.full(151, 33.54), 33.54, scale=33.54)[-1] == 0.0
    assert cumulative_comfort(command_jerk(np.full(151, 0.3), 0.1), scale=8.0)[-1] == 0.0


def test_the_joint_objective_weighs_both_sides():
    av, hv = np.array([2.0, 4.0]), np.array([10.0, 0.0])
    np.testing.assert_allclose(joint_objective(av, hv, 0.75), [4.0, 3.0])
    np.testing.assert_allclose(joint_objective(av, hv, 1.0), av)
