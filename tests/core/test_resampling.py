import numpy as np
import pytest

from highd_lc.core.kinematics import hermite, resample


def cubic(t):
    return 3.0 + 2.0 * t - 0.7 * t**2 + 0.3 * t**3, 2.0 - 1.4 * t + 0.9 * t**2, -1.4 + 1.8 * t


@pytest.mark.parametrize("rate", [25.0, 10.0, 29.97])
def test_a_cubic_motion_comes_back_exactly(rate):
    t = np.arange(60) / rate
    grid = np.arange(0.0, t[-1], 0.1)
    np.testing.assert_allclose(hermite(t, *cubic(t)[:2], grid), cubic(grid)[0], atol=1e-12)


def plain_hermite(t, x, v, grid):
    """Numpy twin of ``hermite``."""
    i = np.clip(np.searchsorted(t, grid, side="right") - 1, 0, len(t) - 2)
    h = t[i + 1] - t[i]
    u = (grid - t[i]) / h
    w = 1.0 - u
    ends = x[i] * w * w * (1.0 + 2.0 * u) + x[i + 1] * u * u * (3.0 - 2.0 * u)
    return ends + h * u * w * (v[i] * w - v[i + 1] * u)


def test_the_kernel_is_its_plain_twin():
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.uniform(0.01, 0.1, 50))
    x, v = rng.normal(size=(2, 50))
    grid = rng.uniform(t[0], t[-1], 200)
    np.testing.assert_allclose(hermite(t, x, v, grid), plain_hermite(t, x, v, grid), rtol=1e-14, atol=1e-14)


def test_samples_on_the_grid_are_kept():
    t = np.arange(20) * 0.1
    rng = np.random.default_rng(0)
    x, v, a = rng.normal(size=(3, 20))
    found = resample(t, x, v, a, t)
    for values, expected in zip(found, (x, v, a), strict=True):
        np.testing.assert_allclose(values, expected, atol=1e-12)


def test_speed_and_acceleration_are_linear_between_samples():
    t = np.array([0.0, 0.04, 0.08, 0.12])
    v, a = np.array([1.0, 2.0, 4.0, 8.0]), np.array([0.0, 1.0, 0.0, -1.0])
    _, speed, acceleration = resample(t, np.zeros(4), v, a, np.array([0.1]))
    np.testing.assert_allclose(speed, 6.0)
    np.testing.assert_allclose(acceleration, -0.5)
