"""First contact of candidate plans with the other vehicles, for tiles of candidates of one duration.

All candidates of a tile share the lateral motion. So lateral separation is tested once per sample for the whole
tile, longitudinal separation for all candidates in one vector loop, and the ellipses themselves only where
neither decides.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.core.drive import lcm_step
from highd_lc.core.ellipse import ellipses_touch
from highd_lc.core.kernels import UNALIASED, kernel
from highd_lc.core.quintic import lateral, q_rate, r_rate, z_rate
from highd_lc.planning.scene import PackedScene
from highd_lc.vocab import names
from highd_lc.vocab.driver import TABLE3_MEANS

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

WIDTH = 16
"""Candidates a tile; arrays of a tile are flat, sample k of candidate w at k WIDTH + w."""
NO_CONTACT = 1_000_000
"""Sample of the first contact of a candidate that has none."""

# Rows of a tile's scratch: the candidates, losses to T and to H, a vehicle on its way (front, speed, command), how
# near it has come to its leader, and what it credits of its change of leader (spacing, speed). JUMP is free once a
# vehicle has driven: it then holds by how much a gap exceeds what is asked.
DELTA, CHANGE, TO_T, TO_H, FRONT, SPEED, COMMAND, NEAREST, JUMP, V_JUMP = range(10)
STATE_ROWS = 10

_OTHERS = TABLE3_MEANS.as_array()
_STEP = 4.0
"""More than two vehicles come nearer in a sample [m]."""
_BLOCK = 8
"""Samples that are looked at together for whether anybody comes near."""

Place = tuple[float, float, float, float]


def contact_words(roles: tuple[str, ...]) -> tuple[str, ...]:
    """What stands in a candidate's way, by the kernels' numbers: ellipses, then who drives through whom.

    With R roles: r: the AV's ellipse and that of r; R + r: r through the vehicle before it on the target lane;
    2 R + r: r through the AV; 3 R + r: the AV through r. roles: see ``scene.obstacle_roles``.
    """
    before = dict(zip(_lane_of(roles)[1:], _lane_of(roles), strict=False))
    pairs = [(role, before.get(role, role)) for role in roles]
    pairs += [(role, names.EGO) for role in roles] + [(names.EGO, role) for role in roles]
    return (*(f"clearance_{role}" for role in roles), *(f"contact_{names.through(*pair)}" for pair in pairs))


def _lane_of(roles: tuple[str, ...]) -> list[str]:
    """The roles on the target lane, foremost first."""
    return [role for role in roles if role not in (names.ORIGIN_LEADER, names.ORIGIN_FOLLOWER)]


@kernel(error_model="numpy", **UNALIASED)
def lateral_motion(
    n: int, state: FloatArray, scene: PackedScene, y: FloatArray, vy: FloatArray, reach: FloatArray
) -> None:
    """Fill y [m], ydot [m/s] and how far the AV's ellipse reaches sideways [m] at every sample.

    A turned ellipse reaches at most b + a sin(heading), and its centre swings by r sin(heading) about the
    planned point; the heading is bounded by the lowest speed in the tile. state: rows delta, change.
    """
    delta_low = state[DELTA * WIDTH : (DELTA + 1) * WIDTH].min()
    changes = state[CHANGE * WIDTH : (CHANGE + 1) * WIDTH]
    change_low, change_high = changes.min(), changes.max()
    y[n:], vy[n:], reach[n:] = scene.D, 0.0, scene.b
    T = n * scene.dt
    for k in range(n):
        u = k / n
        dz, dq = z_rate(u) / T, q_rate(u)
        y[k], vy[k] = lateral(u, T, scene.D, scene.start)
        slowest = scene.v0 + dz * delta_low + min(dq * change_low, dq * change_high)
        slowest += T * scene.start.ax * r_rate(u)
        sin = abs(vy[k]) / np.hypot(vy[k], max(slowest, 0.1)) if vy[k] != 0.0 else 0.0
        reach[k] = scene.b + (scene.a + scene.rear_to_centre) * sin


@njit(inline="always")
def _near(k: int, shift: float, limit: float, av_front: FloatArray) -> int:
    near = 0
    for w in range(WIDTH):
        near += abs(shift - av_front[k * WIDTH + w]) < limit
    return near


@njit(inline="always")
def _near_pair(first: int, stop: int, shift: float, limit: float, av_front: FloatArray, front: FloatArray) -> int:
    near = 0
    for at in range(first * WIDTH, stop * WIDTH):
        near += abs(front[at] + shift - av_front[at]) < limit
    return near


@njit(inline="always")
def _beside(k: int, other_y: float, room: float, y: FloatArray, reach: FloatArray) -> bool:
    """Whether the AV, at sample k or on the way to it, is too near sideways to somebody at other_y."""
    j = max(k - 1, 0)
    beside: bool = min(abs(other_y - y[j]), abs(other_y - y[k])) < max(reach[j], reach[k]) + room
    return beside


@njit(inline="always")
def _course(vx: float, vy: float) -> tuple[float, float]:
    """Cosine and sine of the AV's heading."""
    if vy == 0.0:
        return 1.0, 0.0
    speed = np.hypot(vx, vy)
    return vx / speed, vy / speed


