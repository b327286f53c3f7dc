"""Responses: recorded followers behind a lane changer, and the same followers simulated by a follower model.

Every model is one equation with constants of its own for each follower (equations.md 3.10):

    a = m a_0 + (1 - m) (command(v, s, v_leader) + drift),   m = exp(-t / memory)

and no weaker than the situation demands, once the deceleration required to avoid a contact passes ``need``.
command is 0 (``none``: nothing happens), the LCM's, the IDM's, or a function of somebody's own. memory 0,
relaxation 0, drift 0 and an infinite ``need`` leave the bare model. t counts from t_start, K samples of 0.1 s; R
responses lie side by side.

Folds of cross-fitting: where locations can be left out as well, a fold is a location; else a recording, or a few
of them. With fewer than ``LEAST_RECORDINGS`` recordings a fold is a block of time of one recording, and responses
within a minute of it teach it nothing.
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields
from typing import Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.core.car_following import Simulated as Simulated
from highd_lc.core.drive import IDM, LCM, advance, family_code, follower_command, jump
from highd_lc.core.kernels import UNALIASED, kernel, plain

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

TIME_STEP: Final = 0.1
"""Step of the responses' time grid [s]."""
HORIZON: Final = 8.0
"""Longest time after t_start that is judged [s]."""
SAMPLES: Final = round(HORIZON / TIME_STEP) + 1
HARDEST: Final = 9.0
"""Braking on a dry road, which no follower exceeds if nothing else is said [m/s^2]."""
NO_LEADER: Final = 1e9
"""Front of a leader that does not exist [m]."""
SERIES: Final = ("x", "v", "before_x", "before_v", "x_ahead", "v_ahead", "progress")
"""What ``Responses`` hold a value a sample of, and so the columns of the table."""
Family = str | NDArray[np.object_]
"""Of all responses, or of each of them, shape (R,)."""


class Behaviours(NamedTuple):
    """What each of R followers drives by, each of shape (R,): units of ``follower_models``.

    L_before, L: behind the target leader, and behind who it gets. moment: share of the lane changer's lateral way
    from which that one is its leader.
    """

    v_desire: FloatArray
    A: FloatArray
    b: FloatArray
    B: FloatArray
    tau: FloatArray
    L: FloatArray
    L_before: FloatArray
    memory: FloatArray
    relaxation: FloatArray
    need: FloatArray
    a_0: FloatArray
    drift: FloatArray
    moment: FloatArray

    def take(self, places: IntArray | BoolArray) -> "Behaviours":
        """Those of some of the followers."""
        return Behaviours(*(values[places] for values in self))


@dataclass(frozen=True)
class Responses:
    """R recorded followers from t_start on, K samples.

    x, v: front [m] and speed [m/s] as recorded, shape (K, R), good for the first ``n`` samples (R,): while both
    tracks are in view and the follower keeps its lane. before_x, before_v: front and speed of the leader until the
    change (x = ``NO_LEADER``: none), x_ahead, v_ahead: of who it gets as leader, shape (K, R); lengths (R,) [m].
    progress: share of the lane changer's lateral way, ascending, (K, R); 1 for who keeps its leader.
    a_0, a_lasting: recorded acceleration over the last 0.5 s and the last 2 s before t_start, drift: of the
    carriageway, without the event's vehicles [m/s^2]; time_gap: to the leader before t_start [s], NaN unless it
    was followed. truck, rank (R,). event, recording, location, time: which event (an index), recording, site, and
    time of t_start in the recording [s].
    """

    x: FloatArray
    v: FloatArray
    n: IntArray
    before_x: FloatArray
    before_v: FloatArray
    before_length: FloatArray
    x_ahead: FloatArray
    v_ahead: FloatArray
    ahead_length: FloatArray
    progress: FloatArray
    a_0: FloatArray
    a_lasting: FloatArray
    drift: FloatArray
    time_gap: FloatArray
    truck: BoolArray
    rank: IntArray
    event: IntArray
    recording: IntArray
    location: IntArray
    time: FloatArray

    def take(self, places: IntArray | BoolArray) -> "Responses":
        """Some of the responses."""
        chosen = {f.name: np.ascontiguousarray(getattr(self, f.name)[..., places]) for f in fields(self)}
        return Responses(**chosen)

    def __len__(self) -> int:
        return len(self.n)

    @property
    def seen(self) -> BoolArray:
        """Which samples are recorded, shape (K, R)."""
        return np.arange(len(self.x))[:, None] < self.n

    def joins(self, moment: FloatArray) -> IntArray:
        """First sample at which the lane changer has made that share of its way, K if never; shape (R,)."""
        return np.asarray((self.progress < moment - 1e-9).sum(axis=0))


