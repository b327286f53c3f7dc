"""Baselines for the tracking MPC on the same plants: LQR with feedforward, and pure pursuit.

Both know the bounds only as a clip: the car's limits cut what they order.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are

from highd_lc.core.kinematics import error_model
from highd_lc.tracking.controllers import Command
from highd_lc.tracking.mpc import mpc_parameters
from highd_lc.vocab.tracking import TrackingSettings

FloatArray = NDArray[np.float64]

# Below this reference speed [m/s] steering moves nothing and no stabilising gain exists.
_SLOWEST_GAIN = 0.5


@dataclass(frozen=True)
class LqrController:
    """The MPC's cost over an infinite horizon without bounds, with the reference's input as feedforward.

    The gain is the LQR's for the augmented model frozen at each sample. The car's own limits clip the order.
    """

    settings: TrackingSettings
    wheelbase: float
    dt: float
    _gains: dict[tuple[float, float, float], FloatArray] = field(default_factory=dict)

    def command(self, measured: FloatArray, last_input: FloatArray, *, rows: FloatArray, k: int) -> Command:
        """dU = -K [error; previous input error], added to the reference's input and the input error."""
        input_error = last_input - rows[max(k - 1, 0), 3:]
        xi = np.concatenate([measured - rows[k, :3], input_error])
        v, heading, delta = max(float(rows[k, 3]), _SLOWEST_GAIN), float(rows[k, 2]), float(rows[k, 4])
        ordered = rows[k, 3:] + input_error - self._gain(v, heading, delta) @ xi
        return Command(clip(ordered, last_input, settings=self.settings, dt=self.dt))

    def _gain(self, v: float, heading: float, delta: float) -> FloatArray:
        key = (v, heading, delta)
        if key not in self._gains:
            p = mpc_parameters(self.settings, self.dt)
            A, B = error_model(v, heading, delta, dt=self.dt, wheelbase=self.wheelbase)
            self._gains[key] = lqr_gain(A, B, R=p.R * [1.0, 1.0, v * v], Q=p.Q)
        return self._gains[key]


def lqr_gain(A: FloatArray, B: FloatArray, *, R: FloatArray, Q: FloatArray) -> FloatArray:
    """K, shape (2, 5), of dU = -K xi for the augmented model of A, B with weights R (errors), Q (increments)."""
    Aa = np.block([[A, B], [np.zeros((2, 3)), np.eye(2)]])
    Ba = np.vstack([B, np.eye(2)])
    P = solve_discrete_are(Aa, Ba, np.diag([*R, 0.0, 0.0]), np.diag(Q))
    return np.linalg.solve(np.diag(Q) + Ba.T @ P @ Ba, Ba.T @ P @ Aa)


@dataclass(frozen=True)
class PurePursuit:
    """Pure pursuit of the reference's point ``look_ahead_s`` ahead; the speed follows by proportional feedback.

    delta = atan(2 l sin(alpha) / distance), alpha the bearing of the point from the heading (Coulter 1992).
    look_ahead_s [s] and gain [1/s] are the law's usual values, not tuned.
    """

    settings: TrackingSettings
    wheelbase: float
    dt: float
    look_ahead_s: float = 0.6
    gain: float = 1.0

    def command(self, measured: FloatArray, last_input: FloatArray, *, rows: FloatArray, k: int) -> Command:
        """Steer onto the arc through the point ahead; v = v_r - gain times the longitudinal error."""
        ahead = rows[min(k + round(self.look_ahead_s / self.dt), len(rows) - 1)]
        dx, dy = ahead[0] - measured[0], ahead[1] - measured[1]
        distance = max(math.hypot(dx, dy), 1e-3)
        bearing = math.atan2(dy, dx) - measured[2]
        here = rows[k]
        along = (measured[0] - here[0]) * math.cos(here[2]) + (measured[1] - here[1]) * math.sin(here[2])
        steering = math.atan(2.0 * self.wheelbase * math.sin(bearing) / distance)
        ordered = np.array([here[3] - self.gain * along, steering])
        return Command(clip(ordered, last_input, settings=self.settings, dt=self.dt))


def clip(ordered: FloatArray, last_input: FloatArray, *, settings: TrackingSettings, dt: float) -> FloatArray:
    """An order within the MPC's bounds on the input and on its change per sample of dt [s], shape (2,)."""
    p = mpc_parameters(settings, dt)
    changed = np.clip(ordered, last_input - p.increment, last_input + p.increment)
    return np.clip(changed, p.input_lower, p.input_upper)
