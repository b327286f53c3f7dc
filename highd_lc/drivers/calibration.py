"""One follower's fit of the LCM: from its car-following track to parameters, quality of fit and dispersion.

From the recorded rows of a follower and its leader to the track that a fit reads.

Also a common driver, towards which fits may be drawn and which replaces those that cannot be fitted.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.car_following import (
    TIME_STEP,
    FitProblem,
    FollowingTrack,
    fit_problem,
    objectives_of,
    open_loop_objective,
    simulate,
)
from highd_lc.core.drive import UNBOUNDED
from highd_lc.core.kinematics import resample
from highd_lc.drivers.genetic import GeneticAlgorithm, Optimiser, Optimum, PymooGeneticAlgorithm
from highd_lc.drivers.least_squares import STARTS, Screening, descend, screen
from highd_lc.vocab.driver import LOWER_BOUNDS, PARAMETERS, UPPER_BOUNDS
from highd_lc.vocab.settings import CalibrateSettings

FloatArray = NDArray[np.float64]

# Positions are snapped to this before anything is computed from them [m]: a mirrored recording differs in the
# last bits of its positions, and a fit amplifies bits (equations.md 9).
_SNAP = 1e-4
_SAME_TIME = 1e-6


@dataclass(frozen=True)
class RecordedMotion:
    """Recorded rows of a vehicle, ascending in time: t [s], box centre x along travel [m], v [m/s], a [m/s^2],
    each of shape (n,); length [m].
    """

    t: FloatArray
    x: FloatArray
    v: FloatArray
    a: FloatArray
    length: float


def following_track(follower: RecordedMotion, leader: RecordedMotion) -> FollowingTrack:
    """The common time of both on the 0.1 s grid that counts from t = 0, in front-bumper coordinates.

    Only instants recorded for both count; a track without any has length zero.
    """
    first, last = _common_span(follower.t, leader.t)
    grid = np.arange(np.ceil(first / TIME_STEP - _SAME_TIME), np.floor(last / TIME_STEP + _SAME_TIME) + 1.0)
    if last <= first:
        grid = grid[:0]
    grid = np.clip(grid * TIME_STEP, first, last)
    x, v, a = _resampled(follower, grid)
    leader_x, leader_v, _ = _resampled(leader, grid)
    return FollowingTrack(leader_x + 0.5 * leader.length, leader_v, x + 0.5 * follower.length, v, a)


def _common_span(a: FloatArray, b: FloatArray) -> tuple[float, float]:
    if len(a) == 0 or len(b) == 0:
        return 0.0, 0.0
    return max(float(a[0]), float(b[0])), min(float(a[-1]), float(b[-1]))


def _resampled(motion: RecordedMotion, grid: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    if len(grid) == 0:
        return grid, grid, grid
    snapped = np.round(motion.x / _SNAP) * _SNAP
    return resample(motion.t, snapped, motion.v, motion.a, grid)


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


# Why a follower is not fitted.
TOO_SHORT: Final = "too_short"
NOT_FINITE: Final = "not_finite"
STANDING_STILL: Final = "standing_still"
NO_ACCELERATION: Final = "no_acceleration"

# A parameter this close to a bound, as a share of its range, sits on it.
_AT_BOUND = 1e-3
# Below this root mean square of speed [m/s] the follower stands: relative errors of speed mean nothing.
_STANDING = 0.1
# Starts whose objective is within this share of the best are equally good, and so are all below the second
# number: recordings rounded to 0.01 m cannot tell them apart.
_EQUALLY_GOOD, _EXACT = 0.02, 1e-4
IDM_LOWER: Final = np.array([1.0, 0.1, 0.1, 0.0, 0.1, 0.1])
IDM_UPPER: Final = np.array([70.0, 6.0, 6.0, 1.0, 5.0, 8.0])
"""Bounds of the IDM: v_desire [m/s], A, b [m/s^2], unused, T [s], s0 [m] (Kesting and Treiber 2008)."""
# Points screened for the starts that polish a GA's best.
_POLISH_SCREEN = 512


@dataclass(frozen=True)
class Quality:
    """Closed-loop errors of a fit and the paper's one-step objective.

    RMSE of spacing [m], speed [m/s] and acceleration [m/s^2]; nrmse_spacing = RMSE / RMS of the recorded spacing;
    theil_u = RMSE / (RMS simulated + RMS recorded) of spacing; paper_j: NaN if the follower never accelerates.
    """

    rmse_spacing: float
    rmse_speed: float
    rmse_acceleration: float
    nrmse_spacing: float
    theil_u: float
    paper_j: float


@dataclass(frozen=True)
class FollowerFit:
    """A fit, or the reason why there is none.

    parameters: shape (6,) in the order of ``PARAMETERS``; objective: of the parameters kept; objective_ga: of the
    GA before the polish, NaN without a GA; spread: standard deviation of each parameter over the equally good
    starts, shape (6,), NaN if there is only one; reason: empty when fitted. Unavailable is NaN.
    """

    parameters: FloatArray
    objective: float
    objective_ga: float
    quality: Quality
    spread: FloatArray
    at_bound: tuple[str, ...]
    n_samples: int
    reason: str


def follower_seed(run_seed: int, event_id: str, follower: int) -> int:
    """Seed of one follower's fit: a hash, the same in every process, order and batch. follower: rank from 1."""
    digest = hashlib.blake2b(f"{run_seed}/{event_id}/{follower}".encode(), digest_size=8).digest()
    return int.from_bytes(digest, "big") >> 1