@kernel(error_model="numpy", **UNALIASED)
def _record(
    k: int,
    w: int,
    who: int,
    before: Place,
    now: Place,
    a2: float,
    b2: float,
    scene: PackedScene,
    contact: IntArray,
    role: IntArray,
) -> None:
    """Record a candidate's contact on the way to sample k, if its ellipse, turned into its course, meets another.

    before, now: position of the other from the planned point, and the AV's speed, at the samples k - 1 and k.
    """
    r = scene.rear_to_centre
    cos, sin = _course(before[2], before[3])
    x0, y0 = before[0] + r * (1.0 - cos), before[1] - r * sin
    cos, sin = _course(now[2], now[3])
    x1, y1 = now[0] + r * (1.0 - cos), now[1] - r * sin
    if ellipses_touch(x0, y0, x1, y1, cos, sin, scene.a, scene.b, a2, b2, scene.safety.clearance):
        contact[w], role[w] = k, who


@kernel(error_model="numpy", **UNALIASED)
def meet_leaders(
    n: int,
    scene: PackedScene,
    av_front: FloatArray,
    av_v: FloatArray,
    y: FloatArray,
    vy: FloatArray,
    reach: FloatArray,
    contact: IntArray,
    role: IntArray,
) -> None:
    """Contacts with the leaders of the origin and the target lane, at all samples."""
    half = scene.length / 2.0
    for i in range(len(scene.leader_a)):
        a2, b2 = scene.leader_a[i], scene.leader_b[i]
        limit = scene.a + a2 + scene.rear_to_centre + scene.safety.clearance
        for k in range(len(y)):
            j = max(k - 1, 0)
            dy0, dy = scene.leader_y[i, j] - y[j], scene.leader_y[i, k] - y[k]
            if min(abs(dy0), abs(dy)) >= max(reach[j], reach[k]) + b2 + scene.safety.clearance:
                continue
            shift0, shift = scene.leader_x[i, j] + half, scene.leader_x[i, k] + half
            if _near(k, shift, limit + _STEP, av_front) == 0:
                continue
            for w in range(WIDTH):
                dx0, dx = shift0 - av_front[j * WIDTH + w], shift - av_front[k * WIDTH + w]
                if k < contact[w] and min(abs(dx0), abs(dx)) < limit:
                    before = (dx0, dy0, av_v[j * WIDTH + w], vy[j])
                    now = (dx, dy, av_v[k * WIDTH + w], vy[k])
                    _record(k, w, i, before, now, a2, b2, scene, contact, role)


@kernel(error_model="numpy", **UNALIASED)
def _meet_behind(
    last: int,
    who: int,
    other_y: float,
    back: float,
    axes: tuple[float, float],
    scene: PackedScene,
    av_front: FloatArray,
    av_v: FloatArray,
    y: FloatArray,
    vy: FloatArray,
    reach: FloatArray,
    front: FloatArray,
    contact: IntArray,
    role: IntArray,
) -> None:
    """Contacts until sample ``last`` with a vehicle that reacts to each candidate. back: front to centre [m]."""
    shift = scene.length / 2.0 - back
    a2, b2 = axes
    limit = scene.a + a2 + scene.rear_to_centre + scene.safety.clearance
    room, first = b2 + scene.safety.clearance, 0
    while first <= last and not _beside(first, other_y, room, y, reach):
        first += 1
    for block in range(first, last + 1, _BLOCK):
        stop = min(block + _BLOCK, last + 1)
        if _near_pair(block, stop, shift, limit + _STEP, av_front, front) == 0:
            continue
        for k in range(block, stop):
            if not _beside(k, other_y, room, y, reach):
                continue
            j = max(k - 1, 0)
            for w in range(WIDTH):
                dx0 = front[j * WIDTH + w] + shift - av_front[j * WIDTH + w]
                dx = front[k * WIDTH + w] + shift - av_front[k * WIDTH + w]
                if k < contact[w] and min(abs(dx0), abs(dx)) < limit:
                    before = (dx0, other_y - y[j], av_v[j * WIDTH + w], vy[j])
                    now = (dx, other_y - y[k], av_v[k * WIDTH + w], vy[k])
                    _record(k, w, who, before, now, a2, b2, scene, contact, role)


