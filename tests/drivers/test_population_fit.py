"""The population: what it recovers of drivers of its own family, and that nobody teaches himself."""

from dataclasses import replace

import numpy as np
import pytest
from made_responses import made

from highd_lc.drivers import population
from highd_lc.drivers.population import CONSTANTS, NAMES, PRIOR, Population
from highd_lc.drivers.prediction import CrossFit, folds
from highd_lc.drivers.responses import Responses

TRUE = Population(np.array([27.0, 0.2, 2.0, 1.1, 2.3, 1.6, 2.9, 0.2, 3.5, 1.1, 4.0, 0.9, 6.0]), 0.3, 0, "made")


def driven(responses: Responses, by: Population, *, noise: float = 0.0, seed: int = 2) -> Responses:
    """The responses as drivers of that population would have given them."""
    found = population.respond(by, responses)
    rng = np.random.default_rng(seed)
    return replace(responses, x=found.x, v=found.v + noise * rng.normal(size=found.v.shape))


@pytest.fixture(scope="module")
def recorded() -> Responses:
    return driven(made(120, seed=7), TRUE, noise=0.05)


def test_response_curves_of_its_own_family_are_recovered(recorded: Responses) -> None:
    fitted = population.fit(recorded, source="all")
    fresh = made(60, seed=11)
    true, found = population.respond(TRUE, fresh), population.respond(fitted, fresh)
    change = np.abs(true.v[50] - true.v[0])
    assert np.abs(found.v[50] - true.v[50]).mean() < 0.1 * change.mean()


def test_without_responses_the_prior_stands() -> None:
    assert population.fit(made(0), source="none") is PRIOR


def test_constants_stay_within_their_bounds(recorded: Responses) -> None:
    fitted = population.fit(recorded, source="all")
    for constant, value in zip(CONSTANTS, fitted.constants, strict=True):
        assert constant.low <= value <= constant.high


def test_parts_left_out_are_zero(recorded: Responses) -> None:
    fitted = population.fit(recorded, source="all", without=("memory", "relaxation"))
    assert fitted["memory"] == 0.0
    assert fitted["relaxation"] == 0.0


def test_every_response_is_held_in_one_fold_and_teaches_none_of_its_own(recorded: Responses) -> None:
    for recordings, locations in ((1, 1), (3, 1), (6, 1), (12, 3)):
        responses = made(600, recordings=recordings)
        responses = replace(responses, location=responses.recording % locations)
        held = np.sum([fold.held for fold in folds(responses)], axis=0)
        assert (held == 1).all()
        for fold in folds(responses):
            assert not (fold.held & fold.taught).any()


def test_with_few_recordings_neighbours_in_time_teach_nothing() -> None:
    responses = made(600, recordings=1)
    for fold in folds(responses):
        away = np.abs(responses.time[fold.held][:, None] - responses.time[fold.taught]).min(initial=np.inf)
        assert away >= 60.0


def test_a_response_does_not_change_the_constants_that_predict_it(recorded: Responses) -> None:
    v = recorded.v.copy()
    v[:, 5] += np.linspace(0, 3, len(v))
    altered = replace(recorded, v=v)
    for (fold, before), (_, after) in zip(
        CrossFit(recorded).populations(), CrossFit(altered, workers=1).populations(), strict=True
    ):
        same = np.array_equal(before.constants, after.constants)
        assert same == bool(fold.held[5])


def test_names_are_those_of_the_constants() -> None:
    assert tuple(constant.name for constant in CONSTANTS) == NAMES
    assert TRUE["memory"] == 4.0
