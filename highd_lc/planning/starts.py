"""The starts of an event: which moments and gaps are open to the AV, and the search that each of them poses.

Waiting before a lane change: what happens until the AV starts, in which gap it then goes, what is charged.

Until it starts the AV keeps its lane, and the followers stay behind the target leader by their models. Both can be
simulated once, for they do not depend on the plan. So a delay d makes an event a later one, with the states at
t_start + d as its start: the planner's kernels search it as any other, and the losses charged before d are added.

Sample d belongs to the manoeuvre. Steps of a commanded acceleration at the joint are not counted where a motion is
handed over (the AV's from waiting to the quintic, that of the follower who gets a new leader), as at t_start of a
change without delay (equations.md 4); those of the other followers are.

The gaps on the target lane into which an AV that waits may go, each as a scene of its own at every delay.

Who leads and who follows the AV depends on the gap: behind HV_g, that one leads, by LCM behind the target leader
and untouched by the AV, and HV_(g+1) .. HV_p follow. Ahead of the target leader, whose own leader is not among an
event's roles, the road is taken as free; the target leader then follows the AV by LCM (Table 3 means), and HV_1 ..
HV_p follow it. A target leader that leaves the lane has no gap ahead of it: behind the AV it might have stayed.
The gap behind HV_p is none: nobody knows who comes after it.

Every gap charges the same followers, HV_1 .. HV_p with their weights at t_start, those that the AV lets pass
included; nobody charges the target leader.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.drive import LCM
from highd_lc.core.ellipse import ellipses_overlap
from highd_lc.core.kernels import kernel
from highd_lc.core.losses import Charge, LossTerms, charge, command_jerk
from highd_lc.planning.contacts import NO_CONTACT
from highd_lc.planning.later import Around, AvState, later_scene, own_lane
from highd_lc.planning.limits import limits_of
from highd_lc.planning.planner import PlanningProblem
from highd_lc.planning.pool import Before, Goal, Pool, Task
from highd_lc.planning.replay import (
    AvMotion,
    av_charge,
    drive_on,
    follow,
    free_motion,
    origin_follower_motion,
)
from highd_lc.planning.scene import BARE_LCM, FAMILY, MOMENT, Motion, PackedScene, Scene, obstacle_count
from highd_lc.vocab import names
from highd_lc.vocab.driver import REPLAY_L_BOUNDS, TABLE3_MEANS

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Waiting:
    """Everybody while the AV keeps its lane, over the samples 0 .. N.

    av: its motion (n = 0). x, v, a: of the p followers behind the target leader, shape (p, N + 1): box centre [m],
    speed [m/s], commanded acceleration [m/s^2]. origin_x, origin_v: of the origin follower behind the AV, shape
    (N + 1,), or empty. contact: first sample at which the AV's ellipse overlaps another's, or a follower has
    driven through the vehicle ahead; NO_CONTACT if none.
    """

    av: AvMotion
    x: FloatArray
    v: FloatArray
    a: FloatArray
    origin_x: FloatArray
    origin_v: FloatArray
    contact: int


class ChainContact(NamedTuple):
    """First sample at which one of the followers, undisturbed, has driven through the vehicle ahead, and which one
    (0 = nearest to the AV).
    """

    sample: int
    follower: int


NEVER: Final = ChainContact(NO_CONTACT, -1)


@dataclass(frozen=True)
class WaitingLosses:
    """Losses while the AV waits, aggregated: av_before, hv_before (N + 1,): charged to the samples before k;
    hv_passed (N + 1,): charged over 0 .. k to the followers that the AV lets pass.
    """

    av_before: FloatArray
    hv_before: FloatArray
    hv_passed: FloatArray


def wait(scene: Scene, packed: PackedScene, *, behind_leader: bool) -> Waiting:
    """Let the AV keep its lane: at constant speed, or by LCM (Table 3 means) behind the origin leader.

    packed: the scene's arrays.
    """
    samples, av = len(packed.target_v), free_motion(packed)
    lane = own_lane(packed, scene.origin_leader)._replace(after_lcm=behind_leader)
    drive_on(av.x, av.y, av.vx, av.ax, av.jerk, 0, lane)
    x, v, a = (np.empty((len(packed.follower_x), samples)) for _ in range(3))
    follow(av.x, av.vx, samples, packed, x, v, a)
    origin_x, origin_v = np.empty(0), np.empty(0)
    if len(packed.origin_follower):
        origin_x = origin_follower_motion(av.x + packed.length / 2.0, av.vx, samples - 1, packed)
        origin_v = np.append(packed.origin_follower[2], np.diff(origin_x) / packed.dt)
    contact = min(int(_first_contact(av.x, x, origin_x, packed)), chain_contact(x, packed).sample)
    return Waiting(av, x, v, a, origin_x, origin_v, contact)


def chain_contact(x: FloatArray, packed: PackedScene) -> ChainContact:
    """The first contact of the nearest q followers, box centres x (q, N + 1) [m], behind the target leader."""
    if not packed.asks_all:
        return NEVER
    half = packed.follower_length[: len(x), None] / 2.0
    rears = np.vstack([packed.target_front - packed.target_length, x - half])
    through = x + half > rears[:-1]
    samples = np.where(through.any(axis=1), through.argmax(axis=1), NO_CONTACT)
    first = int(np.argmin(samples))
    return ChainContact(int(samples[first]), first) if samples[first] < NO_CONTACT else NEVER


@kernel(error_model="numpy")
def _first_contact(x: FloatArray, follower_x: FloatArray, origin_x: FloatArray, scene: PackedScene) -> int:
    """First sample at which the AV, at x [m] on its lane, overlaps a leader, a follower or the origin follower."""
    near = scene.safety.clearance
    for k in range(len(x)):
        for i in range(len(scene.leader_a)):
            dx, dy = scene.leader_x[i, k] - x[k], scene.leader_y[i, k]
            if ellipses_overlap(dx, dy, 1.0, 0.0, scene.a, scene.b, scene.leader_a[i], scene.leader_b[i], near):
                return k
        for i in range(len(scene.follower_a)):
            dx, dy = follower_x[i, k] - x[k], scene.follower_y[i]
            if ellipses_overlap(
                dx, dy, 1.0, 0.0, scene.a, scene.b, scene.follower_a[i], scene.follower_b[i], near
            ):
                return k
        if len(origin_x):
            of = scene.origin_follower
            if ellipses_overlap(origin_x[k] - x[k], of[1], 1.0, 0.0, scene.a, scene.b, of[4], of[5], near):
                return k
    return NO_CONTACT


def waiting_losses(
    waiting: Waiting, terms: LossTerms, dt: float, *, passed: int, counts_insertion: bool
) -> WaitingLosses:
    """What the AV and the followers are charged beside the manoeuvre.

    passed: number of followers that the AV lets pass; counts_insertion: whether the next one's step of the command
    at the start counts as well (it does while that one keeps its leader until the crossing, or if nobody of the
    followers gets a new one).
    """
    each = charge(waiting.v, command_jerk(waiting.a, dt), terms.hv_ref[:, None], terms)
    # The step onto the sample of the start comes from before the manoeuvre.
    before = Charge(each.comfort[passed:], _before(each.efficiency[passed:]))
    if len(before.comfort) and not counts_insertion:
        before.comfort[0] = _before(before.comfort[0])
    return WaitingLosses(
        av_before=_before(av_charge(waiting.av, terms).loss),
        hv_before=terms.weights[passed:] @ before.loss,
        hv_passed=terms.weights[:passed] @ each.loss[:passed],
    )


def _before(charged: FloatArray) -> FloatArray:
    """From what is charged over 0 .. t_k what is charged to the samples before each, along the last axis."""
    before = np.zeros(charged.shape)
    before[..., 1:] = charged[..., :-1]
    return before


@dataclass(frozen=True)
class Gap:
    """A gap, as the scene that it makes of the event at t_start.

    scene: with the gap's leader as target leader, the vehicles that the AV leaves ahead among the leaders, and the
    vehicles behind the gap as followers; terms: theirs. x, v, a: undisturbed motion of these q followers, shape
    (q, N + 1). passed: followers of the event ahead of the gap; rows: slice of the event's followers among the q.
    charges: beside the manoeuvre; passed_contact: among those who pass. The obstacles keep the order of
    ``scene.obstacle_roles`` in every gap.
    """

    name: str
    scene: PackedScene
    terms: LossTerms
    x: FloatArray
    v: FloatArray
    a: FloatArray
    passed: int
    rows: slice
    charges: WaitingLosses
    passed_contact: ChainContact = NEVER

    def opens(self, waiting: Waiting) -> NDArray[np.bool_]:
        """At which samples the AV may start for this gap: its front lies ahead of the follower's, shape (N + 1,).

        A follower behind LCM brakes without measure for a leader whose front is behind its own.
        """
        front = waiting.av.x + self.scene.length / 2.0
        ahead: NDArray[np.bool_] = front > self.x[0] + self.scene.follower_length[0] / 2.0
        return ahead

    def delayed(self, d: int, waiting: Waiting) -> PackedScene:
        """The gap's scene with sample d of the event as its t_start and the AV's place there as its origin."""
        origin = None
        if len(self.scene.origin_follower):
            origin = float(waiting.origin_x[d]), float(waiting.origin_v[d])
        av = AvState(float(waiting.av.x[d]), float(waiting.av.vx[d]))
        return later_scene(self.scene, d, av, Around(self.x[:, d], self.v[:, d], origin))


def find_gaps(scene: Scene, packed: PackedScene, terms: LossTerms, waiting: Waiting) -> list[Gap]:
    """The gaps of an event, the recorded one first. packed, terms: of the scene; waiting: in it."""
    found = [_recorded(packed, terms, waiting)]
    found += [_behind(g, packed, terms, waiting) for g in range(1, len(packed.follower_x))]
    if scene.target_leader is not None and not scene.next_leaders:
        found.append(_ahead(scene.target_leader, packed, terms, waiting))
    return found


def _recorded(packed: PackedScene, terms: LossTerms, waiting: Waiting) -> Gap:
    own = waiting_losses(waiting, terms, packed.dt, passed=0, counts_insertion=_waits(packed, 0))
    return Gap(names.RECORDED_GAP, packed, terms, waiting.x, waiting.v, waiting.a, 0, slice(None), own)


def _waits(packed: PackedScene, follower: int) -> bool:
    """Whether a follower keeps its leader beyond the start of the AV's manoeuvre."""
    return bool(packed.reactions[follower, MOMENT] > 0.0)


