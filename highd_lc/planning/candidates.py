"""Losses and first contact of many candidate plans at once: the planner's hot kernel.

One row holds candidates of the same duration. They are simulated in tiles with the candidate as the innermost
axis, so that LLVM vectorises the LCM. Everything that all candidates of a row share (the lateral motion, hence
the lateral separation from everybody) is computed once per sample.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.core.drive import (
    IDM,
    LCM,
    UNBOUNDED,
    advance,
    bounded,
    credited,
    family_command,
    follower_command,
    in_need,
    intended,
    jump,
    remembered,
)
from highd_lc.core.kernels import UNALIASED, kernel, plain
from highd_lc.core.losses import LossTerms, charged
from highd_lc.core.quintic import reaches
from highd_lc.planning.candidates_av import drive_av
from highd_lc.planning.contacts import (
    CHANGE,
    COMMAND,
    DELTA,
    FRONT,
    JUMP,
    NEAREST,
    NO_CONTACT,
    SPEED,
    STATE_ROWS,
    TO_H,
    TO_T,
    V_JUMP,
    WIDTH,
    drive_through,
    lateral_motion,
    meet_ahead,
    meet_follower,
    meet_leaders,
    meet_origin_follower,
)
from highd_lc.planning.crowd import Crowd, own_crowd, together
from highd_lc.planning.safety import keep_ahead, keep_apart, keep_behind, starts_critically
from highd_lc.planning.scene import FAMILY, MOMENT, PackedScene, Scene
from highd_lc.vocab.sections import LossSettings

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class Outcomes(NamedTuple):
    """Losses of candidates, each of shape (rows, candidates): of the AV and the followers charged to T and to H.

    contact: first sample at which ellipses overlap or somebody is past its leader's rear (NO_CONTACT if none);
    role: which contact that is (see ``contacts.contact_words``). unsafe: 1 + index in ``limits.SAFETY`` of what a
    safety profile asks in vain, 0: nothing.
    """

    av_T: FloatArray
    av_H: FloatArray
    hv_T: FloatArray
    hv_H: FloatArray
    contact: IntArray
    role: IntArray
    unsafe: IntArray


def loss_terms(scene: Scene, weights: FloatArray, settings: LossSettings) -> LossTerms:
    """The terms under the settings' reference and aggregation. weights: of equation 17, shape (p,)."""
    p = len(weights)
    own = settings.reference == "own"
    return LossTerms(
        av_ref=scene.v0 if own else settings.v_ref_av,
        hv_ref=scene.followers.v.copy() if own else np.full(p, settings.v_ref_hv),
        one_sided=settings.reference == "one-sided",
        comfort=0.5 / settings.comfort_scale,
        efficiency=0.5 / settings.efficiency_scale,
        weights=weights if settings.aggregation == "weighted" else np.ones(p),
    )


def evaluate(
    n: IntArray,
    delta: FloatArray,
    change: FloatArray,
    scene: PackedScene,
    terms: LossTerms,
    crowd: Crowd | None = None,
) -> Outcomes:
    """Simulate candidate plans.

    n: samples of each row's duration (T = n dt), shape (rows,), each below len(scene.target_v). delta:
    x_final - v0 T [m], change: v_end - v0 [m/s], shape (rows, candidates). crowd: who the followers may be; None:
    those of the scene. Their losses are what the crowd makes of its draws, contacts those of the first
    draw, or of any.
    """
    outcomes = new_outcomes(delta.shape)
    evaluate_into(
        plain(n, np.int64), plain(delta), plain(change), scene, crowd or own_crowd(scene), terms, outcomes
    )
    return outcomes


def new_outcomes(shape: tuple[int, ...]) -> Outcomes:
    """Room for the outcomes of candidates in an array of that shape."""
    av_T, av_H, hv_T, hv_H = (np.empty(shape) for _ in range(4))
    contact, role, unsafe = (np.empty(shape, np.int64) for _ in range(3))
    return Outcomes(av_T, av_H, hv_T, hv_H, contact, role, unsafe)


