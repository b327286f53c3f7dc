"""Plans as a car drives them: the same world around the plan itself, clearances by hand, both plants, statuses."""

from dataclasses import replace

import numpy as np
import pytest
from random_scenes import pushed, random_scene

from highd_lc.core.ellipse import ellipse_clearance
from highd_lc.planning.planner import Plan, contact_of, plan_all, plan_one, pose, reference_plans
from highd_lc.planning.start_planner import plan_starts
from highd_lc.tracking.closed_loop import track
from highd_lc.tracking.multibody import track_multibody
from highd_lc.tracking.plan_tracking import PlanTracker, planned_motion, reference_of, tracked_av
from highd_lc.vocab import names
from highd_lc.vocab.safety import SafetySettings
from highd_lc.vocab.settings import ValidateSettings
from highd_lc.vocab.tracking import INVALID_REFERENCE, KINEMATIC, LOST, MULTI_BODY, TRACKED

SETTINGS = ValidateSettings()
PROBLEM = pose(random_scene(np.random.default_rng(3)), SETTINGS)
PLANS = [p for p in plan_all(PROBLEM) + plan_starts(PROBLEM) if p.accounting == names.PRIMARY_ACCOUNTING]
CHANGING = [p for p in PLANS if p.policy != names.NO_LANE_CHANGE]
TRACKER = PlanTracker(PROBLEM)


def perfectly(plan, problem=PROBLEM):
    """The closed loop's result of a car that never leaves the plan."""
    reference = reference_of(problem, plan, plan.replay)
    result = track(reference, wheelbase=problem.scene.wheelbase, settings=SETTINGS.tracking)
    states = np.column_stack([reference.x, reference.y, reference.heading])
    velocity = np.column_stack([reference.xdot, reference.ydot])
    return replace(result, states=states, velocity=velocity), planned_motion(reference)


@pytest.mark.parametrize("plan", CHANGING, ids=lambda plan: plan.policy)
def test_around_a_car_that_never_leaves_the_plan_everything_is_as_planned(plan):
    played = TRACKER.around(plan, tracked_av(plan.replay.av, *perfectly(plan)))
    for name in ("x", "v", "a", "clearance_to_T", "clearance_after_T"):
        np.testing.assert_allclose(getattr(played, name), getattr(plan.replay, name), atol=1e-9, err_msg=name)
    for name in ("x", "y", "vx", "vy"):
        np.testing.assert_allclose(getattr(played.av, name), getattr(plan.replay.av, name), atol=1e-9)
    assert TRACKER.loss_hv(plan, played) == pytest.approx(TRACKER.loss_hv(plan, plan.replay), rel=1e-12)


@pytest.mark.parametrize(("seed", "waits", "gap"), [(7, 0.1, "recorded"), (27, 0.5, "behind_target_follower_1")])
def test_so_it_is_where_the_car_waits_or_takes_another_gap(seed, waits, gap):
    # Under the ellipses alone, for a safety profile lets neither of the two wait as long.
    alone = ValidateSettings(safety=SafetySettings(profile="paper"))
    problem = pose(random_scene(np.random.default_rng(seed)), alone)
    wanted = (names.LOCAL_OPTIMUM_START, names.PRIMARY_ACCOUNTING)
    plan = next(p for p in plan_starts(problem) if (p.policy, p.accounting) == wanted)
    assert (plan.delay_s, plan.gap) == (waits, gap)
    played = PlanTracker(problem).around(plan, tracked_av(plan.replay.av, *perfectly(plan, problem)))
    for name in ("x", "v", "a", "clearance_to_T", "clearance_after_T"):
        np.testing.assert_allclose(getattr(played, name), getattr(plan.replay, name), atol=1e-9, err_msg=name)


@pytest.mark.parametrize("plant", [KINEMATIC, MULTI_BODY])
@pytest.mark.parametrize("policy", [names.LOCAL_OPTIMUM, names.LOCAL_OPTIMUM_START])
def test_both_cars_stay_near_the_plan(policy, plant):
    plan = next(p for p in CHANGING if p.policy == policy)
    driven = TRACKER.drive(plan, plant)
    assert driven.result.status == TRACKED
    planned, tracked = (TRACKER.clearances(plan, played) for played in (plan.replay, driven.replay))
    assert planned.keys() == tracked.keys()
    for role, value in planned.items():
        assert tracked[role] == pytest.approx(value, abs=0.2), role
    assert TRACKER.loss_hv(plan, driven.replay) == pytest.approx(TRACKER.loss_hv(plan, plan.replay), rel=0.01)


def test_the_multi_body_car_steers_its_own_wheelbase():
    plan = CHANGING[1]
    reference = reference_of(PROBLEM, plan, plan.replay)
    alone = track_multibody(reference, settings=SETTINGS.tracking)
    np.testing.assert_array_equal(TRACKER.drive(plan, MULTI_BODY).result.states, alone.states)