class Ahead(NamedTuple):
    """Front, speed and length of the present leader, front and speed of the one before, shape (K, R)."""

    x: FloatArray
    v: FloatArray
    length: FloatArray
    before_x: FloatArray
    before_v: FloatArray


def ahead_of(responses: Responses, joins: IntArray) -> Ahead:
    """Whom the followers have ahead, who get their new leader at the samples ``joins``, shape (R,)."""
    r, joined = responses, np.arange(len(responses.x))[:, None] >= joins
    x, v = np.where(joined, r.x_ahead, r.before_x), np.where(joined, r.v_ahead, r.before_v)
    return Ahead(x, v, np.where(joined, r.ahead_length, r.before_length), plain(r.before_x), plain(r.before_v))


def simulate(
    family: Family,
    behaviours: Behaviours,
    responses: Responses,
    *,
    hardest: float = HARDEST,
    joins: IntArray | None = None,
    ahead: Ahead | None = None,
) -> Simulated:
    """Drive the followers behind what was recorded ahead of them, from their recorded states at t_start.

    family: of ``names.FAMILIES``, or the name of a command of one's own; hardest: bound of their braking
    [m/s^2, positive]; joins, ahead: where known, ``responses.joins`` of their moment and ``ahead_of`` that.
    """
    if not isinstance(family, str):
        return _of_each_family(family, behaviours, responses, hardest)
    joins = responses.joins(behaviours.moment) if joins is None else joins
    ahead = ahead_of(responses, joins) if ahead is None else ahead
    out = Simulated(*(np.empty(responses.x.shape) for _ in range(3)))
    start, code = (plain(responses.x[0]), plain(responses.v[0])), family_code(family)
    behaviours = Behaviours(*map(plain, behaviours))
    if code == LCM:
        _simulate_lcm(behaviours, joins, ahead, *start, hardest, out)
    elif code == IDM:
        _simulate_idm(behaviours, joins, ahead, *start, hardest, out)
    else:
        _simulate_any(code, behaviours, joins, ahead, *start, hardest, out)
    return out


def _of_each_family(
    family: NDArray[np.object_], behaviours: Behaviours, responses: Responses, hardest: float
) -> Simulated:
    out = Simulated(*(np.empty_like(responses.x) for _ in range(3)))
    for one in np.unique(family):
        own = np.flatnonzero(family == one)
        found = simulate(str(one), behaviours.take(own), responses.take(own), hardest=hardest)
        for whole, values in zip(out, found, strict=True):
            whole[:, own] = values
    return out


@njit(inline="always")
def _simulate(
    family: int, p: Behaviours, joins: IntArray, ahead: Ahead, x0: FloatArray, v0: FloatArray, hardest: float,
    out: Simulated,
) -> None:  # fmt: skip
    """See ``simulate``. family: a constant where this is inlined, so that LLVM vectorises the step."""
    samples, count = ahead.x.shape
    x, v = x0.copy(), v0.copy()
    jump_s, jump_v, m, kept, fades = (
        np.zeros(count),
        np.zeros(count),
        np.ones(count),
        np.empty(count),
        np.empty(count),
    )
    for r in range(count):
        kept[r] = np.exp(-0.1 / p.memory[r]) if p.memory[r] > 0.0 else 0.0
        fades[r] = 0.1 / p.relaxation[r] if p.relaxation[r] > 0.0 else 1e9
        m[r] = 1.0 if p.memory[r] > 0.0 else 0.0
    for k in range(samples):
        for r in range(count):
            if k == joins[r] and p.relaxation[r] > 0.0:
                before = ahead.before_x[k, r] - x[r] if ahead.before_x[k, r] < NO_LEADER / 2.0 else np.inf
                jump_s[r], jump_v[r] = jump(
                    family, v[r], ahead.x[k, r] - x[r], ahead.v[k, r], before, ahead.before_v[k, r], p.b[r],
                    p.B[r], p.tau[r], p.L[r],
                )  # fmt: skip
        front, speed, length = ahead.x[k], ahead.v[k], ahead.length[k]
        for r in range(count):
            fading = max(1.0 - (k - joins[r]) * fades[r], 0.0)
            a = follower_command(
                family, v[r], front[r] - x[r], speed[r], length[r], p.v_desire[r], p.A[r],
                p.b[r], p.B[r], p.tau[r], p.L[r] if k >= joins[r] else p.L_before[r], fading * jump_s[r],
                fading * jump_v[r], m[r], p.a_0[r], p.drift[r], p.need[r], hardest,
            )  # fmt: skip
            out.x[k, r], out.v[k, r], out.a[k, r] = x[r], v[r], a
            x[r], v[r] = advance(x[r], v[r], a, 0.1)
            m[r] *= kept[r]


