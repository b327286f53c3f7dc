"""Followers with known parameters behind made-up leaders: the problems of the calibration tests and benchmarks."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.car_following import TIME_STEP, FollowingTrack, simulate
from highd_lc.core.lcm import equilibrium_spacing
from highd_lc.vocab.driver import TABLE3_MEANS

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Noise:
    """Standard deviations of recorded positions [m], speeds [m/s] and accelerations [m/s^2]."""

    x: float
    v: float
    a: float


NOISE_FREE = Noise(0.0, 0.0, 0.0)
NOISY = Noise(0.05, 0.1, 0.2)


def driver(rng: np.random.Generator) -> FloatArray:
    """Parameters (6,) scattered by 15 % around the published means."""
    return TABLE3_MEANS.as_array() * rng.uniform(0.85, 1.15, 6)


def leader(rng: np.random.Generator, n_samples: int) -> tuple[FloatArray, FloatArray]:
    """Front bumper and speed of a leader whose acceleration wanders, each of shape (n_samples,)."""
    shocks = rng.normal(0.0, 0.35, n_samples)
    a = np.empty(n_samples)
    a[0] = shocks[0]
    for k in range(1, n_samples):
        a[k] = 0.95 * a[k - 1] + shocks[k]
    v = np.maximum(rng.uniform(15.0, 28.0) + np.cumsum(a - a.mean()) * TIME_STEP, 1.0)
    return np.cumsum(v) * TIME_STEP, v


def follower(
    rng: np.random.Generator, *, n_samples: int = 101, noise: Noise = NOISE_FREE
) -> tuple[FollowingTrack, FloatArray]:
    """A track driven by the LCM and recorded with noise, and the parameters (6,) that drove it.

    The start is off the equilibrium in spacing and speed, as recorded followers are.
    """
    parameters = driver(rng)
    leader_x, leader_v = leader(rng, n_samples)
    v = min(leader_v[0] + rng.normal(0.0, 1.0), 0.9 * parameters[0])
    x = leader_x[0] - equilibrium_spacing(v, parameters) * rng.uniform(0.8, 1.3)
    blank = np.zeros(n_samples)
    start = FollowingTrack(leader_x, leader_v, blank + x, blank + v, blank)
    driven = simulate(start, parameters)
    return FollowingTrack(
        leader_x + noise.x * rng.normal(size=n_samples),
        leader_v + noise.v * rng.normal(size=n_samples),
        driven.x + noise.x * rng.normal(size=n_samples),
        driven.v + noise.v * rng.normal(size=n_samples),
        driven.a + noise.a * rng.normal(size=n_samples),
    ), parameters
