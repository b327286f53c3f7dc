"""A recording's ids split at holes and jumps: rows, neighbour ids, metas and words."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from highd_lc.extraction.track_index import TrackIndex
from highd_lc.io.highd import read_recording, split_tracks

FIXTURES = Path(__file__).parents[1] / "fixtures"
COLUMNS = ("x", "y", "vx", "vy", "ax", "ay", "lane", "leader_id", "follower_id")


@pytest.fixture(scope="module")
def recording():
    return read_recording(FIXTURES, 1)


def without(recording, rows):
    """The recording without some rows."""
    tracks, ids = recording.road.tracks, ids_of(recording)
    kept = np.delete(np.arange(len(ids)), rows)
    columns = {name: getattr(tracks, name)[kept].copy() for name in COLUMNS}
    index = TrackIndex.of(ids[kept], tracks.index.frame[kept])
    return replace(recording, road=replace(recording.road, tracks=replace(tracks, index=index, **columns)))


def ids_of(recording):
    return np.repeat(recording.vehicles.id, recording.road.tracks.index.counts)


def longest(recording, count):
    return np.argsort(-recording.road.tracks.index.counts, kind="stable")[:count]


def rows_of(recording, vehicle, first, stop):
    span = recording.road.tracks.index.span(int(vehicle))
    return np.arange(span.start + first, span.start + stop)


def test_a_recording_without_breaks_stays_what_it_is(recording):
    parts = split_tracks(recording)
    assert parts.recording is recording
    assert parts.in_words() == ""
    assert parts.recorded_id.tolist() == recording.vehicles.id.tolist()


@pytest.mark.parametrize("holes", [[(30, 31)], [(30, 50)], [(20, 25), (40, 41), (60, 70)]])
def test_each_part_is_a_vehicle_of_its_own_with_the_same_rows(recording, holes):
    vehicle = longest(recording, 1)[0]
    torn = without(recording, np.concatenate([rows_of(recording, vehicle, *hole) for hole in holes]))
    parts = split_tracks(torn)
    split, ids = parts.recording, ids_of(parts.recording)
    own, highest = recording.vehicles.id[vehicle], recording.vehicles.id.max()
    assert split.vehicles.id[-len(holes) :].tolist() == [highest + 1 + k for k in range(len(holes))]
    assert parts.recorded_id[-len(holes) :].tolist() == [own] * len(holes)
    assert np.all(np.diff(split.vehicles.id) > 0)
    index = split.road.tracks.index
    assert all(np.all(np.diff(index.frame[index.span(v)]) == 1) for v in range(len(index.counts)))
    before = {
        (i, f): x for i, f, x in zip(ids_of(torn), torn.road.tracks.index.frame, torn.road.tracks.x, strict=True)
    }
    file_id = dict(zip(split.vehicles.id, parts.recorded_id, strict=True))
    after = {(file_id[i], f): x for i, f, x in zip(ids, index.frame, split.road.tracks.x, strict=True)}
    assert before == after
    metas = split.vehicles
    assert set(metas.length[parts.recorded_id == own]) == {recording.vehicles.length[vehicle]}


def test_neighbours_are_the_parts_that_are_there(recording):
    tracks = recording.road.tracks
    vehicle = next(v for v in longest(recording, 40) if np.sum(tracks.leader_id == recording.vehicles.id[v]) > 120)
    torn = without(recording, rows_of(recording, vehicle, 40, 43))
    split = split_tracks(torn).recording
    own, new = recording.vehicles.id[vehicle], split.vehicles.id[-1]
    first_frame = split.road.tracks.index.frame[split.road.tracks.index.starts[-2]]
    for name in ("leader_id", "follower_id"):
        frame, neighbour = split.road.tracks.index.frame, getattr(split.road.tracks, name)
        assert np.all(frame[neighbour == own] < first_frame)
        assert np.all(frame[neighbour == new] >= first_frame)
        count = np.sum(getattr(torn.road.tracks, name) == own)
        assert np.sum((neighbour == own) | (neighbour == new)) == count


@pytest.mark.parametrize(("dx", "dy"), [(-5.0, 0.0), (80.0, 0.0), (0.0, 3.6)])
def test_jumps_are_told_from_holes(recording, dx, dy):
    vehicle = longest(recording, 1)[0]
    rows = rows_of(recording, vehicle, 50, recording.road.tracks.index.counts[vehicle])
    tracks = recording.road.tracks
    x, y = tracks.x.copy(), tracks.y.copy()
    x[rows] += dx
    y[rows] += dy
    moved = replace(recording, road=replace(recording.road, tracks=replace(tracks, x=x, y=y)))
    parts = split_tracks(without(moved, rows_of(recording, longest(recording, 2)[1], 20, 23)))
    told = sorted((one.vehicle_id, one.missing) for one in parts.breaks)
    others = [recording.vehicles.id[v] for v in longest(recording, 2)]
    assert told == sorted([(others[0], 0), (others[1], 3)])
    frame = tracks.index.frame[rows[0]]
    assert f"vehicle {others[0]} jumps at frame {frame}" in parts.in_words()
    assert f"vehicle {others[1]} misses 3 frames before frame" in parts.in_words()
    assert "recording 01" in parts.in_words()
    assert parts.jumps(1) + parts.jumps(2) == 1
