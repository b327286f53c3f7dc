"""What an AV could know: predictions from states at a moment, blind to what comes."""

from dataclasses import replace

import numpy as np
import pytest
from made_drives import SETTINGS, changed, scene_of

from highd_lc.driving.knowledge import BRAKES_ON, PERSISTS, known_scene, leader_at
from highd_lc.planning.scene import NextLeader, pack

HOW = ("braking", "constant_speed", "constant_acceleration", "lcm")
SCENE = scene_of(1)
PACKED = pack(SCENE, SETTINGS)


def test_perfect_foresight_is_the_scene_itself():
    assert known_scene(SCENE, PACKED, 20, "recorded") is PACKED


@pytest.mark.parametrize("how", HOW)
@pytest.mark.parametrize("k", [0, 23])
def test_nothing_that_comes_later_is_known(how, k):
    other = replace(
        SCENE,
        target_leader=changed(SCENE.target_leader, k + 1, -6.0),
        origin_leader=changed(SCENE.origin_leader, k + 1, 3.0),
        next_leaders=(NextLeader(k + 1, None),),
    )
    one, two = known_scene(SCENE, PACKED, k, how), known_scene(other, pack(other, SETTINGS), k, how)
    for name in ("leader_x", "leader_y", "target_front", "target_v"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name), err_msg=name)


@pytest.mark.parametrize("how", HOW)
def test_what_was_before_stays_and_the_present_is_seen_rightly(how):
    k = 40
    known = known_scene(SCENE, PACKED, k, how)
    np.testing.assert_array_equal(known.target_front[: k + 1], PACKED.target_front[: k + 1])
    np.testing.assert_allclose(known.target_v[k], PACKED.target_v[k])
    np.testing.assert_array_equal(known.leader_x[:, : k + 1], PACKED.leader_x[:, : k + 1])
    np.testing.assert_array_equal(known.leader_y[:, k:], np.tile(PACKED.leader_y[:, [k]], 151 - k))


def test_speed_or_acceleration_last_as_said():
    k, leader = 30, SCENE.target_leader
    t = 0.1 * np.arange(151 - k)
    still = known_scene(SCENE, PACKED, k, "constant_speed")
    np.testing.assert_allclose(still.target_front[k:], PACKED.target_front[k] + leader.v[k] * t)
    faster = known_scene(SCENE, PACKED, k, "constant_acceleration")
    np.testing.assert_allclose(faster.target_v[k:], leader.v[k] + leader.a[k] * np.minimum(t, PERSISTS))
    np.testing.assert_allclose(np.diff(faster.target_front[k:]), 0.1 * faster.target_v[k + 1 :])


def test_a_leader_that_left_leads_no_more_and_the_next_one_does():
    later = NextLeader(25, SCENE.origin_leader)
    scene = replace(SCENE, next_leaders=(NextLeader(12, None), later))
    packed = pack(scene, SETTINGS)
    assert leader_at(scene, 11) is SCENE.target_leader
    assert leader_at(scene, 12) is None
    assert leader_at(scene, 25) is SCENE.origin_leader
    alone = known_scene(scene, packed, 15, "constant_speed")
    assert np.isinf(alone.target_front[15:]).all()
    assert np.isfinite(alone.target_front[:12]).all()
    behind = known_scene(scene, packed, 30, "constant_speed")
    np.testing.assert_allclose(np.diff(behind.target_front[30:]), 0.1 * SCENE.origin_leader.v[30])


def test_who_has_been_braking_goes_on_for_a_second_and_who_gets_faster_does_not():
    t = 0.1 * np.arange(151)
    for acceleration, k in ((-2.0, 30), (-2.0, 4), (1.5, 30)):
        still = replace(SCENE.target_leader, v=np.full(151, 25.0), x=25.0 * t, a=np.zeros(151))
        scene = replace(SCENE, target_leader=changed(still, k - 4, acceleration), next_leaders=())
        known = known_scene(scene, pack(scene, SETTINGS), k, "braking")
        # Over the last second, or since t_start.
        mean = min(0.4 * acceleration / min(1.0, 0.1 * k), 0.0)
        v = 25.0 + 0.4 * acceleration + mean * np.minimum(t[: 151 - k], BRAKES_ON)
        np.testing.assert_allclose(known.target_v[k:], v, atol=1e-9)
        np.testing.assert_allclose(np.diff(known.target_front[k:]), 0.1 * v[1:], atol=1e-9)


def test_at_the_start_nothing_but_the_measured_acceleration_is_known():
    for a in (-1.5, 2.0):
        scene = replace(SCENE, target_leader=replace(SCENE.target_leader, a=np.full(151, a)), next_leaders=())
        known = known_scene(scene, pack(scene, SETTINGS), 0, "braking")
        v = scene.target_leader.v[0] + min(a, 0.0) * np.minimum(0.1 * np.arange(151), BRAKES_ON)
        np.testing.assert_allclose(known.target_v, v)
