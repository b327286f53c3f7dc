from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_traffic import RATE, traffic

from highd_lc.extraction.lane_change import Crossing, LaneChange, calibration_rows, role_rows
from highd_lc.extraction.roles import Maneuver, Successor, find_roles
from highd_lc.extraction.track_index import TrackIndex

CROSSES = np.where(np.arange(1, 101) < 60, 1, 2)
PAIR = ((200.0, 30.0, 2, 4.5), (160.0, 30.0, 2, 4.5))


def window_frames(made, rows):
    return made.index.frame[rows].tolist()


def test_window_is_everything_before_the_start():
    made = traffic(PAIR)
    rows = calibration_rows(made, 1, 0, lane=2, before_frame=41)
    assert window_frames(made, rows) == list(range(1, 41))
    assert rows.start >= made.index.span(1).start


def test_window_keeps_off_the_ends_of_the_section():
    made = traffic(PAIR, entry=175.0, stop=290.0)
    rows = calibration_rows(made, 1, 0, lane=2, before_frame=41)
    # The follower enters at 175 m after 0.5 s, the leader leaves at 290 m after 3.0 s.
    assert window_frames(made, rows) == list(range(6, 32))


def test_window_is_empty_without_a_leader_or_behind_another():
    made = traffic(PAIR)
    assert window_frames(made, calibration_rows(made, 1, -1, lane=2, before_frame=41)) == []
    assert window_frames(made, calibration_rows(made, 0, 1, lane=2, before_frame=41)) == []


@given(follows=st.lists(st.booleans(), min_size=60, max_size=60), before=st.integers(1, 61))
@settings(deadline=None)
def test_window_is_the_longest_run_behind_the_leader(follows, before):
    made = traffic(PAIR, frames=60)
    span = made.index.span(1)
    made.leader_id[span] = np.where(follows, 10, 30)
    found = window_frames(made, calibration_rows(made, 1, 0, lane=2, before_frame=before))
    runs, run = [], []
    for frame, good in enumerate(follows[: before - 1], start=1):
        run = [*run, frame] if good else []
        runs.append(run)
    longest = max(map(len, runs), default=0)
    assert found == ([] if longest == 0 else [one for one in runs if len(one) == longest][-1])


@pytest.fixture
def event():
    made = traffic(
        ((200.0, 30.0, CROSSES, 4.5), (260.0, 30.0, 1, 12.0), (240.0, 30.0, 2, 4.5), (170.0, 30.0, 2, 4.5))
    )
    roles = find_roles(made, Maneuver(0, 30, 60, 1, 2), max_link_m=150.0, max_followers=3)
    change = LaneChange(crossing=59, origin=1, target=2, start=29, end=79)
    return made, roles, Crossing(0, change, 60, 30, 80, "", roles)


def test_roles_have_the_rows_that_the_planner_needs(event):
    made, roles, crossing = event
    parts = {part.role: part for part in role_rows(made, crossing, roles, horizon_s=1.0)}
    assert list(parts) == ["ego", "origin_leader", "target_leader", "target_follower_1"]
    frames = {role: window_frames(made, part.rows) for role, part in parts.items()}
    assert frames["ego"] == list(range(1, 91))  # from the window on, until a second after the end
    assert frames["origin_leader"] == list(range(30, 91))
    assert frames["target_leader"][0] == frames["target_follower_1"][0] == 1
    assert window_frames(made, parts["target_follower_1"].calibration) == list(range(1, 30))


def test_ego_has_a_second_before_the_start_without_any_window(event):
    made, roles, crossing = event
    made.leader_id[:] = 0
    parts = {part.role: part for part in role_rows(made, crossing, roles, horizon_s=100.0)}
    assert window_frames(made, parts["ego"].rows) == list(range(30 - round(RATE), 101))
    assert window_frames(made, parts["target_follower_1"].rows) == list(range(30, 101))


@pytest.mark.parametrize("role", ["ego", "origin_leader", "target_leader", "target_follower_1"])
@pytest.mark.parametrize(("hole", "seen"), [((50, 53), (1, 49)), ((10, 20), (21, 91)), ((28, 29), (30, 91))])
def test_rows_of_a_role_end_at_a_hole(event, role, hole, seen):
    made, roles, crossing = event
    vehicle = {"ego": 0, "origin_leader": 1, "target_leader": 2, "target_follower_1": 3}[role]
    span = made.index.span(vehicle)
    kept = np.ones(len(made.x), bool)
    kept[span.start + hole[0] - 1 : span.start + hole[1]] = False
    columns = {name: getattr(made, name)[kept] for name in ("x", "y", "vy", "lane", "leader_id")}
    index = TrackIndex.of(np.repeat(np.arange(4), 100)[kept], made.index.frame[kept])
    torn = replace(made, index=index, **columns)
    parts = {part.role: part for part in role_rows(torn, crossing, roles, horizon_s=1.0)}
    frames = window_frames(torn, parts[role].rows)
    assert frames == list(range(frames[0], frames[-1] + 1))
    assert 30 in frames
    assert seen[0] <= frames[0]
    assert frames[-1] == min(seen[1], 90)
    for part in parts.values():
        window = window_frames(torn, part.calibration)
        assert set(window) <= set(window_frames(torn, part.rows))
        assert window == list(range(window[0], window[-1] + 1)) if window else True


def test_later_leaders_have_rows_of_their_own(event):
    made, roles, crossing = event
    later = replace(crossing, successors=(Successor(45, 1), Successor(70, -1)))
    parts = {part.role: part for part in role_rows(made, later, roles, horizon_s=1.0)}
    assert parts["target_leader_2"].vehicle == 1
    assert window_frames(made, parts["target_leader_2"].rows) == list(range(30, 91))
    assert "target_leader_3" not in parts
    too_late = replace(crossing, successors=(Successor(95, 1),))
    assert "target_leader_2" not in {part.role for part in role_rows(made, too_late, roles, horizon_s=1.0)}
