"""The tracks files as HighD writes them, decoded here by brute force without the package."""

import re

import numpy as np
import pandas as pd
import pytest
from made_traffic import FAULTLESS

from highd_lc.io.synthetic import write_recording
from highd_lc.vocab.sections import RecorderSettings

TRACKS = (
    "frame,id,x,y,width,height,xVelocity,yVelocity,xAcceleration,yAcceleration,frontSightDistance,"
    "backSightDistance,dhw,thw,ttc,precedingXVelocity,precedingId,followingId,leftPrecedingId,leftAlongsideId,"
    "leftFollowingId,rightPrecedingId,rightAlongsideId,rightFollowingId,laneId"
)
SECONDS = 24.0
LAYOUTS = {
    "3+3": (FAULTLESS, {2, 3, 4}, {6, 7, 8}),
    "2+2": (FAULTLESS.model_copy(update={"upper_lanes": 2, "lower_lanes": 2}), {2, 3}, {5, 6}),
    "4+3 noisy": (
        RecorderSettings(drivers="lcm", upper_lanes=4, lower_lanes=3, frame_rate=10, lane_change_rate=2),
        {2, 3, 4, 5},
        {7, 8, 9},
    ),
}


class Read:
    def __init__(self, folder, settings, upper, lower):
        self.folder, self.settings, self.lanes = folder, settings, {1: upper, 2: lower}
        self.tracks = pd.read_csv(folder / "07_tracks.csv")
        self.vehicles = pd.read_csv(folder / "07_tracksMeta.csv").set_index("id")
        meta = pd.read_csv(folder / "07_recordingMeta.csv").iloc[0]
        self.upper, self.lower = (
            np.array([float(y) for y in meta[f"{side}LaneMarkings"].split(";")]) for side in ("upper", "lower")
        )
        self.direction = self.vehicles["drivingDirection"][self.tracks["id"]].to_numpy()
        self.forward = np.where(self.direction == 2, 1, -1)
        self.centre_x = (self.tracks["x"] + self.tracks["width"] / 2).to_numpy()
        self.centre_y = (self.tracks["y"] + self.tracks["height"] / 2).to_numpy()


@pytest.fixture(scope="module", params=list(LAYOUTS))
def read(request, tmp_path_factory) -> Read:
    folder = tmp_path_factory.mktemp("highd")
    settings, upper, lower = LAYOUTS[request.param]
    write_recording(folder, 7, SECONDS, 3, settings=settings)
    return Read(folder, settings, upper, lower)


def test_columns_and_number_formats_are_highds(read):
    header, *rows = (read.folder / "07_tracks.csv").read_text().splitlines()
    assert header == TRACKS
    integer, decimal = r"\d+", r"-?\d+\.\d\d"
    pattern = re.compile(",".join([integer] * 2 + [decimal] * 14 + [integer] * 9))
    assert all(pattern.fullmatch(row) for row in rows)


def test_rows_stand_by_vehicle_and_frame_and_count_from_one(read):
    order = read.tracks[["id", "frame"]]
    assert order.equals(order.sort_values(["id", "frame"]))
    assert read.tracks["frame"].min() == 1
    assert read.tracks["frame"].max() == round(SECONDS * read.settings.frame_rate)
    frames = read.tracks.groupby("id")["frame"]
    assert (frames.diff().dropna() == 1).all()
    assert frames.first().is_monotonic_increasing  # ids in the order of appearance
    assert (read.tracks["frame"] == 1).sum() > 5  # the road was not empty before


def test_directions_have_highds_signs(read):
    tracks = read.tracks
    assert (np.sign(tracks["xVelocity"]) == read.forward).all()
    upper = read.direction == 1
    assert read.centre_y[upper].max() < read.lower[0]
    assert read.centre_y[~upper].min() > read.upper[-1]
    moved = tracks.groupby("id")["x"].diff().dropna()
    assert (np.sign(moved) == read.forward[moved.index]).mean() > 0.999


def test_velocities_are_the_rates_of_the_positions(read):
    if read.settings is FAULTLESS or read.settings.end_speed_error_mps == 0:
        moved = read.tracks.groupby("id")[["x", "y"]].diff()
        inside = moved["x"].notna()
        for axis, tolerance in (("x", 0.02), ("y", 0.02)):
            rate = moved[axis][inside] * read.settings.frame_rate
            mean = read.tracks[f"{axis}Velocity"].rolling(2).mean()[inside]
            assert abs((rate - mean).mean()) < tolerance
            assert (rate - mean).abs().max() < 0.02 * read.settings.frame_rate + 0.1


def test_lane_ids_count_all_markings_from_the_top(read):
    markings = np.concatenate([read.upper, read.lower])
    np.testing.assert_array_equal(np.searchsorted(markings, read.centre_y - 1e-6) + 1, read.tracks["laneId"])
    for direction, lanes in read.lanes.items():
        assert set(read.tracks["laneId"][read.direction == direction]) == lanes


