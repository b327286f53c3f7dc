"""Candidates of a manoeuvre under way: against the numpy twin, and as what is left of a plan from t_start."""

from dataclasses import replace

import numpy as np
import planner_twin
import pytest
from random_scenes import random_scene, reacting, task_of
from test_candidates import check

from highd_lc.core.drive import jump
from highd_lc.core.quintic import Quintic, StartState, sample
from highd_lc.planning.candidates import evaluate
from highd_lc.planning.later import Around, AvState, later_scene
from highd_lc.planning.limits import CONSTRAINTS, Limits, margins, started_violation
from highd_lc.planning.replay import plan_motion, replay
from highd_lc.planning.scene import MOMENT, NOT_JOINED, Joined

UNDER_WAY = StartState(0.7, 0.9, 0.6, -0.2)


def made(seed, moment=0.5):
    rng = np.random.default_rng(seed)
    return task_of(reacting(random_scene(rng, 1 + seed % 3, crowding=1.0 + seed % 2), rng, moment=moment))


def later(task, start, joined, k=7):
    """The scene k samples on, with an AV in that state on either side, and the others where they were."""
    scene = task.scene
    side = np.sign(scene.D)
    turned = StartState(start.ax, side * start.y, side * start.vy, side * start.ay)
    origin = (
        (float(scene.origin_follower[0]), float(scene.origin_follower[2])) if len(scene.origin_follower) else None
    )
    around = Around(scene.follower_x + 3.0, scene.follower_v - 0.5, origin, joined)
    return later_scene(scene, k, AvState(2.0, scene.v0 + 0.4, turned), around)


@pytest.mark.parametrize("joined", [NOT_JOINED, Joined(0, 0.0, 0.0), Joined(-9, 6.0, 1.5)])
@pytest.mark.parametrize("start", [UNDER_WAY, StartState(-1.0, 2.9, 0.4, 0.1), StartState(1.2, 0.0, 0.0, 0.0)])
@pytest.mark.parametrize("seed", range(4))
def test_candidates_under_way_are_those_of_the_twin(seed, start, joined):
    task = made(seed, moment=(0.0, 0.3, 0.5, 0.9)[seed])
    scene = later(task, start, joined)
    rng, n = np.random.default_rng(seed), np.array([12, 25, 44, 71])
    T = n[:, None] * 0.1
    change = rng.uniform(-2, 2, (len(n), 20))
    delta = change * T / 2 + rng.uniform(-0.2, 0.2, change.shape) * T**2
    arguments = (n, delta, change, scene, task.terms)
    check(evaluate(*arguments), planner_twin.evaluate(*arguments))


def moment_of(plan, k, dt):
    now = sample(plan, np.array([k * dt]))
    start = StartState(*(float(getattr(now, name)[0]) for name in ("ax", "y", "vy", "ay")))
    return AvState(float(now.x[0]), float(now.vx[0]), start)


@pytest.mark.parametrize("moment", [0.0, 0.3, 0.5])
@pytest.mark.parametrize("n", [44, 57])
@pytest.mark.parametrize("k", [5, 20, 35])
def test_what_is_left_costs_what_is_left(k, n, moment):
    """Losses from a moment on are those of the whole plan less what was charged before it."""
    task = made(6, moment)
    # Who credits nothing of a jump follows alike whether he is asked before or after it.
    task = replace(task, scene=task.scene._replace(reactions=without_relaxation(task.scene)))
    scene, dt = task.scene, task.scene.dt
    T = n * dt
    plan = Quintic(scene.v0, scene.D, T, scene.v0 * T + 4.0, scene.v0 + 1.0)
    played = replay(plan_motion(plan, scene), scene)
    state = moment_of(plan, k, dt)
    joins = 0 if moment == 0.0 else next(j for j in range(n) if made_share(plan, j, moment, dt))
    joined = Joined(joins - k, 0.0, 0.0) if joins <= k else NOT_JOINED
    now = later_scene(scene, k, state, Around(played.x[:, k], played.v[:, k], None, joined))
    left = np.array([[plan.x_final - state.x - state.v * (n - k) * dt]]), np.array([[plan.v_end - state.v]])
    tail = evaluate(np.array([n - k]), *left, now, task.terms)
    av, hv = charged_before(played, task, k)
    whole = evaluate(np.array([n]), np.array([[4.0]]), np.array([[1.0]]), scene, task.terms)
    assert tail.av_H[0, 0] == pytest.approx(whole.av_H[0, 0] - av, rel=1e-9)
    # The step of the command at the first sample is of no plan's making, and is not counted.
    assert tail.hv_H[0, 0] == pytest.approx(whole.hv_H[0, 0] - hv, rel=1e-9)


