"""The policies' plans: what must hold on every event, what happens when nothing is possible, the references."""

from dataclasses import replace

import numpy as np
import pytest
from random_scenes import mirrored, random_scene

from highd_lc.core.lcm import lcm_acceleration
from highd_lc.core.quintic import sample
from highd_lc.planning import planner
from highd_lc.planning.limits import CONSTRAINTS
from highd_lc.planning.planner import FORM_OF, Plan, PlanningProblem, plan_all, pose
from highd_lc.planning.scene import Motion, Scene
from highd_lc.scoring import charges
from highd_lc.vocab import names
from highd_lc.vocab.settings import ValidateSettings

SETTINGS = ValidateSettings()
EVENTS = [(seed, crowding) for seed in range(6) for crowding in (1.0, 2.0)]


def settings_with(**sections) -> ValidateSettings:
    return ValidateSettings.model_validate(sections)


def planned(scene: Scene, settings: ValidateSettings = SETTINGS) -> tuple[PlanningProblem, dict]:
    """The problem, and its plans by policy and accounting."""
    problem = pose(scene, settings)
    return problem, {(plan.policy, plan.accounting): plan for plan in plan_all(problem)}


@pytest.fixture(scope="module", params=EVENTS, ids=lambda event: f"{event[0]}-crowding-{event[1]}")
def event(request):
    seed, crowding = request.param
    return planned(random_scene(np.random.default_rng(seed), p=1 + seed % 4, crowding=crowding))


def losses(problem: PlanningProblem, plan: Plan) -> dict:
    dt = problem.scene.dt
    cumulative = charges.cumulative_losses(plan.replay, problem.terms, dt)
    return charges.losses_at(cumulative, plan.accounting, problem.terms, n=plan.replay.av.n, dt=dt)


def solved(plans: dict, *policies: str) -> bool:
    return all(plans[p, a].status == names.SOLVED for p in policies for a in names.ACCOUNTINGS)


def test_every_policy_has_a_plan_under_every_accounting(event):
    _, plans = event
    assert set(plans) == {(p, a) for p in planner.policies(SETTINGS) for a in names.ACCOUNTINGS}


def test_the_objective_is_that_of_the_losses(event):
    problem, plans = event
    for (policy, _), plan in plans.items():
        if plan.status == names.SOLVED:
            found = losses(problem, plan)
            omega = 1.0 if policy in (names.BENCHMARK, names.BENCHMARK_FREE) else 0.5
            joint = omega * found["loss_av"] + (1 - omega) * found["loss_hv"]
            assert plan.objective == pytest.approx(joint, rel=1e-9)


@pytest.mark.parametrize(("benchmark", "local"), [names.FIXED_POLICIES, names.FREE_POLICIES])
def test_each_policy_is_best_at_what_it_minimises(event, benchmark, local):
    problem, plans = event
    if not solved(plans, benchmark, local):
        pytest.skip("nothing is feasible here")
    for accounting in names.ACCOUNTINGS:
        own, joint = losses(problem, plans[benchmark, accounting]), losses(problem, plans[local, accounting])
        assert own["loss_av"] <= joint["loss_av"] * (1 + 1e-9)
        assert joint["loss_total"] <= own["loss_total"] * (1 + 1e-9)


@pytest.mark.parametrize(
    ("fixed", "free"), [(names.BENCHMARK, names.BENCHMARK_FREE), (names.LOCAL_OPTIMUM, names.LOCAL_OPTIMUM_FREE)]
)
def test_a_free_end_speed_never_costs(event, fixed, free):
    _, plans = event
    for accounting in names.ACCOUNTINGS:
        one, other = plans[fixed, accounting], plans[free, accounting]
        if one.status == names.SOLVED:
            assert other.status == names.SOLVED
            assert other.objective <= one.objective


