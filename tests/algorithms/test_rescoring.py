import numpy as np
import pytest
from random_scenes import random_scene

from highd_lc.algorithms import planner, scoring
from highd_lc.algorithms.rescoring import av_charged, idm_followers, lcm_followers
from highd_lc.core.idm import MOTORWAY, idm_acceleration
from highd_lc.vocab import names
from highd_lc.vocab.settings import LossSettings, PlannerSettings, ValidateSettings

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
    same = lcm_followers(av, packed, terms, np.repeat(packed.parameters[None], 3, axis=0))
    losses = scoring.cumulative_losses(plan.replay, terms, settings.loss, packed.dt)
    for accounting, hv, own in (("paper", same.to_T, 0), ("equal", same.to_H, 1)):
        expected = scoring.losses_at(losses, accounting, terms, n=av.n, dt=packed.dt)
        assert hv == pytest.approx([expected["loss_hv"]] * 3, rel=1e-9)
        assert av_charged(av, terms)[own] == pytest.approx(expected["loss_av"], rel=1e-9)


@pytest.mark.parametrize(("seed", "settings"), CASES)
def test_drawn_parameters_give_the_losses_of_an_event_posed_with_them(seed, settings):
    problem, plan = posed(seed, settings)
    rng = np.random.default_rng(9)
    drawn = problem.packed.parameters * rng.uniform(0.9, 1.1, (5, *problem.packed.parameters.shape))
    together = lcm_followers(plan.replay.av, problem.packed, problem.terms, drawn)
    for k, one in enumerate(drawn):
        first_L = problem.packed.first_L + one[0, 5] - problem.packed.parameters[0, 5]
        packed = problem.packed._replace(parameters=one, first_L=first_L)
        alone = lcm_followers(plan.replay.av, packed, problem.terms, one[None])
        assert together.to_T[k] == pytest.approx(alone.to_T[0], rel=1e-9)
        assert together.to_H[k] == pytest.approx(alone.to_H[0], rel=1e-9)


def plain_idm(problem: planner.PlanningProblem, plan: planner.Plan) -> tuple[float, float]:
    """The twin: followers one instant at a time, losses by ``scoring``."""
    packed, av = problem.packed, plan.replay.av
    p, samples = len(packed.follower_x), len(av.x)
    insertion = av.crossing if packed.from_crossing else 0
    v, a = np.empty((p, samples)), np.empty((p, samples))
    fronts, speeds = packed.follower_x + packed.follower_length / 2, packed.follower_v.copy()
    for k in range(samples):
        ahead = (av.x[k] + packed.length / 2, av.vx[k], packed.length)
        if k < insertion:
            ahead = (packed.target_front[k], packed.target_v[k], packed.target_length)
        before = [ahead, *zip(fronts, speeds, packed.follower_length, strict=True)]
        v[:, k] = speeds
        for i in range(p):
            front, speed, length = before[i]
            a[i, k] = idm_acceleration.py_func(speeds[i], front - length - before[i + 1][0], speed, MOTORWAY)
        speeds = np.maximum(0.0, speeds + a[:, k] * packed.dt)
        fronts = fronts + speeds * packed.dt
    settings, terms = problem.settings.loss, problem.terms
    comfort = np.cumsum(np.abs(np.diff(a, prepend=a[:, :1])) / packed.dt, axis=1) / settings.comfort_scale
    both = comfort + scoring.follower_efficiency(v, terms, settings)
    loss = 0.5 * terms.weights @ both
    return loss[av.n], loss[-1]


@pytest.mark.parametrize(("seed", "settings"), CASES)
def test_idm_followers_equal_the_plain_twin(seed, settings):
    problem, plan = posed(seed, settings)
    found = idm_followers(plan.replay.av, problem.packed, problem.terms)
    assert (found.to_T[0], found.to_H[0]) == pytest.approx(plain_idm(problem, plan), rel=1e-9)
