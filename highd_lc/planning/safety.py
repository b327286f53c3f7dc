"""What a safety profile asks of a plan from its crossing to H (equations.md 5.8).

Who breaks it among many candidates, and how far one motion stays inside it and when it comes nearest.
"""

from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.core.kernels import UNALIASED, kernel
from highd_lc.core.safety import critical_gap
from highd_lc.planning.contacts import JUMP, NEAREST, WIDTH
from highd_lc.planning.limits import (
    CONSTRAINTS,
    DRAC_AHEAD,
    DRAC_BEHIND,
    FOLLOWER_GAP,
    INSERTION,
    SPEED_AFTER_T,
    TIME_GAP_AHEAD,
    TIME_GAP_BEHIND,
    Limits,
    Pair,
    pairs,
)
from highd_lc.planning.replay import PlannedMotion, Replay
from highd_lc.planning.scene import Human, PackedScene, SafetyLimits
from highd_lc.vocab import names

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

DURATION = "duration"
"""What forbids a lane change of which no duration is allowed."""
ACCELERATION_AFTER_T = "acceleration_after_T"
JERK_AFTER_T = "jerk_after_T"
"""What the drive after T keeps by itself: its margins are told beside those of ``limits.SAFETY``."""
_STANDING = 0.1
"""Below this speed [m/s] a time gap says nothing: its margin is that of this speed."""
_NO_GAP = 0.01
_OVERSHOOT = 2.0
"""By how much an AV whose jerk is limited may get faster than it desires [m/s]."""


@njit(inline="always")
def _asked_gap(v: float, closing: float, time_gap: float, brake: float) -> float:
    """The gap [m] that time gap and DRAC ask for; brake: 1 / (2 DRAC) [s^2/m]."""
    towards = max(closing, 0.0)
    return max(time_gap * v, brake * towards * towards)


@njit(inline="always")
def _which(gap: float, v: float, time_gap: float, of_gap: int) -> int:
    """The constraint that a gap below the one asked for breaks: its time gap, else the DRAC numbered next."""
    return of_gap if gap < time_gap * v else of_gap + 1


@kernel(error_model="numpy", **UNALIASED)
def keep_ahead(
    n: int,
    crossing: int,
    state: FloatArray,
    scene: PackedScene,
    av_front: FloatArray,
    av_v: FloatArray,
    unsafe: IntArray,
) -> None:
    """Where the AV, from its crossing to H, comes too near to the leader of the target lane or gets too fast.

    Marks ``unsafe`` of those not marked, by 1 + index in ``limits.SAFETY``.
    """
    asked, samples = scene.safety, len(scene.target_v)
    time_gap, brake, length = asked.time_gap, 0.5 / asked.drac, scene.target_length
    for w in range(WIDTH):
        state[JUMP * WIDTH + w] = np.inf
    for k in range(crossing, samples):
        rear, target_v = scene.target_front[k] - length, scene.target_v[k]
        for w in range(WIDTH):
            v = av_v[k * WIDTH + w]
            gap = rear - av_front[k * WIDTH + w] - _asked_gap(v, v - target_v, time_gap, brake)
            state[JUMP * WIDTH + w] = min(state[JUMP * WIDTH + w], gap)
    for w in range(WIDTH):
        if state[JUMP * WIDTH + w] < 0.0 and unsafe[w] == 0:
            for k in range(crossing, samples):
                v, gap = av_v[k * WIDTH + w], scene.target_front[k] - length - av_front[k * WIDTH + w]
                if gap < _asked_gap(v, v - scene.target_v[k], time_gap, brake):
                    unsafe[w] = _which(gap, v, time_gap, 2)
                    break
    # Nobody drives faster after T than he desires, but for what the limit of the jerk lets him overshoot.
    if asked.v_max < scene.av_parameters[0] + _OVERSHOOT:
        for w in range(WIDTH):
            for k in range(n + 1, samples):
                if av_v[k * WIDTH + w] > asked.v_max and unsafe[w] == 0:
                    unsafe[w] = 4


