"""Losses and safety of a replayed motion under every accounting (equations.md 4, 6 and 12)."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.kernels import kernel
from highd_lc.core.losses import Charge, LossTerms, charge, command_jerk
from highd_lc.core.safety import braking_asked, critical_gap, rss_gaps
from highd_lc.planning.limits import Pair, first_contact, pairs, target_leader_lengths
from highd_lc.planning.planner import Plan, PlanningProblem
from highd_lc.planning.replay import Replay, av_charge
from highd_lc.planning.safety import dracs, time_gaps
from highd_lc.planning.scene import Motion
from highd_lc.vocab import names
from highd_lc.vocab.policy import ACCOUNTINGS
from highd_lc.vocab.safety import SafetySettings

FloatArray = NDArray[np.float64]

_R79_BRAKING = 3.0
"""What R79 asks of an approaching vehicle at most [m/s^2]: where a profile asks nothing, the distance is told."""


@dataclass(frozen=True)
class Charges:
    """What the AV, shape (N + 1,), and each follower, shape (p, N + 1), is charged over 0 .. t_k."""

    av: Charge[FloatArray]
    hv: Charge[FloatArray]

    def of_hv(self, terms: LossTerms, last: int) -> Charge[float]:
        """The followers' charge over the samples 0 .. last, by their weights."""
        return self.hv.upto(last).weighted(terms.weights)


def cumulative_losses(replay: Replay, terms: LossTerms, dt: float) -> Charges:
    """What a replayed motion is charged."""
    jerk = command_jerk(replay.a, dt)
    if replay.entry is not None and replay.entry.hand_over is not None:
        jerk[replay.entry.place - 1, replay.entry.hand_over] = 0.0
    return Charges(av_charge(replay.av, terms), charge(replay.v, jerk, terms.hv_ref[:, None], terms))


def losses_at(losses: Charges, accounting: str, terms: LossTerms, *, n: int, dt: float) -> dict[str, object]:
    """The columns of ``losses`` that follow from the simulated motion, under one accounting."""
    av_last, hv_last = ACCOUNTINGS[accounting].charged(n, losses.av.comfort.shape[-1] - 1)
    av, hv = losses.av.upto(av_last), losses.of_hv(terms, hv_last)
    loss_av, loss_hv = float(av.loss), hv.loss
    return {
        "loss_av": loss_av,
        "av_comfort": float(av.comfort),
        "av_efficiency": float(av.efficiency),
        "loss_hv": loss_hv,
        "hv_comfort": hv.comfort,
        "hv_efficiency": hv.efficiency,
        "loss_total": loss_av + loss_hv,
        "loss_av_dt": loss_av * dt,
        "loss_hv_dt": loss_hv * dt,
        "loss_hv_each": losses.hv.upto(hv_last).loss.tolist(),
        "follower_weights": terms.weights.tolist(),
    }