@kernel(error_model="numpy", **UNALIASED)
def _simulate_lcm(
    p: Behaviours, joins: IntArray, ahead: Ahead, x0: FloatArray, v0: FloatArray, hardest: float, out: Simulated
) -> None:
    _simulate(LCM, p, joins, ahead, x0, v0, hardest, out)


@kernel(error_model="numpy", **UNALIASED)
def _simulate_idm(
    p: Behaviours, joins: IntArray, ahead: Ahead, x0: FloatArray, v0: FloatArray, hardest: float, out: Simulated
) -> None:
    _simulate(IDM, p, joins, ahead, x0, v0, hardest, out)


@kernel(error_model="numpy", **UNALIASED)
def _simulate_any(
    family: int, p: Behaviours, joins: IntArray, ahead: Ahead, x0: FloatArray, v0: FloatArray, hardest: float,
    out: Simulated,
) -> None:  # fmt: skip
    _simulate(family, p, joins, ahead, x0, v0, hardest, out)


SETS: Final = 16
"""Sets of behaviours that are driven side by side."""
_X, _V, _JUMP, _JUMP_V, _M, _KEPT, _FADES = range(7)
"""Rows of their scratch: front, speed, what is credited of the jump, what memory has left, how both fade."""


def speeds_of_sets(
    family: str, sets: Behaviours, ahead: Ahead, joins: IntArray, start: FloatArray, *, every: int, hardest: float
) -> FloatArray:
    """Speeds [m/s] of every response under each of ``SETS`` sets of behaviours, every so many samples.

    family: the LCM or the IDM, KeyError for another one; sets: behaviours of shape (R, SETS); ahead: arrays of
    shape (R, K), a response's samples side by side; joins (R,); start: fronts and speeds, shape (2, R); hardest:
    bound of braking [m/s^2, positive]. The step is that of ``simulate`` (equations.md 3.10). The speeds have the
    shape (R, (K - 1) // every, SETS).
    """
    count, samples = ahead.x.shape
    out, scratch = np.empty((count, (samples - 1) // every, SETS)), np.empty((_FADES + 1) * SETS)
    drive = {LCM: _sets_of_lcm, IDM: _sets_of_idm}[family_code(family)]
    drive(sets, ahead, joins, start, every, hardest, scratch, out)
    return out


@njit(inline="always")
def _drive_sets(
    family: int, p: Behaviours, ahead: Ahead, joins: IntArray, start: FloatArray, every: int, hardest: float,
    s: FloatArray, out: FloatArray,
) -> None:  # fmt: skip
    """See ``speeds_of_sets``. family: a constant where this is inlined; s: scratch."""
    count, samples = ahead.x.shape
    for r in range(count):
        for w in range(SETS):
            memory, relaxation = p.memory[r, w], p.relaxation[r, w]
            s[_X * SETS + w], s[_V * SETS + w] = start[0, r], start[1, r]
            s[_JUMP * SETS + w], s[_JUMP_V * SETS + w] = 0.0, 0.0
            s[_M * SETS + w] = 1.0 if memory > 0.0 else 0.0
            s[_KEPT * SETS + w] = np.exp(-TIME_STEP / memory) if memory > 0.0 else 0.0
            s[_FADES * SETS + w] = TIME_STEP / relaxation if relaxation > 0.0 else 1e9
        for k in range(samples):
            front, speed, length = ahead.x[r, k], ahead.v[r, k], ahead.length[r, k]
            joined, since = k >= joins[r], float(k - joins[r])
            if k == joins[r]:
                old = ahead.before_x[r, k] if ahead.before_x[r, k] < NO_LEADER / 2.0 else np.inf
                for w in range(SETS):
                    if p.relaxation[r, w] == 0.0:
                        continue
                    x, v = s[_X * SETS + w], s[_V * SETS + w]
                    credit, credit_v = jump(
                        family, v, front - x, speed, old - x, ahead.before_v[r, k], p.b[r, w], p.B[r, w],
                        p.tau[r, w], p.L[r, w],
                    )  # fmt: skip
                    s[_JUMP * SETS + w], s[_JUMP_V * SETS + w] = credit, credit_v
            if k > 0 and k % every == 0:
                for w in range(SETS):
                    out[r, k // every - 1, w] = s[_V * SETS + w]
            for w in range(SETS):
                x, v, m = s[_X * SETS + w], s[_V * SETS + w], s[_M * SETS + w]
                fading = max(1.0 - since * s[_FADES * SETS + w], 0.0) if joined else 0.0
                a = follower_command(
                    family, v, front - x, speed, length, p.v_desire[r, w], p.A[r, w], p.b[r, w], p.B[r, w],
                    p.tau[r, w], p.L[r, w] if joined else p.L_before[r, w], fading * s[_JUMP * SETS + w],
                    fading * s[_JUMP_V * SETS + w], m, p.a_0[r, w], p.drift[r, w], p.need[r, w], hardest,
                )  # fmt: skip
                s[_X * SETS + w], s[_V * SETS + w] = advance(x, v, a, TIME_STEP)
                s[_M * SETS + w] = m * s[_KEPT * SETS + w]


@kernel(error_model="numpy", **UNALIASED)
def _sets_of_lcm(
    sets: Behaviours, ahead: Ahead, joins: IntArray, start: FloatArray, every: int, hardest: float, s: FloatArray,
    out: FloatArray,
) -> None:  # fmt: skip
    _drive_sets(LCM, sets, ahead, joins, start, every, hardest, s, out)


@kernel(error_model="numpy", **UNALIASED)
def _sets_of_idm(
    sets: Behaviours, ahead: Ahead, joins: IntArray, start: FloatArray, every: int, hardest: float, s: FloatArray,
    out: FloatArray,
) -> None:  # fmt: skip
    _drive_sets(IDM, sets, ahead, joins, start, every, hardest, s, out)


LEAST_RECORDINGS: Final = 4
"""With fewer recordings, blocks of time are left out."""


BLOCK: Final = 300.0
"""Length of a block of time [s]."""


GAP: Final = 60.0
"""Time around a block in which responses are left out as well [s]."""


MOST_FOLDS: Final = 10
"""Most folds over recordings: more of them share one."""


_LEAST_TRAINING = 200  # responses that have to remain where locations are left out


@dataclass(frozen=True)
class Fold:
    """Responses that share constants (``held``) and those that teach them (``taught``), each of shape (R,)."""

    word: str
    held: BoolArray
    taught: BoolArray


def folds(responses: Responses) -> list[Fold]:
    """The folds of the responses: every one is held in exactly one of them."""
    recordings, locations = np.unique(responses.recording), np.unique(responses.location)
    if len(recordings) < LEAST_RECORDINGS:
        return list(_blocks(responses))
    if len(locations) > 1:
        by_location = [_of(f"location {place} left out", responses.location == place) for place in locations]
        if min(int(fold.taught.sum()) for fold in by_location) >= _LEAST_TRAINING:
            return by_location
    groups = np.array_split(recordings, min(len(recordings), MOST_FOLDS))
    return [_of(_without(group), np.isin(responses.recording, group)) for group in groups if len(group)]


def _of(word: str, held: BoolArray) -> Fold:
    return Fold(word, held, ~held)


def _without(group: IntArray) -> str:
    return "recordings " + ", ".join(f"{number:02d}" for number in group) + " left out"


def _blocks(responses: Responses) -> Iterator[Fold]:
    for recording in np.unique(responses.recording):
        own = responses.recording == recording
        block = np.floor(responses.time / BLOCK).astype(np.int64)
        for number in np.unique(block[own]):
            held = own & (block == number)
            near = own & (responses.time > number * BLOCK - GAP) & (responses.time < (number + 1) * BLOCK + GAP)
            word = f"recording {recording:02d}, {number * BLOCK:g} to {(number + 1) * BLOCK:g} s left out"
            yield Fold(word, held, ~near)
