"""A follower behind its recorded leader: compiled simulation and objectives, for many parameter sets at once.

Closed loop: the LCM drives the follower from its first recorded state behind the recorded leader, semi-implicit
Euler (v += a dt, then x += v dt); objective RMSE(s) / RMS(s) + RMSE(v) / RMS(v), s the spacing.
Open loop (the paper's form): at every sample the LCM reads the *recorded* speeds and spacing; objective
J = sum((a_sim - a_obs)^2 / max(|a_obs|, 0.1)) / sum |a_obs|. Both: equations.md 9.4.

Candidates (parameter sets) are the innermost axis, in tiles of ``WIDTH``. A tile's rows lie at offsets known to
the compiler in one flat array, so that LLVM needs no aliasing checks and vectorises the whole model step.

Products and sums may be contracted here, as in no kernel that plans: the dispersion of a fit over its starts hangs
on last bits along flat valleys, and so stays what it was.
"""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.core.drive import UNBOUNDED, advance, bounded
from highd_lc.core.kernels import UNALIASED, kernel
from highd_lc.core.lcm import idm_command, lcm_of_inverses

FloatArray = NDArray[np.float64]

WIDTH: Final = 256
"""Candidates a tile."""
TIME_STEP: Final = 0.1
"""Integration step of the car-following simulation [s] (equations.md 3)."""
ACCELERATION_FLOOR: Final = 0.1
"""Smallest |a_obs| that weighs a sample of the paper's objective [m/s^2] (equations.md 9.4)."""

# Rows of a track array.
LEADER_X, LEADER_V, X, V, A = range(5)
# Values simulated at each sample, WIDTH candidates each.
SIM_V, SIM_X, SIM_A, SIM_COMMAND = range(4)
SIMULATED = 4
_NEXT = SIMULATED * WIDTH
# Rows of a tile's scratch: parameters in the form that the model step uses, error sums.
_INVERSE_V_DESIRE, _A, _HALF_INVERSE_b, _HALF_INVERSE_B, _TAU, _L, ERROR_1, ERROR_2 = range(8)
_SCRATCH_ROWS = 8
# Entries of a problem's weights.
OF_SPACING, OF_SPEED, OF_ACCELERATION = range(3)


class FitProblem(NamedTuple):
    """What a candidate is judged by; a named tuple so that compiled code can take it.

    track: rows of ``core.car_following.FollowingTrack.as_array``, shape (5, K). open_loop: the paper's objective
    instead of the closed loop. delayed: the command is applied tau later (equation 10 as printed). idm: the IDM
    drives in the closed loop, leader_x is the leader's rear, T and s0 stand where the LCM has tau and L. hardest:
    bound of commanded braking [m/s^2, positive], infinite = none. weights: reciprocals of sum s^2, sum v^2 and
    sum |a_obs|, shape (3,). lower, upper: bounds of parameters, shape (6,).
    A penalty sum_j strength_j (p_j - centre_j)^2 is added to the objective; centre, strength: shape (6,).
    """

    track: FloatArray
    open_loop: bool
    delayed: bool
    idm: bool
    hardest: float
    weights: FloatArray
    lower: FloatArray
    upper: FloatArray
    centre: FloatArray
    strength: FloatArray


def new_scratch(n_samples: int) -> tuple[FloatArray, FloatArray]:
    """Scratch and state arrays for one tile of a track with n_samples samples."""
    return np.empty(_SCRATCH_ROWS * WIDTH), np.empty(SIMULATED * (n_samples + 1) * WIDTH)


@kernel(fastmath={"contract"}, error_model="numpy", **UNALIASED)
def load_tile(parameters: FloatArray, first: int, width: int, scratch: FloatArray) -> None:
    """Put candidates first .. first + width of parameters (6, n) into the scratch, divisions done once."""
    for i in range(width):
        scratch[_INVERSE_V_DESIRE * WIDTH + i] = 1.0 / parameters[0, first + i]
        scratch[_A * WIDTH + i] = parameters[1, first + i]
        scratch[_HALF_INVERSE_b * WIDTH + i] = 0.5 / parameters[2, first + i]
        scratch[_HALF_INVERSE_B * WIDTH + i] = 0.5 / parameters[3, first + i]
        scratch[_TAU * WIDTH + i] = parameters[4, first + i]
        scratch[_L * WIDTH + i] = parameters[5, first + i]


