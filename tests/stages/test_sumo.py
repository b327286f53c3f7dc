"""Recordings of SUMO's traffic, made by SUMO itself where it is installed."""

import importlib.util

import numpy as np
import pandas as pd
import pytest
import running

from highd_lc.io import sumo
from highd_lc.io.synthetic import DIRECTIONS
from highd_lc.vocab.errors import MissingExtraError
from highd_lc.vocab.sections import RecorderSettings

INSTALLED = importlib.util.find_spec("sumo") is not None
needs_sumo = pytest.mark.skipif(not INSTALLED, reason="extra sumo is not installed")
SETTINGS = RecorderSettings(upper_lanes=2, lower_lanes=3)
QUIET = RecorderSettings(upper_lanes=2, lower_lanes=2, flow_veh_per_h=300.0)


def made(folder, seed=3, settings=SETTINGS):
    folder.mkdir()
    assert sumo.synthesize(folder, recordings=1, seconds=40.0, seed=seed, settings=settings) == [1]
    return folder


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return made(tmp_path_factory.mktemp("sumo") / "data")


@needs_sumo
def test_a_recording_is_read_without_a_contradiction(data, tmp_path):
    tables = running.extracted(data, tmp_path)
    # In the sublane model two may be abreast, both centres in one lane: the gaps of the metas know no such.
    told = {check.split(" ")[0] for checks in tables["recordings"]["failed_checks"] for check in checks}
    assert told <= {"min_gap", "min_time_gap"}
    assert set(tables["vehicles"]["driving_direction"]) == set(DIRECTIONS)
    lanes = tables["tracks"].merge(tables["vehicles"][["vehicle_id", "driving_direction"]], on="vehicle_id")
    assert lanes.groupby("driving_direction")["lane"].max().tolist() == [2, 3]
    assert tables["recordings"]["n_trucks"].sum() > 0
    assert (tables["tracks"]["vx"] > 0).all()


@needs_sumo
def test_the_truth_is_what_extraction_finds(data, tmp_path):
    found = running.extracted(data, tmp_path)["crossings"]
    truth = pd.read_csv(data / "01_truth.csv")
    assert len(truth) > 3
    both = truth.merge(
        found,
        left_on=["vehicle_id", "origin_lane", "target_lane"],
        right_on=["ego_id", "origin_lane", "target_lane"],
    )
    off = np.abs(both["crossing_frame_x"] - both["crossing_frame_y"])
    assert len(both[off <= 1]) >= len(truth) - 1  # a centre on the marking may be rounded to either side
    drivers = pd.read_csv(data / "01_truth_drivers.csv")
    assert set(drivers["model"]) == {"EIDM", "Krauss"}
    assert set(truth["vehicle_id"]) <= set(drivers["vehicle_id"])


@needs_sumo
def test_the_same_seed_gives_the_same_recording_and_another_one_another(tmp_path):
    one, again, other = (made(tmp_path / str(k), seed, QUIET) for k, seed in enumerate((3, 3, 4)))
    assert len((one / "01_tracks.csv").read_bytes().splitlines()) > 1000
    for path in sorted(one.iterdir()):
        assert (again / path.name).read_bytes() == path.read_bytes()
    assert (other / "01_tracks.csv").read_bytes() != (one / "01_tracks.csv").read_bytes()


@pytest.mark.skipif(INSTALLED, reason="SUMO is installed")
def test_without_sumo_the_extra_is_named(tmp_path):
    with pytest.raises(MissingExtraError, match=r"install highd-lc\[sumo\]"):
        sumo.synthesize(tmp_path, recordings=1, seconds=10.0, seed=1, settings=SETTINGS)
