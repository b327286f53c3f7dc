"""Replay of one motion against the twin of the candidates, its prescribed parts, and clearances by brute force."""

from dataclasses import replace

import numpy as np
import planner_twin
import pytest
from random_scenes import random_scene, task_of

from highd_lc.core.ellipse import ellipse_clearance
from highd_lc.core.quintic import Quintic, sample
from highd_lc.planning import replay as module
from highd_lc.planning.replay import Replay, free_motion, human_motion, plan_motion, replay
from highd_lc.planning.scene import PackedScene, obstacle_roles, pack, scene_weights
from highd_lc.vocab import names
from highd_lc.vocab.safety import SafetySettings
from highd_lc.vocab.settings import LossSettings, PlannerSettings, ValidateSettings

# The drive after T of the twin: unbounded, its step onto the plan not charged.
SETTINGS = ValidateSettings(safety=SafetySettings(profile="paper"), loss=LossSettings(handover="uncounted"))


def played(seed: int, settings: ValidateSettings = SETTINGS, p: int = 3) -> tuple[PackedScene, Quintic, Replay]:
    scene = random_scene(np.random.default_rng(seed), p)
    packed = pack(scene, settings)
    plan = Quintic(v0=packed.v0, D=packed.D, T=5.2, x_final=packed.v0 * 5.2 + 3.0, v_end=packed.v0 + 1.5)
    return packed, plan, replay(plan_motion(plan, packed), packed)


@pytest.mark.parametrize("section", [{}, {"after": "constant"}, {"leader_from": "crossing"}], ids=str)
@pytest.mark.parametrize("seed", range(4))
def test_motion_is_that_of_the_twin(seed, section):
    packed, _, found = played(seed, SETTINGS.model_copy(update={"planner": PlannerSettings(**section)}))
    n, delta, change = np.array([52]), np.array([3.0]), np.array([1.5])
    terms = task_of(random_scene(np.random.default_rng(seed))).terms
    x, vx, y, vy, _, _ = planner_twin._av(n, delta, change, packed, terms)
    for mine, theirs in ((found.av.x, x), (found.av.vx, vx), (found.av.y, y), (found.av.vy, vy)):
        np.testing.assert_allclose(mine, theirs[0], rtol=1e-12, atol=1e-12)
    _, _, centres, _ = planner_twin._followers(n, x + packed.length / 2, vx, packed, terms)
    np.testing.assert_allclose(found.x, np.concatenate(centres), rtol=1e-11)
    assert found.av.crossing == 26


def test_the_plan_is_prescribed_and_its_jerk_not_counted_twice_at_its_end():
    _, plan, found = played(1)
    s = sample(plan, np.arange(53) * 0.1)
    np.testing.assert_allclose(found.av.jerk[:53], np.abs(s.jx) + np.abs(s.jy))
    np.testing.assert_allclose(found.av.jerk[53:], np.abs(np.diff(found.av.ax[52:])) / 0.1)


def test_speeds_never_fall_below_zero():
    scene = random_scene(np.random.default_rng(1), v0=12.0)
    samples = len(scene.followers.recorded[0].x)
    wall = replace(
        scene.followers.recorded[0], x=np.full(samples, 45.0), v=np.zeros(samples), y=np.full(samples, 3.0)
    )
    packed = pack(replace(scene, target_leader=wall), SETTINGS)
    plan = Quintic(v0=12.0, D=packed.D, T=3.0, x_final=36.0, v_end=12.0)
    found = replay(plan_motion(plan, packed), packed)
    assert found.av.vx.min() == 0.0
    assert found.v.min() >= 0.0
    assert (np.diff(found.av.x) >= 0.0).all()


def test_clearances_by_brute_force_over_all_samples():
    for seed in range(6):
        scene = random_scene(np.random.default_rng(seed), p=2, crowding=2.0)
        packed, _, found = pack(scene, SETTINGS), *played(seed, p=2)[1:]
        plan = Quintic(v0=packed.v0, D=packed.D, T=5.2, x_final=packed.v0 * 5.2 + 3.0, v_end=packed.v0 + 1.5)
        found = replay(plan_motion(plan, packed), packed)
        for i, role in enumerate(obstacle_roles(scene)):
            near = brute_force(role, packed, found, scene)
            to_T, after = near[:53], near[53:]
            assert found.clearance_to_T[i] == pytest.approx(np.nanmin(to_T), abs=1e-9)
            wanted = np.nanmin(after) if not np.isnan(after).all() else np.inf
            assert found.clearance_after_T[i] == pytest.approx(wanted, abs=1e-9)


def brute_force(role: str, packed: PackedScene, found: Replay, scene) -> np.ndarray:
    """Clearance to a role at every sample, NaN where it does not count."""
    last = len(found.av.x)
    if role in (names.ORIGIN_LEADER, names.TARGET_LEADER):
        motion = scene.origin_leader if role == names.ORIGIN_LEADER else scene.target_leader
        x, y, length, width = motion.x, motion.y, motion.length, motion.width
    elif role == names.ORIGIN_FOLLOWER:
        motion, last = scene.origin_follower, 27
        x = module.origin_follower_motion(found.av.x + packed.length / 2, found.av.vx, 26, packed)
        y, length, width = np.full(27, motion.y[0]), motion.length, motion.width
    else:
        rank = int(role.rsplit("_", 1)[1]) - 1
        x, y = found.x[rank], np.full(last, scene.followers.y[rank])
        length, width = scene.followers.length[rank], scene.followers.width[rank]
    near = np.full(len(found.av.x), np.nan)
    for k in range(last):
        heading = np.arctan2(found.av.vy[k], found.av.vx[k])
        r = packed.rear_to_centre
        centre = found.av.x[k] - r + r * np.cos(heading), found.av.y[k] + r * np.sin(heading)
        axes = packed.a, packed.b, length / np.sqrt(2), width / np.sqrt(2)
        near[k] = ellipse_clearance(x[k] - centre[0], y[k] - centre[1], heading, *axes)
    return near


