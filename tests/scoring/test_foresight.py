"""Knowledge of the leaders: what is predicted, and that knowing more never costs the policy anything."""

from dataclasses import replace

import numpy as np
import pytest
from random_scenes import random_scene

from highd_lc.planning.planner import pose
from highd_lc.planning.pool import Goal
from highd_lc.scoring.uncertainty import with_predicted, with_predicted_leaders, with_recorded, with_replanning
from highd_lc.vocab import names
from highd_lc.vocab.settings import ValidateSettings

JOINT = Goal(names.EQUAL, 0.5)


def waits(scene, **changes):
    settings = ValidateSettings()
    planner = settings.planner.model_copy(update={"waiting": "lcm", **changes})
    return pose(scene, settings.model_copy(update={"planner": planner}))


@pytest.mark.parametrize("now", [0, 5, 50])
def test_leaders_are_recorded_until_now_and_then_keep_their_speed(now):
    scene = random_scene(np.random.default_rng(1))
    leader, seen = scene.target_leader, with_predicted_leaders(scene, now).target_leader
    np.testing.assert_array_equal(seen.x[: now + 1], leader.x[: now + 1])
    np.testing.assert_allclose(np.diff(seen.x[now:]), leader.v[now] * scene.dt, rtol=1e-9)
    assert set(seen.v[now:]) == {leader.v[now]}
    assert with_predicted_leaders(replace(scene, origin_leader=None), now).origin_leader is None


@pytest.mark.parametrize("seed", [3, 7, 16])
def test_perfect_information_is_never_worth_less_than_nothing(seed):
    problem = waits(random_scene(np.random.default_rng(seed)))
    perfect = with_recorded(problem, JOINT)
    for driven in (with_predicted(problem, JOINT), with_replanning(problem, JOINT)):
        if driven.choice is not None and not driven.touches:
            # The search's own precision is 0.1 %.
            assert driven.objective >= perfect.objective * (1 - 1e-3)


@pytest.mark.parametrize("drive", [with_predicted, with_replanning])
def test_leaders_who_keep_their_speed_hold_no_surprise(drive):
    scene = with_predicted_leaders(random_scene(np.random.default_rng(16)), 0)
    problem = waits(scene)
    assert drive(problem, JOINT).objective == pytest.approx(with_recorded(problem, JOINT).objective, rel=1e-3)


def test_a_waiting_av_plans_again_every_half_second():
    problem = waits(random_scene(np.random.default_rng(16)))
    driven = with_replanning(problem, Goal(names.EQUAL, 0.5))
    assert driven.plannings == 1 + int(round(driven.choice.delay_s / 0.1) // 5)
