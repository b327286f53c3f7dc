"""What really happens around an AV: leaders as recorded, followers by the world's model, up to the present."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.drive import drive_behind
from highd_lc.driving.knowledge import reached
from highd_lc.planning.later import Around, AvState, later_scene
from highd_lc.planning.planner import PlanningProblem
from highd_lc.planning.replay import AvMotion, Replay, clearances, follow, human_motion
from highd_lc.planning.scene import MOMENT, NOT_YET, PackedScene
from highd_lc.vocab.driver import TABLE3_MEANS

FloatArray = NDArray[np.float64]
Three = tuple[FloatArray, FloatArray, FloatArray]


@dataclass(frozen=True)
class Way:
    """What others see of the AV's way: the samples at which its manoeuvre begins, and at which it turns back.

    ``NOT_YET`` for what has not happened.
    """

    begins: int = NOT_YET
    turns_back: int = NOT_YET


NOWHERE: Final = Way()
"""The way of an AV that keeps its lane."""


def followers(scene: PackedScene, av: AvMotion, way: Way, *, k: int) -> Three:
    """The followers' x (box centre) [m], v [m/s] and commanded a [m/s^2] over 0 .. k, each of shape (p, k + 1).

    av: as driven up to k; what it does later changes nothing. The first follower goes back to the target leader
    when the AV turns back. The command at k is of speeds that are not yet known where the AV is still to act.
    """
    last = min(k, way.turns_back)
    joins = reached(av, scene, float(scene.reactions[0, MOMENT]), k=last, since=way.begins)
    before = _driven(scene, av, (0, last), joins)
    if last == k:
        return before
    x, v, a = before
    again = later_scene(scene, last, AvState(0.0, 0.0), Around(x[:, last], v[:, last], None))
    after = _driven(again, av, (last, k), NOT_YET)
    joined = (np.hstack([one[:, :last], other]) for one, other in zip((x, v, a), after, strict=True))
    x, v, a = joined
    return x, v, a


def _driven(scene: PackedScene, av: AvMotion, span: tuple[int, int], joins: int) -> Three:
    """x, v, a of the followers over the samples of a span. scene: with its first one as sample 0."""
    seen = slice(span[0], span[1] + 1)
    x, v, a = (np.empty((len(scene.follower_x), span[1] - span[0] + 1)) for _ in range(3))
    follow(av.x[seen] + scene.length / 2.0, av.vx[seen], joins, scene, x, v, a)
    return x, v, a


def origin_follower(scene: PackedScene, av: AvMotion, *, k: int) -> tuple[float, float] | None:
    """Box centre [m] and speed [m/s] of the origin follower at sample k, behind the AV; None without one."""
    if not len(scene.origin_follower):
        return None
    x, _, v, length = scene.origin_follower[:4]
    seen = slice(0, k + 1)
    ahead = av.x[seen] + scene.length / 2.0, av.vx[seen]
    driver = TABLE3_MEANS.as_array()
    front, speed = drive_behind(x + length / 2.0, v, *ahead, driver, scene.hardest, scene.dt)
    return float(front[-1] - length / 2.0), float(speed[-1])


def recorded_drive(problem: PlanningProblem) -> tuple[Replay, int]:
    """The human among the recorded followers, and the last sample at which all of them are in view.

    Clearances are those up to it.
    """
    scene, packed = problem.scene, problem.packed._replace(rear_to_centre=0.0)
    av = human_motion(scene.driver, packed)
    recorded = scene.followers.recorded
    last = min(av.recorded, *(motion.observed - 1 for motion in recorded))
    x, v, a = (np.stack([getattr(motion, name) for motion in recorded]) for name in ("x", "v", "a"))
    seen = slice(0, last + 1)
    n, crossing = min(av.n, last), min(av.crossing, last)
    to_T, after_T = clearances(
        av.x[seen], av.y[seen], av.vx[seen], av.vy[seen], n, crossing, packed, np.ascontiguousarray(x[:, seen])
    )
    return Replay(av, x, v, a, to_T, after_T), last
