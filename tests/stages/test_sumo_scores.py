"""Replays in SUMO, made by SUMO itself where it is installed."""

import importlib.util
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import running
from random_scenes import random_scene
from rich.console import Console

from highd_lc import engine
from highd_lc.io import artefacts, sumo_replay
from highd_lc.io import settings as settings_file
from highd_lc.planning.planner import contact_of, pose, reference_plans
from highd_lc.reporting.pages_robust import sumo_sections
from highd_lc.scoring.charges import cumulative_losses
from highd_lc.stages.overview_pages import Overview
from highd_lc.stages.sumo_scores import SumoTracker, leaders, sumo_summary
from highd_lc.vocab import names
from highd_lc.vocab.errors import InputError, MissingExtraError
from highd_lc.vocab.job import Options
from highd_lc.vocab.settings import Settings, ValidateSettings
from highd_lc.vocab.tables import TABLES

INSTALLED = all(importlib.util.find_spec(name) is not None for name in ("sumo", "libsumo"))
needs_sumo = pytest.mark.skipif(not INSTALLED, reason="extra sumo is not installed")
QUICK = Path(__file__).parents[1] / "faults" / "quick.toml"
SETTINGS = ValidateSettings()


def posed(seed=3, **changes):
    scene = replace(random_scene(np.random.default_rng(seed), p=3), **changes)
    return pose(scene, SETTINGS)


def mirrored(scene):
    """The same lane change to the other side."""

    def other_side(motion):
        return None if motion is None else replace(motion, y=-motion.y)

    leader = other_side(scene.target_leader)
    followers = replace(scene.followers, y=-scene.followers.y)
    return replace(scene, lateral_shift=-scene.lateral_shift, target_leader=leader, followers=followers)


def constant(problem):
    return reference_plans(problem, names.CONSTANT)[0]


def replayed(problem, plan=None, seed=1):
    plan = constant(problem) if plan is None else plan
    return SumoTracker(problem, seed).among(plan.replay, plan.policy)


@needs_sumo
def test_a_replay_depends_on_the_event_and_the_seed_and_on_nothing_before_it():
    one, other = posed(3), posed(4, event_id="01-0002-00002")
    first = replayed(one)
    replayed(other)
    again = replayed(one)
    assert np.array_equal(first.x, again.x)
    assert np.array_equal(first.a, again.a)
    assert not np.array_equal(first.v, replayed(one, seed=2).v)


@needs_sumo
def test_followers_begin_as_recorded_and_move_by_their_accelerations():
    problem = posed()
    played, dt = replayed(problem), problem.scene.dt
    assert played.x[:, 0] == pytest.approx(problem.scene.followers.x, abs=1e-5)
    assert played.v[:, 0] == pytest.approx(problem.scene.followers.v, abs=1e-5)
    assert np.diff(played.v, axis=1) == pytest.approx(played.a[:, :-1] * dt, abs=1e-9)
    assert np.diff(played.x, axis=1) == pytest.approx(played.v[:, 1:] * dt, abs=1e-6)


@needs_sumo
@pytest.mark.parametrize("seed", range(6))
def test_nobody_minds_the_av_before_it_is_in_the_lane(seed):
    problem = posed(seed)
    plan, unchanged = constant(problem), reference_plans(problem, names.NO_LANE_CHANGE)[0]
    changed, stayed = replayed(problem, plan), replayed(problem, unchanged)
    k = plan.replay.av.crossing
    assert np.array_equal(changed.v[:, : k + 1], stayed.v[:, : k + 1])


@needs_sumo
def test_who_is_cut_in_on_brakes_soon_after_the_crossing():
    scene = posed(3, target_leader=None).scene
    behind, v = np.array([-30.0, -70.0, -110.0]), np.full(3, scene.v0 + 1.0)
    problem = pose(replace(scene, followers=replace(scene.followers, x=behind, v=v)), SETTINGS)
    plan, unchanged = constant(problem), reference_plans(problem, names.NO_LANE_CHANGE)[0]
    soon = slice(plan.replay.av.crossing, plan.replay.av.crossing + 15)
    assert replayed(problem, plan).a[0, soon].min() < -2.0
    assert replayed(problem, unchanged).a[0, soon].min() > 0.0


@needs_sumo
def test_what_sumo_refuses_is_told_and_leaves_the_next_replay_alone():
    problem = posed(3)
    good = replayed(problem)
    samples = problem.scene.samples
    still, gone = np.zeros(samples), 5900.0 + 20.0 * np.arange(samples)  # beyond the end of SUMO's road
    moved = [sumo_replay.Moved(still, still, still, 4.6, 1.9), sumo_replay.Moved(gone, still, still, 4.6, 1.9)]
    driven = sumo_replay.Driven(np.array([-30.0]), np.array([20.0]), np.array([4.6]), np.array([1.9]))
    about = {"lateral_shift": 3.5, "dt": 0.1, "model": "EIDM", "seed": 1}
    with pytest.raises(InputError, match=r"^SUMO: .*m1"):
        sumo_replay.drive(moved, driven, **about)
    assert np.array_equal(replayed(problem).x, good.x)
    outside = replace(driven, front=np.array([-9000.0]))
    with pytest.raises(InputError, match=r"^SUMO: "):
        sumo_replay.drive(moved[:1], outside, **about)
    assert np.array_equal(replayed(problem).x, good.x)


@needs_sumo
def test_left_and_right_are_the_same_to_sumo():
    problem = posed(5)
    other = pose(mirrored(problem.scene), SETTINGS)
    assert np.array_equal(replayed(problem).v, replayed(other).v)


