"""Losses and clearances of every plan follow from the artefacts alone, by code of their own."""

import numpy as np
import pandas as pd
import pytest
from random_scenes import reacting
from recompute import (
    behind,
    drive,
    drives_through,
    in_view,
    plan_losses,
    read_event,
    safety_slack,
    smallest_clearance,
    unchanged,
)
from recompute_start import start_clearance, start_losses

from highd_lc.core.quintic import Quintic
from highd_lc.planning.planner import pose, stay
from highd_lc.planning.replay import human_motion, plan_motion, replay
from highd_lc.planning.start_planner import key_of, replay_start
from highd_lc.planning.starts import pose_starts
from highd_lc.scoring import charges
from highd_lc.stages.scenes import read_scene_tables, scene_makers

TABLES = ("events", "event_tracks", "vehicles", "followers", "plans", "losses")
DEFAULT = "population"
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


def merged(tables, *, chooses_start, model="own_fit"):
    """The plans with a follower model, the fitted drivers unless told otherwise, with their losses."""
    both = tables["plans"].merge(tables["losses"], on=["followers", *KEYS], suffixes=("", "_loss"))
    both = both[both["followers"] == model]
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


@pytest.fixture(scope="module")
def of_default(pipeline_run, tables):
    """The tables with the models that the followers of the default model drive by."""
    assert pipeline_run.settings.validation.follower_models[0] == DEFAULT
    return tables | {"follower_models": pd.read_parquet(pipeline_run.work / "follower_models.parquet")}


@pytest.mark.parametrize("chooses_start", [False, True])
def test_losses_of_the_default_model_follow_from_its_artefacts(of_default, chooses_start):
    rows, losses = (
        merged(of_default, chooses_start=chooses_start, model=DEFAULT),
        start_losses if chooses_start else plan_losses,
    )
    rows = rows[rows["contact"] == ""]
    assert rows["accounting"].nunique() == 3
    for event_id, of_event in rows.groupby("event_id"):
        event = read_event(of_default, event_id, DEFAULT)
        for _, plan in of_event.iterrows():
            for name, value in losses(event, plan).items():
                assert value == pytest.approx(plan[name], rel=1e-6), (event_id, plan["policy"], name)


def test_trajectories_of_the_default_model_follow_from_its_artefacts(pipeline_run, of_default):
    found = pd.read_parquet(pipeline_run.work / "trajectories")
    found = found[(found["kind"] == "simulated") & (found["followers"] == DEFAULT)]
    found = found.set_index(["event_id", "policy", "role"]).sort_index()
    rows = merged(of_default, chooses_start=False, model=DEFAULT)
    compared = set()
    for _, plan in rows[rows["accounting"] == "equal"].iterrows():
        event = read_event(of_default, plan["event_id"], DEFAULT)
        stays = plan["policy"] == "no_lane_change"
        motion = unchanged(event) if stays else behind(event, drive(event, plan))
        for policy in (plan["policy"], "recorded") if plan["policy"] == "human" else (plan["policy"],):
            for rank, mine in enumerate(motion, start=1):
                key = (plan["event_id"], policy, f"target_follower_{rank}")
                if key not in found.index:
                    assert policy == "recorded"  # out of view at once
                    continue
                written = found.loc[[key]].sort_values("t")
                for column, name in (("x", "x"), ("vx", "v"), ("ax", "a")):
                    # As exact as single precision is.
                    assert written[column].to_numpy(float) == pytest.approx(
                        mine[name][: len(written)], rel=1e-6, abs=1e-6
                    ), (key, column)  # fmt: skip
                compared.add(policy)
    assert compared >= {"human", "recorded", "no_lane_change", "benchmark", "local_optimum", "constant"}


def test_error_and_effect_follow_from_the_same_samples(of_default):
    rows = merged(of_default, chooses_start=False, model=DEFAULT)
    rows = rows[(rows["accounting"] == "equal") & (rows["contact"] == "")]
    known = 0
    for _, plan in rows[rows["policy"].isin(["benchmark", "local_optimum", "human"])].iterrows():
        event = read_event(of_default, plan["event_id"], DEFAULT)
        simulated = [motion["v"] for motion in behind(event, drive(event, plan))]
        value = in_view(of_default, plan["event_id"], event, simulated)
        assert value == pytest.approx(plan["loss_hv_in_view"], rel=1e-6, nan_ok=True)
        known += np.isfinite(value)
        if plan["policy"] == "human":
            recorded = in_view(of_default, plan["event_id"], event, [car.v for car in event.followers])
            assert recorded == pytest.approx(plan["loss_hv_in_view_recorded"], rel=1e-6, nan_ok=True)
    assert known > 0


