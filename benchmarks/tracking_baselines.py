"""Baselines for the tracking MPC on the same plants: LQR with feedforward, and pure pursuit.

Both know the bounds only as a clip: the car's limits cut what they order. ``track_kinematic`` drives the bicycle
under any controller, one Python call a step.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are

from highd_lc.core.kinematics import bicycle_step, error_model_entries
from highd_lc.tracking.closed_loop import Disturbance, invalid_result, noise_rows, reference_rows, summarise
from highd_lc.tracking.controllers import Command, Controller, drive
from highd_lc.tracking.mpc import mpc_parameters
from highd_lc.vocab.tracking import Reference, TrackingResult, TrackingSettings

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


def error_model(
    v_r: float, phi_r: float, delta_r: float, *, dt: float, wheelbase: float
) -> tuple[FloatArray, FloatArray]:
    """A, shape (3, 3), and B, shape (3, 2), of equation 22; see ``error_model_entries``."""
    a02, a12, b00, b10, b20, b21 = error_model_entries(v_r, phi_r, delta_r, dt, wheelbase)
    A = np.array([[1.0, 0.0, a02], [0.0, 1.0, a12], [0.0, 0.0, 1.0]])
    B = np.array([[b00, 0.0], [b10, 0.0], [b20, b21]])
    return A, B


@dataclass
class KinematicPlant:
    """The kinematic bicycle as a plant; start: pose at t = 0, shape (3,); wheelbase [m]."""

    start: FloatArray
    wheelbase: float

    def pose(self) -> FloatArray:
        """x, y [m], heading [rad], shape (3,)."""
        return self.start

    def velocity(self) -> None:
        """None: the rear axle rolls as commanded."""

    def advance(self, held: FloatArray, dt: float) -> None:
        """The exact arc of the held input."""
        x, y, phi = self.start
        self.start = np.array(bicycle_step(x, y, phi, held[0], held[1], dt, self.wheelbase))


def track_kinematic(
    reference: Reference,
    *,
    controller: Controller,
    wheelbase: float,
    settings: TrackingSettings,
    disturbance: Disturbance | None = None,
) -> TrackingResult:
    """Drive the kinematic bicycle along the reference under any controller; wheelbase [m] that it believes in.

    With the MPC the same as ``closed_loop.track``, step by step in Python.
    """
    rows = reference_rows(reference, wheelbase, settings.horizon)
    if not np.all(np.isfinite(rows)):
        return invalid_result(reference)
    given = disturbance or Disturbance()
    plant = KinematicPlant(rows[0, :3] + np.array(given.offset), wheelbase * given.wheelbase_factor)
    noise = noise_rows(given, reference.n_steps)
    log, velocity = drive(plant, controller, rows=rows, noise=noise, dt=reference.dt)
    return summarise(log, velocity, rows=rows, dt=reference.dt, settings=settings)
