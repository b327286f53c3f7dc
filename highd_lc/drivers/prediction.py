"""How well follower models predict: errors behind the recorded ego, against models in which nothing happens.

Only what both tracks show is scored. Braking, comfort and loss are those of the speed smoothed over 1 s, recorded
and simulated alike, so that a tracker's noise is not held against a driver.

Matched controls: followers that nobody cuts in on, alike before the start to those that somebody does. A control
is a vehicle that keeps its lane and its leader from half a second before its start to the horizon. It is matched
to a follower by class, carriageway and lane, and by speed, acceleration, spacing and closing speed within
calipers; the nearest few count (equations.md 3.13).

Cross-fitting: the constants for a recording's followers come from other recordings, by folds
(``responses.folds``, equations.md 3.12). A driver's own response is never among those behind his constants.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from highd_lc.drivers import models
from highd_lc.drivers.population import PRIOR, Population
from highd_lc.drivers.population_fit import fit
from highd_lc.drivers.responses import HARDEST, TIME_STEP, Behaviours, Fold, Responses, Simulated, folds
from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS
from highd_lc.vocab.follower_names import parse

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

HORIZONS: Final = (1.0, 2.0, 3.0, 5.0, 8.0)
"""Times after t_start at which followers are judged [s]."""
EXTERNALITY_HORIZONS: Final = (5.0, 8.0)
"""Times over which the cost of a lane change to HV_1 is counted [s]."""
SMOOTHING: Final = 1.0
"""Width of the moving mean over speeds before braking and comfort are read [s]."""
_LEAST_ACCELERATION = 0.1  # below it an acceleration weighs as this in the paper's J [m/s^2]
SPACINGS: Final = (20.0, 35.0, 60.0)
"""Bounds of the classes of spacing [m]."""
CLOSINGS: Final = (-2.0, 0.0, 2.0, 5.0)
"""Bounds of the classes of closing speed [m/s]."""


@dataclass(frozen=True)
class Scales:
    """Reference speed of the followers [m/s], N_c [m/s^3] and N_e [m/s] of the losses (equations.md 4)."""

    v_ref: float
    comfort: float
    efficiency: float


class Judged(NamedTuple):
    """A model's prediction of R followers at one horizon, each of shape (R,); NaN where that is not in view."""

    error_speed: FloatArray
    error_position: FloatArray
    rmse_speed: FloatArray
    change_simulated: FloatArray
    change_recorded: FloatArray
    peak_decel_simulated: FloatArray
    peak_decel_recorded: FloatArray
    comfort_simulated: FloatArray
    comfort_recorded: FloatArray
    loss_simulated: FloatArray
    loss_recorded: FloatArray
    nrmse_spacing: FloatArray
    theil_u: FloatArray
    paper_j: FloatArray
    contact: BoolArray
    contact_recorded: BoolArray


def in_view(responses: Responses, horizon: float) -> BoolArray:
    """Which responses are recorded up to the horizon [s], shape (R,)."""
    return responses.n > round(horizon / TIME_STEP)


def judge(
    simulated: Simulated, responses: Responses, horizon: float, scales: Scales, *, ahead: FloatArray | None = None
) -> Judged:
    """Compare simulated with recorded followers up to a horizon [s].

    ahead: fronts of those whom the simulated followers get as leader [m], shape (K, R); None: the recorded ones.
    """
    last = round(horizon / TIME_STEP)
    seen = np.where(in_view(responses, horizon), 0.0, np.nan)
    v, recorded = simulated.v[: last + 1], responses.v[: last + 1]
    error = v - recorded
    drifted = responses.drift * horizon
    fronts = responses.x_ahead if ahead is None else ahead
    own, theirs = _smooth_motion(v, scales), _smooth_motion(recorded, scales)
    spacing = (fronts - simulated.x)[: last + 1]
    kept = (responses.x_ahead - responses.x)[: last + 1]
    return Judged(
        error_speed=error[-1] + seen,
        error_position=(simulated.x - responses.x)[last] + seen,
        rmse_speed=np.sqrt((error**2).mean(axis=0)) + seen,
        change_simulated=v[-1] - v[0] - drifted + seen,
        change_recorded=recorded[-1] - recorded[0] - drifted + seen,
        peak_decel_simulated=own.peak + seen,
        peak_decel_recorded=theirs.peak + seen,
        comfort_simulated=own.comfort + seen,
        comfort_recorded=theirs.comfort + seen,
        loss_simulated=own.loss + seen,
        loss_recorded=theirs.loss + seen,
        nrmse_spacing=_rms(spacing - kept) / _rms(kept) + seen,
        theil_u=_rms(spacing - kept) / (_rms(spacing) + _rms(kept)) + seen,
        paper_j=_paper_j(v, recorded) + seen,
        contact=contacts(simulated.x[: last + 1], fronts, responses),
        contact_recorded=contacts(responses.x[: last + 1], responses.x_ahead, responses),
    )


