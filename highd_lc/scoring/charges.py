"""Losses and safety of a replayed motion under every accounting (equations.md 4, 6 and 12)."""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.core.losses import command_jerk, cumulative_comfort, cumulative_efficiency
from highd_lc.planning.candidates import LossTerms
from highd_lc.planning.replay import Replay, origin_follower_motion
from highd_lc.planning.scene import Motion, PackedScene
from highd_lc.vocab import names
from highd_lc.vocab.settings import LossSettings

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class CumulativeLosses:
    """Normalised losses charged over 0 .. t_k: of the AV, shape (N + 1,), of each follower, shape (p, N + 1)."""

    av_comfort: FloatArray
    av_efficiency: FloatArray
    hv_comfort: FloatArray
    hv_efficiency: FloatArray


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


def charged_samples(accounting: str, n: int, last: int) -> tuple[int, int]:
    """Last charged sample of the AV and of the followers. n: sample of T; last: sample of H."""
    if accounting == names.PAPER:
        return n, n
    return (n, last) if accounting == names.FOLLOWER_HORIZON else (last, last)


def cumulative_losses(replay: Replay, terms: LossTerms, settings: LossSettings, dt: float) -> CumulativeLosses:
    """Cumulative losses of a replayed motion."""
    av_speed = np.hypot(replay.av.vx, replay.av.vy)
    one_sided = terms.one_sided
    jerk = command_jerk(replay.a, dt)
    if replay.entry is not None and replay.entry.hand_over is not None:
        jerk[replay.entry.place - 1, replay.entry.hand_over] = 0.0
    return CumulativeLosses(
        cumulative_comfort(replay.av.jerk, scale=settings.comfort_scale),
        cumulative_efficiency(av_speed, terms.av_ref, scale=settings.efficiency_scale, one_sided=one_sided),
        cumulative_comfort(jerk, scale=settings.comfort_scale),
        follower_efficiency(replay.v, terms, settings),
    )


def follower_efficiency(v: FloatArray, terms: LossTerms, settings: LossSettings) -> FloatArray:
    """Cumulative efficiency of the followers, each against its own reference. v: shape (p, N + 1) [m/s]."""
    rows = [
        cumulative_efficiency(row, ref, scale=settings.efficiency_scale, one_sided=terms.one_sided)
        for row, ref in zip(v, terms.hv_ref, strict=True)
    ]
    return np.stack(rows)


def losses_at(
    losses: CumulativeLosses, accounting: str, terms: LossTerms, *, n: int, dt: float
) -> dict[str, object]:
    """The columns of ``losses`` that follow from the simulated motion, under one accounting."""
    av_last, hv_last = charged_samples(accounting, n, losses.av_comfort.shape[-1] - 1)
    av_comfort, av_efficiency = float(losses.av_comfort[av_last]), float(losses.av_efficiency[av_last])
    hv_comfort = float(terms.weights @ losses.hv_comfort[:, hv_last])
    hv_efficiency = float(terms.weights @ losses.hv_efficiency[:, hv_last])
    each = 0.5 * losses.hv_comfort[:, hv_last] + 0.5 * losses.hv_efficiency[:, hv_last]
    loss_av = 0.5 * av_comfort + 0.5 * av_efficiency
    loss_hv = 0.5 * hv_comfort + 0.5 * hv_efficiency
    return {
        "loss_av": loss_av,
        "av_comfort": av_comfort,
        "av_efficiency": av_efficiency,
        "loss_hv": loss_hv,
        "hv_comfort": hv_comfort,
        "hv_efficiency": hv_efficiency,
        "loss_total": loss_av + loss_hv,
        "loss_av_dt": loss_av * dt,
        "loss_hv_dt": loss_hv * dt,
        "loss_hv_each": each.tolist(),
        "follower_weights": terms.weights.tolist(),
    }


def recorded_loss(
    recorded: tuple[Motion, ...],
    simulated: CumulativeLosses,
    terms: LossTerms,
    settings: LossSettings,
    *,
    last: int,
    dt: float,
) -> dict[str, float | int]:
    """Followers' loss from their recorded motion, and the simulated one over the same samples.

    Each follower counts as long as its track lasts, at most to sample ``last``. Recorded accelerations stand for
    the commands.
    """
    loss, counterpart, samples = 0.0, 0.0, 0
    for i, motion in enumerate(recorded):
        end = min(motion.observed - 1, last)
        if end < 1:
            continue
        jerk = command_jerk(motion.a[: end + 1], dt)
        comfort = cumulative_comfort(jerk, scale=settings.comfort_scale)[-1]
        efficiency = cumulative_efficiency(
            motion.v[: end + 1], terms.hv_ref[i], scale=settings.efficiency_scale, one_sided=terms.one_sided
        )[-1]
        loss += terms.weights[i] * 0.5 * (comfort + efficiency)
        both = simulated.hv_comfort[i, end] + simulated.hv_efficiency[i, end]
        counterpart += terms.weights[i] * 0.5 * both
        samples += end + 1
    if not samples:
        return {"loss_hv_recorded": np.nan, "loss_hv_simulated": np.nan, "recorded_n_samples": 0}
    return {"loss_hv_recorded": loss, "loss_hv_simulated": counterpart, "recorded_n_samples": samples}


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


def safety(lane: list[Pair], last: int) -> dict[str, float]:
    """Smallest gap [m], time headway [s] and time to collision [s], largest DRAC [m/s^2] up to sample ``last``.

    NaN where no sample has one: nobody closes in, or everybody stands. Time headway = (gap + leader length) /
    speed; DRAC = closing speed^2 / (2 gap), only while the gap is positive.
    """
    worst = np.array([np.inf, np.inf, np.inf, -np.inf])
    for pair in lane:
        _extremes(pair.gap, pair.v_follower, pair.v_leader, pair.leader_length, pair.first, last, worst)
    worst[np.isinf(worst)] = np.nan
    return dict(zip(("min_gap_m", "min_time_headway_s", "min_ttc_s", "max_drac"), worst.tolist(), strict=True))


@njit(cache=True, nogil=True)
def _extremes(
    gap: FloatArray,
    v: FloatArray,
    v_leader: FloatArray,
    leader_length: float,
    first: int,
    last: int,
    worst: FloatArray,
) -> None:
    """Take a pair at the samples first .. last into worst: least gap, time headway, TTC; largest DRAC."""
    for k in range(first, last + 1):
        if np.isinf(gap[k]):  # the leader has left the lane, and nobody leads
            continue
        closing = v[k] - v_leader[k]
        worst[0] = min(worst[0], gap[k])
        if v[k] > 0.1:
            worst[1] = min(worst[1], (gap[k] + leader_length) / v[k])
        if closing > 1e-6 and gap[k] > 0.0:
            worst[2] = min(worst[2], gap[k] / closing)
            worst[3] = max(worst[3], closing**2 / (2.0 * gap[k]))


def peak_deceleration(a: FloatArray, last: int) -> float:
    """Strongest braking of any follower [m/s^2, positive] up to sample ``last``; 0 if nobody brakes."""
    return float(max(0.0, -a[:, : last + 1].min()))
