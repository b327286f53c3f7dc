from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import running
from quintic_recording import Driver, Scene, random_scene, write

from highd_lc.io import artefacts
from highd_lc.io.synthetic import write_recording
from highd_lc.stages import cross_checks, ingest
from highd_lc.vocab.cross_checks import CROSS_CHECKS
from highd_lc.vocab.errors import InputError
from highd_lc.vocab.job import Job, Provenance
from highd_lc.vocab.sections import RecorderSettings
from highd_lc.vocab.settings import Settings

FIXTURES = Path(__file__).parents[1] / "fixtures"


def small_scene(**options):
    drivers = [
        Driver(4.5, 1.9, False, direction, 1, 30.0 - 60.0 * place, 30.0)
        for direction in (1, 2)
        for place in range(3)
    ]
    return Scene(drivers, rate=10.0, seconds=18.0, **options)


@pytest.fixture
def data(tmp_path):
    write(small_scene(), tmp_path / "data")
    return tmp_path / "data"


def edit(data, kind, **columns):
    path = data / f"01_{kind}.csv"
    frame = pd.read_csv(path)
    for name, change in columns.items():
        frame[name] = change(frame[name])
    frame.to_csv(path, index=False)


def test_recording_of_another_maker_passes_every_cross_check(tmp_path):
    write(random_scene(np.random.default_rng(1), rate=10.0, seconds=25.0, lanes=(4, 3)), tmp_path / "data")
    report = running.ingested(tmp_path / "data", tmp_path / "work")
    assert report.problems == ()
    quality = artefacts.read_part(tmp_path / "work", "ingest", "recordings", 1)
    shares = quality[[f"share_{name}" for name in CROSS_CHECKS]]
    assert (shares.drop(columns="share_acceleration") == 1.0).all(axis=None)
    assert shares["share_acceleration"].isna().all()  # everybody drives at constant speed
    assert (quality["share_lane_mismatch"] < 0.001).all()
    assert quality["markings"].map(len).tolist() == [5, 4]


@pytest.mark.parametrize("recording", [1, 2])
def test_fixtures_pass_every_cross_check(tmp_path, recording):
    assert ingest.run(running.job(FIXTURES, tmp_path, recording)).problems == ()


@pytest.mark.parametrize(
    ("seconds", "settings"),
    [
        (30.0, {"detection_noise_m": 0.05}),
        (30.0, {"acceleration_bias_mps2": 0.3, "detection_noise_m": 0.05}),
        (30.0, {"upper_lanes": 2, "lower_lanes": 2, "truck_share": 0.3, "return_share": 0.9}),
        (30.0, {"upper_lanes": 4, "lower_lanes": 3, "frame_rate": 10.0, "flow_veh_per_h": 2200.0}),
        (30.0, {"frame_rate": 5.0}),
        (5.0, {"detection_noise_m": 0.05, "acceleration_bias_mps2": 0.3, "flow_veh_per_h": 200.0}),
    ],
    ids=["noise", "bias", "returns", "dense", "slow", "short"],
)
def test_what_trackers_leave_is_no_error(tmp_path, seconds, settings):
    write_recording(tmp_path / "data", 1, seconds, 5, settings=RecorderSettings(**settings))
    assert [p for p in running.ingested(tmp_path / "data", tmp_path / "work").problems if not p.warning] == []


def test_vehicles_are_those_of_the_metas(data, tmp_path):
    running.ingested(data, tmp_path)
    vehicles = artefacts.read_part(tmp_path, "ingest", "vehicles", 1)
    metas = pd.read_csv(data / "01_tracksMeta.csv")
    assert vehicles["vehicle_id"].tolist() == metas["id"].tolist()
    assert vehicles["driving_direction"].tolist() == metas["drivingDirection"].tolist()
    assert vehicles["length"].tolist() == metas["width"].tolist()
    assert vehicles["first_frame"].tolist() == metas["initialFrame"].tolist()
    assert vehicles["last_frame"].tolist() == metas["finalFrame"].tolist()


