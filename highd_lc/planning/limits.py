"""Limits of speed, acceleration and jerk over a whole manoeuvre, by their exact extrema (paper, equation 8).

Below them: pairs of vehicles that follow one another on a lane, and the contacts between them (equations.md 5.4).
"""

import math
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.core.kernels import kernel
from highd_lc.core.quintic import (
    AT_REST,
    END_JY,
    PEAK_AY,
    Quintic,
    StartState,
    forward_extrema,
    q_curvature,
    q_rate,
    speed_extrema,
    z_curvature,
    z_rate,
)
from highd_lc.core.under_way import axis, axis_extrema, sharpest_turns, speed_range
from highd_lc.planning.replay import Replay, origin_follower_motion
from highd_lc.planning.scene import Motion, PackedScene, Scene
from highd_lc.vocab import names
from highd_lc.vocab.sections import ConstraintSettings
from highd_lc.vocab.settings import ValidateSettings

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

CONSTRAINTS: Final = ("jerk_y", "acceleration_y", "speed", "acceleration_x", "jerk_x", "curvature", "yaw_rate")
"""Dynamic constraints in the order in which they are tested; a violation is numbered 1 + its index."""
INSERTION: Final = "insertion_gap"
TIME_GAP_AHEAD, DRAC_AHEAD, TIME_GAP_BEHIND, DRAC_BEHIND, SPEED_AFTER_T = (
    "time_gap_ahead", "drac_ahead", "time_gap_behind", "drac_behind", "speed_after_T",
)  # fmt: skip
FOLLOWER_GAP: Final = "follower_gap"
SAFETY: Final = (
    INSERTION, TIME_GAP_AHEAD, DRAC_AHEAD, SPEED_AFTER_T, TIME_GAP_BEHIND, DRAC_BEHIND, FOLLOWER_GAP,
)  # fmt: skip
"""Constraints of a safety profile; one that fails is numbered 1 + its index (see ``contacts``)."""
# Rounding of T = n dt must not decide whether a plan on a limit passes.
_SLACK = 1e-9
# Far above the rounding of an extremum: a speed below the limit by this much needs none.
_CLEAR = 1e-6


class Limits(NamedTuple):
    """Lowest and highest speed [m/s], largest |acceleration| [m/s^2] and |jerk| [m/s^3].

    Of a safety profile alone, else infinite: the largest |a_y| [m/s^2], |curvature| [1/m] and |yaw rate| [rad/s].
    """

    v_min: float
    v_max: float
    acceleration: float
    jerk: float
    lateral: float = math.inf
    curvature: float = math.inf
    yaw_rate: float = math.inf


def limits(v0: float, settings: ConstraintSettings) -> Limits:
    """The limits of an event: v_min is at most 0.8 v0 (equations.md 5). v0 in m/s."""
    return Limits(min(settings.v_min, 0.8 * v0), settings.v_max, settings.acceleration, settings.jerk)


def limits_of(v0: float, settings: ValidateSettings, wheelbase: float) -> Limits:
    """The limits of an event under the settings' safety profile. v0 in m/s; wheelbase of the AV [m]."""
    found, safety = limits(v0, settings.constraints), settings.safety
    if not safety.asked:
        return found
    return found._replace(
        lateral=safety.lateral_acceleration or math.inf,
        curvature=math.tan(safety.steering) / wheelbase,
        yaw_rate=safety.yaw_rate,
    )


