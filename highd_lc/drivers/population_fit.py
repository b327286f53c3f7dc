"""The fit of a population to recorded responses (equations.md 3.12).

It minimises the mean over responses of a power of the root mean square error of speed, drawn towards a stated
prior, by a Levenberg-Marquardt descent on reweighted squares. The moment from which the lane changer counts as
leader is chosen among ``MOMENTS``, the family of the command (LCM or IDM) and the optional constants by the error
of drivers that it was not fitted to.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.kernels import plain
from highd_lc.drivers.population import (
    CENTRES,
    HIGH,
    LOW,
    NAMES,
    NEUTRAL,
    OPTIONAL,
    PRIOR,
    SD,
    SPREAD,
    WITHOUT,
    Population,
    behaviours,
)
from highd_lc.drivers.responses import (
    HARDEST,
    SETS,
    Ahead,
    Behaviours,
    Responses,
    ahead_of,
    simulate,
    speeds_of_sets,
)
from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

MOMENTS: Final = (0.0, 0.15, 0.3, 0.5)
"""Shares of the lateral way at which the lane changer may become the leader; 0 = start, 0.5 = crossing."""
_PRIOR_WEIGHT = 0.25  # the prior counts as a quarter of a response that is off by its standard deviation
_ITERATIONS = 30
_RELAXED = 8.0  # where a second descent starts [s]
_SMALLEST_GAIN = 1e-5
_EVERY = 5  # samples from one error of speed that counts to the next
_SCREENED = 5  # iterations after which the better half of the descents goes on
_LEAST_ERROR = 1e-2  # errors below this weigh as this [m/s]
_CHAIN_WEIGHT = 0.25  # of followers behind HV_1, who keep their leader
_APART = 20  # samples between errors that count as independent
_SPREAD_PRIOR = 5.0  # drivers that the prior's spread counts as
_SPREAD_ITERATIONS = 100
_SPREAD_STEP = 0.05  # of a difference, in standard deviations
_LEAST_GAIN = 0.02  # share of the held-out error by which an optional constant, or the IDM, has to lower it
_LEAST_VOTERS = 100  # responses from which on the family is chosen
_POWER = 1.5  # of an error: between the mean error, which asks for skill, and its square, which asks for no bias


@dataclass(frozen=True)
class _Descent:
    """The objective of a fit of one family at one moment, and its reweighted squares."""

    family: str
    responses: Responses
    moment: float
    pinned: NDArray[np.bool_]
    hardest: float

    @cached_property
    def _joins(self) -> IntArray:
        return self.responses.joins(np.full(len(self.responses), self.moment))

    @cached_property
    def _ahead(self) -> Ahead:
        return ahead_of(self.responses, self._joins)

    @cached_property
    def _share(self) -> FloatArray:
        """What an error of speed counts: 1 over the root of their number, 0 where nothing was recorded; (k, R)."""
        seen = self.responses.seen[_EVERY::_EVERY]
        return np.asarray(seen / np.sqrt(np.maximum(seen.sum(axis=0), 1)))

    @cached_property
    def _side_by_side(self) -> Ahead:
        """Whom the followers have ahead, a response's samples side by side, shape (R, K)."""
        return Ahead(*(plain(values.T) for values in self._ahead))

    def residuals(self, constants: FloatArray) -> FloatArray:
        """Errors of speed over the square root of their number, 0 where nothing was recorded, shape (k, R)."""
        r, drivers = self.responses, self.drivers(constants)
        found = simulate(self.family, drivers, r, hardest=self.hardest, joins=self._joins, ahead=self._ahead)
        return np.asarray((found.v - r.v)[_EVERY::_EVERY] * self._share)

    def drivers(self, constants: FloatArray) -> Behaviours:
        """The drivers under these constants."""
        return behaviours(constants, self.responses, self.moment, family=self.family)

    @property
    def centre(self) -> FloatArray:
        """Of the prior."""
        return CENTRES[self.family]

    @cached_property
    def weights(self) -> FloatArray:
        """Of each response, summing to 1."""
        w = np.where(self.responses.rank == 1, 1.0, _CHAIN_WEIGHT)
        return np.asarray(w / w.sum())

    def objective(self, constants: FloatArray, residuals: FloatArray) -> float:
        """Mean power of a response's error and the prior's share."""
        errors = np.sqrt((residuals**2).sum(axis=0) + _LEAST_ERROR**2)
        return float(self.weights @ errors**_POWER + 0.5 * self._prior @ ((constants - self.centre) / SD) ** 2)

    @cached_property
    def _prior(self) -> FloatArray:
        return np.where(self.pinned, 0.0, _PRIOR_WEIGHT / len(self.responses))

    def normal_equations(self, constants: FloatArray, residuals: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Hessian and gradient of the reweighted squares, over the constants that are free."""
        errors = np.sqrt((residuals**2).sum(axis=0) + _LEAST_ERROR**2)
        root = np.sqrt(_POWER * self.weights * errors ** (_POWER - 2.0))
        free = np.flatnonzero(~self.pinned)
        parts = [
            self._slopes(constants, free[first : first + SETS - 1]) for first in range(0, len(free), SETS - 1)
        ]
        slopes = np.concatenate(parts, axis=2) * (self._share * root).T[:, :, None]
        slopes = slopes.reshape(-1, len(free))
        pull = self._prior[free] / SD[free] ** 2
        gradient = slopes.T @ (residuals * root).T.ravel() + pull * (constants - self.centre)[free]
        return slopes.T @ slopes + np.diag(pull), gradient

    def _slopes(self, constants: FloatArray, moved: IntArray) -> FloatArray:
        """Derivatives of the speeds by some constants, shape (R, k, len(moved)), by differences."""
        steps = 1e-4 * (HIGH - LOW)
        steps = np.where(constants + steps <= HIGH, steps, -steps)
        sets = [constants + steps * (np.arange(len(NAMES)) == j) for j in (-1, *moved)]
        drivers = [self.drivers(one) for one in sets + sets[:1] * (SETS - len(sets))]
        stacked = Behaviours(*(plain(np.stack(values, axis=1)) for values in zip(*drivers, strict=True)))
        start = np.stack([self.responses.x[0], self.responses.v[0]])
        v = speeds_of_sets(
            self.family, stacked, self._side_by_side, self._joins, start, every=_EVERY, hardest=self.hardest
        )
        return np.asarray((v[:, :, 1 : len(sets)] - v[:, :, :1]) / steps[moved])


def fit(
    responses: Responses,
    *,
    source: str,
    without: tuple[str, ...] = (),
    hardest: float = HARDEST,
    like: Population | None = None,
) -> Population:
    """The population of these responses; the prior where there are none.

    without: constants held at 0, such as ``memory`` or ``relaxation``. hardest: bound of braking [m/s^2]. like:
    the population of the same responses with all of its parts, whose moment, family and options are kept.
    """
    if not len(responses):
        return PRIOR
    if like is not None:
        return _ablated(like, responses, source, without, hardest)
    options = [name for name in OPTIONAL if name not in without]
    problem, constants = _best_moment(names.LCM, responses, (*without, *OPTIONAL), hardest)
    bare = _held_out(problem, constants)
    if len(responses) >= _LEAST_VOTERS:
        other = _best_moment(names.IDM, responses, (*without, *OPTIONAL), hardest)
        reached = _held_out(*other)
        if reached < (1.0 - _LEAST_GAIN) * bare:
            (problem, constants), bare = other, reached
    freed = problem.pinned & ~_chosen_options(problem, constants, options, bare)
    if (freed != problem.pinned).any():
        constants, _ = _descend(replace(problem, pinned=freed), constants)
    spread = _spread(problem, constants)
    return Population(constants, problem.moment, len(responses), source, spread, problem.family)


def _ablated(
    like: Population, responses: Responses, source: str, without: tuple[str, ...], hardest: float
) -> Population:
    """A population without some of its parts, fitted anew from where it stands."""
    unused = np.isin(NAMES, OPTIONAL) & (like.constants == NEUTRAL)
    pinned = np.isin(NAMES, (*without, *WITHOUT[like.family])) | unused
    problem = _Descent(like.family, responses, like.moment, pinned, hardest)
    constants, _ = _descend(problem, np.where(pinned, NEUTRAL, like.constants))
    spread = _spread(problem, constants)
    return replace(like, constants=constants, n_responses=len(responses), source=source, spread=spread)


def _best_moment(
    family: str, responses: Responses, without: tuple[str, ...], hardest: float
) -> tuple[_Descent, FloatArray]:
    """The fit of a family at the moment that suits the responses best, and its constants."""
    pinned = np.array([name in (*without, *WITHOUT[family]) for name in NAMES])
    problems = [_Descent(family, responses, moment, pinned, hardest) for moment in MOMENTS]
    begun = [(one, *_descend(one, start, _SCREENED)) for one in problems for start in _starts(one)]
    begun = sorted(begun, key=lambda found: found[2])[: (len(begun) + 1) // 2]
    fits = [(one, *_descend(one, constants)) for one, constants, _ in begun]
    problem, constants, _ = min(fits, key=lambda found: found[2])
    return problem, constants


def _spread(problem: _Descent, constants: FloatArray) -> FloatArray:
    """How much drivers differ in each parameter of the LCM, by what the population leaves unexplained, (6,).

    A linear mixed model of the errors of speed, z the drivers' deviations in the prior's standard deviations:
    error = J z + noise, z ~ N(0, D), by expectation maximisation; the prior, D = 1, counts as a few drivers. How
    large D is altogether follows from the errors' mean square (``_share_left``).
    """
    r, apart = problem.responses, slice(_APART, None, _APART)
    b = problem.drivers(constants)
    bare = simulate(problem.family, b, r, hardest=problem.hardest).v[apart]
    error = np.where(r.seen[apart], r.v[apart] - bare, 0.0)
    slopes = np.empty((len(PARAMETERS), *error.shape))
    for j, name in enumerate(PARAMETERS):
        step = _SPREAD_STEP * SPREAD[j]
        moved = b._replace(**{name: getattr(b, name) + step})
        found = simulate(problem.family, moved, r, hardest=problem.hardest).v[apart]
        slopes[j] = np.where(r.seen[apart], (found - bare) / _SPREAD_STEP, 0.0)
    H, g = np.einsum("ikr,jkr->rij", slopes, slopes), np.einsum("ikr,kr->ri", slopes, error)
    samples = max(int(r.seen[apart].sum()), 1)
    D, noise = np.ones(len(PARAMETERS)), float((error**2).sum()) / samples + _LEAST_ERROR**2
    for _ in range(_SPREAD_ITERATIONS):
        V = np.linalg.inv(np.diag(1.0 / D) + H / noise)
        z = np.einsum("rij,rj->ri", V, g) / noise
        left = error - np.einsum("ikr,ri->kr", slopes, z)
        noise = (float((left**2).sum()) + float(np.einsum("rij,rji->", H, V))) / samples + _LEAST_ERROR**2
        seen = (z**2 + np.diagonal(V, axis1=1, axis2=2)).sum(axis=0)
        D = (_SPREAD_PRIOR + seen) / (_SPREAD_PRIOR + len(r))
    explained = float(np.einsum("rii,i->", H, D)) / samples
    share = _share_left(float((error**2).sum()) / samples, noise, explained, samples)
    has = ~np.isin(PARAMETERS, WITHOUT[problem.family])
    return np.asarray(has * SPREAD * np.sqrt(D * share ** (len(r) / (len(r) + _SPREAD_PRIOR))))


def _share_left(left: float, noise: float, explained: float, samples: int) -> float:
    """By which share drivers differ less than D says, by the method of moments: mean J D J' = left - noise.

    left: mean square of the errors; explained: mean J D J' [m^2/s^2]. Without it a prior that is far too wide
    stands out: of parameters that trade against each other each keeps a share of it. A difference below its own
    sampling error counts as that.
    """
    if not explained > 0.0:
        return 1.0
    return float(max(left - noise, noise * np.sqrt(2.0 / samples)) / explained)


def _chosen_options(
    problem: _Descent, constants: FloatArray, options: list[str], bare: float
) -> NDArray[np.bool_]:
    """Which optional constants lower the error of the half of the responses that they are not fitted to.

    Halves are recordings, or events where there is one recording alone. constants: where every fit starts. bare:
    the error without them.
    """
    chosen = np.zeros(len(NAMES), bool)
    for name in options:
        wanted = np.array(NAMES) == name
        error = _held_out(replace(problem, pinned=problem.pinned & ~wanted), constants)
        chosen |= wanted & (error < (1.0 - _LEAST_GAIN) * bare)
    return chosen


def _held_out(problem: _Descent, constants: FloatArray) -> float:
    """Mean power of the error of responses, each half by the constants of the other; infinite without two."""
    r = problem.responses
    _, place = np.unique(r.recording if len(np.unique(r.recording)) > 1 else r.event, return_inverse=True)
    halves = [place % 2 == half for half in (0, 1)]
    if not all(half.any() for half in halves):
        return np.inf
    total = 0.0
    for held in halves:
        fitted, _ = _descend(replace(problem, responses=r.take(~held)), constants)
        part = replace(problem, responses=r.take(held), pinned=np.ones(len(NAMES), bool))
        total += held.mean() * part.objective(fitted, part.residuals(fitted))
    return total


def _start(problem: _Descent) -> FloatArray:
    return np.where(problem.pinned, NEUTRAL, problem.centre)


def _starts(problem: _Descent) -> Iterator[FloatArray]:
    """The prior's centre; and with relaxation, whose derivative vanishes at the prior's 0."""
    yield _start(problem)
    place = NAMES.index("relaxation")
    if not problem.pinned[place]:
        yield np.where(np.arange(len(NAMES)) == place, _RELAXED, _start(problem))


def _descend(problem: _Descent, start: FloatArray, iterations: int = _ITERATIONS) -> tuple[FloatArray, float]:
    """Levenberg-Marquardt within bounds: the constants and their objective."""
    constants = start
    residuals = problem.residuals(constants)
    value, damping = problem.objective(constants, residuals), 1e-2
    for _ in range(iterations):
        hessian, gradient = problem.normal_equations(constants, residuals)
        step = _accepted(problem, constants, value, hessian, gradient, damping)
        if step is None:
            break
        gain = value - step[2]
        constants, residuals, value, damping = step
        if gain < _SMALLEST_GAIN:
            break
    return constants, value


def _accepted(
    problem: _Descent,
    constants: FloatArray,
    value: float,
    hessian: FloatArray,
    gradient: FloatArray,
    damping: float,
) -> tuple[FloatArray, FloatArray, float, float] | None:
    """The first damped step that lowers the objective: constants, residuals, value and the next damping."""
    free = np.flatnonzero(~problem.pinned)
    for _ in range(10):
        step = np.linalg.solve(hessian + damping * np.diag(np.diag(hessian) + 1e-12), -gradient)
        trial = constants.copy()
        trial[free] = np.clip(trial[free] + step, LOW[free], HIGH[free])
        residuals = problem.residuals(trial)
        reached = problem.objective(trial, residuals)
        if reached < value:
            return trial, residuals, reached, max(damping / 4.0, 1e-9)
        damping *= 4.0
    return None
