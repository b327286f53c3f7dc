"""Names of follower models: what they mean, and what is refused."""

import numpy as np
import pytest
from made_models import keeper
from made_responses import made

from highd_lc.drivers import models
from highd_lc.drivers.population import PRIOR
from highd_lc.drivers.responses import Behaviours, Responses, Simulated, simulate
from highd_lc.vocab import follower_names, names
from highd_lc.vocab.driver import TABLE3_MEANS
from highd_lc.vocab.errors import SettingsError


def drives_of(name: str, responses: Responses) -> tuple[str, Behaviours]:
    count = len(responses)
    fits = models.Fits(np.tile(TABLE3_MEANS.as_array(), (count, 1)), np.full(count, np.nan), np.ones(count, bool))
    return models.drives(name, responses, fits, PRIOR)


def test_names_are_taken_apart() -> None:
    choice = follower_names.parse("own_fit@crossing+memory+relaxation")
    assert (choice.base, choice.moment, choice.added) == ("own_fit", 0.5, ("memory", "relaxation"))
    assert follower_names.parse("population-relaxation").removed == ("relaxation",)
    assert follower_names.parse("idm@0.3").moment == 0.3
    assert follower_names.parse("own_fit").moment is None


@pytest.mark.parametrize(
    "name", ["population+memory", "own_fit-memory", "constant_speed@crossing", "drift+relaxation"]
)
def test_parts_that_change_nothing_are_refused(name: str) -> None:
    with pytest.raises(SettingsError, match="follower model"):
        follower_names.parse(name)


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
        follower_names.parse(name)


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
    monkeypatch.setitem(follower_names.REGISTRY, "mine", lambda r: drives_of("idm@crossing", r))
    assert follower_names.parse("mine").base == "mine"
    mine = simulate(*drives_of("mine", responses), responses)
    np.testing.assert_array_equal(mine.v, simulate(*drives_of("idm@crossing", responses), responses).v)


def test_a_model_of_ones_own_is_found_by_module_and_function() -> None:
    responses = made(6)
    assert follower_names.parse("made_models:calm").base == "made_models:calm"
    family, calm = drives_of("made_models:calm", responses)
    population = drives_of(names.POPULATION, responses)[1]
    assert family == names.LCM
    np.testing.assert_allclose(calm.A, 0.5 * population.A)
    for wrong in ("made_models:hasty", "nobodys_models:calm"):
        with pytest.raises(SettingsError, match=wrong):
            follower_names.parse(wrong)


def bare(name: str, responses: Responses) -> Simulated:
    family, b = drives_of(name, responses)
    return simulate(family, b, responses)


def test_a_command_of_ones_own_drives_as_its_plain_python() -> None:
    responses = made(8)
    responses.truck[:4] = True
    found = bare("made_models:keeper", responses)
    for i in range(8):
        x, v, T = responses.x[0, i], responses.v[0, i], 1.5 if i < 4 else 1.0
        for k in range(len(found.v)):
            parameters = (32.0, T, 0.02, responses.ahead_length[i])
            a = max(keeper(v, responses.v_ahead[k, i], responses.x_ahead[k, i] - x, parameters), -9.0)
            assert found.v[k, i] == pytest.approx(v, abs=1e-9)
            v = max(v + 0.1 * a, 0.0)
            x += 0.1 * v


@pytest.mark.parametrize("parts", ["", "@crossing", "@0.3+memory"])
def test_the_lcm_written_once_more_is_the_lcm(parts: str) -> None:
    responses = made(10, seed=5)
    np.testing.assert_allclose(
        bare("made_models:again" + parts, responses).v, bare("table3" + parts, responses).v, atol=1e-9
    )


def test_what_numba_cannot_compile_drives_all_the_same() -> None:
    responses = made(4)
    found = bare("made_models:spoken", responses)
    np.testing.assert_allclose(found.a, np.minimum(0.1 * (responses.v_ahead - found.v), 1.5), atol=1e-12)


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("made_models:crowded", "7 parameters, at most 6"),
        ("made_models:speechless", "no number at v = 0, v_leader = 0"),
        ("made_models:dividing", "ZeroDivisionError"),
        ("made_models:calm@crossing", "it returns all of its drivers"),
        ("made_models:keeper-memory", "- takes a part from population"),
    ],
)
def test_a_function_that_cannot_drive_is_refused_with_the_reason(name: str, why: str) -> None:
    with pytest.raises(SettingsError, match=why):
        follower_names.parse(name)