@kernel(error_model="numpy", **UNALIASED)
def keep_behind(
    crossing: int,
    state: FloatArray,
    scene: PackedScene,
    av_front: FloatArray,
    av_v: FloatArray,
    front: FloatArray,
    speed: FloatArray,
    unsafe: IntArray,
) -> None:
    """Where the first follower, of the given fronts and speeds, comes too near to the AV (see ``keep_ahead``)."""
    asked, samples = scene.safety, len(scene.target_v)
    time_gap, brake, length = asked.time_gap, 0.5 / asked.drac, scene.length
    for w in range(WIDTH):
        state[JUMP * WIDTH + w] = np.inf
    for k in range(crossing, samples):
        for w in range(WIDTH):
            at = k * WIDTH + w
            v = speed[at]
            gap = av_front[at] - length - front[at] - _asked_gap(v, v - av_v[at], time_gap, brake)
            state[JUMP * WIDTH + w] = min(state[JUMP * WIDTH + w], gap)
    for w in range(WIDTH):
        if state[JUMP * WIDTH + w] < 0.0 and unsafe[w] == 0:
            for k in range(crossing, samples):
                at = k * WIDTH + w
                v, gap = speed[at], av_front[at] - length - front[at]
                if gap < _asked_gap(v, v - av_v[at], time_gap, brake):
                    unsafe[w] = _which(gap, v, time_gap, 5)
                    break


@njit(inline="always")
def keep_apart(length: float, state: FloatArray, scene: PackedScene, unsafe: IntArray) -> None:
    """Where a follower comes too near to the one before it, of that length [m] (see ``keep_ahead``).

    What a plan promises of their gap a car beside its plan does not keep to the millimetre: it has the margin of
    the ellipses.
    """
    for w in range(WIDTH):
        if state[NEAREST * WIDTH + w] < length + scene.safety.clearance and unsafe[w] == 0:
            unsafe[w] = 7


@kernel(error_model="numpy")
def starts_critically(scene: PackedScene) -> bool:
    """Whether the manoeuvre starts while the gap to the first follower is critical (equations.md 5.8)."""
    if not scene.safety.asked or len(scene.follower_x) == 0 or scene.safety.braking == np.inf:
        return False
    asked, gap = scene.safety, -scene.length / 2.0 - scene.follower_x[0] - scene.follower_length[0] / 2.0
    critical: bool = gap < critical_gap(scene.follower_v[0], scene.v0, asked.braking, asked.delay, asked.left)
    return critical


@dataclass
class Kept:
    """Margins by constraint, each in its unit and negative where violated, and when each is smallest [s]."""

    margins: dict[str, float] = field(default_factory=dict)
    moments: dict[str, float] = field(default_factory=dict)

    def take(self, name: str, values: FloatArray, first: int, dt: float) -> None:
        """The smallest of the values, which begin at sample ``first``, if none is known that is smaller."""
        if len(values) and not values.min() >= self.margins.get(name, np.nan):
            k = int(np.argmin(values))
            self.margins[name] = float(values[k])
            self.moments[name] = round((first + k) * dt, 10)


def av_pairs(replay: Replay, scene: PackedScene) -> tuple[Pair | None, Pair | None]:
    """The AV behind its new leader, and its new follower behind the AV, where there are such."""
    lane = pairs(replay, scene, joins=True)
    ahead = next((pair for pair in lane if pair.follower == names.EGO), None)
    return ahead, next((pair for pair in lane if pair.leader == names.EGO), None)


def behind_the_av(replay: Replay, scene: PackedScene) -> list[Pair]:
    """The pairs of followers behind an AV that changes lane, foremost first."""
    lane = pairs(replay, scene, joins=True)
    places = [i for i, pair in enumerate(lane) if pair.leader == names.EGO]
    return lane[places[0] + 1 :] if places else []


