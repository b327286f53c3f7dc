from dataclasses import replace

import numpy as np
import pytest
from random_scenes import random_scene

from highd_lc.planning import planner
from highd_lc.scoring.uncertainty import (
    av_loss,
    best_losses,
    charged_by,
    draws_of,
    optima,
    relative_gain,
    replan,
    rescore,
    weight_of,
    with_horizon,
    with_parameters,
)
from highd_lc.vocab import names
from highd_lc.vocab.settings import PlannerSettings, ValidateSettings

FIXED_ONLY = ValidateSettings(planner=PlannerSettings(free_form=False))


@pytest.fixture(scope="module")
def problem() -> planner.PlanningProblem:
    scene = random_scene(np.random.default_rng(2))
    spread = np.tile([2.0, 0.5, 0.5, 0.5, 0.2, 0.5], (3, 1))
    return planner.pose(replace(scene, followers=replace(scene.followers, spread=spread)), FIXED_ONLY)


def test_the_own_horizon_and_parameters_change_nothing(problem):
    expected = best_losses(problem)
    assert best_losses(with_horizon(problem, 15.0)) == expected
    assert best_losses(with_parameters(problem, problem.packed.parameters.copy())) == expected


def test_losses_are_those_of_the_plans(problem):
    plans = {(p.policy, p.accounting): p for p in planner.plan_all(problem) if p.policy in planner.FORM_OF}
    found = optima(problem)
    assert found.keys() == plans.keys()
    for (policy, accounting), (av, hv) in found.items():
        omega = weight_of(problem, policy)
        assert omega * av + (1 - omega) * hv == pytest.approx(plans[policy, accounting].objective, rel=1e-12)


def test_paper_accounting_does_not_depend_on_the_horizon(problem):
    # T <= 10 s, so that no plan of the longer horizon is lost; nothing after T is charged or checked.
    short, long = optima(with_horizon(problem, 10.0)), optima(problem)
    for policy in names.FIXED_POLICIES:
        assert short[policy, names.PAPER] == pytest.approx(long[policy, names.PAPER], rel=1e-9)


def test_a_shorter_horizon_is_charged_less_and_bounds_the_duration(problem):
    short, long = best_losses(with_horizon(problem, 5.0)), best_losses(problem)
    for cell, ((av, hv), T) in short.items():
        assert T <= 5.0 + 1e-9
        if cell[1] == names.EQUAL:
            assert av + hv < sum(long[cell][0])


def test_draws_belong_to_the_event_and_keep_their_beginning(problem):
    draws = draws_of(problem, 6, seed=1)
    assert np.array_equal(draws[:4], draws_of(problem, 4, seed=1))
    assert not np.array_equal(draws, draws_of(problem, 6, seed=2))
    assert (draws.std(axis=0) > 0).all()


def test_replanning_is_never_worse_than_keeping_the_plan_under_a_draw(problem):
    draws = draws_of(problem, 3, seed=1)
    replanned = replan(problem, draws)
    for plan in planner.plan_all(problem):
        if plan.policy not in planner.FORM_OF:
            continue
        cell, omega = (plan.policy, plan.accounting), weight_of(problem, plan.policy)
        av, hv = charged_by(plan.accounting, av_loss(problem, plan), rescore(problem, plan, draws))
        kept = omega * av + (1 - omega) * hv
        best = omega * replanned.av[cell] + (1 - omega) * replanned.hv[cell]
        # A kept plan that touches a follower who brakes less is no candidate.
        candidate = _feasible(problem, plan, draws)
        assert (best[candidate] <= kept[candidate] * (1 + 1e-3)).all()
        assert replanned.total(cell) == pytest.approx(replanned.av[cell] + replanned.hv[cell])


def _feasible(problem: planner.PlanningProblem, plan: planner.Plan, draws: np.ndarray) -> np.ndarray:
    quintic, v0 = plan.quintic, problem.packed.v0
    n = np.array([round(quintic.T / problem.packed.dt)])
    delta, change = np.array([[quintic.x_final - v0 * quintic.T]]), np.array([[quintic.v_end - v0]])
    tasks = [with_parameters(problem, drawn).task for drawn in draws]
    return np.array([task.simulate(n, delta, change).feasible(plan.accounting)[0] for task in tasks])


def test_relative_gain_is_missing_where_a_total_is():
    gain = relative_gain(np.array([9.0, np.nan, 1.0]), np.array([10.0, 10.0, 0.0]))
    assert gain[0] == pytest.approx(0.1)
    assert np.isnan(gain[1:]).all()
