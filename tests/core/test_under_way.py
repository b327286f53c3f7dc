"""Quintics that start under way: their tail is theirs, their extrema are those of dense samples."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from highd_lc.core.quintic import AT_REST, Quintic, StartState, first_past, reaches, sample
from highd_lc.core.under_way import axis, axis_extrema, rates, sharpest_turns, speed_range

STATES = st.builds(
    StartState,
    st.floats(-3.0, 3.0),
    st.floats(-1.0, 3.0),
    st.floats(-1.5, 1.5),
    st.floats(-2.0, 2.0),
)
PLANS = st.builds(
    Quintic,
    v0=st.floats(8.0, 35.0),
    D=st.floats(-4.0, 4.0),
    T=st.floats(1.0, 9.0),
    x_final=st.floats(20.0, 250.0),
    v_end=st.floats(5.0, 35.0),
    start=STATES,
)


def axes(plan):
    start = plan.start
    x = axis(0.0, plan.v0, start.ax, plan.x_final, plan.v_end, plan.T)
    return x, axis(start.y, start.vy, start.ay, plan.D, 0.0, plan.T)


@given(PLANS)
def test_both_ends_are_those_asked_for(plan):
    s = sample(plan, np.array([0.0, plan.T]))
    start = plan.start
    np.testing.assert_allclose(
        [s.x[0], s.vx[0], s.ax[0], s.y[0], s.vy[0], s.ay[0]],
        [0.0, plan.v0, start.ax, start.y, start.vy, start.ay],
        atol=1e-9,
    )
    np.testing.assert_allclose([s.x[1], s.vx[1]], [plan.x_final, plan.v_end], rtol=1e-9)
    np.testing.assert_allclose([s.y[1], s.ax[1], s.vy[1], s.ay[1]], [plan.D, 0.0, 0.0, 0.0], atol=1e-8)


@given(PLANS)
def test_derivatives_are_those_of_the_positions(plan):
    t, h = np.linspace(0.1, 0.9, 9) * plan.T, 1e-4
    s, before, after = (sample(plan, t + shift) for shift in (0.0, -h, h))
    for lower, higher in (("x", "vx"), ("vx", "ax"), ("ax", "jx"), ("y", "vy"), ("vy", "ay"), ("ay", "jy")):
        slope = (getattr(after, lower) - getattr(before, lower)) / (2 * h)
        np.testing.assert_allclose(slope, getattr(s, higher), atol=1e-3 * (1.0 + np.abs(slope).max()))


@given(PLANS, st.floats(0.05, 0.95))
def test_what_is_left_of_a_plan_is_a_plan_from_there(plan, share):
    t0 = share * plan.T
    now = sample(plan, np.array([t0]))
    start = StartState(*(float(getattr(now, name)[0]) for name in ("ax", "y", "vy", "ay")))
    tail = Quintic(float(now.vx[0]), plan.D, plan.T - t0, plan.x_final - float(now.x[0]), plan.v_end, start)
    t = np.linspace(0.0, plan.T - t0, 23)
    left, whole = sample(tail, t), sample(plan, t0 + t)
    for name in ("y", "vx", "vy", "ax", "ay", "jx", "jy"):
        size = 1.0 + np.abs(getattr(whole, name)).max()
        np.testing.assert_allclose(getattr(left, name), getattr(whole, name), atol=1e-7 * size / (1 - share) ** 3)
    np.testing.assert_allclose(left.x + now.x[0], whole.x, atol=1e-7)


@given(PLANS)
def test_an_axis_is_the_sampled_one_and_its_extrema_bound_it_closely(plan):
    u = np.linspace(0.0, 1.0, 4001)
    s = sample(plan, u * plan.T)
    for c, names in zip(axes(plan), (("vx", "ax", "jx"), ("vy", "ay", "jy")), strict=True):
        v, a, j = (getattr(s, name) for name in names)
        at_third = rates(c, 1 / 3, plan.T)
        there = sample(plan, np.array([plan.T / 3]))
        np.testing.assert_allclose(at_third, [getattr(there, n)[0] for n in names], rtol=1e-7, atol=1e-7)
        found = axis_extrema(c, plan.T)
        wanted = (v.min(), v.max(), np.abs(a).max(), np.abs(j).max())
        scale = 1.0 + max(np.abs(wanted))
        np.testing.assert_allclose(found, wanted, atol=1e-5 * scale)
        assert found[0] <= wanted[0] + 1e-9 * scale
        assert all(f >= w - 1e-9 * scale for f, w in zip(found[1:], wanted[1:], strict=True))


@given(PLANS)
def test_speed_and_turns_are_those_of_dense_samples(plan):
    s = sample(plan, np.linspace(0.0, plan.T, 4001))
    x, y = axes(plan)
    speed = np.hypot(s.vx, s.vy)
    np.testing.assert_allclose(speed_range(x, y, plan.T), (speed.min(), speed.max()), rtol=1e-4, atol=1e-3)
    some = sample(plan, np.arange(65) / 64 * plan.T)
    turned = np.abs(some.vx * some.ay - some.vy * some.ax)
    square = some.vx**2 + some.vy**2
    curvature, yaw_rate = sharpest_turns(x, y, plan.T)
    assert curvature == pytest.approx((turned / square**1.5).max(), rel=1e-6)
    assert yaw_rate == pytest.approx((turned / square).max(), rel=1e-6)


@pytest.mark.parametrize("n", [20, 21, 47, 100])
@pytest.mark.parametrize("share", [0.0, 0.2, 0.5, 0.8])
def test_a_share_of_the_way_is_reached_when_a_plan_from_the_start_reaches_it(n, share):
    """Seen from any moment before, and just so if the state is nearly at rest."""
    plan = Quintic(25.0, 3.5, 0.1 * n, 25.0 * 0.1 * n, 25.0)
    wanted = first_past(share, n)
    assert reaches(share, n, 0.1, 3.5, AT_REST) == wanted
    for k in range(max(wanted, 1)):
        now = sample(plan, np.array([0.1 * k]))
        start = StartState(*(float(getattr(now, name)[0]) for name in ("ax", "y", "vy", "ay")))
        if start != AT_REST:
            assert k + reaches(share, n - k, 0.1, 3.5, start) == wanted
    mirrored = replace(plan, D=-3.5)
    now = sample(mirrored, np.array([0.5]))
    start = StartState(*(float(getattr(now, name)[0]) for name in ("ax", "y", "vy", "ay")))
    assert 5 + reaches(0.5, n - 5, 0.1, -3.5, start) == n // 2
