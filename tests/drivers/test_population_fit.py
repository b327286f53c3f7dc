"""The population: what it recovers of drivers of its own family, and that nobody teaches himself."""

from dataclasses import replace

import numpy as np
import pytest
from made_responses import made

from highd_lc.core.lcm import lcm_acceleration
from highd_lc.drivers import population
from highd_lc.drivers.population import CONSTANTS, NAMES, PRIOR, Population
from highd_lc.drivers.population_fit import fit
from highd_lc.drivers.prediction import CrossFit
from highd_lc.drivers.responses import Responses, folds, simulate
from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS

OF_TRUE = {
    "v_desire": 27.0, "own_speed": 0.2, "above": 2.0, "A": 1.1, "b": 2.3, "B": 1.6, "tau": 2.9,
    "own_time_gap": 0.2, "L_0": 3.5, "truck": 1.1, "truck_A": 1.0, "memory": 4.0, "persistence": 0.9,
    "lasting": 0.5, "own_offset": 0.0, "idle": 0.0, "relaxation": 6.0,
}  # fmt: skip
TRUE = Population(np.array([OF_TRUE[name] for name in NAMES]), 0.3, 0, "made")


def driven(responses: Responses, by: Population, *, noise: float = 0.0, seed: int = 2) -> Responses:
    """The responses as drivers of that population would have given them."""
    found = population.respond(by, responses)
    rng = np.random.default_rng(seed)
    return replace(responses, x=found.x, v=found.v + noise * rng.normal(size=found.v.shape))


@pytest.fixture(scope="module")
def recorded() -> Responses:
    return driven(made(120, seed=7), TRUE, noise=0.05)


def test_response_curves_of_its_own_family_are_recovered(recorded: Responses) -> None:
    fitted = fit(recorded, source="all")
    fresh = made(60, seed=11)
    true, found = population.respond(TRUE, fresh), population.respond(fitted, fresh)
    change = np.abs(true.v[50] - true.v[0])
    assert np.abs(found.v[50] - true.v[50]).mean() < 0.1 * change.mean()


def test_without_responses_the_prior_stands() -> None:
    assert fit(made(0), source="none") is PRIOR


def test_constants_stay_within_their_bounds(recorded: Responses) -> None:
    fitted = fit(recorded, source="all")
    for constant, value in zip(CONSTANTS, fitted.constants, strict=True):
        assert constant.low <= value <= constant.high


def test_parts_left_out_are_zero(recorded: Responses) -> None:
    fitted = fit(recorded, source="all", without=("memory", "relaxation"))
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


def test_an_optional_constant_counts_where_it_predicts_others_better() -> None:
    responses = made(160, seed=9)
    responses = replace(responses, truck=np.arange(160) % 3 == 0)
    truth = np.where(np.array(NAMES) == "truck_A", 0.35, TRUE.constants)
    recorded = driven(responses, replace(TRUE, constants=truth), noise=0.02)
    found = fit(recorded, source="all")
    assert found["truck_A"] < 0.7
    plain = fit(driven(responses, TRUE, noise=0.02), source="all")
    assert abs(plain["truck_A"] - 1.0) < 0.1


def test_who_is_opening_the_gap_may_be_idle() -> None:
    responses = made(30, seed=2)
    truth = np.where(np.array(NAMES) == "idle", 1.0, TRUE.constants)
    b = population.behaviours(truth, responses, 0.0)
    opening = responses.v_ahead[0] - responses.v[0] > 2.0
    assert opening.any()
    assert (b.A[opening] == 0.0).all()
    closing = responses.v_ahead[0] < responses.v[0]
    np.testing.assert_allclose(b.A[closing], TRUE["A"])


def test_an_own_offset_is_what_was_beyond_the_command_before_the_start() -> None:
    responses = made(10, seed=4)
    bare = population.behaviours(TRUE.constants, responses, 0.5)
    kept = population.behaviours(np.where(np.array(NAMES) == "own_offset", 0.5, TRUE.constants), responses, 0.5)
    for i in range(10):
        spacing = responses.before_x[0, i] - responses.x[0, i]
        command = lcm_acceleration.py_func(
            responses.v[0, i], spacing, responses.before_v[0, i], bare.v_desire[i], bare.A[i], bare.b[i],
            bare.B[i], bare.tau[i], bare.L_before[i],
        )  # fmt: skip
        own = 0.5 * (responses.a_0[i] + responses.a_lasting[i]) - responses.drift[i]
        expected = responses.drift[i] + 0.5 * np.clip(own - command, -1.0, 1.0)
        assert kept.drift[i] == pytest.approx(expected)


