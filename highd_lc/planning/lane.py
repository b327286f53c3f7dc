"""Pairs of vehicles that follow one another on a lane, and the contacts between them (equations.md 5.4)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from highd_lc.planning.replay import Replay, origin_follower_motion
from highd_lc.planning.scene import Motion, PackedScene
from highd_lc.vocab import names

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Pair:
    """A follower and its leader on the target lane: gap [m], speeds [m/s], each of shape (N + 1,).

    The samples before ``first`` do not count: the AV is still on its own lane. follower, leader: their roles.
    """

    gap: FloatArray
    v_follower: FloatArray
    v_leader: FloatArray
    leader_length: float
    first: int
    follower: str
    leader: str

    def contact(self, first: int, last: int) -> int | None:
        """The first of the samples first .. last at which the follower's front is past the leader's rear."""
        through = np.flatnonzero(self.gap[first : last + 1] < 0.0)
        return first + int(through[0]) if len(through) else None


def pairs(replay: Replay, scene: PackedScene, *, joins: bool) -> list[Pair]:
    """Pairs on the target lane: AV in its gap, behind the target leader if not told otherwise, and the followers.

    joins: whether the AV enters the lane (at its crossing); otherwise the first follower stays behind the leader.
    """
    lane, place = _lane(replay, scene)
    if joins:
        lane.insert(place, (names.EGO, replay.av.x + scene.length / 2.0, replay.av.vx, scene.length))
    firsts = [0] * (len(lane) + 1)
    if joins:
        firsts[place] = firsts[place + 1] = replay.av.crossing
    return _pairs(lane, firsts)


_Vehicle = tuple[str, FloatArray, FloatArray, float]
"""A vehicle on a lane: role, front [m], speed [m/s], length [m]."""


def _lane(replay: Replay, scene: PackedScene) -> tuple[list[_Vehicle], int]:
    """Target leader and followers, foremost first, and how many of them the AV has ahead once it is among them."""
    front, v, place = scene.target_front, scene.target_v, 1
    if replay.entry is not None:
        front, v, place = replay.entry.target_front, replay.entry.target_v, replay.entry.place
    lane: list[_Vehicle] = [(names.TARGET_LEADER, front, v, scene.target_length)]
    for i, length in enumerate(scene.follower_length):
        lane.append((names.target_follower(i + 1), replay.x[i] + length / 2.0, replay.v[i], float(length)))
    return lane, place


def _pairs(lane: list[_Vehicle], firsts: list[int]) -> list[Pair]:
    """Each vehicle with the one before it, where there is one. firsts: the sample from which each counts."""
    return [
        Pair(ahead[1] - behind[1] - ahead[3], behind[2], ahead[2], ahead[3], first, behind[0], ahead[0])
        for ahead, behind, first in zip(lane, lane[1:], firsts[1:], strict=False)
        if np.isfinite(ahead[1][0])
    ]


def first_contact(
    replay: Replay, scene: PackedScene, *, joins: bool, last: int, origin_leader: Motion | None = None
) -> str:
    """The first contact of a replay up to sample ``last``: who drives through whom (``names.through``), or "".

    A contact is a front past the rear bumper of the vehicle ahead in the same lane. An AV that joins is on the
    target lane from its crossing; before, its ellipse is what counts. One that does not join follows
    ``origin_leader`` and is followed by the origin follower.
    """
    if not scene.asks_all:
        return ""
    lane, _ = _lane(replay, scene)
    before = min(replay.av.crossing - 1, last) if joins else last
    met = [(pair.contact(pair.first, last), pair) for pair in pairs(replay, scene, joins=joins)]
    met += [(pair.contact(0, before), pair) for pair in _pairs(lane, [0] * len(lane))]
    if not joins:
        own = _origin_lane(replay, scene, origin_leader)
        met += [(pair.contact(0, last), pair) for pair in _pairs(own, [0] * len(own))]
    found = [(sample, names.through(pair.follower, pair.leader)) for sample, pair in met if sample is not None]
    return min(found)[1] if found else ""


def _origin_lane(replay: Replay, scene: PackedScene, leader: Motion | None) -> list[_Vehicle]:
    """Origin leader, AV and origin follower when the AV keeps its lane."""
    av = replay.av
    lane: list[_Vehicle] = [(names.EGO, av.x + scene.length / 2.0, av.vx, scene.length)]
    if leader is not None:
        lane.insert(0, (names.ORIGIN_LEADER, leader.x + leader.length / 2.0, leader.v, leader.length))
    if len(scene.origin_follower):
        length = float(scene.origin_follower[3])
        x = origin_follower_motion(lane[-1][1], av.vx, len(av.x) - 1, scene)
        lane.append((names.ORIGIN_FOLLOWER, x + length / 2.0, np.gradient(x, scene.dt), length))
    return lane