def kept(replay: Replay, scene: PackedScene, asked: SafetyLimits, *, start: int = 0) -> Kept:
    """What is kept of ``asked`` by an AV that changes lane. start: sample at which its manoeuvre begins."""
    found = Kept()
    ahead, behind = av_pairs(replay, scene)
    if behind is not None and np.isfinite(asked.braking):
        critical = critical_gap(
            behind.v_follower[start], behind.v_leader[start], asked.braking, asked.delay, asked.left
        )
        found.take(INSERTION, np.array([behind.gap[start] - critical]), start, scene.dt)
    for pair, of_gap, of_drac in ((ahead, TIME_GAP_AHEAD, DRAC_AHEAD), (behind, TIME_GAP_BEHIND, DRAC_BEHIND)):
        if pair is not None:
            found.take(of_gap, time_gaps(pair) - asked.time_gap, pair.first, scene.dt)
            found.take(of_drac, asked.drac - dracs(pair), pair.first, scene.dt)
    for pair in behind_the_av(replay, scene) if scene.asks_all else ():
        found.take(FOLLOWER_GAP, pair.gap[start:] - asked.clearance, start, scene.dt)
    _take_drive(found, replay, scene, asked)
    return found


def time_gaps(pair: Pair) -> FloatArray:
    """Time gaps of a pair from its first sample on [s], infinite where nobody leads."""
    gap, v = pair.gap[pair.first :], pair.v_follower[pair.first :]
    return np.asarray(gap / np.maximum(v, _STANDING))


def dracs(pair: Pair) -> FloatArray:
    """DRAC of a pair from its first sample on [m/s^2], 0 where nobody closes in."""
    gap, closing = pair.gap[pair.first :], (pair.v_follower - pair.v_leader)[pair.first :]
    return np.asarray(np.maximum(closing, 0.0) ** 2 / (2.0 * np.maximum(gap, _NO_GAP)))


def _take_drive(found: Kept, replay: Replay, scene: PackedScene, asked: SafetyLimits) -> None:
    """The AV's limits in its drive after T: of one that is recorded then, from where it is no more."""
    av = replay.av
    last, dt = av.free_from, scene.dt
    if last + 1 >= len(av.ax):
        return
    found.take(SPEED_AFTER_T, asked.v_max - av.vx[last + 1 :], last + 1, dt)
    found.take(ACCELERATION_AFTER_T, asked.acceleration - np.abs(av.ax[last:]), last, dt)
    # A plan ends without acceleration; of a recorded motion the step onto the drive is not known.
    command = av.ax[last:] if av.recorded else np.append(0.0, av.ax[last:])
    found.take(JERK_AFTER_T, asked.jerk - np.abs(np.diff(command)) / dt, last + 1, dt)


def binding(scene: PackedScene, rejected: dict[str, int]) -> str:
    """What forbids a lane change that has no plan, by how many candidates each constraint rejects.

    A critical gap at the start of the scene; else what rejects most of the candidates that keep the limits of
    motion, or, where none does, the limit that rejects most. ``DURATION``: no duration is allowed.
    """
    if not any(rejected.values()):
        return DURATION
    if starts_critically(scene):
        return INSERTION
    last = {name: n for name, n in rejected.items() if name not in CONSTRAINTS}
    most = last if any(last.values()) else rejected
    return max(most, key=lambda name: most[name], default="")


def motion_margins(motion: Human | PlannedMotion, limit: Limits, last: int | None = None) -> dict[str, float]:
    """How far a motion stays inside each dynamic limit at its samples, to sample ``last`` or its end."""
    columns = (np.asarray(getattr(motion, name), np.float64) for name in ("vx", "vy", "ax", "ay", "jx", "jy"))
    vx, vy, ax, ay, jx, jy = (np.abs(values[: None if last is None else last + 1]) for values in columns)
    speed = np.hypot(vx, vy)
    return {
        "speed": float(min(speed.min() - limit.v_min, limit.v_max - speed.max())),
        "acceleration_x": float(limit.acceleration - ax.max()),
        "acceleration_y": float(min(limit.acceleration, limit.lateral) - ay.max()),
        "jerk_x": float(limit.jerk - jx.max()),
        "jerk_y": float(limit.jerk - jy.max()),
    }
