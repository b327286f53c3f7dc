"""The wave's speed: exact on a wave that is known, nothing where nothing passes on, the same for the same seed."""

import numpy as np
import pytest

from highd_lc.core.shock_waves import ESTIMATED, NO_DISTURBANCE, wave_speed
from highd_lc.vocab.errors import ShapeError

DT = 0.1


def newell(lag, shift, vehicles=8, noise=0.0, seed=1):
    """Newell's followers: each repeats the leader's path, lag [s] later and shift [m] upstream."""
    t = np.arange(0.0, 60.0, DT)
    rng = np.random.default_rng(seed)

    def speed(at):
        return 20.0 - 6.0 * np.exp(-(((at - 20.0) / 4.0) ** 2))

    v = np.stack([speed(t - lag * i) for i in range(vehicles)])
    fine = np.arange(-60.0, 60.0, 0.01)
    path = np.cumsum(speed(fine)) * 0.01
    x = np.stack([np.interp(t - lag * i, fine, path) - shift * i for i in range(vehicles)])
    return x, v + rng.normal(0.0, noise, v.shape)


@pytest.mark.parametrize(("lag", "shift"), [(1.0, 6.0), (1.33, 7.0), (0.7, 5.0), (2.05, 11.0)])
def test_newells_wave_has_speed_minus_shift_over_lag(lag, shift):
    x, v = newell(lag, shift)
    found = wave_speed(x, v, dt=DT, rng=np.random.default_rng(0))
    assert found.status == ESTIMATED
    assert found.pairs == 7
    assert found.speed == pytest.approx(-shift / lag, rel=0.02)
    assert found.low <= found.speed + 1e-9
    assert found.high >= found.speed - 1e-9
    assert found.correlation > 0.99


def test_interval_widens_with_noise_and_holds_the_truth():
    x, v = newell(1.2, 7.0, vehicles=12, noise=0.4)
    found = wave_speed(x, v, dt=DT, rng=np.random.default_rng(0))
    assert found.low < -7.0 / 1.2 < found.high
    assert found.high - found.low > 0.01


def test_same_seed_same_interval():
    x, v = newell(1.2, 7.0, noise=0.2)
    one, two = (wave_speed(x, v, dt=DT, rng=np.random.default_rng(5)) for _ in range(2))
    assert one == two


def test_undisturbed_platoon_has_no_wave():
    x, v = newell(1.0, 6.0)
    found = wave_speed(x, np.full_like(v, 20.0), dt=DT, rng=np.random.default_rng(0))
    assert found.status == NO_DISTURBANCE
    assert np.isnan([found.speed, found.low, found.high]).all()


def test_unseen_samples_are_left_out():
    x, v = newell(1.0, 6.0)
    x[3, :100], v[5, -80:] = np.nan, np.nan
    found = wave_speed(x, v, dt=DT, rng=np.random.default_rng(0))
    assert found.speed == pytest.approx(-6.0, rel=0.05)


def test_bad_shapes_are_named():
    with pytest.raises(ShapeError, match="positions"):
        wave_speed(np.zeros((2, 5)), np.zeros((2, 6)), dt=DT, rng=np.random.default_rng(0))
