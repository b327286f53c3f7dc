"""Cross-fitting: the constants for a recording's followers come from other recordings (equations.md 3.12).

Where locations can be left out as well, a fold is a location; else a recording, or a few of them. With fewer
than ``LEAST_RECORDINGS`` recordings a fold is a block of time of one recording, and responses within a minute of
it teach it nothing. A driver's own response is never among those that his constants come from.
"""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.drivers import models, population
from highd_lc.drivers.population import Population
from highd_lc.drivers.responses import Behaviours, Responses
from highd_lc.vocab import names

BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

LEAST_RECORDINGS: Final = 4
"""With fewer recordings, blocks of time are left out."""
BLOCK: Final = 300.0
"""Length of a block of time [s]."""
GAP: Final = 60.0
"""Time around a block in which responses are left out as well [s]."""
MOST_FOLDS: Final = 10
"""Most folds over recordings: more of them share one."""
_LEAST_SAMPLES = 10  # a response that is seen for less than a second teaches nothing
_LEAST_TRAINING = 200  # responses that have to remain where locations are left out
_MOST_RESPONSES = 800  # a fit takes every k-th response, so that it takes at most this many


@dataclass(frozen=True)
class Fold:
    """Responses that share constants (``held``) and those that teach them (``taught``), each of shape (R,)."""

    word: str
    held: BoolArray
    taught: BoolArray


def folds(responses: Responses) -> list[Fold]:
    """The folds of the responses: every one is held in exactly one of them."""
    recordings, locations = np.unique(responses.recording), np.unique(responses.location)
    if len(recordings) < LEAST_RECORDINGS:
        return list(_blocks(responses))
    if len(locations) > 1:
        by_location = [_of(f"location {place} left out", responses.location == place) for place in locations]
        if min(int(fold.taught.sum()) for fold in by_location) >= _LEAST_TRAINING:
            return by_location
    groups = np.array_split(recordings, min(len(recordings), MOST_FOLDS))
    return [_of(_without(group), np.isin(responses.recording, group)) for group in groups if len(group)]


def _of(word: str, held: BoolArray) -> Fold:
    return Fold(word, held, ~held)


def _without(group: IntArray) -> str:
    return "recordings " + ", ".join(f"{number:02d}" for number in group) + " left out"


def _blocks(responses: Responses) -> Iterator[Fold]:
    for recording in np.unique(responses.recording):
        own = responses.recording == recording
        block = np.floor(responses.time / BLOCK).astype(np.int64)
        for number in np.unique(block[own]):
            held = own & (block == number)
            near = own & (responses.time > number * BLOCK - GAP) & (responses.time < (number + 1) * BLOCK + GAP)
            word = f"recording {recording:02d}, {number * BLOCK:g} to {(number + 1) * BLOCK:g} s left out"
            yield Fold(word, held, ~near)


@dataclass
class CrossFit:
    """Populations by fold and by the parts left out; fitted when first asked for.

    given: one for all folds, from a file. moment: of models that bring none (``planner.leader_from``).
    """

    responses: Responses
    given: Population | None = None
    moment: float = models.START
    workers: int = 2
    _folds: list[Fold] = field(init=False)
    _fitted: dict[tuple[str, ...], list[Population]] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        self._folds = folds(self.responses) if self.given is None else []

    def populations(self, without: tuple[str, ...] = ()) -> list[tuple[Fold, Population]]:
        """Each fold with its constants."""
        if without not in self._fitted:
            with ThreadPoolExecutor(self.workers) as pool:
                calls = [pool.submit(_fit, self.responses, fold, without) for fold in self._folds]
                self._fitted[without] = [call.result() for call in calls]
        return list(zip(self._folds, self._fitted[without], strict=True))

    def drives(self, name: str, responses: Responses, fits: models.Fits) -> models.Drives:
        """Family and behaviours of the followers under a model (see ``models.drives``)."""
        if name in models.REGISTRY or models.parse(name).base != names.POPULATION:
            return models.drives(name, responses, fits, population.PRIOR, moment=self.moment)
        if self.given is not None:
            return models.drives(name, responses, fits, self.given)
        found: list[tuple[BoolArray, Behaviours]] = []
        for fold, fitted in self.populations(models.parse(name).removed):
            found.append(
                (fold.held, models.drives(name, responses.take(fold.held), fits.take(fold.held), fitted)[1])
            )
        return names.LCM, _joined(found, len(responses))

    def everybody(self) -> Population:
        """The population of all responses, to be exported and used on other data."""
        if self.given is not None:
            return self.given
        everything = Fold("all recordings", self.responses.n > 0, self.responses.n > 0)
        return _fit(self.responses, everything, ())

    def fold_words(self, responses: Responses) -> NDArray[np.object_]:
        """What the constants of each response's population come from."""
        given = "" if self.given is None else f"{self.given.source}; given, not cross-fitted"
        words = np.full(len(responses), given, dtype=object)
        for fold, fitted in self.populations() if self._folds else ():
            words[fold.held] = fold.word if fitted.n_responses else fitted.source
        return words


def _fit(responses: Responses, fold: Fold, without: tuple[str, ...]) -> Population:
    enough = responses.n >= _LEAST_SAMPLES
    return population.fit(thinned(responses.take(fold.taught & enough)), source=fold.word, without=without)


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