def test_the_origin_follower_keeps_its_distance_until_the_crossing():
    scene = next(
        s for s in map(random_scene, map(np.random.default_rng, range(9))) if s.origin_follower is not None
    )
    packed = pack(scene, SETTINGS)
    front = packed.v0 * 0.1 * np.arange(151) + packed.length / 2
    found = module.origin_follower_motion(front, np.full(151, packed.v0), 30, packed)
    assert len(found) == 31
    assert found[0] == scene.origin_follower.x[0]
    assert found[1] - found[0] == pytest.approx(scene.origin_follower.v[0] * 0.1, abs=0.06)


def test_the_human_is_prescribed_until_the_end_of_its_lane_change():
    scene = random_scene(np.random.default_rng(2))
    human = replace(scene.human, y=np.linspace(0, 3.2, 56), jy=np.full(56, -0.5), crossing=31)
    packed = pack(replace(scene, human=human), SETTINGS)
    motion = human_motion(human, packed)
    assert (motion.n, motion.crossing) == (55, 31)
    np.testing.assert_array_equal(motion.jerk[:56], 0.5)
    assert (replay(motion, packed).av.y[55:] == 3.2).all()


def test_behind_the_human_half_of_the_way_is_what_its_y_says_and_not_the_lane_id_crossing():
    scene = random_scene(np.random.default_rng(2))
    y = np.linspace(0.0, scene.lateral_shift, 61)  # half of the way is sample 30
    human = replace(scene.human, **dict.fromkeys(("x", "vx", "vy", "ax", "jx", "jy"), y), y=y, crossing=41)
    moments = {0.0: 0, 0.5: 30, 0.75: 45}
    for moment, since in moments.items():
        followers = replace(scene.followers, moment=np.full(len(scene.followers.x), moment))
        packed = pack(replace(scene, human=human, followers=followers), SETTINGS)
        motion = human_motion(human, packed)
        assert (motion.crossing, module.joins(motion, packed)) == (41, since)
    plan = plan_motion(Quintic(packed.v0, packed.D, 5.0, 130.0, packed.v0), packed)
    halfway = packed._replace(reactions=np.where(np.arange(7) == 6, 0.5, packed.reactions))
    assert module.joins(plan, halfway) == plan.crossing == 25


def test_without_anything_prescribed_the_av_keeps_its_lane():
    packed = pack(random_scene(np.random.default_rng(2)), SETTINGS)
    motion = free_motion(packed)
    assert (motion.n, motion.vx[0]) == (0, packed.v0)
    assert (replay(motion, packed).av.y == 0.0).all()


def test_packing_keeps_fronts_roles_and_weights():
    scene = random_scene(np.random.default_rng(3))
    packed = pack(scene, SETTINGS)
    present = [m is not None for m in (scene.origin_leader, scene.target_leader)]
    assert len(packed.leader_x) == sum(present)
    chain = [names.target_follower(i) for i in (1, 2, 3)]
    roles = obstacle_roles(scene)
    assert [r for r in roles if r in chain] == chain
    if scene.target_leader is not None:
        np.testing.assert_allclose(packed.target_front, scene.target_leader.x + scene.target_leader.length / 2)
    spacing = -scene.followers.x + (scene.length - scene.followers.length) / 2
    sigma = np.abs(scene.followers.v - scene.v0) / np.sqrt(spacing)
    np.testing.assert_allclose(scene_weights(scene), sigma / sigma.sum())
    assert packed.a == pytest.approx(scene.length / np.sqrt(2))


def test_the_paper_s_ellipses_are_the_same_for_everybody():
    packed = pack(
        random_scene(np.random.default_rng(3)),
        ValidateSettings.model_validate({"constraints": {"ellipse": "paper"}}),
    )
    assert (packed.a, packed.b) == (2.5, 1.0)
    assert set(packed.follower_a) == {2.5}
    assert set(packed.leader_b) <= {1.0}


def test_without_a_target_leader_the_road_ahead_is_free():
    scene = replace(random_scene(np.random.default_rng(3)), target_leader=None, origin_follower=None)
    packed = pack(scene, SETTINGS)
    assert np.isinf(packed.target_front).all()
    assert len(packed.origin_follower) == 0
    plan = Quintic(v0=packed.v0, D=packed.D, T=4.0, x_final=packed.v0 * 4.0, v_end=packed.v0)
    found = replay(plan_motion(plan, packed), packed)
    A, v_desire = packed.av_parameters[1], packed.av_parameters[0]
    np.testing.assert_allclose(found.av.ax[40:], A * (1 - found.av.vx[40:] / v_desire), rtol=1e-12)


def test_the_step_onto_the_drive_after_the_plan_is_charged_where_it_is_counted():
    counted = SETTINGS.model_copy(update={"loss": LossSettings(handover="counted")})
    _, _, without = played(1)
    _, _, found = played(1, counted)
    difference = found.av.jerk - without.av.jerk
    assert difference[53] == pytest.approx(abs(found.av.ax[52]) / 0.1)
    assert abs(found.av.ax[52]) > 0.1
    assert np.count_nonzero(difference) == 1
