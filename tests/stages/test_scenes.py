"""Reading scenes: groups of rows, what is recorded of each role and until when, who leads the target lane."""

import numpy as np
import pandas as pd
import pytest
from made_tables import PLACE, RATE, SHIFT, rows, speed, tables, torn, way

from highd_lc.planning.scene import obstacle_roles, pack
from highd_lc.stages.scene_drivers import grouped
from highd_lc.stages.scenes import scene_makers
from highd_lc.vocab.errors import ArtefactError
from highd_lc.vocab.settings import ValidateSettings


def test_no_rows_are_no_groups():
    nothing = pd.DataFrame({"event_id": [], "t": []})
    assert grouped("events", nothing, by=["event_id"], order="t", columns=["t"]) == {}


def test_groups_are_ordered_slices():
    rows = pd.DataFrame({"event_id": ["a", "a", "b"], "t": [1.0, 2.0, 0.0]})
    groups = grouped("event_tracks", rows, by=["event_id"], order="t", columns=["t"])
    assert {key: of["t"].tolist() for key, of in groups.items()} == {("a",): [1.0, 2.0], ("b",): [0.0]}


@pytest.mark.parametrize(("ids", "times"), [("aba", [0.0, 1.0, 2.0]), ("aab", [2.0, 1.0, 3.0])])
def test_rows_in_another_order_are_refused(ids, times):
    rows = pd.DataFrame({"event_id": list(ids), "t": times})
    with pytest.raises(ArtefactError, match="event_tracks: rows are not ordered by event_id, t"):
        grouped("event_tracks", rows, by=["event_id"], order="t", columns=["t"])


ROLES = ("ego", "origin_leader", "target_leader", "target_follower_1")
GRID = np.arange(151) * 0.1


def scene(tracks, settings=None, **about):
    ((_, make),) = scene_makers(tables(tracks, **about), settings or ValidateSettings())
    return make()


@pytest.mark.parametrize("ratio", [0.6, 0.55])
def test_the_wheelbase_is_a_share_of_the_length(ratio):
    settings = ValidateSettings.model_validate({"tracking": {"wheelbase_ratio": ratio}})
    made = scene({r: rows(r) for r in ROLES}, settings)
    assert made.wheelbase == pytest.approx(ratio * made.length)


def motion_of(made, role):
    return made.followers.recorded[0] if role == "target_follower_1" else getattr(made, role)


@pytest.mark.parametrize("role", ROLES[1:])
@pytest.mark.parametrize(("first", "last"), [(3.0, 3.0), (2.0, 4.0), (7.0, 7.4)])
def test_nothing_is_filled_in_across_a_hole(role, first, last):
    tracks = {r: rows(r) for r in ROLES}
    tracks[role] = torn(tracks[role], first, last)
    motion = motion_of(scene(tracks), role)
    until = first - 1 / RATE
    x0 = PLACE[role][0]
    seen, after = until + 1e-9 >= GRID, until < GRID
    np.testing.assert_allclose(motion.x[seen], x0 + way(GRID[seen]), atol=1e-4)
    np.testing.assert_allclose(motion.x[after], x0 + way(until) + speed(until) * (GRID[after] - until), atol=1e-4)
    assert motion.observed == seen.sum()


@pytest.mark.parametrize("missing", [(-0.4, -0.2), (-1.0, -0.04), (7.0, 7.2), (6.04, 6.2)])
def test_a_hole_in_the_ego_leaves_the_humans_comfort_alone(missing):
    whole = scene({r: rows(r) for r in ROLES}).human
    tracks = {r: rows(r) for r in ROLES} | {"ego": torn(rows("ego"), *missing)}
    human = scene(tracks).human
    charged = [np.abs(h.jx[:61]).sum() + np.abs(h.jy[:61]).sum() for h in (human, whole)]
    assert charged[0] == pytest.approx(charged[1], rel=0.1)
    assert human.comfort_raw == pytest.approx(whole.comfort_raw, rel=1e-6)


@pytest.mark.parametrize("last", [6.0, 6.04, 8.8, 20.0])
def test_the_human_is_recorded_as_long_as_it_is_in_view(last):
    human = scene({r: rows(r, last=last) for r in ROLES}).human
    assert human.end == 60
    assert len(human.x) == int(last / 0.1 + 1e-6) + 1
    t = np.arange(len(human.x)) * 0.1
    np.testing.assert_allclose(human.x, way(t), atol=2e-3)
    np.testing.assert_allclose(human.vx, speed(t), atol=2e-2)
    np.testing.assert_allclose(human.y[61:], SHIFT, atol=2e-2)


@pytest.mark.parametrize("change", [0.72, 3.0, 8.04])
def test_the_next_leader_leads_from_when_the_first_one_has_left(change):
    tracks = {r: rows(r) for r in (*ROLES, "target_leader_2")}
    made = scene(tracks, changes=[change], later=[5])
    packed = pack(made, ValidateSettings())
    leads = change - 1e-6 > GRID
    # Gaps and speeds are those behind who leads: its rear is where it is.
    rear = np.where(leads, 40.0 - 2.5, 90.0 - 7.5) + np.where(
        GRID <= 10, way(GRID), way(10) + speed(10) * (GRID - 10)
    )
    np.testing.assert_allclose(packed.target_front - packed.target_length, rear, atol=1e-4)
    np.testing.assert_allclose(packed.target_v[GRID <= 10], speed(GRID[GRID <= 10]), atol=1e-3)
    assert obstacle_roles(made)[:3] == ("origin_leader", "target_leader_2", "target_leader")


@pytest.mark.parametrize("changes", [[2.0], [2.0, 4.0], [2.0, 4.0, 5.0]])
def test_when_the_last_one_has_left_nobody_leads(changes):
    later = {f"target_leader_{k}" for k in range(2, len(changes) + 1)}
    made = scene({r: rows(r) for r in {*ROLES, *later}}, changes=changes, later=[5, 6][: len(later)])
    packed = pack(made, ValidateSettings())
    gone = changes[-1] - 1e-6 < GRID
    np.testing.assert_array_equal(np.isinf(packed.target_front), gone)
    assert len(packed.leader_x) == 2 + len(later)  # they stay obstacles where they are


@pytest.mark.parametrize("leaders", ["lcm", "constant"])
def test_predicted_leaders_never_leave(leaders):
    settings = ValidateSettings.model_validate({"planner": {"leaders": leaders}})
    tracks = {r: rows(r) for r in (*ROLES, "target_leader_2")}
    made = scene(tracks, settings, changes=[2.0], later=[5])
    assert made.next_leaders == ()
    assert np.isfinite(pack(made, settings).target_front).all()


def test_a_later_leader_that_comes_into_view_later_has_driven_there():
    tracks = {r: rows(r) for r in ROLES} | {"target_leader_2": rows("target_leader_2", first=3.0)}
    (later,) = scene(tracks, changes=[4.0], later=[5]).next_leaders
    np.testing.assert_allclose(later.motion.x[0], 90.0 + way(3.0) - 3.0 * speed(3.0), atol=1e-6)
    np.testing.assert_allclose(later.motion.x[40], 90.0 + way(4.0), atol=1e-4)
