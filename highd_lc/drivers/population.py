"""The population: one follower model for all, fitted to the responses of followers of *other* recordings.

Its constants are few; each driver is adapted to by what was seen of him before t_start: his acceleration, his
speed and the time gap that he kept. The fit minimises the mean over responses of a power of the root mean
square error of speed, drawn towards a stated prior, by a Levenberg-Marquardt descent on reweighted squares; the
moment from which the lane changer counts as leader is chosen among ``MOMENTS``, the family of the command (LCM or
IDM) by the error of drivers that it was not fitted to.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.lcm import MOTORWAY
from highd_lc.drivers.responses import (
    HARDEST,
    SERIES,
    Ahead,
    Behaviours,
    Responses,
    Simulated,
    ahead_of,
    simulate,
)
from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

TIME_GAP: Final = 1.3
"""Time gap around which own time gaps are counted [s]."""
MOMENTS: Final = (0.0, 0.15, 0.3, 0.5)
"""Shares of the lateral way at which the lane changer may become the leader; 0 = start, 0.5 = crossing."""


@dataclass(frozen=True)
class Constant:
    """A constant of the population: bounds, the prior's centre and standard deviation, unit, meaning."""

    name: str
    low: float
    high: float
    centre: float
    sd: float
    unit: str
    meaning: str


CONSTANTS: Final = (
    Constant("v_desire", 15.0, 50.0, 25.5, 4.0, "m/s", "desired speed"),
    Constant(
        "own_speed", 0.0, 1.0, 0.0, 0.3, "", "share of the desired speed that is the driver's own speed and more"
    ),
    Constant("above", 0.0, 15.0, 3.0, 3.0, "m/s", "desired speed above the own speed at t_start"),
    Constant("A", 0.05, 4.0, 0.85, 0.3, "m/s²", "maximum acceleration"),
    Constant("b", 0.5, 10.0, 2.0, 0.5, "m/s²", "deceleration that the driver is willing to use"),
    Constant("B", 0.5, 10.0, 1.4, 0.4, "m/s²", "deceleration that the driver expects of the leader"),
    Constant("tau", 0.2, 8.0, 3.4, 0.8, "s", "perception-reaction time"),
    Constant("own_time_gap", -0.5, 1.5, 0.0, 0.3, "", "share of the own time gap's deviation that goes into tau"),
    Constant("L_0", 2.0, 8.0, 4.0, 1.0, "m", "spacing at standstill beyond the leader's length"),
    Constant("truck", 0.5, 2.0, 1.0, 0.2, "", "factor of tau for trucks"),
    Constant("truck_A", 0.3, 2.0, 1.0, 0.2, "", "factor of A for trucks"),
    Constant("memory", 0.0, 15.0, 6.5, 2.0, "s", "time constant with which the acceleration at t_start fades"),
    Constant(
        "persistence", 0.0, 1.2, 1.0, 0.3, "", "share of the acceleration at t_start that is the driver's intent"
    ),
    Constant("lasting", 0.0, 1.0, 0.5, 0.3, "", "share of that acceleration that is read over 2 s"),
    Constant("own_offset", 0.0, 1.0, 0.0, 0.2, "", "share of his acceleration beyond his command that stays"),
    Constant("idle", 0.0, 1.0, 0.0, 0.3, "", "weight of nothing happens behind who is 2 m/s faster"),
    Constant("relaxation", 0.0, 30.0, 0.0, 5.0, "s", "time in which the jump at a change of leader fades"),
)
"""The prior's centres are the constants found on seven real recordings (equations.md 3.12)."""
OPTIONAL: Final = ("truck_A", "own_offset", "idle")
"""Constants that count where they predict drivers better that they were not fitted to."""

