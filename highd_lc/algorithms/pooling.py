"""Fits drawn towards a common driver, and whether they predict better than fits of one's own.

The penalty of ``algorithms.prior`` draws a fit towards the median of the other followers' fits. Its strength is
judged by the error on the held-out last third of each track, simulated from the first recorded state of that third
with parameters fitted to the first two thirds.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.algorithms.calibration import pose
from highd_lc.algorithms.least_squares import descend
from highd_lc.algorithms.prior import Prior, penalised, pool_of
from highd_lc.algorithms.screening import screen
from highd_lc.core.car_following import FollowingTrack, objectives_of
from highd_lc.core.car_following_kernel import FitProblem
from highd_lc.core.drive import UNBOUNDED
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
