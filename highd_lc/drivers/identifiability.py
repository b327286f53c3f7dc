"""What a fit can know: profiles of the objective, correlation of parameters, dispersion over the GA's seeds.

On 7 to 13 s of car following many parameter sets fit equally well (equations.md 9). These functions say which
parameters a track determines, and over what range the others may vary at nearly the same objective.

Pooling draws fits towards a common driver: the penalty of ``drivers.calibration`` draws a fit towards the median
of the other followers' fits. Its strength is judged by the error on the held-out last third of each track,
simulated from the first recorded state of that third with parameters fitted to the first two thirds.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.car_following import FitProblem, FollowingTrack, objectives_of
from highd_lc.core.drive import UNBOUNDED
from highd_lc.drivers.calibration import (
    FollowerFit,
    Prior,
    bounds_hit,
    common_driver,
    fit_follower,
    penalised,
    pool_of,
    pose,
    pose_idm,
)
from highd_lc.drivers.genetic import GeneticAlgorithm
from highd_lc.drivers.least_squares import STARTS, curvature, descend, screen
from highd_lc.vocab.driver import PARAMETERS
from highd_lc.vocab.settings import CalibrateSettings
from highd_lc.vocab.tables.fits import BELIEVED, NOT_IDENTIFIABLE, WEAK

FloatArray = NDArray[np.float64]

TOLERANCE: Final = 0.05
"""Objectives within this share of the best count as nearly as good."""
# A parameter is believed if its interval takes at most this share of its range in the median follower and at
# most this share of the fits sit on its bounds; it is weakly determined below the second pair.
_BELIEVED, _WEAK = (0.25, 0.10), (0.60, 0.30)
_ITERATIONS = 25


@dataclass(frozen=True)
class Profile:
    """Least objective, over the other five parameters, at each value of one parameter.

    values: ascending, shape (n,); objectives, shape (n,); low, high: the interval around the best fit within which
    the objective stays within ``TOLERANCE`` of the best.
    """

    values: FloatArray
    objectives: FloatArray
    low: float
    high: float


def profile(
    problem: FitProblem, best: FloatArray, parameter: int, *, rng: np.random.Generator, n: int = STARTS // 2
) -> Profile:
    """Profile of one parameter (its index) over its bounds, n <= STARTS / 2 values and the best fit's (6,).

    At every value the other parameters start from the best fit and from a screened point.
    """
    values = np.linspace(problem.lower[parameter], problem.upper[parameter], n)
    starts = np.concatenate([np.tile(best[:, None], n), screen(problem, rng, count=512, keep=n)], axis=1)
    starts[parameter] = np.tile(values, 2)
    _, reached = descend(problem, starts, iterations=_ITERATIONS, pinned=parameter)
    _, at_best = descend(problem, best[:, None], iterations=_ITERATIONS, pinned=parameter)
    place = int(np.searchsorted(values, best[parameter]))
    values = np.insert(values, place, best[parameter])
    objectives = np.insert(reached.reshape(2, n).min(axis=0), place, at_best[0])
    return Profile(values, objectives, *_interval(values, objectives, place))


def _interval(values: FloatArray, objectives: FloatArray, place: int) -> tuple[float, float]:
    """Where the profile leaves the tolerance on either side of place, linear between values."""
    limit = (1.0 + TOLERANCE) * objectives.min()
    ends = []
    for step, last in ((-1, 0), (1, len(values) - 1)):
        i = place
        while i != last and objectives[i + step] <= limit:
            i += step
        if i == last or objectives[i] > limit:
            ends.append(float(values[i]))
        else:
            share = (limit - objectives[i]) / (objectives[i + step] - objectives[i])
            ends.append(float(values[i] + share * (values[i + step] - values[i])))
    return ends[0], ends[1]


def correlations(problem: FitProblem, best: FloatArray) -> FloatArray:
    """Correlation (6, 6) of the parameters at a best fit, from the inverse of the curvature.

    NaN in the rows and columns of parameters that sit on a bound or to which the fit does not respond.
    """
    _, hessian = curvature(problem, best)
    scale = problem.upper - problem.lower
    scaled = hessian * np.outer(scale, scale)
    inside = (best > problem.lower) & (best < problem.upper)
    known = np.flatnonzero(inside & (np.diag(scaled) > 1e-9 * np.diag(scaled).max()))
    result = np.full((6, 6), np.nan)
    if len(known) == 0:
        return result
    part = scaled[np.ix_(known, known)]
    covariance = np.linalg.inv(part + 1e-12 * np.trace(part) * np.eye(len(known)))
    deviation = np.sqrt(np.diag(covariance))
    result[np.ix_(known, known)] = covariance / np.outer(deviation, deviation)
    return result


def spread_over_seeds(problem: FitProblem, seeds: Sequence[int]) -> FloatArray:
    """Standard deviation of each parameter over the paper's GA with other seeds, not polished, shape (6,)."""
    found = [GeneticAlgorithm().minimise(problem, np.random.default_rng(seed)).parameters for seed in seeds]
    spread: FloatArray = np.std(found, axis=0)
    return spread


