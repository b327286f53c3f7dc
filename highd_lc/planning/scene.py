"""Frozen containers of an event as arrays: what the planner reads and nothing else.

A scene as flat arrays for the compiled kernels, with the conventions of the replay settled.

Positions along the lane are those of the *front bumper* where spacings are formed (spacing = difference of
fronts), and of the box centre where ellipses are compared.
"""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.drive import LCM, family_code, hardest_braking
from highd_lc.core.ellipse import semi_axes
from highd_lc.core.kernels import plain
from highd_lc.core.losses import follower_weights
from highd_lc.core.quintic import AT_REST, StartState
from highd_lc.vocab import names
from highd_lc.vocab.driver import TABLE3_MEANS
from highd_lc.vocab.errors import UsageError
from highd_lc.vocab.settings import ValidateSettings

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """A vehicle's motion on the time grid of a scene, t_k = k dt, k = 0 .. N, and its size.

    x, y: box centre relative to the ego's centre at t_start [m]; v: forward speed [m/s]; a: forward
    acceleration [m/s^2]; all of shape (N + 1,). length, width [m]; observed: number of leading samples that
    were recorded, the rest is predicted.
    """

    x: FloatArray
    y: FloatArray
    v: FloatArray
    a: FloatArray
    length: float
    width: float
    observed: int


@dataclass(frozen=True)
class NextLeader:
    """Who leads the target lane from sample ``since`` on, after the leader before left it; None = nobody."""

    since: int
    motion: Motion | None


@dataclass(frozen=True)
class Human:
    """The ego's recorded motion on the time grid as long as it is in view, at least to T = duration, smoothed.

    x, y: box centre relative to t_start [m]; vx, vy [m/s]; ax, ay [m/s^2]; jx, jy [m/s^3]; all of shape
    (n + 1,). crossing: sample of the lane crossing. comfort_raw: jerk sum of the recorded accelerations over
    0 .. T, unsmoothed [m/s^3]. end: sample of T; None = the last one.
    """

    x: FloatArray
    y: FloatArray
    vx: FloatArray
    vy: FloatArray
    ax: FloatArray
    ay: FloatArray
    jx: FloatArray
    jy: FloatArray
    crossing: int
    comfort_raw: float
    end: int | None = None


@dataclass(frozen=True)
class Followers:
    """The p followers on the target lane at t_start, nearest first.

    x, y: box centres relative to the ego's centre [m], v: speed [m/s], length, width [m], each of shape (p,).
    parameters: LCM of each with L moved behind the AV (L_replay), shape (p, 6). L_no_change: L of the first
    one when it stays behind the target leader [m]. recorded: their motions, empty if nobody recorded them. spread:
    standard deviation of each parameter, 0 where unknown, shape (p, 6); None: of none.

    The rest says how they react (equations.md 3.10); left out, it leaves the bare model. family: of
    ``names.FAMILIES``, or the name of a command of one's own, whose parameters these are. memory, relaxation [s],
    need, a_0, drift [m/s^2], moment (share of the AV's lateral way from which it is the leader of who gets it):
    each of shape (p,); None or NaN: 0, an infinite need, the moment of the setting ``leader_from``.
    """

    x: FloatArray
    y: FloatArray
    v: FloatArray
    length: FloatArray
    width: FloatArray
    parameters: FloatArray
    L_no_change: float
    recorded: tuple[Motion, ...]
    spread: FloatArray | None = None
    family: str = names.LCM
    memory: FloatArray | None = None
    relaxation: FloatArray | None = None
    need: FloatArray | None = None
    a_0: FloatArray | None = None
    drift: FloatArray | None = None
    moment: FloatArray | None = None


@dataclass(frozen=True)
class Scene:
    """Everything the planner knows of one lane change, relative to the ego's box centre at t_start.

    v0: the ego's recorded speed at t_start [m/s]; a0: its recorded acceleration [m/s^2]; lateral_shift: D,
    left positive [m]; length, width, wheelbase of the ego [m]; dt: step of the time grid, horizon: H [s];
    target_leader, origin_leader, origin_follower: motions over 0 .. H, or None (the origin follower's matter at
    t_start). human: None where nobody recorded one. next_leaders: who leads the target lane when the target
    leader has left it, in the order of time.
    """

    event_id: str
    v0: float
    a0: float
    lateral_shift: float
    length: float
    width: float
    wheelbase: float
    dt: float
    horizon: float
    target_leader: Motion | None
    origin_leader: Motion | None
    origin_follower: Motion | None
    followers: Followers
    human: Human | None = None
    next_leaders: tuple[NextLeader, ...] = ()

    @property
    def samples(self) -> int:
        """Samples of the time grid, N + 1."""
        return round(self.horizon / self.dt) + 1

    @property
    def driver(self) -> Human:
        """The human's motion. Raises UsageError if nobody recorded one."""
        if self.human is None:
            raise UsageError(f"{self.event_id}: nobody recorded a human's lane change in this scene")
        return self.human


