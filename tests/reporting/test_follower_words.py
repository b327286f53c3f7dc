"""What is said in front of every gain is what the tables hold, whatever they hold."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sample_prediction import DEFAULT, losses, nobody, prediction, prediction_summary, sample_prediction

from highd_lc.reporting.event import driver_says
from highd_lc.reporting.follower_words import (
    Effect,
    effects_of,
    error_over_effect,
    followers_say,
    times,
)
from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS

FIXED, FREE = (Effect(form, 4.32, 2.76, mean, 0.0002, 60) for form, mean in (("fixed", 0.36), ("free", 1.44)))


def summary_with(horizons=(5.0, 8.0), **values: float) -> pd.DataFrame:
    """The sample's summary with other numbers in the rows that are told."""
    table = sample_prediction().prediction_summary.copy()
    at = (table["model"] == DEFAULT) & (table["stratum"] == "all") & table["horizon_s"].isin(horizons)
    assert at.sum() == len(horizons)
    table.loc[at, list(values)] = list(values.values())
    return table


def skills(constant, naive, **more):
    return summary_with(**{
        f"skill_{of}{end}": value
        for of, triple in (("constant", constant), ("naive", naive))
        for end, value in zip(("", "_low", "_high"), triple, strict=True)
    }, **more)  # fmt: skip


def said(summary, effects=(FIXED,)) -> list[str]:
    return [text.replace("\u00a0", " ") for text in followers_say(summary, effects)]


@pytest.mark.parametrize(
    ("error", "effect", "ratio"),
    [(4.23, 0.36, 11.75), (0.0, 0.36, 0.0), (0.36, 0.36, 1.0), (1.0, 0.0, np.inf), (0.0, 0.0, np.inf)],
)
def test_error_over_effect(error, effect, ratio):
    assert error_over_effect(error, effect) == pytest.approx(ratio)


@pytest.mark.parametrize("pair", [(np.nan, 0.36), (1.0, np.nan), (np.nan, np.nan)])
def test_what_is_not_known_has_no_ratio(pair):
    assert np.isnan(error_over_effect(*pair))


@given(st.floats(0, 1e6), st.floats(1e-6, 1e6), st.floats(1e-3, 1e3))
def test_error_over_effect_is_free_of_the_loss_s_scale(error, effect, scale):
    assert error_over_effect(scale * error, scale * effect) == pytest.approx(error_over_effect(error, effect))


def test_effects_are_mean_absolute_changes_of_the_followers_loss_under_equal():
    table = losses(prediction(6), change=-0.25)
    ids = table["event_id"].unique()
    turned = (table["event_id"] == ids[0]) & (table["policy"] == names.LOCAL_OPTIMUM)
    table.loc[turned, "loss_hv_in_view"] += 1.0  # +0.75 in one of six events
    table.loc[table["accounting"] != names.EQUAL, "loss_hv_in_view"] *= 9.0
    table.loc[(table["event_id"] == ids[1]) & (table["policy"] == names.BENCHMARK), "loss_hv_in_view"] = np.nan
    fixed, free = effects_of(table)
    assert (fixed.form, fixed.n, free.form, free.n) == ("fixed", 5, "free", 6)
    assert fixed.mean == pytest.approx((0.75 + 4 * 0.25) / 5)
    assert free.mean == pytest.approx(1.0)
    sizes = np.array([1, 2, 3, 4, 5, 6]) / 7  # the sample's errors, mean 0.5; the second event has no effect
    assert free.error == pytest.approx(0.5)
    assert fixed.error == pytest.approx(np.delete(sizes, 1).mean())
    assert (fixed.error_median, fixed.median) == pytest.approx((4 / 7, 0.25))
    assert fixed.ratio == pytest.approx(fixed.error / fixed.mean)


def test_forms_without_plans_have_no_effect():
    table = losses(prediction(6))
    assert [e.form for e in effects_of(table[~table["policy"].isin(names.FREE_POLICIES)])] == ["fixed"]
    assert effects_of(table.iloc[:0]) == []


def test_skills_are_told_with_their_intervals():
    text = said(skills((0.55, 0.41, 0.66), (0.25, 0.05, 0.35)))[0]
    assert text.startswith(
        "The first follower (HV 1) is predicted well: skill of the model that plans (population) 0.55 (0.41 to"
    )
    assert "0.55 (0.41 to 0.66) after 8 s against constant speed (aim 0.50), 0.25 (0.05 to 0.35) after 5 s" in text
    assert "best naive model (drift and decaying acceleration; aim 0.20); events in view: 40 over 5 s, 32" in text


