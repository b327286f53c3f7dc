"""Replay of one motion of the AV: its drive after T, the followers' reaction, clearances to everybody."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.drive import (
    advance,
    credited,
    drive_behind,
    follower_command,
    gentle,
    jump,
    lcm_command,
    remembered,
)
from highd_lc.core.ellipse import ellipse_clearance
from highd_lc.core.kernels import UNALIASED, kernel
from highd_lc.core.losses import Charge, LossTerms, charge
from highd_lc.core.quintic import SHARE_TOLERANCE, Quintic, reaches, sample
from highd_lc.planning.scene import MOMENT, Human, PackedScene
from highd_lc.vocab.driver import TABLE3_MEANS

FloatArray = NDArray[np.float64]

_OTHERS = TABLE3_MEANS.as_array()


@dataclass(frozen=True)
class PlannedMotion:
    """A lane change by samples of the scene's dt, 0.1 s, from t = 0 to its end T = n dt; n + 1 samples.

    x, y: way forward and to the left of the rear axle since t = 0 [m] (equations.md 2). vx, vy [m/s], ax, ay
    [m/s^2], jx, jy [m/s^3]: its derivatives; those left out are differences of the one before, central inside and
    of second order at the ends. Each of shape (n + 1,).
    """

    x: FloatArray
    y: FloatArray
    vx: FloatArray | None = None
    vy: FloatArray | None = None
    ax: FloatArray | None = None
    ay: FloatArray | None = None
    jx: FloatArray | None = None
    jy: FloatArray | None = None


@dataclass(frozen=True)
class AvMotion:
    """Motion of the AV over 0 .. N samples, prescribed up to sample n (T = n dt), and of a recorded one up to
    sample ``recorded``, as long as it is in view (0: not recorded).

    x, y: planned point (moves as the box centre up to r (1 - cos phi)) [m]; vx, vy [m/s]; ax [m/s^2], from n on
    the commanded one; jerk: |jx| + |jy| prescribed at the samples 0 .. n, then |a_k - a_(k-1)| / dt with 0 at n's
    own step [m/s^3]; all of shape (N + 1,). crossing: sample of the lane crossing, N + 1 = after these samples.
    """

    x: FloatArray
    y: FloatArray
    vx: FloatArray
    vy: FloatArray
    ax: FloatArray
    jerk: FloatArray
    n: int
    crossing: int
    recorded: int = 0

    @property
    def free_from(self) -> int:
        """The last sample that is not driven by a model."""
        return max(self.n, self.recorded)


@dataclass(frozen=True)
class Entry:
    """How an AV that chose its start joins the target lane.

    place: how many of target leader, HV_1, HV_2 .. it has ahead. hand_over: sample at which the next of them gets
    the AV as its leader, if the step of its command there is not counted (it is the insertion); else None.
    target_front [m], target_v [m/s]: of the target leader, shape (N + 1,).
    """

    place: int
    hand_over: int | None
    target_front: FloatArray
    target_v: FloatArray


@dataclass(frozen=True, eq=False)  # one is the same as itself alone, and so can be looked up
class Replay:
    """What happens: the AV's motion, the followers' x (box centre) [m], v [m/s] and commanded a [m/s^2] of shape
    (p, N + 1), and for each obstacle (order of ``scene.obstacle_roles``) the smallest clearance [m] over
    0 .. T, and over the samples after T; infinite where an obstacle does not count. entry: None = into the
    recorded gap at t_start.
    """

    av: AvMotion
    x: FloatArray
    v: FloatArray
    a: FloatArray
    clearance_to_T: FloatArray
    clearance_after_T: FloatArray
    entry: Entry | None = None


def plan_motion(plan: Quintic, scene: PackedScene) -> AvMotion:
    """The prescribed motion of a quintic plan; the samples after T are filled by ``replay``."""
    n = round(plan.T / scene.dt)
    s = sample(plan, np.arange(n + 1, dtype=np.float64) * scene.dt)
    crossing = reaches(0.5, n, scene.dt, plan.D, plan.start)
    return _prescribed((s.x, s.y, s.vx, s.vy, s.ax, np.abs(s.jx) + np.abs(s.jy)), len(scene.target_v), crossing)


def human_motion(human: Human, scene: PackedScene) -> AvMotion:
    """The recorded motion of the ego, smoothed, as long as it is in view; T is its own, at most H."""
    jerk = np.abs(human.jx) + np.abs(human.jy)
    columns = (human.x, human.y, human.vx, human.vy, human.ax, jerk)
    seen = _prescribed(columns, len(scene.target_v), min(human.crossing, len(scene.target_v)))
    return replace(seen, n=seen.n if human.end is None else min(human.end, seen.n), recorded=seen.n)


def free_motion(scene: PackedScene) -> AvMotion:
    """No prescribed motion: the AV keeps its lane and is free from t_start on."""
    zero = np.zeros(1)
    return _prescribed((zero, zero, zero + scene.v0, zero, zero, zero), len(scene.target_v), len(scene.target_v))


def _prescribed(columns: tuple[FloatArray, ...], samples: int, crossing: int) -> AvMotion:
    n = min(len(columns[0]), samples) - 1
    padded = np.zeros((len(columns), samples))
    for row, column in zip(padded, columns, strict=True):
        row[: n + 1] = column[: n + 1]
    x, y, vx, vy, ax, jerk = padded
    return AvMotion(x, y, vx, vy, ax, jerk, n=n, crossing=crossing)


def av_charge(av: AvMotion, terms: LossTerms) -> Charge[FloatArray]:
    """What the AV is charged over 0 .. t_k, shape (N + 1,)."""
    return charge(np.hypot(av.vx, av.vy), av.jerk, terms.av_ref, terms)


def box_centre(av: AvMotion, rear_to_centre: float) -> tuple[FloatArray, FloatArray]:
    """x, y of the AV's box centre [m], each of shape (N + 1,): a planned point is the rear axle, moved forward by
    rear_to_centre [m] (equations.md 2); 0 where the motion is that of the centre.
    """
    heading = np.arctan2(av.vy, av.vx)
    return av.x + rear_to_centre * (np.cos(heading) - 1.0), av.y + rear_to_centre * np.sin(heading)


def joins(av: AvMotion, scene: PackedScene, follower: int = 0) -> int:
    """Sample from which that follower has the AV as leader: once the AV has made the follower's share of its way.

    At most 0 where it has had that leader since before these samples. Half of the way of a plan is its crossing. A
    recorded AV has made what its y says, as where followers are
    predicted behind it: its lane-id crossing need not be half of its way. A share never made is N + 1.
    """
    if follower == 0 and scene.joined.since <= 0:
        return scene.joined.since
    moment = float(scene.reactions[follower, MOMENT])
    if moment == 0.0:
        return 0
    if moment == 0.5 and not av.recorded:
        return av.crossing
    made = np.flatnonzero(av.y / scene.D >= moment - SHARE_TOLERANCE)
    return int(made[0]) if len(made) else len(av.y)


def replay(av: AvMotion, scene: PackedScene) -> Replay:
    """Let the AV drive on after T and the followers react.

    Semi-implicit Euler, all vehicles on the states of the same instant (equations.md 3). The arrays of ``av`` are
    completed in place.
    """
    drive_on(av.x, av.y, av.vx, av.ax, av.jerk, av.free_from, scene)
    x, v, a = following(av, scene)
    to_T, after_T = clearances(av.x, av.y, av.vx, av.vy, av.n, av.crossing, scene, x)
    return Replay(av, x, v, a, to_T, after_T)


def following(av: AvMotion, scene: PackedScene) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The followers' x (box centre) [m], v [m/s], a [m/s^2] behind a whole motion of the AV, each (p, N + 1)."""
    x, v, a = (np.empty((len(scene.follower_x), len(av.x))) for _ in range(3))
    follow(av.x + scene.length / 2.0, av.vx, joins(av, scene), scene, x, v, a)
    return x, v, a


