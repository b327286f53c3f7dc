"""Holes and jumps through ingest and extraction: what they leave of an event, and that nothing crosses them."""

import numpy as np
import pandas as pd
import pytest
import running

from highd_lc.vocab import names
from highd_lc.vocab.errors import InputError


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    return running.extracted(running.FIXTURES, tmp_path_factory.mktemp("clean"))


@pytest.fixture(scope="module")
def event(clean):
    """An event with everybody around it, all in view for a while."""
    events, rows = clean["events"], clean["event_tracks"]
    seen = rows[rows["t"] > 5.0].groupby("event_id")["role"].nunique()
    full = events[events["target_leader_id"].notna() & events["origin_leader_id"].notna()]
    full = full[full["origin_leader_id"] != full["target_leader_id"]]
    return full.loc[full["event_id"].map(seen).fillna(0).idxmax()]


def torn(tmp_path, vehicle, first, last, *, move=(0.0, 0.0)):
    """The tables of the fixture without the frames first .. last of a vehicle, which is moved from there on."""
    tracks = pd.read_csv(running.FIXTURES / "01_tracks.csv")
    own = tracks["id"] == vehicle
    later = own & (tracks["frame"] >= first)
    tracks.loc[later, "x"] += move[0]
    tracks.loc[later, "y"] += move[1]
    tracks = tracks[~(own & tracks["frame"].between(first, last))]
    return running.extracted(with_tracks(tmp_path, tracks), tmp_path / "work")


def with_tracks(tmp_path, tracks):
    """A folder with the fixture's metas and other tracks."""
    data = tmp_path / "data"
    data.mkdir()
    tracks.to_csv(data / "01_tracks.csv", index=False)
    for kind in ("tracksMeta", "recordingMeta"):
        (data / f"01_{kind}.csv").write_text((running.FIXTURES / f"01_{kind}.csv").read_text())
    return data


def rows_of(tables, event_id, role):
    rows = tables["event_tracks"]
    return rows[(rows["event_id"] == event_id) & (rows["role"] == role)]


@pytest.mark.parametrize("role", ["target_leader", "target_follower_1", "origin_leader"])
@pytest.mark.parametrize("hole", [(1.0, 1.0), (1.0, 1.4), (3.0, 3.8)])
def test_a_role_is_recorded_until_the_hole(clean, event, tmp_path, role, hole):
    vehicle = event["follower_ids"][0] if role == "target_follower_1" else event[f"{role}_id"]
    first, last = (round(event["start_frame"] + t * event["frame_rate"]) for t in hole)
    tables = torn(tmp_path, vehicle, first, last)
    rows = rows_of(tables, event["event_id"], role)
    whole = rows_of(clean, event["event_id"], role)
    expected = whole[whole["t"] * event["frame_rate"] < first - event["start_frame"] - 1e-6]
    pd.testing.assert_frame_equal(rows.reset_index(drop=True), expected.reset_index(drop=True))
    vehicles = tables["vehicles"].set_index("vehicle_id")
    (part,) = vehicles.index[(vehicles["recorded_id"] == vehicle) & (vehicles.index != vehicle)]
    assert vehicles.loc[part, "first_frame"] == last + 1


@pytest.mark.parametrize("move", [(-60.0, 0.0), (25.0, 0.0), (0.0, 3.5)])
def test_a_jump_ends_a_role_like_a_hole(clean, event, tmp_path, move):
    frame = round(event["start_frame"] + 2.0 * event["frame_rate"])
    tables = torn(tmp_path, event["target_leader_id"], frame, frame - 1, move=move)
    rows = rows_of(tables, event["event_id"], names.TARGET_LEADER)
    assert rows["t"].max() == pytest.approx(2.0 - 1 / event["frame_rate"])
    assert tables["recordings"][["n_jumps", "n_holes"]].sum().tolist() == [1, 0]
    assert len(tables["vehicles"]) == len(clean["vehicles"]) + 1


