"""The meta files agree with the printed tracks and with HighD's conventions."""

import numpy as np
import pandas as pd
import pytest

from highd_lc.io.synthetic import write_recording
from highd_lc.vocab.sections import RecorderSettings

VEHICLE_COLUMNS = (
    "id,width,height,initialFrame,finalFrame,numFrames,class,drivingDirection,traveledDistance,minXVelocity,"
    "maxXVelocity,meanXVelocity,minDHW,minTHW,minTTC,numLaneChanges"
)
RECORDING_COLUMNS = (
    "id,frameRate,locationId,speedLimit,month,weekDay,startTime,duration,totalDrivenDistance,totalDrivenTime,"
    "numVehicles,numCars,numTrucks,upperLaneMarkings,lowerLaneMarkings"
)
SECONDS = 30.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("metas")
    write_recording(out, 3, SECONDS, 8, settings=RecorderSettings(drivers="lcm", lane_change_rate=2))
    return out


@pytest.fixture(scope="module")
def tracks(folder) -> pd.DataFrame:
    return pd.read_csv(folder / "03_tracks.csv")


@pytest.fixture(scope="module")
def vehicles(folder) -> pd.DataFrame:
    return pd.read_csv(folder / "03_tracksMeta.csv").set_index("id")


def test_columns_are_highds(folder):
    for name, columns in (("tracksMeta", VEHICLE_COLUMNS), ("recordingMeta", RECORDING_COLUMNS)):
        assert (folder / f"03_{name}.csv").read_text().splitlines()[0] == columns


def test_frames_sizes_and_distance_are_those_of_the_track(tracks, vehicles):
    rows = tracks.groupby("id")
    np.testing.assert_array_equal(vehicles["initialFrame"], rows["frame"].min())
    np.testing.assert_array_equal(vehicles["finalFrame"], rows["frame"].max())
    np.testing.assert_array_equal(vehicles["numFrames"], rows.size())
    for size in ("width", "height"):
        np.testing.assert_array_equal(vehicles[size], rows[size].first())
        assert (tracks[size] == rows[size].transform("first")).all()
    np.testing.assert_allclose(
        vehicles["traveledDistance"], (rows["x"].last() - rows["x"].first()).abs(), atol=0.006
    )
    assert (vehicles["width"] > 1.5 * vehicles["height"]).all()  # HighD's width is the length
    assert vehicles.groupby("class")["width"].mean()["Truck"] > 10


def test_speeds_are_positive_in_both_directions(tracks, vehicles):
    speed = tracks["xVelocity"].abs().groupby(tracks["id"])
    np.testing.assert_allclose(vehicles["minXVelocity"], speed.min(), atol=1e-9)
    np.testing.assert_allclose(vehicles["maxXVelocity"], speed.max(), atol=1e-9)
    np.testing.assert_allclose(vehicles["meanXVelocity"], speed.mean(), atol=0.006)
    assert set(vehicles["drivingDirection"]) == {1, 2}


@pytest.mark.parametrize(("smallest", "column"), [("minDHW", "dhw"), ("minTHW", "thw"), ("minTTC", "ttc")])
def test_smallest_values_are_over_the_positive_ones_and_minus_one_without_any(tracks, vehicles, smallest, column):
    positive = tracks[tracks[column] > 0].groupby("id")[column].min()
    wanted = positive.reindex(vehicles.index).fillna(-1.0)
    np.testing.assert_allclose(vehicles[smallest], wanted, atol=1e-9)
    assert (wanted == -1).any()
    assert (wanted > 0).any()


def test_lane_changes_are_changes_of_the_lane_id(tracks, vehicles):
    changed = tracks.groupby("id")["laneId"].apply(lambda lane: (lane.diff().dropna() != 0).sum())
    np.testing.assert_array_equal(vehicles["numLaneChanges"], changed)
    assert changed.sum() >= 5


def test_the_recording_adds_up(folder, vehicles):
    meta = pd.read_csv(folder / "03_recordingMeta.csv", dtype=str).iloc[0]
    assert (meta["id"], meta["frameRate"], meta["duration"]) == ("3", "25", "30.00")
    assert meta["locationId"] in list("123456")
    assert pd.to_datetime(meta["month"], format="%m.%Y").year in (2017, 2018)
    assert meta["weekDay"] in ("Mon", "Tue", "Wed", "Thu", "Fri")
    assert pd.to_datetime(meta["startTime"], format="%H:%M") is not None
    counts = vehicles["class"].value_counts()
    assert int(meta["numVehicles"]) == len(vehicles)
    assert (int(meta["numCars"]), int(meta["numTrucks"])) == (counts["Car"], counts["Truck"])
    assert float(meta["totalDrivenDistance"]) == pytest.approx(vehicles["traveledDistance"].sum(), abs=0.02)
    assert float(meta["totalDrivenTime"]) == pytest.approx(vehicles["numFrames"].sum() / 25, abs=0.01)


def test_markings_ascend_with_lanes_as_wide_as_a_motorways(folder):
    meta = pd.read_csv(folder / "03_recordingMeta.csv").iloc[0]
    upper, lower = (
        np.array([float(y) for y in meta[name].split(";")]) for name in ("upperLaneMarkings", "lowerLaneMarkings")
    )
    assert len(upper) == len(lower) == 4
    for markings in (upper, lower):
        assert ((np.diff(markings) > 3.4) & (np.diff(markings) < 4.0)).all()
    assert lower[0] > upper[-1]