def test_clearance_of_the_tracked_motion_by_hand():
    """Ellipses of the event's boxes, the AV's turned by the car's heading about its rear axle."""
    plan = next(p for p in CHANGING if p.policy == names.BENCHMARK)
    driven, scene = TRACKER.drive(plan, MULTI_BODY), PROBLEM.scene
    x, y, heading = driven.result.states.T
    leader, packed = scene.target_leader, PROBLEM.packed
    assert leader is not None
    r = packed.rear_to_centre
    distances = [
        ellipse_clearance(
            leader.x[k] - x[k] + r * (1 - np.cos(heading[k])),
            leader.y[k] - y[k] - r * np.sin(heading[k]),
            heading[k],
            scene.length / np.sqrt(2),
            scene.width / np.sqrt(2),
            leader.length / np.sqrt(2),
            leader.width / np.sqrt(2),
        )
        for k in range(len(x))
    ]
    index = PROBLEM.roles.index(names.TARGET_LEADER)
    assert driven.replay.clearance_to_T[index] == pytest.approx(min(distances), abs=1e-9)


def test_a_lost_clearance_is_a_violation_by_its_role():
    plan = next(p for p in CHANGING if p.policy == names.BENCHMARK)
    driven = TRACKER.drive(plan, KINEMATIC)
    index = PROBLEM.roles.index(names.TARGET_LEADER)
    closer = driven.replay.clearance_to_T.copy()
    closer[index] = -0.01
    touched = replace(driven, replay=replace(driven.replay, clearance_to_T=closer))
    assert f"clearance_{names.TARGET_LEADER}" in TRACKER.violations(touched)
    assert not [name for name in TRACKER.violations(driven) if name.startswith("clearance_")]


THROUGH = names.through(names.target_follower(2), names.target_follower(1))


@pytest.mark.parametrize("plant", [KINEMATIC, MULTI_BODY])
def test_a_plan_for_followers_who_come_near_is_driven_without_a_contact(plant):
    """The plan lies on their margin, and the car beside it moves them: by less."""
    settings = ValidateSettings(safety=SafetySettings(braking=0.0))
    problem = pose(pushed(random_scene(np.random.default_rng(22), p=2, crowding=0.5), 2.5), settings)
    plan = plan_one(problem, names.BENCHMARK, names.EQUAL)
    tracker = PlanTracker(problem)
    driven = tracker.drive(plan, plant)
    planned, found = (
        (played.x[0] - played.x[1] - problem.scene.followers.length[:2].mean()).min()
        for played in (plan.replay, driven.replay)
    )
    assert planned == pytest.approx(settings.safety.clearance_m, abs=1e-3)
    assert 1e-4 < abs(found - planned) < settings.safety.clearance_m
    assert contact_of(problem, plan.policy, driven.replay, plan.accounting) == ""


def test_each_contact_of_a_drive_has_its_cause():
    problem = pose(pushed(random_scene(np.random.default_rng(3)), 3.0, blind=True), SETTINGS)
    constant = next(p for p in reference_plans(problem, names.CONSTANT) if p.accounting == names.EQUAL)
    blind = PlanTracker(problem)
    assert blind.cause(constant, THROUGH) == names.BY_FOLLOWER_MODEL
    assert blind.cause(constant, names.through(names.EGO, names.TARGET_LEADER)) == names.BY_TRACKING
    assert blind.cause(constant, "") == ""
    # Who drives into the AV would not, were it not there.
    followers = PROBLEM.scene.followers
    x, v = followers.x.copy(), followers.v.copy()
    x[0], v[0] = x[0] / 2.0, v[0] + 30.0
    fast = replace(followers, x=x, v=v)
    problem = pose(replace(PROBLEM.scene, followers=fast), SETTINGS)
    constant = next(p for p in reference_plans(problem, names.CONSTANT) if p.accounting == names.EQUAL)
    into = names.through(names.target_follower(1), names.EGO)
    assert PlanTracker(problem).cause(constant, into) == names.BY_PLAN


def test_without_a_plan_nothing_is_driven():
    assert TRACKER.drive(Plan(names.BENCHMARK, names.EQUAL, names.INFEASIBLE), KINEMATIC) is None


@pytest.mark.parametrize("plant", [KINEMATIC, MULTI_BODY])
def test_a_plan_that_is_not_finite_is_a_status(plant):
    plan = next(p for p in CHANGING if p.policy == names.BENCHMARK)
    driven = TRACKER.drive(replace(plan, quintic=replace(plan.quintic, x_final=np.nan)), plant)
    assert (driven.result.status, driven.replay) == (INVALID_REFERENCE, None)


@pytest.mark.parametrize("plant", [KINEMATIC, MULTI_BODY])
def test_a_plan_outside_the_cars_ability_is_a_status_with_finite_numbers(plant):
    """10 m sideways within 2 s, on a slow road."""
    scene = replace(random_scene(np.random.default_rng(3), v0=8.0), lateral_shift=10.0)
    tracker = PlanTracker(pose(scene, SETTINGS))
    plan = next(p for p in plan_all(tracker.problem) if p.policy == names.CONSTANT and p.accounting == names.EQUAL)
    tight = replace(plan, quintic=replace(plan.quintic, T=2.0, x_final=10.0))
    av = replace(plan.replay.av, n=20)
    driven = tracker.drive(replace(tight, replay=replace(plan.replay, av=av)), plant)
    assert driven.result.status == LOST
    assert np.isfinite(tracker.loss_hv(plan, driven.replay))
    assert np.isfinite(list(tracker.clearances(plan, driven.replay).values())).all()
    assert tracker.violations(driven)
