"""Vehicles that drive through one another: named in every policy, rejected in the search, counted in draws."""

from dataclasses import replace

import numpy as np
import pytest
from random_scenes import random_scene

from highd_lc.planning import planner
from highd_lc.planning.contacts import contact_words
from highd_lc.planning.limits import first_contact
from highd_lc.planning.start_planner import plan_starts
from highd_lc.scoring.cross_scores import drawn_followers, idm_followers
from highd_lc.vocab import names
from highd_lc.vocab.sections import ConstraintSettings
from highd_lc.vocab.settings import FollowerSettings, ValidateSettings

SETTINGS = ValidateSettings()
AS_IN_0_1_0 = ValidateSettings(
    constraints=ConstraintSettings(contacts="av"), followers=FollowerSettings(b_max=0.0)
)
FIRST, SECOND = names.target_follower(1), names.target_follower(2)
RUSHING = names.through(SECOND, FIRST)


def scene_of(seed=4, *, gap=8.0, faster=16.0):
    """HV_2 comes up to HV_1, far behind the AV, at so much more speed that 9 m/s^2 do not suffice."""
    scene = random_scene(np.random.default_rng(seed), p=2)
    f, leader = scene.followers, scene.target_leader
    x = np.array([-60.0, -60.0 - (f.length[0] + f.length[1]) / 2 - gap])
    followers = replace(f, x=x, v=np.array([scene.v0, scene.v0 + faster]))
    if leader is not None:
        way = 80.0 + scene.v0 * scene.dt * np.arange(len(leader.x))
        leader = replace(leader, x=way, v=np.full(len(way), scene.v0))
    return replace(scene, followers=followers, target_leader=leader, origin_leader=None, origin_follower=None)


def cells(plans):
    return {(plan.policy, plan.accounting): plan for plan in plans}


@pytest.mark.parametrize(
    "how", [{"gap": 8.0}, {"gap": 3.0, "faster": 12.0}, {"gap": -1.0, "faster": 0.0}], ids=str
)
@pytest.mark.parametrize("policy", names.REFERENCE_POLICIES)
def test_a_reference_names_who_drives_through_whom(policy, how):
    problem = planner.pose(scene_of(**how), SETTINGS)
    for plan in planner.reference_plans(problem, policy):
        assert (plan.status, plan.contact) == (names.CONTACT, RUSHING)
    gap = plan.replay.x[0] - plan.replay.x[1] - problem.packed.follower_length.mean()
    assert gap.min() < 0.0


def test_no_plan_is_found_where_every_candidate_has_the_contact():
    problem = planner.pose(scene_of(), SETTINGS)
    for plan in planner.plan_all(problem):
        if plan.policy in names.REFERENCE_POLICIES:
            continue
        assert plan.status == names.INFEASIBLE
        assert plan.rejected_by[f"contact_{RUSHING}"] > 0
    for plan in plan_starts(problem):
        assert plan.status == names.INFEASIBLE


def test_with_the_contacts_of_0_1_0_the_same_event_is_solved():
    problem = planner.pose(scene_of(), AS_IN_0_1_0)
    plans = cells(planner.plan_all(problem))
    assert plans[names.BENCHMARK, names.EQUAL].status == names.SOLVED
    assert plans[names.NO_LANE_CHANGE, names.EQUAL].status == names.REFERENCE
    assert not any(plan.contact for plan in plans.values())


