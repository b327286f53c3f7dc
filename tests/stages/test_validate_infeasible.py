"""Events without a feasible plan beside others: they are results with a status, and lose nobody else's rows."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from running import FIXTURES, validated

from highd_lc.io import artefacts
from highd_lc.stages import validate
from highd_lc.stages.tracking_tables import Planned
from highd_lc.vocab import names
from highd_lc.vocab.job import Job, Provenance
from highd_lc.vocab.settings import Settings

# Within 4 s, a lateral shift of more than about 3.75 m asks for more than this lateral acceleration.
_CONSTRAINTS = {"acceleration": 1.35}
_NO_STUDIES = {
    name: 0
    for name in (
        "sample",
        "start_sample",
        "foresight_sample",
        "solver_sample",
        "multibody_sample",
        "safety_sample",
    )
}
SETTINGS = Settings.model_validate(
    {
        "calibrate": {"optimiser": "screen", "models": ["constant_speed"]},
        "validate": {
            "constraints": _CONSTRAINTS,
            "followers": {"model": "own_fit"},
            "planner": {"T_max": 4.0},
            "studies": _NO_STUDIES,
            "multiverse": {"sample": 0},
            "closed_loop": {"events": 0},
            "robust": {"sample": 0},
            "statistics": {"bootstrap": 200},
        },
    }
)
OPTIMAL = (*names.FIXED_POLICIES, *names.FREE_POLICIES)


@pytest.fixture(scope="module")
def work(tmp_path_factory) -> Path:
    return validated(tmp_path_factory.mktemp("infeasible"), (1, 2), SETTINGS)


@pytest.fixture(scope="module")
def plans(work) -> pd.DataFrame:
    found = artefacts.read(work, "plans")
    return found[found["policy"].isin(OPTIMAL)].set_index(["event_id", "policy", "accounting"])


def test_some_events_have_a_plan_and_some_have_none(plans):
    assert set(plans["status"]) == {names.SOLVED, names.INFEASIBLE}


def test_every_event_has_a_row_for_each_policy_and_accounting(work, plans):
    losses = artefacts.read(work, "losses")
    events = artefacts.read(work, "events")["event_id"]
    counts = losses.groupby("event_id").size().reindex(events)
    assert (counts == len(names.ACCOUNTINGS) * (len(OPTIMAL) + len(names.REFERENCE_POLICIES))).all()
    assert len(plans) == len(events) * len(names.ACCOUNTINGS) * len(OPTIMAL)


def test_without_a_plan_losses_are_null_and_followers_lists_empty(work, plans):
    losses = artefacts.read(work, "losses").set_index(["event_id", "policy", "accounting"]).loc[plans.index]
    missing = losses[plans["status"] == names.INFEASIBLE]
    assert missing[["loss_av", "loss_hv", "loss_total", "min_gap_m"]].isna().all(axis=None)
    assert (missing["loss_hv_each"].map(len) == 0).all()
    assert (missing["follower_n_samples"] == 0).all()
    there = losses[plans["status"] == names.SOLVED]
    assert there["loss_total"].notna().all()
    assert (there["loss_hv_each"].map(len) > 0).all()


def test_matrix_counts_them_and_leaves_them_out_of_the_totals(work, plans):
    matrix = artefacts.read(work, "validation_matrix")
    losses = artefacts.read(work, "losses").set_index(["policy", "accounting"])["loss_total"]
    for cell in matrix[matrix["stratum"] == "all"].itertuples():
        _, local = names.FIXED_POLICIES if cell.form == names.FIXED else names.FREE_POLICIES
        status = plans.xs((local, cell.accounting), level=("policy", "accounting"))["status"]
        assert cell.n_events == len(status)
        assert cell.infeasible == (status == names.INFEASIBLE).sum() > 0
        assert cell.total_local == pytest.approx(losses.loc[(local, cell.accounting)].sum())
        assert np.isfinite(cell.gain)
        assert 0.0 <= cell.share_worst_follower_worse <= 1.0


def test_an_event_that_fails_is_listed_and_leaves_no_row(work, monkeypatch):
    events = artefacts.read(work, "events", recording=1)["event_id"].tolist()
    whole = validate.tracking_rows

    def fails_once(planned: Planned) -> Iterator[dict[str, object]]:
        if planned.tracker.problem.scene.event_id == events[0]:
            raise KeyError("something unforeseen")
        return whole(planned)

    monkeypatch.setattr(validate, "tracking_rows", fails_once)
    report = validate.run(Job(1, FIXTURES, work, SETTINGS, Provenance("settings", {}, 1, "code")))
    assert [problem.message for problem in report.problems] == [f"{events[0]}: KeyError: 'something unforeseen'"]
    for name in ("plans", "losses", "tracking"):
        left = artefacts.read_part(work, "validate", name, 1)["event_id"]
        assert set(left) == set(events[1:])
    assert set(artefacts.read_partition(work, "trajectories", 1)["event_id"]) == set(events[1:])