def _behind(g: int, packed: PackedScene, terms: LossTerms, waiting: Waiting) -> Gap:
    """The gap behind HV_g, g >= 1."""
    level = np.repeat(packed.follower_y[:g, None], len(packed.target_v), axis=1)
    parameters, length = packed.parameters[g:].copy(), float(packed.follower_length[g - 1])
    # A fitted spacing belongs to a leader's length: moved from HV_g's to the AV's (equations.md 3). Gaps do not.
    if packed.reactions[g, FAMILY] == LCM:
        parameters[0, 5] = np.clip(parameters[0, 5] - length + packed.length, *REPLAY_L_BOUNDS)
    scene = packed._replace(
        target_front=waiting.x[g - 1] + length / 2.0,
        target_v=waiting.v[g - 1].copy(),
        target_length=length,
        leader_x=np.concatenate([packed.leader_x, waiting.x[:g]]),
        leader_y=np.concatenate([packed.leader_y, level]),
        leader_a=np.concatenate([packed.leader_a, packed.follower_a[:g]]),
        leader_b=np.concatenate([packed.leader_b, packed.follower_b[:g]]),
        follower_x=packed.follower_x[g:].copy(),
        follower_y=packed.follower_y[g:].copy(),
        follower_v=packed.follower_v[g:].copy(),
        follower_length=packed.follower_length[g:].copy(),
        follower_a=packed.follower_a[g:].copy(),
        follower_b=packed.follower_b[g:].copy(),
        parameters=parameters,
        reactions=packed.reactions[g:].copy(),
        first_L=float(packed.parameters[g, 5]),
        weights=packed.weights[g:].copy(),
    )
    later = terms._replace(hv_ref=terms.hv_ref[g:].copy(), weights=terms.weights[g:].copy())
    own = waiting_losses(waiting, terms, packed.dt, passed=g, counts_insertion=_waits(packed, g))
    motion = (waiting.x[g:], waiting.v[g:], waiting.a[g:])
    met = chain_contact(waiting.x[:g], packed)
    return Gap(names.gap_behind(g), scene, later, *motion, g, slice(None), own, met)


