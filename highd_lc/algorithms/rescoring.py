"""Followers' losses of a given motion of the AV under other drivers: drawn LCM parameters, or the IDM."""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.algorithms.candidates import LossTerms
from highd_lc.algorithms.packing import PackedScene
from highd_lc.algorithms.replay import AvMotion
from highd_lc.core.idm import MOTORWAY, IdmParameters, idm_acceleration
from highd_lc.core.lcm import lcm_acceleration
from highd_lc.core.losses import cumulative_comfort, cumulative_efficiency

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Charged:
    """A side's loss charged to T and to H, shape (K,): one value a set of drivers."""

    to_T: FloatArray
    to_H: FloatArray


def lcm_followers(av: AvMotion, scene: PackedScene, terms: LossTerms, parameters: FloatArray) -> Charged:
    """The followers' aggregated loss for each of K sets of LCM parameters, shape (K, p, 6).

    L of the first follower behind the target leader moves with its L behind the AV.
    """
    count = len(parameters)
    out = Charged(np.zeros(count), np.zeros(count))
    first_L = scene.first_L + parameters[:, 0, 5] - scene.parameters[0, 5]
    drivers = np.ascontiguousarray(parameters.transpose(1, 2, 0)).reshape(len(scene.follower_x), -1)
    front, insertion = _front(av, scene)
    _drive_lcm(front, av.vx, insertion, av.n, scene, terms, drivers, first_L, out.to_T, out.to_H)
    return out


def idm_followers(av: AvMotion, scene: PackedScene, terms: LossTerms) -> Charged:
    """The followers' aggregated loss if all of them drive by the IDM on a motorway; shape (1,)."""
    front, insertion = _front(av, scene)
    to_T, to_H = _drive_idm(front, av.vx, insertion, av.n, scene, terms, MOTORWAY)
    return Charged(np.array([to_T]), np.array([to_H]))


def _front(av: AvMotion, scene: PackedScene) -> tuple[FloatArray, int]:
    """The AV's front, and the sample from which on the first follower follows it."""
    return av.x + scene.length / 2.0, av.crossing if scene.from_crossing else 0


def av_charged(av: AvMotion, terms: LossTerms) -> tuple[float, float]:
    """The AV's loss charged to T and to H."""
    speed = np.hypot(av.vx, av.vy)
    # The terms hold 0.5 / N: dividing by their inverse gives the weighted sums.
    comfort = cumulative_comfort(av.jerk, scale=1.0 / terms.comfort)
    scale = 1.0 / terms.efficiency
    loss = comfort + cumulative_efficiency(speed, terms.av_ref, scale=scale, one_sided=terms.one_sided)
    return float(loss[av.n]), float(loss[-1])


@njit(cache=True, nogil=True, fastmath={"contract", "arcp"}, error_model="numpy")
def _drive_lcm(
    av_front: FloatArray,
    av_v: FloatArray,
    insertion: int,
    n: int,
    scene: PackedScene,
    terms: LossTerms,
    drivers: FloatArray,
    first_L: FloatArray,
    to_T: FloatArray,
    to_H: FloatArray,
) -> None:
    """Add the loss of every follower to to_T and to_H (K,), all sets at once; conventions of ``replay.follow``.

    drivers: shape (p, 6 K), parameter by parameter. Sets are innermost, so that LLVM vectorises the LCM.
    """
    K, samples, dt = len(to_T), len(av_v), scene.dt
    front, speed = np.empty(samples * K), np.empty(samples * K)
    for k in range(samples):
        for w in range(k * K, (k + 1) * K):
            front[w] = scene.target_front[k] if k < insertion else av_front[k]
            speed[w] = scene.target_v[k] if k < insertion else av_v[k]
    state = np.empty(5 * K)
    both_sides = 0.0 if terms.one_sided else 1.0
    for i in range(len(scene.follower_x)):
        ref, own = terms.hv_ref[i], drivers[i]
        for w in range(K):
            state[w] = 0.0
            state[K + w] = scene.follower_x[i] + scene.follower_length[i] / 2.0
            state[2 * K + w] = scene.follower_v[i]
            state[3 * K + w] = 0.0
            state[4 * K + w] = own[5 * K + w]
        for k in range(samples):
            if i == 0 and insertion > 0:
                for w in range(K):
                    state[4 * K + w] = first_L[w] if k < insertion else own[5 * K + w]
            counted = terms.comfort / dt if k > 0 else 0.0
            for w in range(K):
                x, v = state[K + w], state[2 * K + w]
                a = lcm_acceleration(
                    v,
                    front[k * K + w] - x,
                    speed[k * K + w],
                    own[w],
                    own[K + w],
                    own[2 * K + w],
                    own[3 * K + w],
                    own[4 * K + w],
                    state[4 * K + w],
                )
                short = ref - v
                state[w] += counted * abs(a - state[3 * K + w]) + terms.efficiency * max(
                    short, -both_sides * short
                )
                front[k * K + w], speed[k * K + w] = x, v
                v = max(0.0, v + a * dt)
                state[K + w], state[2 * K + w], state[3 * K + w] = x + v * dt, v, a
            if k == n:
                for w in range(K):
                    to_T[w] += terms.weights[i] * state[w]
        for w in range(K):
            to_H[w] += terms.weights[i] * state[w]


@njit(cache=True, nogil=True, error_model="numpy")
def _drive_idm(
    av_front: FloatArray,
    av_v: FloatArray,
    insertion: int,
    n: int,
    scene: PackedScene,
    terms: LossTerms,
    driver: IdmParameters,
) -> tuple[float, float]:
    """The followers' loss to T and to H when all are the same IDM driver; conventions of ``replay.follow``."""
    dt, to_T, to_H = scene.dt, 0.0, 0.0
    front, speed = np.empty(len(av_v)), np.empty(len(av_v))
    for k in range(len(av_v)):
        front[k] = scene.target_front[k] if k < insertion else av_front[k]
        speed[k] = scene.target_v[k] if k < insertion else av_v[k]
    for i in range(len(scene.follower_x)):
        x, v = scene.follower_x[i] + scene.follower_length[i] / 2.0, scene.follower_v[i]
        ahead, before, loss = scene.length if i == 0 else scene.follower_length[i - 1], 0.0, 0.0
        for k in range(len(av_v)):
            length = scene.target_length if i == 0 and k < insertion else ahead
            a = idm_acceleration(v, front[k] - length - x, speed[k], driver)
            short = terms.hv_ref[i] - v
            loss += terms.efficiency * (max(short, 0.0) if terms.one_sided else abs(short))
            if k > 0:
                loss += terms.comfort / dt * abs(a - before)
            if k == n:
                to_T += terms.weights[i] * loss
            front[k], speed[k], before = x, v, a
            v = max(0.0, v + a * dt)
            x += v * dt
        to_H += terms.weights[i] * loss
    return to_T, to_H