def test_sight_distances_run_from_the_centre_to_the_ends(read):
    length = read.settings.section_m
    ahead = np.where(read.direction == 2, length - read.centre_x, read.centre_x)
    slack = 0.011 + 5 * (read.settings.position_noise_m + read.settings.detection_noise_m)
    np.testing.assert_allclose(read.tracks["frontSightDistance"], ahead, atol=0.011)
    np.testing.assert_allclose(read.tracks["backSightDistance"], length - ahead, atol=0.011)
    assert read.tracks["frontSightDistance"].between(-slack, length + slack).all()


class TooCloseError(Exception):
    """Boxes that touch to the centimetre: which side of the overlap they are on is lost in the rounding."""


def neighbours(frame: pd.DataFrame, i: int, lane: int, *, beside: bool) -> tuple[int, int, int]:
    """(ahead, alongside, behind) on a lane: nearest centres; alongside = boxes overlap lengthwise."""
    there = frame[(frame["laneId"] == lane) & (frame.index != i)]
    distance = (there["s"] - frame["s"][i]).to_numpy()
    reach = ((there["width"] + frame["width"][i]) / 2).to_numpy()
    ids = there["id"].to_numpy()
    if beside and (np.abs(np.abs(distance) - reach) < 0.02).any():
        raise TooCloseError
    groups = (
        (distance > 0) & ((not beside) | (distance >= reach)),
        beside & (np.abs(distance) < reach),
        (distance <= 0) & ((not beside) | (-distance >= reach)),
    )
    found = [ids[g][np.argmin(np.abs(distance[g]))] if g.any() else 0 for g in groups]
    return found[0], found[1], found[2]


def test_neighbours_are_those_that_the_driver_sees(read):
    tracks = read.tracks.assign(s=read.forward * read.centre_x, direction=read.direction)
    checked = 0
    for (_, direction), frame in tracks[tracks["frame"] % 40 == 1].groupby(["frame", "direction"]):
        left = 1 if direction == 1 else -1
        for i, row in frame.iterrows():
            lane = int(row["laneId"])
            try:
                lp, la, lf = neighbours(frame, i, lane + left, beside=True)
                rp, ra, rf = neighbours(frame, i, lane - left, beside=True)
            except TooCloseError:
                continue
            p, _, f = neighbours(frame, i, lane, beside=False)
            wanted = [p, f, lp, la, lf, rp, ra, rf]
            assert row.loc["precedingId":"rightFollowingId"].astype(int).tolist() == wanted
            checked += 1
    assert checked > 200
    assert (tracks["leftAlongsideId"] > 0).any()
    assert (tracks["rightAlongsideId"] > 0).any()


def test_the_leader_gives_gap_headway_and_time_to_collision(read):
    tracks = read.tracks.assign(s=read.forward * read.centre_x)
    alone = tracks["precedingId"] == 0
    assert (tracks.loc[alone, ["dhw", "thw", "ttc", "precedingXVelocity"]] == 0).all(axis=None)
    leader = tracks[["frame", "id", "s", "width", "xVelocity"]]
    pair = tracks[~alone].merge(
        leader, left_on=["frame", "precedingId"], right_on=["frame", "id"], suffixes=("", "_leader")
    )
    assert len(pair) == (~alone).sum()
    gap = pair["s_leader"] - pair["s"] - (pair["width"] + pair["width_leader"]) / 2
    np.testing.assert_allclose(pair["dhw"], gap, atol=0.03)
    np.testing.assert_allclose(pair["precedingXVelocity"], pair["xVelocity_leader"], atol=1e-9)
    np.testing.assert_allclose(pair["thw"], pair["dhw"] / pair["xVelocity"].abs(), atol=0.02)
    closing = pair["xVelocity"].abs() - pair["xVelocity_leader"].abs()
    clear = closing.abs() > 0.5
    assert (np.sign(pair["ttc"][clear]) == np.sign(closing[clear])).all()
    np.testing.assert_allclose(pair["ttc"][clear], (pair["dhw"] / closing)[clear], rtol=0.03, atol=0.05)
    assert (pair["dhw"] > 0).all()


def test_a_lane_change_switches_leader_in_the_frame_of_the_lane_id(read):
    tracks = read.tracks
    changed = (tracks["laneId"].diff() != 0) & (tracks["id"].diff() == 0)
    assert changed.sum() >= 3
    for row in tracks[changed].itertuples():
        if row.precedingId:
            leader = tracks[(tracks["id"] == row.precedingId) & (tracks["frame"] == row.frame)]
            assert leader["laneId"].item() == row.laneId