@kernel(**UNALIASED)
def evaluate_into(
    n: IntArray,
    delta: FloatArray,
    change: FloatArray,
    scene: PackedScene,
    crowd: Crowd,
    terms: LossTerms,
    out: Outcomes,
) -> None:
    """Fill the outcomes of candidates (see ``evaluate``)."""
    samples, leaders = len(scene.target_v), len(scene.leader_a)
    roles = leaders + len(scene.follower_x) + (1 if len(scene.origin_follower) else 0)
    av_front, av_v = np.empty(samples * WIDTH), np.empty(samples * WIDTH)
    ahead, own, ahead_v = np.empty(samples * WIDTH), np.empty(samples * WIDTH), np.empty(samples * WIDTH)
    state = np.empty(STATE_ROWS * WIDTH)
    y, vy, reach = np.empty(samples), np.empty(samples), np.empty(samples)
    contact, role, unsafe = np.empty(WIDTH, np.int64), np.empty(WIDTH, np.int64), np.empty(WIDTH, np.int64)
    critical = 1 if starts_critically(scene) else 0
    each_T, each_H = np.empty((len(crowd.first_L), WIDTH)), np.empty((len(crowd.first_L), WIDTH))
    rear = scene.target_front - scene.target_length
    behind_leader = scene.asks_all and np.isfinite(rear[0])
    for row in range(len(n)):
        width, crossing = delta.shape[1], reaches(0.5, n[row], scene.dt, scene.D, scene.start)
        for first in range(0, width, WIDTH):
            used = min(WIDTH, width - first)
            for w in range(WIDTH):
                at = first + min(w, used - 1)
                state[DELTA * WIDTH + w], state[CHANGE * WIDTH + w] = delta[row, at], change[row, at]
                contact[w], role[w], unsafe[w] = NO_CONTACT, -1, critical
            drive_av(n[row], state, scene, terms, av_front, av_v)
            for w in range(used):
                out.av_T[row, first + w] = state[TO_T * WIDTH + w]
                out.av_H[row, first + w] = state[TO_H * WIDTH + w]
            lateral_motion(n[row], state, scene, y, vy, reach)
            meet_leaders(n[row], scene, av_front, av_v, y, vy, reach, contact, role)
            if scene.safety.asked:
                keep_ahead(n[row], crossing, state, scene, av_front, av_v, unsafe)
            if behind_leader:
                drive_through(crossing, samples, 3 * roles + leaders - 1, rear, state, av_front, contact, role)
            for draw in range(len(crowd.first_L)):
                insertion = int(crowd.joined[draw, 0])
                if insertion > 0:
                    insertion = reaches(crowd.reactions[draw, 0, MOMENT], n[row], scene.dt, scene.D, scene.start)
                for k in range(insertion):
                    ahead[k * WIDTH : (k + 1) * WIDTH] = scene.target_front[k]
                    ahead_v[k * WIDTH : (k + 1) * WIDTH] = scene.target_v[k]
                since = max(insertion, 0) * WIDTH
                ahead[since:], ahead_v[since:] = av_front[since:], av_v[since:]
                each_T[draw], each_H[draw] = 0.0, 0.0
                for i in range(len(scene.follower_x)):
                    moments = (insertion, crossing)
                    _drive_follower(i, n[row], moments, state, scene, crowd, draw, terms, ahead, ahead_v, own)
                    for w in range(used):
                        each_T[draw, w] += terms.weights[i] * state[TO_T * WIDTH + w]
                        each_H[draw, w] += terms.weights[i] * state[TO_H * WIDTH + w]
                    asks = draw == 0 or crowd.rejects_all
                    if asks and scene.safety.asked and i == 0:
                        keep_behind(crossing, state, scene, av_front, av_v, own, ahead_v, unsafe)
                    if asks and scene.asks_all:
                        if scene.safety.asked and i > 0:
                            keep_apart(scene.follower_length[i - 1], state, scene, unsafe)
                        who = (1 if i else 2) * roles + leaders + i
                        length = scene.follower_length[i - 1] if i else scene.length
                        looked, asked = (0, False) if i else (crossing, insertion > crossing)
                        meet_ahead(who, looked, asked, length, state, ahead if i else av_front, own, contact, role)
                    if asks and behind_leader and i == 0:
                        drive_through(0, crossing, roles + leaders, rear, state, own, contact, role)
                    if asks:
                        meet_follower(i, n[row], scene, av_front, av_v, y, vy, reach, own, contact, role)
                    ahead, own = own, ahead
            for w in range(used):
                out.hv_T[row, first + w] = together(each_T[:, w], crowd.worst)
                out.hv_H[row, first + w] = together(each_H[:, w], crowd.worst)
            if len(scene.origin_follower):
                meet_origin_follower(crossing, state, scene, av_front, av_v, y, vy, reach, own, contact, role)
            for w in range(used):
                out.contact[row, first + w], out.role[row, first + w] = contact[w], role[w]
                out.unsafe[row, first + w] = unsafe[w]


