"""Losses and clearances of every plan follow from the artefacts alone, by code of their own."""

import numpy as np
import pandas as pd
import pytest
from recompute import drives_through, plan_losses, read_event, smallest_clearance
from recompute_start import start_clearance, start_losses

TABLES = ("events", "event_tracks", "vehicles", "followers", "plans", "losses")
KEYS = ["event_id", "policy", "accounting"]
TOLERANCE = 1e-3


@pytest.fixture(scope="module")
def tables(pipeline_run):
    return {name: pd.read_parquet(pipeline_run.work / f"{name}.parquet") for name in TABLES}


@pytest.fixture(scope="module")
def plans(tables):
    return merged(tables, chooses_start=False)


@pytest.fixture(scope="module")
def starts(tables):
    return merged(tables, chooses_start=True)


def merged(tables, *, chooses_start):
    """The plans of the fitted drivers with their losses."""
    both = tables["plans"].merge(tables["losses"], on=["followers", *KEYS], suffixes=("", "_loss"))
    both = both[both["followers"] == "own_fit"]
    return both[both["T"].notna() & (both["policy"].str.endswith("_start") == chooses_start)]


def test_contacts_follow_from_the_artefacts(tables, plans):
    changes = plans[~plans["policy"].isin(["no_lane_change", "human"])]
    for event_id, rows in changes.groupby("event_id"):
        event = read_event(tables, event_id)
        for _, plan in rows.iterrows():
            met = drives_through(event, plan, round(plan["T"] / 0.1) // 2)
            assert met == (plan["contact"] != ""), (event_id, plan["policy"], plan["contact"])
            assert met == np.isnan(plan["loss_total"])


def test_nobody_is_commanded_to_brake_harder_than_the_bound(tables):
    assert tables["losses"]["peak_follower_decel"].max() <= 9.0
    assert tables["plans"]["braking_after_T"].max() <= 9.0


def test_losses_follow_from_the_artefacts(tables, plans):
    assert len(plans) > 0
    for event_id, rows in plans[plans["contact"] == ""].groupby("event_id"):
        event = read_event(tables, event_id)
        for _, plan in rows.iterrows():
            for name, value in plan_losses(event, plan).items():
                assert value == pytest.approx(plan[name], rel=TOLERANCE), (event_id, plan["policy"], name)


def test_smallest_clearance_follows_from_the_artefacts(tables, plans):
    solved = plans[(plans["status"] == "solved") & (plans["accounting"] == "equal")]
    assert len(solved) > 0
    for event_id, rows in solved.groupby("event_id"):
        event = read_event(tables, event_id)
        for _, plan in rows.iterrows():
            assert smallest_clearance(event, plan) == pytest.approx(plan["min_clearance_m"], abs=1e-3)
            assert np.isfinite(plan["min_clearance_m"])


def test_losses_of_chosen_starts_follow_from_the_artefacts(tables, starts):
    assert (starts["delay_s"] > 0).any()
    for event_id, rows in starts.groupby("event_id"):
        event = read_event(tables, event_id)
        for _, plan in rows.iterrows():
            for name, value in start_losses(event, plan).items():
                assert value == pytest.approx(plan[name], rel=TOLERANCE), (event_id, plan["policy"], name)


def test_smallest_clearance_of_chosen_starts_follows_from_the_artefacts(tables, starts):
    solved = starts[(starts["status"] == "solved") & (starts["accounting"] == "equal")]
    assert len(solved) > 0
    for event_id, rows in solved.groupby("event_id"):
        event = read_event(tables, event_id)
        for _, plan in rows.iterrows():
            assert start_clearance(event, plan) == pytest.approx(plan["min_clearance_m"], abs=1e-3)
