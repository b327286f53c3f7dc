"""The candidates' kernel once more in plain numpy, vectorised over the candidates, from the equations.

``evaluate`` has the signature of ``candidates.evaluate``: the tests compare results, the benchmark times.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.losses import LossTerms
from highd_lc.planning.candidates import Outcomes
from highd_lc.planning.contacts import NO_CONTACT
from highd_lc.planning.scene import MOMENT, PackedScene
from highd_lc.vocab.driver import TABLE3_MEANS

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

Z = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])
Q = np.polynomial.Polynomial([0, 0, 0, -4, 7, -3])
R = np.polynomial.Polynomial([0, 0, 0.5, -1.5, 1.5, -0.5])
S = np.polynomial.Polynomial([0, 1, 0, -6, 8, -3])
GOLDEN = 0.3819660112501051
DIRECTIONS = 24


def lcm(
    v: FloatArray, spacing: FloatArray, v_leader: FloatArray, parameters: FloatArray, hardest: float
) -> FloatArray:
    """Equations 10 and 11 with the floor and bounded braking; infinite spacing = free road."""
    v_desire, A, b, B, tau, L = parameters
    wanted = np.maximum(v**2 / (2 * b) - v_leader**2 / (2 * B) + v * tau + L, L)
    return np.maximum(A * (1 - v / v_desire - np.exp(np.minimum(1 - spacing / wanted, 40))), -hardest)


def command(
    family: int, v: FloatArray, spacing: FloatArray, v_leader: FloatArray, length: FloatArray, parameters: tuple
) -> FloatArray:
    """What a family asks for: nothing, the LCM or the IDM, not bounded."""
    if family == 0:
        return np.zeros_like(v)
    if family == 1:
        return lcm(v, spacing, v_leader, parameters, np.inf)
    v_desire, A, b, _, T, s0 = parameters
    wanted = s0 + np.maximum(0.0, v * T + v * (v - v_leader) / (2 * np.sqrt(A * b)))
    return A * (1 - (v / v_desire) ** 4 - (wanted / np.maximum(spacing - length, 0.1)) ** 2)


def evaluate(
    n: IntArray,
    delta: FloatArray,
    change: FloatArray,
    scene: PackedScene,
    terms: LossTerms,
    crowd: None = None,
) -> Outcomes:
    """Losses and first contacts of candidates, each of shape (rows, candidates). crowd: none here."""
    shape = delta.shape
    n, delta, change = np.repeat(n, shape[1]), delta.ravel(), change.ravel()
    x, vx, y, vy, av_T, av_H = _av(n, delta, change, scene, terms)
    front = x + scene.length / 2
    hv_T, hv_H, followers, first_v = _followers(n, front, vx, scene, terms)
    fronts = [x + length / 2 for x, length in zip(followers, scene.follower_length, strict=True)]
    unsafe = unsafe_codes(n, (front, vx), fronts, first_v, scene)
    firsts = _contacts(n, (x, vx, y, vy), followers, scene)
    if scene.asks_all:
        firsts |= _through(n, front, followers, scene)
    contact, role = np.full(len(n), NO_CONTACT), np.full(len(n), -1)
    for who in sorted(firsts, key=lambda code: _asked(code, scene)):
        role = np.where(firsts[who] < contact, who, role)
        contact = np.minimum(contact, firsts[who])
    return Outcomes(*(column.reshape(shape) for column in (av_T, av_H, hv_T, hv_H, contact, role, unsafe)))


def unsafe(
    n: IntArray, delta: FloatArray, change: FloatArray, scene: PackedScene, terms: LossTerms
) -> NDArray[np.int64]:
    """``evaluate``'s column of that name alone."""
    shape = delta.shape
    n = np.repeat(n, shape[1])
    x, vx, *_ = _av(n, delta.ravel(), change.ravel(), scene, terms)
    front = x + scene.length / 2
    fronts, speeds, _ = zip(*_chain(n, front, vx, scene), strict=True)
    return unsafe_codes(n, (front, vx), fronts, speeds[0], scene).reshape(shape)


