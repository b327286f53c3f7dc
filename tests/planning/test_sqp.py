import numpy as np
import pytest
from random_scenes import random_scene, task_of
from scipy.optimize import approx_fprime

from highd_lc.planning.pool import Goal
from highd_lc.planning.replay import plan_motion, replay
from highd_lc.planning.search import search
from highd_lc.planning.sqp import FIRST_T, Relaxation, multi_start, separations, starts
from highd_lc.vocab import names
from highd_lc.vocab.safety import SafetySettings
from highd_lc.vocab.settings import ValidateSettings

ELLIPSES_ALONE = ValidateSettings(safety=SafetySettings(profile="paper"))
"""SLSQP knows no more of what stands in the way."""
GOAL = Goal(names.EQUAL, 0.5)


def test_separation_is_negative_exactly_where_ellipses_clearly_overlap():
    agree = 0
    for seed in range(12):
        task = task_of(random_scene(np.random.default_rng(seed), crowding=2.5), ELLIPSES_ALONE)
        for delta in (-8.0, 0.0, 8.0):
            played = replay(plan_motion(task.quintic(55, delta, 0.0), task.scene), task.scene)
            exact = np.minimum(played.clearance_to_T, played.clearance_after_T)
            found = separations(np.array([55]), np.array([delta]), np.zeros(1), task.scene, to_T=False)[0]
            clear = np.isfinite(exact) & (np.abs(exact) > 0.1)
            assert (np.sign(found[clear]) == np.sign(exact[clear])).all()
            agree += int(clear.sum())
    assert agree > 60


@pytest.mark.parametrize("free", [False, True])
def test_gradients_equal_finite_differences(free):
    relaxed = Relaxation(task_of(random_scene(np.random.default_rng(3)), ELLIPSES_ALONE), GOAL, free)
    x = relaxed.point(6.237, 3.1, 1.3 if free else 0.0)
    assert relaxed.gradient(x) == pytest.approx(approx_fprime(x, relaxed.value, 1e-6), rel=1e-2, abs=1e-2)
    numeric = np.stack([approx_fprime(x, lambda p, i=i: relaxed.margins(p)[i], 1e-6)
                        for i in range(len(relaxed.margins(x)))])  # fmt: skip
    assert relaxed.margins_gradient(x) == pytest.approx(numeric, abs=1e-2)


def test_on_the_grid_the_relaxed_objective_is_the_exact_one():
    task = task_of(random_scene(np.random.default_rng(3)), ELLIPSES_ALONE)
    pool = task.simulate(np.array([52]), np.array([[2.0]]), np.array([[1.0]]))
    relaxed = Relaxation(task, GOAL, free=True)
    exact = 0.5 * (pool.av_H[0] + pool.hv_H[0])
    assert relaxed.value(relaxed.point(5.2, 2.0, 1.0)) == pytest.approx(exact, rel=1e-9)


def test_points_and_unknowns_are_inverse():
    task = task_of(random_scene(np.random.default_rng(3)), ELLIPSES_ALONE)
    for relaxed in (Relaxation(task, GOAL, True), Relaxation(task, GOAL, True, n=50)):
        assert relaxed.unknowns(relaxed.point(5.0, 2.0, 1.0)) == pytest.approx((5.0, 2.0, 1.0))


def test_first_start_is_constant_speed_and_all_are_seeded():
    task = task_of(random_scene(np.random.default_rng(3)), ELLIPSES_ALONE)
    found = starts(task, 4, free=True, rng=np.random.default_rng(0))
    assert found[0] == (FIRST_T, 0.0, 0.0)
    assert found == starts(task, 4, free=True, rng=np.random.default_rng(0))
    assert len(set(found)) == 4


@pytest.mark.parametrize("seed", range(6))
def test_descents_end_in_feasible_plans_no_better_than_the_global_one(seed):
    task = task_of(random_scene(np.random.default_rng(seed)), ELLIPSES_ALONE)
    pool = search(task, [GOAL])
    found = multi_start(task, GOAL, free=False, count=3, rng=np.random.default_rng(1))
    best = pool.objective(GOAL)[pool.best(GOAL)]
    for descent in (d for d in found if np.isfinite(d.objective)):
        exact = task.simulate(np.array([descent.n]), np.array([[descent.delta]]), np.array([[descent.change]]))
        assert exact.feasible(names.EQUAL)[0]
        assert descent.objective == pytest.approx(float(exact.objective(GOAL)[0]), rel=1e-12)
        assert descent.objective > best * (1 - 1e-3)
    assert min(d.objective for d in found) < best * 1.1


@pytest.mark.parametrize("seed", [5, 13, 15, 34])
def test_no_descent_beats_the_global_search_with_a_free_end_speed(seed):
    # Events whose best durations lie on a long, flat ridge: a search that stops early ends up to 0.8 % worse.
    task = task_of(random_scene(np.random.default_rng(seed)), ELLIPSES_ALONE)
    goals = [Goal(names.EQUAL, omega) for omega in (1.0, 0.5)]
    pool = search(task, goals, known=search(task, goals))
    for goal in goals:
        best = pool.objective(goal)[pool.best(goal)]
        found = multi_start(task, goal, free=True, count=3, rng=np.random.default_rng(1))
        assert min(d.objective for d in found) > best * (1 - 1e-3)
