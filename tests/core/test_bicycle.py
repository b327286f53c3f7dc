"""The kinematic bicycle: circles, integration against a fine Runge-Kutta, linearisation against differences."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tracking_baselines import error_model

from highd_lc.core.kinematics import bicycle_step

SPEEDS = st.floats(0.0, 60.0)
ANGLES = st.floats(-1.0, 1.0)
HEADINGS = st.floats(-3.0, 3.0)


def rate(state, v, delta, wheelbase):
    return np.array([v * math.cos(state[2]), v * math.sin(state[2]), v * math.tan(delta) / wheelbase])


def runge_kutta(state, v, delta, *, dt, wheelbase, steps=20):
    h = dt / steps
    for _ in range(steps):
        k1 = rate(state, v, delta, wheelbase)
        k2 = rate(state + h / 2 * k1, v, delta, wheelbase)
        k3 = rate(state + h / 2 * k2, v, delta, wheelbase)
        k4 = rate(state + h * k3, v, delta, wheelbase)
        state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return state


def test_constant_steering_closes_a_circle_of_radius_l_over_tan_delta():
    wheelbase, delta, v = 2.7, 0.1, 15.0
    radius = wheelbase / math.tan(delta)
    steps = 1000
    dt = 2 * math.pi * radius / v / steps
    state, farthest = (0.0, 0.0, 0.0), 0.0
    for _ in range(steps):
        state = bicycle_step(*state, v, delta, dt, wheelbase)
        farthest = max(farthest, math.hypot(state[0], state[1] - radius))
    assert state[:2] == pytest.approx((0.0, 0.0), abs=1e-9)
    assert state[2] == pytest.approx(2 * math.pi, abs=1e-9)
    assert farthest == pytest.approx(radius, abs=1e-9)


@given(SPEEDS, ANGLES, HEADINGS)
def test_a_step_equals_a_fine_runge_kutta(v, delta, phi):
    start = np.array([3.0, -1.0, phi])
    exact = bicycle_step(*start, v, delta, 0.1, 2.7)
    assert exact == pytest.approx(runge_kutta(start, v, delta, dt=0.1, wheelbase=2.7), abs=1e-5)


@given(SPEEDS, ANGLES, HEADINGS)
def test_two_half_steps_make_one_step(v, delta, phi):
    whole = bicycle_step(0.0, 0.0, phi, v, delta, 0.1, 2.7)
    half = bicycle_step(0.0, 0.0, phi, v, delta, 0.05, 2.7)
    assert bicycle_step(*half, v, delta, 0.05, 2.7) == pytest.approx(whole, abs=1e-11)


def test_small_steering_is_continuous_with_straight_driving():
    straight = bicycle_step(0.0, 0.0, 0.2, 30.0, 0.0, 0.1, 2.7)
    for delta in (1e-14, 1e-10, 1e-6, 1.7e-4, 1.9e-4):
        step = bicycle_step(0.0, 0.0, 0.2, 30.0, delta, 0.1, 2.7)
        assert step == pytest.approx(straight, abs=15.0 * math.tan(delta) / 2.7 + 1e-12)


@given(st.floats(1.0, 50.0), st.floats(-0.5, 0.5), HEADINGS)
def test_error_model_equals_the_eulers_derivatives(v, delta, phi):
    dt, wheelbase, h = 0.1, 2.7, 1e-6
    A, B = error_model(v, phi, delta, dt=dt, wheelbase=wheelbase)

    def euler(z):
        return z[:3] + dt * rate(z[:3], z[3], z[4], wheelbase)

    z = np.array([0.0, 0.0, phi, v, delta])
    numeric = np.column_stack([(euler(z + h * e) - euler(z - h * e)) / (2 * h) for e in np.eye(5)])
    np.testing.assert_allclose(np.hstack([A, B]), numeric, atol=1e-7 * max(1.0, v))


@pytest.mark.parametrize("v", [5.0, 25.0, 40.0])
def test_error_model_is_the_exact_steps_derivative_to_first_order_in_dt(v):
    wheelbase, phi, delta, h = 2.7, 0.05, 0.01, 1e-6
    z = np.array([0.0, 0.0, phi, v, delta])
    distance = []
    for dt in (0.02, 0.01):
        A, B = error_model(v, phi, delta, dt=dt, wheelbase=wheelbase)

        def step(z, dt=dt):
            return np.array(bicycle_step(*z, dt, wheelbase))

        numeric = np.column_stack([(step(z + h * e) - step(z - h * e)) / (2 * h) for e in np.eye(5)])
        distance.append(np.abs(np.hstack([A, B]) - numeric).max())
    assert distance[1] < 0.3 * distance[0]
