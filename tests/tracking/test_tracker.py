"""The closed loop: accuracy on nominal plans, agreement with a plain loop, statuses, disturbances."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tracking_baselines import track_kinematic
from tracking_plans import quintic_reference

from highd_lc.tracking.closed_loop import Disturbance, controller, errors_and_inputs, track
from highd_lc.tracking.controllers import MpcController
from highd_lc.vocab.errors import ShapeError
from highd_lc.vocab.tracking import (
    INVALID_REFERENCE,
    LOST,
    QP_FAILED,
    SOFTENED,
    TRACKED,
    Reference,
    TrackingSettings,
)

SETTINGS = TrackingSettings()


def drive(reference, wheelbase=2.7, settings=SETTINGS, **disturbance):
    return track(reference, wheelbase=wheelbase, settings=settings, disturbance=Disturbance(**disturbance))


NOMINAL = [(v0, shift, T) for v0 in (10.0, 25.0, 40.0) for shift in (-3.5, 3.5) for T in (4.0, 5.5, 8.0)]


@pytest.mark.parametrize(("v0", "shift", "T"), NOMINAL)
def test_nominal_plans_are_tracked_to_centimetres(v0, shift, T):
    result = drive(quintic_reference(v0, shift, T, v_end=v0 + 2.0))
    assert result.status == TRACKED
    assert result.reason == ""
    assert result.rmse_lateral_m < 0.02
    assert result.max_lateral_m < 0.05
    assert result.qp_failures == 0


@pytest.mark.parametrize("solver", ["daqp", "osqp"])
def test_compiled_loop_equals_the_loop_step_by_step(solver):
    """The generic Python loop is the compiled one's twin, with either QP solver; the offset reaches bounds."""
    reference, offset = quintic_reference(22.0, -3.4, 5.0, v_end=25.0), (1.5, -0.2, 0.05)
    compiled = drive(reference, offset=offset)
    stepwise = track_kinematic(
        reference,
        controller=MpcController(SETTINGS, 2.7, reference.dt, solver),
        wheelbase=2.7,
        settings=SETTINGS,
        disturbance=Disturbance(offset),
    )
    exact = 1e-10 if solver == "daqp" else 1e-5
    assert compiled.active_bounds.max() > 0
    np.testing.assert_allclose(compiled.states, stepwise.states, atol=exact)
    np.testing.assert_allclose(compiled.inputs, stepwise.inputs, atol=exact)
    np.testing.assert_allclose(compiled.velocity, stepwise.velocity, atol=exact)
    np.testing.assert_allclose(compiled.slack, stepwise.slack, atol=1e-5)


def test_a_straight_reference_is_followed_exactly():
    result = drive(quintic_reference(30.0, 0.0, 5.0))
    np.testing.assert_allclose(result.errors, 0.0, atol=1e-12)
    np.testing.assert_allclose(result.inputs, np.tile([30.0, 0.0], (51, 1)), atol=1e-12)


def test_left_and_right_mirror():
    left, right = drive(quintic_reference(25.0, 3.5, 5.0)), drive(quintic_reference(25.0, -3.5, 5.0))
    np.testing.assert_allclose(left.states * [1, -1, -1], right.states, atol=1e-12)


def test_an_initial_offset_decays():
    result = drive(quintic_reference(25.0, 3.5, 8.0), offset=(0.5, 0.5, 0.0))
    assert abs(result.errors[0, 1]) == pytest.approx(0.5)
    assert np.abs(result.errors[-1]).max() < 0.02


def test_errors_are_taken_in_the_references_frame():
    reference = quintic_reference(25.0, 3.5, 5.0)
    result = drive(reference, offset=(0.4, 0.3, 0.02))
    assert result.errors[0] == pytest.approx([0.4, 0.3, 0.02])
    k = 25
    c, s = np.cos(reference.heading[k]), np.sin(reference.heading[k])
    ex, ey = result.states[k, 0] - reference.x[k], result.states[k, 1] - reference.y[k]
    assert result.errors[k, :2] == pytest.approx([c * ex + s * ey, c * ey - s * ex])
    assert result.max_lateral_m == np.abs(result.errors[:, 1]).max()
    assert result.rmse_lateral_m == pytest.approx(np.sqrt(np.mean(result.errors[:, 1] ** 2)))