@kernel()
def drive_on(
    x: FloatArray,
    y: FloatArray,
    vx: FloatArray,
    ax: FloatArray,
    jerk: FloatArray,
    n: int,
    scene: PackedScene,
) -> None:
    """Fill the AV's motion after sample n: LCM behind the target leader, or constant speed.

    A safety profile bounds its acceleration, and its jerk from the acceleration at n on. The step of the command
    onto this drive, from the acceleration at n (0 where a plan ends), is in the jerk of sample n + 1 if counted;
    of an AV that is free from the start there is none.
    """
    dt, before, step = scene.dt, ax[n], scene.safety.jerk * scene.dt
    v_desire, A, b, B, tau, L = scene.av_parameters
    half = scene.length / 2.0
    for k in range(n, len(x)):
        command = 0.0
        if scene.after_lcm:
            spacing = scene.target_front[k] - x[k] - half
            command = lcm_command(vx[k], spacing, scene.target_v[k], v_desire, A, b, B, tau, L, scene.hardest)
        command = gentle(command, before if k == n else ax[k - 1], scene.safety.acceleration, step)
        ax[k] = command
        if k > n:
            jerk[k] = abs(command - ax[k - 1]) / dt
        if k == n + 1 and n > 0 and scene.counts_handover:
            jerk[k] += abs(ax[n] - before) / dt
        if k + 1 < len(x):
            x[k + 1], vx[k + 1] = advance(x[k], vx[k], command, dt)
            y[k + 1] = y[k]


