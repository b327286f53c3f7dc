"""A common driver towards whom fits may be drawn, and the driver who stands for those that cannot be fitted."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.car_following import objectives_of
from highd_lc.core.car_following_kernel import FitProblem
from highd_lc.vocab.lcm_parameters import LOWER_BOUNDS, UPPER_BOUNDS

FloatArray = NDArray[np.float64]

# Smallest scale of a parameter, as a share of its range: a pool whose fits all sit on a bound has none.
_LEAST_SCALE = 0.05


@dataclass(frozen=True)
class Prior:
    """A common driver: centre and scale, each of shape (6,), and how strongly fits are drawn to it."""

    centre: FloatArray
    scale: FloatArray
    strength: float


def pool_of(parameters: FloatArray, strength: float) -> Prior:
    """The prior of fits (n, 6): median, and quartile range over 1.349 (the standard deviation of a normal)."""
    lower, upper = LOWER_BOUNDS.as_array(), UPPER_BOUNDS.as_array()
    low, high = np.quantile(parameters, [0.25, 0.75], axis=0)
    scale = np.maximum((high - low) / 1.349, _LEAST_SCALE * (upper - lower))
    return Prior(np.median(parameters, axis=0), scale, strength)


def penalised(problem: FitProblem, prior: Prior) -> FitProblem:
    """The problem with the penalty strength * sum(((p - centre) / scale)^2); the strength is finite."""
    return problem._replace(centre=prior.centre, strength=prior.strength / prior.scale**2)


def common_driver(problems: Sequence[FitProblem], parameters: FloatArray) -> int:
    """Index of the fit, of parameters (n, 6), that drives all tracks of the pool best: least mean objective.

    A real driver, not an average: parameters of a fit compensate each other, so that medians or means taken one by
    one describe nobody (their objective on a track of somebody else is two to three times as large).
    """
    candidates = parameters.T
    mean = np.mean([objectives_of(problem, candidates) for problem in problems], axis=0)
    return int(np.argmin(mean))