@pytest.mark.parametrize(
    ("column", "change", "word"),
    [
        ("minDHW", lambda v: v + 0.2, "min_gap"),
        ("minTHW", lambda v: v + 0.2, "min_time_gap"),
        ("traveledDistance", lambda v: v * 2, "travelled"),
    ],
)
def test_metas_that_nothing_else_reads_are_told_if_they_say_otherwise(data, tmp_path, column, change, word):
    edit(data, "tracksMeta", **{column: change})
    report = running.ingested(data, tmp_path)
    assert report.problems
    assert all(f"column '{column}'" in problem.message for problem in report.problems)
    assert all(problem.warning for problem in report.problems)
    quality = artefacts.read_part(tmp_path, "ingest", "recordings", 1)
    assert (quality[f"share_{word}"] < 1).all()
    assert quality["failed_checks"].map(len).sum() == len(report.problems)


@pytest.mark.parametrize("column", ["numLaneChanges", "numFrames", "initialFrame", "finalFrame"])
def test_metas_of_other_tracks_are_refused(data, tmp_path, column):
    edit(data, "tracksMeta", **{column: lambda v: v + 1})
    with pytest.raises(InputError, match=rf"01_tracksMeta\.csv: columns? '.*{column}.*': 3 of 3 vehicles"):
        running.ingested(data, tmp_path / "work")
    assert not (tmp_path / "work").exists()


@pytest.mark.parametrize(("column", "word"), [("traveledDistance", "travelled"), ("minDHW", "min_gap")])
def test_without_its_column_a_check_is_unavailable_and_nothing_fails(data, tmp_path, column, word):
    path = data / "01_tracksMeta.csv"
    pd.read_csv(path).drop(columns=column).to_csv(path, index=False)
    report = running.ingested(data, tmp_path)
    assert not report.problems
    assert artefacts.read_part(tmp_path, "ingest", "recordings", 1)[f"share_{word}"].isna().all()


def test_markings_may_end_with_a_semicolon(data, tmp_path):
    edit(data, "recordingMeta", upperLaneMarkings=lambda v: v + ";", lowerLaneMarkings=lambda v: v + "; ")
    assert not running.ingested(data, tmp_path).problems


def swapped(frame, one, other):
    return frame.rename(columns={one: other, other: one})


@pytest.mark.parametrize(
    ("kind", "change", "text"),
    [
        ("tracks", lambda frame: swapped(frame, "xVelocity", "xAcceleration"), "column 'xVelocity'"),
        ("tracks", lambda frame: swapped(frame, "y", "x"), "column 'laneId'"),
        ("recordingMeta", lambda frame: frame.assign(frameRate=5), "frameRate 10 instead of 5"),
    ],
    ids=["speeds", "positions", "frame-rate"],
)
def test_columns_that_contradict_each_other_are_refused(data, tmp_path, kind, change, text):
    path = data / f"01_{kind}.csv"
    change(pd.read_csv(path)).to_csv(path, index=False)
    with pytest.raises(InputError, match=text):
        running.ingested(data, tmp_path)


def test_a_torn_file_is_loud(data, tmp_path):
    path = data / "01_tracks.csv"
    pd.read_csv(path).iloc[:-1].to_csv(path, index=False)
    (problem,) = (p for p in running.ingested(data, tmp_path).problems if not p.warning)
    assert "column 'numFrames': 1 of 3 vehicles of direction 2" in problem.message


def test_bias_is_measured_per_carriageway_and_removed_on_demand(data, tmp_path):
    """Both carriageways' image acceleration is +0.2: backward on the upper one, forward on the lower one."""
    edit(data, "tracks", xAcceleration=lambda v: v + 0.2)
    for remove, expected in ((False, [-0.2, 0.2]), (True, [0.0, 0.0])):
        work = tmp_path / str(remove)
        running.ingested(data, work, ingest={"remove_bias": remove})
        quality = artefacts.read_part(work, "ingest", "recordings", 1)
        assert quality["mean_acceleration"].tolist() == pytest.approx([-0.2, 0.2])
        assert quality["mean_speed_change"].tolist() == pytest.approx([0.0, 0.0], abs=1e-9)
        assert quality["bias_removed"].tolist() == [remove] * 2
        tracks = artefacts.read_tracks(work, 1).merge(artefacts.read_part(work, "ingest", "vehicles", 1))
        found = tracks.groupby("driving_direction")["ax"].mean()
        assert found.tolist() == pytest.approx(expected, abs=1e-6)


