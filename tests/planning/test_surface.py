from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest
from random_scenes import random_scene

from highd_lc.planning import planner
from highd_lc.planning.pareto import ON_SURFACE, LossSurface, SurfacePoint, loss_surface
from highd_lc.vocab import names
from highd_lc.vocab.settings import PlannerSettings, ValidateSettings

SETTINGS = ValidateSettings(planner=PlannerSettings(free_form=False))


def points_of(problem: planner.PlanningProblem, plans: Iterable[planner.Plan]) -> tuple[SurfacePoint, ...]:
    found = []
    for plan in plans:
        if plan.policy in ON_SURFACE and plan.replay is not None:
            av = plan.replay.av
            T = round(av.n * problem.packed.dt, 10)
            found.append(SurfacePoint(plan.policy, plan.accounting, T, float(av.x[av.n]) - problem.packed.v0 * T))
    return tuple(found)


@pytest.fixture(scope="module", params=[0, 2, 5])
def drawn(request) -> tuple[planner.PlanningProblem, list[planner.Plan], LossSurface]:
    problem = planner.pose(random_scene(np.random.default_rng(request.param)), SETTINGS)
    plans = planner.plan_all(problem)
    return problem, plans, loss_surface(problem, points_of(problem, plans))


@pytest.mark.parametrize("accounting", names.ACCOUNTINGS)
def test_no_feasible_node_beats_the_optimum(drawn, accounting):
    _, plans, surface = drawn
    for plan in plans:
        if plan.policy in names.FIXED_POLICIES and plan.accounting == accounting and plan.replay is not None:
            omega = 1.0 if plan.policy == names.BENCHMARK else SETTINGS.loss.omega_av
            assert np.nanmin(surface.joint(accounting, omega)) >= plan.objective * (1 - 1e-3)


def test_every_point_lies_on_the_surface(drawn):
    problem, plans, surface = drawn
    on = [p for p in plans if p.policy in (names.HUMAN, names.CONSTANT, *names.FIXED_POLICIES) and p.replay]
    assert len(surface.points) == len(on)
    for point in surface.points:
        assert abs(point.x_offset) < surface.x_offset[-1]
    human = next(p for p in surface.points if p.policy == names.HUMAN)
    assert pytest.approx(problem.scene.human.x[-1]) == human.x_offset + problem.scene.v0 * human.T


def test_nodes_hold_the_losses_of_single_plans(drawn):
    problem, _, surface = drawn
    for i, j in ((0, 0), (7, 20), (30, 28)):
        n = np.array([round(surface.T[i] / problem.packed.dt)])
        pool = problem.task.simulate(n, surface.x_offset[None, [j]], np.zeros((1, 1)))
        for accounting in names.ACCOUNTINGS:
            av, hv = pool.losses(accounting)
            assert surface.loss_av[accounting][i, j] == pytest.approx(av[0], rel=1e-9)
            assert surface.loss_hv[accounting][i, j] == pytest.approx(hv[0], rel=1e-9)
            assert surface.feasible[accounting][i, j] == pool.feasible(accounting)[0]
    assert surface.x_final[3] == pytest.approx(problem.scene.v0 * surface.T[3] + surface.x_offset)


def test_an_infeasible_event_has_a_surface_without_optima(drawn):
    problem, _, _ = drawn
    followers = problem.scene.followers
    inside = replace(followers, x=np.array([-1.0, *followers.x[1:]]), y=np.zeros(len(followers.y)))
    blocked = planner.pose(replace(problem.scene, followers=inside), SETTINGS)
    points = points_of(blocked, planner.plan_all(blocked))
    surface = loss_surface(blocked, points)
    assert not any(p.policy in names.FIXED_POLICIES for p in points)
    assert not any(feasible.any() for feasible in surface.feasible.values())
