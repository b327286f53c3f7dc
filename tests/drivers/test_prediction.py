"""How predictions are judged: exact errors, only what is in view, contacts, classes."""

from dataclasses import replace

import numpy as np
import pytest
from made_responses import T, made

from highd_lc.drivers.prediction import SPACINGS, Scales, class_labels, in_view, judge, loss_change, motion_loss
from highd_lc.drivers.responses import SAMPLES, Responses, Simulated

SCALES = Scales(v_ref=33.54, comfort=8.0, efficiency=33.54)


def test_errors_of_a_speed_that_is_off_by_a_constant() -> None:
    responses = made(6)
    v = responses.v + 0.5
    found = Simulated(responses.x + 0.5 * T[:, None], v, np.zeros_like(v))
    judged = judge(found, responses, 5.0, SCALES)
    np.testing.assert_allclose(judged.error_speed, 0.5)
    np.testing.assert_allclose(judged.error_position, 2.5)
    np.testing.assert_allclose(judged.rmse_speed, 0.5)
    np.testing.assert_allclose(judged.comfort_simulated, 0.0, atol=1e-6)


def test_what_is_out_of_view_is_not_judged() -> None:
    responses = replace(made(3), n=np.array([SAMPLES, 51, 50]))
    assert in_view(responses, 5.0).tolist() == [True, True, False]
    judged = judge(Simulated(responses.x, responses.v, responses.v), responses, 5.0, SCALES)
    assert np.isnan(judged.error_speed).tolist() == [False, False, True]


def test_peak_braking_of_a_ramp_is_its_slope() -> None:
    responses = made(2)
    v = responses.v - 1.2 * np.clip(T - 1.0, 0, 3)[:, None]
    judged = judge(Simulated(responses.x, v, v), responses, 8.0, SCALES)
    np.testing.assert_allclose(judged.peak_decel_simulated, 1.2)
    np.testing.assert_allclose(judged.peak_decel_recorded, 0.0, atol=1e-9)


def apart(count: int = 2) -> Responses:
    """Followers that keep their distance to everybody."""
    responses = made(count, crossing_s=4.0)
    return replace(responses, x_ahead=responses.x + 40.0, before_x=responses.x + 80.0)


def test_a_front_past_the_rear_bumper_is_a_contact() -> None:
    responses = apart()
    x = responses.x.copy()
    x[60:, 0] = responses.x_ahead[60:, 0] - 4.0
    found = Simulated(x, responses.v, responses.v)
    judged = judge(found, responses, 8.0, SCALES)
    assert judged.contact.tolist() == [True, False]
    assert judged.contact_recorded.tolist() == [False, False]
    assert judge(found, replace(responses, x=x), 8.0, SCALES).contact_recorded.tolist() == [True, False]


def test_a_contact_is_with_who_is_ahead_in_the_same_world() -> None:
    responses = apart()
    # The recorded leader is passed by a metre; the simulated one is 10 m farther on.
    x = responses.x_ahead - responses.ahead_length + 1.0
    found = Simulated(x, responses.v, responses.v)
    assert judge(found, responses, 8.0, SCALES).contact.all()
    assert not judge(found, responses, 8.0, SCALES, ahead=responses.x_ahead + 10.0).contact.any()


def test_before_half_of_the_way_a_contact_is_with_the_leader_of_then() -> None:
    responses = apart()
    x = responses.x.copy()
    x[20] = responses.x_ahead[20] - 4.0  # beside the lane changer, who is still on its own lane
    found = Simulated(x, responses.v, responses.v)
    assert judge(found, responses, 8.0, SCALES).contact.tolist() == [False, False]
    before = responses.before_x.copy()
    before[20, 0] = x[20, 0] + 4.0
    assert judge(found, replace(responses, before_x=before), 8.0, SCALES).contact.tolist() == [True, False]


def test_keeping_ones_speed_costs_nothing_more() -> None:
    v = np.full((51, 2), [[25.0, 40.0]])
    np.testing.assert_allclose(loss_change(v, SCALES), 0.0, atol=1e-9)
    slower = v - np.linspace(0, 2, 51)[:, None]
    change = loss_change(slower, SCALES)
    assert change[0] > 0 > change[1]


def test_classes_have_open_ends() -> None:
    assert class_labels(SPACINGS) == ("< 20", "20 .. 35", "35 .. 60", "> 60")


def test_a_loss_is_that_of_the_smoothed_speed_and_unknown_where_there_is_too_little_of_it() -> None:
    v = 28.0 - 1.2 * np.clip(T - 2.0, 0, 3)[:, None]
    comfort = 2 * 1.2 / 0.1 / SCALES.comfort  # on and off the ramp: each a step of 1.2 m/s^2
    efficiency = np.abs(v - SCALES.v_ref).sum() / SCALES.efficiency
    assert motion_loss(v, SCALES)[0] == pytest.approx(0.5 * comfort + 0.5 * efficiency)
    assert np.isnan(motion_loss(v[:12], SCALES)[0])
    assert np.isfinite(motion_loss(v[:13], SCALES)[0])


def test_drift_is_taken_out_of_changes() -> None:
    responses = made(4)
    judged = judge(Simulated(responses.x, responses.v, responses.v), responses, 5.0, SCALES)
    assert judged.change_recorded == pytest.approx(-5.0 * responses.drift)
