"""A follower model that a researcher adds as a function: from the settings to the page."""

import io
import os

import numpy as np
import pandas as pd
import pytest
from rich.console import Console
from running import FIXTURES

from highd_lc import engine
from highd_lc.io import artefacts
from highd_lc.stages.overview_pages import Overview, page_of
from highd_lc.vocab.job import Options
from highd_lc.vocab.settings import Settings

PLANS, JUDGED = "own_drivers:timid", "own_drivers:timid@crossing+memory"
MODULE = """
def timid(v, v_leader, spacing, parameters):
    v_0, T, length = parameters
    gap = spacing - length
    return max(min(0.2 * (v_0 - v), 0.03 * (gap - 2.0 - v * T) + 0.3 * (v_leader - v)), -3.0)

timid.parameters = {"v_0": 31.0, "T": 1.1}
"""


def settings():
    samples = ("sample", "start_sample", "foresight_sample", "solver_sample", "multibody_sample", "safety_sample")
    few = {
        "studies": dict.fromkeys(samples, 0),
        "robust": {"sample": 1, "draws": 2},
        "statistics": {"bootstrap": 100},
        "multiverse": {"sample": 0},
        "closed_loop": {"events": 1},
    }
    models = ["constant_speed", "drift", "table3", "population", JUDGED]
    calibrate = {"optimiser": "screen", "study_sample": 0, "models": models}
    followers = {"model": PLANS, "also": ["own_fit"], "also_sample": 3}
    return Settings.model_validate({"calibrate": calibrate, "validate": few | {"followers": followers}})


@pytest.fixture(scope="module")
def options(tmp_path_factory):
    root = tmp_path_factory.mktemp("own")
    (root / "own_drivers.py").write_text(MODULE)
    made = Options(FIXTURES, root / "work", root / "reports", workers=1)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(os.fspath(root))
        outcome = engine.run(settings(), made, last="validate", console=Console(file=io.StringIO()))
        assert not outcome.problems
        yield made


def timid(v, v_leader, spacing, length):
    return max(min(0.2 * (31.0 - v), 0.03 * (spacing - length - 2.0 - v * 1.1) + 0.3 * (v_leader - v)), -3.0)


def test_its_drivers_are_told_with_their_parameters(options):
    rows = artefacts.read(options.work, "follower_models").set_index("model")
    for model, moment, memory in ((PLANS, 0.0, 0.0), (JUDGED, 0.5, 2.0)):
        own = rows.loc[[model]]
        assert set(own["family"]) == {"function"}
        assert [dict(one) for one in own["parameters"]] == [{"v_0": 31.0, "T": 1.1}] * len(own)
        assert own["v_desire"].isna().all()
        assert (own["moment"] == moment).all()
        assert (own["memory_s"] == memory).all()
    assert not [one for one in rows.loc["population", "parameters"] if len(one)]


def test_it_is_scored_beside_the_others(options):
    summary = artefacts.read(options.work, "prediction_summary")
    every = summary[(summary["stratum"] == "all") & (summary["horizon_s"] == 5.0)].set_index("model")
    assert np.isfinite(every.loc[[PLANS, JUDGED], ["mae", "bias", "skill_constant"]]).all(axis=None)
    assert every.index[every["default"]].tolist() == [PLANS]
    assert every.loc[PLANS, "n_events"] == every.loc["population", "n_events"] > 0


def test_it_plans_and_is_scored_by_the_others(options):
    plans = artefacts.read(options.work, "plans")
    own = plans[(plans["followers"] == PLANS) & (plans["policy"] == "local_optimum")]
    assert (own["status"] == "solved").any()
    cross = artefacts.read(options.work, "cross_scores")
    assert {PLANS, "own_fit"} <= set(cross["planned_with"]) & set(cross["scored_with"])


def test_every_judged_model_has_followers_behind_the_recorded_ego(options):
    rows = pd.read_parquet(options.work / "trajectories")
    behind = rows[(rows["policy"] == "recorded") & (rows["kind"] == "simulated")]
    models = {*settings().calibrate.models, *settings().validation.follower_models}
    for event in rows["event_id"].unique():
        assert set(behind.loc[behind["event_id"] == event, "followers"]) >= models - {"own_fit"}


def test_its_trajectories_follow_from_the_function_alone(options):
    rows = pd.read_parquet(options.work / "trajectories")
    lengths = artefacts.read(options.work, "vehicles").set_index(["recording_id", "vehicle_id"])["length"]
    events = artefacts.read(options.work, "events").set_index("event_id")
    planned = rows[(rows["followers"] == PLANS) & (rows["policy"] == "local_optimum")]
    planned = planned[planned["kind"] == "simulated"]
    compared = 0
    for event, of in planned.groupby("event_id"):
        roles, about = dict(list(of.groupby("role"))), events.loc[event]
        ego, first = roles["ego"], roles["target_follower_1"]
        recording = about["recording_id"]
        leader, own = (lengths[recording, v] for v in (about["ego_id"], about["follower_ids"][0]))
        spacing = ego["x"].to_numpy() - first["x"].to_numpy() + (leader - own) / 2.0
        speeds = zip(first["vx"], ego["vx"], spacing, strict=True)
        expected = [timid(v, v_leader, s, leader) for v, v_leader, s in speeds]
        np.testing.assert_allclose(first["ax"], expected, atol=1e-3)
        compared += 1
    assert compared


def test_the_page_names_it(options, undrawn):
    validation = settings().validation
    of_run = Overview(options.work, False, validation.statistics, validation.followers.b_max, PLANS)
    page = page_of("prediction.html", of_run).decode()
    assert PLANS in page
    assert JUDGED in page
