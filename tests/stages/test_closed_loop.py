"""The closed loop's tables: every sampled event and policy has its rows, and they fit together."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from made_drives import OPEN, case_of, drive, scene_of

from highd_lc.driving.recorded import recorded_drive
from highd_lc.io import artefacts
from highd_lc.planning.planner import pose
from highd_lc.stages.closed_loop import DRIVES, MOTIONS, REPLANS, drive_row, human_row, loop_plays, replan_row
from highd_lc.vocab import names
from highd_lc.vocab.settings import ValidateSettings
from highd_lc.vocab.tables import TABLES


@pytest.fixture(scope="module")
def run(pipeline_run):
    tables = {name: artefacts.read(pipeline_run.work, name) for name in (DRIVES, REPLANS, MOTIONS)}
    return SimpleNamespace(work=pipeline_run.work, reports=pipeline_run.reports, **tables)


def test_every_sampled_event_has_a_row_of_every_policy_and_of_the_human(run):
    policies = {*names.REPLANNED_POLICIES, names.HUMAN}
    assert run.closed_loop.groupby("event_id")["policy"].agg(set).tolist() == [policies] * 2
    assert set(run.closed_loop.loc[run.closed_loop["policy"] != names.HUMAN, "seen_s"]) == {15.0}
    for column in ("contact_cause", "contact_reason"):
        assert (run.closed_loop["contacts"] == run.closed_loop[column].map(len)).all()
    assert set(run.closed_loop["contact_reason"].explode().dropna()) <= set(names.LOOP_CAUSES)


def test_decisions_are_those_that_the_drives_count(run):
    key = ["event_id", "policy"]
    drives = run.closed_loop[run.closed_loop["policy"] != names.HUMAN].set_index(key)
    counts = run.closed_loop_replans.groupby(key)["verdict"].value_counts().unstack(fill_value=0)
    for column, verdict in (
        ("new_plans", names.REPLANNED),
        ("freed", names.FREED),
        ("relaxed", names.RELAXED),
        ("pressed", names.LATEST),
        ("held", names.HELD),
    ):
        found = counts[verdict] if verdict in counts else 0 * counts.iloc[:, 0]
        assert (found.reindex(drives.index) == drives[column]).all(), column
    assert (counts.sum(axis=1).reindex(drives.index) == drives["replans"]).all()
    turned = counts[names.TURNED_BACK] if names.TURNED_BACK in counts else 0 * counts.iloc[:, 0]
    assert ((turned.reindex(drives.index) > 0) == drives["aborted"]).all()


def test_times_stand_in_the_log_and_in_no_table(run):
    rows = [json.loads(line) for line in (run.work / "run.log").read_text().splitlines()]
    timed = {(row["event_id"], row["policy"]): row for row in rows if "solve_ms_p99" in row}
    drives = run.closed_loop[run.closed_loop["policy"] != names.HUMAN]
    assert set(timed) == set(zip(drives["event_id"], drives["policy"], strict=True))
    assert all(0.0 < row["solve_ms_median"] <= row["solve_ms_p99"] for row in timed.values())
    assert not any("ms" in column.name.split("_") for name in (DRIVES, REPLANS) for column in TABLES[name].columns)


def test_the_page_tells_contacts_and_regret_and_the_index_leads_there(run):
    page = (run.reports / "closed_loop.html").read_text()
    assert "Local optimum, replanned" in page
    assert "Regret" in page
    assert 'href="closed_loop.html"' in (run.reports / "index.html").read_text()


def test_the_events_page_plays_the_drives_with_their_plans(run):
    event = run.closed_loop["event_id"].iloc[0]
    page = (run.reports / "events" / f"{event}.html").read_text()
    text = page.split('id="data">', 1)[1].split("</script>", 1)[0]
    plays = {play["policy"]: play for play in json.loads(text)["plays"]}
    own = run.closed_loop_replans[run.closed_loop_replans["event_id"] == event]
    for policy in names.REPLANNED_POLICIES:
        planned = own[(own["policy"] == policy) & own["T"].notna()]
        assert [plan[0] for plan in plays[policy].get("plans", [])] == planned["t"].tolist()


@pytest.mark.parametrize("seed", OPEN[:3])
def test_plans_of_the_tables_begin_where_the_av_is(seed):
    case = case_of(scene_of(seed))
    loop = drive(case)
    rows = [replan_row(decision, 0.1) for decision in loop.replans]
    for row in rows:
        k = round(row["t"] / 0.1)
        assert row["x"] == pytest.approx(loop.replay.av.x[k], abs=1e-9)
        assert row["y"] == pytest.approx(loop.replay.av.y[k], abs=1e-9)
        assert row["v"] == pytest.approx(loop.replay.av.vx[k], abs=1e-9)
    drives = [{"policy": "p", "delay_s": 0.0, "T": 4.0}]
    motions = [{"policy": "p", "role": names.EGO, **{name: [0.0, 1.0] for name in "xyva"}, "jerk": [0.0, 0.0]}]
    (play,) = loop_plays(drives, [{"policy": "p", **row} for row in rows], motions)
    assert play.T == 4.0
    t, x, y = play.plans[-1]
    assert (t, x[0], y[0]) == pytest.approx((rows[-1]["t"], rows[-1]["x"], rows[-1]["y"]))
    assert y[-1] == pytest.approx(case.problem.scene.lateral_shift)


def test_a_contact_leaves_neither_losses_nor_regret():
    case = case_of(scene_of(0))
    loop = drive(case)
    touched = replace(loop, met=("target_follower_1_through_ego",))
    row = drive_row(case.problem, touched, loop)
    assert row["contacts"] == 1
    assert np.isnan([row["loss_av"], row["loss_hv"], row["regret"]]).all()
    clean = drive_row(case.problem, loop, loop)
    assert clean["regret"] == 0.0
    assert clean["loss_av"] + clean["loss_hv"] == pytest.approx(clean["loss_foresight"])


def test_the_human_is_judged_by_what_was_recorded():
    scene = replace(scene_of(1), origin_follower=None)
    problem = pose(scene, ValidateSettings())
    replay, last = recorded_drive(problem)
    assert last == min(m.observed - 1 for m in scene.followers.recorded) or last == len(scene.human.x) - 1
    np.testing.assert_array_equal(replay.x[0], scene.followers.recorded[0].x)
    assert human_row(problem)["seen_s"] == pytest.approx(0.1 * last)
    assert human_row(problem)["contact_cause"] == []


def recorded_beside_the_human(*, ahead, across):
    """What is said of a human whose first follower was recorded so far from his own box [m]."""
    scene = replace(scene_of(1), origin_follower=None)
    first, human = scene.followers.recorded[0], scene.human
    x, y = first.x.copy(), first.y.copy()
    n = min(len(human.x), len(x))
    x[:n], y[:n] = human.x[:n] + ahead, human.y[:n] + across
    inside = replace(scene.followers, recorded=(replace(first, x=x, y=y), *scene.followers.recorded[1:]))
    return human_row(pose(replace(scene, followers=inside), ValidateSettings()))


def test_a_recorded_contact_is_one_of_boxes_where_they_were_across():
    into = names.through(names.target_follower(1), names.EGO)
    assert into in recorded_beside_the_human(ahead=-2.0, across=0.5)["contact_cause"]
    inside = recorded_beside_the_human(ahead=0.0, across=0.0)
    assert inside["contact_cause"] == [into, f"clearance_{names.target_follower(1)}"]
    assert inside["contact_reason"] == [names.BY_RECORDING] * 2
    # Who passes on another lane drives through nobody, and touches nobody's ellipse.
    away = -4.5 * np.sign(scene_of(1).lateral_shift)
    for ahead in (-2.0, 0.0, 40.0):
        assert recorded_beside_the_human(ahead=ahead, across=away)["contact_cause"] == []
