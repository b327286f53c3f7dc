"""Every policy under every accounted time H: nothing lasts longer, and what is cut says so."""

from dataclasses import replace

import numpy as np
import pytest
from random_scenes import random_scene

from highd_lc.planning import planner
from highd_lc.planning.limits import pairs, target_leader_lengths
from highd_lc.planning.pool import Goal
from highd_lc.planning.replay import CONSTANT_T, human_motion
from highd_lc.planning.scene import Human, NextLeader
from highd_lc.planning.sqp import multi_start
from highd_lc.planning.start_planner import plan_starts
from highd_lc.scoring import charges
from highd_lc.scoring.uncertainty import with_predicted_leaders, with_replanning
from highd_lc.stages.validate_samples import _at_bound
from highd_lc.vocab import names
from highd_lc.vocab.settings import ValidateSettings

T_HUMAN = 6.2


def settings_with(H, **planner):
    coarse = {"x_nodes": 9, "v_nodes": 3, "T_nodes_free": 5, "zoom_levels_free": 3}
    return ValidateSettings.model_validate({"loss": {"horizon_s": H}, "planner": coarse | planner})


def human(v0, seen_s):
    """A driver who changes lane in 6.2 s and is in view for longer, always at the same speed."""
    t = np.arange(round(seen_s / 0.1) + 1) * 0.1
    zero = np.zeros(len(t))
    return Human(v0 * t, zero, zero + v0, zero, zero, zero, zero, zero, 31, 0.0, end=round(T_HUMAN / 0.1))


def led_scene():
    """A scene with a target leader."""
    scenes = (random_scene(np.random.default_rng(seed)) for seed in range(20))
    return next(scene for scene in scenes if scene.target_leader is not None)


def problem_of(H, seed=2, seen_s=9.0):
    scene = random_scene(np.random.default_rng(seed), horizon=H)
    return planner.pose(replace(scene, human=human(scene.v0, seen_s)), settings_with(H))


@pytest.mark.parametrize("H", [2.0, 2.5, 5.0, 8.0, 15.0])
def test_every_policy_is_planned_and_charged_within_the_accounted_time(H):
    problem = problem_of(H)
    last = round(H / 0.1)
    for plan in [*planner.plan_all(problem), *plan_starts(problem)]:
        if plan.replay is None:
            continue
        losses = charges.cumulative_losses(plan.replay, problem.terms, 0.1)
        assert losses.av.comfort.shape == (last + 1,)
        row = charges.losses_at(losses, plan.accounting, problem.terms, n=plan.replay.av.n, dt=0.1)
        assert np.isfinite([row["loss_av"], row["loss_hv"]]).all()
        assert plan.replay.av.n <= last
        own = {names.HUMAN: T_HUMAN}.get(plan.policy, CONSTANT_T)
        if plan.status == names.REFERENCE:
            assert plan.replay.av.n * 0.1 == pytest.approx(min(own, H))
            assert _at_bound(problem, plan) == (["T"] if own > H else [])


@pytest.mark.parametrize("H", [2.0, 5.0, 15.0])
def test_waiting_and_descending_end_within_the_accounted_time(H):
    problem = problem_of(H)
    driven = with_replanning(problem, Goal(names.EQUAL, 0.5))
    assert driven.choice is None or driven.choice.delay_s + driven.choice.T <= H + 1e-9
    rng = np.random.default_rng(1)
    for descent in multi_start(problem.task, Goal(names.EQUAL, 0.5), free=True, count=2, rng=rng):
        assert descent.n <= round(H / 0.1)