def unsafe_codes(
    n: IntArray, av: tuple, fronts: Sequence[FloatArray], first_v: FloatArray, scene: PackedScene
) -> IntArray:
    """1 + index in ``limits.SAFETY`` of the first constraint that each candidate breaks, 0 for none.

    av: front and speed, fronts: of the followers, first_v: the first one's speed, each (candidates, samples).
    """
    asked = scene.safety
    if not asked.asked:
        return np.zeros(len(n), np.int64)
    front, vx = av
    counts = np.arange(front.shape[1]) >= crossing_samples(n, scene)[:, None]
    code = np.zeros(len(n), np.int64)
    closing = max(scene.follower_v[0] - scene.v0, 0.0)
    critical = closing * asked.delay + closing**2 / (2 * asked.braking) + scene.v0 * asked.left if closing else 0.0
    gap_0 = -scene.length / 2 - (scene.follower_x[0] + scene.follower_length[0] / 2)
    if np.isfinite(asked.braking) and gap_0 < critical:
        return np.ones(len(n), np.int64)
    pairs = (
        (2, scene.target_front - scene.target_length - front, vx, np.broadcast_to(scene.target_v, vx.shape)),
        (5, front - scene.length - fronts[0], first_v, vx),
    )
    for of_gap, gap, v, v_leader in pairs:
        short = (gap < asked.time_gap * v) & counts
        hard = (np.maximum(v - v_leader, 0) ** 2 > 2 * asked.drac * gap) & counts
        at_gap, at_drac = _first(short), _first(hard)
        found = np.where(at_gap <= at_drac, of_gap, of_gap + 1)
        code = np.where((code == 0) & (np.minimum(at_gap, at_drac) < NO_CONTACT), found, code)
        if of_gap == 2:
            fast = ((vx > asked.v_max) & (np.arange(front.shape[1]) > n[:, None])).any(axis=1)
            code = np.where((code == 0) & fast, 4, code)
    for i in range(1, len(fronts)):
        gap = fronts[i - 1] - scene.follower_length[i - 1] - fronts[i]
        near = (gap < asked.clearance).any(axis=1) & scene.asks_all
        code = np.where((code == 0) & near, 7, code)
    return code


def _first(at: NDArray[np.bool_]) -> IntArray:
    return np.where(at.any(axis=1), at.argmax(axis=1), NO_CONTACT)


def speed_loss(v: FloatArray, ref: float, terms: LossTerms) -> FloatArray:
    """Weighted |v - ref|, or the shortfall alone."""
    return terms.efficiency * (np.maximum(ref - v, 0) if terms.one_sided else np.abs(v - ref))


def charged(loss: FloatArray, n: IntArray) -> FloatArray:
    """Sums over the samples 0 .. n of each row."""
    return np.take_along_axis(np.cumsum(loss, axis=1), n[:, None], axis=1)[:, 0]


def _av(n: IntArray, delta: FloatArray, change: FloatArray, scene: PackedScene, terms: LossTerms) -> tuple:
    """The AV's motion, shape (candidates, samples), and its losses to T and to H."""
    k = np.arange(len(scene.target_v))
    T = (n * scene.dt)[:, None]
    u = np.minimum(k / n[:, None], 1.0)
    d, c = delta[:, None], change[:, None]
    ax = scene.start.ax
    x = scene.v0 * u * T + d * Z(u) + T * c * Q(u) + T**2 * ax * R(u)
    vx = scene.v0 + d / T * Z.deriv()(u) + c * Q.deriv()(u) + T * ax * R.deriv()(u)
    jx = d / T**3 * Z.deriv(3)(u) + c / T**2 * Q.deriv(3)(u) + ax / T * R.deriv(3)(u)
    y, vy, jy = (lateral(u, T, scene, order) for order in (0, 1, 3))
    jerk = np.abs(jx) + np.abs(jy)
    a = np.zeros_like(x)
    for i in k[n.min() :]:
        after = i >= n
        if scene.after_lcm:
            spacing = scene.target_front[i] - x[:, i] - scene.length / 2
            command = lcm(vx[:, i], spacing, scene.target_v[i], scene.av_parameters, scene.hardest)
            before, step = a[:, i - 1], scene.safety.jerk * scene.dt
            command = np.minimum(np.maximum(command, before - step), before + step)
            a[:, i] = np.where(after, np.clip(command, -scene.safety.acceleration, scene.safety.acceleration), 0.0)
        if i:
            jerk[:, i] = np.where(i > n, np.abs(a[:, i] - a[:, i - 1]) / scene.dt, jerk[:, i])
            if scene.counts_handover:
                jerk[:, i] += np.where(i == n + 1, np.abs(a[:, i - 1]) / scene.dt, 0.0)
        if i + 1 < len(k):
            v = np.maximum(vx[:, i] + a[:, i] * scene.dt, 0.0)
            vx[:, i + 1] = np.where(after, v, vx[:, i + 1])
            x[:, i + 1] = np.where(after, x[:, i] + v * scene.dt, x[:, i + 1])
    loss = terms.comfort * jerk + speed_loss(np.hypot(vx, vy), terms.av_ref, terms)
    return x, vx, y, vy, charged(loss, n), loss.sum(axis=1)


