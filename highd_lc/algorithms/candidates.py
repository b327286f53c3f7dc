"""Losses and first contact of many candidate plans at once: the planner's hot kernel.

One row holds candidates of the same duration. They are simulated in tiles with the candidate as the innermost
axis, so that LLVM vectorises the LCM. Everything that all candidates of a row share (the lateral motion, hence
the lateral separation from everybody) is computed once per sample.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.algorithms.contacts import (
    LANES,
    NO_CONTACT,
    lateral_motion,
    meet_follower,
    meet_leaders,
    meet_origin_follower,
)
from highd_lc.algorithms.packing import PackedScene
from highd_lc.core.lcm import lcm_acceleration
from highd_lc.core.quintic import q_rate, q_shape, q_third, z_rate, z_shape, z_third
from highd_lc.core.unaliased import UNALIASED
from highd_lc.vocab.scene import Scene
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

    contact: first sample at which ellipses overlap (NO_CONTACT if none); role: index of that obstacle.
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
    samples = len(scene.target_v)
    av_front, av_v = np.empty(samples * LANES), np.empty(samples * LANES)
    ahead_front, ahead_v = np.empty(samples * LANES), np.empty(samples * LANES)
    state = np.empty(8 * LANES)
    y, vy, reach = np.empty(samples), np.empty(samples), np.empty(samples)
    contact, role = np.empty(LANES, np.int64), np.empty(LANES, np.int64)
    for row in range(len(n)):
        width = delta.shape[1]
        for first in range(0, width, LANES):
            used = min(LANES, width - first)
            for w in range(LANES):
                at = first + min(w, used - 1)
                state[w], state[LANES + w] = delta[row, at], change[row, at]
                contact[w], role[w] = NO_CONTACT, -1
            _drive_av(n[row], state, scene, terms, av_front, av_v)
            for w in range(used):
                out.av_T[row, first + w], out.av_H[row, first + w] = state[2 * LANES + w], state[3 * LANES + w]
                out.hv_T[row, first + w], out.hv_H[row, first + w] = 0.0, 0.0
            lateral_motion(n[row], state, scene, y, vy, reach)
            meet_leaders(n[row], scene, av_front, av_v, y, vy, reach, contact, role)
            ahead_front[:], ahead_v[:] = av_front, av_v
            if scene.from_crossing:
                for k in range(n[row] // 2):
                    ahead_front[k * LANES : (k + 1) * LANES] = scene.target_front[k]
                    ahead_v[k * LANES : (k + 1) * LANES] = scene.target_v[k]
            for i in range(len(scene.follower_x)):
                _drive_follower(i, n[row], state, scene, terms, ahead_front, ahead_v)
                for w in range(used):
                    out.hv_T[row, first + w] += terms.weights[i] * state[2 * LANES + w]
                    out.hv_H[row, first + w] += terms.weights[i] * state[3 * LANES + w]
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
    """Plan to n, then the drive after T. state rows: 0 delta, 1 change; out: 2 loss to T, 3 loss to H."""
    dt, v0, half = scene.dt, scene.v0, scene.length / 2.0
    T = n * dt
    v_desire, A, b, B, tau, L = scene.av_parameters
    comfort, efficiency, ref = terms.comfort, terms.efficiency, terms.av_ref
    both_sides = 0.0 if terms.one_sided else 1.0
    for w in range(LANES):
        state[2 * LANES + w] = 0.0
    for k in range(n + 1):
        u = k / n
        base, z, q = half + v0 * k * dt, z_shape(u), T * q_shape(u)
        dz, dq = z_rate(u) / T, q_rate(u)
        j_z, j_q = z_third(u) / (T * T * T), q_third(u) / (T * T)
        vy, jy = scene.D * dz, abs(scene.D * j_z)
        for w in range(LANES):
            v = v0 + state[w] * dz + state[LANES + w] * dq
            front[k * LANES + w] = base + state[w] * z + state[LANES + w] * q
            speed[k * LANES + w] = v
            short = ref - np.sqrt(v * v + vy * vy)
            jerk = abs(state[w] * j_z + state[LANES + w] * j_q) + jy
            state[2 * LANES + w] += comfort * jerk + efficiency * max(short, -both_sides * short)
    after = 1.0 if scene.after_lcm else 0.0
    # A plan that ends at H has no drive after T, hence no step onto it.
    handover = comfort / dt if scene.counts_handover and n + 1 < len(scene.target_v) else 0.0
    for w in range(LANES):
        state[4 * LANES + w] = front[n * LANES + w]
        state[5 * LANES + w] = speed[n * LANES + w]
        spacing = scene.target_front[n] - front[n * LANES + w]
        state[6 * LANES + w] = after * lcm_acceleration(
            speed[n * LANES + w], spacing, scene.target_v[n], v_desire, A, b, B, tau, L
        )
        state[3 * LANES + w] = state[2 * LANES + w] + handover * abs(state[6 * LANES + w])
    for k in range(n + 1, len(scene.target_v)):
        target, target_v = scene.target_front[k], scene.target_v[k]
        for w in range(LANES):
            v = max(0.0, state[5 * LANES + w] + state[6 * LANES + w] * dt)
            x = state[4 * LANES + w] + v * dt
            a = after * lcm_acceleration(v, target - x, target_v, v_desire, A, b, B, tau, L)
            short = ref - v
            state[3 * LANES + w] += comfort * (abs(a - state[6 * LANES + w]) / dt) + efficiency * max(
                short, -both_sides * short
            )
            state[4 * LANES + w], state[5 * LANES + w], state[6 * LANES + w] = x, v, a
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
    """Follower i behind the motion in front and speed, which its own replaces. Losses: state rows 2 (T), 3 (H)."""
    dt = scene.dt
    v_desire, A, b, B, tau, L_replay = scene.parameters[i]
    comfort, efficiency, ref = terms.comfort, terms.efficiency, terms.hv_ref[i]
    both_sides = 0.0 if terms.one_sided else 1.0
    insertion = n // 2 if (scene.from_crossing and i == 0) else 0
    for w in range(LANES):
        state[3 * LANES + w] = 0.0
        state[4 * LANES + w] = scene.follower_x[i] + scene.follower_length[i] / 2.0
        state[5 * LANES + w] = scene.follower_v[i]
        state[6 * LANES + w] = 0.0
    for k in range(len(scene.target_v)):
        L = scene.first_L if k < insertion else L_replay
        counted = comfort / dt if k > 0 else 0.0
        for w in range(LANES):
            x, v = state[4 * LANES + w], state[5 * LANES + w]
            a = lcm_acceleration(v, front[k * LANES + w] - x, speed[k * LANES + w], v_desire, A, b, B, tau, L)
            short = ref - v
            state[3 * LANES + w] += counted * abs(a - state[6 * LANES + w]) + efficiency * max(
                short, -both_sides * short
            )
            front[k * LANES + w], speed[k * LANES + w] = x, v
            v = max(0.0, v + a * dt)
            state[4 * LANES + w], state[5 * LANES + w], state[6 * LANES + w] = x + v * dt, v, a
        if k == n:
            for w in range(LANES):
                state[2 * LANES + w] = state[3 * LANES + w]
