"""Planners of others in a run: found by name, rows of their own, and one board with ours."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import running

from highd_lc.io import artefacts
from highd_lc.io import settings as settings_file
from highd_lc.reporting import labels
from highd_lc.reporting.figures_event import EventPainter, event_panels
from highd_lc.reporting.pages_event import Links, event_page
from highd_lc.stages.event_report import event_report, read_tables
from highd_lc.stages.other_planners import OtherPlanners, load, sources
from highd_lc.stages.scenes import scene_makers
from highd_lc.vocab import names
from highd_lc.vocab.errors import SettingsError
from highd_lc.vocab.job import Job, Provenance

ROOT = Path(__file__).resolve().parents[2]
PLANNERS = ("examples.fixed_quintic:fixed_quintic", "faulty_planner:sometimes")
FAULTY = """
def sometimes(scene):
    if scene.lateral_shift > 0:
        raise RuntimeError("no left turns")
    return "only to the left"

number = 5
"""


@pytest.fixture(scope="module", autouse=True)
def importable(tmp_path_factory):
    folder = tmp_path_factory.mktemp("planners")
    (folder / "faulty_planner.py").write_text(FAULTY)
    (folder / "broken_planner.py").write_text("1 / 0")
    sys.path[:0] = [str(folder), str(ROOT)]
    yield folder
    sys.path.remove(str(folder))
    sys.path.remove(str(ROOT))


@pytest.fixture(scope="module")
def work(tmp_path_factory):
    quick = settings_file.load(ROOT / "tests" / "faults" / "quick.toml")
    settings = settings_file.with_planners(quick, PLANNERS)
    return running.validated(tmp_path_factory.mktemp("work"), (1,), settings)


def test_every_event_has_a_row_of_each_planner_and_accounting(work):
    rows, events = artefacts.read(work, "other_plans"), artefacts.read(work, "events")
    assert len(rows) == 2 * 3 * len(events)
    fixed = rows[rows["policy"] == "fixed_quintic"]
    assert set(fixed["status"]) <= {"solved", "contact"}
    assert (fixed["T"] == 5.0).all()
    tracked = fixed[(fixed["accounting"] == "equal") & (fixed["status"] == "solved")]
    assert (tracked["rmse_lateral_m"] < 0.1).all()
    faulty = rows[rows["policy"] == "sometimes"].merge(events[["event_id", "direction"]], on="event_id")
    expected = {"left": ("faulty", "RuntimeError: no left turns"), "right": ("infeasible", "only to the left")}
    assert [tuple(r) for r in faulty[["status", "reason"]].to_numpy()] == [
        expected[d] for d in faulty["direction"]
    ]
    assert faulty["loss_total"].isna().all()


def test_no_quintic_costs_less_than_the_optimum_over_them(work):
    rows, losses = artefacts.read(work, "other_plans"), artefacts.read(work, "losses")
    ours = losses[(losses["policy"] == "local_optimum") & (losses["followers"] == "population")]
    both = rows[rows["policy"] == "fixed_quintic"].merge(
        ours, on=["event_id", "accounting"], suffixes=("", "_ours")
    )
    equal = both[(both["accounting"] == "equal") & both["loss_total"].notna()]
    assert len(equal) > 3
    assert (equal["loss_total"] >= equal["loss_total_ours"] - 1e-9).all()


def test_the_board_counts_faults_and_compares_on_common_events(work):
    board = artefacts.read(work, "leaderboard").set_index("policy")
    events = artefacts.read(work, "events")
    assert {"fixed_quintic", "sometimes", "benchmark", "local_optimum", "human"} <= set(board.index)
    assert board.loc["sometimes", "n_planned"] == 0
    assert board.loc["sometimes", "n_faulty"] == (events["direction"] == "left").sum()
    assert board["n_common"].eq(0).all()  # one of them plans nothing at all
    assert board["loss_total"].isna().all()
    assert list(board["ours"][["fixed_quintic", "benchmark"]]) == [False, True]


def test_without_planners_of_others_both_tables_are_empty(pipeline_run):
    assert artefacts.read(pipeline_run.work, "other_plans").empty
    assert artefacts.read(pipeline_run.work, "leaderboard").empty


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("nowhere:plan", "ModuleNotFoundError: No module named 'nowhere'"),
        ("faulty_planner:missing", "AttributeError"),
        ("faulty_planner:number", "a int, not a function"),
        ("broken_planner:plan", "ZeroDivisionError"),
        ("unknown", "give module:function, or one of the entry points of highd_lc.planners: none"),
        ("benchmark", "the name of a policy of this package"),
    ],
)
def test_what_is_no_planner_is_told_before_any_work(name, said):
    with pytest.raises(SettingsError, match=said):
        load(name)


def test_names_are_the_functions_unless_two_share_one():
    assert list(OtherPlanners.of(PLANNERS).functions) == ["fixed_quintic", "sometimes"]
    twice = ("examples.fixed_quintic:fixed_quintic", "examples.fixed_quintic:fixed_quintic")
    assert list(OtherPlanners.of(twice).functions) == [twice[0]]


def test_a_planner_s_source_is_part_of_what_a_run_depends_on(importable):
    assert sources(["faulty_planner:sometimes"]) == [importable / "faulty_planner.py"]


def test_times_go_to_the_log_and_not_into_tables(work):
    log = pd.read_json(work / "run.log", lines=True)
    log = log[log["planner"].notna()]  # drives in the closed loop have times there too
    assert set(log["planner"]) == {"fixed_quintic", "sometimes", "local_optimum"}
    assert (log["ms_median"] >= 0.0).all()
    assert np.isfinite(log["ms_largest"]).all()


# --- drawn as ours are ---


@pytest.fixture(scope="module")
def moved(work):
    rows = pd.read_parquet(work / "trajectories")
    return rows[rows["policy"] == "fixed_quintic"]


def test_motions_of_others_are_written_as_ours_are(work, moved):
    ours = pd.read_parquet(work / "trajectories")
    ours = ours[(ours["policy"] == "constant") & (ours["followers"] == "population")]
    assert set(moved["followers"]) == {"population"}
    for kind in ("simulated", "tracked"):
        one, other = (rows[rows["kind"] == kind] for rows in (moved, ours))
        roles = one.groupby("event_id")["role"].agg(set)
        assert roles.to_dict() == other.groupby("event_id")["role"].agg(set).to_dict()
    events = artefacts.read(work, "events").set_index("event_id")
    ends = moved[(moved["kind"] == "tracked")].groupby("event_id").tail(1).set_index("event_id")
    assert ends["t"].to_numpy() == pytest.approx(5.0)
    shift = events.loc[ends.index, "lateral_shift_m"].to_numpy()
    assert ends["y"].to_numpy() == pytest.approx(shift, abs=0.1)
    assert "sometimes" not in set(pd.read_parquet(work / "trajectories")["policy"])


def test_the_followers_losses_follow_from_the_written_motions(work, moved):
    rows = artefacts.read(work, "other_plans")
    rows = rows[(rows["policy"] == "fixed_quintic") & (rows["accounting"] == "equal") & rows["loss_total"].notna()]
    assert len(rows) > 3
    for row in rows.itertuples():
        of_event = moved[(moved["event_id"] == row.event_id) & (moved["kind"] == "simulated")]
        for rank, loss in enumerate(row.loss_hv_each, start=1):
            one = of_event[of_event["role"] == f"target_follower_{rank}"].astype({"vx": float, "ax": float})
            comfort = np.abs(np.diff(one["ax"])).sum() / 0.1 / 8.0
            assert 0.5 * comfort + 0.5 * np.abs(one["vx"] - 33.54).sum() / 33.54 == pytest.approx(loss, rel=1e-5)


@pytest.fixture(scope="module")
def reports(work):
    settings = settings_file.with_planners(settings_file.load(ROOT / "tests" / "faults" / "quick.toml"), PLANNERS)
    job = Job(1, running.FIXTURES, work, settings, Provenance("settings", {}, 1, "code"))
    tables = read_tables(job)
    found = []
    for event, (_, scene_of) in zip(tables.events, scene_makers(tables.scenes, settings.validation), strict=True):
        found.append(event_report(event, tables, scene_of(), settings.validation))
    return found


def test_an_event_s_page_has_the_motion_and_every_table_of_others(reports):
    assert {report.planners for report in reports} == {("fixed_quintic", "sometimes")}
    planned = [report for report in reports if report.play("fixed_quintic")]
    assert len(planned) > 3
    for report in planned:
        play, ours = report.play("fixed_quintic"), report.play("constant")
        assert play.T == 5.0
        assert len(play.followers) == len(ours.followers)
        assert play.ego.x[0] == pytest.approx(ours.ego.x[0], abs=1e-3)
        assert play.ego.v[0] == pytest.approx(report.v0, abs=0.1)
    page = event_page(planned[0], Links())
    head = '<span class="key" style="background: var(--other-'
    assert page.count(head) == 2 * 3 * 3 + 2  # losses, plans, safety of three accountings; two tables of tracking
    assert '"policy":"fixed_quintic"' in page
    assert "only to the left" in page or "no left turns" in page


def test_an_event_s_figure_draws_and_names_them(reports):
    report = next(report for report in reports if report.play("fixed_quintic"))
    panels = event_panels(report)
    plain = replace(report, plans=tuple(row for row in report.plans if row["policy"] in names.POLICIES))
    for name in ("lateral", "speed", "acceleration"):
        assert len(panels[name].curves) == len(event_panels(plain)[name].curves) + 1
    assert {"fixed_quintic", "sometimes"} <= set(panels["loss"].names)
    painter = EventPainter()
    assert painter.png(report) != painter.png(plain)
    assert painter.png(report) == EventPainter().png(report)


def test_a_planner_s_colour_goes_with_its_name_and_is_no_policy_s():
    ours = {look.light for look in labels.POLICIES.values()}
    look = labels.look("examples.commonroad_reactive:plan")
    assert look.light not in ours
    assert look == labels.look(look.label)
    assert len(labels.short_policy(look.label)) == 18