def _ahead(leader: Motion, packed: PackedScene, terms: LossTerms, waiting: Waiting) -> Gap:
    """The gap ahead of the target leader, who becomes the first follower, without weight."""
    m, samples = len(packed.leader_a) - 1, len(packed.target_v)  # the target leader is the last of the leaders
    parameters = packed.parameters.copy()
    parameters[0, 5] = packed.first_L
    scene = packed._replace(
        target_front=np.full(samples, np.inf),
        target_v=np.zeros(samples),
        target_length=0.0,
        leader_x=packed.leader_x[:m].copy(),
        leader_y=packed.leader_y[:m].copy(),
        leader_a=packed.leader_a[:m].copy(),
        leader_b=packed.leader_b[:m].copy(),
        follower_x=np.append(leader.x[0], packed.follower_x),
        follower_y=np.append(leader.y[0], packed.follower_y),
        follower_v=np.append(leader.v[0], packed.follower_v),
        follower_length=np.append(leader.length, packed.follower_length),
        follower_a=np.append(packed.leader_a[m], packed.follower_a),
        follower_b=np.append(packed.leader_b[m], packed.follower_b),
        parameters=np.vstack([TABLE3_MEANS.as_array(), parameters]),
        # Nobody knows the target leader's ways: it minds the AV when HV_1 would.
        reactions=np.vstack([[*BARE_LCM, packed.reactions[0, MOMENT]], packed.reactions]),
        first_L=TABLE3_MEANS.L,
        weights=np.append(0.0, packed.weights),
    )
    ahead = terms._replace(hv_ref=np.append(terms.hv_ref[:1], terms.hv_ref), weights=np.append(0.0, terms.weights))
    own = waiting_losses(waiting, terms, packed.dt, passed=0, counts_insertion=True)
    motion = (
        np.vstack([leader.x, waiting.x]),
        np.vstack([leader.v, waiting.v]),
        np.vstack([leader.a, waiting.a]),
    )
    return Gap(names.GAP_AHEAD, scene, ahead, *motion, 0, slice(1, None), own)


