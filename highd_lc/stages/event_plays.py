"""What the policies did in an event, replayed from the tabulated plans for drawing."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from highd_lc.algorithms import planner
from highd_lc.algorithms.packing import PackedScene, leaders_of
from highd_lc.algorithms.planner import PlanningProblem
from highd_lc.algorithms.replay import AvMotion, drive_on, follow, human_motion, plan_motion
from highd_lc.algorithms.start_planner import FORM_OF_START, key_of, replay_start
from highd_lc.algorithms.starts import Key, StartProblem, pose_starts
from highd_lc.core.quintic import Quintic
from highd_lc.reporting.event import Path, Play, Row
from highd_lc.vocab import names
from highd_lc.vocab.scene import Motion, Scene

FloatArray = NDArray[np.float64]
Three = tuple[FloatArray, FloatArray, FloatArray]
Driven = tuple[AvMotion, Three]
"""The AV's motion, and the followers' x [m], v [m/s], a [m/s^2], each of shape (p, N + 1)."""


def policy_plays(problem: PlanningProblem, plans: Iterable[Row]) -> Iterator[Play]:
    """The motions behind an event's rows of ``plans``; rows with the same plan share one."""
    groups = _accountings_of(plans)
    posed = pose_starts(problem) if any(key[0] in FORM_OF_START for key in groups) else None
    # Policies often find the same plan: it is driven once. Human and "no lane change" drive something else.
    driven: dict[tuple[Any, ...], Play] = {}
    for (policy, *shape, delay_s, v_start, gap), accountings in groups.items():
        of = policy if policy in (names.HUMAN, names.NO_LANE_CHANGE) else ""
        motion = (of, *shape, delay_s, v_start, gap)
        if motion not in driven:
            if policy in FORM_OF_START and posed is not None:
                run = _delayed(posed, key_of(posed, gap, delay_s), v_start, *shape)
            else:
                run = _replayed(problem, policy, *shape)
            driven[motion] = _play(problem, policy, *run, delay_s=delay_s)
        yield replace(driven[motion], policy=policy, accountings=tuple(accountings))


def _accountings_of(plans: Iterable[Row]) -> dict[tuple[Any, ...], list[str]]:
    """The accountings that led to each policy and plan (T, x_final, v_end, delay_s, v_start, gap)."""
    groups: dict[tuple[Any, ...], list[str]] = {}
    for row in plans:
        # A start without delay into the recorded gap is the play of the policy that it contains: pages stay small.
        starts_at_once = row["delay_s"] == 0.0 and row["gap"] == names.RECORDED_GAP
        if row["policy"] in FORM_OF_START and starts_at_once:
            continue
        if row["status"] in (names.SOLVED, names.REFERENCE, names.CONTACT):
            key = tuple(row[name] for name in ("policy", "T", "x_final", "v_end", "delay_s", "v_start", "gap"))
            groups.setdefault(key, []).append(row["accounting"])
    return groups


def _delayed(posed: StartProblem, key: Key, v_start: float, T: float, x_final: float, v_end: float) -> Driven:
    D = posed.problem.scene.lateral_shift
    played = replay_start(posed, key, Quintic(v0=v_start, D=D, T=T, x_final=x_final, v_end=v_end))
    return played.av, (played.x, played.v, played.a)


def _replayed(problem: PlanningProblem, policy: str, T: float, x_final: float, v_end: float) -> Driven:
    if policy == names.NO_LANE_CHANGE:
        av, *followers = planner.unchanged_motion(problem)
        return av, (followers[0], followers[1], followers[2])
    if policy == names.HUMAN:
        return _driven(human_motion(problem.scene.human, problem.packed), problem.packed)
    quintic = Quintic(v0=problem.scene.v0, D=problem.scene.lateral_shift, T=T, x_final=x_final, v_end=v_end)
    return _driven(plan_motion(quintic, problem.packed), problem.packed)


def _driven(av: AvMotion, scene: PackedScene) -> Driven:
    # As ``replay`` does, but without the clearances, which stand in the tables and take most of its time.
    drive_on(av.x, av.y, av.vx, av.ax, av.jerk, av.free_from, scene)
    x, v, a = (np.empty((len(scene.follower_x), len(av.x))) for _ in range(3))
    follow(av.x + scene.length / 2.0, av.vx, av.crossing if scene.from_crossing else 0, scene, x, v, a)
    return av, (x, v, a)


def _play(problem: PlanningProblem, policy: str, av: AvMotion, followers: Three, *, delay_s: float) -> Play:
    scene = problem.scene
    stays = policy == names.NO_LANE_CHANGE
    levels = (np.full(len(av.x), y) for y in scene.followers.y)
    return Play(
        policy=policy,
        accountings=(),
        T=float("nan") if stays else av.n * scene.dt,
        ego=_ego(av, scene, at_rear_axle=policy not in (names.HUMAN, names.NO_LANE_CHANGE)),
        jerk=av.jerk,
        followers=tuple(Path(x, y, v, a) for x, y, v, a in zip(followers[0], levels, *followers[1:], strict=True)),
        measured=policy == names.HUMAN,
        delay_s=delay_s,
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
    behind = {} if scene.origin_follower is None else {names.ORIGIN_FOLLOWER: scene.origin_follower}
    return leaders_of(scene) | behind


def leads(scene: Scene) -> tuple[tuple[int, str], ...]:
    """From which sample on which role leads the target lane; empty = nobody."""
    if scene.target_leader is None:
        return ()
    later = enumerate(scene.next_leaders, start=2)
    found = [(one.since, "" if one.motion is None else names.target_leader(rank)) for rank, one in later]
    return ((0, names.TARGET_LEADER), *found)