@njit(inline="always")
def _step(
    k: int,
    w: int,
    a: float,
    spacing: float,
    counted: float,
    efficiency: float,
    ref: float,
    both_sides: float,
    dt: float,
    state: FloatArray,
    speed: FloatArray,
    own: FloatArray,
) -> None:
    """Charge candidate w's follower for its command at sample k, and move it."""
    x, v = state[FRONT * WIDTH + w], state[SPEED * WIDTH + w]
    step = abs(a - state[COMMAND * WIDTH + w])
    state[TO_H * WIDTH + w] = charged(state[TO_H * WIDTH + w], step, v, ref, counted, efficiency, both_sides)
    state[NEAREST * WIDTH + w] = min(state[NEAREST * WIDTH + w], spacing)
    own[k * WIDTH + w], speed[k * WIDTH + w] = x, v
    later, faster = advance(x, v, a, dt)
    state[FRONT * WIDTH + w], state[SPEED * WIDTH + w], state[COMMAND * WIDTH + w] = later, faster, a


@njit(inline="always")
def _drive_all_the_way(
    family: int,
    reacts: bool,
    i: int,
    n: int,
    moments: tuple[int, int],
    state: FloatArray,
    scene: PackedScene,
    crowd: Crowd,
    draw: int,
    terms: LossTerms,
    ahead: FloatArray,
    speed: FloatArray,
    own: FloatArray,
) -> None:
    """See ``_driving``. family, reacts: constants where this is inlined."""
    dt, hardest, leader_length = scene.dt, scene.hardest, scene.follower_length[i - 1] if i else scene.length
    v_desire, A, b, B, tau, L_replay = crowd.parameters[draw, i]
    _, memory, relaxation, need, a_0, drift, _ = crowd.reactions[draw, i]
    comfort, efficiency, ref = terms.comfort, terms.efficiency, terms.hv_ref[i]
    both_sides = 0.0 if terms.one_sided else 1.0
    insertion, joined = (0, 0) if i else moments
    credit_0, v_credit_0 = (0.0, 0.0) if i else (crowd.joined[draw, 1], crowd.joined[draw, 2])
    # A product in the place of an exponential a sample, which would cost a tenth of the whole.
    m, kept = remembered(scene.clock, memory), remembered(dt, memory)
    for w in range(WIDTH):
        state[TO_H * WIDTH + w] = 0.0
        state[FRONT * WIDTH + w] = scene.follower_x[i] + scene.follower_length[i] / 2.0
        state[SPEED * WIDTH + w] = scene.follower_v[i]
        state[COMMAND * WIDTH + w] = 0.0
        state[NEAREST * WIDTH + w] = np.inf
        state[JUMP * WIDTH + w], state[V_JUMP * WIDTH + w] = credit_0, v_credit_0
    for k in range(len(scene.target_v)):
        L, length = (L_replay, leader_length) if k >= insertion else (crowd.first_L[draw], scene.target_length)
        if k == joined:
            state[NEAREST * WIDTH : (NEAREST + 1) * WIDTH] = np.inf
        if reacts and k == insertion and relaxation > 0.0 and i == 0:
            for w in range(WIDTH):
                x, v = state[FRONT * WIDTH + w], state[SPEED * WIDTH + w]
                state[JUMP * WIDTH + w], state[V_JUMP * WIDTH + w] = jump(
                    family, v, ahead[k * WIDTH + w] - x, speed[k * WIDTH + w],
                    scene.target_front[k] - x, scene.target_v[k], b, B, tau, L,
                )  # fmt: skip
        share = credited((k - insertion) * dt, relaxation) if reacts else 0.0
        counted = comfort / dt if k > 0 else 0.0
        # What is credited of a jump costs a tenth, and mostly there is nothing.
        if share > 0.0:
            for w in range(WIDTH):
                v, v_leader = state[SPEED * WIDTH + w], speed[k * WIDTH + w]
                spacing = ahead[k * WIDTH + w] - state[FRONT * WIDTH + w]
                a = follower_command(
                    family, v, spacing, v_leader, length, v_desire, A, b, B, tau, L,
                    share * state[JUMP * WIDTH + w], share * state[V_JUMP * WIDTH + w], m, a_0, drift, need,
                    hardest,
                )  # fmt: skip
                _step(k, w, a, spacing, counted, efficiency, ref, both_sides, dt, state, speed, own)
        else:
            for w in range(WIDTH):
                v, v_leader = state[SPEED * WIDTH + w], speed[k * WIDTH + w]
                spacing = ahead[k * WIDTH + w] - state[FRONT * WIDTH + w]
                a = family_command(family, v, spacing, v_leader, length, v_desire, A, b, B, tau, L)
                if reacts:
                    a = in_need(intended(a, a_0, m, drift), spacing - length, v - v_leader, need)
                a = bounded(a, hardest)
                _step(k, w, a, spacing, counted, efficiency, ref, both_sides, dt, state, speed, own)
        m *= kept
        if k == n:
            for w in range(WIDTH):
                state[TO_T * WIDTH + w] = state[TO_H * WIDTH + w]