def test_solved_plans_keep_every_limit_at_every_moment(event):
    problem, plans = event
    limit = problem.limit
    for plan in plans.values():
        if plan.status != names.SOLVED:
            continue
        s = sample(plan.quintic, np.linspace(0.0, plan.quintic.T, 2001))
        speed = np.hypot(s.vx, s.vy)
        assert limit.v_min - 1e-6 <= speed.min()
        assert speed.max() <= limit.v_max + 1e-6
        assert max(np.abs(s.ax).max(), np.abs(s.ay).max()) <= limit.acceleration + 1e-6
        assert max(np.abs(s.jx).max(), np.abs(s.jy).max()) <= limit.jerk + 1e-6
        assert min(plan.margins.values()) >= -1e-9
        assert abs(plan.quintic.T * 10 - round(plan.quintic.T * 10)) < 1e-9
        assert 2.0 <= plan.quintic.T <= 10.0


def test_the_fixed_form_ends_as_fast_as_it_starts(event):
    problem, plans = event
    for (policy, _), plan in plans.items():
        if FORM_OF.get(policy) == names.FIXED and plan.status == names.SOLVED:
            assert plan.quintic.v_end == problem.scene.v0


def test_a_mirrored_event_has_the_same_plans():
    scene = random_scene(np.random.default_rng(11), crowding=1.5)
    (one, plans), (other, flipped) = planned(scene), planned(mirrored(scene))
    for key, plan in plans.items():
        twin = flipped[key]
        assert (twin.status, twin.rejected_by, twin.candidates) == (plan.status, plan.rejected_by, plan.candidates)
        if plan.quintic is not None:
            assert twin.quintic == replace(plan.quintic, D=-plan.quintic.D)
        if plan.replay is not None:
            mine, theirs = losses(one, plan), losses(other, twin)
            assert mine["loss_total"] == theirs["loss_total"]
            assert min(plan.margins.values()) == pytest.approx(min(twin.margins.values()), abs=1e-9)


def test_overlap_at_the_start_is_a_status_with_its_margins():
    scene = random_scene(np.random.default_rng(2))
    beside = replace(scene.followers, x=scene.followers.x + 0.0, y=scene.followers.y.copy())
    beside.x[0], beside.y[0] = -1.0, 1.0
    _, plans = planned(replace(scene, followers=beside))
    for policy in FORM_OF:
        plan = plans[policy, names.EQUAL]
        assert plan.status == names.INFEASIBLE_AT_START
        assert plan.replay is None
        assert plan.margins[f"clearance_{names.target_follower(1)}"] < 0
        assert np.isnan(plan.objective)
    # Recorded all the same; the follower beside it is driven through from the crossing on.
    assert plans[names.HUMAN, names.EQUAL].status == names.CONTACT
    assert plans[names.HUMAN, names.EQUAL].replay is not None


def test_no_room_on_the_target_lane_is_a_status_with_reasons():
    scene = random_scene(np.random.default_rng(5))
    samples = len(scene.followers.recorded[0].x)
    still = np.zeros(samples)
    # A vehicle as long as a train that stays beside the AV on the target lane.
    x, y, v = scene.v0 * 0.1 * np.arange(samples), still + scene.lateral_shift, still + scene.v0
    train = Motion(x, y, v, still, 150.0, 1.9, samples)
    _, plans = planned(replace(scene, target_leader=train))
    for policy in FORM_OF:
        plan = plans[policy, names.EQUAL]
        assert plan.status == names.INFEASIBLE
        assert plan.replay is None
        assert sum(n for reason, n in plan.rejected_by.items() if names.TARGET_LEADER in reason) > 0
        assert sum(plan.rejected_by.values()) == plan.candidates
        assert plan.margins[f"clearance_{names.TARGET_LEADER}"] < 0
        assert plan.margins["speed"] > 0


def test_too_wide_a_change_is_infeasible_by_its_lateral_jerk():
    problem, plans = planned(replace(random_scene(np.random.default_rng(1)), lateral_shift=200.0))
    plan = plans[names.LOCAL_OPTIMUM, names.EQUAL]
    assert plan.status == names.INFEASIBLE
    assert plan.rejected_by["jerk_y"] == plan.candidates > 0
    assert plan.margins["jerk_y"] == pytest.approx(8.0 - 60 * 200.0 / 10**3)
    assert set(plan.margins) == set(CONSTRAINTS)
    assert len(problem.pools[names.FIXED]) == 0


