"""Quintics: the exact values of equations.md 14, boundary conditions, and extrema against dense sampling."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import Polynomial

from highd_lc.core import quintic
from highd_lc.core.losses import cumulative_comfort, cumulative_efficiency
from highd_lc.core.quintic import Quintic, first_past, forward_extrema, sample, speed_extrema, z_shape

Z = Polynomial([0, 0, 0, 10, -15, 6])
Q = Polynomial([0, 0, 0, -4, 7, -3])

plans = st.builds(
    Quintic,
    v0=st.floats(2, 45),
    D=st.floats(-4.5, 4.5),
    T=st.integers(20, 100).map(lambda n: n / 10),
    x_final=st.floats(5, 450),
    v_end=st.floats(2, 50),
)


def densely(plan: Quintic, count: int = 20001) -> quintic.Samples:
    return sample(plan, np.linspace(0.0, plan.T, count))


def coefficients(plan: Quintic) -> tuple[float, float]:
    """alpha and beta of the module."""
    return (plan.x_final - plan.v0 * plan.T) / plan.T**2, (plan.v_end - plan.v0) / plan.T


def test_the_shapes_at_both_ends():
    assert quintic.z_shape(0.0) == quintic.z_rate(0.0) == quintic.z_curvature(0.0) == 0.0
    assert quintic.z_shape(1.0) == 1.0
    assert quintic.z_rate(1.0) == quintic.z_curvature(1.0) == 0.0
    assert quintic.q_shape(0.0) == quintic.q_rate(0.0) == quintic.q_curvature(0.0) == 0.0
    assert quintic.q_shape(1.0) == quintic.q_curvature(1.0) == 0.0
    assert quintic.q_rate(1.0) == 1.0


@pytest.mark.parametrize(("name", "shape"), [("z", Z), ("q", Q)])
def test_the_shapes_are_the_derivatives_of_the_printed_polynomials(name, shape):
    u = np.linspace(0.0, 1.0, 50)
    for order, part in enumerate(("shape", "rate", "curvature", "third")):
        found = getattr(quintic, f"{name}_{part}")(u)
        np.testing.assert_allclose(found, shape.deriv(order)(u) if order else shape(u), atol=1e-12)


def test_peaks_of_the_lateral_motion():
    D, T = 3.5, 4.7
    s = densely(Quintic(v0=25.0, D=D, T=T, x_final=25.0 * T, v_end=25.0))
    assert np.abs(s.vy).max() == pytest.approx(1.875 * D / T, rel=1e-8)
    assert np.abs(s.ay).max() == pytest.approx(5.7735 * D / T**2, rel=1e-5)
    assert abs(s.jy[0]) == abs(s.jy[-1]) == pytest.approx(60 * D / T**3)
    assert np.trapezoid(np.abs(s.jy), s.t) == pytest.approx(23.094 * D / T**2, rel=1e-4)
    assert s.y[-1] == pytest.approx(D)


def test_losses_of_the_specification_s_example():
    plan = Quintic(v0=25.0, D=3.5, T=4.0, x_final=100.0, v_end=25.0)
    s = sample(plan, np.arange(41) * 0.1)
    efficiency = cumulative_efficiency(np.hypot(s.vx, s.vy), 33.54, scale=25.0)[-1]
    comfort = cumulative_comfort(np.abs(s.jx) + np.abs(s.jy), scale=8.0)[-1]
    assert efficiency == pytest.approx(13.9706, abs=5e-5)
    assert comfort == pytest.approx(6.7409, abs=5e-5)


@given(plans)
def test_a_plan_starts_and_ends_as_it_says(plan):
    s = sample(plan, np.array([0.0, plan.T]))
    np.testing.assert_allclose([s.x[0], s.vx[0], s.ax[0], s.y[0], s.vy[0], s.ay[0]], [0, plan.v0, 0, 0, 0, 0])
    np.testing.assert_allclose(
        [s.x[1], s.vx[1], s.ax[1], s.y[1], s.vy[1], s.ay[1]],
        [plan.x_final, plan.v_end, 0, plan.D, 0, 0],
        atol=1e-9,
    )


@given(plans)
def test_samples_are_the_printed_equations(plan):
    t = np.linspace(0.0, plan.T, 7)
    x = Polynomial([0, plan.v0 * plan.T]) + (plan.x_final - plan.v0 * plan.T) * Z
    x += plan.T * (plan.v_end - plan.v0) * Q
    s = sample(plan, t)
    for order, (sx, sy) in enumerate(((s.x, s.y), (s.vx, s.vy), (s.ax, s.ay), (s.jx, s.jy))):
        for found, shape in ((sx, x), (sy, plan.D * Z)):
            wanted = (shape.deriv(order) if order else shape)(t / plan.T) / plan.T**order
            np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-8)


@given(plans)
def test_forward_extrema_are_those_of_dense_sampling(plan):
    v_low, v_high, a_high, j_high = forward_extrema(*coefficients(plan), plan.v0, plan.T)
    s = densely(plan, 4001)
    # Between two samples a speed bends by at most |j| dt^2 / 8, an acceleration by |snap| dt^2 / 8.
    step = plan.T / 4000
    speed_slack, snap = j_high * step**2 / 8, np.abs(np.diff(s.jx)).max() / step
    assert v_low == pytest.approx(s.vx.min(), abs=speed_slack + 1e-9)
    assert v_high == pytest.approx(s.vx.max(), abs=speed_slack + 1e-9)
    assert a_high == pytest.approx(np.abs(s.ax).max(), abs=snap * step**2 / 8 + 1e-9)
    assert j_high == pytest.approx(np.abs(s.jx).max(), rel=1e-5, abs=1e-9)


@given(plans)
def test_speed_extrema_are_those_of_dense_sampling(plan):
    low, high = speed_extrema(*coefficients(plan), plan.v0, plan.D, plan.T)
    s = densely(plan, 4001)
    speed = np.hypot(s.vx, s.vy)
    assert low <= speed.min() + 1e-9
    assert high >= speed.max() - 1e-9
    # A speed near zero has a sharp minimum, so the distance to the nearest sample counts in first order there.
    slack = 2e-6 * plan.T**2 + np.abs(np.diff(speed)).max()
    assert low == pytest.approx(speed.min(), abs=slack)
    assert high == pytest.approx(speed.max(), abs=slack)


def test_an_unaccelerated_plan_has_flat_extrema():
    assert forward_extrema(0.0, 0.0, 25.0, 5.0) == (25.0, 25.0, 0.0, 0.0)
    assert speed_extrema(0.0, 0.0, 25.0, 0.0, 5.0) == (25.0, 25.0)


@pytest.mark.parametrize(
    ("share", "n", "sample"), [(0.0, 40, 0), (0.5, 40, 20), (0.5, 41, 20), (1.0, 40, 40), (0.103515625, 40, 10)]
)
def test_first_sample_past_a_share_of_the_way(share, n, sample):
    # z(1/4) = 106 / 1024.
    assert first_past(share, n) == sample


@given(st.floats(0.01, 0.99).filter(lambda share: share != 0.5), st.integers(2, 150))
def test_a_share_is_made_at_that_sample_and_not_before(share, n):
    k = first_past(share, n)
    assert z_shape(k / n) >= share - 1e-9
    assert z_shape((k - 1) / n) < share
