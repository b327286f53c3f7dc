"""Followers' losses of a given motion of the AV under other drivers: drawn parameters, or the IDM.

The chain of followers drives behind the target leader. One of them has the AV ahead instead from some sample on:
the first one from t_start, or whoever is behind the gap that an AV chose with its start. If that one goes ahead
of the target leader, the leader keeps the motion that it has under the plan, by LCM, whoever the followers are.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.core.drive import (
    IDM,
    LCM,
    NO_COMMAND,
    UNBOUNDED,
    advance,
    bounded,
    credited,
    family_command,
    follower_command,
    jump,
    remembered,
)
from highd_lc.core.kernels import UNALIASED, kernel
from highd_lc.core.lcm import MOTORWAY
from highd_lc.core.losses import LossTerms, charged
from highd_lc.planning.contacts import NO_CONTACT
from highd_lc.planning.replay import AvMotion, Entry, av_charge, joins
from highd_lc.planning.scene import BARE_LCM, FAMILY, MEMORY, MOMENT, PackedScene
from highd_lc.vocab.driver import REPLAY_L_BOUNDS

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class DrawnLosses:
    """The followers' loss charged to T and to H, shape (K,): one value a set of drivers.

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
    if entry is None:
        return Joining(0, joins(av, scene), -1, av.crossing, scene.target_front, scene.target_v)
    handed = -1 if entry.hand_over is None else entry.hand_over
    since = max(joins(av, scene, max(entry.place - 1, 0)), handed)
    return Joining(entry.place - 1, since, handed, av.crossing, entry.target_front, entry.target_v)


# Rows of a scratch with a column for each set of drivers: losses, a vehicle on its way (front, speed, command),
# its L, and what it credits of its change of leader (spacing, speed).
LOSS, FRONT, SPEED, COMMAND, SPACING, JUMP, V_JUMP = range(7)
_ROWS = 7
_MOTORWAY = np.array([MOTORWAY.v_desire, MOTORWAY.A, MOTORWAY.b, MOTORWAY.b, MOTORWAY.T, MOTORWAY.s0])


def drawn_followers(
    av: AvMotion, scene: PackedScene, terms: LossTerms, parameters: FloatArray, entry: Entry | None = None
) -> DrawnLosses:
    """The followers' aggregated loss for each of K sets of their model's parameters, shape (K, p, 6).

    How they react is the scene's. L of a follower behind the one before, or behind the AV, moves with its own L.
    entry: as in ``Replay``.
    """
    count = len(parameters)
    out = DrawnLosses(np.zeros(count), np.zeros(count), np.full(count, NO_CONTACT), av.n)
    joined = joining(av, scene, entry)
    drivers = np.ascontiguousarray(parameters.transpose(1, 2, 0)).reshape(len(scene.follower_x), -1)
    before, behind_av = _moved_lengths(parameters, scene, joined.follower)
    ends = out.to_T, out.to_H, out.contact
    _drive(av.x + scene.length / 2.0, av.vx, joined, av.n, scene, terms, drivers, before, behind_av, *ends)
    return out


def _moved_lengths(parameters: FloatArray, scene: PackedScene, follower: int) -> tuple[FloatArray, FloatArray]:
    """L behind whoever is ahead in the chain, shape (p, K), and that of ``follower`` behind the AV, (K,).

    The first follower's parameters hold its L behind the AV, the others' that behind the one before.
    """
    before = parameters[:, :, 5].T.copy()
    before[0] += scene.first_L - scene.parameters[0, 5]
    if follower <= 0 or scene.reactions[follower, FAMILY] != LCM:
        return before, parameters[:, max(follower, 0), 5].copy()
    moved = parameters[:, follower, 5] - scene.follower_length[follower - 1] + scene.length
    return before, np.clip(moved, *REPLAY_L_BOUNDS)


def idm_followers(av: AvMotion, scene: PackedScene, terms: LossTerms, entry: Entry | None = None) -> DrawnLosses:
    """The followers' aggregated loss if all of them drive by the IDM on a motorway; shape (1,)."""
    reactions = scene.reactions.copy()
    reactions[:, FAMILY:MOMENT] = float(IDM), *BARE_LCM[MEMORY:]
    drivers = np.tile(_MOTORWAY, (1, len(reactions), 1))
    hardest = min(scene.hardest, MOTORWAY.hardest)
    same = scene._replace(reactions=reactions, parameters=drivers[0], first_L=MOTORWAY.s0, hardest=hardest)
    return drawn_followers(av, same, terms, drivers, entry)


def av_charged(av: AvMotion, terms: LossTerms) -> tuple[float, float]:
    """The AV's loss charged to T and to H."""
    loss = av_charge(av, terms).loss
    return float(loss[av.n]), float(loss[-1])


@njit(inline="always")
def _step(
    k: int,
    family: int,
    reacts: bool,
    own: FloatArray,
    length: float,
    share: float,
    reaction: tuple[float, float, float, float],
    charge: tuple[float, float, float, float],
    dt: float,
    hardest: float,
    state: FloatArray,
    front: FloatArray,
    speed: FloatArray,
) -> None:
    """A follower's step at sample k, of all K sets. family, reacts: constants where this is inlined.

    own: parameters (6 K,); share: of the jump that is still credited; reaction: m, a_0, drift, need; charge:
    weight of a step of the command, of a speed difference, the reference speed, 0 where only the shortfall counts.
    """
    K = len(own) // 6
    m, a_0, drift, need = reaction
    counted, efficiency, ref, both_sides = charge
    for w in range(K):
        x, v = state[FRONT * K + w], state[SPEED * K + w]
        spacing, v_leader = front[k * K + w] - x, speed[k * K + w]
        v_desire, A, b, B, tau = own[w], own[K + w], own[2 * K + w], own[3 * K + w], own[4 * K + w]
        L = state[SPACING * K + w]
        if reacts:
            credit, v_credit = share * state[JUMP * K + w], share * state[V_JUMP * K + w]
            a = follower_command(
                family, v, spacing, v_leader, length, v_desire, A, b, B, tau, L,
                credit, v_credit, m, a_0, drift, need, hardest,
            )  # fmt: skip
        else:
            a = bounded(family_command(family, v, spacing, v_leader, length, v_desire, A, b, B, tau, L), hardest)
        later, faster = advance(x, v, a, dt)
        step = abs(a - state[COMMAND * K + w])
        state[LOSS * K + w] = charged(state[LOSS * K + w], step, v, ref, counted, efficiency, both_sides)
        front[k * K + w], speed[k * K + w] = x, v
        state[FRONT * K + w], state[SPEED * K + w], state[COMMAND * K + w] = later, faster, a


