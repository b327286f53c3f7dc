"""The scene of a later moment: an event with another sample as its start, everybody where he is by then."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.quintic import AT_REST, StartState
from highd_lc.planning.scene import NOT_JOINED, Joined, Motion, PackedScene

FloatArray = NDArray[np.float64]


class AvState(NamedTuple):
    """The AV at a moment: x [m] and forward speed [m/s] of its planned point, and how a plan starts beside."""

    x: float
    v: float
    start: StartState = AT_REST


class Around(NamedTuple):
    """Who reacts to the AV, at a moment: followers' box centres [m] and speeds [m/s], each of shape (p,).

    origin: the same two of the origin follower; None = without one, or once it counts no more. joined: since when
    the first follower has had the AV as its leader.
    """

    x: FloatArray
    v: FloatArray
    origin: tuple[float, float] | None
    joined: Joined = NOT_JOINED


def later_scene(scene: PackedScene, k: int, av: AvState, around: Around) -> PackedScene:
    """The scene with its sample k as the first one and the AV's place there as its origin along the lane."""
    origin = np.empty(0)
    if around.origin is not None:
        x, v = around.origin
        origin = np.array([x - av.x, scene.origin_follower[1], v, *scene.origin_follower[3:]])
    return scene._replace(
        v0=av.v,
        start=av.start,
        joined=around.joined,
        target_front=scene.target_front[k:] - av.x,
        target_v=scene.target_v[k:].copy(),
        leader_x=np.ascontiguousarray(scene.leader_x[:, k:]) - av.x,
        leader_y=np.ascontiguousarray(scene.leader_y[:, k:]),
        follower_x=around.x - av.x,
        follower_v=around.v.copy(),
        clock=scene.clock + k * scene.dt,
        origin_follower=origin,
    )


def own_lane(packed: PackedScene, leader: Motion | None) -> PackedScene:
    """The scene of an AV that keeps its lane: behind the origin leader, or on a free road."""
    samples = len(packed.target_v)
    return packed._replace(
        target_front=np.full(samples, np.inf) if leader is None else leader.x + leader.length / 2.0,
        target_v=np.zeros(samples) if leader is None else leader.v,
        target_length=0.0 if leader is None else leader.length,
        D=0.0,
    )
