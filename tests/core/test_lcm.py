"""LCM: equilibrium, floor, free road, jerk, and L behind another leader."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from highd_lc.core.lcm import desired_spacing, equilibrium_spacing, lcm_acceleration, moved_behind
from highd_lc.vocab.driver import LOWER_BOUNDS, SIMULATION, TABLE3_MEANS, UPPER_BOUNDS

MEANS, PAPER = TABLE3_MEANS.as_array(), SIMULATION.as_array()

drivers = st.tuples(
    *(st.floats(a, b) for a, b in zip(LOWER_BOUNDS.as_array(), UPPER_BOUNDS.as_array(), strict=True))
)


def acceleration(v, spacing, v_leader, p):
    """Equations 10 and 11 in plain Python."""
    v_desire, A, b, B, tau, L = p
    wanted = max(v**2 / (2 * b) - v_leader**2 / (2 * B) + v * tau + L, L)
    return A * (1 - v / v_desire - math.exp(1 - spacing / wanted))


@given(st.floats(0, 50), st.floats(5, 300), st.floats(0, 50), drivers)
def test_the_compiled_acceleration_is_the_printed_equation(v, spacing, v_leader, p):
    found = lcm_acceleration(v, spacing, v_leader, *p)
    assert found == pytest.approx(acceleration(v, spacing, v_leader, p), rel=1e-12, abs=1e-12)


@given(st.floats(0, 50), drivers)
def test_on_a_free_road_only_the_desired_speed_counts(v, p):
    assert lcm_acceleration(v, np.inf, 0.0, *p) == pytest.approx(p[1] * (1 - v / p[0]))


@pytest.mark.parametrize("p", [MEANS, PAPER], ids=["table 3", "simulation"])
@pytest.mark.parametrize("v", [0.0, 5.0, 15.0, 24.0])
def test_nobody_accelerates_at_the_equilibrium(v, p):
    spacing = equilibrium_spacing(v, p)
    assert spacing == pytest.approx(desired_spacing(v, v, *p[2:]) * (1 - math.log(1 - v / p[0])))
    assert lcm_acceleration(v, spacing, v, *p) == pytest.approx(0.0, abs=1e-12)


def test_there_is_no_equilibrium_at_the_desired_speed():
    assert math.isnan(equilibrium_spacing(25.0, PAPER))


def test_the_floor_bounds_the_desired_spacing_from_below():
    # A leader that is much faster: unfloored, s* would be negative.
    assert 10.0**2 / (2 * 6.93) - 35.0**2 / (2 * 6.44) + 10.0 * 0.93 + 4.82 < 0
    assert desired_spacing(10.0, 35.0, *MEANS[2:]) == 4.82


def test_the_standstill_spacing_moves_with_the_length_of_the_leader():
    assert moved_behind(5.0, 4.5, 12.0) == pytest.approx(12.5)
    assert moved_behind(9.0, 4.0, 24.0) == 25.0
    assert moved_behind(3.0, 14.0, 4.0) == 2.0
    assert moved_behind(4.82, math.nan, 12.0) == 4.82
