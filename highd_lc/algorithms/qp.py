"""One quadratic program, two solvers behind one function: DAQP, and OSQP to cross-check it.

min 0.5 z'H z + f'z   subject to   A z <= upper
"""

import time
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from highd_lc.algorithms.daqp_call import INFINITY, PROBLEM, RESULT, check_daqp, daqp_solve
from highd_lc.algorithms.mpc import kkt_residuals
from highd_lc.vocab.errors import MissingExtraError

FloatArray = NDArray[np.float64]

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

    of the optimality conditions (stationarity, feasibility, complementarity), the rows that bind, and the wall
    time [s] of set-up and solution.
    """

    status: str
    solved: bool
    z: FloatArray
    multipliers: FloatArray
    stationarity: float
    feasibility: float
    complementarity: float
    active: tuple[int, ...]
    solve_time_s: float


def solve_qp(qp: Qp, *, solver: Literal["daqp", "osqp"] = "daqp") -> QpSolution:
    """Solve the QP by DAQP (active set, exact to rounding) or by OSQP (splitting, polished).

    A QP with numbers that are not finite is a status, handed to neither. Raises MissingExtraError when osqp is
    asked for and not installed.
    """
    if not all(np.all(np.isfinite(part)) for part in (qp.H, qp.f, qp.A, qp.upper)):
        return _unsolved(qp)
    started = time.perf_counter()
    status, solved, z, multipliers = (_daqp if solver == "daqp" else _osqp)(qp)
    elapsed = time.perf_counter() - started
    residuals = kkt_residuals(qp.H, qp.f, qp.A, qp.upper, z, multipliers)
    threshold = _ACTIVE_MULTIPLIER * (1.0 + float(np.max(np.abs(qp.f))))
    active = tuple(int(row) for row in np.flatnonzero(multipliers > threshold))
    return QpSolution(status, solved, z, multipliers, *residuals, active, elapsed)


def _unsolved(qp: Qp) -> QpSolution:
    nan = float("nan")
    z, multipliers = np.full(len(qp.f), nan), np.full(len(qp.upper), nan)
    return QpSolution("not finite", False, z, multipliers, nan, nan, nan, (), 0.0)


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
