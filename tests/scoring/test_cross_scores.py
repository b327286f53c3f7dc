import numpy as np
import pytest
from random_scenes import random_scene, reacting

from highd_lc.core.lcm import MOTORWAY, idm_acceleration
from highd_lc.core.losses import charge
from highd_lc.planning import planner
from highd_lc.planning.replay import Entry, joins
from highd_lc.planning.start_planner import replay_start
from highd_lc.planning.starts import pose_starts
from highd_lc.scoring import charges
from highd_lc.scoring.cross_scores import av_charged, drawn_followers, idm_followers
from highd_lc.scoring.uncertainty import with_parameters
from highd_lc.vocab import names
from highd_lc.vocab.sections import LossSettings
from highd_lc.vocab.settings import PlannerSettings, ValidateSettings

SETTINGS = [
    ValidateSettings(),
    ValidateSettings(planner=PlannerSettings(leader_from="crossing"), loss=LossSettings(reference="one-sided")),
    ValidateSettings(loss=LossSettings(reference="own", aggregation="sum")),
]
CASES = [(k, settings) for k in range(4) for settings in SETTINGS]


def posed(seed: int, settings: ValidateSettings) -> tuple[planner.PlanningProblem, planner.Plan]:
    problem = planner.pose(random_scene(np.random.default_rng(seed)), settings)
    return problem, planner.reference_plans(problem, names.CONSTANT)[0]


@pytest.mark.parametrize(("seed", "settings"), CASES)
def test_with_the_planned_parameters_the_losses_are_those_of_the_replay(seed, settings):
    problem, plan = posed(seed, settings)
    av, packed, terms = plan.replay.av, problem.packed, problem.terms
    same = drawn_followers(av, packed, terms, np.repeat(packed.parameters[None], 3, axis=0))
    losses = charges.cumulative_losses(plan.replay, terms, packed.dt)
    for accounting, hv, own in (("paper", same.to_T, 0), ("equal", same.to_H, 1)):
        expected = charges.losses_at(losses, accounting, terms, n=av.n, dt=packed.dt)
        assert hv == pytest.approx([expected["loss_hv"]] * 3, rel=1e-9)
        assert av_charged(av, terms)[own] == pytest.approx(expected["loss_av"], rel=1e-9)


@pytest.mark.parametrize(("seed", "settings"), CASES)
def test_drawn_parameters_give_the_losses_of_an_event_posed_with_them(seed, settings):
    problem, plan = posed(seed, settings)
    rng = np.random.default_rng(9)
    drawn = problem.packed.parameters * rng.uniform(0.9, 1.1, (5, *problem.packed.parameters.shape))
    together = drawn_followers(plan.replay.av, problem.packed, problem.terms, drawn)
    for k, one in enumerate(drawn):
        first_L = problem.packed.first_L + one[0, 5] - problem.packed.parameters[0, 5]
        packed = problem.packed._replace(parameters=one, first_L=first_L)
        alone = drawn_followers(plan.replay.av, packed, problem.terms, one[None])
        assert together.to_T[k] == pytest.approx(alone.to_T[0], rel=1e-9)
        assert together.to_H[k] == pytest.approx(alone.to_H[0], rel=1e-9)


def plain_idm(problem: planner.PlanningProblem, plan: planner.Plan) -> tuple[float, float]:
    """The twin: followers one instant at a time, losses by ``scoring``."""
    packed, av = problem.packed, plan.replay.av
    p, samples = len(packed.follower_x), len(av.x)
    entry = plan.replay.entry or Entry(1, None, packed.target_front, packed.target_v)
    who = entry.place - 1
    since = max(joins(av, packed, max(who, 0)), entry.hand_over or 0)
    v, a = np.empty((p, samples)), np.empty((p, samples))
    fronts, speeds = packed.follower_x + packed.follower_length / 2, packed.follower_v.copy()
    for k in range(samples):
        target = (entry.target_front[k], entry.target_v[k], packed.target_length)
        chain = [target, *zip(fronts, speeds, packed.follower_length, strict=True)]
        v[:, k] = speeds
        for i in range(p):
            ahead = (av.x[k] + packed.length / 2, av.vx[k], packed.length)
            front, speed, length = ahead if i == who and k >= since else chain[i]
            a[i, k] = idm_acceleration.py_func(speeds[i], front - length - chain[i + 1][0], speed, MOTORWAY)
        speeds = np.maximum(0.0, speeds + a[:, k] * packed.dt)
        fronts = fronts + speeds * packed.dt
    terms = problem.terms
    steps = np.abs(np.diff(a, prepend=a[:, :1])) / packed.dt
    if entry.hand_over is not None:
        steps[who, entry.hand_over] = 0.0
    loss = terms.weights @ charge(v, steps, terms.hv_ref[:, None], terms).loss
    return loss[av.n], loss[-1]


