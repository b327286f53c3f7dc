"""Losses and first contact of many candidate plans at once: the planner's hot kernel.

One row holds candidates of the same duration. They are simulated in tiles with the candidate as the innermost
axis, so that LLVM vectorises the LCM. Everything that all candidates of a row share (the lateral motion, hence
the lateral separation from everybody) is computed once per sample.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.core.drive import advance, lcm_command, lcm_step
from highd_lc.core.kernels import UNALIASED
from highd_lc.core.quintic import q_rate, q_shape, q_third, z_rate, z_shape, z_third
from highd_lc.planning.contacts import (
    CHANGE,
    COMMAND,
    DELTA,
    FRONT,
    LANES,
    NEAREST,
    NO_CONTACT,
    SPEED,
    STATE_ROWS,
    TO_H,
    TO_T,
    drive_through,
    lateral_motion,
    meet_follower,
    meet_leaders,
    meet_origin_follower,
)
from highd_lc.planning.scene import PackedScene, Scene
from highd_lc.vocab.settings import LossSettings

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class LossTerms(NamedTuple):
    """What a speed is compared with and how losses are scaled and added.

    av_ref [m/s]; hv_ref (p,) [m/s]; one_sided: charge only speeds below the reference; comfort, efficiency:
    0.5 / N_c and 0.5 / N_e; weights (p,): of the followers' losses.
    """

    av_ref: float
    hv_ref: FloatArray
    one_sided: bool
    comfort: float
    efficiency: float
    weights: FloatArray


class Outcomes(NamedTuple):
    """Losses of candidates, each of shape (rows, candidates): of the AV and the followers charged to T and to H.

    contact: first sample at which ellipses overlap or somebody is past its leader's rear (NO_CONTACT if none);
    role: which contact that is (see ``scene.contact_words``).
    """

    av_T: FloatArray
    av_H: FloatArray
    hv_T: FloatArray
    hv_H: FloatArray
    contact: IntArray
    role: IntArray


def loss_terms(scene: Scene, weights: FloatArray, settings: LossSettings) -> LossTerms:
    """The terms under the settings' reference and aggregation. weights: of equation 17, shape (p,)."""
    p = len(weights)
    own = settings.reference == "own"
    return LossTerms(
        av_ref=scene.v0 if own else settings.v_ref_av,
        hv_ref=scene.followers.v.copy() if own else np.full(p, settings.v_ref_hv),
        one_sided=settings.reference == "one-sided",
        comfort=0.5 / settings.comfort_scale,
        efficiency=0.5 / settings.efficiency_scale,
        weights=weights if settings.aggregation == "weighted" else np.ones(p),
    )


def evaluate(n: IntArray, delta: FloatArray, change: FloatArray, scene: PackedScene, terms: LossTerms) -> Outcomes:
    """Simulate candidate plans.

    n: samples of each row's duration (T = n dt), shape (rows,), each below len(scene.target_v). delta:
    x_final - v0 T [m], change: v_end - v0 [m/s], shape (rows, candidates).
    """
    outcomes = new_outcomes(delta.shape)
    evaluate_into(n, delta, change, scene, terms, outcomes)
    return outcomes


def new_outcomes(shape: tuple[int, ...]) -> Outcomes:
    """Room for the outcomes of candidates in an array of that shape."""
    av_T, av_H, hv_T, hv_H = (np.empty(shape) for _ in range(4))
    return Outcomes(av_T, av_H, hv_T, hv_H, np.empty(shape, np.int64), np.empty(shape, np.int64))