@kernel()
def follow(
    av_front: FloatArray,
    av_v: FloatArray,
    insertion: int,
    scene: PackedScene,
    x: FloatArray,
    v: FloatArray,
    a: FloatArray,
) -> None:
    """Drive the followers by their models: the first behind the target leader before sample ``insertion`` and
    behind the AV from then on, each other behind the one before. Fills x, v, a of shape (p, N + 1).

    insertion: below 0, the first one has followed the AV for so long, and credits what ``scene.joined`` says.
    """
    dt = scene.dt
    p, samples = x.shape
    _, credit, v_credit = scene.joined
    for i in range(p):
        x[i, 0], v[i, 0] = scene.follower_x[i], scene.follower_v[i]
    for k in range(samples):
        front, speed, length = av_front[k], av_v[k], scene.length
        if k < insertion:
            front, speed, length = scene.target_front[k], scene.target_v[k], scene.target_length
        for i in range(p):
            v_desire, A, b, B, tau, L = scene.parameters[i]
            code, memory, relaxation, need, a_0, drift, _ = scene.reactions[i]
            family, half, share = int(code), scene.follower_length[i] / 2.0, 0.0
            if i == 0 and k < insertion:
                L = scene.first_L
            spacing = front - half - x[i, k]
            if i == 0 and k == insertion:
                before = scene.target_front[k] - half - x[i, k]
                credit, v_credit = jump(family, v[i, k], spacing, speed, before, scene.target_v[k], b, B, tau, L)
            if i == 0:
                share = credited((k - insertion) * dt, relaxation)
            a[i, k] = follower_command(
                family, v[i, k], spacing, speed, length, v_desire, A, b, B, tau, L,
                share * credit, share * v_credit, remembered(scene.clock + k * dt, memory), a_0, drift, need,
                scene.hardest,
            )  # fmt: skip
            front, speed, length = x[i, k] + half, v[i, k], scene.follower_length[i]
            if k + 1 < samples:
                x[i, k + 1], v[i, k + 1] = advance(x[i, k], v[i, k], a[i, k], dt)


class _Box(NamedTuple):
    """The AV's ellipse at each sample: cosine and sine of its heading, its centre beside the planned point, and
    how far it reaches along both axes [m], each of shape (N + 1,).
    """

    cos: FloatArray
    sin: FloatArray
    behind: FloatArray
    beside: FloatArray
    reach_x: FloatArray
    reach_y: FloatArray


