"""Batched Levenberg-Marquardt within bounds: up to ``STARTS`` starts of one fit advance together.

The closed-loop objective is a sum of two norms, ||r_s|| + ||r_v||, not a sum of squares. Each iteration minimises
its quadratic majorant, sum_q (||r_q||^2 / n_q + n_q) / 2 with n_q the present norm, whose gradient at the present
point is the objective's own; steps are accepted on the objective itself. Derivatives are one-sided differences,
simulated as further candidates of the same tile.

A Sobol sequence in six dimensions, without the second that importing scipy's takes.

The fast optimiser: a Sobol screen of the parameter box, then Levenberg-Marquardt from the best points.
"""

import math
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.car_following import (
    ACCELERATION_FLOOR,
    ERROR_1,
    OF_ACCELERATION,
    SIM_A,
    SIM_V,
    SIM_X,
    SIMULATED,
    WIDTH,
    A,
    FitProblem,
    V,
    X,
    evaluate_tile,
    new_scratch,
    objectives_of,
)
from highd_lc.core.kernels import UNALIASED, kernel
from highd_lc.drivers.genetic import Optimum

_BITS: Final = 30
# Joe and Kuo (2008), "new-joe-kuo-6": degree and coefficients of the primitive polynomial, first directions.
_POLYNOMIALS: Final = ((1, 0, (1,)), (2, 1, (1, 3)), (3, 1, (1, 3, 1)), (3, 2, (1, 1, 1)), (4, 1, (1, 1, 3, 3)))


def _directions(degree: int, coefficients: int, first: tuple[int, ...]) -> NDArray[np.int64]:
    """Direction numbers of one dimension, shape (_BITS,)."""
    m = list(first)
    for k in range(degree, _BITS):
        value = m[k - degree] ^ (m[k - degree] << degree)
        for i in range(1, degree):
            if coefficients >> (degree - 1 - i) & 1:
                value ^= m[k - i] << i
        m.append(value)
    return np.array([value << (_BITS - 1 - k) for k, value in enumerate(m)])


@cache
def sobol(count: int) -> NDArray[np.float64]:
    """The first count points of the sequence in [0, 1)^6, shape (6, count), in Gray-code order."""
    identity = np.array([1 << (_BITS - 1 - k) for k in range(_BITS)])
    directions = np.stack([identity, *(_directions(*polynomial) for polynomial in _POLYNOMIALS)])
    index = np.arange(1, count)
    lowest_bit = np.log2(index & -index).astype(np.int64)
    words = np.zeros((6, count), dtype=np.int64)
    words[:, 1:] = np.bitwise_xor.accumulate(directions[:, lowest_bit], axis=1)
    return words / float(1 << _BITS)


FloatArray = NDArray[np.float64]

STARTS: Final = 32
"""Most starts of a batch: each takes 1 + 6 candidates of a tile."""
# Difference step as a share of the parameter's range: the error of the derivative is of the same order.
_DIFFERENCE = 1e-6
_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-2, 1e-9, 1e9
_SOFTER, _HARDER = 0.25, 4.0
# A norm below this counts as this in the majorant: the fit is then exact to rounding.
_LEAST_NORM = 1e-13
# Rows of the normal equations of a batch: upper triangle of the Hessian, gradient, residuals and derivatives.
_HESSIAN, _GRADIENT, _RESIDUAL, _DERIVATIVE = 0, 21, 27, 29
_ROWS = 41


@kernel(error_model="numpy", **UNALIASED)
def _spread_candidates(problem: FitProblem, n: int, trial: FloatArray, candidates: FloatArray) -> None:
    """Candidates of n starts: the trial points, then for each parameter the points displaced in it."""
    for j in range(6):
        step = _DIFFERENCE * (problem.upper[j] - problem.lower[j])
        for s in range(n):
            for moved in range(7):
                candidates[j, moved * STARTS + s] = trial[j, s]
            inside = trial[j, s] + step <= problem.upper[j]
            candidates[j, (1 + j) * STARTS + s] += step if inside else -step


@kernel(fastmath={"contract"}, error_model="numpy", **UNALIASED)
def _accumulate(
    first: int, recorded: float, states: FloatArray, scales: FloatArray, inverse: FloatArray, normal: FloatArray
) -> None:
    """Add one sample of one simulated quantity to the normal equations of all starts.

    first: offset of the quantity's row in states; scales: square root of the weight a start, inverse: 1 / step,
    6 rows; normal: the flat rows of the batch.
    """
    row = states[first : first + WIDTH]
    for s in range(STARTS):
        base = row[s]
        residual = scales[s] * (base - recorded)
        for i in range(6):
            derivative = scales[s] * (row[(1 + i) * STARTS + s] - base) * inverse[i * STARTS + s]
            normal[(_DERIVATIVE + i) * STARTS + s] = derivative
            normal[(_GRADIENT + i) * STARTS + s] += derivative * residual
    for s in range(STARTS):
        place = 0
        for i in range(6):
            for j in range(i + 1):
                normal[place * STARTS + s] += (
                    normal[(_DERIVATIVE + i) * STARTS + s] * normal[(_DERIVATIVE + j) * STARTS + s]
                )
                place += 1