def lateral(u: FloatArray, T: FloatArray, scene: PackedScene, order: int) -> FloatArray:
    """y of the AV or a derivative of it by time."""
    start = scene.start
    shapes = (p.deriv(order) if order else p for p in (Z, S, R))
    parts = zip((scene.D - start.y, T * start.vy, T**2 * start.ay), shapes, strict=True)
    return (start.y if order == 0 else 0.0) + sum(size * shape(u) for size, shape in parts) / T**order


def crossing_samples(n: IntArray, scene: PackedScene) -> IntArray:
    """Sample of each candidate's crossing: n // 2, or the nearest one where it starts under way."""
    if scene.start == (0.0, 0.0, 0.0, 0.0):
        return n // 2
    return np.array([_first_of(lateral((np.arange(m) + 0.5) / m, m * scene.dt, scene, 0), 0.5, scene) for m in n])


def _first_of(y: FloatArray, share: float, scene: PackedScene) -> int:
    made = np.flatnonzero(y / scene.D >= share - 1e-9)
    return int(made[0]) if len(made) else len(y)


def _followers(n: IntArray, front: FloatArray, vx: FloatArray, scene: PackedScene, terms: LossTerms) -> tuple:
    """The followers' losses to T and to H, their box centres, each of shape (candidates, samples), and the first
    one's speed.
    """
    to_T, to_H, centres, speeds = np.zeros(len(n)), np.zeros(len(n)), [], []
    for i, (ahead, v, a) in enumerate(_chain(n, front, vx, scene)):
        jerk = np.abs(np.diff(a, axis=1, prepend=a[:, :1])) / scene.dt
        loss = terms.comfort * jerk + speed_loss(v, terms.hv_ref[i], terms)
        to_T, to_H = to_T + terms.weights[i] * charged(loss, n), to_H + terms.weights[i] * loss.sum(axis=1)
        centres.append(ahead - scene.follower_length[i] / 2)
        speeds.append(v)
    return to_T, to_H, centres, speeds[0]


def _chain(n: IntArray, front: FloatArray, vx: FloatArray, scene: PackedScene) -> Iterator[tuple]:
    """Fronts, speeds and commands of the followers behind the AV's front and speed, nearest first."""
    inserted = joining_samples(n, scene.reactions[0, MOMENT], scene)
    before = np.arange(front.shape[1]) < inserted[:, None]
    ahead, ahead_v = np.where(before, scene.target_front, front), np.where(before, scene.target_v, vx)
    for i, parameters in enumerate(scene.parameters):
        half = scene.follower_length[i] / 2
        L = np.where(before & (i == 0), scene.first_L, parameters[5])
        length = np.where(before, scene.target_length, scene.length) if i == 0 else scene.follower_length[i - 1]
        start = scene.follower_x[i] + half, scene.follower_v[i]
        leader = (ahead, ahead_v, np.broadcast_to(length, L.shape))
        ahead, ahead_v, a = _react(leader, start, (*parameters[:5], L), i, inserted, scene)
        yield ahead, ahead_v, a


def joining_samples(n: IntArray, moment: float, scene: PackedScene) -> IntArray:
    """Sample at which each candidate's AV has made that share of its lateral way; half of it is the crossing."""
    if scene.joined.since <= 0:
        return np.full(len(n), scene.joined.since)
    if moment == 0.5:
        return crossing_samples(n, scene)
    return np.array([_first_of(lateral(np.arange(m + 1) / m, m * scene.dt, scene, 0), moment, scene) for m in n])