NAMES: Final = tuple(c.name for c in CONSTANTS)
_LOW, _HIGH = np.array([c.low for c in CONSTANTS]), np.array([c.high for c in CONSTANTS])
_NEUTRAL = np.array([1.0 if name.startswith("truck") or name == "B" else 0.0 for name in NAMES])
_SD = np.array([c.sd for c in CONSTANTS])
_OF_IDM = {"v_desire": MOTORWAY.v_desire, "A": MOTORWAY.A, "b": MOTORWAY.b, "tau": MOTORWAY.T, "L_0": MOTORWAY.s0}
_CENTRES: Final = {
    names.LCM: np.array([c.centre for c in CONSTANTS]),
    names.IDM: np.array([_OF_IDM.get(c.name, c.centre) for c in CONSTANTS]),
}
"""The prior's centres by family: of the IDM the values of the book for motorways, tau its time gap, L_0 its gap at
standstill."""
_WITHOUT: Final = {names.LCM: (), names.IDM: ("B",)}
"""Constants that a family does not have."""
SPREAD: Final = _SD[[NAMES.index(name) for name in ("v_desire", "A", "b", "B", "tau", "L_0")]]
"""How much drivers are taken to differ a priori: standard deviations, in the LCM's order of parameters."""
NEED: Final = 1.5
"""Required deceleration from which a driver brakes at once, whatever he remembers [m/s^2]."""
_PRIOR_WEIGHT = 0.25  # the prior counts as a quarter of a response that is off by its standard deviation
_ITERATIONS = 30
_RELAXED = 8.0  # where a second descent starts [s]
_SMALLEST_GAIN = 1e-5
_LEAST_ERROR = 1e-2  # errors below this weigh as this [m/s]
_CHAIN_WEIGHT = 0.25  # of followers behind HV_1, who keep their leader
_APART = 20  # samples between errors that count as independent
_SPREAD_PRIOR = 5.0  # drivers that the prior's spread counts as
_SPREAD_ITERATIONS = 100
_SPREAD_STEP = 0.05  # of a difference, in standard deviations
_OPENING = 2.0  # by so much faster a lane changer opens the gap by itself [m/s]
_LEAST_GAIN = 0.02  # share of the held-out error by which an optional constant, or the IDM, has to lower it
_LEAST_VOTERS = 100  # responses from which on the family is chosen
_LEAST_COMMAND = 1e-3  # what an IDM that does nothing does: A = 0 has no desired gap
_MOST_OFFSET = 1.0  # no driver's own offset is read from more than this [m/s^2]
_POWER = 1.5  # of an error: between the mean error, which asks for skill, and its square, which asks for no bias


@dataclass(frozen=True)
class Population:
    """Fitted constants (order of ``NAMES``), moment of the change of leader, responses used, their source; and how
    much drivers differ: a standard deviation of each parameter of the LCM, shape (6,). family: of the command.
    """

    constants: FloatArray
    moment: float
    n_responses: int
    source: str
    spread: FloatArray = field(default_factory=SPREAD.copy)
    family: str = names.LCM

    def __getitem__(self, name: str) -> float:
        return float(self.constants[NAMES.index(name)])


PRIOR: Final = Population(_CENTRES[names.LCM], 0.5, 0, "prior")


def behaviours(
    constants: FloatArray, responses: Responses, moment: float, *, family: str = names.LCM
) -> Behaviours:
    """Every driver of the responses under the population's constants, by a command of that family."""
    c = dict(zip(NAMES, constants, strict=True))
    v_0, ones = responses.v[0], np.ones(len(responses))
    gap = np.clip(np.nan_to_num(responses.time_gap - TIME_GAP), -1.0, 1.5)
    tau = np.maximum(c["tau"] + c["own_time_gap"] * gap, 0.1) * np.where(responses.truck, c["truck"], 1.0)
    lasting = (1.0 - c["lasting"]) * responses.a_0 + c["lasting"] * responses.a_lasting - responses.drift
    # A weight of nothing happens in the command is a factor of A: commands are proportional to it, the IDM's where
    # A b stays the same.
    opening = np.clip((responses.v_ahead[0] - v_0) / _OPENING, 0.0, 1.0) * (responses.rank == 1)
    active = np.maximum(1.0 - c["idle"] * opening, _LEAST_COMMAND if family == names.IDM else 0.0)
    behind, before = (0.0, 0.0) if family == names.IDM else (responses.ahead_length, responses.before_length)
    found = Behaviours(
        v_desire=(1.0 - c["own_speed"]) * c["v_desire"] + c["own_speed"] * (v_0 + c["above"]),
        A=c["A"] * np.where(responses.truck, c["truck_A"], 1.0) * active,
        b=c["b"] / (active if family == names.IDM else ones),
        B=c["B"] * ones,
        tau=tau,
        L=c["L_0"] * ones + behind,
        L_before=c["L_0"] * ones + before,
        memory=c["memory"] * ones,
        relaxation=c["relaxation"] * ones,
        need=NEED * ones,
        a_0=responses.drift + c["persistence"] * lasting,
        drift=responses.drift,
        moment=moment * ones,
    )
    if not c["own_offset"]:
        return found
    beyond = np.clip(lasting - _commands_at_start(family, found, responses), -_MOST_OFFSET, _MOST_OFFSET)
    return found._replace(drift=responses.drift + c["own_offset"] * beyond)


def _commands_at_start(family: str, b: Behaviours, responses: Responses) -> FloatArray:
    """What every driver's model commands at t_start behind the leader before the change [m/s^2], shape (R,)."""
    series = {f.name: getattr(responses, f.name)[:1] for f in fields(responses) if f.name in SERIES}
    nothing, never = np.zeros(len(responses)), np.full(len(responses), np.inf)
    bare = b._replace(memory=nothing, drift=nothing, need=never, moment=never)
    return np.asarray(simulate(family, bare, replace(responses, **series), hardest=np.inf).a[0])


