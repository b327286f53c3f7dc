"""The truth files against the tracks of a camera without error."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from made_traffic import FAULTLESS

from highd_lc.io.synthetic import simulate_recording, truth_of, write_recording
from highd_lc.vocab.driver import PARAMETERS
from highd_lc.vocab.sections import RecorderSettings

RATE = 25.0
SECONDS = 200.0


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> SimpleNamespace:
    folder = tmp_path_factory.mktemp("truth")
    settings = FAULTLESS.model_copy(update={"lane_change_rate": 2.0, "return_share": 0.3})
    write_recording(folder, 1, SECONDS, 2, settings=settings)
    names = ("tracks", "tracksMeta", "truth", "truth_drivers")
    read = {name: pd.read_csv(folder / f"01_{name}.csv") for name in names}
    read["truth"]["target_follower_ids"] = read["truth"]["target_follower_ids"].fillna("").astype(str)
    read["truth"]["target_follower_spacings_m"] = (
        read["truth"]["target_follower_spacings_m"].fillna("").astype(str)
    )
    return SimpleNamespace(**read)


def track(made: SimpleNamespace, vehicle: int) -> pd.DataFrame:
    return made.tracks[made.tracks["id"] == vehicle].set_index("frame")


def chain(row) -> list[int]:
    return [int(float(number)) for number in row.target_follower_ids.split(";") if number]


def test_every_change_of_the_lane_id_is_a_true_crossing_and_no_other(made):
    tracks = made.tracks
    changed = tracks[(tracks["id"].diff() == 0) & (tracks["laneId"].diff() != 0)]
    seen = set(zip(changed["id"], changed["frame"], strict=True))
    true = set(zip(made.truth["vehicle_id"], made.truth["crossing_frame"], strict=True))
    assert len(made.truth) == len(true) > 20
    # Rounding to the centimetre can move a slow crossing by a frame.
    assert {v for v, _ in seen} == {v for v, _ in true}
    assert len(seen) == len(true)
    for (v, frame), (w, crossing) in zip(sorted(seen), sorted(true), strict=True):
        assert v == w
        assert abs(frame - crossing) <= 1
    assert len(seen & true) > 0.9 * len(true)


def test_changes_seen_whole_are_marked_so(made):
    frames = made.tracks.groupby("id")["frame"].agg(["min", "max"])
    for row in made.truth.itertuples():
        first, last = (frames.loc[row.vehicle_id] - 1) / RATE
        assert row.complete_in_view == (first <= row.moving_from_s and row.moving_to_s <= last)
        assert row.path_in_view == (first <= row.start_s and row.end_s <= last)
    assert 0.4 < made.truth["complete_in_view"].mean() < 0.9


def test_times_are_those_of_the_lateral_speed(made):
    """The recorded lateral speed passes 0.1 m/s at the reported moments and is towards the target between."""
    for row in made.truth[made.truth["complete_in_view"]].itertuples():
        ego = track(made, row.vehicle_id)
        direction = made.tracksMeta.set_index("id")["drivingDirection"][row.vehicle_id]
        towards = (1 if direction == 1 else -1) * np.sign(row.target_lane - row.origin_lane)
        speed = towards * ego["yVelocity"]
        time = (speed.index - 1) / RATE
        moving = (time > row.moving_from_s) & (time < row.moving_to_s)
        assert (speed[moving] >= 0.09).all()
        just_before = (time > row.moving_from_s - 0.1) & (time < row.moving_from_s)
        just_after = (time > row.moving_to_s) & (time < row.moving_to_s + 0.1)
        assert (speed[just_before | just_after] <= 0.11).all()
        assert (row.start_frame - 1) / RATE == pytest.approx(row.moving_from_s, abs=0.5 / RATE + 0.001)
        assert (row.end_frame - 1) / RATE == pytest.approx(row.moving_to_s, abs=0.5 / RATE + 0.001)
        assert row.start_s < row.moving_from_s < row.crossing_s < row.moving_to_s < row.end_s


def test_lanes_are_the_recorded_ones(made):
    direction = made.tracksMeta.set_index("id")["drivingDirection"]
    for row in made.truth.itertuples():
        ego = track(made, row.vehicle_id)["laneId"]
        upper = direction[row.vehicle_id] == 1
        number = {lane: lane - 1 if upper else 9 - lane for lane in range(2, 9)}
        # Rounding to the centimetre can move a slow crossing by a frame.
        assert number[ego.get(row.crossing_frame + 1, ego.iloc[-1])] == row.target_lane
        assert number[ego.get(row.crossing_frame - 2, ego.iloc[0])] == row.origin_lane


def test_returns_follow_what_was_broken_off(made):
    kinds = made.truth.groupby("kind").size()
    assert kinds["broken_off"] >= 2
    for row in made.truth[made.truth["kind"] == "return"].itertuples():
        before = made.truth[
            (made.truth["vehicle_id"] == row.vehicle_id) & (made.truth["crossing_s"] < row.crossing_s)
        ]
        if len(before):
            out = before.iloc[-1]
            assert out["kind"] == "broken_off"
            assert (out["origin_lane"], out["target_lane"]) == (row.target_lane, row.origin_lane)
            assert out["end_s"] == pytest.approx(row.start_s, abs=0.01)


def test_the_chain_is_what_walking_the_recorded_followers_gives(made):
    checked = 0
    for row in made.truth[made.truth["complete_in_view"]].itertuples():
        ego = track(made, row.vehicle_id).loc[row.start_frame]
        side = "left" if row.target_lane > row.origin_lane else "right"
        assert row.origin_leader_id == ego["precedingId"]
        assert row.origin_follower_id == ego["followingId"]
        if ego[f"{side}AlongsideId"] == 0:
            assert row.target_leader_id == ego[f"{side}PrecedingId"]
            walked, follower = [], int(ego[f"{side}FollowingId"])
            while follower:
                walked.append(follower)
                follower = int(track(made, follower).loc[row.start_frame, "followingId"])
            assert chain(row) == walked
            checked += len(walked)
    assert checked > 20


def test_spacings_are_front_to_front_along_the_chain(made):
    direction = made.tracksMeta.set_index("id")["drivingDirection"]
    for row in made.truth[made.truth["target_follower_ids"] != ""].itertuples():
        fronts = []
        for vehicle in (row.vehicle_id, *chain(row)):
            at = track(made, vehicle).loc[row.start_frame]
            fronts.append(at["x"] + at["width"] if direction[vehicle] == 2 else -at["x"])
        spacings = [float(s) for s in row.target_follower_spacings_m.split(";")]
        np.testing.assert_allclose(spacings, -np.diff(fronts), atol=0.03)


def test_every_vehicle_has_its_driver(made):
    drivers = made.truth_drivers
    assert list(drivers["vehicle_id"]) == list(made.tracksMeta["id"])
    assert list(drivers["class"]) == list(made.tracksMeta["class"])
    assert set(PARAMETERS) < set(drivers.columns)


def test_the_drivers_reproduce_the_recorded_accelerations(made):
    """The published equations with the true parameters give what the camera saw, to its rounding."""
    tracks = made.tracks.merge(
        made.tracks[["frame", "id", "width", "xVelocity"]],
        left_on=["frame", "precedingId"],
        right_on=["frame", "id"],
        suffixes=("", "_leader"),
    ).merge(made.truth_drivers, left_on="id", right_on="vehicle_id")
    v, v_leader = tracks["xVelocity"].abs(), tracks["xVelocity_leader"].abs()
    spacing = tracks["dhw"] + tracks["width_leader"]
    L = tracks["L"] + tracks["width_leader"] - tracks["reference_length_m"]
    wanted = v**2 / (2 * tracks["b"]) - v_leader**2 / (2 * tracks["B"]) + v * tracks["tau"] + L
    model = tracks["A"] * (1 - v / tracks["v_desire"] - np.exp(1 - spacing / np.maximum(wanted, L)))
    forward = np.where(tracks["xVelocity"] > 0, 1, -1) * tracks["xAcceleration"]
    # Whoever moves over, or is moved in front of, minds a second leader; most rows are neither.
    assert (abs(model - forward) < 0.02).mean() > 0.9
    assert (forward < model + 0.02).mean() > 0.999


def test_default_recordings_resemble_highd():
    """Durations of the changes seen whole, followers behind them: what the recorder is made for."""
    settings = RecorderSettings()
    tables = [truth_of(simulate_recording(k, 300.0, 1, settings=settings), RATE) for k in (1, 2, 3, 4)]
    truth = pd.concat([t for t, _ in tables])
    cars = pd.concat([t[t["vehicle_id"].isin(d.loc[d["class"] == "Car", "vehicle_id"])] for t, d in tables])
    whole = truth[truth["complete_in_view"]]
    duration = (cars["moving_to_s"] - cars["moving_from_s"])[cars["complete_in_view"] & (cars["kind"] == "change")]
    assert 5.3 < duration.mean() < 6.1
    assert 1.0 < duration.std() < 1.7
    assert 0.5 < truth["complete_in_view"].mean() < 0.75
    links = whole["target_follower_spacings_m"].map(lambda text: [float(s) for s in text.split(";") if s])
    reached = links.map(lambda chain: int(np.argmax([*(np.array(chain) > 150), True])))
    assert (reached >= 1).mean() > 0.6
    assert (reached >= 3).mean() > 0.1
    assert set(truth["kind"]) == {"change", "broken_off", "return"}
    left = (truth["target_lane"] > truth["origin_lane"]).mean()
    assert 0.35 < left < 0.65


KINDS = {"lcm": {"lcm at once"}, "mixture": {"lcm", "idm"}, "idm": {"idm"}, "population": {"lcm"}}


@pytest.mark.parametrize("kind", list(KINDS))
def test_the_truth_names_each_drivers_model_manner_and_drift(kind):
    scene = simulate_recording(1, 20.0, 4, settings=RecorderSettings(drivers=kind))
    _, drivers = truth_of(scene, RATE)
    assert set(drivers["model"]) == KINDS[kind]
    idm = drivers["model"] == "idm"
    of_the_lcm = ["A", "b", "B", "tau", "L", "reference_length_m"]
    of_the_idm = ["idm_A", "idm_b", "idm_T", "idm_s0"]
    assert drivers.loc[idm, of_the_lcm].isna().all(axis=None)
    assert drivers.loc[idm, of_the_idm].notna().all(axis=None)
    assert drivers.loc[~idm, of_the_lcm].notna().all(axis=None)
    assert drivers.loc[~idm, of_the_idm].isna().all(axis=None)
    manner = ["v_desire", "memory_s", "relaxation_s", "reaction_moment", "reaction_strength", "ignores_s"]
    assert drivers[[*manner, "unrest_mps2", "drift_mps2"]].notna().all(axis=None)
    assert drivers["reaction_moment"].between(0, 1).all()
    drifts = set(drivers["drift_mps2"])
    assert drifts == {0.0} if kind == "lcm" else len(drifts) == 2
    assert max(map(abs, drifts)) <= RecorderSettings().drift_mps2


def test_kinds_of_drivers_drive_differently():
    scenes = [simulate_recording(1, 10.0, 4, settings=RecorderSettings(drivers=kind)) for kind in KINDS]
    assert len({scene.tracks.table.tobytes() for scene in scenes}) == len(KINDS)
