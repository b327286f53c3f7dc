"""Parameters of the Longitudinal Control Model: their order, bounds and published values.

Wherever parameters stand in an array, the last axis has length 6 in the order of ``PARAMETERS``:
v_desire [m/s], A [m/s^2], b [m/s^2], B [m/s^2], tau [s], L [m].
"""

from dataclasses import astuple, dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

PARAMETERS: Final = ("v_desire", "A", "b", "B", "tau", "L")
UNITS: Final = {"v_desire": "m/s", "A": "m/s²", "b": "m/s²", "B": "m/s²", "tau": "s", "L": "m"}


@dataclass(frozen=True)
class LcmParameters:
    """One driver's parameters of the LCM (paper, equations 10 and 11).

    v_desire: desired speed [m/s]; A: maximum acceleration [m/s^2]; b: deceleration that the driver is willing
    to use [m/s^2, positive]; B: deceleration that the driver expects of the leader [m/s^2, positive];
    tau: perception-reaction time [s]; L: spacing at standstill, front to front [m].
    """

    v_desire: float
    A: float
    b: float
    B: float
    tau: float
    L: float

    def as_array(self) -> NDArray[np.float64]:
        """The six values in the order of ``PARAMETERS``, shape (6,)."""
        return np.array(astuple(self))


LOWER_BOUNDS: Final = LcmParameters(v_desire=5.0, A=2.0, b=2.0, B=2.0, tau=0.1, L=2.0)
UPPER_BOUNDS: Final = LcmParameters(v_desire=50.0, A=10.0, b=10.0, B=10.0, tau=10.0, L=10.0)
"""Bounds of the calibration (paper, Table 3)."""

TABLE3_MEANS: Final = LcmParameters(v_desire=33.54, A=4.91, b=6.93, B=6.44, tau=0.93, L=4.82)
TABLE3_QUANTILES: Final = {
    0.25: LcmParameters(v_desire=31.81, A=4.18, b=6.26, B=5.75, tau=0.56, L=4.64),
    0.50: LcmParameters(v_desire=33.00, A=4.44, b=6.46, B=6.34, tau=0.82, L=4.80),
    0.75: LcmParameters(v_desire=34.91, A=5.21, b=8.19, B=7.30, tau=1.31, L=4.91),
}
"""Published calibration results on HighD (paper, Table 3)."""

SIMULATION: Final = LcmParameters(v_desire=25.0, A=2.81, b=6.14, B=5.95, tau=0.46, L=5.03)
"""Parameters of the paper's simulation scenarios (equations.md 3)."""

REPLAY_L_BOUNDS: Final = (2.0, 25.0)
"""Limits of L after it has been moved to another leader [m] (equations.md 3)."""