def contacts(x: FloatArray, ahead: FloatArray, responses: Responses) -> BoolArray:
    """Whether fronts x (K, R) pass the rear bumper ahead, shape (R,): the changer's from half of its way on."""
    r, samples = responses, len(x)
    rear = np.where(r.progress >= 0.5, ahead - r.ahead_length, r.before_x - r.before_length)
    return np.asarray((rear[:samples] < x).any(axis=0))


def _rms(values: FloatArray) -> FloatArray:
    """Root mean square over the samples of (K, R)."""
    return np.asarray(np.sqrt((values**2).mean(axis=0)))


def _paper_j(v: FloatArray, recorded: FloatArray) -> FloatArray:
    """The paper's J (equations.md 9.4) of the accelerations of speeds (K, R), smoothed; NaN of who has none."""
    found, known = (np.diff(_smoothed(values), axis=0) / TIME_STEP for values in (v, recorded))
    size = np.abs(known)
    with np.errstate(invalid="ignore", divide="ignore"):
        j = ((found - known) ** 2 / np.maximum(size, _LEAST_ACCELERATION)).sum(axis=0) / size.sum(axis=0)
    return np.where(size.sum(axis=0) > 0.0, j, np.nan)


def _smoothed(v: FloatArray) -> FloatArray:
    """Moving means of speeds (K, R) over ``SMOOTHING``."""
    width = round(SMOOTHING / TIME_STEP) + 1
    padded = np.concatenate([np.zeros((1, v.shape[1])), np.cumsum(v, axis=0)])
    return np.asarray((padded[width:] - padded[:-width]) / width)


class _Smooth(NamedTuple):
    peak: FloatArray
    comfort: FloatArray
    loss: FloatArray


def _smooth_motion(v: FloatArray, scales: Scales) -> _Smooth:
    """Peak braking [m/s^2], comfort sum and loss of speeds (K, R), smoothed."""
    smooth = _smoothed(v) if len(v) >= round(SMOOTHING / TIME_STEP) + 1 else v[:0]
    if len(smooth) < 3:  # too short for a jerk
        unknown = np.full(v.shape[1], np.nan)
        return _Smooth(unknown, unknown, unknown)
    a = np.diff(smooth, axis=0) / TIME_STEP
    comfort = np.abs(np.diff(a, axis=0)).sum(axis=0) / TIME_STEP / scales.comfort
    efficiency = np.abs(v - scales.v_ref).sum(axis=0) / scales.efficiency
    peak = np.maximum(-a.min(axis=0), 0.0)
    return _Smooth(peak, comfort, 0.5 * comfort + 0.5 * efficiency)


def motion_loss(v: FloatArray, scales: Scales) -> FloatArray:
    """Loss of speeds (K, R), comfort of the smoothed speed; shape (R,), NaN where K is too short for a comfort."""
    return _smooth_motion(v, scales).loss


def loss_change(v: FloatArray, scales: Scales) -> FloatArray:
    """Loss of speeds (K, R) beyond that of keeping the first one, smoothed; shape (R,)."""
    kept = len(v) * np.abs(v[0] - scales.v_ref) / scales.efficiency
    return np.asarray(_smooth_motion(v, scales).loss - 0.5 * kept)