@kernel(error_model="numpy")
def violation(T: float, delta: float, change: float, v0: float, D: float, limit: Limits) -> int:
    """The first constraint that a plan violates: 0 none, else 1 + index in ``CONSTRAINTS``.

    T [s], delta = x_final - v0 T [m], change = v_end - v0 [m/s], v0 [m/s], D [m].
    """
    if END_JY * abs(D) / T**3 > limit.jerk + _SLACK:
        return 1
    if PEAK_AY * abs(D) / T**2 > min(limit.acceleration, limit.lateral) + _SLACK:
        return 2
    alpha, beta = delta / (T * T), change / T
    v_low, v_high, a_high, j_high = forward_extrema(alpha, beta, v0, T)
    if v_low < 0.0:
        return 3
    # hypot(xdot, ydot) lies between xdot and hypot(max xdot, max ydot): the exact extremum decides only rarely.
    if v_low < limit.v_min - _SLACK or np.hypot(v_high, 1.875 * D / T) > limit.v_max + _SLACK:
        if v_high > limit.v_max + _SLACK or _slowest_known(T, delta, change, v0, D) < limit.v_min - _CLEAR:
            return 3
        low, high = speed_extrema(alpha, beta, v0, D, T)
        if low < limit.v_min - _SLACK or high > limit.v_max + _SLACK:
            return 3
    if a_high > limit.acceleration + _SLACK:
        return 4
    if j_high > limit.jerk + _SLACK:
        return 5
    # The acceleration bounds both turns: a sample of the motion decides only rarely.
    bound = math.hypot(a_high, PEAK_AY * D / (T * T))
    if bound > limit.curvature * v_low * v_low or bound > limit.yaw_rate * v_low:
        curvature, yaw_rate = turns(alpha, beta, v0, D, T)
        if curvature > limit.curvature + _SLACK:
            return 6
        if yaw_rate > limit.yaw_rate + _SLACK:
            return 7
    return 0


@kernel(error_model="numpy")
def started_violation(
    T: float, delta: float, change: float, v0: float, D: float, start: StartState, limit: Limits
) -> int:
    """``violation`` of a plan that starts in that state."""
    if start.ax == 0.0 and start.y == 0.0 and start.vy == 0.0 and start.ay == 0.0:
        return violation(T, delta, change, v0, D, limit)
    y = axis(start.y, start.vy, start.ay, D, 0.0, T)
    _, vy_high, ay_high, jy_high = axis_extrema(y, T)
    if jy_high > limit.jerk + _SLACK:
        return 1
    if ay_high > min(limit.acceleration, limit.lateral) + _SLACK:
        return 2
    x = axis(0.0, v0, start.ax, v0 * T + delta, v0 + change, T)
    v_low, v_high, a_high, j_high = axis_extrema(x, T)
    if v_low < 0.0:
        return 3
    if v_low < limit.v_min - _SLACK or v_high + abs(vy_high) > limit.v_max - _CLEAR:
        low, high = speed_range(x, y, T)
        if low < limit.v_min - _SLACK or high > limit.v_max + _SLACK:
            return 3
    if a_high > limit.acceleration + _SLACK:
        return 4
    if j_high > limit.jerk + _SLACK:
        return 5
    bound = math.hypot(a_high, ay_high)
    if bound > limit.curvature * v_low * v_low or bound > limit.yaw_rate * v_low:
        curvature, yaw_rate = sharpest_turns(x, y, T)
        if curvature > limit.curvature + _SLACK:
            return 6
        if yaw_rate > limit.yaw_rate + _SLACK:
            return 7
    return 0


@kernel(error_model="numpy")
def turns(alpha: float, beta: float, v0: float, D: float, T: float) -> tuple[float, float]:
    """Largest |curvature| [1/m] and |yaw rate| [rad/s] of a manoeuvre, at its ends and 63 moments between."""
    gamma, curvature, yaw_rate = D / (T * T), 0.0, 0.0
    for i in range(65):
        u = i / 64.0
        vx = v0 + T * (alpha * z_rate(u) + beta * q_rate(u))
        vy = T * gamma * z_rate(u)
        ax, ay = alpha * z_curvature(u) + beta * q_curvature(u), gamma * z_curvature(u)
        turned = abs(vx * ay - vy * ax)
        square = vx * vx + vy * vy
        if turned > 0.0:
            yaw_rate = max(yaw_rate, turned / square if square > 0.0 else np.inf)
            curvature = max(curvature, turned / (square * math.sqrt(square)) if square > 0.0 else np.inf)
    return curvature, yaw_rate


