"""Duration of a lateral path between the passings of 0.1 m/s."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from highd_lc.traffic.lanes import full_duration


@given(duration=st.floats(2.0, 11.0), shift=st.floats(2.5, 5.0))
def test_the_quintic_is_faster_than_a_tenth_for_just_the_given_time(duration, shift):
    T = full_duration(duration, shift)
    start, end = (T - duration) / 2, (T + duration) / 2
    u = np.array([start, end]) / T
    np.testing.assert_allclose(shift / T * 30 * u**2 * (1 - u) ** 2, 0.1, atol=1e-6)


def test_a_longer_time_needs_a_longer_path():
    durations = [full_duration(duration, 3.7) for duration in np.linspace(2, 11, 50)]
    assert (np.diff(durations) > 0).all()
    assert full_duration(5.0, 3.7) > full_duration(5.0, 4.5) > 5.0
    assert full_duration(5.63, 3.7) == pytest.approx(6.8, abs=0.02)
