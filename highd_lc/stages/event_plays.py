"""What the policies did in an event, replayed from the tabulated plans for drawing."""

from collections.abc import Iterable, Iterator
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.algorithms import planner
from highd_lc.algorithms.planner import PlanningProblem
from highd_lc.algorithms.replay import AvMotion, Replay, human_motion, plan_motion, replay
from highd_lc.core.quintic import Quintic
from highd_lc.reporting.event import Path, Play, Row
from highd_lc.vocab import names
from highd_lc.vocab.scene import Motion, Scene

FloatArray = NDArray[np.float64]
_LEADERS: Final = (names.ORIGIN_LEADER, names.TARGET_LEADER, names.ORIGIN_FOLLOWER)


def policy_plays(problem: PlanningProblem, plans: Iterable[Row]) -> Iterator[Play]:
    """The motions behind an event's rows of ``plans``; rows with the same plan share one."""
    groups: dict[tuple[Any, ...], list[str]] = {}
    for row in plans:
        if row["status"] in (names.SOLVED, names.REFERENCE):
            key = (row["policy"], row["T"], row["x_final"], row["v_end"])
            groups.setdefault(key, []).append(row["accounting"])
    for (policy, *shape), accountings in groups.items():
        played = _replayed(problem, policy, *shape)
        yield _play(problem, policy, tuple(accountings), played)


def _replayed(problem: PlanningProblem, policy: str, T: float, x_final: float, v_end: float) -> Replay:
    if policy == names.NO_LANE_CHANGE:
        return planner.stay(problem)
    if policy == names.HUMAN:
        return replay(human_motion(problem.scene.human, problem.packed), problem.packed)
    quintic = Quintic(v0=problem.scene.v0, D=problem.scene.lateral_shift, T=T, x_final=x_final, v_end=v_end)
    return replay(plan_motion(quintic, problem.packed), problem.packed)


def _play(problem: PlanningProblem, policy: str, accountings: tuple[str, ...], played: Replay) -> Play:
    scene = problem.scene
    stays = policy == names.NO_LANE_CHANGE
    levels = (np.full(played.x.shape[1], y) for y in scene.followers.y)
    return Play(
        policy=policy,
        accountings=accountings,
        T=float("nan") if stays else played.av.n * scene.dt,
        ego=_ego(played.av, scene, at_rear_axle=policy not in (names.HUMAN, names.NO_LANE_CHANGE)),
        jerk=played.av.jerk,
        followers=tuple(Path(*each) for each in zip(played.x, levels, played.v, played.a, strict=True)),
        measured=policy == names.HUMAN,
    )


def _ego(av: AvMotion, scene: Scene, *, at_rear_axle: bool) -> Path:
    """The box centre's motion; a planned point is the rear axle, r = wheelbase / 2 behind (SPEC section 2)."""
    speed = np.hypot(av.vx, av.vy)
    x, y = av.x, av.y
    if at_rear_axle:
        heading = np.arctan2(av.vy, av.vx)
        r = scene.wheelbase / 2.0
        x, y = x + r * (np.cos(heading) - 1.0), y + r * np.sin(heading)
    return Path(x, y, speed, av.ax)


def surrounding(scene: Scene) -> dict[str, Motion]:
    """The vehicles that no policy moves, by role."""
    return {role: motion for role in _LEADERS if (motion := getattr(scene, role)) is not None}
