"""The tracking MPC as a QP: augmented error model, condensed prediction, bounds with slack [23, 24].

Augmented state xi = [psi error (3); previous input error (2)]; decision z = [N_c increments of the input error
(2 each); slack eps]. The input error is held beyond N_c. With E_i the error i samples on,

    E = F + Theta dU,   Theta lower block triangular, N_p x N_c blocks of 3 x 2,
    J = sum ||E_i||_R^2 + sum ||dU_i||_Q^2 + rho eps^2,

where F is the free response to xi. R = diag(R_x, R_y, R_phi v_r^2): the heading is weighed as the lateral speed
that it stands for, v_r (phi - phi_r), so that an offset decays alike at every speed. Bounds on the input and on
its increment are given in absolute terms and moved by the reference's own input and increment; eps softens them,
one unit by ``softening``.

Compiled functions take a reference as rows [x, y, phi, v, delta], one a sample. Units: m, rad, m/s, s.

One quadratic program, two solvers behind one function: DAQP, and OSQP to cross-check it.

min 0.5 z'H z + f'z   subject to   A z <= upper
"""

import math
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.core.kernels import kernel
from highd_lc.core.kinematics import error_model_entries
from highd_lc.tracking.daqp_call import INFINITY, PROBLEM, RESULT, check_daqp, daqp_solve
from highd_lc.vocab.errors import MissingExtraError
from highd_lc.vocab.tracking import TrackingSettings

FloatArray = NDArray[np.float64]

BOUNDS_PER_SAMPLE = 8
"""Upper and lower bound of the value and of the increment, of the speed and then of the steering."""
HEADING, SPEED, STEERING = 2, 3, 4
"""Columns of the reference rows behind x and y."""
STEERING_STOP = 1.2
"""Mechanical stop of the steering [rad]: no slack takes the wheels further."""


class MpcParameters(NamedTuple):
    """Weights and bounds as compiled code reads them.

    R, shape (3,): weights of the errors in x, y, and v_r times heading; Q, shape (2,): of the increments of speed
    and steering error; rho: of the slack; input_lower, input_upper, increment, softening, shape (2,): bounds of
    speed [m/s] and steering [rad], of their change per sample, and what one unit of slack adds to either.
    """

    R: FloatArray
    Q: FloatArray
    rho: float
    horizon: int
    control_horizon: int
    input_lower: FloatArray
    input_upper: FloatArray
    increment: FloatArray
    softening: FloatArray
    dt: float


class MpcMemory(NamedTuple):
    """One controller's working memory: prediction, QP, solution, and the records that DAQP reads.

    free, shape (3 N_p,): F; theta, shape (3 N_p, 2 N_c): Theta; H, f, A, upper, lower: the QP in n = 2 N_c + 1
    variables and m = 8 N_c rows; z, shape (n,), lam, shape (m,): its solution and multipliers.
    """

    free: FloatArray
    theta: FloatArray
    H: FloatArray
    f: FloatArray
    A: FloatArray
    upper: FloatArray
    lower: FloatArray
    sense: NDArray[np.intc]
    z: FloatArray
    lam: FloatArray
    problem: Any
    result: Any


def mpc_parameters(settings: TrackingSettings, dt: float) -> MpcParameters:
    """The settings as arrays, rates turned into increments per sample of dt [s]."""
    s = settings
    return MpcParameters(
        R=np.array([s.weight_longitudinal, s.weight_lateral, s.weight_heading]),
        Q=np.array([s.weight_speed_increment, s.weight_steering_increment]),
        rho=s.slack_penalty,
        horizon=s.horizon,
        control_horizon=s.control_horizon,
        input_lower=np.array([s.speed_min, -s.steering_max]),
        input_upper=np.array([s.speed_max, s.steering_max]),
        increment=np.array([s.acceleration_max, s.steering_rate_max]) * dt,
        softening=np.array([1.0, s.steering_softening]),
        dt=dt,
    )


def new_memory(p: MpcParameters) -> MpcMemory:
    """Working memory for the parameters; what never changes (A, the slack's weight) is filled in here.

    Row 8 i + 4 a + r of A z <= upper bounds input a of sample i: r = 0, 1 its value from above and below,
    r = 2, 3 its increment. The slack needs no bound of its own: a negative one only tightens and costs.
    """
    n, m = 2 * p.control_horizon + 1, BOUNDS_PER_SAMPLE * p.control_horizon
    A = np.zeros((m, n))
    for i in range(p.control_horizon):
        for a in range(2):
            row = BOUNDS_PER_SAMPLE * i + 4 * a
            for j in range(i + 1):
                A[row, 2 * j + a] = 1.0
                A[row + 1, 2 * j + a] = -1.0
            A[row + 2, 2 * i + a] = 1.0
            A[row + 3, 2 * i + a] = -1.0
            A[row : row + 4, n - 1] = -p.softening[a]
    H = np.zeros((n, n))
    H[n - 1, n - 1] = 2.0 * p.rho
    return MpcMemory(
        np.zeros(3 * p.horizon),
        np.zeros((3 * p.horizon, n - 1)),
        H,
        np.zeros(n),
        A,
        np.zeros(m),
        np.full(m, -INFINITY),
        np.zeros(m, np.intc),
        np.zeros(n),
        np.zeros(m),
        np.zeros(1, PROBLEM),
        np.zeros(1, RESULT),
    )