def respond(population: Population, responses: Responses) -> Simulated:
    """The followers as the population has them, braking by ``HARDEST`` at most."""
    drivers = behaviours(population.constants, responses, population.moment, family=population.family)
    return simulate(population.family, drivers, responses)


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
        """What a sample's error of speed counts: 1 over the root of their number, 0 where nothing was recorded."""
        return np.asarray(self.responses.seen / np.sqrt(self.responses.n))

    def residuals(self, constants: FloatArray) -> FloatArray:
        """Errors of speed over the square root of their number, 0 where nothing was recorded, shape (K, R)."""
        r, drivers = self.responses, self.drivers(constants)
        found = simulate(self.family, drivers, r, hardest=self.hardest, joins=self._joins, ahead=self._ahead)
        return np.asarray((found.v - r.v) * self._share)

    def drivers(self, constants: FloatArray) -> Behaviours:
        """The drivers under these constants."""
        return behaviours(constants, self.responses, self.moment, family=self.family)

    @property
    def centre(self) -> FloatArray:
        """Of the prior."""
        return _CENTRES[self.family]

    @cached_property
    def weights(self) -> FloatArray:
        """Of each response, summing to 1."""
        w = np.where(self.responses.rank == 1, 1.0, _CHAIN_WEIGHT)
        return np.asarray(w / w.sum())

    def objective(self, constants: FloatArray, residuals: FloatArray) -> float:
        """Mean power of a response's error and the prior's share."""
        errors = np.sqrt((residuals**2).sum(axis=0) + _LEAST_ERROR**2)
        return float(self.weights @ errors**_POWER + 0.5 * self._prior @ ((constants - self.centre) / _SD) ** 2)

    @cached_property
    def _prior(self) -> FloatArray:
        return np.where(self.pinned, 0.0, _PRIOR_WEIGHT / len(self.responses))

    def normal_equations(self, constants: FloatArray, residuals: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Hessian and gradient of the reweighted squares, over the constants that are free."""
        errors = np.sqrt((residuals**2).sum(axis=0) + _LEAST_ERROR**2)
        root = np.sqrt(_POWER * self.weights * errors ** (_POWER - 2.0))
        free = np.flatnonzero(~self.pinned)
        slopes = np.stack([(self._slope(constants, residuals, int(j)) * root).ravel() for j in free])
        pull = self._prior[free] / _SD[free] ** 2
        gradient = slopes @ (residuals * root).ravel() + pull * (constants - self.centre)[free]
        return slopes @ slopes.T + np.diag(pull), gradient

    def _slope(self, constants: FloatArray, residuals: FloatArray, j: int) -> FloatArray:
        step = 1e-4 * (_HIGH[j] - _LOW[j])
        step = step if constants[j] + step <= _HIGH[j] else -step
        moved = constants.copy()
        moved[j] += step
        return np.asarray((self.residuals(moved) - residuals) / step)


def fit(
    responses: Responses, *, source: str, without: tuple[str, ...] = (), hardest: float = HARDEST
) -> Population:
    """The population of these responses; the prior where there are none.

    without: constants held at 0, such as ``memory`` or ``relaxation``. hardest: bound of braking [m/s^2].
    """
    if not len(responses):
        return PRIOR
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


def _best_moment(
    family: str, responses: Responses, without: tuple[str, ...], hardest: float
) -> tuple[_Descent, FloatArray]:
    """The fit of a family at the moment that suits the responses best, and its constants."""
    pinned = np.array([name in (*without, *_WITHOUT[family]) for name in NAMES])
    problems = [_Descent(family, responses, moment, pinned, hardest) for moment in MOMENTS]
    fits = [(one, *_descend(one, start)) for one in problems for start in _starts(one)]
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
    has = ~np.isin(PARAMETERS, _WITHOUT[problem.family])
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
    return np.where(problem.pinned, _NEUTRAL, problem.centre)


def _starts(problem: _Descent) -> Iterator[FloatArray]:
    """The prior's centre; and with relaxation, whose derivative vanishes at the prior's 0."""
    yield _start(problem)
    place = NAMES.index("relaxation")
    if not problem.pinned[place]:
        yield np.where(np.arange(len(NAMES)) == place, _RELAXED, _start(problem))


def _descend(problem: _Descent, start: FloatArray) -> tuple[FloatArray, float]:
    """Levenberg-Marquardt within bounds: the constants and their objective."""
    constants = start
    residuals = problem.residuals(constants)
    value, damping = problem.objective(constants, residuals), 1e-2
    for _ in range(_ITERATIONS):
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
        trial[free] = np.clip(trial[free] + step, _LOW[free], _HIGH[free])
        residuals = problem.residuals(trial)
        reached = problem.objective(trial, residuals)
        if reached < value:
            return trial, residuals, reached, max(damping / 4.0, 1e-9)
        damping *= 4.0
    return None