@pytest.mark.parametrize(("seed", "settings"), CASES)
def test_idm_followers_equal_the_plain_twin(seed, settings):
    problem, plan = posed(seed, settings)
    found = idm_followers(plan.replay.av, problem.packed, problem.terms)
    assert (found.to_T[0], found.to_H[0]) == pytest.approx(plain_idm(problem, plan), rel=1e-9)


def plans_into_every_gap(seed: int, **reactions) -> tuple[planner.PlanningProblem, list[planner.Plan]]:
    """A plan for some starts of every gap that has one: reached by the search or not, its losses must be right."""
    settings = ValidateSettings(planner=PlannerSettings(waiting="lcm", latest_end_s=15.0, free_form=False))
    rng = np.random.default_rng(seed)
    scene = random_scene(rng)
    problem = planner.pose(reacting(scene, rng, **reactions) if reactions else scene, settings)
    posed = pose_starts(problem)
    keys = [
        (gap, int(d))
        for gap in range(len(posed.gaps))
        for d in posed.delays(gap)[:: len(posed.delays(gap)) // 3 or 1]
    ]
    quintics = [posed.task(key).quintic(45, 2.0, 0.0) for key in keys]
    replays = [replay_start(posed, key, quintic) for key, quintic in zip(keys, quintics, strict=True)]
    return problem, [
        planner.Plan("start", "equal", names.SOLVED, q, r) for q, r in zip(quintics, replays, strict=True)
    ]


@pytest.mark.parametrize("seed", [3, 5, 6, 14, 23])
def test_followers_of_a_chosen_start_are_those_of_its_replay_and_of_the_idm_twin(seed):
    problem, plans = plans_into_every_gap(seed)
    assert len(plans) > 3
    packed, terms = problem.packed, problem.terms
    for plan in plans:
        av, entry = plan.replay.av, plan.replay.entry
        same = drawn_followers(av, packed, terms, packed.parameters[None], entry)
        losses = charges.cumulative_losses(plan.replay, terms, packed.dt)
        for accounting, hv in (("paper", same.to_T), ("equal", same.to_H)):
            expected = charges.losses_at(losses, accounting, terms, n=av.n, dt=packed.dt)
            assert hv[0] == pytest.approx(expected["loss_hv"], rel=1e-9)
        found = idm_followers(av, packed, terms, entry)
        assert (found.to_T[0], found.to_H[0]) == pytest.approx(plain_idm(problem, plan), rel=1e-9)


def test_drawn_followers_of_a_chosen_start_are_those_of_an_event_posed_with_them():
    problem, plans = plans_into_every_gap(14)
    rng = np.random.default_rng(9)
    drawn = problem.packed.parameters * rng.uniform(0.9, 1.1, (3, *problem.packed.parameters.shape))
    for plan in plans:
        av, entry = plan.replay.av, plan.replay.entry
        together = drawn_followers(av, problem.packed, problem.terms, drawn, entry)
        for k, one in enumerate(drawn):
            alone = drawn_followers(av, with_parameters(problem, one).packed, problem.terms, one[None], entry)
            assert together.to_H[k] == pytest.approx(alone.to_H[0], rel=1e-9)


@pytest.mark.parametrize("moment", [0.0, 0.3, 0.5, 0.7])
@pytest.mark.parametrize("family", names.FAMILIES)
def test_followers_that_react_are_scored_as_they_are_replayed(family, moment):
    problem, plans = plans_into_every_gap(14, family=family, moment=moment)
    rng = np.random.default_rng(1)
    problem_at_once = planner.pose(
        reacting(random_scene(rng), rng, family=family, moment=moment), problem.settings
    )
    at_once = planner.reference_plans(problem_at_once, names.CONSTANT)[0]
    assert {plan.replay.entry.place for plan in plans} >= {1, 2}
    for posed_one, plan in [(problem, plan) for plan in plans] + [(problem_at_once, at_once)]:
        packed, terms = posed_one.packed, posed_one.terms
        av, entry = plan.replay.av, plan.replay.entry
        same = drawn_followers(av, packed, terms, np.repeat(packed.parameters[None], 2, axis=0), entry)
        losses = charges.cumulative_losses(plan.replay, terms, packed.dt)
        for accounting, hv in (("paper", same.to_T), ("equal", same.to_H)):
            expected = charges.losses_at(losses, accounting, terms, n=av.n, dt=packed.dt)
            assert hv == pytest.approx([expected["loss_hv"]] * 2, rel=1e-9)
