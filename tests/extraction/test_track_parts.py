"""Broken tracks: holes and jumps are found, a vehicle's motion and a tracker's noise are let pass."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from highd_lc.extraction.track_index import TrackIndex, breaks

ROWS = 300


def track(rate=25.0, rows=ROWS, v=30.0):
    """Frames and positions of a vehicle at constant speed in the middle of a lane."""
    return np.arange(1, rows + 1), v * np.arange(rows) / rate, np.full(rows, 5.6)


def found(frame, x, y, rate=25.0):
    return breaks(TrackIndex.of(np.zeros(len(frame), int), frame), x, y, rate=rate).tolist()


@pytest.mark.parametrize("missing", [slice(100, 101), slice(100, 120), slice(2, 295)])
def test_missing_frames_break_a_track_where_it_goes_on(missing):
    kept = np.delete(np.arange(ROWS), missing)
    assert found(*(column[kept] for column in track())) == [missing.start]


@pytest.mark.parametrize("rate", [5.0, 10.0, 25.0, 30.0])
@pytest.mark.parametrize(
    ("dx", "dy"), [(4.0, 0.0), (-4.0, 0.0), (-400.0, 0.0), (0.0, 3.2), (0.0, -3.2), (60.0, 7.5)]
)
def test_a_vehicle_that_is_suddenly_elsewhere_breaks_its_track(rate, dx, dy):
    frame, x, y = track(rate)
    x[150:] += dx
    y[150:] += dy
    assert found(frame, x, y, rate) == [150]


@pytest.mark.parametrize("row", [3, 150, ROWS - 3])
def test_one_misplaced_row_is_a_part_of_its_own(row):
    frame, x, y = track()
    x[row] += 8.0
    assert found(frame, x, y) == [row, row + 1]


def test_two_vehicles_that_swap_their_ids_are_broken_both():
    frame, x, y = track()
    other = x - 12.0
    ids = np.repeat([0, 1], ROWS)
    swapped = np.r_[x[:90], other[90:], other[:90], x[90:]]
    index = TrackIndex.of(ids, np.tile(frame, 2))
    assert breaks(index, swapped, np.tile(y, 2), rate=25.0).tolist() == [90, ROWS + 90]


def test_vehicles_end_without_a_break():
    frame, x, y = track()
    index = TrackIndex.of(np.repeat([0, 1], ROWS), np.tile(frame, 2))
    assert breaks(index, np.r_[x, 500 - x], np.r_[y, y + 4], rate=25.0).tolist() == []


@pytest.mark.parametrize("rate", [2.5, 10.0, 25.0])
def test_the_hardest_driving_breaks_nothing(rate):
    t = np.arange(200) / rate
    speed = np.clip(45.0 - 11.0 * np.maximum(t - 2.0, 0.0), 0.0, None)
    x = np.cumsum(speed) / rate
    y = 1.9 + 3.7 / (1 + np.exp(-(t - 4.0) * 2.0))  # a lane change in about 3 s
    assert found(np.arange(200), x, y, rate) == []


@given(seed=st.integers(0, 10**6), rate=st.sampled_from([10.0, 25.0]), kind=st.integers(0, 2))
@settings(deadline=None, max_examples=60)
def test_what_trackers_leave_breaks_nothing(seed, rate, kind):
    rng = np.random.default_rng(seed)
    frame, x, y = track(rate, rows=1000)
    if kind == 0:
        x, y = x + 0.05 * rng.normal(size=1000), y + 0.05 * rng.normal(size=1000)
    elif kind == 1:  # positions of a conversion that are up to 0.43 m a frame off
        x = x + np.cumsum(rng.uniform(-0.43, 0.43, 1000))
    x, y = np.round(x, 2), np.round(y, 2)
    assert found(frame, x, y, rate) == []