def _react(
    leader: tuple, start: tuple, parameters: tuple, i: int, inserted: IntArray, scene: PackedScene
) -> tuple:
    """Fronts, speeds and commands of follower i behind the fronts, speeds and lengths of its leader."""
    family, memory, relaxation, need, a_0, drift, _ = scene.reactions[i]
    ahead, ahead_v, length = leader
    _, _, b, B, tau, every_L = parameters
    front, v, a = (np.empty_like(ahead) for _ in range(3))
    front[:, 0], v[:, 0] = start
    _, credit, v_credit = scene.joined if i == 0 else (0, 0.0, 0.0)
    jump, v_jump, dt = np.full(len(ahead), credit), np.full(len(ahead), v_credit), scene.dt
    for k in range(ahead.shape[1]):
        spacing, v_leader, now, L = ahead[:, k] - front[:, k], ahead_v[:, k], v[:, k], every_L[:, k]
        joins = (k == inserted) & (i == 0) & (relaxation > 0)
        if joins.any():
            wanted = L + now * tau
            if family == 1:
                wanted = np.maximum(now**2 / (2 * b) - v_leader**2 / (2 * B) + now * tau + L, L)
            had = np.minimum(scene.target_front[k] - front[:, k], 2 * wanted)
            alone = np.isinf(scene.target_front[k])
            jump = np.where(joins, np.maximum((wanted if alone else had) - spacing, 0), jump)
            v_jump = np.where(joins, 0.0 if alone else scene.target_v[k] - v_leader, v_jump)
        share = np.maximum(1 - (k - inserted) * dt / relaxation, 0) if relaxation > 0 else 0.0
        seen, v_seen = spacing + share * jump, np.maximum(v_leader + share * v_jump, 0)
        m = np.exp(-(scene.clock + k * dt) / memory) if memory > 0 else 0.0
        wish = command(int(family), now, seen, v_seen, length[:, k], (*parameters[:5], L)) + drift
        wish = m * a_0 + (1 - m) * wish
        required = np.maximum(now - v_leader, 0) ** 2 / (2 * np.maximum(spacing - length[:, k] - 1.0, 0.1))
        wish = np.where(required > need, np.minimum(wish, -required), wish)
        a[:, k] = np.maximum(wish, -scene.hardest)
        if k + 1 < ahead.shape[1]:
            v[:, k + 1] = np.maximum(now + a[:, k] * dt, 0.0)
            front[:, k + 1] = front[:, k] + v[:, k + 1] * dt
    return front, v, a


def _follow(ahead: FloatArray, ahead_v: FloatArray, start: tuple, parameters: tuple, scene: PackedScene) -> tuple:
    """Fronts, speeds and commands of an LCM driver behind the given fronts and speeds."""
    front, v, a = (np.empty_like(ahead) for _ in range(3))
    dt = scene.dt
    front[:, 0], v[:, 0] = start
    for k in range(ahead.shape[1]):
        a[:, k] = lcm(v[:, k], ahead[:, k] - front[:, k], ahead_v[:, k], parameters, scene.hardest)
        if k + 1 < ahead.shape[1]:
            v[:, k + 1] = np.maximum(v[:, k] + a[:, k] * dt, 0.0)
            front[:, k + 1] = front[:, k] + v[:, k + 1] * dt
    return front, v, a


def _obstacles(n: IntArray, av: tuple, followers: list[FloatArray], scene: PackedScene) -> Iterator[tuple]:
    """Every obstacle's centre, semi-axes and the last sample at which it counts, in the order of the roles."""
    x, vx, _, _ = av
    always = np.full(len(n), x.shape[1] - 1)
    for i in range(len(scene.leader_a)):
        yield scene.leader_x[i], scene.leader_y[i], scene.leader_a[i], scene.leader_b[i], always
    for i, centre in enumerate(followers):
        yield centre, scene.follower_y[i], scene.follower_a[i], scene.follower_b[i], always
    if len(scene.origin_follower):
        x0, y0, v0, length, a, b = scene.origin_follower
        start = x0 + length / 2, v0
        front, _, _ = _follow(x + scene.length / 2, vx, start, tuple(TABLE3_MEANS.as_array()), scene)
        yield front - length / 2, y0, a, b, crossing_samples(n, scene)


