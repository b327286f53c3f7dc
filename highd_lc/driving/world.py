"""What really happens around an AV: leaders as recorded, followers by the world's model, up to the present."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.drive import drive_behind
from highd_lc.driving.knowledge import in_the_way, reached
from highd_lc.planning.later import Around, AvState, later_scene, own_lane
from highd_lc.planning.replay import AvMotion, drive_on, follow
from highd_lc.planning.scene import MOMENT, NOT_YET, Motion, PackedScene, Scene
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


def keeping_lane(packed: PackedScene, leader: Motion | None) -> PackedScene:
    """The scene of an AV that keeps its lane, at a distance at which its safety profile lets it stand.

    leader: the origin leader, the first of the scene's leaders. Table 3's L says nothing of how long a leader is:
    behind a lorry an AV would drive into it.
    """
    lane = own_lane(packed, leader)
    if leader is None or not packed.safety.asked:
        return lane
    between = packed.a + float(packed.leader_a[0]) + packed.safety.clearance
    L = between + (leader.length - packed.length) / 2.0
    return lane._replace(av_parameters=np.append(packed.av_parameters[:-1], max(L, packed.av_parameters[-1])))


def coming_over(scene: Scene, world: PackedScene, av: AvMotion, end: int) -> NDArray[np.bool_]:
    """At which samples the origin leader leads an AV that has ended its lane change at sample ``end``.

    It does from the moment at which it stands in the AV's way, ahead of it and nearer than the lane's leader.
    """
    over = scene.origin_leader
    if over is None:
        return np.zeros(len(av.x), np.bool_)
    rear, target = over.x - over.length / 2.0, world.target_front - world.target_length
    leads = in_the_way(scene, over, over.y, world.safety.clearance) & (rear < target)
    comes = np.flatnonzero(leads & (rear > av.x + world.length / 2.0) & (np.arange(len(rear)) >= end))
    leads[: comes[0] if len(comes) else len(leads)] = False
    return leads


def led_by(world: PackedScene, leader: Motion | None, leads: NDArray[np.bool_]) -> PackedScene:
    """The scene in which that vehicle leads the target lane at some of the samples."""
    if leader is None or not leads.any():
        return world
    front = leader.x - leader.length / 2.0 + world.target_length
    return world._replace(
        target_front=np.where(leads, front, world.target_front), target_v=np.where(leads, leader.v, world.target_v)
    )


def drive_after(scene: Scene, world: PackedScene, av: AvMotion, end: int) -> None:
    """Fill the AV's motion after a lane change that ends at sample ``end``: behind who leads its lane then."""
    columns, before = (av.x, av.y, av.vx, av.ax, av.jerk), av.ax[end]
    drive_on(*columns, end, world)
    leads = coming_over(scene, world, av, end)
    if leads.any():
        av.ax[end] = before
        drive_on(*columns, end, led_by(world, scene.origin_leader, leads))
