"""Fits drawn towards a common driver, and whether they predict better than fits of one's own.

The penalty of ``drivers.calibration`` draws a fit towards the median of the other followers' fits. Its strength is
judged by the error on the held-out last third of each track, simulated from the first recorded state of that third
with parameters fitted to the first two thirds.

All fitted drivers together: samples of them, fits drawn to their class, and who drives for the unfitted.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.car_following import FitProblem, FollowingTrack, objectives_of
from highd_lc.core.drive import UNBOUNDED
from highd_lc.drivers.calibration import FollowerFit, Prior, common_driver, fit_follower, penalised, pool_of, pose
from highd_lc.drivers.least_squares import descend, screen
from highd_lc.vocab.settings import CalibrateSettings

FloatArray = NDArray[np.float64]

STRENGTHS: Final = (0.0, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, np.inf)
"""Strengths that are compared: 0 = everyone's own fit, infinite = everyone drives as the pool's median."""
_FOLDS = 5
_SCREENED, _STARTS, _ITERATIONS = 512, 16, 25


def split(track: FollowingTrack) -> tuple[FollowingTrack, FollowingTrack]:
    """First two thirds and last third of a track."""
    rows = track.as_array()
    cut = round(2 * rows.shape[1] / 3)
    return FollowingTrack(*rows[:, :cut]), FollowingTrack(*rows[:, cut:])


@dataclass(frozen=True)
class PoolingStudy:
    """Held-out errors of fits drawn to the pool with each strength.

    errors: closed-loop objective on the last third, shape (n followers, n strengths); fold: of each follower,
    shape (n,); chosen: strength that the other folds chose for each fold; cross_validated: mean held-out error
    with the chosen strengths.
    """

    strengths: tuple[float, ...]
    errors: FloatArray
    fold: NDArray[np.int64]
    chosen: tuple[float, ...]
    cross_validated: float

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
    chosen, found = [], []
    for held in range(int(fold.max()) + 1):
        place = int(np.argmin(errors[fold != held].mean(axis=0)))
        chosen.append(STRENGTHS[place])
        found.append(errors[fold == held, place])
    return PoolingStudy(STRENGTHS, errors, fold, tuple(chosen), float(np.concatenate(found).mean()))


EVERYBODY: Final = ""
"""Key of the pool of all classes."""
# Most fits of a pool that stand for election as its driver, and most tracks that elect.
_ELECTORS = 300
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
    """Place of the common driver of each class that has fits, and of ``EVERYBODY`` if anybody was fitted."""
    pools = {name: np.flatnonzero(np.array(drivers.classes) == name) for name in sorted(set(drivers.classes))}
    pools[EVERYBODY] = np.arange(len(drivers))
    return {name: _elect(drivers, places, settings, rng, hardest) for name, places in pools.items() if len(places)}


def _elect(
    drivers: FittedDrivers,
    places: NDArray[np.int64],
    settings: CalibrateSettings,
    rng: np.random.Generator,
    hardest: float,
) -> int:
    members = drivers.take(places)
    electors = members.sample(_ELECTORS, rng)
    problems = [pose(members.tracks[i], settings, hardest=hardest) for i in electors]
    return int(places[electors[common_driver(problems, members.parameters[electors])]])


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
