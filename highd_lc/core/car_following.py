"""A follower behind its recorded leader: simulation and calibration objectives.

Closed loop: the LCM drives the follower from its first recorded state behind the recorded leader, semi-implicit
Euler (v += a dt, then x += v dt); objective RMSE(s) / RMS(s) + RMSE(v) / RMS(v), s the spacing.
Open loop (the paper's form): at every sample the LCM reads the *recorded* speeds and spacing; objective
J = sum((a_sim - a_obs)^2 / max(|a_obs|, 0.1)) / sum |a_obs|. Both: SPEC section 9.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.car_following_kernel import (
    LANES,
    SIM_A,
    SIM_V,
    SIM_X,
    SIMULATED,
    FitProblem,
    evaluate_population,
    load_tile,
    new_scratch,
    simulate_closed_loop,
)
from highd_lc.core.car_following_kernel import TIME_STEP as TIME_STEP  # part of what this module offers
from highd_lc.core.drive import UNBOUNDED

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class FollowingTrack:
    """A recorded follower and its leader on the 0.1 s grid.

    leader_x, x: front bumpers along travel [m]; leader_v, v: speeds [m/s]; a: recorded acceleration of the
    follower [m/s^2]; all of shape (K,).
    """

    leader_x: FloatArray
    leader_v: FloatArray
    x: FloatArray
    v: FloatArray
    a: FloatArray

    @property
    def spacing(self) -> FloatArray:
        """Recorded spacing, front bumper to front bumper [m], shape (K,)."""
        return self.leader_x - self.x

    def as_array(self) -> FloatArray:
        """Rows leader_x, leader_v, x, v, a, shape (5, K), C-contiguous."""
        return np.ascontiguousarray(np.stack([self.leader_x, self.leader_v, self.x, self.v, self.a]))


@dataclass(frozen=True)
class Simulation:
    """A simulated follower: speed [m/s], front bumper [m] and acceleration [m/s^2] at every sample, shape (K,)."""

    v: FloatArray
    x: FloatArray
    a: FloatArray


def fit_problem(
    track: FollowingTrack,
    lower: FloatArray,
    upper: FloatArray,
    *,
    open_loop: bool = False,
    delayed: bool = False,
    hardest: float = UNBOUNDED,
) -> FitProblem:
    """The fit of a track within bounds (6,), without a penalty. hardest: bound of commanded braking [m/s^2].

    A sum that is zero (a follower that stands, or never accelerates) gives an infinite weight: see to it before.
    """
    sums = np.array([np.sum(track.spacing**2), np.sum(track.v**2), np.sum(np.abs(track.a))])
    with np.errstate(divide="ignore"):
        weights = 1.0 / sums
    nothing = np.zeros(6)
    return FitProblem(track.as_array(), open_loop, delayed, hardest, weights, lower, upper, nothing, nothing)


def simulate(
    track: FollowingTrack, parameters: FloatArray, *, delayed: bool = False, hardest: float = UNBOUNDED
) -> Simulation:
    """Drive the follower behind its recorded leader with parameters (6,); shapes and units of the track.

    hardest: bound of commanded braking [m/s^2, positive].
    """
    scratch, states = new_scratch(len(track.x))
    load_tile(parameters[:, None], 0, 1, scratch)
    simulate_closed_loop(track.as_array(), 1, delayed, hardest, scratch, states)
    lane = states.reshape(-1, SIMULATED, LANES)[: len(track.x), :, 0]
    return Simulation(lane[:, SIM_V].copy(), lane[:, SIM_X].copy(), lane[:, SIM_A].copy())


def objectives_of(problem: FitProblem, parameters: FloatArray) -> FloatArray:
    """Objective of each candidate of parameters (6, n), shape (n,)."""
    objectives = np.empty(parameters.shape[1])
    candidates = np.ascontiguousarray(parameters)
    evaluate_population(problem, candidates, *new_scratch(problem.track.shape[1]), objectives)
    return objectives


def open_loop_objective(
    track: FollowingTrack, parameters: FloatArray, *, delayed: bool = False, hardest: float = UNBOUNDED
) -> float:
    """The paper's J of parameters (6,); NaN if the follower never accelerates."""
    if not np.any(track.a):
        return float("nan")
    problem = fit_problem(track, parameters, parameters, open_loop=True, delayed=delayed, hardest=hardest)
    return float(objectives_of(problem, parameters[:, None])[0])