@dataclass(frozen=True)
class Identifiability:
    """What the tracks of a sample determine, by parameter, each of shape (6,).

    width: median width of the profile's interval as a share of the range; share_open: share of followers whose
    interval reaches a bound; spread: median over followers of the standard deviation over seeds of the GA, in the
    parameter's unit; partner: index of the most correlated other parameter (-1: none known); correlation: median
    |r| with it.
    """

    n: int
    width: FloatArray
    share_open: FloatArray
    spread: FloatArray
    partner: NDArray[np.int64]
    correlation: FloatArray


def identifiability(
    tracks: Sequence[FollowingTrack],
    fits: Sequence[FloatArray],
    settings: CalibrateSettings,
    *,
    seeds: Sequence[int],
    repeats: int = 3,
    hardest: float = UNBOUNDED,
) -> Identifiability:
    """Study fitted followers: their tracks, parameters (6,) and seeds, in the same order, at least one."""
    widths, opens, spreads, matrices = [], [], [], []
    for track, best, seed in zip(tracks, fits, seeds, strict=True):
        problem, rng = pose(track, settings, hardest=hardest), np.random.default_rng(seed)
        profiles = [profile(problem, best, j, rng=rng) for j in range(len(PARAMETERS))]
        low, high = (np.array([getattr(p, end) for p in profiles]) for end in ("low", "high"))
        widths.append((high - low) / (problem.upper - problem.lower))
        opens.append((low <= problem.lower) | (high >= problem.upper))
        spreads.append(spread_over_seeds(problem, [seed + r for r in range(repeats)]))
        matrices.append(np.abs(correlations(problem, best)))
    partner, correlation = _partners(np.array(matrices))
    return Identifiability(
        len(widths),
        np.median(widths, axis=0),
        np.mean(opens, axis=0),
        np.median(spreads, axis=0),
        partner,
        correlation,
    )


def _partners(matrices: FloatArray) -> tuple[NDArray[np.int64], FloatArray]:
    """Most correlated other parameter of each: median |r| over the followers (n, 6, 6) in which it is known."""
    partner, correlation = np.full(6, -1), np.full(6, np.nan)
    for j in range(6):
        for other in range(6):
            known = matrices[:, j, other][np.isfinite(matrices[:, j, other])]
            if other == j or len(known) == 0:
                continue
            if not np.median(known) <= correlation[j]:
                partner[j], correlation[j] = other, np.median(known)
    return partner, correlation


def verdict(width: float, share_at_bound: float) -> str:
    """Whether a parameter may be believed: ``believed``, ``weak`` or ``not identifiable``.

    width: median width of its interval as a share of its range; share_at_bound: share of all fits on a bound.
    """
    for word, (widest, most) in ((BELIEVED, _BELIEVED), (WEAK, _WEAK)):
        if width <= widest and share_at_bound <= most:
            return word
    return NOT_IDENTIFIABLE


STRENGTHS: Final = (0.0, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, np.inf)
"""Strengths that are compared: 0 = everyone's own fit, infinite = everyone drives as the pool's median."""
_FOLDS = 5
_SCREENED, _STARTS = 512, 16


