"""What was recorded, judged as the closed loop's drives are: the human among the recorded followers."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from highd_lc.planning.planner import PlanningProblem
from highd_lc.planning.replay import Replay, clearances, human_motion
from highd_lc.planning.scene import Motion, PackedScene, leaders_of, obstacle_roles
from highd_lc.vocab import names

FloatArray = NDArray[np.float64]

_FAR = 1e6
"""Where who is out of view is put [m]."""


class _Box(NamedTuple):
    """A vehicle's box centre over the samples [m], its length and width [m]."""

    role: str
    x: FloatArray
    y: FloatArray
    length: float
    width: float


def recorded_drive(problem: PlanningProblem) -> tuple[Replay, int]:
    """The human among the recorded others, and the last sample at which all followers are in view.

    Clearances are those up to it, to everybody as he was recorded, while he is in view.
    """
    scene, packed = problem.scene, problem.packed._replace(rear_to_centre=0.0)
    recorded = scene.followers.recorded
    av = human_motion(scene.driver, packed)
    last = min(av.recorded, *(motion.observed - 1 for motion in recorded))
    seen, n, crossing = slice(0, last + 1), min(av.n, last), min(av.crossing, last)
    to_T, after_T = clearances(
        av.x[seen],
        av.y[seen],
        av.vx[seen],
        av.vy[seen],
        n,
        crossing,
        _as_recorded(problem),
        np.empty((0, last + 1)),
    )
    x, v, a = (np.stack([getattr(motion, name) for motion in recorded]) for name in ("x", "v", "a"))
    return Replay(av, x, v, a, to_T, after_T), last


def _as_recorded(problem: PlanningProblem) -> PackedScene:
    """The scene with everybody a leader, whom nobody moves, in the order of the roles."""
    scene, packed = problem.scene, problem.packed
    behind = scene.origin_follower
    motions = [*leaders_of(scene).values(), *scene.followers.recorded, *([behind] if behind is not None else [])]
    axes = [packed.leader_a, packed.follower_a, packed.origin_follower[4:5]]
    across = [packed.leader_b, packed.follower_b, packed.origin_follower[5:6]]
    return packed._replace(
        rear_to_centre=0.0,
        leader_x=np.array([np.where(_in_view(motion), motion.x, _FAR) for motion in motions]),
        leader_y=np.array([motion.y for motion in motions]),
        leader_a=np.concatenate(axes),
        leader_b=np.concatenate(across),
        follower_x=np.empty(0),
        origin_follower=np.empty(0),
    )


def _in_view(motion: Motion) -> NDArray[np.bool_]:
    return np.arange(len(motion.x)) < motion.observed


def recorded_contacts(problem: PlanningProblem, replay: Replay, last: int) -> tuple[str, ...]:
    """Who touched whom up to sample ``last``: boxes that overlap, then ellipses (see ``loop.contacts_of``).

    Where everybody was across is known: who passes on another lane drives through nobody.
    """
    lane = [_box(names.target_follower(i + 1), m) for i, m in enumerate(problem.scene.followers.recorded)]
    if problem.scene.target_leader is not None:
        lane.insert(0, _box(names.TARGET_LEADER, problem.scene.target_leader))
    scene, av = problem.scene, replay.av
    ego = _Box(names.EGO, av.x, av.y, scene.length, scene.width)
    pairs = [(behind, ahead) for ahead, behind in pairwise(lane)]
    pairs += [(ego, box) if box.role == names.TARGET_LEADER else (box, ego) for box in lane]
    through = [names.through(one.role, other.role) for one, other in pairs if _overlap(one, other, last)]
    nearest = np.minimum(replay.clearance_to_T, replay.clearance_after_T)
    roles = zip(obstacle_roles(scene), nearest, strict=True)
    return (*through, *(f"clearance_{role}" for role, clearance in roles if clearance < 0.0))


def _box(role: str, motion: Motion) -> _Box:
    return _Box(role, np.where(_in_view(motion), motion.x, np.nan), motion.y, motion.length, motion.width)


def _overlap(one: _Box, other: _Box, last: int) -> bool:
    seen = slice(0, last + 1)
    along = np.abs(one.x[seen] - other.x[seen]) < (one.length + other.length) / 2.0
    across = np.abs(one.y[seen] - other.y[seen]) < (one.width + other.width) / 2.0
    return bool((along & across).any())