def method_name(settings: CalibrateSettings) -> str:
    """Objective and optimiser in one word, such as ``closed-loop/ga+polish``."""
    polish = "+polish" if settings.polish and settings.optimiser != "screen" else ""
    delay = "/delay" if settings.delay == "explicit" else ""
    pooling = "/pooled" if settings.pooling == "penalised" else ""
    return f"{settings.objective}/{settings.optimiser}{polish}{delay}{pooling}"


def make_optimiser(settings: CalibrateSettings) -> Optimiser:
    """The optimiser that the settings name."""
    if settings.optimiser == "screen":
        return Screening(settings.screened)
    method = GeneticAlgorithm if settings.optimiser == "ga" else PymooGeneticAlgorithm
    return method(
        settings.population,
        settings.generations,
        settings.crossover_probability,
        settings.mutation_probability,
    )


def why_not(track: FollowingTrack, settings: CalibrateSettings) -> str:
    """Why a track cannot be fitted; empty if it can."""
    if (len(track.x) - 1) * TIME_STEP < settings.min_window_s - 1e-9:
        return TOO_SHORT
    if not np.isfinite(track.as_array()).all():
        return NOT_FINITE
    if np.sqrt(np.mean(track.v**2)) < _STANDING:
        return STANDING_STILL
    if settings.objective == "paper" and not np.any(track.a):
        return NO_ACCELERATION
    return ""


def fit_follower(
    track: FollowingTrack,
    settings: CalibrateSettings,
    *,
    seed: int,
    prior: Prior | None = None,
    hardest: float = UNBOUNDED,
) -> FollowerFit:
    """Fit the LCM to a follower's track (equations.md 9); deterministic for a seed.

    prior: a common driver towards whom the fit is drawn; the objectives of the result do not count the penalty.
    hardest: bound of the simulated drivers' braking [m/s^2, positive].
    """
    reason = why_not(track, settings)
    if reason:
        return unfitted(len(track.x), reason)
    problem = pose(track, settings, hardest=hardest)
    search = problem if prior is None else penalised(problem, prior)
    rng = np.random.default_rng(seed)
    found = make_optimiser(settings).minimise(search, rng)
    points, objectives = _starts(search, found, rng)
    genetic = settings.optimiser != "screen"
    polished = settings.polish or not genetic
    kept = points[:, int(np.argmin(objectives))].copy() if polished else found.parameters
    before, after = objectives_of(problem, np.stack([found.parameters, kept], axis=1))
    return FollowerFit(
        kept,
        float(after),
        float(before) if genetic else np.nan,
        assess(track, kept, delayed=problem.delayed, hardest=hardest),
        _spread(points, objectives),
        bounds_hit(kept),
        len(track.x),
        "",
    )