FAMILY, MEMORY, RELAXATION, NEED, A_0, DRIFT, MOMENT = range(7)
"""Columns of ``PackedScene.reactions``: ``core.drive.family_code``, then as in ``Followers``."""
BARE_LCM: Final = (float(LCM), 0.0, 0.0, np.inf, 0.0, 0.0)
"""Reactions of who is an LCM driver and nothing more, without the moment."""
MOMENT_OF: Final = {"start": 0.0, "crossing": 0.5}
"""The moment that a setting ``leader_from`` stands for."""
PAPER_SEMI_AXES = (2.5, 1.0)
"""C_a and C_b of the paper [m]; they do not contain the corners of its own 5 m x 2 m box (equations.md 10)."""


class SafetyLimits(NamedTuple):
    """What a safety profile asks in the kernels (equations.md 5.8).

    asked: whether it asks anything. clearance: margin between ellipses [m]. time_gap [s], drac [m/s^2]: of the AV
    and its new leader, of HV_1 and the AV. braking: asked of HV_1 at the start, at most [m/s^2], infinite = not
    asked; delay, left: its t_B and t_G [s]. v_max [m/s], acceleration [m/s^2], jerk [m/s^3]: the AV's after T.
    """

    asked: bool
    clearance: float
    time_gap: float
    drac: float
    braking: float
    delay: float
    left: float
    v_max: float
    acceleration: float
    jerk: float


NOTHING_ASKED: Final = SafetyLimits(False, 0.0, 0.0, *(np.inf,) * 2, 0.0, 0.0, *(np.inf,) * 3)


NOT_YET: Final = 1_000_000
"""Sample since which a follower has a leader whom it does not have."""


class Joined(NamedTuple):
    """Since when the first follower has had the AV as its leader: a sample of at most 0, or ``NOT_YET``.

    credit [m], v_credit [m/s]: what it credited of the change of leader then (``core.drive.jump``).
    """

    since: int
    credit: float
    v_credit: float


NOT_JOINED: Final = Joined(NOT_YET, 0.0, 0.0)


class PackedScene(NamedTuple):
    """Arrays of one scene. N + 1 samples, m leaders, p followers; lengths in m, speeds in m/s.

    v0, D, length, rear_to_centre, a, b: of the AV (D: y where it goes; a, b: semi-axes). start: its state beside
    v0 at sample 0, joined: since when it is followed, both of a manoeuvre under way. target_front, target_v,
    target_length: front, speed and length of who leads the target lane, infinite, 0 and 0 without one; a later
    leader's front is its rear plus the first one's length, so that gaps are right and L, which belongs to that
    length, stays right. leader_x, leader_y (m, N + 1), leader_a, leader_b (m,): the target leader is the last.
    follower_* (p,), parameters (p, 6), reactions (p, 7): how each turns them into a command, first_L: L of the
    first follower while it is behind the target leader. clock: how long before sample 0 everybody's memory began
    to fade [s]. origin_follower: x, y, v, length, a, b, or empty. av_parameters (6,). weights (p,). after_lcm:
    the AV's drive after T. counts_handover: whether the step of the AV's command onto that drive, from 0, is
    charged. hardest: bound of everybody's commanded braking [m/s^2]. asks_all: whether contacts between the
    others count as well. safety: what a safety profile asks beside, and how the AV is bounded after T.
    """

    v0: float
    D: float
    start: StartState
    joined: Joined
    length: float
    rear_to_centre: float
    a: float
    b: float
    dt: float
    target_front: FloatArray
    target_v: FloatArray
    target_length: float
    leader_x: FloatArray
    leader_y: FloatArray
    leader_a: FloatArray
    leader_b: FloatArray
    follower_x: FloatArray
    follower_y: FloatArray
    follower_v: FloatArray
    follower_length: FloatArray
    follower_a: FloatArray
    follower_b: FloatArray
    parameters: FloatArray
    reactions: FloatArray
    first_L: float
    clock: float
    origin_follower: FloatArray
    av_parameters: FloatArray
    weights: FloatArray
    after_lcm: bool
    counts_handover: bool
    hardest: float
    asks_all: bool
    safety: SafetyLimits


def safety_limits(settings: ValidateSettings) -> SafetyLimits:
    """What the settings' safety profile asks of an event."""
    safety, limit = settings.safety, settings.constraints
    if not safety.asked:
        return NOTHING_ASKED
    return SafetyLimits(
        asked=True,
        clearance=safety.clearance_m,
        time_gap=safety.time_gap_s,
        drac=safety.drac,
        braking=safety.braking or np.inf,
        delay=safety.braking_delay_s,
        left=safety.braking_gap_s,
        v_max=limit.v_max,
        acceleration=limit.acceleration,
        jerk=limit.jerk,
    )


