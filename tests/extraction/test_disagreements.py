import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_traffic import traffic

from highd_lc.extraction.data_quality import crossing_offsets, gaps_to, means, neighbours, seconds_of
from highd_lc.extraction.track_index import TrackIndex

RATE = 10.0


def track_of(frames):
    frames = np.asarray(frames, dtype=np.int64)
    return TrackIndex.of(np.zeros(len(frames), dtype=np.int64), frames)


@given(
    first=st.integers(1, 100),
    count=st.integers(1, 120),
    hole=st.integers(0, 119),
    rate=st.sampled_from([1.0, 10.0, 25.0]),
)
def test_windows_last_a_second_and_cross_no_hole(first, count, hole, rate):
    frames = np.delete(np.arange(first, first + count + 1), min(hole, count - 1))
    seconds = seconds_of(track_of(frames), frame_rate=rate)
    assert seconds.frames == max(3, rate)
    assert (seconds.last - seconds.first == seconds.frames).all()
    assert (frames[seconds.last] - frames[seconds.first] == seconds.frames).all()
    assert (np.diff(seconds.first) >= 2 * seconds.frames).all()


def test_a_window_is_found_wherever_a_second_is_seen_whole():
    assert len(seconds_of(track_of(np.arange(1, 11)), frame_rate=RATE).first) == 0
    assert seconds_of(track_of(np.arange(1, 12)), frame_rate=RATE).first.tolist() == [0]
    broken = np.r_[np.arange(1, 8), np.arange(9, 20)]
    assert seconds_of(track_of(broken), frame_rate=RATE).first.tolist() == [7]


def test_mean_of_a_rate_is_the_change_of_a_quadratic():
    """The trapezoidal rule is exact for a rate that grows evenly."""
    t = np.arange(41) / RATE
    seconds = seconds_of(track_of(np.arange(1, 42)), frame_rate=RATE)
    way, speed = 3.0 * t + 0.7 * t**2, 3.0 + 1.4 * t
    found = means(speed, seconds.first, seconds.frames)
    assert len(found) == 2
    assert found == pytest.approx((way[seconds.last] - way[seconds.first]) * RATE / seconds.frames)


def test_neighbours_equal_those_found_one_by_one():
    rng = np.random.default_rng(4)
    vehicles = [(300 * rng.random(), 20 + 10 * rng.random(), int(rng.integers(0, 3)), 4.5) for _ in range(12)]
    made = traffic(vehicles, frames=60)
    direction = np.where(np.arange(12) % 3 == 0, 1, 2)
    found = neighbours(made.index, made.x, made.lane, ids=made.ids, direction=direction, frame_rate=RATE)
    vehicle = np.searchsorted(made.index.starts, np.arange(len(made.x)), side="right") - 1
    wanted = np.flatnonzero((made.index.frame % 20 == 0) & (made.lane > 0))
    assert sorted(found.row.tolist()) == wanted.tolist()
    for row, leader, follower in zip(found.row, found.leader, found.follower, strict=True):
        same = (made.index.frame == made.index.frame[row]) & (made.lane == made.lane[row])
        same &= direction[vehicle] == direction[vehicle[row]]
        ahead, behind = (same & (made.x > made.x[row])), (same & (made.x < made.x[row]))
        expected = [
            made.ids[vehicle[np.flatnonzero(ahead)[np.argmin(made.x[ahead])]]] if ahead.any() else 0,
            made.ids[vehicle[np.flatnonzero(behind)[np.argmax(made.x[behind])]]] if behind.any() else 0,
        ]
        assert [leader, follower] == expected
    assert (found.vehicle == vehicle[found.row]).all()


def test_gaps_are_between_bumpers_and_unknown_to_nobody():
    made = traffic(((0.0, 30.0, 1, 4.0), (50.0, 30.0, 1, 10.0)), frames=5)
    found = gaps_to(
        made.index, made.x, vehicle=np.array([0, 0, 0]), row=np.array([2, 3, 4]),
        leader_id=np.array([made.ids[1], 0, 777]), ids=made.ids, length=made.length,
    )  # fmt: skip
    assert found[0] == pytest.approx(43.0)
    assert np.isnan(found[1:]).all()


def test_offsets_at_a_crossing_are_from_the_marking_between_both_lanes():
    index = TrackIndex.of(np.repeat([0, 1], 4), np.tile(np.arange(1, 5), 2))
    lane = np.array([1, 1, 2, 2, 2, 2, 1, 0])
    y = np.array([3.4, 3.7, 4.1, 4.4, 4.0, 3.9, 3.5, -1.0])
    vehicle, offset, half_way = crossing_offsets(
        index, y, lane, markings={1: np.array([0.0, 3.75, 7.5]), 2: np.array([0.0, 3.5, 7.0])},
        direction=np.array([1, 2]),
    )  # fmt: skip
    assert vehicle.tolist() == [0, 1]
    assert offset == pytest.approx([0.15, 0.2])
    assert half_way == pytest.approx([0.2, 0.2])
