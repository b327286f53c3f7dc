"""The validate stage on the small recordings: its tables agree with each other and do not depend on the order."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from running import done_again, validated

from highd_lc.io import artefacts
from highd_lc.stages import validate
from highd_lc.vocab import names
from highd_lc.vocab.policy import PAIRS, ROBUST_PAIRS
from highd_lc.vocab.settings import Settings
from highd_lc.vocab.tables.studies import STUDY_TABLES

SETTINGS = Settings.model_validate(
    {
        "calibrate": {"optimiser": "screen", "models": ["constant_speed", "own_fit", "table3"]},
        "validate": {
            "followers": {"model": "own_fit", "also": ["table3"], "also_sample": 3},
            "studies": {
                "sample": 3, "solver_sample": 1, "solver_starts": 2, "draws": 4, "replans": 2,
                "population": 24, "generations": 6, "horizons_s": [5.0], "multibody_sample": 2,
                "safety_sample": 2, "start_sample": 4,
            },
            "trajectories": "none",
            "robust": {"sample": 3, "draws": 2},
            "multiverse": {"sample": 1},
            "closed_loop": {"events": 0},
            "statistics": {"bootstrap": 200, "interval": "percentile"},
        },
    }
)  # fmt: skip
KEY = ["event_id", "policy", "accounting"]


@pytest.fixture(scope="module")
def work(tmp_path_factory) -> Path:
    return validated(tmp_path_factory.mktemp("one"), (1, 2), SETTINGS)


def default(work, name):
    """The rows of the model that plans every event."""
    frame = artefacts.read(work, name)
    return frame[frame["followers"] == "own_fit"]


def test_every_table_has_rows(work):
    for table in STUDY_TABLES:
        if table.name not in ("worse_for_somebody", "tracking_contacts"):
            assert len(artefacts.read(work, table.name)), table.name


def test_cross_scores_on_the_diagonal_are_the_validation_matrix(work):
    cross = artefacts.read(work, "cross_scores")
    diagonal = cross[(cross["optimised"] == cross["scored"]) & (cross["planned_with"] == cross["scored_with"])]
    matrix = artefacts.read(work, "validation_matrix")
    whole = matrix[matrix["stratum"] == "all"].set_index(["followers", "form", "accounting"])
    assert list(dict.fromkeys(matrix["followers"])) == ["own_fit", "table3"]
    diagonal = diagonal.set_index(["planned_with", "form", "scored"])
    assert set(diagonal.index) == set(whole.index)
    for column in ("total_benchmark", "total_local", "gain", "gain_low", "gain_high", "gain_av", "gain_hv"):
        expected = whole.loc[diagonal.index, column].to_numpy()
        assert diagonal[column].to_numpy() == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_cross_losses_are_those_of_the_losses_table(work):
    cross = artefacts.read(work, "cross_losses")
    cross = cross[cross["planned_with"] == cross["scored_with"]]
    cross = cross.rename(columns={"planned_with": "followers"}).set_index(["followers", *KEY])
    losses = artefacts.read(work, "losses").set_index(["followers", *KEY]).loc[cross.index]
    for accounting, av, hv in (("paper", "T", "T"), ("follower_horizon", "T", "H"), ("equal", "H", "H")):
        here = cross.index.get_level_values("accounting") == accounting
        for mine, theirs in ((f"av_to_{av}", "loss_av"), (f"hv_to_{hv}", "loss_hv")):
            assert cross[mine][here].to_numpy() == pytest.approx(losses[theirs][here].to_numpy(), rel=1e-9)


def test_further_models_plan_a_sample_and_both_score_each_others_plans(work):
    plans, cross = artefacts.read(work, "plans"), artefacts.read(work, "cross_losses")
    events = plans.groupby("followers")["event_id"].agg(set)
    assert len(events["table3"]) == min(3, len(events["own_fit"]))
    assert events["own_fit"] == set(artefacts.read(work, "events")["event_id"])
    for one, other in (("own_fit", "table3"), ("table3", "own_fit")):
        scored = cross[(cross["planned_with"] == one) & (cross["scored_with"] == other)]
        assert set(scored["event_id"]) == events["table3"]
        own = cross[(cross["planned_with"] == one) & (cross["scored_with"] == one)].set_index(KEY)
        pair = scored.set_index(KEY).join(own.add_suffix("_own"), how="left")
        at_start = ~pair.index.get_level_values("policy").str.endswith("_start")
        # Who behind whom drives on after T depends on the followers only where a gap was chosen.
        for end in ("T", "H"):
            kept = pair if end == "T" else pair[at_start]
            assert (kept[f"av_to_{end}"].dropna() == kept[f"av_to_{end}_own"].dropna()).all()
        assert (pair["hv_to_H"] != pair["hv_to_H_own"]).any()


def test_references_are_scored_under_each_model(work):
    losses = artefacts.read(work, "losses")
    sampled = losses[losses["followers"] == "table3"]["event_id"].unique()
    references = losses[losses["policy"].isin(names.REFERENCE_POLICIES) & losses["event_id"].isin(sampled)]
    counts = references.groupby(["event_id", "policy", "accounting"])["followers"].nunique()
    assert (counts == 2).all()


def test_sample_is_studied_and_no_other_event(work):
    events = set(artefacts.read(work, "events")["event_id"])
    studied = set(artefacts.read(work, "pareto_summary")["event_id"])
    assert len(studied) == min(3, len(events))
    for name in ("horizon_losses", "uncertainty"):
        assert set(artefacts.read(work, name)["event_id"]) == studied
    assert set(artefacts.read(work, "solver_comparison")["event_id"]) <= studied


def test_plans_are_driven_by_the_bicycle_and_a_sample_by_the_multi_body_car(work):
    events, tracking = artefacts.read(work, "events"), artefacts.read(work, "tracking")
    heavy = tracking[tracking["plant"] == "multi_body"]
    assert heavy["event_id"].nunique() == min(2, len(events))
    policies = tracking.groupby(["event_id", "plant"])["policy"].agg(set)
    plans = artefacts.read(work, "plans")
    changing = plans[plans["policy"] != names.NO_LANE_CHANGE].groupby("event_id")["policy"].agg(set)
    for (event, _), found in policies.items():
        assert found == changing[event]


def test_planned_sides_of_tracking_are_those_of_plans_and_losses(work):
    key = ["event_id", "policy"]
    tracking = default(work, "tracking")
    tracking = tracking[tracking["rmse_lateral_m"].notna()]
    assert len(tracking)
    primary = {
        name: frame[frame["accounting"] == names.PRIMARY_ACCOUNTING].set_index(key)
        for name, frame in ((n, default(work, n)) for n in ("plans", "losses"))
    }
    at = pd.MultiIndex.from_frame(tracking[key])
    for mine, table, theirs in (
        ("loss_hv_planned", "losses", "loss_hv"),
        ("min_clearance_planned_m", "plans", "min_clearance_m"),
    ):
        expected = primary[table][theirs].reindex(at).to_numpy()
        assert tracking[mine].to_numpy() == pytest.approx(expected, rel=1e-9, nan_ok=True)
    touching = tracking["violations"].map(lambda found: any(name.startswith("clearance_") for name in found))
    assert (touching == (tracking["min_clearance_tracked_m"] < 0.0)).all()


def test_what_was_not_driven_has_a_status_and_no_number(work):
    tracking = artefacts.read(work, "tracking")
    missing = tracking[tracking["rmse_lateral_m"].isna()]
    assert set(missing["status"]) <= {names.INFEASIBLE, names.INFEASIBLE_AT_START, "invalid_reference"}
    about = ["event_id", "recording_id", "followers", "policy", "plant", "status", "contact"]
    assert missing.drop(columns=about).isna().all(axis=None)


def test_own_horizon_repeats_the_losses(work):
    horizons = artefacts.read(work, "horizon_losses")
    own = horizons[(horizons["horizon_s"] == 15.0) & (horizons["form"] == names.FIXED)]
    losses = default(work, "losses").set_index(KEY)
    for row in own.itertuples():
        local = losses.loc[(row.event_id, names.LOCAL_OPTIMUM, row.accounting)]
        assert row.loss_av_local == pytest.approx(local["loss_av"], rel=1e-9)
        assert row.loss_hv_local == pytest.approx(local["loss_hv"], rel=1e-9)


def test_gain_with_the_fitted_parameters_is_that_of_the_losses(work):
    totals = default(work, "losses").set_index(KEY)["loss_total"]
    for row in artefacts.read(work, "uncertainty").itertuples():
        benchmark, local = PAIRS[row.form]
        expected = (
            1 - totals[row.event_id, local, row.accounting] / totals[row.event_id, benchmark, row.accounting]
        )
        assert row.gain == pytest.approx(expected, abs=1e-9)


def test_every_form_is_cross_scored_and_drawn_and_both_free_ones_have_a_front(work):
    assert set(artefacts.read(work, "cross_scores")["form"]) == set(PAIRS | ROBUST_PAIRS)
    assert set(artefacts.read(work, "uncertainty")["form"]) == set(PAIRS)
    summary = artefacts.read(work, "pareto_summary")
    assert set(summary["form"]) == {names.FREE, names.FREE_START}
    assert set(artefacts.read(work, "gain_map")["form"]) == set(PAIRS)


def test_share_observed_is_a_share_of_what_is_charged(work):
    losses = default(work, "losses")
    human = losses[(losses["policy"] == names.HUMAN) & (losses["accounting"] == names.EQUAL)]
    matrix = default(work, "validation_matrix").set_index(["form", "accounting", "stratum"])
    share = matrix.loc[(names.FIXED, names.EQUAL, "all"), "share_observed"]
    assert share == pytest.approx(human["recorded_n_samples"].sum() / human["follower_n_samples"].sum())
    assert 0.0 < share <= 1.0


def test_worst_follower_is_compared(work):
    summary = default(work, "summary_losses")
    chosen = summary[(summary["quantity"] == "worst_follower") & (summary["policy"] == names.LOCAL_OPTIMUM)]
    losses = default(work, "losses").set_index(KEY)["loss_hv_each"]
    events = losses.index.get_level_values("event_id").unique()
    row = chosen[(chosen["against"] == names.BENCHMARK) & (chosen["accounting"] == names.EQUAL)].iloc[0]
    worst = [
        max(
            np.array(losses[e, names.LOCAL_OPTIMUM, names.EQUAL])
            - np.array(losses[e, names.BENCHMARK, names.EQUAL])
        )
        for e in events
        if losses[e, names.LOCAL_OPTIMUM, names.EQUAL] is not None
    ]
    assert row["mean"] - row["mean_against"] == pytest.approx(np.mean(worst), abs=1e-9)


def test_order_of_the_recordings_does_not_matter(work, tmp_path):
    other = done_again(work, tmp_path, (2, 1), SETTINGS, validate)
    for name in ("cross_losses", "cross_scores", "uncertainty", "pareto", "solver_comparison", "horizon_losses"):
        pd.testing.assert_frame_equal(artefacts.read(work, name), artefacts.read(other, name), check_exact=True)