@njit(inline="always")
def _slowest_known(T: float, delta: float, change: float, v0: float, D: float) -> float:
    """The lower of the speeds halfway (see ``forward_interval``) and at the end [m/s]; an extremum is dear."""
    halfway = math.hypot(v0 + 1.875 * delta / T - 0.4375 * change, 1.875 * D / T)
    return min(halfway, abs(v0 + change))


def violations(
    T: FloatArray,
    delta: FloatArray,
    change: FloatArray,
    v0: float,
    D: float,
    limit: Limits,
    start: StartState = AT_REST,
) -> IntArray:
    """``started_violation`` of many plans. T: shape (rows,); delta, change: shape (rows, candidates)."""
    codes = np.empty(delta.shape, np.int64)
    _fill_violations(T, delta, change, v0, D, start, limit, codes)
    return codes


@kernel()
def _fill_violations(
    T: FloatArray,
    delta: FloatArray,
    change: FloatArray,
    v0: float,
    D: float,
    start: StartState,
    limit: Limits,
    codes: IntArray,
) -> None:
    for row in range(delta.shape[0]):
        for w in range(delta.shape[1]):
            codes[row, w] = started_violation(T[row], delta[row, w], change[row, w], v0, D, start, limit)


def margins(plan: Quintic, limit: Limits) -> dict[str, float]:
    """How far a plan stays inside each dynamic limit, in the limit's unit; negative = violated."""
    if plan.start != AT_REST:
        return _started_margins(plan, limit)
    T, delta, change = plan.T, plan.x_final - plan.v0 * plan.T, plan.v_end - plan.v0
    alpha, beta = delta / T**2, change / T
    _, _, a_high, j_high = forward_extrema(alpha, beta, plan.v0, T)
    low, high = speed_extrema(alpha, beta, plan.v0, plan.D, T)
    found = {
        "speed": min(low - limit.v_min, limit.v_max - high),
        "acceleration_x": limit.acceleration - a_high,
        "acceleration_y": min(limit.acceleration, limit.lateral) - PEAK_AY * abs(plan.D) / T**2,
        "jerk_x": limit.jerk - j_high,
        "jerk_y": limit.jerk - END_JY * abs(plan.D) / T**3,
    }
    if math.isinf(limit.curvature):
        return found
    curvature, yaw_rate = turns(alpha, beta, plan.v0, plan.D, T)
    return found | {"curvature": limit.curvature - curvature, "yaw_rate": limit.yaw_rate - yaw_rate}


def _started_margins(plan: Quintic, limit: Limits) -> dict[str, float]:
    start, T = plan.start, plan.T
    x = axis(0.0, plan.v0, start.ax, plan.x_final, plan.v_end, T)
    y = axis(start.y, start.vy, start.ay, plan.D, 0.0, T)
    (_, _, ax_high, jx_high), (_, _, ay_high, jy_high) = axis_extrema(x, T), axis_extrema(y, T)
    low, high = speed_range(x, y, T)
    curvature, yaw_rate = sharpest_turns(x, y, T)
    found = {
        "speed": min(low - limit.v_min, limit.v_max - high),
        "acceleration_x": limit.acceleration - ax_high,
        "acceleration_y": min(limit.acceleration, limit.lateral) - ay_high,
        "jerk_x": limit.jerk - jx_high,
        "jerk_y": limit.jerk - jy_high,
        "curvature": limit.curvature - curvature,
        "yaw_rate": limit.yaw_rate - yaw_rate,
    }
    return {name: margin for name, margin in found.items() if math.isfinite(margin)}


def unchanged_margins(v0: float, D: float, *, T: float, limit: Limits) -> dict[str, float]:
    """Margins of a lane change of T [s] that keeps the speed v0 [m/s]. D: across [m]."""
    return margins(Quintic(v0=v0, D=D, T=T, x_final=v0 * T, v_end=v0), limit)