@kernel()
def clearances(
    x: FloatArray,
    y: FloatArray,
    vx: FloatArray,
    vy: FloatArray,
    n: int,
    crossing: int,
    scene: PackedScene,
    follower_x: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Smallest clearance [m] to each obstacle over the samples 0 .. n and over those after n."""
    m, p, samples = len(scene.leader_a), len(scene.follower_x), len(x)
    count = m + p + (1 if len(scene.origin_follower) else 0)
    to_T, after_T = np.full(count, np.inf), np.full(count, np.inf)
    box = _Box(
        np.ones(samples), np.zeros(samples), np.zeros(samples), np.zeros(samples),
        np.full(samples, scene.a), np.full(samples, scene.b),
    )  # fmt: skip
    _turn(vx, vy, n, scene, box)
    bounds, level = np.empty(samples), np.empty(samples)
    for i in range(m):
        axes = scene.leader_a[i], scene.leader_b[i]
        _nearest(x, y, n, scene, box, scene.leader_x[i], scene.leader_y[i], axes, bounds, to_T, after_T, i)
    for i in range(p):
        level[:], axes = scene.follower_y[i], (scene.follower_a[i], scene.follower_b[i])
        _nearest(x, y, n, scene, box, follower_x[i], level, axes, bounds, to_T, after_T, m + i)
    if len(scene.origin_follower):
        behind = origin_follower_motion(x + scene.length / 2.0, vx, crossing, scene)
        level[:], axes = scene.origin_follower[1], (scene.origin_follower[4], scene.origin_follower[5])
        last = min(crossing, n) + 1
        _nearest(x[:last], y, n, scene, box, behind, level, axes, bounds, to_T, after_T, count - 1)
    return to_T, after_T


@kernel()
def _turn(vx: FloatArray, vy: FloatArray, n: int, scene: PackedScene, box: _Box) -> None:
    """Turn the box with the motion up to sample n; it is straight before that, and stays so after it."""
    for k in range(min(n + 1, len(vx))):
        if vy[k] != 0.0:
            speed = np.sqrt(vx[k] * vx[k] + vy[k] * vy[k])
            cos, sin = vx[k] / speed, vy[k] / speed
            box.cos[k], box.sin[k] = cos, sin
            box.behind[k], box.beside[k] = scene.rear_to_centre * (1.0 - cos), scene.rear_to_centre * sin
            box.reach_x[k] = np.sqrt((scene.a * cos) ** 2 + (scene.b * sin) ** 2)
            box.reach_y[k] = np.sqrt((scene.a * sin) ** 2 + (scene.b * cos) ** 2)


@kernel()
def origin_follower_motion(
    av_front: FloatArray, av_v: FloatArray, crossing: int, scene: PackedScene
) -> FloatArray:
    """Box centre [m] of the origin follower, behind the AV by LCM (Table 3 means) until the crossing."""
    x0, _, v, length = scene.origin_follower[:4]
    half, seen = length / 2.0, slice(0, crossing + 1)
    front, _ = drive_behind(x0 + half, v, av_front[seen], av_v[seen], _OTHERS, scene.hardest, scene.dt)
    x: FloatArray = front - half
    return x


@kernel(error_model="numpy", **UNALIASED)
def _nearest(
    x: FloatArray,
    y: FloatArray,
    n: int,
    scene: PackedScene,
    box: _Box,
    other_x: FloatArray,
    other_y: FloatArray,
    axes: tuple[float, float],
    bounds: FloatArray,
    to_T: FloatArray,
    after_T: FloatArray,
    index: int,
) -> None:
    """Lower the clearances at ``index`` to those to an obstacle at other_x, other_y. axes: its semi-axes.

    bounds: scratch, shape (N + 1,).
    """
    # Separation along the axes is a lower bound: beside the clearance at the least of them, most need no more.
    a, b = axes
    for k in range(len(x)):
        dx, dy = other_x[k] - x[k] + box.behind[k], other_y[k] - y[k] - box.beside[k]
        bounds[k] = max(abs(dx) - box.reach_x[k] - a, abs(dy) - box.reach_y[k] - b)
    for part in range(2):
        nearest, first, stop = (after_T, n + 1, len(x)) if part else (to_T, 0, min(n + 1, len(x)))
        if first >= stop:
            continue
        least = first + int(np.argmin(bounds[first:stop]))
        for place in range(first - 1, stop):
            k = least if place < first else place
            if bounds[k] < nearest[index]:
                dx, dy = other_x[k] - x[k] + box.behind[k], other_y[k] - y[k] - box.beside[k]
                heading = np.arctan2(box.sin[k], box.cos[k])
                nearest[index] = min(nearest[index], ellipse_clearance(dx, dy, heading, scene.a, scene.b, a, b))


CONSTANT_T = 5.5
"""Duration of the reference that changes lane at constant speed [s] (equations.md 6)."""


def constant_samples(packed: PackedScene) -> int:
    """Samples of ``CONSTANT_T``, at most those of H."""
    return min(round(CONSTANT_T / packed.dt), len(packed.target_v) - 1)


def own_duration(human: Human | None, packed: PackedScene) -> float:
    """How long a recorded lane change, or the one at constant speed, lasts by itself [s]; replays cut it at H."""
    if human is None:
        return CONSTANT_T
    return float((len(human.x) - 1 if human.end is None else human.end) * packed.dt)
