"""Robust plans: the crowd's losses are those of its draws, and a crowd of one is the plain search."""

from dataclasses import replace

import numpy as np
import pytest
from random_scenes import GOALS, random_scene, reacting, task_of

from highd_lc.drivers.population import SPREAD
from highd_lc.planning.crowd import crowd_of, drawn_crowd, event_generator
from highd_lc.planning.planner import plan_all, pose
from highd_lc.planning.robust import RobustProblem, plan_robust
from highd_lc.planning.search import grid, possible_durations, search
from highd_lc.vocab import names
from highd_lc.vocab.policy import POLICIES
from highd_lc.vocab.sections import RobustSettings
from highd_lc.vocab.settings import ValidateSettings

JOINT = [goal for goal in GOALS if goal.omega_av < 1.0]
FEW = 3


def scene_of(seed):
    rng = np.random.default_rng(seed)
    return reacting(random_scene(rng, 3), rng, moment=0.5)


def crowded(task, count=FEW, seed=2, **changes):
    spread = np.tile(SPREAD, (len(task.scene.follower_x), 1))
    return drawn_crowd(task.scene, spread, count, np.random.default_rng(seed))._replace(**changes)


def coarse(task):
    return grid(task, possible_durations(task)[::9], free=True)


def same(one, other, fields):
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in fields)


def of_draw(task, crowd, draw):
    drivers = {name: getattr(crowd, name)[draw] for name in ("parameters", "reactions", "first_L")}
    return replace(task, scene=task.scene._replace(**drivers))


@pytest.mark.parametrize("seed", [1, 4])
def test_a_crowd_of_one_is_the_plain_search_bit_for_bit(seed):
    task = task_of(scene_of(seed))
    alone = replace(task, crowd=drawn_crowd(task.scene, None, 1, np.random.default_rng(0)))
    plain, robust = search(task, JOINT), search(alone, JOINT)
    assert same(plain, robust, plain.__dataclass_fields__)


def test_without_a_spread_all_draws_are_the_drivers_of_the_scene():
    task = task_of(scene_of(3))
    crowd = drawn_crowd(task.scene, None, FEW, np.random.default_rng(0))
    plain, robust = coarse(task), coarse(replace(task, crowd=crowd))
    np.testing.assert_allclose(robust.hv_H, plain.hv_H, rtol=1e-14)
    assert np.array_equal(robust.contact, plain.contact)


def test_losses_are_the_means_over_the_draws_and_the_av_has_its_own():
    task = task_of(scene_of(5))
    crowd = crowded(task)
    together = coarse(replace(task, crowd=crowd))
    apart = [coarse(of_draw(task, crowd, draw)) for draw in range(FEW)]
    for name in ("hv_T", "hv_H"):
        np.testing.assert_allclose(
            getattr(together, name), np.mean([getattr(p, name) for p in apart], axis=0), rtol=1e-12
        )
    assert same(together, apart[0], ("av_T", "av_H"))


def test_the_worst_draws_are_the_largest_losses_and_never_less_than_the_mean():
    task = task_of(scene_of(6))
    crowd = crowded(task)
    apart = np.sort([coarse(of_draw(task, crowd, draw)).hv_H for draw in range(FEW)], axis=0)
    for worst in range(1, FEW + 1):
        found = coarse(replace(task, crowd=crowd._replace(worst=worst))).hv_H
        np.testing.assert_allclose(found, apart[FEW - worst :].mean(axis=0), rtol=1e-12)
    mean, worst = (coarse(replace(task, crowd=crowd._replace(worst=k))).hv_H for k in (FEW, 1))
    assert (worst >= mean * (1.0 - 1e-12)).all()
    assert (worst > mean).any()


def test_contacts_are_those_of_the_own_drivers_or_of_any_draw():
    found = 0
    for seed in range(6):
        task = task_of(random_scene(np.random.default_rng(seed), 3, crowding=2.5))
        crowd = crowded(task)
        apart = [coarse(of_draw(task, crowd, draw)).contact for draw in range(FEW)]
        own, any_ = (
            coarse(replace(task, crowd=crowd._replace(rejects_all=every))).contact for every in (False, True)
        )
        assert np.array_equal(own, apart[0])
        assert np.array_equal(any_, np.min(apart, axis=0))
        found += int((any_ < own).sum())
    assert found


def problem_of(seed, **changes):
    settings = ValidateSettings()
    return pose(scene_of(seed), settings.model_copy(update={"robust": RobustSettings(**changes)}))


def posed(problem, others=()):
    spread = np.tile(SPREAD, (len(problem.packed.follower_x), 1))
    rng = event_generator(1, "01-0001-00001", purpose="crowd")
    crowd = crowd_of(problem.packed, spread, others, robust=problem.settings.robust, rng=rng)
    return RobustProblem(problem, crowd)


def test_no_robust_plan_is_worse_for_the_crowd_than_the_plain_one():
    problem = problem_of(7, draws=4)
    robust = posed(problem)
    plain = {(p.policy, p.accounting): p for p in plan_all(problem)}
    for plan in plan_robust(robust):
        local = plan.policy.replace("_robust", "")
        quintic = plain[local, plan.accounting].quintic
        task = replace(problem.task, crowd=robust.crowd)
        n = np.array([round(quintic.T / problem.packed.dt)])
        delta, change = quintic.x_final - quintic.v0 * quintic.T, quintic.v_end - quintic.v0
        again = task.simulate(n, np.array([[delta]]), np.array([[change]]))
        goal = next(goal for goal in JOINT if goal.accounting == plan.accounting)
        assert plan.objective <= again.unconstrained(goal)[0] * (1.0 + 1e-9)


def test_one_draw_gives_the_plain_local_optimum():
    problem = problem_of(8, draws=1)
    plain = {(p.policy, p.accounting): p for p in plan_all(problem)}
    for plan in plan_robust(posed(problem)):
        local = plain[plan.policy.replace("_robust", ""), plan.accounting]
        assert (plan.quintic, plan.objective) == (local.quintic, local.objective)


def test_other_models_take_at_most_half_of_the_places_and_draws_depend_on_the_event_alone():
    problem = problem_of(9, draws=4, aggregate="worst", worst_share=0.5)
    other = problem.packed._replace(first_L=123.0)
    crowd = posed(problem, [other] * 3).crowd
    assert (crowd.first_L == 123.0).tolist() == [False, False, True, True]
    assert crowd.worst == 2
    assert np.array_equal(crowd.parameters[0], problem.packed.parameters)
    assert np.array_equal(crowd.parameters, posed(problem, [other] * 3).crowd.parameters)


def test_robust_policies_are_compared_with_the_benchmark_of_their_form():
    assert POLICIES[names.LOCAL_OPTIMUM_ROBUST].counterpart == names.BENCHMARK
    assert POLICIES[names.LOCAL_OPTIMUM_ROBUST_FREE].counterpart == names.BENCHMARK_FREE
