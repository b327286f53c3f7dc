"""Robust and plain plans under every model: means and worst cases are those of the totals, on the same events."""

import numpy as np
import pandas as pd
import pytest

from highd_lc.io import artefacts
from highd_lc.scoring.population import seen
from highd_lc.stages.statistics import PolicyLosses
from highd_lc.stages.validate_robust import event_gains, judges_among, robust_summary, situation_ranking
from highd_lc.vocab import names
from highd_lc.vocab.job import Provenance
from highd_lc.vocab.sections import StatisticsSettings
from highd_lc.vocab.tables.robust import EXPECTED, WORST

MODELS = ("population", "idm", "table3")
SKILFUL = MODELS[:2]
EVENTS = 12
STATISTICS = StatisticsSettings(bootstrap=100)
ABOUT = Provenance("", {}, 1, "")


def total(event, policy, model):
    """Benchmark 20 under every model; the plain plan gains under its own alone, the robust one under both."""
    gains = {"local_optimum": (0.04, -0.02, -0.10), "local_optimum_robust": (0.03, 0.01, 0.0)}
    return 20.0 * (1.0 - gains.get(policy, (0.0, 0.0, 0.0))[MODELS.index(model)] * (1.0 + 0.1 * event))


def cross(contacts=()):
    rows = []
    for event in range(EVENTS):
        for policy in (*names.FIXED_POLICIES, names.LOCAL_OPTIMUM_ROBUST):
            for model in MODELS:
                hv = np.nan if (event, policy, model) in contacts else total(event, policy, model) - 8.0
                rows.append(
                    {"event_id": f"01-{event:04d}-00100", "recording_id": event % 6, "policy": policy,
                     "accounting": names.EQUAL, "planned_with": "population", "scored_with": model,
                     "av_to_T": 4.0, "av_to_H": 8.0, "hv_to_T": 1.0, "hv_to_H": hv}
                )  # fmt: skip
    return pd.DataFrame(rows)


def test_an_events_gains_are_mean_and_least_over_the_skilful_models():
    found = event_gains(cross(), SKILFUL).set_index(["event_id", "policy"])
    plain = found.loc[("01-0000-00100", names.LOCAL_OPTIMUM)]
    assert plain[["gain", "gain_expected", "gain_worst"]].tolist() == pytest.approx([0.04, 0.01, -0.02])
    assert (plain["worst_model"], plain["n_models"]) == ("idm", 2)
    assert (found["gain_worst"] <= found["gain_expected"] + 1e-12).all()
    artefacts.to_arrow("event_gains", found.reset_index(), ABOUT)


def test_the_summary_sets_both_plans_side_by_side():
    table = robust_summary(cross(), SKILFUL, STATISTICS, seed=1)
    found = table.set_index(["policy", "scored_with"])
    mean = 1.0 + 0.1 * np.arange(EVENTS).mean()
    for policy, expected, worst in ((names.LOCAL_OPTIMUM, 0.01, -0.02), (names.LOCAL_OPTIMUM_ROBUST, 0.02, 0.01)):
        assert found.loc[(policy, EXPECTED), "gain"] == pytest.approx(expected * mean)
        assert found.loc[(policy, WORST), "gain"] == pytest.approx(worst * mean)
    robust = found.loc[names.LOCAL_OPTIMUM_ROBUST]
    assert robust.loc[WORST, "beyond_plain"] == pytest.approx(0.03 * mean)
    assert robust.loc["population", "beyond_plain"] == pytest.approx(-0.01 * mean)
    assert robust.loc["table3", "gain"] == pytest.approx(0.0)
    assert not robust.loc["table3", "skilful"]
    assert (found.loc[names.LOCAL_OPTIMUM, "beyond_plain"] == 0.0).all()
    artefacts.to_arrow("robust_summary", table, ABOUT)


def test_events_with_a_contact_under_a_skilful_model_are_compared_nowhere_over_the_models():
    met = cross([(3, names.LOCAL_OPTIMUM, "idm")])
    found = robust_summary(met, SKILFUL, STATISTICS, seed=1).set_index(["policy", "scored_with"])["n_compared"]
    for policy in (names.LOCAL_OPTIMUM, names.LOCAL_OPTIMUM_ROBUST):
        assert found.loc[policy].to_dict() == {
            "population": EVENTS, "table3": EVENTS, "idm": EVENTS - 1, EXPECTED: EVENTS - 1, WORST: EVENTS - 1
        }  # fmt: skip


def test_without_robust_plans_there_is_nothing_to_set_beside():
    plain = cross().query("policy != 'local_optimum_robust'")
    assert robust_summary(plain, SKILFUL, STATISTICS, seed=1).empty
    assert event_gains(plain, SKILFUL).empty


def test_situations_are_ranked_by_the_worst_model_and_tell_what_can_be_seen():
    gains = event_gains(cross(), SKILFUL)
    ids = sorted(set(gains["event_id"]))
    events = pd.DataFrame({"spacing_m": [5.0, 25.0] * 6, "closing_mps": 1.0}, index=ids)
    losses = pd.DataFrame(
        [
            {
                "event_id": e,
                "recording_id": 1,
                "accounting": names.EQUAL,
                "policy": p,
                "contact": "",
                "loss_hv_in_view": hv,
                "loss_hv_in_view_recorded": 8.75 if p == names.HUMAN and e in ids[::2] else np.nan,
            }
            for e in ids
            for p, hv in zip(
                (names.HUMAN, *names.FIXED_POLICIES, names.LOCAL_OPTIMUM_ROBUST),
                (9.0, 10.0, 9.5, 9.8),
                strict=True,
            )
        ]
    )
    found = situation_ranking(events, gains, PolicyLosses(losses))
    robust = found[found["policy"] == names.LOCAL_OPTIMUM_ROBUST]
    assert robust["gain_worst"].is_monotonic_decreasing
    assert robust["rank_worst"].tolist() == [1, 2]
    plain = found[found["policy"] == names.LOCAL_OPTIMUM].set_index("spacing_low_m")["error_over_effect"]
    assert plain[0.0] == pytest.approx(0.5)
    assert np.isnan(plain[20.0])
    artefacts.to_arrow("situation_ranking", found, ABOUT)


def test_models_of_positive_skill_are_those_that_beat_the_best_naive_one_at_both_horizons():
    skills = {
        "population": (0.3, 0.3),
        "idm": (0.1, 0.2),
        "table3": (0.4, -0.1),
        "mean": (0.2, 0.3),
        "drift": (0, 0),
    }
    summary = pd.DataFrame(
        [
            {"model": m, "stratum": "all", "horizon_s": h, "skill_naive": s}
            for m, both in skills.items()
            for h, s in zip((5.0, 8.0), both, strict=True)
        ]
    )
    judges = judges_among(summary, "population")
    assert judges.skilful == ("mean", "idm")
    assert judges.every == ("idm", "mean", "table3")


def test_error_and_effect_of_nothing_are_unknown():
    events = pd.DataFrame({"error": [1.0, np.nan], "effect": [0.0, 7.0]})
    assert np.isnan(seen(*events.to_numpy().T)["error_over_effect"])
    assert np.isnan(seen(*events.iloc[1:].to_numpy().T)["error"])


def test_error_and_effect_are_means_over_the_events_that_have_both():
    events = pd.DataFrame({"error": [1.0, -3.0, 5.0], "effect": [4.0, -4.0, np.nan]})
    assert seen(*events.to_numpy().T) == {"effect": 4.0, "error": 2.0, "error_over_effect": 0.5}
