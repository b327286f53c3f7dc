"""The fast optimiser: a Sobol screen of the parameter box, then Levenberg-Marquardt from the best points."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from highd_lc.algorithms.least_squares import STARTS, descend
from highd_lc.algorithms.optimisation import Optimum
from highd_lc.algorithms.sobol import sobol
from highd_lc.core.car_following import objectives_of
from highd_lc.core.car_following_kernel import FitProblem

FloatArray = NDArray[np.float64]


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
