"""What every optimiser of a fit takes and returns."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.car_following_kernel import FitProblem

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Optimum:
    """Best parameters found, shape (6,), inside the bounds; their objective; objective evaluations spent."""

    parameters: FloatArray
    objective: float
    evaluations: int


class Optimiser(Protocol):
    """Searches the parameters (6,) of the LCM that minimise the objective of a problem."""

    def minimise(self, problem: FitProblem, rng: np.random.Generator) -> Optimum:
        """The best parameters found; all randomness comes from rng."""
        ...