@settings(max_examples=40, deadline=None)
@given(
    st.floats(0.0, 50.0),
    st.floats(-8.0, 8.0),
    st.sampled_from([2.0, 3.0, 5.5]),
    st.floats(0.0, 50.0),
    st.floats(-3.0, 3.0),
)
def test_bounds_hold_to_the_slack_and_nothing_breaks(v0, shift, T, v_end, offset):
    """Any plan, within the car's ability or not: a status, finite numbers, bounds kept to the slack."""
    result = drive(quintic_reference(v0, shift, T, v_end=v_end), offset=(0.0, offset, 0.0))
    assert result.status in (TRACKED, SOFTENED, QP_FAILED, LOST)
    for part in (result.states, result.inputs, result.errors, result.velocity):
        assert np.all(np.isfinite(part))
    assert np.array_equal(np.isfinite(result.slack), result.flags > 0)
    if result.qp_failures == 0:
        s, room = SETTINGS, result.slack + 1e-5
        v, delta = result.inputs.T
        assert np.all(v <= s.speed_max + room)
        assert np.all(v >= s.speed_min - room)
        assert np.all(np.abs(delta) <= s.steering_max + s.steering_softening * room)
        assert np.all(np.abs(np.diff(v)) <= s.acceleration_max * 0.1 + room[1:])
        assert np.all(np.abs(np.diff(delta)) <= s.steering_rate_max * 0.1 + s.steering_softening * room[1:])


def test_a_plan_outside_the_cars_ability_is_lost_with_a_reason():
    result = drive(quintic_reference(2.0, 8.0, 2.0))
    assert result.status == LOST
    assert "exceeds 1.75 m" in result.reason
    assert np.isfinite(result.rmse_lateral_m)


def test_bounds_that_have_to_give_are_softened():
    tight = TrackingSettings(speed_max=24.0, slack_penalty=1.0)
    result = drive(quintic_reference(25.0, 3.5, 5.0), settings=tight)
    assert result.status == SOFTENED
    assert result.max_slack > tight.slack_tolerance
    assert result.active_bounds.max() > 0


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_reference_that_is_not_finite_is_a_status(value):
    good = quintic_reference(25.0, 3.5, 4.0)
    bad = good.y.copy()
    bad[7] = value
    result = drive(Reference(good.dt, good.x, bad, good.xdot, good.ydot, good.xddot, good.yddot))
    assert result.status == INVALID_REFERENCE
    assert np.isnan(result.rmse_lateral_m)
    assert result.states.shape == (41, 3)


def test_standstill_is_driven():
    result = drive(quintic_reference(0.0, 0.0, 3.0, x_final=0.0))
    assert result.status == TRACKED
    assert result.max_lateral_m == 0.0


def test_plans_that_share_a_controller_equal_plans_alone():
    plans = [quintic_reference(v, 3.5, T) for v in (12.0, 30.0) for T in (3.2, 6.0)]
    bases = [2.4, 2.7, 3.0, 6.0]
    alone = [drive(plan, wheelbase) for plan, wheelbase in zip(plans, bases, strict=True)]
    shared = controller(SETTINGS, 0.1)
    for one, plan, wheelbase in [*zip(alone, plans, bases, strict=True)][::-1]:
        result = track(plan, wheelbase=wheelbase, settings=SETTINGS, shared=shared)
        np.testing.assert_array_equal(one.states, result.states)
        np.testing.assert_array_equal(one.inputs, result.inputs)


def test_what_is_drawn_is_what_is_tracked_with_one_controller_for_all():
    shared = controller(SETTINGS, 0.1)
    for v0, shift, T in NOMINAL[:3]:
        reference = quintic_reference(v0, shift, T)
        result = drive(reference)
        errors, inputs, states = errors_and_inputs(reference, wheelbase=2.7, settings=SETTINGS, shared=shared)
        np.testing.assert_array_equal(errors, result.errors)
        np.testing.assert_array_equal(inputs, result.inputs)
        np.testing.assert_array_equal(states, result.states)
    broken = replace(reference, x=np.full_like(reference.x, np.nan))
    errors, inputs, _ = errors_and_inputs(broken, wheelbase=2.7, settings=SETTINGS, shared=shared)
    assert errors.shape == (broken.n_steps + 1, 3)
    assert np.all(np.isnan(errors))
    assert np.all(np.isnan(inputs))


def test_shapes_that_do_not_fit_are_named():
    good = quintic_reference(25.0, 3.5, 4.0)
    with pytest.raises(ShapeError, match=r"Reference.ydot has shape \(3,\)"):
        Reference(0.1, good.x, good.y, good.xdot, good.ydot[:3], good.xddot, good.yddot)
    with pytest.raises(ShapeError, match="noise has shape"):
        drive(good, noise=np.zeros((3, 3)))


def test_an_unsolved_qp_holds_the_last_input_and_is_counted():
    """One measurement is lost (NaN): that step's QP is not solved, the input is held, the car goes on."""
    noise = np.zeros((61, 3))
    noise[20, 1] = np.nan
    result = drive(quintic_reference(25.0, 3.5, 6.0), noise=noise)
    assert (result.status, result.qp_failures) == (QP_FAILED, 1)
    assert "1 unsolved QPs" in result.reason
    np.testing.assert_array_equal(result.inputs[20], result.inputs[19])
    assert np.isnan(result.slack[20])
    assert np.all(np.isfinite(result.states))
    assert result.max_lateral_m < 0.05
