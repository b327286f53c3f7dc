"""The closed loop: what holds with perfect foresight, what every decision keeps, what it does without a plan."""

from dataclasses import replace
from functools import cache

import numpy as np
import planner_twin
import pytest
from made_drives import OPEN, SETTINGS, case_of, changed, drive, scene_of

from highd_lc.driving.loop import ONCE
from highd_lc.driving.world import Way, followers
from highd_lc.planning.contacts import NO_CONTACT
from highd_lc.planning.limits import limits_of, margins
from highd_lc.planning.planner import plan_one, pose
from highd_lc.planning.replay import following
from highd_lc.planning.robust import RobustProblem, plan_one_robust
from highd_lc.planning.scene import NOT_YET
from highd_lc.scoring import charges
from highd_lc.stages.closed_loop import losses_of
from highd_lc.vocab import names
from highd_lc.vocab.policy import REPLANNED
from highd_lc.vocab.settings import ValidateSettings

PLAIN = (names.BENCHMARK_REPLANNED, names.LOCAL_OPTIMUM_REPLANNED)


@cache
def driven(seed, policy, **loop):
    case = case_of(scene_of(seed), policy, **loop)
    return case, drive(case)


def total(case, loop):
    return sum(losses_of(replace(case.problem, packed=case.world), loop))


@pytest.mark.parametrize("policy", REPLANNED)
@pytest.mark.parametrize("seed", OPEN[:4])
def test_the_first_plan_of_who_knows_everything_is_the_plan_of_the_open_loop(seed, policy):
    case, loop = driven(seed, policy, leaders="recorded")
    once = REPLANNED[policy].planned_once
    if REPLANNED[policy].robust:
        wanted = plan_one_robust(RobustProblem(case.problem, case.crowd), once, names.EQUAL)
    else:
        wanted = plan_one(case.problem, once, names.EQUAL)
    assert wanted.quintic is not None
    assert loop.replans[0].plan == wanted.quintic


@pytest.mark.parametrize("policy", PLAIN)
@pytest.mark.parametrize("seed", OPEN)
def test_who_knows_everything_and_plans_once_drives_what_the_planner_replays(seed, policy):
    case = case_of(scene_of(seed), policy, leaders="recorded", every_s=ONCE)
    loop, problem = drive(case), case.problem
    plan = plan_one(problem, REPLANNED[policy].planned_once, names.EQUAL)
    wanted, found = plan.replay, loop.replay
    for name in ("x", "y", "vx", "vy", "ax", "jerk"):
        np.testing.assert_allclose(getattr(found.av, name), getattr(wanted.av, name), atol=1e-9, err_msg=name)
    for name in ("x", "v", "a", "clearance_to_T", "clearance_after_T"):
        np.testing.assert_allclose(getattr(found, name), getattr(wanted, name), atol=1e-9, err_msg=name)
    losses = charges.cumulative_losses(wanted, problem.terms, problem.scene.dt)
    table = charges.losses_at(losses, names.EQUAL, problem.terms, n=wanted.av.n, dt=problem.scene.dt)
    assert losses_of(problem, loop) == pytest.approx((table["loss_av"], table["loss_hv"]), rel=1e-12)
    assert len(loop.replans) == 1


@pytest.mark.parametrize("seed", OPEN)
def test_perfect_foresight_never_makes_planning_again_dearer(seed):
    """The plan that is driven is always among the candidates: its objective can only fall."""
    for policy in PLAIN:
        case, loop = driven(seed, policy, leaders="recorded")
        known = drive(case.foreseen())
        omega = REPLANNED[policy].omega_av(SETTINGS.loss.omega_av)
        own, once = (losses_of(case.problem, one) for one in (loop, known))
        weighed = [omega * av + (1.0 - omega) * hv for av, hv in (own, once)]
        assert weighed[0] <= weighed[1] * (1.0 + 1e-9)
        # The objective from now to H falls by what has been paid, or by more.
        verdicts = {decision.verdict for decision in loop.replans}
        assert verdicts <= {names.REPLANNED, names.KEPT}


@pytest.mark.parametrize("leaders", ["braking", "constant_speed", "constant_acceleration", "lcm", "recorded"])
def test_no_decision_breaks_the_safety_profile_by_the_twin(leaders):
    """Every permitted plan once more in plain numpy: limits of motion, distances, what the profile asks."""
    looked_at = 0
    for seed in OPEN[:5]:
        case, loop = driven(seed, names.LOCAL_OPTIMUM_REPLANNED, leaders=leaders)
        problem = case.problem
        limit = limits_of(problem.scene.v0, SETTINGS, problem.scene.wheelbase)
        for decision in loop.replans:
            if decision.verdict not in (names.REPLANNED, names.KEPT):
                continue
            plan, scene = decision.plan, decision.scene
            assert min(margins(plan, limit).values()) > -1e-6
            delta, change = plan.x_final - plan.v0 * plan.T, plan.v_end - plan.v0
            n = np.array([round(plan.T / scene.dt)])
            one = planner_twin.evaluate(n, np.array([[delta]]), np.array([[change]]), scene, problem.terms)
            assert one.unsafe[0, 0] == 0
            assert one.contact[0, 0] == NO_CONTACT
            looked_at += 1
    assert looked_at > 40


def test_the_same_drive_twice_is_the_same_to_the_bit():
    for tracker in ("none", "mpc"):
        one, other = (drive(case_of(scene_of(3), tracker=tracker)) for _ in range(2))
        assert np.array_equal(one.replay.av.x, other.replay.av.x)
        assert np.array_equal(one.replay.a, other.replay.a)
        assert [d.plan for d in one.replans] == [d.plan for d in other.replans]


