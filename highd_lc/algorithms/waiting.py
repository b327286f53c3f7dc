"""Waiting before a lane change: what happens until the AV starts, in which gap it then goes, what is charged.

Until it starts the AV keeps its lane, and the followers stay behind the target leader by LCM. Both can be
simulated once, for they do not depend on the plan. So a delay d makes an event a later one, with the states at
t_start + d as its start: the planner's kernels search it as any other, and the losses charged before d are added.

Sample d belongs to the manoeuvre. Steps of a commanded acceleration at the joint are not counted where a motion is
handed over (the AV's from waiting to the quintic, that of the follower who gets a new leader), as at t_start of a
change without delay (SPEC section 4); those of the other followers are.
"""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.algorithms.candidates import LossTerms
from highd_lc.algorithms.contacts import NO_CONTACT
from highd_lc.algorithms.packing import PackedScene
from highd_lc.algorithms.replay import AvMotion, drive_on, follow, free_motion, origin_follower_motion
from highd_lc.core.ellipse import ellipses_overlap
from highd_lc.core.losses import command_jerk, speed_difference
from highd_lc.vocab.scene import Scene

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Waiting:
    """Everybody while the AV keeps its lane, over the samples 0 .. N.

    av: its motion (n = 0). x, v, a: of the p followers behind the target leader, shape (p, N + 1): box centre [m],
    speed [m/s], commanded acceleration [m/s^2]. origin_x, origin_v: of the origin follower behind the AV, shape
    (N + 1,), or empty. contact: first sample at which the AV's ellipse overlaps another's, or a follower has
    driven through the vehicle ahead; NO_CONTACT if none.
    """

    av: AvMotion
    x: FloatArray
    v: FloatArray
    a: FloatArray
    origin_x: FloatArray
    origin_v: FloatArray
    contact: int


class ChainContact(NamedTuple):
    """First sample at which one of the followers, undisturbed, has driven through the vehicle ahead, and which one
    (0 = nearest to the AV).
    """

    sample: int
    follower: int


NEVER: Final = ChainContact(NO_CONTACT, -1)


@dataclass(frozen=True)
class Charges:
    """Losses on the way, aggregated: av_before, hv_before (N + 1,): charged to the samples before k; hv_passed
    (N + 1,): charged over 0 .. k to the followers that the AV lets pass.
    """

    av_before: FloatArray
    hv_before: FloatArray
    hv_passed: FloatArray


def wait(scene: Scene, packed: PackedScene, *, behind_leader: bool) -> Waiting:
    """Let the AV keep its lane: at constant speed, or by LCM (Table 3 means) behind the origin leader.

    packed: the scene's arrays.
    """
    origin, samples = scene.origin_leader, len(packed.target_v)
    front = np.full(samples, np.inf) if origin is None else origin.x + origin.length / 2.0
    speed = np.zeros(samples) if origin is None else origin.v
    av = free_motion(packed)
    lane = packed._replace(target_front=front, target_v=speed, after_lcm=behind_leader)
    drive_on(av.x, av.y, av.vx, av.ax, av.jerk, 0, lane)
    x, v, a = (np.empty((len(packed.follower_x), samples)) for _ in range(3))
    follow(av.x, av.vx, samples, packed, x, v, a)
    origin_x, origin_v = np.empty(0), np.empty(0)
    if len(packed.origin_follower):
        origin_x = origin_follower_motion(av.x + packed.length / 2.0, av.vx, samples - 1, packed)
        origin_v = np.append(packed.origin_follower[2], np.diff(origin_x) / packed.dt)
    contact = min(int(_first_contact(av.x, x, origin_x, packed)), chain_contact(x, packed).sample)
    return Waiting(av, x, v, a, origin_x, origin_v, contact)


def chain_contact(x: FloatArray, packed: PackedScene) -> ChainContact:
    """The first contact of the nearest q followers, box centres x (q, N + 1) [m], behind the target leader."""
    if not packed.asks_all:
        return NEVER
    half = packed.follower_length[: len(x), None] / 2.0
    rears = np.vstack([packed.target_front - packed.target_length, x - half])
    through = x + half > rears[:-1]
    samples = np.where(through.any(axis=1), through.argmax(axis=1), NO_CONTACT)
    first = int(np.argmin(samples))
    return ChainContact(int(samples[first]), first) if samples[first] < NO_CONTACT else NEVER


@njit(cache=True, nogil=True, error_model="numpy")
def _first_contact(x: FloatArray, follower_x: FloatArray, origin_x: FloatArray, scene: PackedScene) -> int:
    """First sample at which the AV, at x [m] on its lane, overlaps a leader, a follower or the origin follower."""
    for k in range(len(x)):
        for i in range(len(scene.leader_a)):
            dx, dy = scene.leader_x[i, k] - x[k], scene.leader_y[i, k]
            if ellipses_overlap(dx, dy, 1.0, 0.0, scene.a, scene.b, scene.leader_a[i], scene.leader_b[i]):
                return k
        for i in range(len(scene.follower_a)):
            dx, dy = follower_x[i, k] - x[k], scene.follower_y[i]
            if ellipses_overlap(dx, dy, 1.0, 0.0, scene.a, scene.b, scene.follower_a[i], scene.follower_b[i]):
                return k
        if len(origin_x):
            of = scene.origin_follower
            if ellipses_overlap(origin_x[k] - x[k], of[1], 1.0, 0.0, scene.a, scene.b, of[4], of[5]):
                return k
    return NO_CONTACT


def charges(waiting: Waiting, terms: LossTerms, dt: float, *, passed: int, counts_insertion: bool) -> Charges:
    """What the AV and the followers are charged beside the manoeuvre.

    passed: number of followers that the AV lets pass; counts_insertion: whether the next one's step of the command
    at the start counts as well (it does while that one keeps its leader until the crossing, or if nobody of the
    followers gets a new one).
    """
    av_speed = speed_difference(waiting.av.vx, terms.av_ref, one_sided=terms.one_sided)
    av = terms.efficiency * av_speed + terms.comfort * waiting.av.jerk
    jerk = terms.comfort * command_jerk(waiting.a, dt)
    ref = terms.hv_ref[:, None] - waiting.v
    each = terms.efficiency * (np.maximum(ref, 0.0) if terms.one_sided else np.abs(ref)) + jerk
    before = _before(each[passed:]) + jerk[passed:]
    if len(before) and not counts_insertion:
        before[0] -= jerk[passed]
    weights = terms.weights
    return Charges(
        av_before=_before(av),
        hv_before=weights[passed:] @ before,
        hv_passed=weights[:passed] @ np.cumsum(each[:passed], axis=-1),
    )


def _before(charge: FloatArray) -> FloatArray:
    """Sum of the charges of the samples before each, along the last axis."""
    return np.asarray(np.cumsum(charge, axis=-1) - charge)
