"""The global search against a very fine grid, in easy and in tight traffic."""

from dataclasses import replace

import numpy as np
import pytest
from fine_grid import fine_grid
from random_scenes import GOALS, mirrored, random_scene, reacting, task_of

from highd_lc.planning.limits import CONSTRAINTS, violations
from highd_lc.planning.pool import OVERTAKES, Goal, Pool, Task
from highd_lc.planning.search import nominal_rejections, search
from highd_lc.vocab import names
from highd_lc.vocab.safety import PAPER, PRACTICE, SafetySettings
from highd_lc.vocab.settings import ValidateSettings

WORSE = 1e-3


def lowest(pool: Pool, goals=GOALS) -> np.ndarray:
    return np.array([pool.objective(goal).min(initial=np.inf) for goal in goals])


def assert_not_worse(found: np.ndarray, fine: list[float]) -> None:
    """No goal more than 0.1 % above the fine grid, and feasible where that is."""
    assert (found <= np.array(fine) * (1 + WORSE)).all(), np.array(fine) / found - 1


@pytest.mark.parametrize("crowding", [1.0, 2.5], ids=["easy", "tight"])
@pytest.mark.parametrize("seed", range(10))
def test_no_fixed_plan_is_better_on_a_very_fine_grid(seed, crowding):
    task = task_of(random_scene(np.random.default_rng(seed), crowding=crowding))
    assert_not_worse(lowest(search(task, GOALS)), fine_grid(task, GOALS, nodes=801))


@pytest.mark.parametrize("seed", range(6))
def test_no_fixed_plan_among_followers_that_react_is_better_on_a_very_fine_grid(seed):
    rng = np.random.default_rng(seed)
    task = task_of(reacting(random_scene(rng), rng, moment=0.5))
    assert_not_worse(lowest(search(task, GOALS)), fine_grid(task, GOALS, nodes=801))


@pytest.mark.parametrize(("seed", "crowding"), [(14, 1.0), (44, 2.5), (59, 2.5)])
def test_no_free_plan_is_better_on_a_very_fine_grid(seed, crowding):
    task = task_of(random_scene(np.random.default_rng(seed), crowding=crowding))
    found = search(task, GOALS, known=search(task, GOALS))
    assert_not_worse(lowest(found), fine_grid(task, GOALS, nodes=121, changes=41))


# Under practice seed 7 is the one of 25 feasible scenes that is worse, by 0.5 % (docs/planner.md).
@pytest.mark.parametrize(("seed", "profile"), [(0, PRACTICE), (3, PRACTICE), (0, PAPER), (3, PAPER), (7, PAPER)])
def test_slow_traffic_is_searched_as_well(seed, profile):
    rng = np.random.default_rng(seed)
    settings = ValidateSettings(safety=SafetySettings(profile=profile))
    task = task_of(random_scene(rng, v0=rng.uniform(2, 8), crowding=1.5), settings)
    assert_not_worse(lowest(search(task, GOALS)), fine_grid(task, GOALS, nodes=801))


def test_a_slot_of_centimetres_is_found():
    # Contacts leave 2 cm of x_final at T = 7.5 s; the grid's nodes lie metres apart.
    task = task_of(random_scene(np.random.default_rng(480)))
    fine = fine_grid(task, GOALS[:1], nodes=4001)
    assert_not_worse(lowest(search(task, GOALS[:1]), GOALS[:1]), fine)


@pytest.mark.parametrize("seed", range(8))
def test_a_free_end_speed_is_never_worse(seed):
    task = task_of(random_scene(np.random.default_rng(seed), crowding=2.0))
    fixed = search(task, GOALS)
    assert (lowest(search(task, GOALS, known=fixed)) <= lowest(fixed)).all()


@pytest.mark.parametrize("free", [False, True], ids=["fixed", "free"])
@pytest.mark.parametrize("seed", range(2))
def test_the_av_pays_less_and_the_followers_more_the_more_the_av_counts(seed, free):
    goals = [Goal(accounting, omega) for accounting in names.ACCOUNTINGS for omega in np.linspace(0.05, 1.0, 9)]
    task = task_of(random_scene(np.random.default_rng(seed)))
    pool = search(task, goals)
    pool = search(task, goals, known=pool) if free else pool
    for accounting in names.ACCOUNTINGS:
        best = [pool.best(goal) for goal in goals if goal.accounting == accounting]
        av, hv = (side[best] for side in pool.losses(accounting))
        # All weights choose from one pool, so this holds exactly; at omega = 1 ties leave HV open.
        assert (np.diff(av) <= 1e-9).all()
        assert (np.diff(hv[:-1]) >= -1e-9).all()


def test_the_same_scene_twice_gives_the_same_pool():
    task = task_of(random_scene(np.random.default_rng(2)))
    one, two = search(task, GOALS), search(task, GOALS)
    np.testing.assert_array_equal(one.delta, two.delta)
    np.testing.assert_array_equal(one.av_H, two.av_H)


@pytest.mark.parametrize("seed", range(6))
def test_a_mirrored_scene_has_the_mirrored_plans(seed):
    scene = random_scene(np.random.default_rng(seed), crowding=2.0)
    for one, other in zip(*(best_plans(task_of(s)) for s in (scene, mirrored(scene))), strict=True):
        assert one == other


def best_plans(task: Task) -> list[tuple]:
    pool = search(task, GOALS)
    pool = search(task, GOALS, known=pool)
    best = [pool.best(goal) for goal in GOALS]
    return [(pool.n[i], pool.delta[i], pool.change[i], pool.av_H[i], pool.hv_H[i]) for i in best if i is not None]


def test_a_lane_too_far_away_leaves_no_candidate():
    task = task_of(replace(random_scene(np.random.default_rng(1)), lateral_shift=200.0))
    pool = search(task, GOALS)
    assert len(pool) == len(search(task, GOALS, known=pool)) == 0
    assert all(pool.best(goal) is None for goal in GOALS)


def test_a_horizon_shorter_than_the_longest_plan_bounds_it():
    settings = ValidateSettings.model_validate({"loss": {"horizon_s": 5.0}})
    task = task_of(random_scene(np.random.default_rng(1), horizon=5.0), settings)
    pool = search(task, GOALS)
    assert pool.n.max() == 50
    assert all(pool.best(goal) is not None for goal in GOALS)


def test_nominal_rejections_count_by_constraint():
    task = task_of(random_scene(np.random.default_rng(1)))
    for free in (False, True):
        counts = nominal_rejections(task, free=free)
        assert list(counts) == list(CONSTRAINTS)
        assert 0 < sum(counts.values()) < len(task.durations) * 33 * (11 if free else 1)
    # The lateral jerk depends on T alone: 33 speeds at each duration that is too short.
    too_short = (60 * abs(task.scene.D) / task.seconds(task.durations) ** 3 > task.limit.jerk).sum()
    assert nominal_rejections(task, free=False)["jerk_y"] == 33 * too_short


def test_every_candidate_is_checked():
    task = task_of(random_scene(np.random.default_rng(1)))
    pool = search(task, GOALS)
    one_by_one = [
        violations(np.array([n * 0.1]), np.array([[d]]), np.array([[c]]), task.scene.v0, task.scene.D, task.limit)[
            0, 0
        ]
        for n, d, c in list(zip(pool.n, pool.delta, pool.change, strict=True))[::37]
    ]
    # What the safety profile forbids is asked of the simulated motion, of those alone that break nothing before.
    dynamic = np.where(pool.violation > OVERTAKES, 0, pool.violation)
    np.testing.assert_array_equal(dynamic[::37], one_by_one)