def test_above_the_highest_speed_only_a_slower_end_may_help():
    _, plans = planned(random_scene(np.random.default_rng(1), v0=55.0))
    for policy in FORM_OF:
        assert plans[policy, names.EQUAL].status == names.INFEASIBLE
        assert plans[policy, names.EQUAL].margins["speed"] < 0


def test_rejections_and_feasible_candidates_add_up(event):
    problem, plans = event
    for (policy, accounting), plan in plans.items():
        if policy in FORM_OF and plan.status != names.INFEASIBLE_AT_START:
            feasible = int(problem.pools[FORM_OF[policy]].feasible(accounting).sum())
            assert sum(plan.rejected_by.values()) + feasible == plan.candidates


def test_the_constant_reference_changes_lane_in_5_5_seconds_at_its_speed(event):
    problem, plans = event
    constant = plans[names.CONSTANT, names.EQUAL]
    assert constant.status == names.REFERENCE
    assert constant.quintic.T == 5.5
    assert np.diff(constant.replay.av.x[:56]) == pytest.approx(problem.scene.v0 * 0.1)
    assert constant.replay.av.y[55:] == pytest.approx(problem.scene.lateral_shift)


def test_without_a_lane_change_nobody_notices_the_av(event):
    problem, plans = event
    stay = plans[names.NO_LANE_CHANGE, names.EQUAL].replay
    assert (stay.av.y == 0.0).all()
    assert stay.av.n == 55
    faster = pose(replace(problem.scene, v0=problem.scene.v0 + 5.0), SETTINGS)
    np.testing.assert_array_equal(planner.stay(faster).x, stay.x)


def test_without_a_lane_change_the_followers_follow_the_target_leader():
    scene = next(s for s in map(random_scene, map(np.random.default_rng, range(9))) if s.target_leader is not None)
    stay = planner.stay(pose(scene, SETTINGS))
    f, leader = scene.followers, scene.target_leader
    spacing = leader.x[0] + leader.length / 2 - f.x[0] - f.length[0] / 2
    first = lcm_acceleration(f.v[0], spacing, leader.v[0], *f.parameters[0, :5], f.L_no_change)
    assert stay.a[0, 0] == pytest.approx(first, rel=1e-12)


def test_the_human_is_never_rejected_and_its_violations_are_listed():
    scene = random_scene(np.random.default_rng(4))
    wild = replace(scene.human, ay=scene.human.ay + 9.5)
    _, plans = planned(replace(scene, human=wild))
    plan = plans[names.HUMAN, names.EQUAL]
    assert plan.replay is not None
    assert plan.status in (names.REFERENCE, names.CONTACT)
    assert plan.margins["acceleration_y"] == pytest.approx(-1.5)


def test_the_fixed_form_alone_has_no_free_policies():
    settings = settings_with(planner={"free_form": False})
    _, plans = planned(random_scene(np.random.default_rng(1)), settings)
    assert {policy for policy, _ in plans} == set(names.REFERENCE_POLICIES + names.FIXED_POLICIES)


@pytest.mark.parametrize("shares", [[0, 0, 0], [0, 1, 0, 2, 1], [None, 0, None, 1]])
def test_plans_that_share_a_motion_are_scored_once(event, shares):
    problem, _ = event
    motions = [planner.reference_plans(problem, names.CONSTANT)[0].replay for _ in range(3)]
    plans = [
        Plan(str(k), names.EQUAL, names.SOLVED, replay=None if s is None else motions[s])
        for k, s in enumerate(shares)
    ]
    scored: list[str] = []

    def score(plan: Plan) -> int | None:
        scored.append(plan.policy)
        return None if plan.replay is None else motions.index(plan.replay)

    assert planner.made_once(plans, score) == shares
    assert scored == [str(shares.index(s)) for s in dict.fromkeys(shares)]
