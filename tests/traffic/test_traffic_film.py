"""Films: what depends on what, and what the camera adds to the truth."""

import numpy as np
import pytest
from made_traffic import FAULTLESS

from highd_lc.traffic.film import Film, film_carriageway
from highd_lc.vocab.sections import RecorderSettings

MARKINGS = np.array([0.0, 3.7, 7.45, 11.2])
KEY = (4, 1, 2)


def film(settings: RecorderSettings = FAULTLESS, *, seconds: float = 20.0, key: tuple[int, ...] = KEY) -> Film:
    return film_carriageway(MARKINGS, key, flow=1300.0, acceleration_bias=0.0, seconds=seconds, settings=settings)


def test_a_longer_film_begins_like_a_shorter_one():
    settings = RecorderSettings(detection_noise_m=0.05)
    short, long = film(settings, seconds=10.0), film(settings, seconds=30.0)
    n = len(short.frame)
    np.testing.assert_array_equal(long.frame[:n], short.frame)
    np.testing.assert_array_equal(long.true[:n], short.true)
    np.testing.assert_array_equal(long.seen[:n, [1, 2, 4, 5]], short.seen[:, [1, 2, 4, 5]])
    np.testing.assert_array_equal(long.seen[:n], short.seen)


def test_half_the_frame_rate_keeps_every_second_frame_of_the_same_motion():
    fine, coarse = film(), film(FAULTLESS.model_copy(update={"frame_rate": 12.5}))
    even = fine.frame % 2 == 0
    np.testing.assert_array_equal(fine.frame[even], 2 * coarse.frame)
    np.testing.assert_array_equal(fine.true[even], coarse.true)


def test_another_key_gives_other_traffic():
    first, other = film(), film(key=(4, 2, 2))
    assert len(first.frame) != len(other.frame) or not np.array_equal(first.true, other.true)


def test_a_faultless_camera_sees_the_truth():
    quiet = film()
    np.testing.assert_array_equal(quiet.seen, quiet.true)


@pytest.mark.parametrize(("name", "columns"), [("position_noise_m", (0, 3)), ("detection_noise_m", (0, 3))])
def test_position_noise_has_its_standard_deviation(name, columns):
    noisy = film(FAULTLESS.model_copy(update={name: 0.05}), seconds=60.0)
    error = noisy.seen - noisy.true
    for column in columns:
        assert error[:, column].std() == pytest.approx(0.05, rel=0.1)


def test_white_noise_leaves_speeds_alone():
    noisy = film(FAULTLESS.model_copy(update={"detection_noise_m": 0.05}))
    np.testing.assert_array_equal(noisy.seen[:, [1, 2, 4, 5]], noisy.true[:, [1, 2, 4, 5]])


def test_lane_keeping_is_true_motion_of_the_asked_size():
    straight, swaying = film(seconds=60.0), film(FAULTLESS.model_copy(update={"wander_m": 0.1}), seconds=60.0)
    np.testing.assert_array_equal(swaying.seen, swaying.true)
    sway = swaying.true - straight.true
    assert not sway[:, :3].any()
    assert sway[:, 3].std() == pytest.approx(0.1, rel=0.1)
    assert np.quantile(np.abs(sway[:, 4]), 0.9) < 0.2  # the noise of in-lane lateral speeds in HighD


def test_speeds_read_low_only_within_twenty_metres_of_the_ends():
    flawed = film(FAULTLESS.model_copy(update={"end_speed_error_mps": 0.5}))
    x, error = flawed.true[:, 0], flawed.seen[:, 1] - flawed.true[:, 1]
    from_end = np.minimum(x, FAULTLESS.section_m - x)
    assert not error[from_end >= 20].any()
    assert (error[from_end < 19] < 0).all()
    assert error.min() == pytest.approx(-0.5, abs=0.1)


def test_the_bias_shifts_forward_accelerations_alone():
    biased = film_carriageway(MARKINGS, KEY, flow=1300.0, acceleration_bias=0.2, seconds=20.0, settings=FAULTLESS)
    error = biased.seen - biased.true
    np.testing.assert_allclose(error[:, 2], 0.2, atol=1e-12)
    assert not error[:, [0, 1, 3, 4, 5]].any()


@pytest.mark.parametrize("rate", [5.0, 10.0, 29.97])
def test_any_frame_rate_gives_its_number_of_frames(rate):
    made = film(FAULTLESS.model_copy(update={"frame_rate": rate}), seconds=10.0)
    assert made.frames == round(10 * rate)
    assert made.frame.max() == made.frames - 1
    assert len(made.first_rows()) == made.frames + 1
