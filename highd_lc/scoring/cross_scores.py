"""Followers' losses of a given motion of the AV under other drivers: drawn LCM parameters, or the IDM.

The chain of followers drives behind the target leader. One of them has the AV ahead instead from some sample on:
the first one from t_start, or whoever is behind the gap that an AV chose with its start. If that one goes ahead
of the target leader, the leader keeps the motion that it has under the plan, by LCM, whoever the followers are.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.core.drive import idm_step, lcm_step
from highd_lc.core.idm import MOTORWAY, IdmParameters
from highd_lc.core.kernels import UNALIASED
from highd_lc.core.losses import cumulative_comfort, cumulative_efficiency
from highd_lc.planning.candidates import LossTerms
from highd_lc.planning.contacts import NO_CONTACT
from highd_lc.planning.replay import AvMotion, Entry
from highd_lc.planning.scene import PackedScene
from highd_lc.vocab.driver import REPLAY_L_BOUNDS

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Charged:
    """A side's loss charged to T and to H, shape (K,): one value a set of drivers.

    contact: first sample at which somebody on the target lane is past the rear bumper of the vehicle ahead, shape
    (K,); NO_CONTACT if nobody ever is, or if only the AV's contacts are asked for. n: sample of T.
    """

    to_T: FloatArray
    to_H: FloatArray
    contact: IntArray
    n: int

    def touches(self, *, to_T: bool) -> NDArray[np.bool_]:
        """Which sets of drivers come to a contact up to T, or up to H; shape (K,)."""
        return self.contact <= (self.n if to_T else NO_CONTACT - 1)


class Joining(NamedTuple):
    """Where the AV joins the chain of the followers.

    follower: who has it ahead (-1: none of them) from the sample ``since`` on; uncounted: sample at which the step
    of that one's command is not charged (-1: none). crossing: sample from which the AV is on the lane.
    target_front [m], target_v [m/s]: of the target leader.
    """

    follower: int
    since: int
    uncounted: int
    crossing: int
    target_front: FloatArray
    target_v: FloatArray


def joining(av: AvMotion, scene: PackedScene, entry: Entry | None) -> Joining:
    """How the AV of a replay joins. entry: as in ``Replay``."""
    crossing = av.crossing if scene.from_crossing else 0
    if entry is None:
        return Joining(0, crossing, -1, av.crossing, scene.target_front, scene.target_v)
    handed = -1 if entry.hand_over is None else entry.hand_over
    since = max(crossing, handed)
    return Joining(entry.place - 1, since, handed, av.crossing, entry.target_front, entry.target_v)


def lcm_followers(
    av: AvMotion, scene: PackedScene, terms: LossTerms, parameters: FloatArray, entry: Entry | None = None
) -> Charged:
    """The followers' aggregated loss for each of K sets of LCM parameters, shape (K, p, 6).

    L of a follower behind the one before, or behind the AV, moves with its own L. entry: as in ``Replay``.
    """
    count = len(parameters)
    out = Charged(np.zeros(count), np.zeros(count), np.full(count, NO_CONTACT), av.n)
    joined = joining(av, scene, entry)
    drivers = np.ascontiguousarray(parameters.transpose(1, 2, 0)).reshape(len(scene.follower_x), -1)
    before, behind_av = _moved_lengths(parameters, scene, joined.follower)
    ends = out.to_T, out.to_H, out.contact
    _drive_lcm(av.x + scene.length / 2.0, av.vx, joined, av.n, scene, terms, drivers, before, behind_av, *ends)
    return out


def _moved_lengths(parameters: FloatArray, scene: PackedScene, follower: int) -> tuple[FloatArray, FloatArray]:
    """L behind whoever is ahead in the chain, shape (p, K), and that of ``follower`` behind the AV, (K,).

    The first follower's parameters hold its L behind the AV, the others' that behind the one before.
    """
    before = parameters[:, :, 5].T.copy()
    before[0] += scene.first_L - scene.parameters[0, 5]
    if follower <= 0:
        return before, parameters[:, 0, 5].copy()
    moved = parameters[:, follower, 5] - scene.follower_length[follower - 1] + scene.length
    return before, np.clip(moved, *REPLAY_L_BOUNDS)


def idm_followers(av: AvMotion, scene: PackedScene, terms: LossTerms, entry: Entry | None = None) -> Charged:
    """The followers' aggregated loss if all of them drive by the IDM on a motorway; shape (1,)."""
    joined = joining(av, scene, entry)
    to_T, to_H, contact = _drive_idm(av.x + scene.length / 2.0, av.vx, joined, av.n, scene, terms, MOTORWAY)
    return Charged(np.array([to_T]), np.array([to_H]), np.array([contact]), av.n)


def av_charged(av: AvMotion, terms: LossTerms) -> tuple[float, float]:
    """The AV's loss charged to T and to H."""
    speed = np.hypot(av.vx, av.vy)
    # The terms hold 0.5 / N: dividing by their inverse gives the weighted sums.
    comfort = cumulative_comfort(av.jerk, scale=1.0 / terms.comfort)
    scale = 1.0 / terms.efficiency
    loss = comfort + cumulative_efficiency(speed, terms.av_ref, scale=scale, one_sided=terms.one_sided)
    return float(loss[av.n]), float(loss[-1])


