import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lateral_paths import LANE, RULE, path

from highd_lc.extraction.lateral_motion import first_rest, smoothed

LIMITS = np.array([0.5, 0.2, 0.8])


def plain_first_rest(towards, samples, open_ended, needed):
    """The rule as a sentence: slow and off the marking here, and slow for as long as needed or in view."""
    for place, sample in enumerate(samples):
        distance, speed, acceleration = towards[:, sample]
        if abs(speed) >= 0.2 or abs(acceleration) >= 0.8 or abs(distance) < 0.5:
            continue
        following = [towards[1, other] < 0.2 for other in samples[place : place + needed]]
        if all(following) and (len(following) == needed or open_ended):
            return sample
    return -1


@given(
    values=st.lists(
        st.tuples(*[st.sampled_from([-1.0, -0.3, -0.1, 0.0, 0.1, 0.3, 1.0])] * 3), min_size=2, max_size=25
    ),
    crossing=st.integers(1, 24),
    forward=st.booleans(),
    open_ended=st.booleans(),
    needed=st.integers(1, 6),
)
@settings(deadline=None, max_examples=300)
def test_first_rest_equals_its_plain_twin(values, crossing, forward, open_ended, needed):
    towards = np.array(values).T
    crossing = min(crossing, len(values) - 1)
    samples = list(range(crossing, len(values))) if forward else list(range(crossing - 1, -1, -1))
    found = first_rest(towards, samples[0], len(samples), 1 if forward else -1, open_ended, needed, LIMITS)
    assert found == plain_first_rest(towards, samples, open_ended, needed)


def test_clean_motion_is_followed_closely():
    track = path(12.0, (3.0, 4.0, 1))
    position, speed, _ = smoothed(track, RULE)
    u = np.clip((np.arange(len(track.y)) / 25 - 3.0) / 4.0, 0, 1)
    np.testing.assert_allclose(position, track.y, atol=0.01)
    np.testing.assert_allclose(speed, LANE / 4.0 * 30 * u**2 * (1 - u) ** 2, atol=0.03)


@pytest.mark.parametrize("rate", [10.0, 25.0])
def test_noise_is_kept_below_a_sixth_of_the_threshold_or_the_widest_window_is_taken(rate):
    rng = np.random.default_rng(1)
    for noise in (0.01, 0.03):
        speed = smoothed(path(200.0, noise=noise, rate=rate, rng=rng), RULE)[1]
        assert speed[50:-50].std() < 1.1 * RULE.speed / 6


def test_ends_of_a_noisy_track_are_read_leniently():
    """Standing still, the one-sided fit at the ends would show speed more often than it may."""
    rng = np.random.default_rng(2)
    fast = 0
    for _ in range(300):
        speed = smoothed(path(6.0, noise=0.05, rng=rng), RULE)[1]
        fast += abs(speed[0]) > RULE.speed
    assert fast / 300 < 0.02
