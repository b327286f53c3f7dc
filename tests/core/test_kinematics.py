import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import savgol_filter

from highd_lc.core.kinematics import local_polynomial, narrowest_window, noise_gain, white_noise, window_samples


@given(
    coefficients=st.lists(st.floats(-5, 5), min_size=3, max_size=3),
    n=st.integers(3, 80),
    rate=st.sampled_from([5.0, 10.0, 12.5, 25.0, 59.94]),
    window_s=st.floats(0.05, 3.0),
)
def test_quadratic_is_reproduced_exactly(coefficients, n, rate, window_s):
    t = np.arange(n) / rate
    a, b, c = coefficients
    value, speed, acceleration = local_polynomial(a + b * t + c * t**2, rate, window_s=window_s)
    np.testing.assert_allclose(value, a + b * t + c * t**2, atol=1e-7)
    np.testing.assert_allclose(speed, b + 2 * c * t, atol=1e-6)
    np.testing.assert_allclose(acceleration, np.full(n, 2 * c), atol=1e-4)


@pytest.mark.parametrize("n", [25, 26, 60])
@pytest.mark.parametrize("order", [2, 3])
def test_equals_savitzky_golay(n, order):
    values = np.random.default_rng(1).standard_normal(n)
    found = local_polynomial(values, 25.0, window_s=1.0, order=order)
    for k in range(order + 1):
        expected = savgol_filter(values, 25, order, deriv=k, delta=1 / 25, mode="interp")
        np.testing.assert_allclose(found[k], expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_short_tracks_stay_finite(n):
    found = local_polynomial(np.arange(n, dtype=float), 10.0, window_s=1.0)
    assert found.shape == (3, n)
    assert np.isfinite(found).all()
    np.testing.assert_allclose(found[0], np.arange(n), atol=1e-12)
    if n > 1:
        np.testing.assert_allclose(found[1], 10.0)


@pytest.mark.parametrize(
    ("window_s", "rate", "samples"), [(1.0, 25, 25), (1.0, 10, 11), (0.7, 10, 9), (0.01, 25, 1)]
)
def test_window_spans_its_seconds_by_an_odd_number_of_samples(window_s, rate, samples):
    assert window_samples(window_s, rate) == samples


def test_noise_of_the_speed_is_that_of_the_least_squares_slope():
    noise = 0.05 * np.random.default_rng(2).standard_normal(200_000)
    speed = local_polynomial(noise, 25.0, window_s=1.0)[1]
    expected = 0.05 * 25.0 * np.sqrt(12 / (25 * (25**2 - 1)))
    assert speed.std() == pytest.approx(expected, rel=0.02)


def test_gain_is_the_noise_that_comes_out():
    rng = np.random.default_rng(3)
    found = np.array([local_polynomial(rng.standard_normal(40), 25.0, window_s=0.6) for _ in range(4000)])
    np.testing.assert_allclose(found.std(axis=0), noise_gain(40, 25.0, window_s=0.6), rtol=0.06)


@pytest.mark.parametrize("noise", [0.0, 0.005, 0.05])
def test_white_noise_is_recovered_beside_motion(noise):
    t = np.arange(4000) / 25
    y = 2 * np.sin(t / 2) + noise * np.random.default_rng(4).standard_normal(len(t))
    assert white_noise(y) == pytest.approx(noise, rel=0.1, abs=1e-3)
    assert white_noise(y[:2]) == 0.0


@pytest.mark.parametrize(("rate", "window_s"), [(1.5, 2 / 1.5), (2.5, 0.8), (10.0, 0.2), (25.0, 0.4)])
def test_no_window_holds_fewer_than_three_samples(rate, window_s):
    shortest_s = min(0.4, window_s)
    assert narrowest_window(0.0, rate, speed_noise=0.04, shortest_s=shortest_s, longest_s=1.2) == window_s


@given(noise=st.floats(0, 0.2), rate=st.sampled_from([10.0, 25.0]))
def test_window_is_the_narrowest_that_keeps_the_speed_certain(noise, rate):
    window_s = narrowest_window(noise, rate, speed_noise=0.04, shortest_s=0.4, longest_s=1.2)
    inside = noise * noise_gain(200, rate, window_s=window_s)[1, 100]
    assert inside <= 0.04 * (1 + 1e-9) or window_s == pytest.approx(1.2, abs=2 / rate)
    if window_s > 0.4 + 1 / rate:
        assert noise * noise_gain(200, rate, window_s=window_s - 2 / rate)[1, 100] > 0.04