def made_share(plan, j, share, dt):
    half = 0.5 if share == 0.5 else 0.0
    return sample(plan, np.array([(j + half) * dt])).y[0] / plan.D >= share - 1e-9


def without_relaxation(scene):
    reactions = scene.reactions.copy()
    reactions[:, 2] = 0.0
    return reactions


def charged_before(played, task, k):
    """What AV and followers were charged before sample k, the followers' step at k included."""
    terms, dt = task.terms, task.scene.dt
    av = terms.comfort * played.av.jerk + terms.efficiency * np.abs(
        np.hypot(played.av.vx, played.av.vy) - terms.av_ref
    )
    steps = np.abs(np.diff(played.a, axis=1, prepend=played.a[:, :1])) / dt
    hv = terms.efficiency * np.abs(played.v - terms.hv_ref[:, None])
    weighted = terms.weights @ (hv[:, :k].sum(axis=1) + terms.comfort * steps[:, : k + 1].sum(axis=1))
    return av[:k].sum(), weighted


def test_a_credited_jump_goes_on_fading():
    """HV_1 seen from later credits what it credited at the change of leader."""
    task = made(1, moment=0.0)
    scene, dt, n, k = task.scene, task.scene.dt, 50, 12
    plan = Quintic(scene.v0, scene.D, n * dt, scene.v0 * n * dt, scene.v0)
    played = replay(plan_motion(plan, scene), scene)
    state = moment_of(plan, k, dt)
    half = scene.follower_length[0] / 2.0
    own = played.x[0, 0] + half
    _, _, b, B, tau, L = scene.parameters[0]
    before = float(scene.target_front[0] - own), float(scene.target_v[0])
    credit = jump(1, played.v[0, 0], scene.length / 2.0 - own, scene.v0, *before, b, B, tau, L)
    around = Around(played.x[:, k], played.v[:, k], None, Joined(-k, *credit))
    now = later_scene(scene, k, state, around)
    tail = Quintic(state.v, scene.D, (n - k) * dt, plan.x_final - state.x, plan.v_end, state.start)
    again = replay(plan_motion(tail, now), now)
    assert credit[0] > 0.0
    np.testing.assert_allclose(again.x + state.x, played.x[:, k:], atol=1e-8)


def test_limits_under_way_are_those_of_dense_samples():
    rng, seen = np.random.default_rng(5), set()
    for k in range(400):
        limit = Limits(5.0, 40.0, 4.0, 6.0 if k % 2 else 25.0, curvature=0.05, yaw_rate=0.3)
        start = StartState(*(rng.normal(size=4) * (1.5, 1.5, 0.6, 0.8)))
        T, v0 = rng.uniform(1.0, 8.0), rng.uniform(6.0, 38.0)
        plan = Quintic(v0, 3.5, T, v0 * T + rng.normal() * T, v0 + rng.normal() * 2.0, start)
        code = started_violation(T, plan.x_final - v0 * T, plan.v_end - v0, v0, plan.D, start, limit)
        broken = {name for name, margin in sampled_margins(plan, limit).items() if margin < -1e-6}
        assert (code == 0) == (not broken) or min(abs(m) for m in sampled_margins(plan, limit).values()) < 1e-3
        if code:
            seen.add(CONSTRAINTS[code - 1])
            assert CONSTRAINTS[code - 1] in broken
        found = margins(plan, limit)
        for name, margin in sampled_margins(plan, limit).items():
            assert found[name] == pytest.approx(margin, rel=2e-3, abs=2e-3)
    assert seen >= {"jerk_y", "acceleration_y", "speed", "acceleration_x", "jerk_x"}


def sampled_margins(plan, limit):
    s = sample(plan, np.linspace(0.0, plan.T, 4097))
    speed = np.hypot(s.vx, s.vy)
    turned = np.abs(s.vx * s.ay - s.vy * s.ax)
    return {
        "speed": min(speed.min() - limit.v_min, limit.v_max - speed.max()),
        "acceleration_x": limit.acceleration - np.abs(s.ax).max(),
        "acceleration_y": limit.acceleration - np.abs(s.ay).max(),
        "jerk_x": limit.jerk - np.abs(s.jx).max(),
        "jerk_y": limit.jerk - np.abs(s.jy).max(),
        "curvature": limit.curvature - (turned / speed**3)[::64].max(),
        "yaw_rate": limit.yaw_rate - (turned / speed**2)[::64].max(),
    }


def test_the_moment_of_the_scene_stays_its_own():
    task = made(0, moment=0.3)
    scene = later(task, UNDER_WAY, NOT_JOINED)
    assert scene.reactions[0, MOMENT] == 0.3
    assert scene.clock == pytest.approx(0.7)