def test_no_plan_breaks_the_safety_profile(tables, plans):
    solved = plans[plans["status"] == "solved"]
    assert len(solved) > 0
    for event_id, rows in solved.groupby("event_id"):
        event = read_event(tables, event_id)
        for _, plan in rows.iterrows():
            assert min(safety_slack(event, plan).values()) > -1e-6, (event_id, plan["policy"])
            assert plan["accounting"] == "paper" or smallest_clearance(event, plan) > 0.3 - 1e-3


def test_who_has_no_plan_stays_and_says_why(tables):
    plans = tables["plans"]
    without = plans[plans["T"].isna()]
    assert (without["fallback"] == "no_lane_change").all()
    assert (without["binding"] != "").all()
    assert (plans.loc[plans["T"].notna(), "fallback"] != "no_lane_change").all()


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


def scene_of(work, event_id, settings):
    tables = read_scene_tables(work, int(event_id.split("-")[0]), settings)
    return dict(scene_makers(tables, settings))[event_id]()


def follower_models(event_id, followers):
    """Rows of ``follower_models`` of one event, from what a scene's followers drive by."""
    columns = dict(zip(("v_desire", "A", "b", "B", "tau", "L"), followers.parameters.T, strict=True))
    parts = {name: getattr(followers, name) for name in ("need", "a_0", "drift", "moment")}
    rows = pd.DataFrame(columns | parts).assign(memory_s=followers.memory, relaxation_s=followers.relaxation)
    rows = rows.assign(event_id=event_id, model="population", family=followers.family)
    return rows.assign(L_before=followers.L_no_change, follower=np.arange(len(rows)) + 1)


@pytest.mark.parametrize(("family", "moment"), [("lcm", 0.0), ("lcm", 0.5), ("idm", 0.3), ("none", 0.7)])
def test_losses_of_followers_that_react_follow_from_their_models(
    pipeline_run, tables, plans, starts, family, moment
):
    settings = pipeline_run.settings.validation
    rng = np.random.default_rng(4)
    compared = set()
    for event_id in plans["event_id"].unique():
        scene = reacting(scene_of(pipeline_run.work, event_id, settings), rng, family=family, moment=moment)
        problem = pose(scene, settings)
        models = {"follower_models": follower_models(event_id, scene.followers)}
        event = read_event(tables | models, event_id)
        for played, plan, losses in replayed(problem, event_id, plans, starts):
            cumulative = charges.cumulative_losses(played, problem.terms, problem.packed.dt)
            accounting = (plan["accounting"], problem.terms)
            found = charges.losses_at(cumulative, *accounting, n=played.av.n, dt=problem.packed.dt)
            assert found["loss_hv"] == pytest.approx(losses(event, plan)["loss_hv"], rel=1e-6), plan["policy"]
            compared.add(plan["policy"])
    assert compared >= {"human", "no_lane_change", "local_optimum", "local_optimum_start"}


def replayed(problem, event_id, plans, starts):
    """Every plan of an event that was charged to H, with everybody's motion, and who recomputes its losses."""
    of_event = (rows[(rows["event_id"] == event_id) & (rows["accounting"] == "equal")] for rows in (plans, starts))
    at_once, chosen = of_event
    for _, plan in at_once.iterrows():
        shape = Quintic(problem.scene.v0, problem.scene.lateral_shift, *plan[["T", "x_final", "v_end"]])
        if plan["policy"] == "no_lane_change":
            played = stay(problem)
        elif plan["policy"] == "human":
            played = replay(human_motion(problem.scene.human, problem.packed), problem.packed)
        else:
            played = replay(plan_motion(shape, problem.packed), problem.packed)
        yield played, plan, plan_losses
    posed = pose_starts(problem)
    for _, plan in chosen.iterrows():
        key = key_of(posed, plan["gap"], plan["delay_s"])
        shape = Quintic(plan["v_start"], problem.scene.lateral_shift, *plan[["T", "x_final", "v_end"]])
        yield replay_start(posed, key, shape), plan, start_losses