@pytest.mark.parametrize(
    ("constant", "naive", "verdict"),
    [
        ((0.50, 0.1, 0.6), (0.20, 0.1, 0.3), "well"),
        ((0.49, 0.1, 0.6), (0.20, 0.1, 0.3), "better than if nothing happened and than by the best naive model"),
        ((0.60, 0.1, 0.6), (0.10, -0.1, 0.3),
         "better than if nothing happened and perhaps (not shown) better than by the best naive model"),
        ((0.60, 0.0, 0.6), (0.0, -0.1, 0.3),
         "perhaps (not shown) better than if nothing happened and no better than by the best naive model"),
        ((0.0, -0.1, 0.1), (-0.2, -0.4, 0.1),
         "no better than if nothing happened and than by the best naive model"),
        ((-0.3, -0.5, -0.1), (-0.6, -0.8, -0.4),
         "worse than if nothing happened and than by the best naive model"),
        ((0.9, np.nan, np.nan), (0.8, np.nan, np.nan),
         "perhaps (not shown) better than if nothing happened and than by the best naive model"),
    ],
)  # fmt: skip
def test_verdicts(constant, naive, verdict):
    assert said(skills(constant, naive))[0].startswith(f"The first follower (HV 1) is predicted {verdict}: skill")


def test_the_worse_of_two_horizons_decides():
    table = skills((0.6, 0.5, 0.7), (0.3, 0.2, 0.4))
    bad = (table["model"] == DEFAULT) & (table["stratum"] == "all") & (table["horizon_s"] == 8.0)
    table.loc[bad, ["skill_constant", "skill_constant_low", "skill_constant_high"]] = [-0.2, -0.3, -0.1]
    assert said(table)[0].startswith(
        "The first follower (HV 1) is predicted worse than if nothing happened and better than by the best"
    )


def test_no_interval_is_said_once_and_leaves_no_brackets():
    table = prediction_summary(prediction(7, 1), intervals=False)
    text = said(table)[0]
    assert text.count("no interval: fewer than five recordings") == 1
    assert "nan" not in text
    assert "()" not in text
    assert "to –" not in text
    assert "no interval" not in said(sample_prediction().prediction_summary)[0]


@pytest.mark.parametrize(
    ("simulated", "recorded", "words"),
    [
        (2.7, 0.3, "9.0 times as hard as recorded drivers"),
        (3.6, 0.3, "12 times as hard as recorded drivers"),
        (0.1, 0.3, "0.33 times as hard as recorded drivers"),
        (0.45, 0.3, "about as hard as recorded drivers, within a factor of 1.5"),
        (0.2, 0.3, "about as hard as recorded drivers, within a factor of 1.5"),
        (0.3, 0.0, "where recorded drivers do not brake"),
        (0.0, 0.0, "as little as recorded drivers"),
        (np.nan, 0.3, "to an extent that is not known"),
    ],
)
def test_braking(simulated, recorded, words):
    text = said(summary_with(peak_decel_simulated=simulated, peak_decel_recorded=recorded, contacts=3))[1]
    assert text.startswith(f"The model brakes {words} (mean peak braking over 5 s ")
    assert text.endswith("in 3 of 40 events it drives into the vehicle ahead, recorded drivers in 1.")


def scaled(error, *effects):
    return [replace(effect, error=error) for effect in effects]


def test_an_error_of_twelve_times_the_effect_hides_the_gain():
    _, _, error, follows = said(sample_prediction().prediction_summary, [FIXED, FREE])
    assert error == (
        "While the followers are filmed behind the recorded lane changer, at most 8 s, their loss is missed by "
        "4.32 (mean absolute error; median 2.76), and the local optimum changes it over the same samples by 0.36 "
        "(fixed end speed; median 0.0002), 1.44 (free end speed; median 0.0002), mean absolute effect, 60 events."
    )
    assert follows == (
        "The gain cannot be seen: the error is 12 times the effect (fixed end speed), 3.0 times (free end speed)."
    )


def test_errors_of_other_events_are_told_apart():
    text = said(sample_prediction().prediction_summary, [FIXED, replace(FREE, error=2.0, n=1)])[2]
    assert "by 4.32 (mean absolute error; median 2.76)" in text
    assert "60 events; by 2.00 (mean absolute error; median 2.76)" in text
    assert text.endswith("mean absolute effect, 1 event.")