def recorded_loss(
    recorded: tuple[Motion, ...], simulated: Charges, terms: LossTerms, *, last: int, dt: float
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
        seen = slice(0, end + 1)
        own = charge(motion.v[seen], command_jerk(motion.a[seen], dt), terms.hv_ref[i], terms).upto(end)
        loss += terms.weights[i] * own.loss
        counterpart += terms.weights[i] * simulated.hv.upto(end).loss[i]
        samples += end + 1
    if not samples:
        return {"loss_hv_recorded": np.nan, "loss_hv_simulated": np.nan, "recorded_n_samples": 0}
    return {"loss_hv_recorded": loss, "loss_hv_simulated": counterpart, "recorded_n_samples": samples}


def safety(lane: list[Pair], last: int) -> dict[str, float]:
    """Smallest gap [m], time headway [s] and time to collision [s], largest DRAC [m/s^2] up to sample ``last``.

    NaN where no sample has one: nobody closes in, or everybody stands. Time headway = (gap + leader length) /
    speed; DRAC = closing speed^2 / (2 gap), only while the gap is positive.
    """
    worst = np.array([np.inf, np.inf, np.inf, -np.inf])
    for pair in lane:
        lengths = np.full(pair.gap.shape, pair.leader_length)
        _extremes(pair.gap, pair.v_follower, pair.v_leader, lengths, pair.first, last, worst)
    worst[np.isinf(worst)] = np.nan
    return dict(zip(("min_gap_m", "min_time_headway_s", "min_ttc_s", "max_drac"), worst.tolist(), strict=True))


@kernel()
def _extremes(
    gap: FloatArray,
    v: FloatArray,
    v_leader: FloatArray,
    leader_length: FloatArray,
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
            worst[1] = min(worst[1], (gap[k] + leader_length[k]) / v[k])
        if closing > 1e-6 and gap[k] > 0.0:
            worst[2] = min(worst[2], gap[k] / closing)
            worst[3] = max(worst[3], closing**2 / (2.0 * gap[k]))


def exposure(lane: list[Pair], last: int, threshold: float, *, dt: float) -> dict[str, float]:
    """Time exposed and time integrated time to collision up to sample ``last`` (Minderhoud and Bovy 2001).

    threshold: TTC below which a sample counts [s]. TET [s] is the time in which some pair counts, TIT [s^2] the
    integral of threshold - TTC over it, of all pairs.
    """
    below, integral = np.zeros(last + 1, np.bool_), 0.0
    for pair in lane:
        used = slice(pair.first, last + 1)
        gap, closing = pair.gap[used], (pair.v_follower - pair.v_leader)[used]
        near = (closing > 1e-6) & (gap > 0.0) & (gap < threshold * closing)
        below[used] |= near
        integral += float((threshold - gap[near] / closing[near]).sum()) * dt
    return {"tet_s": float(below.sum()) * dt, "tit_s2": integral}


def lane_change_safety(
    ahead: Pair | None, behind: Pair | None, settings: SafetySettings, start: int, dt: float
) -> dict[str, float]:
    """Safety of a lane change from the crossing to H, and of its start (sample ``start``): columns of ``losses``.

    ahead: the AV behind its new leader, behind: its new follower behind the AV; None: there is none.
    """
    row: dict[str, float] = {}
    for where, pair in (("ahead", ahead), ("behind", behind)):
        if pair is not None and len(pair.gap[pair.first :]) and np.isfinite(pair.gap[pair.first]):
            row |= {
                f"min_time_gap_{where}_s": float(time_gaps(pair).min()),
                f"max_drac_{where}": float(dracs(pair).max()),
                f"rss_margin_{where}_m": float(_beyond_rss(pair, settings).min()),
            }
    gaps = [value for name, value in row.items() if name.startswith("min_time_gap")]
    if gaps:
        row["time_gap_shortfall_s"] = max(settings.time_gap_target_s - min(gaps), 0.0)
    encroached = [
        one for one in (_post_encroachment(ahead, dt), _post_encroachment(behind, dt)) if one is not None
    ]
    return row | ({"pet_s": min(encroached)} if encroached else {}) | _at_start(behind, settings, start)


def _at_start(behind: Pair | None, settings: SafetySettings, start: int) -> dict[str, float]:
    """What UN R79 says of the gap to the first follower when the manoeuvre starts."""
    if behind is None:
        return {}
    gap, v_rear, v = (float(values[start]) for values in (behind.gap, behind.v_follower, behind.v_leader))
    delay, left = settings.braking_delay_s, settings.braking_gap_s
    critical = critical_gap(v_rear, v, settings.braking or _R79_BRAKING, delay, left)
    asked = braking_asked(gap, v_rear, v, delay, left)
    return {
        "r79_gap_m": critical,
        "r79_margin_m": gap - critical,
        "braking_asked": asked if np.isfinite(asked) else np.nan,
    }


def _beyond_rss(pair: Pair, settings: SafetySettings) -> FloatArray:
    """Gap of a pair beyond the distance of responsibility-sensitive safety, from its first sample on [m]."""
    used = slice(pair.first, None)
    with_accelerations = (settings.rss_response_s, settings.rss_acceleration)
    braking = (settings.rss_braking_min, settings.rss_braking_max)
    safe = rss_gaps(pair.v_follower[used], pair.v_leader[used], *with_accelerations, *braking)
    return np.asarray(pair.gap[used] - safe)


def _post_encroachment(pair: Pair | None, dt: float) -> float | None:
    """Time [s] between the leader's rear leaving a place and the follower's front reaching it, at the crossing.

    The place is where the AV is when it crosses: its front behind a leader, its rear ahead of a follower. None
    where one of the two is there out of the time known.
    """
    if pair is None or pair.first >= len(pair.front):
        return None
    k, rear = pair.first, pair.front + pair.gap
    own = pair.front if pair.follower == names.EGO else rear
    other = rear if pair.follower == names.EGO else pair.front
    place = own[k]
    if not other[0] <= place <= other[-1] or not np.isfinite(other).all():
        return None
    when = float(np.interp(place, other, np.arange(len(other))))
    return abs(when - k) * dt if (when <= k) == (pair.follower == names.EGO) else 0.0


def peak_deceleration(a: FloatArray, last: int) -> float:
    """Strongest braking of any follower [m/s^2, positive] up to sample ``last``; 0 if nobody brakes."""
    return float(max(0.0, -a[:, : last + 1].min()))


@dataclass(frozen=True)
class Scores:
    """Losses and safety of an event's replays, each computed once: accountings share them.

    unchanged: the plan without a lane change, beside which the followers' loss is an increment.
    """

    problem: PlanningProblem
    unchanged: Plan
    found: dict[Replay, Charges] = field(default_factory=dict)
    safe: dict[tuple[Replay, int], dict[str, float]] = field(default_factory=dict)
    kept_lane: dict[int, float] = field(default_factory=dict)
    seen: dict[Replay, dict[str, Any]] = field(default_factory=dict)

    def once(self, replay: Replay, make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """Columns that no accounting changes, made when first asked for."""
        if replay not in self.seen:
            self.seen[replay] = make()
        return self.seen[replay]

    def losses(self, replay: Replay) -> Charges:
        """What a replay is charged."""
        if replay not in self.found:
            self.found[replay] = cumulative_losses(replay, self.problem.terms, self.problem.scene.dt)
        return self.found[replay]

    def safety(self, plan: Plan, last: int) -> dict[str, float]:
        """Safety of a plan's replay up to sample ``last``."""
        assert plan.replay is not None
        key = plan.replay, last
        if key not in self.safe:
            joins, lengths = plan.policy != names.NO_LANE_CHANGE, target_leader_lengths(self.problem.scene)
            lane = pairs(plan.replay, self.problem.packed, joins=joins, lengths=lengths)
            threshold, dt = self.problem.settings.safety.ttc_s, self.problem.scene.dt
            self.safe[key] = safety(lane, last) | exposure(lane, last, threshold, dt=dt)
        return self.safe[key]

    def hv_unchanged(self, last: int) -> float:
        """The followers' loss without a lane change, charged up to sample ``last``; NaN after a contact."""
        if last not in self.kept_lane:
            replay, origin = self.unchanged.replay, self.problem.scene.origin_leader
            assert replay is not None, "it needs no plan"
            met = first_contact(replay, self.problem.packed, joins=False, last=last, origin_leader=origin)
            self.kept_lane[last] = np.nan if met else self.losses(replay).of_hv(self.problem.terms, last).loss
        return self.kept_lane[last]
