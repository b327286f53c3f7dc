"""Names of follower models: what they mean, and what is refused."""

import numpy as np
import pytest
from made_responses import made

from highd_lc.drivers import models
from highd_lc.drivers.population import PRIOR
from highd_lc.drivers.responses import Behaviours, Responses, simulate
from highd_lc.vocab import names
from highd_lc.vocab.driver import TABLE3_MEANS
from highd_lc.vocab.errors import SettingsError


def drives_of(name: str, responses: Responses) -> tuple[str, Behaviours]:
    count = len(responses)
    fits = models.Fits(np.tile(TABLE3_MEANS.as_array(), (count, 1)), np.full(count, np.nan), np.ones(count, bool))
    return models.drives(name, responses, fits, PRIOR)


def test_names_are_taken_apart() -> None:
    choice = models.parse("own_fit@crossing+memory+relaxation")
    assert (choice.base, choice.moment, choice.added) == ("own_fit", 0.5, ("memory", "relaxation"))
    assert models.parse("population-relaxation").removed == ("relaxation",)
    assert models.parse("idm@0.3").moment == 0.3
    assert models.parse("own_fit").moment is None


@pytest.mark.parametrize(
    "name", ["population+memory", "own_fit-memory", "constant_speed@crossing", "drift+relaxation"]
)
def test_parts_that_change_nothing_are_refused(name: str) -> None:
    with pytest.raises(SettingsError, match="follower model"):
        models.parse(name)


def test_memory_begins_with_the_drivers_own_acceleration() -> None:
    responses = made(20)
    family, b = drives_of("own_fit@crossing+memory", responses)
    found = simulate(family, b._replace(need=np.full(20, np.inf)), responses)
    np.testing.assert_allclose(found.a[0], responses.a_0)


def test_published_means_keep_their_L_behind_any_leader(made_fits: models.Fits) -> None:
    fits = models.Fits(made_fits.parameters, np.array([4.0, 16.0, 5.0]), made_fits.fitted)
    responses = made(3)
    _, table3 = models.drives(names.TABLE3, responses, fits, PRIOR)
    np.testing.assert_array_equal(table3.L, TABLE3_MEANS.L)
    _, mean = models.drives(names.MEAN, responses, fits, PRIOR)
    np.testing.assert_allclose(mean.L, np.clip(5.0 - 10.0 + responses.ahead_length, 2.0, 25.0))


@pytest.mark.parametrize("name", ["", "owl_fit", "own_fit@sometime", "own_fit+luck", "own_fit memory"])
def test_a_name_that_means_nothing_is_refused_with_what_is_allowed(name: str) -> None:
    with pytest.raises(SettingsError, match="population"):
        models.parse(name)


def test_the_mean_is_that_of_the_fitted(made_fits: models.Fits) -> None:
    responses = made(3)
    _, b = models.drives(names.MEAN, responses, made_fits, PRIOR)
    np.testing.assert_allclose(b.A, made_fits.parameters[:2, 1].mean())


@pytest.fixture
def made_fits() -> models.Fits:
    parameters = np.tile([30.0, 2.0, 5.0, 5.0, 1.0, 5.0], (3, 1))
    parameters[:, 1] = [2.0, 4.0, 9.0]
    return models.Fits(parameters, np.full(3, np.nan), np.array([True, True, False]))


def test_a_model_of_ones_own_is_used_by_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    responses = made(4)
    monkeypatch.setitem(models.REGISTRY, "mine", lambda r: drives_of("idm@crossing", r))
    assert models.parse("mine").base == "mine"
    mine = simulate(*drives_of("mine", responses), responses)
    np.testing.assert_array_equal(mine.v, simulate(*drives_of("idm@crossing", responses), responses).v)


def test_a_model_of_ones_own_is_found_by_module_and_function() -> None:
    responses = made(6)
    assert models.parse("made_models:calm").base == "made_models:calm"
    family, calm = drives_of("made_models:calm", responses)
    population = drives_of(names.POPULATION, responses)[1]
    assert family == names.LCM
    np.testing.assert_allclose(calm.A, 0.5 * population.A)
    for wrong in ("made_models:hasty", "nobodys_models:calm"):
        with pytest.raises(SettingsError, match=wrong):
            models.parse(wrong)
