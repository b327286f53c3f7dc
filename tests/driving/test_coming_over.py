"""An origin leader that changes lane too: what an AV foresees of it, and that it stays behind it."""

from dataclasses import replace

import numpy as np
import pytest
from made_drives import SETTINGS, case_of, drive, scene_of

from highd_lc.core.ellipse import ellipse_clearance
from highd_lc.core.quintic import Quintic
from highd_lc.driving.knowledge import PERSISTS, in_the_way, known_scene
from highd_lc.driving.world import coming_over, drive_after, keeping_lane, led_by
from highd_lc.planning.later import own_lane
from highd_lc.planning.planner import pose
from highd_lc.planning.replay import drive_on, plan_motion
from highd_lc.planning.scene import Motion, pack
from highd_lc.vocab import names
from highd_lc.vocab.settings import ValidateSettings

N = 151
T = 0.1 * np.arange(N)
CLEARANCE = SETTINGS.safety.clearance_m


def leader(scene, *, ahead, v, across=0.0, since=0.0, length=4.6):
    """An origin leader, its rear ``ahead`` [m] of the AV's front, at speed v, that moves over after ``since``."""
    D = scene.lateral_shift
    y = np.sign(D) * np.minimum(across * np.maximum(T - since, 0.0), abs(D))
    x = scene.length / 2.0 + ahead + length / 2.0 + v * T
    return Motion(x, y, np.full(N, v), np.zeros(N), length, 1.9, N)


def with_leader(seed=4, **asked):
    scene = scene_of(seed)
    ahead = replace(scene, target_leader=None, next_leaders=(), origin_follower=None)
    return replace(ahead, origin_leader=leader(ahead, **asked))


def test_in_the_way_is_whom_no_box_could_pass():
    scene = with_leader(ahead=20.0, v=20.0)
    half = (scene.width + 1.9) / 2.0 + CLEARANCE
    beside = scene.lateral_shift - np.sign(scene.lateral_shift) * np.array([half - 1e-6, half + 1e-6])
    assert in_the_way(scene, scene.origin_leader, beside, CLEARANCE).tolist() == [True, False]


@pytest.mark.parametrize("how", ["braking", "constant_speed", "constant_acceleration", "lcm"])
def test_who_wanders_in_his_lane_stays_and_who_comes_over_goes_on_for_two_seconds(how):
    wanders, comes = (with_leader(ahead=30.0, v=20.0, across=speed) for speed in (0.15, 1.2))
    k = 20
    known = known_scene(wanders, pack(wanders, SETTINGS), k, how)
    np.testing.assert_array_equal(known.leader_y[0, k:], wanders.origin_leader.y[k])
    known = known_scene(comes, pack(comes, SETTINGS), k, how)
    y = comes.origin_leader.y[k] + np.sign(comes.lateral_shift) * 1.2 * np.minimum(T[: N - k], PERSISTS)
    np.testing.assert_allclose(known.leader_y[0, k:], y, atol=1e-9)


def test_it_leads_an_av_on_the_target_lane_that_is_behind_it_and_nobody_else():
    scene = with_leader(ahead=30.0, v=20.0, across=1.2)
    packed, k = pack(scene, SETTINGS), 20
    rear = scene.origin_leader.x[k] - 2.3
    before = known_scene(scene, packed, k, "constant_speed")
    past = known_scene(scene, packed, k, "constant_speed", av_front=rear + 1.0)
    behind = known_scene(scene, packed, k, "constant_speed", av_front=rear - 1.0)
    assert np.isinf(before.target_front).all()
    assert np.isinf(past.target_front).all()
    np.testing.assert_allclose(behind.target_front[k:], rear + 20.0 * T[: N - k])
    np.testing.assert_allclose(behind.target_v[k:], 20.0)


def test_a_nearer_target_leader_goes_on_leading():
    scene = with_leader(ahead=60.0, v=20.0, across=1.2)
    near = leader(scene, ahead=25.0, v=20.0)
    scene = replace(scene, target_leader=replace(near, y=near.y + scene.lateral_shift))
    packed = pack(scene, SETTINGS)
    known = known_scene(scene, packed, 20, "constant_speed", av_front=42.0)
    np.testing.assert_allclose(known.target_front, packed.target_front)