def test_drivers_drawn_with_the_spread_differ_as_much_as_the_recorded_ones() -> None:
    responses = made(240, seed=13)
    b = population.behaviours(TRUE.constants, responses, TRUE.moment)

    def differ(sd: float) -> tuple[float, float]:
        """Mean square deviation of speed from the population's every 2 s: of recorded drivers, of drawn ones."""
        rng = np.random.default_rng(3)
        own = b._replace(tau=np.maximum(b.tau + sd * rng.normal(size=240), 0.3))
        found = simulate(names.LCM, own, responses)
        v = found.v + 0.05 * rng.normal(size=found.v.shape)
        fitted = fit(replace(responses, x=found.x, v=v), source="all")
        mean = population.behaviours(fitted.constants, responses, fitted.moment)
        drawn = {p: np.maximum(getattr(mean, p) + s * rng.normal(size=240), 0.2) for p, s in _spreads(fitted)}
        middle, other = (simulate(names.LCM, one, responses).v for one in (mean, mean._replace(**drawn)))
        return float(((v - middle)[20::20] ** 2).mean()), float(((other - middle)[20::20] ** 2).mean())

    alike, apart = differ(0.0), differ(1.2)
    assert alike[1] < 0.25 * apart[1]
    # J D J' = error^2 - noise: drawn drivers differ by no more than the recorded ones do. The relative standard
    # deviation of a mean of n squares is sqrt(2 / n), of either side.
    sampling = 3.0 * np.sqrt(2.0 * 2.0 / 240)
    assert alike[1] < (1.0 + sampling) * alike[0]
    noise = 0.05**2 / apart[0]
    assert 1.0 - noise - sampling < apart[1] / apart[0] < 1.0 + sampling


OF_IDM = {**OF_TRUE, "v_desire": 32.0, "own_speed": 0.0, "A": 1.4, "b": 2.0, "B": 1.0, "tau": 1.3, "L_0": 2.5}
IDM = Population(np.array([OF_IDM[name] for name in NAMES]), 0.3, 0, "made", family=names.IDM)


@pytest.mark.parametrize("truth", [TRUE, IDM])
def test_the_family_is_that_of_the_drivers(truth: Population) -> None:
    fitted = fit(driven(made(160, seed=7), truth, noise=0.05), source="all")
    assert fitted.family == truth.family
    fresh = made(60, seed=11)
    true, found = population.respond(truth, fresh), population.respond(fitted, fresh)
    assert np.abs(found.v[50] - true.v[50]).mean() < 0.1 * np.abs(true.v[50] - true.v[0]).mean()


def test_few_responses_choose_no_family() -> None:
    few = driven(made(60, seed=7), IDM, noise=0.05)
    assert fit(few, source="few").family == names.LCM


def test_an_idle_idm_does_a_share_of_what_it_would() -> None:
    responses = made(30, seed=2)
    half = np.where(np.array(NAMES) == "idle", 0.5, IDM.constants)
    whole, part = (population.behaviours(c, responses, 0.0, family=names.IDM) for c in (IDM.constants, half))
    bare = {"memory": np.zeros(30), "a_0": np.zeros(30), "drift": np.zeros(30), "need": np.full(30, np.inf)}
    a, b = (
        simulate(names.IDM, one._replace(relaxation=np.zeros(30), **bare), responses, hardest=np.inf).a[0]
        for one in (whole, part)
    )
    opening = np.clip((responses.v_ahead[0] - responses.v[0]) / 2.0, 0.0, 1.0) * (responses.rank == 1)
    assert opening.max() > 0.0
    np.testing.assert_allclose(b, a * (1.0 - 0.5 * opening), rtol=1e-9)


def test_followers_of_two_families_drive_as_those_of_each() -> None:
    responses = made(20, seed=5)
    family = np.where(np.arange(20) % 3 == 0, names.IDM, names.LCM).astype(object)
    each = {
        one.family: population.behaviours(one.constants, responses, 0.3, family=one.family) for one in (TRUE, IDM)
    }
    mixed = type(each[names.LCM])(
        *(np.where(family == names.IDM, i, own) for i, own in zip(each[names.IDM], each[names.LCM], strict=True))
    )
    found = simulate(family, mixed, responses)
    for name, drivers in each.items():
        own = family == name
        np.testing.assert_array_equal(found.v[:, own], simulate(name, drivers, responses).v[:, own])


def _spreads(fitted: Population) -> list[tuple[str, float]]:
    return list(zip(PARAMETERS, fitted.spread.tolist(), strict=True))
