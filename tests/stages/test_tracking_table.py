"""Planned against tracked from made-up rows whose summary can be written down."""

import numpy as np
import pandas as pd
import pytest

from highd_lc.stages.tracking_tables import tracking_contacts, tracking_summary
from highd_lc.vocab import names
from highd_lc.vocab.tables import TABLES


def row(k, **changes):
    made = {
        "event_id": f"01-{k:04d}-00100", "recording_id": 1, "policy": names.BENCHMARK, "plant": "kinematic",
        "status": "tracked", "followers": "population", "contact": "", "contact_cause": "",
        "rmse_lateral_m": 0.001 * k, "max_lateral_m": 0.01 * k,
        "rmse_longitudinal_m": 0.01,
        "rmse_heading_rad": 0.001, "max_slack": 0.0, "qp_failures": 0, "loss_av_tracked": 10.0 + k,
        "loss_av_planned": 10.0, "loss_hv_tracked": 8.0, "loss_hv_planned": 8.0 + k,
        "min_clearance_tracked_m": 1.0, "min_clearance_planned_m": 1.0, "violations": [],
    }  # fmt: skip
    return made | changes


@pytest.fixture
def summary():
    rows = [
        row(1),
        row(2, status="softened", violations=["jerk_y"]),
        row(
            3,
            status="lost",
            contact="target_follower_1_through_ego",
            qp_failures=2,
            violations=["clearance_target_leader"],
            min_clearance_tracked_m=-0.1,
        ),
        row(4, **dict.fromkeys(list(row(0))[8:-1], np.nan), status="infeasible", violations=None),
        row(9, plant="multi_body", min_clearance_planned_m=-0.2),
    ]
    tracking = pd.DataFrame(rows).astype({"qp_failures": "Int64"})
    return tracking_summary(tracking).set_index(["plant", "policy"])


def test_each_policy_and_plant_has_its_row(summary):
    assert list(summary.index) == [("kinematic", names.BENCHMARK), ("multi_body", names.BENCHMARK)]
    assert summary.reset_index().columns.isin(TABLES["tracking_summary"].column_names).all()


def test_figures_are_those_of_the_driven_plans(summary):
    found = summary.loc[("kinematic", names.BENCHMARK)]
    assert (found["n_driven"], found["not_driven"], found["lost"], found["softened"]) == (3, 1, 1, 1)
    assert (found["qp_failures"], found["max_lateral_m"], found["contacts"]) == (2, 0.03, 1)
    assert found["rmse_lateral_median_m"] == pytest.approx(0.002)
    assert found["rmse_lateral_largest_m"] == pytest.approx(0.003)
    assert (found["loss_av_tracked"], found["loss_av_planned"]) == (12.0, 10.0)
    assert (found["loss_hv_tracked"], found["loss_hv_planned"]) == (8.0, 10.0)
    assert found["share_violating"] == pytest.approx(2 / 3)
    assert found["share_touching"] == pytest.approx(1 / 3)
    assert found["share_touching_planned"] == 0.0
    assert summary.loc[("multi_body", names.BENCHMARK), "share_touching_planned"] == 1.0


def test_nothing_driven_is_missing_and_not_zero():
    none = row(1, **dict.fromkeys(list(row(0))[8:-1], np.nan), status="infeasible", violations=None)
    found = tracking_summary(pd.DataFrame([none]).astype({"qp_failures": "Int64"})).iloc[0]
    assert (found["n_driven"], found["not_driven"]) == (0, 1)
    for name in ("rmse_lateral_median_m", "max_lateral_m", "loss_av_tracked", "share_violating", "share_touching"):
        assert np.isnan(found[name]), name
    assert np.isnan(found["share_touching_planned"])


def test_no_rows_make_an_empty_table():
    empty = pd.DataFrame([row(1)]).iloc[:0]
    assert tracking_summary(empty).empty


def test_contacts_are_counted_by_pair_and_cause():
    """Plans that a search chose apart from references, whose contacts nothing rejects."""
    through = {"contact": "target_follower_2_through_target_follower_1"}
    rows = [
        row(1),
        row(1, **through, contact_cause=names.BY_TRACKING),
        row(1, **through, contact_cause=names.BY_TRACKING, policy=names.LOCAL_OPTIMUM),
        row(2, **through, contact_cause=names.BY_TRACKING),
        row(1, **through, contact_cause=names.BY_PLAN, policy=names.HUMAN),
        row(1, **through, contact_cause=names.BY_FOLLOWER_MODEL, policy=names.CONSTANT, followers="own_fit"),
    ]
    found = tracking_contacts(pd.DataFrame(rows)).set_index(["followers", "cause"])
    assert list(found.columns) == ["plant", "contact", "n_events", "n_plans", "n_references"]
    counts = {key: tuple(one[["n_events", "n_plans", "n_references"]]) for key, one in found.iterrows()}
    assert counts == {
        ("own_fit", names.BY_FOLLOWER_MODEL): (1, 0, 1),
        ("population", names.BY_PLAN): (1, 0, 1),
        ("population", names.BY_TRACKING): (2, 3, 0),
    }
    assert tracking_contacts(pd.DataFrame(rows[:1])).empty