def split(track: FollowingTrack) -> tuple[FollowingTrack, FollowingTrack]:
    """First two thirds and last third of a track."""
    rows = track.as_array()
    cut = round(2 * rows.shape[1] / 3)
    return FollowingTrack(*rows[:, :cut]), FollowingTrack(*rows[:, cut:])


@dataclass(frozen=True)
class PoolingStudy:
    """Held-out errors of fits drawn to the pool with each strength.

    errors: closed-loop objective on the last third, shape (n followers, n strengths); fold: of each follower,
    shape (n,); chosen: strength that the other folds chose for each fold.
    """

    strengths: tuple[float, ...]
    errors: FloatArray
    fold: NDArray[np.int64]
    chosen: tuple[float, ...]

    @property
    def best_strength(self) -> float:
        """The finite strength with the least mean held-out error over all followers."""
        finite = np.isfinite(self.strengths)
        return self.strengths[int(np.argmin(np.where(finite, self.errors.mean(axis=0), np.inf)))]


def study_pooling(
    tracks: Sequence[FollowingTrack],
    settings: CalibrateSettings,
    *,
    rng: np.random.Generator,
    hardest: float = UNBOUNDED,
) -> PoolingStudy:
    """Compare the strengths on at least two tracks; a follower is never part of the pool that it is drawn to.

    hardest: bound of the simulated drivers' braking [m/s^2, positive].
    """
    parts = [split(track) for track in tracks]
    problems = [pose(first, settings, hardest=hardest) for first, _ in parts]
    streams = rng.spawn(len(tracks))
    starts = [screen(p, r, count=_SCREENED, keep=_STARTS) for p, r in zip(problems, streams, strict=True)]
    own = np.array([_best(problem, start) for problem, start in zip(problems, starts, strict=True)])
    fold = rng.permutation(len(tracks)) % min(_FOLDS, len(tracks))
    errors = np.empty((len(tracks), len(STRENGTHS)))
    for i, (_, held_out) in enumerate(parts):
        prior = pool_of(own[fold != fold[i]], 0.0)
        drawn = [_drawn(problems[i], starts[i], prior, own[i], strength) for strength in STRENGTHS]
        judge = pose(held_out, CalibrateSettings(delay=settings.delay), hardest=hardest)
        errors[i] = objectives_of(judge, np.array(drawn).T)
    return _judge(errors, fold)


def _best(problem: FitProblem, starts: FloatArray) -> FloatArray:
    points, objectives = descend(problem, starts, iterations=_ITERATIONS)
    best: FloatArray = points[:, int(np.argmin(objectives))]
    return best


def _drawn(problem: FitProblem, starts: FloatArray, prior: Prior, own: FloatArray, strength: float) -> FloatArray:
    """A follower's fit of the first two thirds under a strength."""
    if strength == 0.0:
        return own
    if np.isinf(strength):
        return prior.centre
    drawn = penalised(problem, Prior(prior.centre, prior.scale, strength))
    return _best(drawn, np.concatenate([starts[:, 1:], prior.centre[:, None]], axis=1))


def _judge(errors: FloatArray, fold: NDArray[np.int64]) -> PoolingStudy:
    others = (errors[fold != held].mean(axis=0) for held in range(int(fold.max()) + 1))
    return PoolingStudy(STRENGTHS, errors, fold, tuple(STRENGTHS[int(np.argmin(mean))] for mean in others))


EVERYBODY: Final = ""
"""Key of the pool of all classes."""
# A pool's driver is chosen among at most so many of its fits, judged on at most so many of its tracks.
_JUDGED = 300
# Fewest fits of a class towards whose median its members are drawn; smaller ones are drawn to everybody's.
_LEAST_CLASS = 3