@njit(cache=True, nogil=True, fastmath={"contract", "arcp"}, error_model="numpy", **UNALIASED)
def _drive_lcm(
    av_front: FloatArray,
    av_v: FloatArray,
    joined: Joining,
    n: int,
    scene: PackedScene,
    terms: LossTerms,
    drivers: FloatArray,
    before_L: FloatArray,
    behind_av_L: FloatArray,
    to_T: FloatArray,
    to_H: FloatArray,
    contact: IntArray,
) -> None:
    """Add the loss of every follower to to_T and to_H (K,), all sets at once; conventions of ``replay.follow``.

    contact (K,) is lowered to the first sample of a contact.

    drivers: shape (p, 6 K), parameter by parameter. Sets are innermost, so that LLVM vectorises the LCM.
    """
    K, samples, dt = len(to_T), len(av_v), scene.dt
    front, speed = np.empty(samples * K), np.empty(samples * K)
    for k in range(samples):
        front[k * K : (k + 1) * K], speed[k * K : (k + 1) * K] = joined.target_front[k], joined.target_v[k]
    rear = front - scene.target_length
    state = np.empty(5 * K)
    both_sides = 0.0 if terms.one_sided else 1.0
    for i in range(len(scene.follower_x)):
        ref, own, joins = terms.hv_ref[i], drivers[i], i == joined.follower
        if joins:
            _enter(joined.crossing, av_front, scene.length, rear, contact)
            for k in range(joined.since, samples):
                front[k * K : (k + 1) * K], speed[k * K : (k + 1) * K] = av_front[k], av_v[k]
        for w in range(K):
            state[w] = 0.0
            state[K + w] = scene.follower_x[i] + scene.follower_length[i] / 2.0
            state[2 * K + w] = scene.follower_v[i]
            state[3 * K + w] = 0.0
            state[4 * K + w] = before_L[i, w]
        for k in range(samples):
            if joins and k == joined.since:
                state[4 * K : 5 * K] = behind_av_L
            counted = 0.0 if k == 0 or (joins and k == joined.uncounted) else terms.comfort / dt
            for w in range(K):
                x, v = state[K + w], state[2 * K + w]
                a, later, faster = lcm_step(
                    x,
                    v,
                    front[k * K + w],
                    speed[k * K + w],
                    own[w],
                    own[K + w],
                    own[2 * K + w],
                    own[3 * K + w],
                    own[4 * K + w],
                    state[4 * K + w],
                    scene.hardest,
                    dt,
                )
                short = ref - v
                state[w] += counted * abs(a - state[3 * K + w]) + terms.efficiency * max(
                    short, -both_sides * short
                )
                front[k * K + w], speed[k * K + w] = x, v
                state[K + w], state[2 * K + w], state[3 * K + w] = later, faster, a
            if k == n:
                for w in range(K):
                    to_T[w] += terms.weights[i] * state[w]
        for w in range(K):
            to_H[w] += terms.weights[i] * state[w]
        _meet(front, rear, contact)
        rear[:] = front - scene.follower_length[i]
    if not scene.asks_all:
        contact[:] = NO_CONTACT


@njit(cache=True, nogil=True, error_model="numpy")
def _enter(crossing: int, av_front: FloatArray, length: float, rear: FloatArray, contact: IntArray) -> None:
    """The AV enters the lane at its crossing behind rear bumpers, flat (N + 1, K), which its own replaces."""
    K = len(contact)
    for k in range(crossing, len(av_front)):
        for w in range(K):
            if av_front[k] > rear[k * K + w]:
                contact[w] = min(contact[w], k)
            rear[k * K + w] = av_front[k] - length


@njit(cache=True, nogil=True, error_model="numpy")
def _meet(front: FloatArray, rear: FloatArray, contact: IntArray) -> None:
    """Lower contact (K,) to the first sample at which a front is past the rear ahead; both flat (N + 1, K)."""
    K = len(contact)
    for at in range(len(front)):
        if front[at] > rear[at]:
            contact[at % K] = min(contact[at % K], at // K)


@njit(cache=True, nogil=True, error_model="numpy")
def _drive_idm(
    av_front: FloatArray,
    av_v: FloatArray,
    joined: Joining,
    n: int,
    scene: PackedScene,
    terms: LossTerms,
    driver: IdmParameters,
) -> tuple[float, float, int]:
    """The followers' loss to T and to H when all are the same IDM driver, and the first sample of a contact;
    conventions of ``replay.follow``.
    """
    dt, to_T, to_H = scene.dt, 0.0, 0.0
    front, speed = joined.target_front.copy(), joined.target_v.copy()
    rear, contact = front - scene.target_length, np.full(1, NO_CONTACT)
    for i in range(len(scene.follower_x)):
        joins = i == joined.follower
        if joins:
            _enter(joined.crossing, av_front, scene.length, rear, contact)
            front[joined.since :], speed[joined.since :] = av_front[joined.since :], av_v[joined.since :]
        x, v = scene.follower_x[i] + scene.follower_length[i] / 2.0, scene.follower_v[i]
        ahead, before, loss = scene.target_length if i == 0 else scene.follower_length[i - 1], 0.0, 0.0
        for k in range(len(av_v)):
            length = scene.length if joins and k >= joined.since else ahead
            a, later, faster = idm_step(x, v, front[k] - length, speed[k], driver, scene.hardest, dt)
            short = terms.hv_ref[i] - v
            loss += terms.efficiency * (max(short, 0.0) if terms.one_sided else abs(short))
            if k > 0 and not (joins and k == joined.uncounted):
                loss += terms.comfort / dt * abs(a - before)
            if k == n:
                to_T += terms.weights[i] * loss
            front[k], speed[k], before = x, v, a
            x, v = later, faster
        to_H += terms.weights[i] * loss
        _meet(front, rear, contact)
        rear[:] = front - scene.follower_length[i]
    return to_T, to_H, contact[0] if scene.asks_all else NO_CONTACT