@needs_sumo
def test_an_av_that_enters_beside_a_follower_is_a_contact():
    problem = posed(3, target_leader=None)
    beside = replace(problem.scene.followers, x=np.array([-1.0, -60.0, -110.0]), v=np.full(3, problem.scene.v0))
    problem = pose(replace(problem.scene, followers=beside), SETTINGS)
    plan = constant(problem)
    assert contact_of(problem, plan.policy, replayed(problem, plan), names.EQUAL).endswith(names.EGO)


@needs_sumo
def test_krauss_drives_otherwise_and_without_noise():
    problem = posed(3)
    settings = ValidateSettings.model_validate({"sumo": {"model": "Krauss"}})
    krauss = replayed(pose(problem.scene, settings))
    eidm = replayed(problem)
    assert not np.array_equal(krauss.v, eidm.v)
    comfort = cumulative_losses(krauss, problem.terms, problem.scene.dt).hv.upto(-1).comfort
    assert (comfort < 40.0).all()  # of white noise alone it would be above 60


def test_a_leader_stands_on_the_target_lane_while_it_leads():
    problem = posed(3)
    ahead = leaders(problem)
    assert len(ahead) == len(problem.packed.leader_a)
    assert set(ahead[-1].y) == {problem.scene.lateral_shift}
    assert ahead[-1].front == pytest.approx(problem.packed.target_front)


def test_who_has_no_sumo_is_told_before_anything_is_done(tmp_path, monkeypatch):
    monkeypatch.setattr(sumo_replay, "find_spec", lambda name: None)
    settings = Settings.model_validate({"validate": {"sumo": {"events": 1}}})
    options = Options(running.FIXTURES, tmp_path / "work", tmp_path / "reports", workers=1)
    with pytest.raises(MissingExtraError, match=r"validate.sumo.events: .*install highd-lc\[sumo\]"):
        engine.run(settings, options, last="validate", console=Console(quiet=True))
    assert not (tmp_path / "work").exists()


def test_means_leave_out_what_anybody_drives_through():
    about = {"recording_id": 1, "policy": "benchmark", "follower": 1, "lowest_speed_mps": 20.0, "peak_decel": 1.0}
    rows = [
        {"event_id": event, "driven_by": who, "contact": met, "loss": loss, "speed_drop_mps": 2.0, **about}
        for event, who, met, loss in (
            ("a", "sumo", "x", 9.0), ("a", "own_fit", "", 8.0), ("b", "sumo", "", 5.0), ("b", "own_fit", "", 4.0),
        )
    ]  # fmt: skip
    found = sumo_summary(pd.DataFrame(rows)).set_index("driven_by")
    assert found["n_events"].tolist() == [2, 2]
    assert found.loc[["sumo", "own_fit"], "contacts"].tolist() == [1, 0]
    assert found.loc[["sumo", "own_fit"], "loss"].tolist() == [5.0, 4.0]


@pytest.fixture(scope="module")
def work(tmp_path_factory):
    settings = settings_file.load(QUICK).model_dump(by_alias=True)
    settings["validate"]["sumo"]["events"] = 2
    return running.validated(tmp_path_factory.mktemp("work"), (1,), Settings.model_validate(settings))


@needs_sumo
def test_chosen_events_are_scored_with_sumo_beside_the_models(work):
    cross = artefacts.read(work, "cross_losses")
    rows = cross[cross["scored_with"] == names.SUMO]
    assert rows["event_id"].nunique() == 2
    assert {"benchmark", "local_optimum"} <= set(rows["policy"])
    assert not rows["policy"].str.endswith("_start").any()
    assert set(rows["planned_with"]) == {"population"}
    key = ["event_id", "policy", "accounting", "planned_with"]
    own = cross[cross["planned_with"] == cross["scored_with"]].set_index(key)
    both = rows.set_index(key).join(own.add_suffix("_own")).dropna(subset="av_to_H")
    assert len(both)
    assert both["av_to_H"].to_numpy() == pytest.approx(both["av_to_H_own"].to_numpy())  # leaders are the same
    assert (both["hv_to_H"] != both["hv_to_H_own"]).all()
    scores = artefacts.read(work, "cross_scores")
    scores = scores[scores["scored_with"] == names.SUMO]
    assert set(scores["n_events"]) <= {1, 2}
    assert scores["peak_local"].notna().any()


@needs_sumo
def test_the_charges_are_those_of_the_followers_table(work):
    found = artefacts.read(work, "sumo_followers")
    assert set(found["driven_by"]) == {names.SUMO, "population"}
    unchanged = found[found["policy"] == names.NO_LANE_CHANGE]
    assert (unchanged["speed_drop_mps"] == 0.0).all()
    losses = artefacts.read(work, "losses")
    losses = losses[(losses["accounting"] == "equal") & (losses["followers"] == "population")]
    each = losses.set_index(["event_id", "policy"])["loss_hv_each"]
    planned = found[(found["driven_by"] == "population") & found["contact"].eq("")]
    assert len(planned)
    for row in planned.itertuples():
        assert row.loss == pytest.approx(each[row.event_id, row.policy][row.follower - 1])
    assert list(artefacts.read(work, "sumo_summary").columns) == list(TABLES["sumo_summary"].column_names)


@needs_sumo
def test_the_page_of_a_run_shows_sumo_s_followers_beside_the_model_s(work):
    overview = Overview(work, raw=False, statistics=SETTINGS.statistics, b_max=9.0, model="population")
    (shown,) = overview.read("sumo_summary").values()
    (section,) = sumo_sections(shown)
    assert set(shown["driven_by"]) == {names.SUMO, "population"}
    assert {row[2] for row in section.tables[0].rows} == {"SUMO", "population"}