def test_a_gain_is_seen_form_by_form():
    table = skills((0.6, 0.5, 0.7), (0.3, 0.2, 0.4))
    assert said(table, scaled(0.72, FIXED, FREE))[3] == (
        "The gain cannot be seen: the error is 2.0 times the effect (fixed end speed); the gain can be seen: the "
        "error is 0.50 times the effect (free end speed)."
    )
    equal = said(table, scaled(0.36, FIXED))[3]
    assert equal == "The gain can be seen: the error is 1.0 times the effect (fixed end speed)."


@pytest.mark.parametrize("constant", [(0.3, -0.1, 0.5), (-0.2, -0.3, -0.1), (0.9, np.nan, np.nan)])
def test_followers_that_are_not_shown_to_be_predicted_leave_a_small_error_open(constant):
    text = said(skills(constant, (0.3, 0.2, 0.4)), scaled(0.1, FIXED))[3]
    assert text.startswith(
        "The gain stays open: the error is 0.28 times the effect (fixed end speed), but the foll"
    )
    assert "can be seen" not in text


def test_no_effect_is_no_gain_to_see():
    none = Effect("fixed", 0.5, 0.5, 0.0, 0.0, 9)
    assert said(sample_prediction().prediction_summary, [none])[3] == (
        "The gain cannot be seen: there is no effect (fixed end speed)."
    )


def test_without_plans_or_losses_the_gain_is_not_known():
    assert said(sample_prediction().prediction_summary, [])[2:] == [
        "Whether the gain can be seen is not known: no event has plans of both policies and followers that are "
        "filmed behind the recorded lane changer, without contacts."
    ]
    table = losses(prediction(6)).assign(loss_hv_in_view_recorded=np.nan)
    assert effects_of(table) == []


def test_only_horizons_in_view_are_told():
    table = sample_prediction().prediction_summary
    short = said(table[table["horizon_s"] <= 5.0])
    assert "8 s" not in short[0]
    nowhere = table.assign(n_events=table["n_events"].where(table["horizon_s"] < 5.0, 0))
    assert said(nowhere) == said(nobody().prediction_summary)


def test_without_tables_or_rows_it_says_so():
    missing, empty = followers_say(None, [FIXED]), followers_say(nobody().prediction_summary, [FIXED])
    assert len(missing) == len(empty) == 1
    assert "is not known: this work folder holds no prediction" in missing[0]
    assert "is not known: none is in view" in empty[0]
    for text in (*missing, *empty):
        assert "whose model is not tested here" in text


def test_no_model_that_plans_is_no_verdict():
    assert "is not known" in said(sample_prediction().prediction_summary.assign(default=False))[0]


@given(st.floats(0, 1e9))
def test_multiples_are_never_told_as_nothing(ratio):
    text = times(ratio)
    assert text.endswith(" times")
    assert (text == "0.00 times") == (ratio == 0.0)


def fit(**changes):
    spread = dict.fromkeys(PARAMETERS, 0.01)
    return {"status": names.FITTED, "at_bound": [], "spread": spread} | changes


def test_a_driver_is_believed_where_nothing_speaks_against_it():
    assert driver_says(fit(), {}) == "To be believed: v_desire, A, b, B, tau, L."
    told = driver_says(fit(at_bound=["tau"], spread={"A": 3.0, "b": 0.1, "B": 0.1, "v_desire": 0.2}), {})
    assert told == (
        "To be believed: v_desire, b, B. Not: A (± 3.00 over equally good fits), tau (on a bound), "
        "L (spread not known)."
    )


def test_what_the_run_cannot_identify_nobody_is_believed_in():
    known = {
        "b": {"verdict": "not identifiable", "width": 0.8, "correlation": 0.2, "partner": "A"},
        "A": {"verdict": "believed", "width": 0.1, "correlation": 0.95, "partner": "B"},
    }
    told = driver_says(fit(), known)
    assert "b (not identifiable in this run: profiles are 80" in told
    assert "A (tied to B, |r| 0.95)" in told


@pytest.mark.parametrize("status", [names.POOL, names.CLASS_POOL, names.TABLE3])
def test_of_a_pooled_driver_nothing_is_believed(status):
    assert driver_says(fit(status=status), {}).startswith("None of the parameters is this driver's")