@pytest.mark.parametrize("missing", [(-3, -1), (-1, -1), (-12, -6)])
def test_frames_missing_before_the_start_leave_no_event_of_an_uncertain_start(clean, event, tmp_path, missing):
    first, last = (int(event["start_frame"]) + k for k in missing)
    tables = torn(tmp_path, event["ego_id"], first, last)
    vehicles = tables["vehicles"]
    (part,) = vehicles.loc[
        (vehicles["recorded_id"] == event["ego_id"]) & (vehicles["first_frame"] > first), "vehicle_id"
    ]
    crossings = tables["crossings"].set_index(["ego_id", "crossing_frame"])
    crossing = crossings.loc[(part, event["crossing_frame"])]
    if crossing["usable"]:  # the lane was kept after the hole already
        rows = rows_of(tables, crossing["event_id"], names.EGO)
        assert rows["t"].min() * event["frame_rate"] >= last + 1 - crossing["start_frame"] - 1e-6
        assert crossing["start_frame"] > last
    else:
        assert crossing["reason"] == names.CUT_BEFORE_START
    assert (tables["crossings"]["crossing_frame"] == event["crossing_frame"]).sum() == 1


@pytest.mark.parametrize("after", [1, 10, 30])
def test_frames_missing_after_the_end_change_no_event(clean, event, tmp_path, after):
    first = int(event["end_frame"]) + after
    tables = torn(tmp_path, event["ego_id"], first, first + 2)
    found = tables["events"].set_index("event_id")
    if event["event_id"] in found.index:
        same = found.loc[event["event_id"]]
        # Near the end of a track the smoothing has one side only.
        assert abs(same["end_frame"] - event["end_frame"]) <= 2
        assert same["lateral_shift_m"] == pytest.approx(event["lateral_shift_m"], abs=0.03)
        rows = rows_of(tables, event["event_id"], names.EGO)
        assert rows["t"].max() * event["frame_rate"] < first - event["start_frame"]
    else:
        crossing = tables["crossings"].set_index("event_id").loc[event["event_id"]]
        assert crossing["reason"] == names.CUT_AFTER_END


@pytest.mark.parametrize("kept", [2, 3, 5])
def test_a_recording_in_shreds_is_refused(tmp_path, kept):
    """Every second, third, fifth frame alone, numbered as before."""
    tracks = pd.read_csv(running.FIXTURES / "01_tracks.csv")
    data = with_tracks(tmp_path, tracks[tracks["frame"] % kept == 0])
    metas = pd.read_csv(data / "01_tracksMeta.csv")
    metas[metas["id"].isin(tracks.loc[tracks["frame"] % kept == 0, "id"])].to_csv(
        data / "01_tracksMeta.csv", index=False
    )
    with pytest.raises(InputError, match=r"01_tracks\.csv: column 'frame': \d+ of \d+ vehicles miss frames"):
        running.ingested(data, tmp_path / "work")
    assert not (tmp_path / "work").exists()


def test_rows_of_every_role_are_consecutive_frames(tmp_path):
    """A tracker that loses one row in two hundred, of anybody at any time."""
    tracks = pd.read_csv(running.FIXTURES / "01_tracks.csv")
    lost = np.random.default_rng(1).random(len(tracks)) < 0.005
    data = with_tracks(tmp_path, tracks[~lost])
    report = running.ingested(data, tmp_path / "work")
    (told,) = [p for p in report.problems if "tracks are split" in p.message]
    assert not told.warning  # of so many vehicles it is no tracker's usual loss
    tables = running.extracted(data, tmp_path / "work")
    for (event_id, _), rows in tables["event_tracks"].groupby(["event_id", "role"]):
        rate = tables["events"].set_index("event_id").loc[event_id, "frame_rate"]
        np.testing.assert_allclose(np.diff(rows["t"]), 1 / rate, rtol=1e-9)
    assert not (tables["crossings"]["reason"] == names.TRACK_HOLE).any()