@njit(inline="always")
def predict(
    error: FloatArray,
    input_error: FloatArray,
    rows: FloatArray,
    k: int,
    wheelbase: float,
    p: MpcParameters,
    memory: MpcMemory,
) -> None:
    """Write F and Theta for the horizon that starts at sample k of the reference rows.

    error, shape (3,): psi - psi_r at k; input_error, shape (2,): the previous input minus its reference.
    Theta[i, j] = A_i Theta[i-1, j] + B_i for j <= min(i, N_c - 1): an increment at j acts from j on.
    """
    theta, free = memory.theta, memory.free
    ex, ey, ephi = error[0], error[1], error[2]
    for i in range(p.horizon):
        row = rows[k + i]
        a02, a12, b00, b10, b20, b21 = error_model_entries(
            row[SPEED], row[HEADING], row[STEERING], p.dt, wheelbase
        )
        ex += a02 * ephi + b00 * input_error[0]
        ey += a12 * ephi + b10 * input_error[0]
        ephi += b20 * input_error[0] + b21 * input_error[1]
        at = 3 * i
        free[at], free[at + 1], free[at + 2] = ex, ey, ephi
        if i > 0:
            for c in range(theta.shape[1]):
                turned = theta[at - 1, c]
                theta[at, c] = theta[at - 3, c] + a02 * turned
                theta[at + 1, c] = theta[at - 2, c] + a12 * turned
                theta[at + 2, c] = turned
        else:
            for c in range(theta.shape[1]):
                theta[0, c] = theta[1, c] = theta[2, c] = 0.0
        for j in range(min(i + 1, p.control_horizon)):
            theta[at, 2 * j] += b00
            theta[at + 1, 2 * j] += b10
            theta[at + 2, 2 * j] += b20
            theta[at + 2, 2 * j + 1] += b21