def _asked(code: int, scene: PackedScene) -> tuple[int, int]:
    """When a contact is asked for, which decides between two at the same sample: vehicle by vehicle, foremost
    first; of a follower, whom it drives through before its ellipse.
    """
    count = len(scene.leader_a) + len(scene.follower_x) + (len(scene.origin_follower) > 0)
    kind, vehicle = divmod(code, count)
    return vehicle, {0: 2, 1: 1, 2: 0, 3: 3}[kind]


def _contacts(n: IntArray, av: tuple, followers: list[FloatArray], scene: PackedScene) -> dict[int, IntArray]:
    """First sample on the way to which the AV's ellipse meets another, by whose it is."""
    x, vx, y, vy = av
    heading = np.where(vy == 0.0, 0.0, np.arctan2(vy, vx))
    r, k = scene.rear_to_centre, np.arange(x.shape[1])
    firsts = {}
    for who, (other_x, other_y, a, b, last) in enumerate(_obstacles(n, av, followers, scene)):
        dx = other_x - x + r * (1 - np.cos(heading))
        dy = other_y - y - r * np.sin(heading)
        # A bound on the distance: nobody moves more than 4 m nearer within a sample.
        near = (np.hypot(dx, dy) < scene.a + a + 4.0 + scene.safety.clearance) & (k <= last[:, None])
        row, at = np.nonzero(near)
        before = np.maximum(at - 1, 0)
        way = dx[row, before], dy[row, before], dx[row, at], dy[row, at]
        met = swept_clearance(*way, heading[row, at], scene.a, scene.b, a, b) < scene.safety.clearance
        first = np.full(len(n), NO_CONTACT)
        np.minimum.at(first, row[met], at[met])
        firsts[who] = first
    return firsts


def _through(
    n: IntArray, front: FloatArray, followers: list[FloatArray], scene: PackedScene
) -> dict[int, IntArray]:
    """First sample at which a front is past the rear ahead of it, by the numbers of ``contact_words``."""
    leaders, k = len(scene.leader_a), np.arange(front.shape[1])
    count = leaders + len(followers) + (len(scene.origin_follower) > 0)
    inside = k >= crossing_samples(n, scene)[:, None]
    fronts = [x + length / 2 for x, length in zip(followers, scene.follower_length, strict=True)]
    rear = scene.target_front - scene.target_length
    pairs = [(3 * count + leaders - 1, rear, front, inside), (count + leaders, rear, fronts[0], ~inside)]
    pairs.append((2 * count + leaders, front - scene.length, fronts[0], inside))
    pairs += [
        (count + leaders + i, fronts[i - 1] - scene.follower_length[i - 1], fronts[i], inside | True)
        for i in range(1, len(fronts))
    ]
    past = {who: counts & (behind > rears) for who, rears, behind, counts in pairs}
    return {who: np.where(at.any(axis=1), at.argmax(axis=1), NO_CONTACT) for who, at in past.items()}


def swept_clearance(x0, y0, x1, y1, heading, a1, b1, a2, b2):
    """Smallest distance of two ellipses on the straight way: best of 24 directions, then golden section."""

    def separation(angle):
        nearest = np.minimum(x0 * np.cos(angle) + y0 * np.sin(angle), x1 * np.cos(angle) + y1 * np.sin(angle))
        own = np.hypot(a1 * np.cos(angle - heading), b1 * np.sin(angle - heading))
        return nearest - own - np.hypot(a2 * np.cos(angle), b2 * np.sin(angle))

    step = 2 * np.pi / DIRECTIONS
    angle = np.arctan2(y1, x1)
    best = separation(angle)
    for i in range(DIRECTIONS):
        value = separation(np.full_like(best, i * step))
        angle, best = np.where(value > best, i * step, angle), np.maximum(value, best)
    left, right = angle - step, angle + step
    one, two = left + GOLDEN * (right - left), right - GOLDEN * (right - left)
    at_one, at_two = separation(one), separation(two)
    for _ in range(40):
        lower = at_one > at_two
        left, right = np.where(lower, left, one), np.where(lower, two, right)
        new = np.where(lower, left + GOLDEN * (right - left), right - GOLDEN * (right - left))
        value = separation(new)
        one, two = np.where(lower, new, two), np.where(lower, one, new)
        at_one, at_two = np.where(lower, value, at_two), np.where(lower, at_one, value)
    return np.maximum(best, np.maximum(at_one, at_two))