def forward_interval(
    T: FloatArray, change: FloatArray, v0: float, limit: Limits, ax: float = 0.0
) -> tuple[FloatArray, FloatArray]:
    """Interval of delta [m] outside which a plan violates the jerk at its ends or the forward speed halfway.

    T, change: broadcastable shapes; ax: acceleration at the start [m/s^2].
    jx(0) = (60 alpha - 24 beta - 9 ax) / T,
    jx(1) = (60 alpha - 36 beta - 3 ax) / T, xdot(1/2) = v0 + 1.875 delta / T - 0.4375 change - ax T / 32.
    """
    beta, bound = change / T, limit.jerk * T
    first, last = 24.0 * beta + 9.0 * ax, 36.0 * beta + 3.0 * ax
    low = (np.maximum(first, last) - bound) * T**2 / 60.0
    high = (np.minimum(first, last) + bound) * T**2 / 60.0
    middle = 0.4375 * change - v0 + ax * T / 32.0
    return (
        np.maximum(low, (limit.v_min + middle) * T / 1.875),
        np.minimum(high, (limit.v_max + middle) * T / 1.875),
    )


@dataclass(frozen=True)
class Pair:
    """A follower and its leader on the target lane: gap [m], speeds [m/s], each of shape (N + 1,).

    leader_length [m]: shape (N + 1,) where leaders of several lengths follow one another. The samples before
    ``first`` do not count: the AV is still on its own lane. follower, leader: their roles.
    """

    gap: FloatArray
    v_follower: FloatArray
    v_leader: FloatArray
    leader_length: float | FloatArray
    first: int
    follower: str
    leader: str
    front: FloatArray

    def contact(self, first: int, last: int) -> int | None:
        """The first of the samples first .. last at which the follower's front is past the leader's rear."""
        through = np.flatnonzero(self.gap[first : last + 1] < 0.0)
        return first + int(through[0]) if len(through) else None


def pairs(replay: Replay, scene: PackedScene, *, joins: bool, lengths: FloatArray | None = None) -> list[Pair]:
    """Pairs on the target lane: AV in its gap, behind the target leader if not told otherwise, and the followers.

    joins: whether the AV enters the lane (at its crossing); otherwise the first follower stays behind the leader.
    lengths [m]: of whoever is target leader at each sample, shape (N + 1,); None = of the first one all the time.
    """
    lane, place = _lane(replay, scene)
    if joins:
        lane.insert(place, (names.EGO, replay.av.x + scene.length / 2.0, replay.av.vx, scene.length))
    firsts = [0] * (len(lane) + 1)
    if joins:
        firsts[place] = firsts[place + 1] = replay.av.crossing
    found = _pairs(lane, firsts)
    if lengths is None:
        return found
    return [replace(pair, leader_length=lengths) if pair.leader == names.TARGET_LEADER else pair for pair in found]


def target_leader_lengths(scene: Scene) -> FloatArray:
    """Length of who leads the target lane at each sample [m], shape (N + 1,); NaN where nobody does."""
    leader = scene.target_leader
    lengths = np.full(scene.samples, leader.length if leader is not None else np.nan)
    for later in scene.next_leaders:
        lengths[later.since :] = later.motion.length if later.motion is not None else np.nan
    return lengths


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
        Pair(ahead[1] - behind[1] - ahead[3], behind[2], ahead[2], ahead[3], first, behind[0], ahead[0], behind[1])
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
    found = contacts(replay, scene, joins=joins, last=last, origin_leader=origin_leader)
    return min(found)[1] if found else ""


def contacts(
    replay: Replay, scene: PackedScene, *, joins: bool, last: int, origin_leader: Motion | None = None
) -> list[tuple[int, str]]:
    """The first sample of each contact of a replay, and who drives through whom (see ``first_contact``)."""
    lane, _ = _lane(replay, scene)
    before = min(replay.av.crossing - 1, last) if joins else last
    met = [(pair.contact(pair.first, last), pair) for pair in pairs(replay, scene, joins=joins)]
    met += [(pair.contact(0, before), pair) for pair in _pairs(lane, [0] * len(lane))]
    if not joins:
        own = _origin_lane(replay, scene, origin_leader)
        met += [(pair.contact(0, last), pair) for pair in _pairs(own, [0] * len(own))]
    return [(sample, names.through(pair.follower, pair.leader)) for sample, pair in met if sample is not None]


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