@njit(inline="always")
def weigh(rows: FloatArray, k: int, p: MpcParameters, memory: MpcMemory) -> None:
    """Write H = 2 (Theta' R Theta + Q) and f = 2 Theta' R F from the prediction at sample k."""
    theta, free, H, f = memory.theta, memory.free, memory.H, memory.f
    width = theta.shape[1]
    for a in range(width):
        for b in range(width):
            H[a, b] = 0.0
        H[a, a] = 2.0 * p.Q[a % 2]
        f[a] = 0.0
    for r in range(theta.shape[0]):
        # Rows of sample i = r // 3 know the increments 0 .. i only.
        known = min(2 * (r // 3) + 2, width)
        v = rows[k + r // 3, SPEED] if r % 3 == 2 else 1.0
        doubled = 2.0 * p.R[r % 3] * v * v
        for a in range(known):
            weighted = doubled * theta[r, a]
            f[a] += weighted * free[r]
            for b in range(known):
                H[a, b] += weighted * theta[r, b]


@njit(inline="always")
def bound(input_error: FloatArray, rows: FloatArray, k: int, p: MpcParameters, memory: MpcMemory) -> None:
    """Write the right-hand sides: absolute bounds moved by the reference's input and increment.

    The reference's increment into sample 0 is taken as none: the car arrives with the first input.
    """
    upper = memory.upper
    for i in range(p.control_horizon):
        for a in range(2):
            reference = rows[k + i, SPEED + a]
            change = reference - rows[max(k + i - 1, 0), SPEED + a]
            held = reference + input_error[a]
            at = BOUNDS_PER_SAMPLE * i + 4 * a
            upper[at] = p.input_upper[a] - held
            upper[at + 1] = held - p.input_lower[a]
            upper[at + 2] = p.increment[a] - change
            upper[at + 3] = p.increment[a] + change


@kernel(inline="always")
def assemble(
    error: FloatArray,
    input_error: FloatArray,
    rows: FloatArray,
    k: int,
    wheelbase: float,
    p: MpcParameters,
    memory: MpcMemory,
) -> None:
    """Write the whole QP of sample k (arguments as in ``predict``)."""
    predict(error, input_error, rows, k, wheelbase, p, memory)
    weigh(rows, k, p, memory)
    bound(input_error, rows, k, p, memory)


@njit(inline="always")
def solve(memory: MpcMemory) -> int:
    """Solve the assembled QP by DAQP into memory.z and memory.lam; its exit flag, positive = solved.

    A QP with a number that is not finite is not handed on (flag 0): an active-set method could cycle on it.
    """
    m = memory
    checksum = 0.0
    for a in range(m.f.shape[0]):
        checksum += m.f[a] + m.H[a, a]
    for r in range(m.upper.shape[0]):
        checksum += m.upper[r]
    if not math.isfinite(checksum):
        return 0
    flag = daqp_solve(m.H, m.f, m.A, m.upper, m.lower, m.sense, m.z, m.lam, m.problem, m.result)
    for a in range(m.f.shape[0]):
        checksum += m.z[a]
    return flag if math.isfinite(checksum) else 0


@kernel(inline="always")
def kkt_residuals(
    H: FloatArray, f: FloatArray, A: FloatArray, upper: FloatArray, z: FloatArray, lam: FloatArray
) -> tuple[float, float, float]:
    """Largest violations of the optimality conditions of min 0.5 z'Hz + f'z, A z <= upper.

    Stationarity |H z + f + A' lam|, feasibility (A z - upper, and -lam), complementarity |lam (A z - upper)|.
    """
    stationarity = feasibility = complementarity = 0.0
    for a in range(f.shape[0]):
        gradient = f[a]
        for b in range(f.shape[0]):
            gradient += H[a, b] * z[b]
        for r in range(upper.shape[0]):
            gradient += A[r, a] * lam[r]
        stationarity = max(stationarity, abs(gradient))
    for r in range(upper.shape[0]):
        excess = -upper[r]
        for a in range(f.shape[0]):
            excess += A[r, a] * z[a]
        feasibility = max(feasibility, max(excess, -lam[r]))
        complementarity = max(complementarity, abs(lam[r] * excess))
    return stationarity, feasibility, complementarity


_ACTIVE_MULTIPLIER = 1e-7
"""A multiplier below this (of the gradient's size) belongs to a constraint that does not bind."""


@dataclass(frozen=True)
class Qp:
    """H, shape (n, n), positive definite; f, shape (n,); A, shape (m, n); upper, shape (m,)."""

    H: FloatArray
    f: FloatArray
    A: FloatArray
    upper: FloatArray


@dataclass(frozen=True)
class QpSolution:
    """A solver's answer: status (the solver's own word), whether solved, z (n,), multipliers (m,), the residuals

    of the optimality conditions (stationarity, feasibility, complementarity), and the rows that bind.
    """

    status: str
    solved: bool
    z: FloatArray
    multipliers: FloatArray
    stationarity: float
    feasibility: float
    complementarity: float
    active: tuple[int, ...]


def solve_qp(qp: Qp, *, solver: Literal["daqp", "osqp"] = "daqp") -> QpSolution:
    """Solve the QP by DAQP (active set, exact to rounding) or by OSQP (splitting, polished).

    A QP with numbers that are not finite is a status, handed to neither. Raises MissingExtraError when osqp is
    asked for and not installed.
    """
    if not all(np.all(np.isfinite(part)) for part in (qp.H, qp.f, qp.A, qp.upper)):
        return _unsolved(qp)
    status, solved, z, multipliers = (_daqp if solver == "daqp" else _osqp)(qp)
    residuals = kkt_residuals(qp.H, qp.f, qp.A, qp.upper, z, multipliers)
    threshold = _ACTIVE_MULTIPLIER * (1.0 + float(np.max(np.abs(qp.f))))
    active = tuple(int(row) for row in np.flatnonzero(multipliers > threshold))
    return QpSolution(status, solved, z, multipliers, *residuals, active)


def _unsolved(qp: Qp) -> QpSolution:
    nan = float("nan")
    z, multipliers = np.full(len(qp.f), nan), np.full(len(qp.upper), nan)
    return QpSolution("not finite", False, z, multipliers, nan, nan, nan, ())


def _daqp(qp: Qp) -> tuple[str, bool, FloatArray, FloatArray]:
    check_daqp()
    n, m = len(qp.f), len(qp.upper)
    z, multipliers = np.zeros(n), np.zeros(m)
    H, f, A, upper = (np.ascontiguousarray(part, dtype=np.float64) for part in (qp.H, qp.f, qp.A, qp.upper))
    lower, sense = np.full(m, -INFINITY), np.zeros(m, np.intc)
    problem, result = np.zeros(1, PROBLEM), np.zeros(1, RESULT)
    flag = daqp_solve(H, f, A, upper, lower, sense, z, multipliers, problem, result)
    return f"exit flag {flag}", flag > 0, z, multipliers


def _osqp(qp: Qp) -> tuple[str, bool, FloatArray, FloatArray]:
    try:
        import osqp
    except ImportError as missing:
        raise MissingExtraError("osqp is not installed: pip install 'highd-lc[dev]'") from missing
    from scipy.sparse import csc_matrix

    model = osqp.OSQP()
    model.setup(
        P=csc_matrix(np.triu(qp.H)),
        q=qp.f,
        A=csc_matrix(qp.A),
        l=np.full(len(qp.upper), -np.inf),
        u=qp.upper,
        eps_abs=1e-9,
        eps_rel=1e-9,
        max_iter=200_000,
        polishing=True,
        verbose=False,
    )
    answer = model.solve(raise_error=False)
    return answer.info.status, answer.info.status == "solved", answer.x, np.maximum(answer.y, 0.0)
