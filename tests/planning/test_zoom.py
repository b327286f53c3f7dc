"""The compiled zoom against a plain numpy twin, start by start and level by level."""

from dataclasses import replace

import numpy as np
import pytest
from random_scenes import GOALS, random_scene, task_of

from highd_lc.planning import zoom
from highd_lc.planning.contacts import WIDTH
from highd_lc.planning.limits import forward_interval
from highd_lc.planning.pool import OVERTAKES, Before, Task
from highd_lc.planning.search import search
from highd_lc.planning.zoom import Starts, follow_valleys


def twin(
    task: Task, starts: Starts, levels: int, free: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """delta, change and objective of shape (levels, S, WIDTH) and the best objective of each start."""
    found = [_one(task, starts, s, levels, free) for s in range(len(starts.n))]
    delta, change, objective = (np.stack([one[k] for one in found], axis=1) for k in range(3))
    return delta, change, objective, objective.min(axis=(0, 2))


def _one(task: Task, starts: Starts, s: int, levels: int, free: bool) -> list[np.ndarray]:
    n, goal, half_T = starts.n[s : s + 1], GOALS[starts.goal[s]], task.seconds(starts.n)[s] / 2.0
    cloud = zoom._SUNFLOWER if free else zoom._LINE
    centre, frame, least, rows = starts.centre[s], starts.frame[s], np.inf, []
    for _ in range(levels):
        moved = centre + cloud @ frame.T
        change = np.clip(moved[:, 1], task.limit.v_min - task.scene.v0, task.limit.v_max - task.scene.v0)
        low, high = forward_interval(np.array(2.0 * half_T), change, task.scene.v0, task.limit)
        delta = np.clip(moved[:, 0] + change * half_T, low, np.maximum(high, low))
        value = task.simulate(n, delta[None], change[None]).objective(goal)
        rows.append((delta, change, value))
        best, origin = int(np.argmin(value)), np.zeros(2)
        if value[best] < least:
            least, origin = value[best], cloud[best]
            centre = np.array([delta[best] - change[best] * half_T, change[best]])
        frame = frame @ _narrowed(value, origin) if free else frame * zoom._LINE_SHRINK
    return [np.array([row[k] for row in rows]) for k in range(3)]


def _narrowed(value: np.ndarray, origin: np.ndarray) -> np.ndarray:
    elite = np.argsort(value, kind="stable")[: zoom._ELITE]
    elite = elite[np.isfinite(value[elite])]
    away = zoom._SUNFLOWER[elite] - origin
    squares, axes = np.linalg.eigh(away.T @ away)
    # Eigenvectors have no sign of their own: along the valley points forward, across it to the left of that.
    # Where nothing is feasible there is no valley: forward.
    along = axes[:, 1] * (np.sign(axes[0, 1]) or 1.0) if len(elite) else np.array([1.0, 0.0])
    axes = np.stack([[-along[1], along[0]], along], axis=1)
    width = zoom._SPREAD * np.sqrt(np.maximum(squares, 0.0) / max(len(elite), 1))
    return axes * np.clip(width, zoom._NARROWEST, zoom._WIDEST)


def starts_of(task: Task, rng: np.random.Generator, free: bool) -> Starts:
    """A start for every goal at the best candidate of a search, moved off it a little."""
    pool = search(task, GOALS)
    best = np.array([pool.best(goal) or 0 for goal in GOALS])
    change = rng.normal(0.0, 1.0, len(GOALS)) if free else np.zeros(len(GOALS))
    centre = np.stack([pool.delta[best] + rng.normal(0.0, 1.0, len(GOALS)), change], axis=1)
    frame = np.zeros((len(GOALS), 2, 2))
    frame[:, 0, 0], frame[:, 1, 1] = 2.0, 1.0 if free else 0.0
    return Starts(pool.n[best], np.arange(len(GOALS)), centre, frame)


@pytest.mark.parametrize("later", [False, True], ids=["at once", "later"])
@pytest.mark.parametrize("free", [False, True], ids=["fixed", "free"])
@pytest.mark.parametrize("seed", range(6))
def test_kernel_and_twin_see_the_same(seed, free, later):
    rng = np.random.default_rng(seed)
    task = task_of(random_scene(rng, crowding=1.5))
    starts = starts_of(task, rng, free)
    if later:
        passed = np.cumsum(rng.uniform(0.0, 0.01, len(task.scene.target_v)))
        task = replace(task, before=Before(0.3, 0.2, passed, 100))
    levels = 4
    clouds, best = follow_valleys(task, GOALS, starts, levels=levels, free=free)
    delta, change, objective, least = twin(task, starts, levels, free)
    assert clouds.delta == pytest.approx(delta, rel=1e-9, abs=1e-9)
    assert clouds.change == pytest.approx(change, rel=1e-9, abs=1e-9)
    for s, goal in enumerate(GOALS):
        pool, found = zoom.zoom(task, search(task, GOALS), GOALS, starts, levels=levels, free=free)
        assert pool.objective(goal)[-objective.size :].reshape(objective.shape)[:, s] == pytest.approx(
            objective[:, s], rel=1e-9
        )
        reached = pool.objective(goal)[found[s]] if found[s] >= 0 else np.inf
        assert reached == pytest.approx(least[s], rel=1e-9)
        assert (best[s] >= 0) == np.isfinite(least[s])


def test_a_later_start_may_not_end_ahead_of_its_leader():
    rng = np.random.default_rng(1)
    task = task_of(random_scene(rng))
    starts = starts_of(task, rng, True)
    scene = task.scene._replace(target_front=np.full_like(task.scene.target_front, 1.0))
    later = replace(task, scene=scene, before=Before(0.0, 0.0, np.zeros(len(scene.target_v)), 100))
    clouds, best = follow_valleys(later, GOALS, starts, levels=2, free=True)
    assert (clouds.codes > 0).all()
    assert (clouds.codes == OVERTAKES).any()
    assert (best == -1).all()
    assert clouds.delta.shape == (2, len(GOALS), WIDTH)
