"""Why an AV in the closed loop touches somebody: each cause where it is the right one, and no other."""

from dataclasses import replace

import numpy as np
import pytest
from made_drives import SETTINGS, case_of, drive, scene_of, tracker_of
from random_scenes import pushed

from highd_lc.driving.causes import causes
from highd_lc.planning.planner import overlap_at_start, pose, unchanged_contacts
from highd_lc.vocab import names

THROUGH = names.through(names.target_follower(2), names.target_follower(1))
LEADER = "clearance_target_leader"


def told(case, *, met, known=()):
    """Causes of contacts that are said to be there, and of which who knows all that comes has some."""
    loop = drive(case)
    return causes(case, replace(loop, met=met), replace(loop, met=known), lambda: tracker_of(case))


def test_without_a_contact_there_is_no_cause():
    assert told(case_of(scene_of(0)), met=()) == ()


def test_what_foresight_spares_is_the_leaders_and_the_rest_is_not():
    case = case_of(scene_of(0))
    assert told(case, met=(LEADER,)) == (names.BY_LEADERS,)
    assert told(case, met=(LEADER,), known=(LEADER,)) == (names.BY_FORESIGHT,)
    assert told(case, met=(LEADER, THROUGH), known=(LEADER,)) == (names.BY_FORESIGHT, names.BY_LEADERS)


def test_followers_that_drive_through_one_another_without_a_lane_change_are_their_models():
    case = case_of(pushed(scene_of(3), 3.0, blind=True))
    assert THROUGH in unchanged_contacts(case.problem)
    assert told(case, met=(THROUGH,), known=(THROUGH,)) == (names.BY_FOLLOWER_MODEL,)
    # One that a plan can avoid is not.
    assert told(case, met=(THROUGH,)) == (names.BY_LEADERS,)


def test_followers_that_are_others_than_believed_are_told_from_leaders():
    scene = scene_of(3)
    case = case_of(scene, world=pose(pushed(scene, 3.0, blind=True), SETTINGS))
    assert told(case, met=(THROUGH, LEADER)) == (names.BY_FOLLOWERS, names.BY_LEADERS)


@pytest.mark.parametrize("name", ["clearance_origin_leader", "ego_through_origin_leader"])
def test_who_is_too_near_at_the_start_is_not_avoided_by_driving(name):
    scene = scene_of(0)
    near = scene.origin_leader
    near = replace(near, x=near.x - near.x[0] + (scene.length + near.length) / 2.0 + 1.5, y=np.zeros_like(near.y))
    case = case_of(replace(scene, origin_leader=near))
    assert overlap_at_start(case.problem) == [names.ORIGIN_LEADER]
    assert told(case, met=(name, LEADER), known=(name,)) == (names.BY_START, names.BY_LEADERS)