@njit(inline="always")
def _command(i: int, v: float, spacing: float, leader_v: float, hardest: float, scratch: FloatArray) -> float:
    """Acceleration commanded by candidate i of a loaded tile (equations 10 and 11)."""
    a = lcm_of_inverses(
        v, spacing, leader_v,
        scratch[_INVERSE_V_DESIRE * WIDTH + i], scratch[_A * WIDTH + i], scratch[_HALF_INVERSE_b * WIDTH + i],
        scratch[_HALF_INVERSE_B * WIDTH + i], scratch[_TAU * WIDTH + i], scratch[_L * WIDTH + i],
    )  # fmt: skip
    return bounded(a, hardest)


@kernel(fastmath={"contract"}, error_model="numpy", **UNALIASED)
def _delay_commands(k: int, width: int, scratch: FloatArray, states: FloatArray) -> None:
    """Accelerations acting at sample k: the commands of tau ago, linear between samples.

    Before the first sample the driver is taken to have commanded what he commands at the first.
    """
    for i in range(width):
        back = min(scratch[_TAU * WIDTH + i] / TIME_STEP, float(k))
        whole = int(back)
        recent = states[(k - whole) * _NEXT + SIM_COMMAND * WIDTH + i]
        older = states[max(k - whole - 1, 0) * _NEXT + SIM_COMMAND * WIDTH + i]
        states[k * _NEXT + SIM_A * WIDTH + i] = recent + (back - whole) * (older - recent)


@kernel(fastmath={"contract"}, error_model="numpy", **UNALIASED)
def _step_idm(
    now: int,
    width: int,
    leader_rear: float,
    leader_v: float,
    x_recorded: float,
    v_recorded: float,
    hardest: float,
    scratch: FloatArray,
    states: FloatArray,
) -> None:
    """The errors of a tile of IDM drivers at a sample, whose states lie at ``now``, and their step."""
    for i in range(width):
        v, x = states[now + SIM_V * WIDTH + i], states[now + SIM_X * WIDTH + i]
        error_x, error_v = x - x_recorded, v - v_recorded
        scratch[ERROR_1 * WIDTH + i] += error_x * error_x
        scratch[ERROR_2 * WIDTH + i] += error_v * error_v
        v_desire, b = 1.0 / scratch[_INVERSE_V_DESIRE * WIDTH + i], 0.5 / scratch[_HALF_INVERSE_b * WIDTH + i]
        T, s0 = scratch[_TAU * WIDTH + i], scratch[_L * WIDTH + i]
        a = idm_command(v, leader_rear - x, leader_v, v_desire, scratch[_A * WIDTH + i], b, T, s0)
        a = bounded(a, hardest)
        states[now + SIM_COMMAND * WIDTH + i] = a
        states[now + SIM_A * WIDTH + i] = a
        x, v = advance(x, v, a, TIME_STEP)
        states[now + _NEXT + SIM_V * WIDTH + i] = v
        states[now + _NEXT + SIM_X * WIDTH + i] = x


