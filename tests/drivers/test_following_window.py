import numpy as np
import pytest

from highd_lc.drivers.calibration import RecordedMotion, fit_follower, following_track
from highd_lc.vocab.settings import CalibrateSettings


def recorded(first_frame, n, *, rate=25.0, x0=0.0, v0=20.0, length=4.5):
    """A gentle motion recorded as HighD does, rounded to 0.01; t counts to t_start at frame 200."""
    frame = first_frame + np.arange(n)
    t = (frame - 200) / rate
    x = x0 + v0 * t + 0.4 * np.sin(t)
    return RecordedMotion(
        t, np.round(x, 2), np.round(v0 + 0.4 * np.cos(t), 2), np.round(-0.4 * np.sin(t), 2), length
    )


def test_spacing_is_front_to_front():
    follower, leader = recorded(50, 150, length=4.0), recorded(50, 150, x0=30.0, length=12.0)
    track = following_track(follower, leader)
    np.testing.assert_allclose(track.spacing, 30.0 + (12.0 - 4.0) / 2, atol=1e-9)


@pytest.mark.parametrize("rate", [25.0, 10.0, 29.97])
def test_samples_lie_on_tenths_of_a_second_within_both_tracks(rate):
    follower, leader = recorded(51, 120, rate=rate), recorded(60, 150, rate=rate, x0=30.0)
    track = following_track(follower, leader)
    first = np.ceil((60 - 200) / rate * 10 - 1e-9)
    last = np.floor((170 - 200) / rate * 10 + 1e-9)
    assert len(track.x) == last - first + 1
    t = np.arange(first, last + 1) / 10
    np.testing.assert_allclose(track.x, 20.0 * t + 0.4 * np.sin(t) + 2.25, atol=0.01)
    np.testing.assert_allclose(track.v, 20.0 + 0.4 * np.cos(t), atol=0.01)


def test_tracks_that_never_meet_have_no_samples():
    track = following_track(recorded(0, 20), recorded(60, 150))
    assert len(track.x) == 0
    empty = RecordedMotion(*np.empty((4, 0)), 4.5)
    assert len(following_track(empty, recorded(0, 20)).x) == 0


def test_mirrored_recording_gives_the_same_bits():
    """Direction 1 stores 420 - x: positions come back with other last bits, the fit must not notice."""
    leader, follower = recorded(60, 130, x0=31.37), recorded(60, 130)

    def mirrored(motion):
        stored = np.round(420.0 - motion.x, 2)
        return RecordedMotion(motion.t, 420.0 - stored + 1e-13, motion.v, motion.a, motion.length)

    plain = following_track(follower, leader)
    turned = following_track(mirrored(follower), mirrored(leader))
    np.testing.assert_array_equal(plain.as_array(), turned.as_array())
    settings = CalibrateSettings(optimiser="screen")
    fits = [fit_follower(track, settings, seed=1) for track in (plain, turned)]
    assert fits[0].objective == fits[1].objective
    np.testing.assert_array_equal(fits[0].parameters, fits[1].parameters)