@pytest.mark.parametrize(("H", "seen_s"), [(15.0, 6.2), (15.0, 9.0), (15.0, 20.0), (8.0, 9.0), (5.0, 9.0)])
def test_the_human_is_driven_by_a_model_only_out_of_view(H, seen_s):
    problem = problem_of(H, seen_s=seen_s)
    motion = human_motion(problem.scene.human, problem.packed)
    assert motion.n == round(min(T_HUMAN, H) / 0.1)
    assert motion.recorded == motion.free_from == round(min(seen_s, H) / 0.1)
    plan = planner.reference_plans(problem, names.HUMAN)[0]
    seen = plan.replay.av.recorded
    np.testing.assert_allclose(plan.replay.av.x[: seen + 1], problem.packed.v0 * 0.1 * np.arange(seen + 1))
    assert not plan.replay.av.ax[motion.n : seen].any()
    assert len(plan.replay.av.x) == round(H / 0.1) + 1


@pytest.mark.parametrize("a", [-1.5, 0.0, 2.0])
def test_the_step_onto_the_humans_drive_is_from_its_own_acceleration(a):
    def comfort(handover):
        problem = problem_of(15.0)
        settings = problem.settings.model_copy(
            update={"loss": problem.settings.loss.model_copy(update={"handover": handover})}
        )
        driver = replace(problem.scene.human, ax=problem.scene.human.ax + a)
        counted = planner.pose(replace(problem.scene, human=driver), settings)
        return planner.reference_plans(counted, names.HUMAN)[0].replay.av

    counted, uncounted = comfort("counted"), comfort("uncounted")
    step = abs(uncounted.ax[uncounted.recorded] - a) / 0.1
    assert counted.jerk.sum() - uncounted.jerk.sum() == pytest.approx(step)


def test_who_crosses_after_the_accounted_time_never_joins():
    problem = problem_of(2.0)
    plan = planner.reference_plans(problem, names.HUMAN)[0]
    lane = pairs(plan.replay, problem.packed, joins=True)
    assert all(pair.first > 20 for pair in lane[:2])


@pytest.mark.parametrize("since", [10, 40, 120])
def test_a_plan_keeps_its_distance_to_who_leads(since):
    """A leader that brakes on another lane is none: the AV drives as if the next one had always led."""
    scene = next(
        s for s in (random_scene(np.random.default_rng(k)) for k in range(20)) if s.target_leader is not None
    )
    leader = scene.target_leader
    ahead = replace(leader, x=leader.x + 60.0, length=12.0)
    gone = NextLeader(since, ahead)
    problem = planner.pose(replace(scene, next_leaders=(gone,)), settings_with(15.0))
    played = planner.reference_plans(problem, names.CONSTANT)[0].replay
    between = next(p for p in pairs(played, problem.packed, joins=True))
    rear, own = np.where(np.arange(151) < since, leader.x - leader.length / 2, ahead.x - 6.0), played.av.x
    np.testing.assert_allclose(between.gap, rear - own - scene.length / 2)
    lane = pairs(played, problem.packed, joins=True, lengths=target_leader_lengths(problem.scene))
    counted = np.arange(151) >= between.first
    spacing = between.gap + np.where(np.arange(151) < since, leader.length, 12.0)
    headway = charges.safety(lane[:1], 150)["min_time_headway_s"]
    assert headway == pytest.approx((spacing / played.av.vx)[counted & (played.av.vx > 0.1)].min())
    nobody = planner.pose(replace(scene, next_leaders=(NextLeader(since, None),)), settings_with(15.0))
    played = planner.reference_plans(nobody, names.CONSTANT)[0].replay
    lane = pairs(played, nobody.packed, joins=True)
    assert np.isinf(lane[0].gap[since:]).all()
    assert np.isfinite(charges.safety(lane, 150)["min_gap_m"])


@pytest.mark.parametrize(("now", "known"), [(0, 0), (39, 0), (40, 1), (60, 1)])
def test_nobody_foresees_that_a_leader_leaves(now, known):
    scene = next(
        s for s in (random_scene(np.random.default_rng(k)) for k in range(20)) if s.target_leader is not None
    )
    leaves = replace(scene, next_leaders=(NextLeader(40, scene.target_leader),))
    assert len(with_predicted_leaders(leaves, now).next_leaders) == known
