"""String stability: derivatives against finite differences, the gain against a scan and against a simulation."""

import numpy as np
import pytest

from highd_lc.core.lcm import lcm_acceleration
from highd_lc.scenarios.platoon import Lead, drive_platoon, equal_drivers
from highd_lc.scenarios.waves import response
from highd_lc.vocab.driver import SIMULATION, TABLE3_MEANS, TABLE3_QUANTILES

SETS = [SIMULATION.as_array(), TABLE3_MEANS.as_array(), *(q.as_array() for q in TABLE3_QUANTILES.values())]


@pytest.mark.parametrize("parameters", SETS)
@pytest.mark.parametrize("v", [8.0, 16.0, 22.0])
def test_derivatives_are_those_of_the_acceleration(parameters, v):
    found = response(v, parameters)
    h = 1e-5

    def a(s, own, leader):
        return lcm_acceleration(own, s, leader, *parameters)

    s = found.spacing
    assert a(s, v, v) == pytest.approx(0.0, abs=1e-12)
    assert found.f_s == pytest.approx((a(s + h, v, v) - a(s - h, v, v)) / (2 * h), rel=1e-6)
    assert found.f_v == pytest.approx((a(s, v + h, v) - a(s, v - h, v)) / (2 * h), rel=1e-6)
    assert found.f_l == pytest.approx((a(s, v, v + h) - a(s, v, v - h)) / (2 * h), rel=1e-6)


@pytest.mark.parametrize("parameters", SETS)
@pytest.mark.parametrize("v", [5.0, 12.0, 20.0, 24.0])
def test_gain_equals_a_scan_over_frequencies(parameters, v):
    found = response(v, parameters)
    w = np.linspace(1e-4, 8.0, 200001)
    scan = np.abs((found.f_s + 1j * w * found.f_l) / (found.f_s - w**2 - 1j * w * found.f_v))
    assert found.gain == pytest.approx(max(scan.max(), 1.0), rel=1e-6)
    assert (found.gain <= 1.0) == (found.f_v**2 - found.f_l**2 - 2 * found.f_s >= 0.0)


def test_gain_is_that_of_a_simulated_platoon():
    """A small oscillation at a given frequency grows from follower to follower by |Gamma|."""
    parameters, v, w = TABLE3_MEANS.as_array(), 20.0, 0.5
    found = response(v, parameters)
    gain = abs((found.f_s + 1j * w * found.f_l) / (found.f_s - w**2 - 1j * w * found.f_v))
    dt, n = 0.01, 20000
    speed = v + 0.01 * np.sin(w * dt * np.arange(n))
    front = found.spacing + np.concatenate([[0.0], np.cumsum(speed[1:] * dt)])
    start = equal_drivers(3, speed=v, spacing=found.spacing, parameters=parameters, length=5.0)
    driven = drive_platoon(start, Lead(front, speed, 5.0), dt=dt)
    amplitude = np.ptp(driven.v[:, n // 2 :], axis=1) / 2
    assert amplitude[1] / amplitude[0] == pytest.approx(gain, rel=0.02)
    assert amplitude[2] / amplitude[1] == pytest.approx(gain, rel=0.02)


def test_no_equilibrium_no_response():
    assert response(25.0, SIMULATION.as_array()) is None
    assert response(30.0, SIMULATION.as_array()) is None
