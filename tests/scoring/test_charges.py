"""Losses and safety of a replayed motion, by hand and against the candidates."""

from dataclasses import replace

import numpy as np
import pytest
from random_scenes import random_scene, task_of

from highd_lc.planning.limits import Pair, pairs
from highd_lc.planning.planner import pose
from highd_lc.planning.replay import plan_motion, replay
from highd_lc.scoring import charges
from highd_lc.vocab import names
from highd_lc.vocab.policy import ACCOUNTINGS
from highd_lc.vocab.settings import ValidateSettings


@pytest.fixture(
    params=[{}, {"reference": "one-sided"}, {"reference": "own"}, {"aggregation": "sum"}, {"handover": "counted"}],
    ids=str,
)
def scored(request):
    """A candidate of the pool, the same one replayed, and its losses."""
    settings = ValidateSettings.model_validate({"loss": request.param})
    scene = random_scene(np.random.default_rng(1))
    problem, task = pose(scene, settings), task_of(scene, settings)
    pool = task.simulate(np.array([57]), np.array([[2.0]]), np.array([[1.0]]))
    played = replay(plan_motion(task.quintic(57, 2.0, 1.0), problem.packed), problem.packed)
    return problem, pool, played, charges.cumulative_losses(played, problem.terms, 0.1)


def test_the_scores_are_those_of_the_candidate(scored):
    problem, pool, _, losses = scored
    for accounting in names.ACCOUNTINGS:
        found = charges.losses_at(losses, accounting, problem.terms, n=57, dt=0.1)
        av, hv = pool.losses(accounting)
        assert found["loss_av"] == pytest.approx(av[0], rel=1e-10)
        assert found["loss_hv"] == pytest.approx(hv[0], rel=1e-10)


def test_the_columns_add_up(scored):
    problem, _, _, losses = scored
    found = charges.losses_at(losses, names.EQUAL, problem.terms, n=57, dt=0.1)
    assert found["loss_av"] == pytest.approx(0.5 * found["av_comfort"] + 0.5 * found["av_efficiency"])
    assert found["loss_hv"] == pytest.approx(np.dot(found["follower_weights"], found["loss_hv_each"]))
    assert found["loss_total"] == found["loss_av"] + found["loss_hv"]
    assert found["loss_av_dt"] == pytest.approx(0.1 * found["loss_av"])


def test_each_accounting_charges_its_time():
    assert ACCOUNTINGS[names.PAPER].charged(57, 150) == (57, 57)
    assert ACCOUNTINGS[names.FOLLOWER_HORIZON].charged(57, 150) == (57, 150)
    assert ACCOUNTINGS[names.EQUAL].charged(57, 150) == (150, 150)


def test_recorded_followers_count_while_they_are_in_view():
    scene = random_scene(np.random.default_rng(1), p=2)
    problem = pose(scene, ValidateSettings())
    played = replay(plan_motion(task_of(scene).quintic(57, 0.0, 0.0), problem.packed), problem.packed)
    losses = charges.cumulative_losses(played, problem.terms, 0.1)
    # Recorded exactly as simulated, the first follower for 3 s, the second for 1 s.
    recorded = tuple(
        replace(m, v=played.v[i], a=played.a[i], observed=n)
        for i, (m, n) in enumerate(zip(scene.followers.recorded, (31, 11), strict=True))
    )
    found = charges.recorded_loss(recorded, losses, problem.terms, last=57, dt=0.1)
    assert found["recorded_n_samples"] == 42
    assert found["loss_hv_recorded"] == pytest.approx(found["loss_hv_simulated"], rel=1e-12)
    each = losses.hv.comfort + losses.hv.efficiency
    wanted = 0.5 * (problem.terms.weights[0] * each[0, 30] + problem.terms.weights[1] * each[1, 10])
    assert found["loss_hv_recorded"] == pytest.approx(wanted)


def test_nobody_recorded_is_unavailable_not_zero():
    scene = random_scene(np.random.default_rng(1), p=1)
    problem = pose(scene, ValidateSettings())
    played = replay(plan_motion(task_of(scene).quintic(57, 0.0, 0.0), problem.packed), problem.packed)
    losses = charges.cumulative_losses(played, problem.terms, 0.1)
    unseen = (replace(scene.followers.recorded[0], observed=1),)
    found = charges.recorded_loss(unseen, losses, problem.terms, last=57, dt=0.1)
    assert np.isnan(found["loss_hv_recorded"])
    assert found["recorded_n_samples"] == 0


def pair(gap, v, v_leader, first=0):
    known = (np.array(gap, float), np.array(v, float), np.array(v_leader, float), 5.0, first, "behind", "ahead")
    return Pair(*known, front=np.zeros(len(gap)))


def test_safety_by_hand():
    found = charges.safety([pair([20, 10, 15], [20, 20, 10], [20, 15, 12])], 2)
    assert found["min_gap_m"] == 10.0
    assert found["min_time_headway_s"] == pytest.approx(15 / 20)
    assert found["min_ttc_s"] == pytest.approx(10 / 5)
    assert found["max_drac"] == pytest.approx(25 / 20)


def test_who_does_not_close_in_has_no_time_to_collision():
    found = charges.safety([pair([20, 30], [10, 10], [15, 15])], 1)
    assert np.isnan(found["min_ttc_s"])
    assert np.isnan(found["max_drac"])
    assert found["min_gap_m"] == 20.0


def test_who_stands_has_no_time_headway():
    assert np.isnan(charges.safety([pair([2, 2], [0, 0], [0, 0])], 1)["min_time_headway_s"])


def test_samples_before_the_crossing_and_after_the_charged_time_do_not_count():
    lane = [pair([1, 9, 8, 2], [10] * 4, [10] * 4, first=1)]
    assert charges.safety(lane, 2)["min_gap_m"] == 8.0
    assert charges.safety(lane, 3)["min_gap_m"] == 2.0
    # Who crosses after the charged time is nobody's neighbour within it.
    assert np.isnan(charges.safety([pair([5, 4, 3], [10] * 3, [10] * 3, first=9)], 1)["min_gap_m"])


def test_an_empty_lane_has_no_safety():
    assert all(np.isnan(value) for value in charges.safety([], 5).values())


def test_the_av_joins_between_target_leader_and_first_follower():
    scene = next(s for s in map(random_scene, map(np.random.default_rng, range(9))) if s.target_leader is not None)
    problem = pose(scene, ValidateSettings())
    played = replay(plan_motion(task_of(scene).quintic(60, 0.0, 0.0), problem.packed), problem.packed)
    joined = pairs(played, problem.packed, joins=True)
    apart = pairs(played, problem.packed, joins=False)
    assert [p.first for p in joined] == [30, 30, 0, 0]
    assert [p.first for p in apart] == [0, 0, 0]
    gap = scene.target_leader.x - scene.target_leader.length / 2 - played.av.x - scene.length / 2
    np.testing.assert_allclose(joined[0].gap, gap)
    np.testing.assert_allclose(joined[1].v_leader, played.av.vx)


def test_peak_deceleration_is_positive_and_only_of_braking():
    assert charges.peak_deceleration(np.array([[1.0, -2.0, -9.0], [0.0, -3.0, 0.0]]), 1) == 3.0
    assert charges.peak_deceleration(np.array([[1.0, 0.5]]), 1) == 0.0
