"""The step of a follower against the model's equations in plain Python, and what bounded braking means."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from highd_lc.core import drive
from highd_lc.core.lcm import MOTORWAY
from highd_lc.vocab.driver import LOWER_BOUNDS, TABLE3_MEANS, UPPER_BOUNDS

DT = 0.1
B_MAX = 9.0

drivers = st.tuples(
    *(st.floats(low, high) for low, high in zip(LOWER_BOUNDS.as_array(), UPPER_BOUNDS.as_array(), strict=True))
)
speeds = st.floats(0.0, 45.0)
spacings = st.floats(-40.0, 200.0)


def lcm(v, s, v_leader, v_desire, A, b, B, tau, L):
    """Equations 10 and 11 as printed, with the floor; the exponent is capped at 40."""
    wanted = max(v**2 / (2 * b) - v_leader**2 / (2 * B) + v * tau + L, L)
    return A * (1 - v / v_desire - np.exp(min(1 - s / wanted, 40.0)))


@given(speeds, spacings, speeds, drivers)
def test_the_step_is_the_bounded_model_and_then_euler(v, s, v_leader, driver):
    a, x, faster = drive.lcm_step(100.0, v, 100.0 + s, v_leader, *driver, B_MAX, DT)
    assert a == pytest.approx(max(lcm(v, s, v_leader, *driver), -B_MAX), rel=1e-9, abs=1e-9)
    assert faster == pytest.approx(max(0.0, v + a * DT), abs=1e-12)
    assert x == pytest.approx(100.0 + faster * DT, abs=1e-11)


@given(speeds, spacings, speeds, drivers)
def test_an_unbounded_step_is_the_model_alone(v, s, v_leader, driver):
    a, _, _ = drive.lcm_step(0.0, v, s, v_leader, *driver, drive.UNBOUNDED, DT)
    assert a == pytest.approx(lcm(v, s, v_leader, *driver), rel=1e-9, abs=1e-9)


@given(speeds, st.floats(-40.0, 200.0), speeds, st.floats(0.5, 20.0))
def test_nobody_brakes_harder_than_the_bound(v, s, v_leader, hardest):
    lcm_a, _, _ = drive.lcm_step(0.0, v, s, v_leader, *TABLE3_MEANS.as_array(), hardest, DT)
    idm = MOTORWAY.v_desire, MOTORWAY.A, MOTORWAY.b, MOTORWAY.b, MOTORWAY.T, MOTORWAY.s0
    idm_a = drive.follower_command(drive.IDM, v, s, v_leader, 4.5, *idm, 0.0, 0.0, 0.0, 0.0, 0.0, np.inf, hardest)
    assert min(lcm_a, idm_a) >= -hardest


BARE = 0.0, 0.0, 0.0, 0.0, 0.0, np.inf


@given(speeds, spacings, speeds, drivers)
def test_a_follower_who_only_follows_is_its_model_to_the_last_bit(v, s, v_leader, driver):
    found = drive.follower_command(drive.LCM, v, s, v_leader, 4.5, *driver, *BARE, B_MAX)
    assert found == drive.lcm_command(v, s, v_leader, *driver, B_MAX)


def test_a_family_without_a_command_keeps_its_acceleration_as_long_as_it_remembers():
    nothing = np.full(6, np.nan)
    m = drive.remembered(3.0, 6.0)
    assert m == pytest.approx(np.exp(-0.5))
    found = drive.follower_command(
        drive.NO_COMMAND, 30.0, 40.0, 30.0, 4.5, *nothing, 0.0, 0.0, m, 0.8, 0.1, np.inf, B_MAX
    )
    assert found == pytest.approx(0.8 * np.exp(-0.5) + 0.1 * (1 - np.exp(-0.5)))


@pytest.mark.parametrize(
    ("t", "memory", "m"), [(0.0, 5.0, 1.0), (5.0, 5.0, np.exp(-1.0)), (0.0, 0.0, 0.0), (9.0, 0.0, 0.0)]
)
def test_memory_begins_with_all_of_the_acceleration_and_fades(t, memory, m):
    assert drive.remembered(t, memory) == pytest.approx(m, abs=1e-15)


@pytest.mark.parametrize(
    ("t", "relaxation", "share"),
    [(-0.1, 10.0, 0.0), (0.0, 10.0, 1.0), (2.5, 10.0, 0.75), (12.0, 10.0, 0.0), (1.0, 0.0, 0.0)],
)
def test_a_jump_is_credited_from_the_change_of_leader_on_and_fades_linearly(t, relaxation, share):
    assert drive.credited(t, relaxation) == pytest.approx(share)


def test_need_asks_for_what_avoids_a_contact_and_only_once_it_is_large():
    # 10 m/s faster, 21 m of room, one of which is to be left: 100 / 40 = 2.5 m/s^2.
    assert drive.in_need(0.3, 21.0, 10.0, 2.0) == pytest.approx(-2.5)
    assert drive.in_need(0.3, 21.0, 10.0, 3.0) == 0.3
    assert drive.in_need(-4.0, 21.0, 10.0, 2.0) == -4.0
    assert drive.in_need(0.3, -5.0, 1.0, 2.0) == pytest.approx(-5.0)
    assert drive.in_need(0.3, -5.0, -1.0, 0.0) == 0.3


@pytest.mark.parametrize(
    ("old_spacing", "spacing", "credit"),
    [
        (40.0, 15.0, 25.0),  # all that it had
        (90.0, 15.0, 2 * 27.0 - 15.0),  # no more than twice what it desires
        (12.0, 15.0, 0.0),  # a change for the better
        (np.inf, 15.0, 27.0 - 15.0),  # nobody before: what it desires
        (np.inf, 35.0, 0.0),
    ],
)
def test_a_jump_is_capped_by_what_the_follower_had_and_desires(old_spacing, spacing, credit):
    # At 20 m/s behind 20 m/s with b = B: 20 * 1 + 7 = 27 m desired.
    found, speed = drive.jump(drive.LCM, 20.0, spacing, 20.0, old_spacing, 23.0, 5.0, 5.0, 1.0, 7.0)
    assert found == pytest.approx(credit)
    assert speed == (0.0 if old_spacing == np.inf else 3.0)


def test_a_front_behind_which_the_leader_lies_stops_at_the_bound():
    # 30 m/s at 9 m/s^2: 34 steps of 0.1 s, after k of which the speed is 30 - 0.9 k, and then 0.
    front, speed = drive.drive_behind(
        0.0, 30.0, np.full(60, -5.0), np.zeros(60), TABLE3_MEANS.as_array(), B_MAX, DT
    )
    expected = np.maximum(30.0 - 0.9 * np.arange(60), 0.0)
    np.testing.assert_allclose(speed, expected, atol=1e-12)
    np.testing.assert_allclose(front[1:], np.cumsum(expected[1:]) * DT, atol=1e-11)


def test_without_a_bound_the_same_driver_stands_at_once():
    _, speed = drive.drive_behind(
        0.0, 30.0, np.full(3, -200.0), np.full(3, 60.0), TABLE3_MEANS.as_array(), drive.UNBOUNDED, DT
    )
    assert speed.tolist() == [30.0, 0.0, 0.0]


@pytest.mark.parametrize(("b_max", "hardest"), [(0.0, np.inf), (9.0, 9.0), (3.5, 3.5)])
def test_zero_stands_for_unbounded(b_max, hardest):
    assert drive.hardest_braking(b_max) == hardest