def before(gap: Gap, d: int, latest: int) -> Before:
    """What a manoeuvre into the gap inherits when it starts at sample d and ends at sample ``latest`` at most."""
    own, scene = gap.charges, gap.scene
    past, roles = gap.passed_contact, obstacle_count(scene)
    # The first contact of those who pass lies at d or later: no start is open after one.
    contact = past.sample - d if past.sample < NO_CONTACT else NO_CONTACT
    role = roles + len(scene.leader_a) - gap.passed + past.follower if past.sample < NO_CONTACT else -1
    charged = float(own.av_before[d]), float(own.hv_before[d])
    return Before(*charged, own.hv_passed[d:], latest - d, contact, role)


IntArray = NDArray[np.int64]

Key = tuple[int, int]
"""A start: number of its gap, delay in samples."""
CONTAINED: Final = (0, 0)
"""The start of the policies without a choice: the recorded gap, no delay."""


@dataclass(frozen=True)
class StartProblem:
    """Every start of an event from sample ``earliest`` on: its gaps and the AV's waiting for them."""

    problem: PlanningProblem
    waiting: Waiting
    gaps: tuple[Gap, ...]
    earliest: int = 0

    @cached_property
    def latest(self) -> int:
        """The last sample at which a manoeuvre may end."""
        wanted = round(self.problem.settings.planner.latest_end_s / self.problem.packed.dt)
        return min(wanted, len(self.problem.packed.target_v) - 1)

    def delays(self, gap: int) -> IntArray:
        """The delays after which the AV may start for a gap [samples]: it has touched nobody, the gap is open."""
        planner, dt = self.problem.settings.planner, self.problem.packed.dt
        last = min(round(planner.max_delay_s / dt), self.latest - round(planner.T_min / dt))
        last = min(last, self.waiting.contact - 1) if self.waiting.contact < NO_CONTACT else last
        allowed = np.flatnonzero(self.gaps[gap].opens(self.waiting)[: max(last + 1, 0)])
        later: IntArray = allowed[allowed >= self.earliest]
        return later

    def task(self, key: Key) -> Task:
        """The search that a start poses."""
        gap, d = self.gaps[key[0]], key[1]
        scene = gap.delayed(d, self.waiting)
        settings = self.problem.settings
        limit = limits_of(scene.v0, settings, self.problem.scene.wheelbase)
        return Task(scene, gap.terms, limit, settings.search, before(gap, d, self.latest))


@dataclass(frozen=True)
class Best:
    """The best candidate of a goal: its start, its place in that start's pool, its objective."""

    key: Key
    index: int
    objective: float


def pose_starts(problem: PlanningProblem) -> StartProblem:
    """The starts of an event, with the AV's waiting under the settings."""
    behind_leader = problem.settings.planner.waiting == "lcm"
    waiting = wait(problem.scene, problem.packed, behind_leader=behind_leader)
    return StartProblem(problem, waiting, tuple(find_gaps(problem.scene, problem.packed, problem.terms, waiting)))


def best_of(pools: Mapping[Key, Pool], goal: Goal) -> Best | None:
    """The best candidate of all starts, the earliest start of equals; None if none is feasible."""
    found = [best for key, pool in pools.items() if (best := best_at(key, pool, goal)) is not None]
    return min(found, key=lambda best: (best.objective, best.key), default=None)


def best_at(key: Key, pool: Pool, goal: Goal) -> Best | None:
    """The best candidate of one start, the first of equals; None if none is feasible."""
    if not len(pool):
        return None
    value = pool.objective(goal)
    index = int(np.argmin(value))
    return Best(key, index, float(value[index])) if np.isfinite(value[index]) else None
