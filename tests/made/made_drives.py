"""Drives in the closed loop on random scenes: the case, the tracker, the result."""

from dataclasses import replace

import numpy as np
from random_scenes import random_scene, reacting

from highd_lc.driving.loop import Case, ClosedLoop, drive_closed_loop
from highd_lc.driving.tracker import ExactTracker, MpcTracker, Tracker
from highd_lc.planning.crowd import drawn_crowd
from highd_lc.planning.planner import PlanningProblem, pose
from highd_lc.planning.scene import Motion, Scene
from highd_lc.tracking.closed_loop import controller
from highd_lc.vocab import names
from highd_lc.vocab.settings import ValidateSettings

SETTINGS = ValidateSettings()
MOMENTS = (None, 0.0, 0.5, 0.3)
OPEN = (0, 1, 2, 3, 4, 7, 9, 10)
"""Seeds of scenes in which a plan is permitted at t_start."""


def scene_of(seed: int) -> Scene:
    """A scene whose followers react."""
    rng = np.random.default_rng(seed)
    return reacting(random_scene(rng), rng, moment=MOMENTS[seed % 4])


def case_of(
    scene: Scene,
    policy: str = names.LOCAL_OPTIMUM_REPLANNED,
    settings: ValidateSettings = SETTINGS,
    *,
    world: PlanningProblem | None = None,
    **loop: object,
) -> Case:
    """The drive of a scene; exactly tracked, if not asked otherwise. world: None = as believed."""
    asked = settings.closed_loop.model_copy(update={"tracker": "none"} | loop)
    problem = pose(scene, settings)
    spread = 0.1 * np.abs(scene.followers.parameters)
    crowd = drawn_crowd(problem.packed, spread, 4, np.random.default_rng(1))
    return Case(problem, (world or problem).packed, policy, asked, crowd)


def tracker_of(case: Case) -> Tracker:
    """What the case's settings ask for."""
    scene, settings = case.problem.scene, case.problem.settings.tracking
    if case.settings.tracker == "none":
        return ExactTracker(scene.dt)
    shared = controller(settings, scene.dt)
    return MpcTracker(scene.wheelbase, scene.dt, settings.horizon, scene.samples, shared)


def drive(case: Case) -> ClosedLoop:
    """The case, driven."""
    return drive_closed_loop(case, tracker_of(case))


def changed(motion: Motion, since: int, acceleration: float) -> Motion:
    """The motion with another acceleration from a sample on, until it stands [m/s^2]."""
    dt, n = 0.1, len(motion.x) - since
    v = np.maximum(motion.v[since] + acceleration * dt * np.arange(n), 0.0)
    x = motion.x[since] + np.concatenate([[0.0], np.cumsum(v[1:])]) * dt
    joined = {"x": x, "v": v, "a": np.full(n, acceleration)}
    return replace(motion, **{k: np.concatenate([getattr(motion, k)[:since], new]) for k, new in joined.items()})