def pack(scene: Scene, settings: ValidateSettings) -> PackedScene:
    """A scene under the settings' conventions, ready for the kernels."""
    paper = settings.constraints.ellipse == "paper"
    followers = scene.followers
    leaders = list(leaders_of(scene).values())
    samples = scene.samples
    axes = [_axes(le, wi, paper) for le, wi in zip(followers.length, followers.width, strict=True)]
    a, b = _axes(scene.length, scene.width, paper)
    front, speed = _front(scene, samples)
    return PackedScene(
        v0=scene.v0,
        D=scene.lateral_shift,
        start=AT_REST,
        joined=NOT_JOINED,
        length=scene.length,
        rear_to_centre=scene.wheelbase / 2.0,
        a=a,
        b=b,
        dt=scene.dt,
        target_front=front,
        target_v=speed,
        target_length=scene.target_leader.length if scene.target_leader is not None else 0.0,
        leader_x=_stack([m.x for m in leaders], samples),
        leader_y=_stack([m.y for m in leaders], samples),
        leader_a=np.array([_axes(m.length, m.width, paper)[0] for m in leaders]),
        leader_b=np.array([_axes(m.length, m.width, paper)[1] for m in leaders]),
        follower_x=plain(followers.x),
        follower_y=plain(followers.y),
        follower_v=plain(followers.v),
        follower_length=plain(followers.length),
        follower_a=np.array([one for one, _ in axes]),
        follower_b=np.array([two for _, two in axes]),
        parameters=plain(followers.parameters),
        reactions=_reactions(followers, MOMENT_OF[settings.planner.leader_from]),
        first_L=followers.L_no_change,
        clock=0.0,
        origin_follower=_origin_follower(scene.origin_follower, paper),
        av_parameters=TABLE3_MEANS.as_array(),
        weights=scene_weights(scene),
        after_lcm=settings.planner.after == "lcm",
        counts_handover=settings.loss.handover == "counted",
        hardest=hardest_braking(settings.followers.b_max),
        asks_all=settings.constraints.contacts == "all",
        safety=safety_limits(settings),
    )


def driven_by(packed: PackedScene, followers: Followers, settings: ValidateSettings) -> PackedScene:
    """The packed scene with the same followers driven otherwise."""
    return packed._replace(
        parameters=plain(followers.parameters),
        reactions=_reactions(followers, MOMENT_OF[settings.planner.leader_from]),
        first_L=followers.L_no_change,
    )


def _reactions(followers: Followers, moment: float) -> FloatArray:
    """How each follower reacts, shape (p, 7). moment: of those whose model has none of its own."""
    given = (
        followers.memory,
        followers.relaxation,
        followers.need,
        followers.a_0,
        followers.drift,
        followers.moment,
    )
    out = np.tile([*BARE_LCM, moment], (len(followers.x), 1))
    out[:, FAMILY] = family_code(followers.family)
    for column, values in enumerate(given, start=MEMORY):
        if values is not None:
            out[:, column] = np.where(np.isnan(values), out[:, column], values)
    return out


def scene_weights(scene: Scene) -> FloatArray:
    """The followers' weights of equation 17 from the recorded states at t_start, shape (p,)."""
    followers = scene.followers
    return follower_weights(followers.v, -followers.x + (scene.length - followers.length) / 2.0, scene.v0)


def obstacle_roles(scene: Scene) -> tuple[str, ...]:
    """Roles in the order in which the kernels number obstacles: leaders, followers, origin follower."""
    present = list(leaders_of(scene))
    chain = [names.target_follower(rank + 1) for rank in range(len(scene.followers.x))]
    last = [names.ORIGIN_FOLLOWER] if scene.origin_follower is not None else []
    return tuple(present + chain + last)


def leaders_of(scene: Scene) -> dict[str, Motion]:
    """The leaders of both lanes by role; the target leader is the last, after those that lead later."""
    later = [(names.target_leader(k + 2), one.motion) for k, one in enumerate(scene.next_leaders)]
    leaders = [(names.ORIGIN_LEADER, scene.origin_leader), *later, (names.TARGET_LEADER, scene.target_leader)]
    return {role: motion for role, motion in leaders if motion is not None}


def obstacle_count(scene: PackedScene) -> int:
    """How many obstacles the kernels number in a scene."""
    return len(scene.leader_a) + len(scene.follower_x) + (1 if len(scene.origin_follower) else 0)


def _axes(length: float, width: float, paper: bool) -> tuple[float, float]:
    return PAPER_SEMI_AXES if paper else semi_axes(float(length), float(width))


def _stack(rows: list[FloatArray], samples: int) -> FloatArray:
    return plain(rows) if rows else np.empty((0, samples))


def _front(scene: Scene, samples: int) -> tuple[FloatArray, FloatArray]:
    leader = scene.target_leader
    if leader is None:
        return np.full(samples, np.inf), np.zeros(samples)
    front, v = leader.x + leader.length / 2.0, leader.v.copy()
    for later in scene.next_leaders:
        front[later.since :], v[later.since :] = np.inf, 0.0
        if later.motion is not None:
            rear = later.motion.x - later.motion.length / 2.0
            front[later.since :] = rear[later.since :] + leader.length
            v[later.since :] = later.motion.v[later.since :]
    return front, v


def _origin_follower(motion: Motion | None, paper: bool) -> FloatArray:
    if motion is None:
        return np.empty(0)
    a, b = _axes(motion.length, motion.width, paper)
    return np.array([motion.x[0], motion.y[0], motion.v[0], motion.length, a, b])