@kernel(error_model="numpy", **UNALIASED)
def _linearise(
    problem: FitProblem,
    trial: FloatArray,
    candidates: FloatArray,
    scratch: FloatArray,
    states: FloatArray,
    normal: FloatArray,
) -> None:
    """Normal equations of the majorant at the trial points, whose candidates have just been simulated."""
    scales, inverse = np.empty((2, STARTS)), np.empty(6 * STARTS)
    for i in range(_ROWS * STARTS):
        normal[i] = 0.0
    for s in range(STARTS):
        for j in range(6):
            inverse[j * STARTS + s] = 1.0 / (candidates[j, (1 + j) * STARTS + s] - candidates[j, s])
        for q in range(2):
            error = scratch[(ERROR_1 + q) * WIDTH + s]
            norm = max(math.sqrt(problem.weights[q] * error), _LEAST_NORM)
            scales[q, s] = math.sqrt(problem.weights[q] / norm)
    for k in range(problem.track.shape[1]):
        now = k * SIMULATED * WIDTH
        if problem.open_loop:
            recorded = problem.track[A, k]
            weight = 2.0 * problem.weights[OF_ACCELERATION] / max(abs(recorded), ACCELERATION_FLOOR)
            for s in range(STARTS):
                scales[0, s] = math.sqrt(weight)
            _accumulate(now + SIM_A * WIDTH, recorded, states, scales[0], inverse, normal)
        else:
            _accumulate(now + SIM_X * WIDTH, problem.track[X, k], states, scales[0], inverse, normal)
            _accumulate(now + SIM_V * WIDTH, problem.track[V, k], states, scales[1], inverse, normal)
    for j in range(6):
        for s in range(trial.shape[1]):
            offset = trial[j, s] - problem.centre[j]
            normal[(_GRADIENT + j) * STARTS + s] += 2.0 * problem.strength[j] * offset
            normal[(j * (j + 3) // 2) * STARTS + s] += 2.0 * problem.strength[j]


@kernel(error_model="numpy")
def _solve_free(matrix: FloatArray, right: FloatArray, free: NDArray[np.bool_], step: FloatArray) -> None:
    """Solve matrix step = right for the free components by Cholesky; the others of step are given (6, 6)."""
    factor, solution = np.empty((6, 6)), np.empty(6)
    for i in range(6):
        solution[i] = 0.0
        for j in range(i + 1):
            if not (free[i] and free[j]):
                factor[i, j] = 1.0 if i == j else 0.0
                continue
            value = matrix[i, j]
            for m in range(j):
                value -= factor[i, m] * factor[j, m]
            factor[i, j] = math.sqrt(max(value, 1e-300)) if i == j else value / factor[j, j]
    for i in range(6):
        if free[i]:
            value = right[i]
            for j in range(6):
                if not free[j]:
                    value -= matrix[i, j] * step[j]
            for m in range(i):
                value -= factor[i, m] * solution[m]
            solution[i] = value / factor[i, i]
    for i in range(5, -1, -1):
        if free[i]:
            value = solution[i]
            for m in range(i + 1, 6):
                if free[m]:
                    value -= factor[m, i] * step[m]
            step[i] = value / factor[i, i]


@kernel(error_model="numpy")
def _bounded_step(
    problem: FitProblem,
    equations: FloatArray,
    damping: float,
    point: FloatArray,
    pinned: int,
    step: FloatArray,
) -> None:
    """Damped Newton step of one start that stays within the bounds.

    equations: Hessian's lower triangle (21) and gradient (6). The pinned component (-1: none) and components at
    a bound that the gradient pushes outward stay; components whose step would leave the bounds stop there and the
    rest is solved again.
    """
    matrix, right, free = np.empty((6, 6)), np.empty(6), np.empty(6, np.bool_)
    for i in range(6):
        for j in range(i + 1):
            matrix[i, j] = matrix[j, i] = equations[i * (i + 1) // 2 + j]
        right[i] = -equations[_GRADIENT + i]
        at_lower, at_upper = point[i] <= problem.lower[i], point[i] >= problem.upper[i]
        free[i] = i != pinned and not ((at_lower and right[i] <= 0.0) or (at_upper and right[i] >= 0.0))
        step[i] = 0.0
    for i in range(6):
        matrix[i, i] += damping * matrix[i, i] + 1e-30
    for _ in range(6):
        _solve_free(matrix, right, free, step)
        stopped = False
        for i in range(6):
            if free[i] and not problem.lower[i] <= point[i] + step[i] <= problem.upper[i]:
                bound = problem.lower[i] if step[i] < 0.0 else problem.upper[i]
                step[i], free[i], stopped = bound - point[i], False, True
        if not stopped:
            return


@kernel(error_model="numpy", **UNALIASED)
def _descend(
    problem: FitProblem,
    points: FloatArray,
    iterations: int,
    pinned: int,
    scratch: FloatArray,
    states: FloatArray,
) -> FloatArray:
    """Improve the starts points (6, n), n <= STARTS, in place; returns their objectives (n,)."""
    n = points.shape[1]
    candidates = np.empty((6, 7 * STARTS))
    values, normal = np.empty(7 * STARTS), np.empty(_ROWS * STARTS)
    best, damping = np.empty(n), np.empty(n)
    equations, trial, step = np.empty((n, _RESIDUAL)), np.empty((6, n)), np.empty(6)
    for s in range(n):
        best[s], damping[s] = np.inf, _FIRST_DAMPING
    for j in range(6):
        for i in range(7 * STARTS):
            candidates[j, i] = problem.lower[j]
        for s in range(n):
            trial[j, s] = points[j, s]
    for _ in range(iterations + 1):
        _spread_candidates(problem, n, trial, candidates)
        evaluate_tile(problem, candidates, 0, 7 * STARTS, scratch, states, values)
        _linearise(problem, trial, candidates, scratch, states, normal)
        for s in range(n):
            if values[s] < best[s]:
                best[s] = values[s]
                for j in range(6):
                    points[j, s] = trial[j, s]
                damping[s] = max(damping[s] * _SOFTER, _LEAST_DAMPING)
                for row in range(_RESIDUAL):
                    equations[s, row] = normal[row * STARTS + s]
            else:
                damping[s] = min(damping[s] * _HARDER, _MOST_DAMPING)
            _bounded_step(problem, equations[s], damping[s], points[:, s], pinned, step)
            for j in range(6):
                trial[j, s] = min(max(points[j, s] + step[j], problem.lower[j]), problem.upper[j])
    return best


def descend(
    problem: FitProblem, starts: FloatArray, *, iterations: int, pinned: int | None = None
) -> tuple[FloatArray, FloatArray]:
    """Levenberg-Marquardt from each start: points (6, n) within the bounds and their objectives (n,).

    starts: shape (6, n), n <= STARTS, within the bounds; pinned: a parameter that keeps each start's value.
    """
    points = np.ascontiguousarray(starts, dtype=float).copy()
    scratch, states = new_scratch(problem.track.shape[1])
    return points, _descend(problem, points, iterations, -1 if pinned is None else pinned, scratch, states)


def curvature(problem: FitProblem, point: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Gradient (6,) of the objective at a point (6,), and Hessian (6, 6) of its majorant."""
    trial, candidates = np.ascontiguousarray(point[:, None]), np.ones((6, 7 * STARTS))
    values, normal = np.empty(7 * STARTS), np.empty(_ROWS * STARTS)
    scratch, states = new_scratch(problem.track.shape[1])
    _spread_candidates(problem, 1, trial, candidates)
    evaluate_tile(problem, candidates, 0, 7 * STARTS, scratch, states, values)
    _linearise(problem, trial, candidates, scratch, states, normal)
    rows = normal.reshape(_ROWS, STARTS)[:, 0]
    hessian = np.empty((6, 6))
    hessian[np.tril_indices(6)] = rows[:_GRADIENT]
    hessian.T[np.tril_indices(6)] = rows[:_GRADIENT]
    return rows[_GRADIENT:_RESIDUAL].copy(), hessian


def screen(problem: FitProblem, rng: np.random.Generator, *, count: int, keep: int) -> FloatArray:
    """The best keep of count points of a randomly shifted Sobol sequence (Cranley and Patterson), (6, keep)."""
    unit = (sobol(count) + rng.random((6, 1))) % 1.0
    points = problem.lower[:, None] + unit * (problem.upper - problem.lower)[:, None]
    best = np.argsort(objectives_of(problem, points), kind="stable")[:keep]
    return points[:, best]


@dataclass(frozen=True)
class Screening:
    """Sobol screening with batched Levenberg-Marquardt."""

    screened: int = 2048
    starts: int = STARTS
    iterations: int = 30

    def minimise(self, problem: FitProblem, rng: np.random.Generator) -> Optimum:
        """The best point that any start reaches."""
        starts = screen(problem, rng, count=self.screened, keep=self.starts)
        points, objectives = descend(problem, starts, iterations=self.iterations)
        best = int(np.argmin(objectives))
        evaluations = self.screened + 7 * self.starts * (self.iterations + 1)
        return Optimum(points[:, best].copy(), float(objectives[best]), evaluations)