@dataclass(frozen=True)
class FittedDrivers:
    """Fits of n followers, all in one order: tracks, parameters (n, 6), vehicle classes, seeds of the fits."""

    tracks: tuple[FollowingTrack, ...]
    parameters: FloatArray
    classes: tuple[str, ...]
    seeds: tuple[int, ...]

    def __len__(self) -> int:
        return len(self.tracks)

    def take(self, places: NDArray[np.int64]) -> "FittedDrivers":
        """Those at the places, in their order."""
        return FittedDrivers(
            tuple(self.tracks[i] for i in places),
            self.parameters[places],
            tuple(self.classes[i] for i in places),
            tuple(self.seeds[i] for i in places),
        )

    def sample(self, most: int, rng: np.random.Generator) -> NDArray[np.int64]:
        """Places of at most so many of them, ascending."""
        return np.sort(rng.permutation(len(self))[:most])


def pool_drivers(
    drivers: FittedDrivers,
    settings: CalibrateSettings,
    *,
    rng: np.random.Generator,
    hardest: float = UNBOUNDED,
) -> dict[str, int]:
    """Place of the common driver of each class that has fits, and of ``EVERYBODY`` if anybody was fitted.

    With ``pool_election = "inside"`` only fits with the fewest parameters on bounds are candidates: a parameter
    that one track left on a bound says nothing of others.
    """
    pools = {name: np.flatnonzero(np.array(drivers.classes) == name) for name in sorted(set(drivers.classes))}
    pools[EVERYBODY] = np.arange(len(drivers))
    return {
        name: _common(drivers, places, settings, rng, hardest) for name, places in pools.items() if len(places)
    }


def _common(
    drivers: FittedDrivers,
    places: NDArray[np.int64],
    settings: CalibrateSettings,
    rng: np.random.Generator,
    hardest: float,
) -> int:
    members = drivers.take(places)
    judged = members.sample(_JUDGED, rng)
    problems = [pose(members.tracks[i], settings, hardest=hardest) for i in judged]
    standing = judged
    if settings.pool_election == "inside":
        on_bounds = np.array([len(bounds_hit(members.parameters[i])) for i in judged])
        standing = judged[on_bounds == on_bounds.min()]
    return int(places[standing[common_driver(problems, members.parameters[standing])]])


def refit(
    drivers: FittedDrivers, settings: CalibrateSettings, *, strength: float, hardest: float = UNBOUNDED
) -> list[FollowerFit]:
    """Everybody's fit again, drawn with a strength towards the median of his class."""
    classes = np.array(drivers.classes)
    priors = {EVERYBODY: pool_of(drivers.parameters, strength)}
    for name in set(drivers.classes):
        members = drivers.parameters[classes == name]
        if len(members) >= _LEAST_CLASS:
            priors[name] = pool_of(members, strength)
    return [
        fit_follower(track, settings, seed=seed, prior=priors.get(name, priors[EVERYBODY]), hardest=hardest)
        for track, name, seed in zip(drivers.tracks, drivers.classes, drivers.seeds, strict=True)
    ]


def with_parameters(drivers: FittedDrivers, fits: list[FollowerFit]) -> FittedDrivers:
    """The drivers with the parameters of other fits."""
    return replace(drivers, parameters=np.array([fit.parameters for fit in fits]).reshape(-1, 6))


_IDM_ELECTORS = 60
"""Most fits of the IDM in a pool that stand for election and elect."""


def pool_idm(
    tracks: Sequence[FollowingTrack], leader_lengths: FloatArray, fits: FloatArray, classes: NDArray[np.object_]
) -> dict[str, FloatArray]:
    """The IDM of each class, and of ``EVERYBODY``, that drives the pool's tracks best, shape (5,).

    leader_lengths [m] (n,); fits: v_desire, A, b, T, s0 (n, 5). Of a large pool every k-th fit is used.
    """
    found = {}
    for name in (EVERYBODY, *sorted(set(classes))):
        places = np.flatnonzero(classes == name) if name != EVERYBODY else np.arange(len(tracks))
        places = places[:: -(-len(places) // _IDM_ELECTORS)]
        problems = [pose_idm(tracks[int(i)], float(leader_lengths[i])) for i in places]
        candidates = np.insert(fits[places], 3, 0.0, axis=1)
        found[name] = fits[places[common_driver(problems, candidates)]]
    return found