@kernel(error_model="numpy", **UNALIASED)
def drive_through(
    first: int,
    stop: int,
    who: int,
    rear: FloatArray,
    state: FloatArray,
    front: FloatArray,
    contact: IntArray,
    role: IntArray,
) -> None:
    """Contacts, at the samples first .. stop - 1, with a leader that moves alike for all candidates.

    rear: its rear bumper [m], shape (N + 1,); front: of the candidates' AVs, or of those who follow them.
    """
    for w in range(WIDTH):
        state[NEAREST * WIDTH + w] = np.inf
    # Two samples at once: half the way to memory.
    for k in range(first, stop, 2):
        later = min(k + 1, stop - 1)
        for w in range(WIDTH):
            gap = min(rear[k] - front[k * WIDTH + w], rear[later] - front[later * WIDTH + w])
            state[NEAREST * WIDTH + w] = min(state[NEAREST * WIDTH + w], gap)
    for w in range(WIDTH):
        if state[NEAREST * WIDTH + w] < 0.0:
            for k in range(first, min(stop, contact[w])):
                if rear[k] < front[k * WIDTH + w]:
                    contact[w], role[w] = k, who
                    break


@kernel(error_model="numpy", **UNALIASED)
def meet_follower(
    i: int,
    n: int,
    scene: PackedScene,
    av_front: FloatArray,
    av_v: FloatArray,
    y: FloatArray,
    vy: FloatArray,
    reach: FloatArray,
    front: FloatArray,
    contact: IntArray,
    role: IntArray,
) -> None:
    """Contacts with follower i, whose fronts are given, at all samples."""
    _meet_behind(
        len(y) - 1,
        len(scene.leader_a) + i,
        scene.follower_y[i],
        scene.follower_length[i] / 2.0,
        (scene.follower_a[i], scene.follower_b[i]),
        scene,
        av_front,
        av_v,
        y,
        vy,
        reach,
        front,
        contact,
        role,
    )


@kernel(error_model="numpy", **UNALIASED)
def _drive_origin_follower(
    last: int,
    state: FloatArray,
    scene: PackedScene,
    av_front: FloatArray,
    av_v: FloatArray,
    front: FloatArray,
) -> None:
    """Fronts of the origin follower behind each candidate by LCM (Table 3 means), over the samples 0 .. last."""
    v_desire, A, b, B, tau, L = _OTHERS
    for w in range(WIDTH):
        state[FRONT * WIDTH + w] = scene.origin_follower[0] + scene.origin_follower[3] / 2.0
        state[SPEED * WIDTH + w] = scene.origin_follower[2]
    for k in range(last + 1):
        for w in range(WIDTH):
            x, v = state[FRONT * WIDTH + w], state[SPEED * WIDTH + w]
            front[k * WIDTH + w] = x
            _, x, v = lcm_step(
                x,
                v,
                av_front[k * WIDTH + w],
                av_v[k * WIDTH + w],
                v_desire,
                A,
                b,
                B,
                tau,
                L,
                scene.hardest,
                scene.dt,
            )
            state[FRONT * WIDTH + w], state[SPEED * WIDTH + w] = x, v


@kernel(error_model="numpy", **UNALIASED)
def meet_origin_follower(
    crossing: int,
    state: FloatArray,
    scene: PackedScene,
    av_front: FloatArray,
    av_v: FloatArray,
    y: FloatArray,
    vy: FloatArray,
    reach: FloatArray,
    front: FloatArray,
    contact: IntArray,
    role: IntArray,
) -> None:
    """Contacts with the origin follower until the crossing. front, state: scratch."""
    _drive_origin_follower(crossing, state, scene, av_front, av_v, front)
    _meet_behind(
        crossing,
        len(scene.leader_a) + len(scene.follower_x),
        scene.origin_follower[1],
        scene.origin_follower[3] / 2.0,
        (scene.origin_follower[4], scene.origin_follower[5]),
        scene,
        av_front,
        av_v,
        y,
        vy,
        reach,
        front,
        contact,
        role,
    )


@kernel(error_model="numpy")
def meet_ahead(
    who: int,
    first: int,
    asked: bool,
    length: float,
    state: FloatArray,
    ahead: FloatArray,
    own: FloatArray,
    contact: IntArray,
    role: IntArray,
) -> None:
    """Contacts of a follower, from sample ``first`` on, with a vehicle ahead of that length [m].

    asked: whether to look even where the follower came near to nobody whom it follows.
    """
    for w in range(WIDTH):
        if not (asked or state[NEAREST * WIDTH + w] < length):
            continue
        for k in range(first, min(contact[w], len(own) // WIDTH)):
            if ahead[k * WIDTH + w] - own[k * WIDTH + w] < length:
                contact[w], role[w] = k, who
                break