def test_disagreement_near_the_ends_is_found(data, tmp_path):
    tracks = pd.read_csv(data / "01_tracks.csv")
    near = (tracks["x"] < 40) | (tracks["x"] > 380)
    tracks.loc[near, "xVelocity"] *= 1.02
    tracks.to_csv(data / "01_tracks.csv", index=False)
    running.ingested(data, tmp_path)
    quality = artefacts.read_part(tmp_path, "ingest", "recordings", 1)
    assert (quality["disagreement_entry"] > 0.5).all()
    assert (quality["disagreement_exit"] > 0.5).all()
    assert (quality["disagreement_inner"] < 0.2).all()


def test_holes_duplicates_and_rows_outside_are_counted(data, tmp_path):
    tracks = pd.read_csv(data / "01_tracks.csv")
    lower = tracks.index[tracks["id"] == 4]
    tracks.loc[lower[10], "laneId"] = 9 + 1
    tracks = pd.concat([tracks.drop(index=lower[20:22]), tracks.loc[lower[30:31]]])
    tracks.to_csv(data / "01_tracks.csv", index=False)
    report = running.ingested(data, tmp_path)
    quality = artefacts.read_part(tmp_path, "ingest", "recordings", 1)
    assert quality["n_holes"].tolist() == [0, 1]
    assert quality["n_duplicates"].tolist() == [0, 1]
    assert quality["share_outside"].iloc[1] == pytest.approx(1 / quality["n_rows"].iloc[1])
    (told,) = [p for p in report.problems if "vehicle 4" in p.message]
    assert told.warning
    assert "vehicle 4 misses 2 frames before frame 23 (vehicle 7 from there on)" in told.message


@pytest.mark.parametrize("kind", ["tracks", "tracksMeta", "recordingMeta"])
def test_bad_recording_leaves_nothing_behind(data, tmp_path, kind):
    path = data / f"01_{kind}.csv"
    *lines, last = path.read_text().splitlines()
    first, second, *others = last.split(",")
    path.write_text("\n".join([*lines, ",".join([first, f"x{second}", *others])]) + "\n")
    with pytest.raises(InputError, match=rf"01_{kind}\.csv: row {len(lines) + 1}, column"):
        running.ingested(data, tmp_path / "work")
    assert not (tmp_path / "work").exists()


def test_other_frame_rates_change_time_only(tmp_path):
    for rate in (5.0, 25.0):
        write(Scene(small_scene().drivers, rate=rate, seconds=18.0), tmp_path / f"{rate}")
        running.ingested(tmp_path / f"{rate}", tmp_path / f"work{rate}")
        tracks = artefacts.read_tracks(tmp_path / f"work{rate}", 1)
        one = tracks[tracks["vehicle_id"] == 1]
        assert np.diff(one["t"]) == pytest.approx(1 / rate)
        assert one["vx"].to_numpy() == pytest.approx(np.diff(one["x"]).mean() * rate, rel=1e-3)


def test_every_row_of_the_table_of_checks_is_measured(data, tmp_path):
    """And neither a row without a measure nor a measure without a row goes unnoticed."""
    running.ingested(data, tmp_path)
    quality = artefacts.read_part(tmp_path, "ingest", "recordings", 1)
    assert set(CROSS_CHECKS) == {c.removeprefix("share_") for c in quality if c.startswith("share_")} - {
        "outside",
        "lane_mismatch",
    }
    assert all(check.name == name and check.words and check.column for name, check in CROSS_CHECKS.items())
    job = Job(1, data, data, Settings(), Provenance("", {}, 1, ""))
    assert {check.file for check in CROSS_CHECKS.values()} == set(cross_checks.files_by_kind(job))
