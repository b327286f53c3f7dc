import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from highd_lc.core.lcm import MOTORWAY, idm_acceleration


def plain(v: float, gap: float, v_leader: float) -> float:
    driver = MOTORWAY
    wanted = driver.s0 + max(0.0, v * driver.T + v * (v - v_leader) / (2 * (driver.A * driver.b) ** 0.5))
    return max(driver.A * (1 - (v / driver.v_desire) ** 4 - (wanted / max(gap, 0.1)) ** 2), -driver.hardest)


@given(st.floats(0, 50), st.floats(-5, 300), st.floats(0, 50))
def test_acceleration_follows_the_published_equation(v, gap, v_leader):
    assert idm_acceleration.py_func(v, gap, v_leader, MOTORWAY) == pytest.approx(
        plain(v, gap, v_leader), abs=1e-10
    )


def test_standing_start_on_a_free_road_uses_all_the_acceleration():
    assert idm_acceleration.py_func(0.0, np.inf, 0.0, MOTORWAY) == pytest.approx(MOTORWAY.A)


def test_desired_speed_on_a_free_road_needs_no_acceleration():
    assert idm_acceleration.py_func(MOTORWAY.v_desire, np.inf, 0.0, MOTORWAY) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("v", [0.0, 5.0, 20.0, 33.0])
def test_nobody_accelerates_at_the_equilibrium_gap(v):
    gap = (MOTORWAY.s0 + v * MOTORWAY.T) / np.sqrt(1.0 - (v / MOTORWAY.v_desire) ** 4)
    assert idm_acceleration.py_func(v, gap, v, MOTORWAY) == pytest.approx(0.0, abs=1e-12)


def test_braking_is_bounded_by_the_road():
    assert idm_acceleration.py_func(30.0, 0.0, 0.0, MOTORWAY) == -MOTORWAY.hardest
