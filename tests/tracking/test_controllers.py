"""Single control steps and the baselines."""

import numpy as np
import pytest
from tracking_baselines import LqrController, PurePursuit, error_model, lqr_gain, track_kinematic
from tracking_plans import quintic_reference

from highd_lc.tracking.closed_loop import Disturbance, reference_rows
from highd_lc.tracking.controllers import MpcController, bound_names
from highd_lc.vocab.tracking import INVALID_REFERENCE, TRACKED, Reference, TrackingSettings

SETTINGS, WHEELBASE = TrackingSettings(), 2.7
REFERENCE = quintic_reference(25.0, 3.5, 8.0)
ROWS = reference_rows(REFERENCE, WHEELBASE, SETTINGS.horizon)
BASELINES = [LqrController(SETTINGS, WHEELBASE, 0.1), PurePursuit(SETTINGS, WHEELBASE, 0.1)]


def drive(controller, reference=REFERENCE, **disturbance):
    return track_kinematic(
        reference,
        controller=controller,
        wheelbase=WHEELBASE,
        settings=SETTINGS,
        disturbance=Disturbance(**disturbance),
    )


def test_a_step_tells_all_of_its_qp():
    controller = MpcController(SETTINGS, WHEELBASE, 0.1)
    order = controller.command(ROWS[20, :3] + [3.0, 0.0, 0.0], ROWS[19, 3:], rows=ROWS, k=20)
    assert order.solution.status == "exit flag 1"
    assert order.solution.solved
    assert order.solution.stationarity < 1e-9
    assert "largest fall of speed at +0" in order.active_bounds
    assert order.input[0] == pytest.approx(ROWS[19, 3] - 1.0, abs=1e-3 + order.slack)
    assert 0.0 < order.slack < 1e-3


def test_on_the_reference_nothing_binds():
    order = MpcController(SETTINGS, WHEELBASE, 0.1).command(ROWS[20, :3], ROWS[19, 3:], rows=ROWS, k=20)
    assert order.active_bounds == ()
    assert order.slack == 0.0
    np.testing.assert_allclose(order.input, ROWS[20, 3:], atol=1e-3)


def test_an_unsolved_qp_holds_the_last_input():
    held = np.array([24.0, 0.01])
    measured = np.array([np.nan, 0.0, 0.0])
    order = MpcController(SETTINGS, WHEELBASE, 0.1).command(measured, held, rows=ROWS, k=5)
    assert (order.solution.status, order.solution.solved) == ("not finite", False)
    np.testing.assert_array_equal(order.input, held)


def test_bounds_have_names():
    assert bound_names((0, 1, 6, 15)) == (
        "upper bound of speed at +0",
        "lower bound of speed at +0",
        "largest rise of steering at +0",
        "largest fall of steering at +1",
    )


@pytest.mark.parametrize("controller", BASELINES, ids=["lqr", "pure pursuit"])
def test_baselines_track_and_recover(controller):
    nominal = drive(controller)
    assert nominal.status == TRACKED
    assert nominal.max_lateral_m < 0.05
    recovered = drive(controller, offset=(0.0, 0.5, 0.0))
    assert np.abs(recovered.errors[-1, 1]) < 0.05


@pytest.mark.parametrize("controller", BASELINES, ids=["lqr", "pure pursuit"])
def test_baselines_stay_within_the_cars_limits(controller):
    inputs = drive(controller, offset=(4.0, -1.5, 0.2)).inputs
    assert np.all(np.abs(np.diff(inputs[:, 0])) <= SETTINGS.acceleration_max * 0.1 + 1e-12)
    assert np.all(np.abs(np.diff(inputs[:, 1])) <= SETTINGS.steering_rate_max * 0.1 + 1e-12)
    assert np.all(np.abs(inputs[:, 1]) <= SETTINGS.steering_max)


def test_the_lqrs_closed_loop_is_stable():
    for v in (1.0, 10.0, 40.0):
        A, B = error_model(v, 0.0, 0.0, dt=0.1, wheelbase=WHEELBASE)
        K = lqr_gain(A, B, R=np.array([1.0, 1.0, 300.0]), Q=np.array([0.1, 3.0]))
        Aa = np.block([[A, B], [np.zeros((2, 3)), np.eye(2)]])
        assert np.abs(np.linalg.eigvals(Aa - np.vstack([B, np.eye(2)]) @ K)).max() < 1.0


def test_the_lqr_drives_through_standstill():
    result = drive(BASELINES[0], quintic_reference(0.0, 0.0, 3.0, x_final=0.0))
    assert result.max_lateral_m == 0.0


def test_a_reference_that_is_not_finite_is_a_status():
    bad = np.full_like(REFERENCE.x, np.nan)
    broken = Reference(0.1, bad, *[getattr(REFERENCE, n) for n in ("y", "xdot", "ydot", "xddot", "yddot")])
    assert drive(BASELINES[1], broken).status == INVALID_REFERENCE