def class_labels(bounds: tuple[float, ...]) -> tuple[str, ...]:
    """Words of the classes between bounds, the open ends included."""
    inner = [f"{low:g} .. {high:g}" for low, high in pairwise(bounds)]
    return (f"< {bounds[0]:g}", *inner, f"> {bounds[-1]:g}")


IntArray = NDArray[np.int64]

BEFORE: Final = 0.5
"""Time before the start over which the acceleration is averaged and nothing may change [s]."""
MOST: Final = 5
"""Most controls of a follower."""
COVARIATES: Final = ("speed", "acceleration", "spacing", "closing")
# Largest difference in speed [m/s], acceleration [m/s^2], spacing [m] and closing speed [m/s].
_CALIPERS = np.array([1.5, 0.2, 8.0, 1.0])


class Rows(NamedTuple):
    """A recording's rows, by vehicle and frame, each of shape (N,).

    group: of class, carriageway and lane; leader: vehicle id, -1 = none; spacing [m] and v_leader [m/s]: NaN
    without one.
    """

    vehicle: IntArray
    frame: IntArray
    group: IntArray
    leader: IntArray
    v: FloatArray
    a: FloatArray
    spacing: FloatArray
    v_leader: FloatArray


@dataclass(frozen=True)
class Starts:
    """Moments at which followers could have been cut in on: row in ``Rows``, vehicle, group, covariates (4, n)."""

    row: IntArray
    vehicle: IntArray
    group: IntArray
    covariates: FloatArray


def starts(rows: Rows, rate: float, horizon: float) -> Starts:
    """One start a second of every vehicle that has a leader and keeps it, and its lane, up to the horizon [s]."""
    before, after = round(BEFORE * rate), int(np.ceil(horizon * rate))
    new = np.zeros(len(rows.vehicle), bool)
    new[:1] = True
    for values in (rows.vehicle, rows.group, rows.leader, rows.frame - np.arange(len(rows.frame))):
        new[1:] |= values[1:] != values[:-1]
    run = np.cumsum(new) - 1
    first = np.flatnonzero(new)
    stop = np.append(first[1:], len(run))
    place = np.arange(len(run))
    fits = (place - first[run] >= before) & (stop[run] - place > after) & (rows.leader >= 0)
    chosen = np.flatnonzero(fits & (rows.frame % max(round(rate), 1) == 0))
    sums = np.concatenate([[0.0], np.cumsum(rows.a)])
    # As of the followers that are cut in on: the samples before the start, without that of the start.
    acceleration = (sums[chosen] - sums[chosen - before]) / max(before, 1)
    closing = rows.v[chosen] - rows.v_leader[chosen]
    covariates = np.stack([rows.v[chosen], acceleration, rows.spacing[chosen], closing])
    good = np.isfinite(covariates).all(axis=0)
    return Starts(chosen[good], rows.vehicle[chosen[good]], rows.group[chosen[good]], covariates[:, good])


def speeds(rows: Rows, chosen: IntArray, rate: float, horizon: float) -> FloatArray:
    """Speeds from the chosen rows on, on the grid of 0.1 s up to the horizon [s], shape (K, n)."""
    at = np.arange(round(horizon / TIME_STEP) + 1)[:, None] * TIME_STEP * rate
    whole = np.minimum(np.floor(at + 1e-9).astype(np.int64), int(np.ceil(horizon * rate)) - 1)
    part = at - whole
    low = rows.v[chosen + whole]
    return np.asarray(low + part * (rows.v[chosen + whole + 1] - low))


def match(group: int, covariates: FloatArray, own: IntArray, candidates: Starts) -> IntArray:
    """Places of a follower's controls among the candidates, nearest first.

    covariates: its own, shape (4,); own: vehicles of its event, which are no controls.
    """
    away = np.abs(candidates.covariates - covariates[:, None]) / _CALIPERS[:, None]
    alike = (candidates.group == group) & (away <= 1.0).all(axis=0) & ~np.isin(candidates.vehicle, own)
    places = np.flatnonzero(alike)
    distance = (away[:, places] ** 2).sum(axis=0)
    nearest = places[np.argsort(distance, kind="stable")]
    # Two starts of one vehicle say nearly the same: the nearer one stands for both.
    _, earliest = np.unique(candidates.vehicle[nearest], return_index=True)
    return nearest[np.sort(earliest)][:MOST]