@pytest.mark.parametrize("seed", OPEN[:4])
def test_the_car_under_the_mpc_drives_what_an_exact_one_would(seed):
    (_, exact), (_, tracked) = (
        driven(seed, names.BENCHMARK_REPLANNED, tracker=tracker) for tracker in ("none", "mpc")
    )
    assert tracked.max_lateral_m < 0.05
    assert np.isnan(exact.max_lateral_m)
    np.testing.assert_allclose(tracked.replay.av.y, exact.replay.av.y, atol=0.1)


def braking(seed, since, acceleration):
    """The scene with a target leader that brakes, and with room to stay behind the origin leader."""
    scene = scene_of(seed)
    far = changed(scene.target_leader, since, acceleration)
    return replace(scene, target_leader=far, next_leaders=())


@cache
def given_up():
    case = case_of(braking(4, 3, -3.0))
    return case, drive(case)


def test_an_av_turns_back_before_the_crossing_where_no_plan_is_permitted():
    case, loop = given_up()
    verdicts = [decision.verdict for decision in loop.replans]
    assert loop.status == names.ABORTED
    assert verdicts[-1] == names.TURNED_BACK
    assert loop.reason == loop.replans[-1].binding != ""
    turned = loop.replans[-1]
    av = loop.replay.av
    assert abs(av.y[turned.k]) < abs(case.problem.scene.lateral_shift) / 2
    np.testing.assert_allclose(av.y[loop.ended :], 0.0, atol=1e-9)
    assert turned.plan.D == 0.0
    assert not loop.met


def test_the_first_follower_goes_back_to_the_target_leader_when_the_av_does():
    case, loop = given_up()
    turned, world, av = loop.replans[-1].k, case.world, loop.replay.av
    # Whatever the AV does from then on, the followers do the same.
    elsewhere = replace(av, x=av.x + 5.0 * (np.arange(len(av.x)) > turned), vx=av.vx)
    way = Way(begins=loop.began, turns_back=turned)
    for one, other in zip(followers(world, av, way, k=150), followers(world, elsewhere, way, k=150), strict=True):
        np.testing.assert_array_equal(one, other)


def test_the_world_up_to_now_knows_nothing_of_later():
    case, loop = driven(3, names.LOCAL_OPTIMUM_REPLANNED)
    av, way = loop.replay.av, Way(begins=loop.began)
    whole = followers(case.world, av, way, k=150)
    for k in (0, 17, 60):
        other = replace(av, x=np.where(np.arange(151) > k, 1e4, av.x), vx=np.where(np.arange(151) > k, 3.0, av.vx))
        now = followers(case.world, other, way, k=k)
        for one, wanted in zip(now, whole, strict=True):
            np.testing.assert_allclose(one, wanted[:, : k + 1], atol=1e-9)
    x, _, _ = following(av, case.world)
    np.testing.assert_allclose(whole[0], x, atol=1e-9)


def test_a_gap_that_is_critical_at_the_start_is_waited_for():
    """Seed 15's first follower passes the critical distance while the AV waits in its lane."""
    _, loop = driven(15, names.LOCAL_OPTIMUM_REPLANNED)
    verdicts = [decision.verdict for decision in loop.replans]
    waited = verdicts.count(names.WAITED)
    assert loop.status == names.CHANGED
    assert 0 < waited == loop.began // 5
    assert verdicts[waited] == names.REPLANNED
    np.testing.assert_array_equal(loop.replay.av.y[: loop.began + 1], 0.0)
    assert loop.replans[waited].plan.v_end == pytest.approx(loop.replay.av.vx[loop.began])


def test_a_lane_change_that_is_never_permitted_is_never_begun():
    settings = ValidateSettings.model_validate({"safety": {"time_gap_s": 9.0}, "planner": {"max_delay_s": 1.0}})
    scene = scene_of(0)
    case = case_of(scene, settings=settings)
    loop = drive(case)
    assert loop.status == names.NEVER_BEGUN
    assert loop.began == loop.ended == NOT_YET
    assert loop.reason
    assert [decision.verdict for decision in loop.replans] == [names.WAITED] * 3
    stays = plan_one(pose(scene, settings), names.NO_LANE_CHANGE, names.EQUAL).replay
    np.testing.assert_allclose(loop.replay.x, stays.x, atol=1e-9)
    # It keeps the distance of its profile, and so falls behind an AV that keeps Table 3's.
    assert (loop.replay.av.x <= stays.av.x + 1e-9).all()
    alone = drive(case_of(replace(scene, origin_leader=None), settings=settings))
    free = plan_one(pose(replace(scene, origin_leader=None), settings), names.NO_LANE_CHANGE, names.EQUAL).replay
    np.testing.assert_allclose(alone.replay.av.x, free.av.x, atol=1e-9)


def test_other_followers_than_believed_make_another_drive():
    scene = scene_of(7)
    gentle = replace(scene.followers, parameters=scene.followers.parameters * [1.0, 0.5, 1.0, 1.0, 1.5, 1.0])
    world = pose(replace(scene, followers=gentle), SETTINGS)
    believed, other = case_of(scene), case_of(scene, world=world)
    one, two = drive(believed), drive(other)
    assert not np.array_equal(one.replay.x, two.replay.x)
    # What they do is what the world's drivers do behind this AV.
    x, _, _ = following(two.replay.av, world.packed)
    np.testing.assert_allclose(two.replay.x, x, atol=1e-9)
    assert other.foreseen().problem.packed is other.world