@pytest.mark.parametrize("brakes_at", [20, 70, 120])
def test_a_contact_counts_within_the_accounted_time_alone(brakes_at):
    # The leader stops dead with HV_1 close behind it: before T, after T, or so late that nobody meets it.
    scene = scene_of(gap=30.0, faster=0.0)
    leader, t = scene.target_leader, np.arange(len(scene.target_leader.x))
    x = -45.0 + scene.v0 * scene.dt * np.minimum(t, brakes_at)
    stopping = replace(leader, x=x, v=np.where(t < brakes_at, scene.v0, 0.0))
    problem = planner.pose(replace(scene, target_leader=stopping), SETTINGS)
    for plan in planner.reference_plans(problem, names.NO_LANE_CHANGE):
        last = plan.replay.av.n if plan.accounting == names.PAPER else len(plan.replay.av.x) - 1
        fronts = plan.replay.x + problem.packed.follower_length[:, None] / 2
        gap = np.vstack([x + leader.length / 2, fronts[:-1]]) - fronts - leader.length
        assert bool(plan.contact) == bool((gap[:, : last + 1] < 0.0).any())


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("crowding", [1.0, 3.0])
def test_a_solved_plan_has_no_contact(seed, crowding):
    problem = planner.pose(random_scene(np.random.default_rng(seed), crowding=crowding), SETTINGS)
    plans = planner.plan_all(problem) + (plan_starts(problem) if not planner.overlap_at_start(problem) else [])
    for plan in plans:
        if plan.status == names.SOLVED:
            assert planner.contact_of(problem, plan.policy, plan.replay, plan.accounting) == ""
        if plan.replay is not None:
            assert plan.replay.a.min() >= -SETTINGS.followers.b_max
            assert plan.replay.av.ax[plan.replay.av.n :].min() >= -SETTINGS.followers.b_max


def test_the_leader_is_driven_through_when_it_stands():
    scene = scene_of(gap=60.0, faster=0.0)
    wall = replace(scene.target_leader, x=np.full(len(scene.target_leader.x), -40.0), v=0 * scene.target_leader.v)
    problem = planner.pose(replace(scene, target_leader=wall), SETTINGS)
    plan = planner.reference_plans(problem, names.NO_LANE_CHANGE)[-1]
    assert plan.contact == names.through(FIRST, names.TARGET_LEADER)


def test_the_own_leader_counts_for_an_av_that_keeps_its_lane():
    scene = scene_of(gap=60.0, faster=0.0)
    ahead = scene.target_leader
    wall = replace(ahead, x=np.full(len(ahead.x), 12.0), y=0 * ahead.y, v=0 * ahead.v)
    problem = planner.pose(replace(scene, origin_leader=wall), SETTINGS)
    plan = planner.reference_plans(problem, names.NO_LANE_CHANGE)[-1]
    assert plan.contact == names.through(names.EGO, names.ORIGIN_LEADER)


def test_draws_with_a_contact_are_told_from_the_others():
    problem = planner.pose(scene_of(gap=60.0, faster=0.0), SETTINGS)
    plan = planner.reference_plans(problem, names.CONSTANT)[-1]
    careless = problem.packed.parameters.copy()
    careless[1] = 60.0, 1.5, 9.0, 9.0, 0.05, 2.0  # hurries up to HV_1 and sees it late
    draws = np.stack([problem.packed.parameters, careless])
    found = drawn_followers(plan.replay.av, problem.packed, problem.terms, draws)
    for k, parameters in enumerate(draws):
        packed = problem.packed._replace(parameters=parameters)
        played = planner.replay(planner.plan_motion(plan.quintic, packed), packed)
        for to_T, last in ((True, played.av.n), (False, len(played.av.x) - 1)):
            met = first_contact(played, packed, joins=True, last=last)
            assert found.touches(to_T=to_T)[k] == bool(met)


def test_the_idm_counts_as_well():
    problem = planner.pose(scene_of(gap=-1.0, faster=0.0), SETTINGS)
    plan = planner.reference_plans(problem, names.CONSTANT)[-1]
    assert idm_followers(plan.replay.av, problem.packed, problem.terms).touches(to_T=True).all()
    apart = planner.pose(scene_of(gap=60.0, faster=0.0), SETTINGS)
    plan = planner.reference_plans(apart, names.CONSTANT)[-1]
    assert not idm_followers(plan.replay.av, apart.packed, apart.terms).touches(to_T=False).any()


def test_words_of_contacts_go_by_the_lane():
    roles = (names.ORIGIN_LEADER, names.TARGET_LEADER, FIRST, SECOND, names.ORIGIN_FOLLOWER)
    words = contact_words(roles)
    assert len(words) == 4 * len(roles)
    assert words[:2] == ("clearance_origin_leader", "clearance_target_leader")
    assert words[5 + 2] == f"contact_{names.through(FIRST, names.TARGET_LEADER)}"
    assert words[5 + 3] == f"contact_{RUSHING}"
    assert words[10 + 2] == f"contact_{names.through(FIRST, names.EGO)}"
    assert words[15 + 1] == f"contact_{names.through(names.EGO, names.TARGET_LEADER)}"