_LEAST_SAMPLES = 10  # a response that is seen for less than a second teaches nothing
_MOST_RESPONSES = 800  # a fit takes every k-th response, so that it takes at most this many


@dataclass
class CrossFit:
    """Populations by fold and by the parts left out; fitted when first asked for.

    given: one for all folds, from a file. moment: of models that bring none (``planner.leader_from``). hardest:
    bound of everybody's braking [m/s^2].
    """

    responses: Responses
    given: Population | None = None
    moment: float = models.START
    workers: int = 2
    hardest: float = HARDEST
    _folds: list[Fold] = field(init=False)
    _fitted: dict[tuple[str, ...], list[Population]] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        self._folds = folds(self.responses) if self.given is None else []

    def populations(self, without: tuple[str, ...] = ()) -> list[tuple[Fold, Population]]:
        """Each fold with its constants."""
        if without not in self._fitted:
            whole = [fitted for _, fitted in self.populations()] if without else [None] * len(self._folds)
            with ThreadPoolExecutor(self.workers) as pool:
                calls = [
                    pool.submit(self._fit, fold, without, like)
                    for fold, like in zip(self._folds, whole, strict=True)
                ]
                self._fitted[without] = [call.result() for call in calls]
        return list(zip(self._folds, self._fitted[without], strict=True))

    def drives(self, name: str, responses: Responses, fits: models.Fits) -> models.Drives:
        """Family and behaviours of the followers under a model (see ``models.drives``)."""
        if parse(name).base != names.POPULATION:
            return models.drives(name, responses, fits, PRIOR, moment=self.moment)
        if self.given is not None:
            return models.drives(name, responses, fits, self.given)
        family, found = np.full(len(responses), names.LCM, dtype=object), []
        for fold, fitted in self.populations(parse(name).removed):
            family[fold.held], part = models.drives(name, responses.take(fold.held), fits.take(fold.held), fitted)
            found.append((fold.held, part))
        return family, _joined(found, len(responses))

    def everybody(self) -> Population:
        """The population of all responses, to be exported and used on other data."""
        if self.given is not None:
            return self.given
        everything = Fold("all recordings", self.responses.n > 0, self.responses.n > 0)
        return self._fit(everything)

    def _fit(self, fold: Fold, without: tuple[str, ...] = (), like: Population | None = None) -> Population:
        taught = thinned(self.responses.take(fold.taught & (self.responses.n >= _LEAST_SAMPLES)))
        return fit(taught, source=fold.word, without=without, hardest=self.hardest, like=like)

    def spreads(self, name: str, responses: Responses) -> FloatArray:
        """How much drivers differ about each response's parameters under a model, (R, 6); 0 where unknown."""
        out, choice = np.zeros((len(responses), len(PARAMETERS))), parse(name)
        if choice.base == names.POPULATION and self.given is not None:
            out[:] = self.given.spread
        elif choice.base == names.POPULATION:
            for fold, fitted in self.populations(choice.removed):
                out[fold.held] = fitted.spread
        return out

    def fold_words(self, responses: Responses) -> NDArray[np.object_]:
        """What the constants of each response's population come from."""
        given = "" if self.given is None else f"{self.given.source}; given, not cross-fitted"
        words = np.full(len(responses), given, dtype=object)
        for fold, fitted in self.populations() if self._folds else ():
            words[fold.held] = fold.word if fitted.n_responses else fitted.source
        return words


def thinned(responses: Responses) -> Responses:
    """Every k-th event with all its followers."""
    step = -(-len(responses) // _MOST_RESPONSES)
    _, place = np.unique(responses.event, return_inverse=True)
    return responses if step <= 1 else responses.take(place % step == 0)


def _joined(found: list[tuple[BoolArray, Behaviours]], count: int) -> Behaviours:
    """Behaviours of all responses from those of the folds."""
    whole = [np.empty(count) for _ in Behaviours._fields]
    for held, part in found:
        for values, own in zip(whole, part, strict=True):
            values[held] = own
    return Behaviours(*whole)