@kernel(error_model="numpy", **UNALIASED)
def _drive(
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

    drivers: shape (p, 6 K), parameter by parameter. Sets are innermost, so that LLVM vectorises the step.
    """
    K, samples, dt = len(to_T), len(av_v), scene.dt
    front, speed = np.empty(samples * K), np.empty(samples * K)
    for k in range(samples):
        front[k * K : (k + 1) * K], speed[k * K : (k + 1) * K] = joined.target_front[k], joined.target_v[k]
    rear = front - scene.target_length
    state, old, old_v = np.empty(_ROWS * K), np.empty(K), np.empty(K)
    both_sides = 0.0 if terms.one_sided else 1.0
    for i in range(len(scene.follower_x)):
        family, memory, relaxation, need, a_0, drift, _ = scene.reactions[i]
        ref, own, joins = terms.hv_ref[i], drivers[i], i == joined.follower
        relaxes = joins and relaxation > 0.0 and joined.since < samples
        reacts = memory > 0.0 or drift != 0.0 or need < UNBOUNDED or relaxes
        since, length = 0, scene.follower_length[i - 1] if i else scene.target_length
        if joins:
            since = joined.since
            _enter(joined.crossing, av_front, scene.length, rear, contact)
            if relaxes:
                old[:], old_v[:] = front[since * K : (since + 1) * K], speed[since * K : (since + 1) * K]
            for k in range(since, samples):
                front[k * K : (k + 1) * K], speed[k * K : (k + 1) * K] = av_front[k], av_v[k]
        for w in range(K):
            state[LOSS * K + w] = 0.0
            state[FRONT * K + w] = scene.follower_x[i] + scene.follower_length[i] / 2.0
            state[SPEED * K + w] = scene.follower_v[i]
            state[COMMAND * K + w] = 0.0
            state[SPACING * K + w] = before_L[i, w]
            state[JUMP * K + w], state[V_JUMP * K + w] = 0.0, 0.0
        for k in range(samples):
            if joins and k == since:
                state[SPACING * K : (SPACING + 1) * K] = behind_av_L
                length = scene.length
            if relaxes and k == since:
                for w in range(K):
                    x, v = state[FRONT * K + w], state[SPEED * K + w]
                    state[JUMP * K + w], state[V_JUMP * K + w] = jump(
                        family, v, front[k * K + w] - x, speed[k * K + w], old[w] - x, old_v[w],
                        own[2 * K + w], own[3 * K + w], own[4 * K + w], behind_av_L[w],
                    )  # fmt: skip
            counted = 0.0 if k == 0 or (joins and k == joined.uncounted) else terms.comfort / dt
            charge = (counted, terms.efficiency, ref, both_sides)
            share = credited((k - since) * dt, relaxation) if relaxes else 0.0
            reaction = (remembered(scene.clock + k * dt, memory), a_0, drift, need)
            if family == LCM and not reacts:
                _step(k, LCM, False, own, length, share, reaction, charge, dt, scene.hardest, state, front, speed)
            elif family == LCM:
                _step(k, LCM, True, own, length, share, reaction, charge, dt, scene.hardest, state, front, speed)
            elif family == IDM:
                _step(k, IDM, True, own, length, share, reaction, charge, dt, scene.hardest, state, front, speed)
            elif family == NO_COMMAND:
                _step(
                    k, NO_COMMAND, True, own, length, share, reaction, charge, dt, scene.hardest,
                    state, front, speed,
                )  # fmt: skip
            else:
                _step(
                    k, int(family), True, own, length, share, reaction, charge, dt, scene.hardest,
                    state, front, speed,
                )  # fmt: skip
            if k == n:
                for w in range(K):
                    to_T[w] += terms.weights[i] * state[LOSS * K + w]
        for w in range(K):
            to_H[w] += terms.weights[i] * state[LOSS * K + w]
        _meet(front, rear, contact)
        rear[:] = front - scene.follower_length[i]
    if not scene.asks_all:
        contact[:] = NO_CONTACT


@kernel(error_model="numpy")
def _enter(crossing: int, av_front: FloatArray, length: float, rear: FloatArray, contact: IntArray) -> None:
    """The AV enters the lane at its crossing behind rear bumpers, flat (N + 1, K), which its own replaces."""
    K = len(contact)
    for k in range(crossing, len(av_front)):
        for w in range(K):
            if av_front[k] > rear[k * K + w]:
                contact[w] = min(contact[w], k)
            rear[k * K + w] = av_front[k] - length


@kernel(error_model="numpy")
def _meet(front: FloatArray, rear: FloatArray, contact: IntArray) -> None:
    """Lower contact (K,) to the first sample at which a front is past the rear ahead; both flat (N + 1, K)."""
    K = len(contact)
    for at in range(len(front)):
        if front[at] > rear[at]:
            contact[at % K] = min(contact[at % K], at // K)
