"""The platoon: equal to a plain twin and to the planner's replay, equilibria, travel times, headways."""

import numpy as np
import pytest

from highd_lc.core.lcm import equilibrium_spacing
from highd_lc.scenarios.platoon import (
    NO_LEADER,
    Lead,
    PlatoonStart,
    drive_platoon,
    equal_drivers,
    gaps,
    passing_times,
    spacings,
    time_headways,
    travel_time,
)
from highd_lc.vocab.driver import SIMULATION, TABLE3_MEANS
from highd_lc.vocab.errors import ShapeError

DT = 0.1


def plain_twin(start, lead, dt, held):
    """The same platoon, vehicle by vehicle with math from numpy."""
    p, n = len(start.front), len(lead.front)
    x, v, a = start.front.copy(), start.v.copy(), np.zeros(p)
    out = np.empty((3, p, n))
    for k in range(n):
        if k >= held:
            for i in range(p):
                v_desire, A, b, B, tau, L = start.parameters[i]
                ahead_x, ahead_v = (lead.front[k], lead.v[k]) if i == 0 else (x[i - 1], v[i - 1])
                wanted = max(v[i] ** 2 / (2 * b) - ahead_v**2 / (2 * B) + v[i] * tau + L, L)
                pull = 0.0 if np.isinf(ahead_x) else np.exp(1.0 - (ahead_x - x[i]) / wanted)
                a[i] = A * (1.0 - v[i] / v_desire - pull)
        out[:, :, k] = x, v, a
        v = np.maximum(0.0, v + a * dt)
        x = x + v * dt
    return out


def braking_lead(n, front=20.0):
    v = 20.0 - 8.0 * np.exp(-(((np.arange(n) - 80) / 30.0) ** 2))
    return Lead(front + np.concatenate([[0.0], np.cumsum(v[1:] * DT)]), v, 5.0)


def mixed_platoon(p, seed=3):
    rng = np.random.default_rng(seed)
    parameters = TABLE3_MEANS.as_array() * rng.uniform(0.85, 1.15, (p, 6))
    return PlatoonStart(-35.0 * np.arange(p), rng.uniform(17.0, 22.0, p), rng.uniform(4.0, 12.0, p), parameters)


@pytest.mark.parametrize("held", [0, 25])
def test_kernel_equals_plain_twin(held):
    start, lead = mixed_platoon(7), braking_lead(300)
    made = drive_platoon(start, lead, dt=DT, held=held)
    x, v, a = plain_twin(start, lead, DT, held)
    assert np.allclose(made.front, x, atol=1e-9)
    assert np.allclose(made.v, v, atol=1e-10)
    assert np.allclose(made.a, a, atol=1e-9)


def test_free_road_and_late_lead_equal_plain_twin():
    start, lead = mixed_platoon(4), braking_lead(200)
    lead.front[:60] = NO_LEADER
    made = drive_platoon(start, lead, dt=DT)
    assert np.allclose(made.v, plain_twin(start, lead, DT, 0)[1], atol=1e-10)


def test_equilibrium_platoon_keeps_speed_and_spacing():
    parameters = TABLE3_MEANS.as_array()
    spacing = equilibrium_spacing(25.0, parameters)
    start = equal_drivers(20, speed=25.0, spacing=spacing, parameters=parameters, length=5.0)
    n = 600
    lead = Lead(spacing + 25.0 * DT * np.arange(n), np.full(n, 25.0), 5.0)
    made = drive_platoon(start, lead, dt=DT)
    assert np.allclose(made.v, 25.0, atol=1e-6)
    assert np.allclose(spacings(made), spacing, atol=1e-5)
    assert np.allclose(time_headways(made), spacing / 25.0, atol=1e-6)
    assert np.allclose(gaps(made), spacing - 5.0, atol=1e-5)


def test_a_follower_does_not_depend_on_those_behind():
    start, lead = mixed_platoon(9), braking_lead(250)
    first = PlatoonStart(start.front[:4], start.v[:4], start.length[:4], start.parameters[:4])
    few, many = drive_platoon(first, lead, dt=DT), drive_platoon(start, lead, dt=DT)
    assert np.allclose(few.front, many.front[:4], atol=1e-10)


def test_speeds_never_fall_below_zero():
    n = 300
    lead = Lead(np.full(n, 30.0), np.zeros(n), 5.0)
    made = drive_platoon(
        equal_drivers(5, speed=10.0, spacing=30.0, parameters=SIMULATION.as_array(), length=5.0), lead, dt=DT
    )
    assert made.v.min() == 0.0
    assert np.isnan(time_headways(made)[:, -1]).all() == bool((made.v[:, -1] <= 0.1).all())


def test_travel_time_of_constant_speed():
    start = equal_drivers(6, speed=25.0, spacing=44.0, parameters=SIMULATION.as_array(), length=5.0)
    n = 400
    lead = Lead(np.full(n, NO_LEADER), np.zeros(n), 5.0)
    held = drive_platoon(start, lead, dt=DT, held=n)
    assert travel_time(held, (10.0, 210.0)) == pytest.approx(6 * 200.0 / 25.0)
    assert passing_times(held, 100.0) == pytest.approx((100.0 + 44.0 * np.arange(6)) / 25.0)


def test_travel_time_is_nan_unless_all_pass():
    start = equal_drivers(6, speed=25.0, spacing=44.0, parameters=SIMULATION.as_array(), length=5.0)
    lead = Lead(np.full(100, NO_LEADER), np.zeros(100), 5.0)
    held = drive_platoon(start, lead, dt=DT, held=100)
    assert np.isnan(travel_time(held, (10.0, 210.0)))
    assert np.isnan(passing_times(held, -10.0)[0])


def test_bad_shapes_are_named():
    with pytest.raises(ShapeError, match="parameters"):
        PlatoonStart(np.zeros(2), np.zeros(2), np.zeros(2), np.zeros((2, 5)))
    with pytest.raises(ShapeError, match="Lead"):
        drive_platoon(mixed_platoon(2), Lead(np.zeros(3), np.zeros(2), 5.0), dt=DT)
