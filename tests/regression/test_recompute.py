"""Losses and clearances of every plan follow from the artefacts alone, by code of their own."""

import numpy as np
import pandas as pd
import pytest
from recompute import plan_losses, read_event, smallest_clearance

TABLES = ("events", "event_tracks", "vehicles", "followers", "plans", "losses")
KEYS = ["event_id", "policy", "accounting"]
TOLERANCE = 1e-3


@pytest.fixture(scope="module")
def tables(pipeline_run):
    return {name: pd.read_parquet(pipeline_run.work / f"{name}.parquet") for name in TABLES}


@pytest.fixture(scope="module")
def plans(tables):
    # Plans that choose their start are recomputed by the tests of the start's planner.
    merged = tables["plans"].merge(tables["losses"], on=KEYS, suffixes=("", "_loss"))
    return merged[merged["T"].notna() & ~merged["policy"].str.endswith("_start")]


def test_losses_follow_from_the_artefacts(tables, plans):
    assert len(plans) > 0
    for event_id, rows in plans.groupby("event_id"):
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