@kernel(fastmath={"contract"}, error_model="numpy", **UNALIASED)
def simulate_closed_loop(
    track: FloatArray,
    width: int,
    idm: bool,
    delayed: bool,
    hardest: float,
    scratch: FloatArray,
    states: FloatArray,
) -> None:
    """Drive the candidates of a loaded tile behind the recorded leader; sums of squared errors into scratch.

    track: (5, K). Fills states (speed, front bumper, acceleration and command at every sample) and the error
    sums of position [m^2] and speed [m^2/s^2]. delayed: the command is applied tau later.
    """
    n_samples = track.shape[1]
    for i in range(width):
        states[SIM_V * WIDTH + i] = track[V, 0]
        states[SIM_X * WIDTH + i] = track[X, 0]
        scratch[ERROR_1 * WIDTH + i] = 0.0
        scratch[ERROR_2 * WIDTH + i] = 0.0
    for k in range(n_samples):
        leader_x, leader_v = track[LEADER_X, k], track[LEADER_V, k]
        now = k * _NEXT
        x_recorded, v_recorded = track[X, k], track[V, k]
        if idm:
            _step_idm(now, width, leader_x, leader_v, x_recorded, v_recorded, hardest, scratch, states)
            continue
        for i in range(width):
            v, x = states[now + SIM_V * WIDTH + i], states[now + SIM_X * WIDTH + i]
            error_x, error_v = x - x_recorded, v - v_recorded
            scratch[ERROR_1 * WIDTH + i] += error_x * error_x
            scratch[ERROR_2 * WIDTH + i] += error_v * error_v
            a = _command(i, v, leader_x - x, leader_v, hardest, scratch)
            states[now + SIM_COMMAND * WIDTH + i] = a
            states[now + SIM_A * WIDTH + i] = a
            x, v = advance(x, v, a, TIME_STEP)
            states[now + _NEXT + SIM_V * WIDTH + i] = v
            states[now + _NEXT + SIM_X * WIDTH + i] = x
        if delayed:
            _delay_commands(k, width, scratch, states)
            for i in range(width):
                a = states[now + SIM_A * WIDTH + i]
                x, v = states[now + SIM_X * WIDTH + i], states[now + SIM_V * WIDTH + i]
                x, v = advance(x, v, a, TIME_STEP)
                states[now + _NEXT + SIM_V * WIDTH + i] = v
                states[now + _NEXT + SIM_X * WIDTH + i] = x


@kernel(fastmath={"contract"}, error_model="numpy", **UNALIASED)
def simulate_open_loop(
    track: FloatArray, width: int, delayed: bool, hardest: float, scratch: FloatArray, states: FloatArray
) -> None:
    """Command of the candidates of a loaded tile at every recorded state; weighted error sum into scratch.

    track: (5, K). Fills the accelerations of states, as they are compared with the recorded ones (delayed: tau
    after they were commanded), and sum (a_sim - a_obs)^2 / max(|a_obs|, 0.1) [m/s^2].
    """
    n_samples = track.shape[1]
    for i in range(width):
        scratch[ERROR_1 * WIDTH + i] = 0.0
        scratch[ERROR_2 * WIDTH + i] = 0.0
    for k in range(n_samples):
        now = k * _NEXT
        v, leader_v, spacing = track[V, k], track[LEADER_V, k], track[LEADER_X, k] - track[X, k]
        recorded, weight = track[A, k], 1.0 / max(abs(track[A, k]), ACCELERATION_FLOOR)
        for i in range(width):
            a = _command(i, v, spacing, leader_v, hardest, scratch)
            states[now + SIM_COMMAND * WIDTH + i] = a
            states[now + SIM_A * WIDTH + i] = a
        if delayed:
            _delay_commands(k, width, scratch, states)
        for i in range(width):
            error = states[now + SIM_A * WIDTH + i] - recorded
            scratch[ERROR_1 * WIDTH + i] += weight * error * error


@kernel(fastmath={"contract"}, error_model="numpy", **UNALIASED)
def evaluate_tile(
    problem: FitProblem,
    parameters: FloatArray,
    first: int,
    width: int,
    scratch: FloatArray,
    states: FloatArray,
    objectives: FloatArray,
) -> None:
    """Objective of candidates first .. first + width (at most WIDTH) of parameters (6, n) into objectives (n,)."""
    load_tile(parameters, first, width, scratch)
    if problem.open_loop:
        simulate_open_loop(problem.track, width, problem.delayed, problem.hardest, scratch, states)
    else:
        simulate_closed_loop(problem.track, width, problem.idm, problem.delayed, problem.hardest, scratch, states)
    for i in range(width):
        error_1, error_2 = scratch[ERROR_1 * WIDTH + i], scratch[ERROR_2 * WIDTH + i]
        if problem.open_loop:
            objective = error_1 * problem.weights[OF_ACCELERATION]
        else:
            objective = np.sqrt(error_1 * problem.weights[OF_SPACING]) + np.sqrt(
                error_2 * problem.weights[OF_SPEED]
            )
        for j in range(6):
            offset = parameters[j, first + i] - problem.centre[j]
            objective += problem.strength[j] * offset * offset
        objectives[first + i] = objective