def test_after_its_lane_change_the_av_does_not_drive_through_who_came_over():
    scene = with_leader(ahead=40.0, v=scene_of(4).v0 - 4.0, across=1.0, since=4.0)
    packed = pose(scene, SETTINGS).packed
    plan = Quintic(scene.v0, scene.lateral_shift, 4.0, scene.v0 * 4.0, scene.v0)
    av, plain = plan_motion(plan, packed), plan_motion(plan, packed)
    drive_on(plain.x, plain.y, plain.vx, plain.ax, plain.jerk, plain.n, packed)
    drive_after(scene, packed, av, av.n)
    leads = coming_over(scene, packed, plain, plain.n)
    first = int(np.argmax(leads))
    assert 40 < first < 80
    assert leads[first:].all()
    np.testing.assert_array_equal(av.x[: first + 1], plain.x[: first + 1])
    rear = scene.origin_leader.x - scene.origin_leader.length / 2.0
    assert (plain.x + scene.length / 2.0 > rear)[first:].any()
    assert (av.x + scene.length / 2.0 < rear).all()
    assert np.abs(np.diff(np.append(0.0, av.ax[av.n :]))).max() <= 0.1 * SETTINGS.constraints.jerk + 1e-9


def test_who_passes_before_it_comes_over_is_not_led_by_it():
    scene = with_leader(ahead=5.0, v=scene_of(4).v0 - 10.0, across=1.0, since=6.0)
    packed = pose(scene, SETTINGS).packed
    av = plan_motion(Quintic(scene.v0, scene.lateral_shift, 4.0, scene.v0 * 4.0, scene.v0), packed)
    drive_after(scene, packed, av, av.n)
    leads = coming_over(scene, packed, av, av.n)
    assert not leads.any()
    assert led_by(packed, scene.origin_leader, leads) is packed


@pytest.mark.parametrize("policy", [names.BENCHMARK_REPLANNED, names.LOCAL_OPTIMUM_REPLANNED])
def test_a_drive_behind_who_comes_over_touches_nobody(policy):
    scene = with_leader(ahead=25.0, v=scene_of(4).v0 - 3.0, across=0.9, since=5.0)
    case = case_of(scene, policy)
    loop, known = drive(case), drive(case.foreseen())
    assert loop.status == names.CHANGED
    assert not loop.met
    assert not known.met


@pytest.mark.parametrize(("length", "by_table_3"), [(4.6, True), (18.0, False)])
def test_an_av_that_keeps_its_lane_keeps_the_distance_of_its_profile_behind_a_lorry_too(length, by_table_3):
    scene = replace(with_leader(ahead=30.0, v=3.0, length=length), v0=12.0)
    packed, rear = pose(scene, SETTINGS).packed, scene.origin_leader.x - length / 2.0

    def kept(lane):
        x, y, v, a, jerk = (np.zeros(N) for _ in range(5))
        v[0] = scene.v0
        drive_on(x, y, v, a, jerk, 0, lane)
        return x

    x = kept(keeping_lane(packed, scene.origin_leader))
    axes = packed.a, packed.b, packed.leader_a[0], packed.leader_b[0]
    assert ellipse_clearance(scene.origin_leader.x[-1] - x[-1], 0.0, 0.0, *axes) >= packed.safety.clearance
    assert (x + scene.length / 2.0 < rear).all()
    plain = kept(own_lane(packed, scene.origin_leader)) + scene.length / 2.0
    assert (plain < rear).all() == by_table_3


def test_the_paper_keeps_its_lane_by_table_3():
    scene = with_leader(ahead=30.0, v=12.0, length=18.0)
    packed = pose(scene, ValidateSettings.model_validate({"safety": {"profile": "paper"}})).packed
    lane, wanted = keeping_lane(packed, scene.origin_leader), own_lane(packed, scene.origin_leader)
    assert np.array_equal(lane.av_parameters, wanted.av_parameters)
    assert keeping_lane(packed, None).target_length == 0.0
