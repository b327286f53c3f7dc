"""Exports, read back by each format's own library."""

import numpy as np
import pandas as pd
import pytest

from highd_lc.io import artefacts
from highd_lc.io.exports import COLUMNS, export, export_scene
from highd_lc.vocab.errors import ArtefactError, UsageError

POLICY = "local_optimum"


@pytest.fixture(scope="module")
def event(pipeline_run):
    plans = artefacts.read(pipeline_run.work, "plans")
    solved = plans[(plans["policy"] == POLICY) & (plans["accounting"] == "equal") & (plans["status"] == "solved")]
    return pipeline_run.work, solved["event_id"].iloc[0]


def exported(event, to, **options):
    work, event_id = event
    return export(work, [event_id], to, **options)


@pytest.fixture(scope="module")
def scene(event):
    return export_scene(*event, policy=POLICY, raw=True)


def test_a_scene_holds_everybody_and_the_plan_s_own_ego(event, scene):
    work, event_id = event
    recorded = export_scene(work, event_id, raw=True)
    assert not recorded.planned
    assert scene.planned
    assert set(recorded.rows["role"]) >= {"ego", "target_follower_1"}
    plan = artefacts.read(work, "plans").set_index(["event_id", "policy", "followers", "accounting"])
    assert pytest.approx(plan.loc[(event_id, POLICY, "population", "equal"), "T"]) == scene.T
    at_end = scene.ego[np.isclose(scene.ego["t"], scene.T)].iloc[0]
    lane = np.searchsorted(scene.markings, [0.0, at_end["y"]])
    assert abs(lane[1] - lane[0]) == 1
    others = scene.rows[scene.rows["role"].str.startswith("target_leader")]
    same = recorded.rows[recorded.rows["role"].isin(set(others["role"]))]
    assert len(others) == len(same)


def test_csv_holds_the_scene(event, scene, tmp_path):
    (path,) = exported(event, "csv", policy=POLICY, out=tmp_path, raw=True)
    found = pd.read_csv(path)
    assert list(found) == list(COLUMNS)
    np.testing.assert_allclose(found["x"], scene.rows["x"], rtol=1e-5)
    assert (found.groupby("role")["t"].diff().dropna() - 0.1).abs().max() < 1e-6


def test_highd_s_licence_is_kept_unless_asked_otherwise(event, tmp_path):
    with pytest.raises(UsageError, match="its licence allows no redistribution; give --raw"):
        exported(event, "csv", out=tmp_path)


def test_a_wrong_policy_is_told_before_the_licence(event, tmp_path):
    with pytest.raises(UsageError, match="no plan of 'nobody'"):
        exported(event, "csv", policy="nobody", out=tmp_path)


def test_nothing_is_written_if_one_of_several_events_cannot_be(event, tmp_path):
    work, event_id = event
    with pytest.raises(UsageError, match="no lane-id change"):
        export(work, [event_id, "01-0000-00000"], "csv", out=tmp_path, raw=True)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("change", "error", "said"),
    [
        ({"to": "word"}, UsageError, "--to 'word': one of csv, omega-prime, commonroad, openscenario"),
        ({"policy": "nobody"}, UsageError, "no plan of 'nobody'; there are benchmark"),
        ({"event_id": "01-0000-00000"}, UsageError, "no lane-id change"),
    ],
)
def test_what_cannot_be_exported_is_told(event, tmp_path, change, error, said):
    wanted = {"event_id": event[1], "to": "csv"} | change
    with pytest.raises(error, match=said):
        exported((event[0], wanted.pop("event_id")), wanted.pop("to"), out=tmp_path, raw=True, **wanted)


def test_a_change_that_is_no_event_and_motions_that_were_not_written_are_told(event, tmp_path):
    work = event[0]
    crossings = artefacts.read(work, "crossings")
    unusable = crossings.loc[~crossings["usable"], "event_id"].iloc[0]
    with pytest.raises(UsageError, match="not usable"):
        exported((work, unusable), "csv", out=tmp_path, raw=True)
    with pytest.raises(ArtefactError):
        exported((tmp_path, event[1]), "csv", out=tmp_path, raw=True)


def test_omega_prime_reads_its_own_schema_again(event, scene, tmp_path, recwarn):
    omega_prime = pytest.importorskip("omega_prime", reason="extra export is not installed")
    recwarn.clear()
    (path,) = exported(event, "omega-prime", policy=POLICY, out=tmp_path, raw=True)
    assert not [one for one in recwarn if issubclass(one.category, UserWarning)]
    found = omega_prime.Recording.from_file(str(path), validate=True)
    table = found.df.to_pandas()
    assert len(table) == len(scene.rows)
    ego = table[table["idx"] == list(dict.fromkeys(scene.rows["role"])).index("ego")].sort_values("total_nanos")
    np.testing.assert_allclose(ego["x"], scene.ego["x"], atol=1e-4)
    np.testing.assert_allclose(ego["vel_y"], scene.ego["vy"], atol=1e-4)


def test_commonroad_prints_nothing_of_its_own(event, tmp_path, capfd, caplog):
    pytest.importorskip("commonroad", reason="extra export is not installed")
    for _ in range(2):
        exported(event, "commonroad", policy=POLICY, out=tmp_path, raw=True)
    assert capfd.readouterr() == ("", "")
    assert caplog.text == ""


def test_commonroad_reads_scenario_problem_and_solution_again(event, scene, tmp_path):
    pytest.importorskip("commonroad", reason="extra export is not installed")
    from commonroad.common.file_reader import CommonRoadFileReader
    from commonroad.common.solution import CommonRoadSolutionReader

    path, solution = exported(event, "commonroad", policy=POLICY, out=tmp_path, raw=True)
    scenario, problems = CommonRoadFileReader(str(path)).open()
    (problem,) = problems.planning_problem_dict.values()
    assert len(scenario.lanelet_network.lanelets) == len(scene.markings) - 1
    roles = {role for role, rows in scene.rows.groupby("role") if (rows["t"] >= 0).sum()}
    assert len(scenario.dynamic_obstacles) == len(roles) - 1
    ego = scene.ego[scene.ego["t"] >= 0.0]
    np.testing.assert_allclose(problem.initial_state.position, ego[["x", "y"]].iloc[0], atol=1e-3)
    (found,) = CommonRoadSolutionReader.open(str(solution)).planning_problem_solutions
    positions = np.array([state.position for state in found.trajectory.state_list])
    np.testing.assert_allclose(positions, ego[["x", "y"]], atol=1e-3)
    assert len(problem.goal.state_list) == 1
    lane = scenario.lanelet_network.find_lanelet_by_position([problem.initial_state.position])
    assert len(lane[0]) == 1


def test_openscenario_is_parsed_again(event, scene, tmp_path):
    generation = pytest.importorskip("scenariogeneration", reason="extra export is not installed")
    path, road = exported(event, "openscenario", policy=POLICY, out=tmp_path, raw=True)
    found = generation.xosc.ParseOpenScenario(str(path))
    roles = {role for role, rows in scene.rows.groupby("role") if (rows["t"] >= 0).sum()}
    assert {entity.name for entity in found.entities.scenario_objects} == roles
    text = road.read_text()
    assert text.count('type="driving"') == len(scene.markings) - 1
    assert road.name in path.read_text()