@njit(cache=True, nogil=True, **UNALIASED)
def evaluate_into(
    n: IntArray,
    delta: FloatArray,
    change: FloatArray,
    scene: PackedScene,
    terms: LossTerms,
    out: Outcomes,
) -> None:
    """Fill the outcomes of candidates (see ``evaluate``)."""
    samples, leaders = len(scene.target_v), len(scene.leader_a)
    roles = leaders + len(scene.follower_x) + (1 if len(scene.origin_follower) else 0)
    av_front, av_v = np.empty(samples * LANES), np.empty(samples * LANES)
    ahead_front, ahead_v = np.empty(samples * LANES), np.empty(samples * LANES)
    state = np.empty(STATE_ROWS * LANES)
    y, vy, reach = np.empty(samples), np.empty(samples), np.empty(samples)
    contact, role = np.empty(LANES, np.int64), np.empty(LANES, np.int64)
    rear = scene.target_front - scene.target_length
    behind_leader = scene.asks_all and np.isfinite(rear[0])
    for row in range(len(n)):
        width = delta.shape[1]
        for first in range(0, width, LANES):
            used = min(LANES, width - first)
            for w in range(LANES):
                at = first + min(w, used - 1)
                state[DELTA * LANES + w], state[CHANGE * LANES + w] = delta[row, at], change[row, at]
                contact[w], role[w] = NO_CONTACT, -1
            _drive_av(n[row], state, scene, terms, av_front, av_v)
            for w in range(used):
                out.av_T[row, first + w] = state[TO_T * LANES + w]
                out.av_H[row, first + w] = state[TO_H * LANES + w]
                out.hv_T[row, first + w], out.hv_H[row, first + w] = 0.0, 0.0
            lateral_motion(n[row], state, scene, y, vy, reach)
            meet_leaders(n[row], scene, av_front, av_v, y, vy, reach, contact, role)
            if behind_leader:
                drive_through(n[row] // 2, samples, 3 * roles + leaders - 1, rear, state, av_front, contact, role)
            ahead_front[:], ahead_v[:] = av_front, av_v
            if scene.from_crossing:
                for k in range(n[row] // 2):
                    ahead_front[k * LANES : (k + 1) * LANES] = scene.target_front[k]
                    ahead_v[k * LANES : (k + 1) * LANES] = scene.target_v[k]
            for i in range(len(scene.follower_x)):
                _drive_follower(i, n[row], state, scene, terms, ahead_front, ahead_v)
                for w in range(used):
                    out.hv_T[row, first + w] += terms.weights[i] * state[TO_T * LANES + w]
                    out.hv_H[row, first + w] += terms.weights[i] * state[TO_H * LANES + w]
                if scene.asks_all:
                    who = (1 if i else 2) * roles + leaders + i
                    _meet_ahead(i, who, n[row], state, scene, av_front, av_v, contact, role)
                if behind_leader and i == 0:
                    drive_through(0, n[row] // 2, roles + leaders, rear, state, ahead_front, contact, role)
                meet_follower(i, n[row], scene, av_front, av_v, y, vy, reach, ahead_front, contact, role)
            if len(scene.origin_follower):
                meet_origin_follower(
                    n[row], state, scene, av_front, av_v, y, vy, reach, ahead_front, contact, role
                )
            for w in range(used):
                out.contact[row, first + w], out.role[row, first + w] = contact[w], role[w]


@njit(cache=True, nogil=True, fastmath={"contract", "arcp"}, error_model="numpy", **UNALIASED)
def _drive_av(
    n: int,
    state: FloatArray,
    scene: PackedScene,
    terms: LossTerms,
    front: FloatArray,
    speed: FloatArray,
) -> None:
    """Plan to n, then the drive after T; fills fronts and speeds, and the losses in the scratch."""
    dt, v0, half, hardest = scene.dt, scene.v0, scene.length / 2.0, scene.hardest
    T = n * dt
    v_desire, A, b, B, tau, L = scene.av_parameters
    comfort, efficiency, ref = terms.comfort, terms.efficiency, terms.av_ref
    both_sides = 0.0 if terms.one_sided else 1.0
    for w in range(LANES):
        state[TO_T * LANES + w] = 0.0
    for k in range(n + 1):
        u = k / n
        base, z, q = half + v0 * k * dt, z_shape(u), T * q_shape(u)
        dz, dq = z_rate(u) / T, q_rate(u)
        j_z, j_q = z_third(u) / (T * T * T), q_third(u) / (T * T)
        vy, jy = scene.D * dz, abs(scene.D * j_z)
        for w in range(LANES):
            delta, change = state[DELTA * LANES + w], state[CHANGE * LANES + w]
            v = v0 + delta * dz + change * dq
            front[k * LANES + w] = base + delta * z + change * q
            speed[k * LANES + w] = v
            short = ref - np.sqrt(v * v + vy * vy)
            jerk = abs(delta * j_z + change * j_q) + jy
            state[TO_T * LANES + w] += comfort * jerk + efficiency * max(short, -both_sides * short)
    after = 1.0 if scene.after_lcm else 0.0
    # A plan that ends at H has no drive after T, hence no step onto it.
    handover = comfort / dt if scene.counts_handover and n + 1 < len(scene.target_v) else 0.0
    for w in range(LANES):
        x, v = front[n * LANES + w], speed[n * LANES + w]
        a = after * lcm_command(
            v, scene.target_front[n] - x, scene.target_v[n], v_desire, A, b, B, tau, L, hardest
        )
        state[FRONT * LANES + w], state[SPEED * LANES + w], state[COMMAND * LANES + w] = x, v, a
        state[TO_H * LANES + w] = state[TO_T * LANES + w] + handover * abs(a)
    for k in range(n + 1, len(scene.target_v)):
        target, target_v = scene.target_front[k], scene.target_v[k]
        for w in range(LANES):
            before = state[COMMAND * LANES + w]
            x, v = advance(state[FRONT * LANES + w], state[SPEED * LANES + w], before, dt)
            a = after * lcm_command(v, target - x, target_v, v_desire, A, b, B, tau, L, hardest)
            short = ref - v
            state[TO_H * LANES + w] += comfort * (abs(a - before) / dt) + efficiency * max(
                short, -both_sides * short
            )
            state[FRONT * LANES + w], state[SPEED * LANES + w], state[COMMAND * LANES + w] = x, v, a
            front[k * LANES + w], speed[k * LANES + w] = x, v


@njit(cache=True, nogil=True, fastmath={"contract", "arcp"}, error_model="numpy", **UNALIASED)
def _drive_follower(
    i: int,
    n: int,
    state: FloatArray,
    scene: PackedScene,
    terms: LossTerms,
    front: FloatArray,
    speed: FloatArray,
) -> None:
    """Follower i behind the motion in front and speed, which its own replaces.

    In the scratch: its losses, and its smallest spacing to whom it follows (to the AV: from the crossing on).
    """
    dt, hardest = scene.dt, scene.hardest
    v_desire, A, b, B, tau, L_replay = scene.parameters[i]
    comfort, efficiency, ref = terms.comfort, terms.efficiency, terms.hv_ref[i]
    both_sides = 0.0 if terms.one_sided else 1.0
    insertion = n // 2 if (scene.from_crossing and i == 0) else 0
    joined = 0 if i else n // 2
    for w in range(LANES):
        state[TO_H * LANES + w] = 0.0
        state[FRONT * LANES + w] = scene.follower_x[i] + scene.follower_length[i] / 2.0
        state[SPEED * LANES + w] = scene.follower_v[i]
        state[COMMAND * LANES + w] = 0.0
        state[NEAREST * LANES + w] = np.inf
    for k in range(len(scene.target_v)):
        L = scene.first_L if k < insertion else L_replay
        counted = comfort / dt if k > 0 else 0.0
        if k == joined:
            state[NEAREST * LANES : (NEAREST + 1) * LANES] = np.inf
        for w in range(LANES):
            x, v, ahead = state[FRONT * LANES + w], state[SPEED * LANES + w], front[k * LANES + w]
            a, later, faster = lcm_step(x, v, ahead, speed[k * LANES + w], v_desire, A, b, B, tau, L, hardest, dt)
            short = ref - v
            state[TO_H * LANES + w] += counted * abs(a - state[COMMAND * LANES + w]) + efficiency * max(
                short, -both_sides * short
            )
            state[NEAREST * LANES + w] = min(state[NEAREST * LANES + w], ahead - x)
            front[k * LANES + w], speed[k * LANES + w] = x, v
            state[FRONT * LANES + w], state[SPEED * LANES + w], state[COMMAND * LANES + w] = later, faster, a
        if k == n:
            for w in range(LANES):
                state[TO_T * LANES + w] = state[TO_H * LANES + w]


@njit(cache=True, nogil=True, error_model="numpy")
def _meet_ahead(
    i: int,
    who: int,
    n: int,
    state: FloatArray,
    scene: PackedScene,
    av_front: FloatArray,
    av_v: FloatArray,
    contact: IntArray,
    role: IntArray,
) -> None:
    """Contacts of follower i with whom it follows: when they begin, found anew for the few candidates with one."""
    joined, length = (0, scene.follower_length[i - 1]) if i else (n // 2, scene.length)
    for w in range(LANES):
        if not state[NEAREST * LANES + w] < length:
            continue
        front, speed = av_front[w::LANES].copy(), av_v[w::LANES].copy()
        if scene.from_crossing:
            front[: n // 2], speed[: n // 2] = scene.target_front[: n // 2], scene.target_v[: n // 2]
        for j in range(i + 1):
            v_desire, A, b, B, tau, L_replay = scene.parameters[j]
            x, v = scene.follower_x[j] + scene.follower_length[j] / 2.0, scene.follower_v[j]
            for k in range(len(front)):
                if j == i and joined <= k < contact[w] and front[k] - x < length:
                    contact[w], role[w] = k, who
                L = scene.first_L if (scene.from_crossing and j == 0 and k < n // 2) else L_replay
                ahead, ahead_v = front[k], speed[k]
                front[k], speed[k] = x, v
                _, x, v = lcm_step(x, v, ahead, ahead_v, v_desire, A, b, B, tau, L, scene.hardest, scene.dt)