def pose(track: FollowingTrack, settings: CalibrateSettings, *, hardest: float = UNBOUNDED) -> FitProblem:
    """The problem of a track under the settings: objective, delay and the bounds of Table 3."""
    return fit_problem(
        track,
        LOWER_BOUNDS.as_array(),
        UPPER_BOUNDS.as_array(),
        open_loop=settings.objective == "paper",
        delayed=settings.delay == "explicit",
        hardest=hardest,
    )


def pose_idm(track: FollowingTrack, leader_length: float, *, hardest: float = UNBOUNDED) -> FitProblem:
    """The problem of fitting the IDM to a track, in the closed loop, within Kesting and Treiber's bounds."""
    return fit_problem(track, IDM_LOWER, IDM_UPPER, idm_behind=leader_length, hardest=hardest)


def fit_idm(
    track: FollowingTrack,
    leader_length: float,
    settings: CalibrateSettings,
    *,
    seed: int,
    hardest: float = UNBOUNDED,
) -> FloatArray:
    """The IDM of a follower's track by screening and Levenberg-Marquardt, whatever the LCM is fitted with.

    Returns v_desire, A, b, an unused place, T and s0, shape (6,): the order in which kernels have the LCM's.
    """
    problem = pose_idm(track, leader_length, hardest=hardest)
    return Screening(settings.screened).minimise(problem, np.random.default_rng(seed)).parameters


def _starts(problem: FitProblem, found: Optimum, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Levenberg-Marquardt from the optimum found and from the best of a screen: points (6, n), objectives (n,)."""
    others = screen(problem, rng, count=_POLISH_SCREEN, keep=STARTS - 1)
    starts = np.concatenate([found.parameters[:, None], others], axis=1)
    return descend(problem, starts, iterations=30)


def _spread(points: FloatArray, objectives: FloatArray) -> FloatArray:
    good = objectives <= max((1.0 + _EQUALLY_GOOD) * objectives.min(), _EXACT)
    return points[:, good].std(axis=1) if good.sum() > 1 else np.full(6, np.nan)


def bounds_hit(parameters: FloatArray) -> tuple[str, ...]:
    """Names of the parameters (6,) that sit on a bound."""
    lower, upper = LOWER_BOUNDS.as_array(), UPPER_BOUNDS.as_array()
    distance = np.minimum(parameters - lower, upper - parameters) / (upper - lower)
    return tuple(name for name, near in zip(PARAMETERS, distance <= _AT_BOUND, strict=True) if near)


def assess(track: FollowingTrack, parameters: FloatArray, *, delayed: bool, hardest: float = UNBOUNDED) -> Quality:
    """Errors of a closed-loop simulation with parameters (6,), and the paper's J."""
    simulated = simulate(track, parameters, delayed=delayed, hardest=hardest)
    spacing = track.leader_x - simulated.x
    rmse = _rms(spacing - track.spacing)
    return Quality(
        rmse,
        _rms(simulated.v - track.v),
        _rms(simulated.a - track.a),
        rmse / _rms(track.spacing),
        rmse / (_rms(spacing) + _rms(track.spacing)),
        open_loop_objective(track, parameters, delayed=delayed, hardest=hardest),
    )


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def unfitted(n_samples: int, reason: str) -> FollowerFit:
    """A fit that says why there is none."""
    nothing = Quality(*[np.nan] * 6)
    return FollowerFit(np.full(6, np.nan), np.nan, np.nan, nothing, np.full(6, np.nan), (), n_samples, reason)
