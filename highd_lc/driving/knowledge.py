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
from highd_lc.vocab.sections import BRAKING, CONSTANT_SPEED, FOLLOWER_MODEL, RECORDED_LEADERS

FloatArray = NDArray[np.float64]

PERSISTS = 2.0
"""How long a measured acceleration, and a speed across, are taken to last [s]."""
BRAKES_ON = 1.0
"""How long who has been braking is taken to go on [s], and over how long that is measured."""
_LOOKS_BACK = 5
"""Over so many samples a speed across is measured."""


def known_scene(scene: Scene, packed: PackedScene, k: int, how: str, *, av_front: float = np.inf) -> PackedScene:
    """The packed scene with its leaders predicted from their states at sample k on; what was before stays.

    how: of ``vocab.sections.LEADERS``; ``RECORDED_LEADERS`` is perfect foresight. Who leads at k leads to H. The
    origin leader is foreseen to come over to the target lane if it does so already (see ``comes_over``). Of an AV
    on that lane, with its front at av_front [m], it is then the leader, if it is ahead and the nearest.
    """
    if how == RECORDED_LEADERS:
        return packed
    motions = list(leaders_of(scene).values())
    x, y = packed.leader_x.copy(), packed.leader_y.copy()
    for i, motion in enumerate(motions):
        x[i, k:] = motion.x[k] + _way(motion, k, how, packed)[0]
        y[i, k:] = motion.y[k]
    front, v = packed.target_front.copy(), packed.target_v.copy()
    leader, rear = leader_at(scene, k), float(front[k]) - packed.target_length
    over = scene.origin_leader
    if over is not None and comes_over(scene, over, k, packed.safety.clearance):
        y[0, k:] += _way_across(over, k, packed.dt)
        if av_front < over.x[k] - over.length / 2.0 < rear:
            leader, rear = over, float(over.x[k]) - over.length / 2.0
    if leader is None:
        front[k:], v[k:] = np.inf, 0.0
    else:
        way, speed = _way(leader, k, how, packed)
        front[k:], v[k:] = rear + packed.target_length + way, speed
    return packed._replace(leader_x=x, leader_y=y, target_front=front, target_v=v)


def comes_over(scene: Scene, motion: Motion, k: int, clearance: float) -> bool:
    """Whether a vehicle stands in the way on the target lane, or soon will at its speed across at sample k."""
    y = motion.y[k] + _way_across(motion, k, scene.dt)
    return bool(in_the_way(scene, motion, y, clearance)[-1])


def in_the_way(scene: Scene, motion: Motion, y: FloatArray, clearance: float) -> NDArray[np.bool_]:
    """Whether a vehicle at y [m] stands in the way of an AV in the middle of the target lane: no box could pass.

    clearance: to be left between the boxes [m].
    """
    return np.asarray(np.abs(scene.lateral_shift - y) < (scene.width + motion.width) / 2.0 + clearance)


def _way_across(motion: Motion, k: int, dt: float) -> FloatArray:
    """The way across [m] that is predicted for the samples from k on: the present speed for ``PERSISTS``."""
    first = max(k - _LOOKS_BACK, 0)
    speed = (motion.y[k] - motion.y[first]) / ((k - first) * dt) if k else 0.0
    return np.asarray(speed * np.minimum(np.arange(len(motion.y) - k) * dt, PERSISTS))


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
    v, a = float(motion.v[k]), float(motion.a[k]) if how != BRAKING else _braking(motion, k, dt)
    if how == FOLLOWER_MODEL:
        nobody, driver = (np.full(n, np.inf), np.zeros(n)), TABLE3_MEANS.as_array()
        return drive_behind(0.0, v, *nobody, driver, packed.hardest, dt)
    t = np.arange(n) * dt
    lasting = np.minimum(t, {CONSTANT_SPEED: 0.0, BRAKING: BRAKES_ON}.get(how, PERSISTS))
    speed = np.maximum(v + a * lasting, 0.0)
    return np.concatenate([[0.0], np.cumsum(speed[1:])]) * dt, speed


def _braking(motion: Motion, k: int, dt: float) -> float:
    """The mean acceleration up to sample k, if it is a braking, else 0 [m/s^2]; at t_start the measured one."""
    first = max(k - round(BRAKES_ON / dt), 0)
    mean = float(motion.v[k] - motion.v[first]) / ((k - first) * dt) if k else float(motion.a[0])
    return min(mean, 0.0)


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