def _driving(family: int, reacts: bool) -> Any:
    """The kernel of followers of a family, bare or reacting, with a machine code of its own; of a family below 0
    by whatever command is theirs.

    It fills the fronts of follower i, behind the fronts ahead and their speeds, which its own replace. moments:
    samples from which the first one has the AV as leader, and of the AV's crossing. In the scratch: its losses,
    and its smallest spacing to whom it follows (to the AV: from the crossing on).
    """

    @kernel(error_model="numpy", **UNALIASED)
    def drive(
        i: int,
        n: int,
        moments: tuple[int, int],
        state: FloatArray,
        scene: PackedScene,
        crowd: Crowd,
        draw: int,
        terms: LossTerms,
        ahead: FloatArray,
        speed: FloatArray,
        own: FloatArray,
    ) -> None:
        code = family if family >= 0 else int(crowd.reactions[draw, i, FAMILY])
        _drive_all_the_way(code, reacts, i, n, moments, state, scene, crowd, draw, terms, ahead, speed, own)

    return drive


_drive_bare_lcm, _drive_lcm, _drive_idm = _driving(LCM, False), _driving(LCM, True), _driving(IDM, True)
_drive_any = _driving(-1, True)


@kernel()
def _drive_follower(
    i: int,
    n: int,
    moments: tuple[int, int],
    state: FloatArray,
    scene: PackedScene,
    crowd: Crowd,
    draw: int,
    terms: LossTerms,
    ahead: FloatArray,
    speed: FloatArray,
    own: FloatArray,
) -> None:
    """Follower i by its family (see ``_driving``)."""
    family, memory, relaxation, need, _, drift, _ = crowd.reactions[draw, i]
    bare = memory == 0.0 and drift == 0.0 and need == UNBOUNDED and (relaxation == 0.0 or i > 0)
    if family == LCM and bare:
        _drive_bare_lcm(i, n, moments, state, scene, crowd, draw, terms, ahead, speed, own)
    elif family == LCM:
        _drive_lcm(i, n, moments, state, scene, crowd, draw, terms, ahead, speed, own)
    elif family == IDM:
        _drive_idm(i, n, moments, state, scene, crowd, draw, terms, ahead, speed, own)
    else:
        _drive_any(i, n, moments, state, scene, crowd, draw, terms, ahead, speed, own)