@kernel(fastmath={"contract"}, error_model="numpy", **UNALIASED)
def evaluate_population(
    problem: FitProblem, parameters: FloatArray, scratch: FloatArray, states: FloatArray, objectives: FloatArray
) -> None:
    """Objective of every candidate of parameters (6, n) into objectives (n,), tile by tile."""
    n = parameters.shape[1]
    for first in range(0, n, WIDTH):
        evaluate_tile(problem, parameters, first, min(WIDTH, n - first), scratch, states, objectives)


@dataclass(frozen=True)
class FollowingTrack:
    """A recorded follower and its leader on the 0.1 s grid.

    leader_x, x: front bumpers along travel [m]; leader_v, v: speeds [m/s]; a: recorded acceleration of the
    follower [m/s^2]; all of shape (K,).
    """

    leader_x: FloatArray
    leader_v: FloatArray
    x: FloatArray
    v: FloatArray
    a: FloatArray

    @property
    def spacing(self) -> FloatArray:
        """Recorded spacing, front bumper to front bumper [m], shape (K,)."""
        return self.leader_x - self.x

    def as_array(self) -> FloatArray:
        """Rows leader_x, leader_v, x, v, a, shape (5, K), C-contiguous."""
        return np.ascontiguousarray(np.stack([self.leader_x, self.leader_v, self.x, self.v, self.a]))


class Simulated(NamedTuple):
    """Simulated motion: front bumper [m], speed [m/s] and acceleration [m/s^2].

    Shape (K,) of one follower, (K, R) of R followers. A named tuple so that compiled code can take it.
    """

    x: FloatArray
    v: FloatArray
    a: FloatArray


def fit_problem(
    track: FollowingTrack,
    lower: FloatArray,
    upper: FloatArray,
    *,
    open_loop: bool = False,
    delayed: bool = False,
    idm_behind: float | None = None,
    hardest: float = UNBOUNDED,
) -> FitProblem:
    """The fit of a track within bounds (6,), without a penalty. hardest: bound of commanded braking [m/s^2].

    idm_behind: length of the leader [m], with which the IDM is fitted instead of the LCM, in the closed loop.

    A sum that is zero (a follower that stands, or never accelerates) gives an infinite weight; callers exclude it.
    """
    sums = np.array([np.sum(track.spacing**2), np.sum(track.v**2), np.sum(np.abs(track.a))])
    with np.errstate(divide="ignore"):
        weights = 1.0 / sums
    nothing = np.zeros(6)
    rows, idm = track.as_array(), idm_behind is not None
    if idm_behind is not None:
        rows[LEADER_X] -= idm_behind
    return FitProblem(rows, open_loop, delayed, idm, hardest, weights, lower, upper, nothing, nothing)


def simulate(
    track: FollowingTrack, parameters: FloatArray, *, delayed: bool = False, hardest: float = UNBOUNDED
) -> Simulated:
    """Drive the follower behind its recorded leader with parameters (6,); shapes and units of the track.

    hardest: bound of commanded braking [m/s^2, positive].
    """
    scratch, states = new_scratch(len(track.x))
    load_tile(parameters[:, None], 0, 1, scratch)
    simulate_closed_loop(track.as_array(), 1, False, delayed, hardest, scratch, states)
    lane = states.reshape(-1, SIMULATED, WIDTH)[: len(track.x), :, 0]
    return Simulated(lane[:, SIM_X].copy(), lane[:, SIM_V].copy(), lane[:, SIM_A].copy())


def objectives_of(problem: FitProblem, parameters: FloatArray) -> FloatArray:
    """Objective of each candidate of parameters (6, n), shape (n,)."""
    objectives = np.empty(parameters.shape[1])
    candidates = np.ascontiguousarray(parameters)
    evaluate_population(problem, candidates, *new_scratch(problem.track.shape[1]), objectives)
    return objectives


def open_loop_objective(
    track: FollowingTrack, parameters: FloatArray, *, delayed: bool = False, hardest: float = UNBOUNDED
) -> float:
    """The paper's J of parameters (6,); NaN if the follower never accelerates."""
    if not np.any(track.a):
        return float("nan")
    problem = fit_problem(track, parameters, parameters, open_loop=True, delayed=delayed, hardest=hardest)
    return float(objectives_of(problem, parameters[:, None])[0])
