"""What an AV could know at a moment: where everybody is and how fast, not what they will do (equations.md 7.5)."""

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.drive import drive_behind, jump
from highd_lc.core.quintic import SHARE_TOLERANCE
from highd_lc.planning.replay import AvMotion
from highd_lc.planning.scene import (
    FAMILY,
    MOMENT,
    NOT_JOINED,
    NOT_YET,
    Joined,
    Motion,
    PackedScene,
    Scene,
    leaders_of,
)
from highd_lc.vocab.driver import TABLE3_MEANS
from highd_lc.vocab.sections import CONSTANT_ACCELERATION, FOLLOWER_MODEL, RECORDED_LEADERS

FloatArray = NDArray[np.float64]

PERSISTS = 2.0
"""How long a measured acceleration is taken to last [s]; constant speed follows."""


def known_scene(scene: Scene, packed: PackedScene, k: int, how: str) -> PackedScene:
    """The packed scene with its leaders predicted from their states at sample k on; what was before stays.

    how: of ``vocab.sections.LEADERS``; ``RECORDED_LEADERS`` is perfect foresight. Nobody is foreseen to change
    lane: who leads at k leads to H.
    """
    if how == RECORDED_LEADERS:
        return packed
    motions = list(leaders_of(scene).values())
    x, y = packed.leader_x.copy(), packed.leader_y.copy()
    for i, motion in enumerate(motions):
        x[i, k:] = motion.x[k] + _way(motion, k, how, packed)[0]
        y[i, k:] = motion.y[k]
    front, v = packed.target_front.copy(), packed.target_v.copy()
    leader = leader_at(scene, k)
    if leader is None:
        front[k:], v[k:] = np.inf, 0.0
    else:
        way, speed = _way(leader, k, how, packed)
        front[k:], v[k:] = front[k] + way, speed
    return packed._replace(leader_x=x, leader_y=y, target_front=front, target_v=v)


def leader_at(scene: Scene, k: int) -> Motion | None:
    """Who leads the target lane at sample k."""
    leader = scene.target_leader
    for later in scene.next_leaders:
        if later.since <= k:
            leader = later.motion
    return leader


def _way(motion: Motion, k: int, how: str, packed: PackedScene) -> tuple[FloatArray, FloatArray]:
    """The way [m] and the speed [m/s] that are predicted for the samples from k on."""
    dt, n = packed.dt, len(motion.x) - k
    v, a = float(motion.v[k]), float(motion.a[k])
    if how == FOLLOWER_MODEL:
        nobody, driver = (np.full(n, np.inf), np.zeros(n)), TABLE3_MEANS.as_array()
        return drive_behind(0.0, v, *nobody, driver, packed.hardest, dt)
    t = np.arange(n) * dt
    lasting = np.minimum(t, PERSISTS) if how == CONSTANT_ACCELERATION else 0.0 * t
    speed = np.maximum(v + a * lasting, 0.0)
    return np.concatenate([[0.0], np.cumsum(speed[1:])]) * dt, speed


def reached(av: AvMotion, scene: PackedScene, share: float, *, k: int, since: int) -> int:
    """The sample, at most k, at which the AV has made that share of its lateral way; ``NOT_YET`` if it has not.

    since: the start of its manoeuvre. Half of the way is its crossing.
    """
    if share == 0.0:
        return since if since <= k else NOT_YET
    if share == 0.5:
        return av.crossing if av.crossing <= k else NOT_YET
    made = np.flatnonzero(av.y[: k + 1] / scene.D >= share - SHARE_TOLERANCE)
    return int(made[0]) if len(made) else NOT_YET


def joined_since(
    scene: PackedScene, parameters: FloatArray, reaction: FloatArray, first: tuple[FloatArray, FloatArray], *,
    av: AvMotion, k: int, since: int,
) -> Joined:  # fmt: skip
    """Since when a first follower of these parameters and reactions has had the AV as its leader, seen from k.

    first: its box centres [m] and speeds [m/s] over 0 .. k.
    """
    j = reached(av, scene, float(reaction[MOMENT]), k=k, since=since)
    if j > k:
        return NOT_JOINED
    x, v = first
    own = float(x[j]) + float(scene.follower_length[0]) / 2.0
    before = float(scene.target_front[j]) - own, float(scene.target_v[j])
    spacing = float(av.x[j]) + scene.length / 2.0 - own
    _, _, b, B, tau, L = (float(value) for value in parameters)
    credit = jump(int(reaction[FAMILY]), float(v[j]), spacing, float(av.vx[j]), *before, b, B, tau, L)
    return Joined(j - k, *credit)
