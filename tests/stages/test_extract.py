from pathlib import Path

import altered
import numpy as np
import pandas as pd
import pytest
import running
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from quintic_recording import Scene, lateral, random_scene, write

from highd_lc.vocab import names

FIXTURES = Path(__file__).parents[1] / "fixtures"
# Shrinking a seed makes no simpler recording.
FEW = settings(
    max_examples=4,
    deadline=None,
    phases=(Phase.explicit, Phase.reuse, Phase.generate),
    suppress_health_check=list(HealthCheck),
)
SEEDS = st.integers(0, 10_000)


def made(folder, seed, **options):
    options = {"rate": 10.0, "seconds": 25.0, "lanes": (3, 3), **options}
    return write(random_scene(np.random.default_rng(seed), **options), folder)


def by_event(tables):
    """Events with the moments that matter, in seconds, by ego and crossing."""
    return tables["crossings"].sort_values(["ego_id", "crossing_frame"]).reset_index(drop=True)


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    """A recording and its tables for each noise of the lateral positions [m]."""
    found = {}
    for noise in (0.0, 0.05):
        folder = tmp_path_factory.mktemp("truth")
        scene = made(folder, 1, rate=25.0, seconds=70.0, noise=noise, lanes=(4, 3))
        found[noise] = scene, running.extracted(folder, folder / "work")
    return found


@pytest.fixture(params=[0.0, 0.05], ids=["clean", "noisy"])
def known(request, scenes):
    return scenes[request.param]


def with_truth(scene, tables):
    truths = pd.DataFrame([vars(truth) for truth in scene.truths])
    return truths.merge(
        tables["crossings"], left_on="vehicle_id", right_on="ego_id", how="outer", suffixes=("_true", "")
    )


def test_every_complete_lane_change_is_found_and_none_invented(known):
    scene, tables = known
    both = with_truth(scene, tables)
    assert both["event_id"].notna().all()
    assert both["vehicle_id"].notna().all()
    complete = both[both["complete"]]
    assert len(complete) > 25
    assert complete["start_frame"].notna().all()
    assert complete["end_frame"].notna().all()
    assert set(complete["reason"]) <= {"", names.NO_TARGET_FOLLOWER, names.FOLLOWER_AHEAD}


def test_crossing_start_and_end_are_near_the_truth(known):
    scene, tables = known
    both = with_truth(scene, tables)
    assert ((both["crossing_frame"] - both["crossing_frame_true"]).abs() <= 1).all()
    complete = both[both["complete"]]
    start = (complete["start_frame"] - 1) / scene.rate - complete["moving_from"]
    end = (complete["end_frame"] - 1) / scene.rate - complete["moving_to"]
    assert start.abs().median() < 0.3
    assert end.abs().median() < 0.3


def chain_of(scene, event):
    """Leader and followers by brute force from the drivers' own motion, not from anything written."""
    t = (event.start_frame - 1) / scene.rate
    later = (event.crossing_frame - 1) / scene.rate
    ego = scene.drivers[event.ego_id - 1]
    own = ego.x0 + ego.speed * t + ego.length / 2
    own_later = ego.x0 + ego.speed * later + ego.length / 2
    ahead, behind = [], []
    for number, driver in enumerate(scene.drivers, start=1):
        x = driver.x0 + driver.speed * t
        lane = int(np.floor(lateral(driver, np.array([t]))[0][0] / 3.75)) + 1
        seen = driver.length / 2 < x < 420.0 - driver.length / 2
        if number == event.ego_id or driver.direction != ego.direction or lane != event.target_lane or not seen:
            continue
        front, rear = x + driver.length / 2, x - driver.length / 2
        alongside = rear < own and front > own - ego.length
        leads = front + driver.speed * (later - t) > own_later if alongside else front > own
        (ahead if leads else behind).append((front, number))
    chain, last = [], own
    for front, number in sorted(behind, reverse=True):
        if last - front > 150.0 or len(chain) == 3:
            break
        chain.append(number)
        last = front
    return (min(ahead)[1] if ahead else None), chain


def test_roles_are_those_of_the_drivers(known):
    scene, tables = known
    events = tables["events"]
    assert len(events) > 15
    for event in events.itertuples():
        leader, chain = chain_of(scene, event)
        assert (None if pd.isna(event.target_leader_id) else event.target_leader_id) == leader
        assert list(event.follower_ids) == chain
    assert events["roles_confirmed"].mean() > 0.9


def test_a_target_leader_that_leaves_its_lane_is_named_with_its_time(known):
    scene, tables = known
    tracks, left = tables["tracks"], 0
    for event in tables["events"].itertuples():
        own = tracks[(tracks["vehicle_id"] == event.target_leader_id) & (tracks["frame"] >= event.start_frame)]
        off = own.loc[own["lane"] != event.target_lane, "frame"]
        wanted = (off.min() - event.start_frame) / scene.rate if len(off) else np.nan
        np.testing.assert_allclose(event.leader_leaves_s, wanted)
        left += len(off) > 0
    assert left > 0


def test_funnel_adds_up(known):
    scene, tables = known
    crossings, events = tables["crossings"], tables["events"]
    tracks = tables["tracks"].sort_values(["vehicle_id", "frame"])
    changes = (tracks["lane"].diff() != 0) & (tracks["vehicle_id"].diff() == 0)
    assert len(crossings) == changes.sum()
    assert set(crossings.loc[crossings["usable"], "reason"]) == {""}
    assert set(crossings.loc[~crossings["usable"], "reason"]) <= set(names.REASONS)
    assert crossings.loc[crossings["usable"], "event_id"].tolist() == events["event_id"].tolist()
    speeds = (
        tables["tracks"]
        .set_index(["vehicle_id", "frame"])["vx"]
        .loc[pd.MultiIndex.from_frame(crossings[["ego_id", "crossing_frame"]])]
    )
    np.testing.assert_allclose(crossings["speed_mps"], speeds, atol=1e-4)
    assert (events["duration_s"] == (events["end_frame"] - events["start_frame"]) / scene.rate).all()


def test_event_tracks_are_relative_raw_and_complete(known):
    scene, tables = known
    tracks = tables["tracks"].set_index(["vehicle_id", "frame"])
    for event in tables["events"].itertuples():
        rows = tables["event_tracks"][tables["event_tracks"]["event_id"] == event.event_id]
        origin = tracks.loc[(event.ego_id, event.start_frame)]
        frame = (rows["t"] * scene.rate).round().astype(int) + event.start_frame
        own = tracks.loc[list(zip(rows["vehicle_id"], frame, strict=True))].reset_index(drop=True)
        np.testing.assert_allclose(rows["x"], (own["x"] - origin["x"]), atol=5.1e-5)
        np.testing.assert_allclose(rows["y"], (own["y"] - origin["y"]), atol=5.1e-5)
        np.testing.assert_allclose(rows["vx"], own["vx"], atol=1e-5)
        assert (rows["x"] == rows["x"].round(4)).all()
        ego = rows[rows["role"] == names.EGO]
        assert ego["t"].min() <= 0
        assert ego["t"].max() >= event.duration_s
        assert {names.target_follower(k + 1) for k in range(len(event.follower_ids))} <= set(rows["role"])


def test_calibration_window_is_car_following_before_the_start(known):
    scene, tables = known
    tracks = tables["tracks"].set_index(["vehicle_id", "frame"])
    events = tables["events"].set_index("event_id")
    used = tables["event_tracks"][tables["event_tracks"]["calibration"]]
    assert len(used) > 0
    for (event_id, role), rows in used.groupby(["event_id", "role"]):
        event = events.loc[event_id]
        rank = int(role.removeprefix(f"{names.TARGET_FOLLOWER}_"))
        leader = event["target_leader_id"] if rank == 1 else event["follower_ids"][rank - 2]
        assert (rows["t"] < 0).all()
        assert np.diff(rows["t"]) == pytest.approx(1 / scene.rate)
        frame = (rows["t"] * scene.rate).round().astype(int) + event["start_frame"]
        own = tracks.loc[list(zip(rows["vehicle_id"], frame, strict=True))]
        ahead = tracks.loc[[(leader, f) for f in frame]]
        assert (own["leader_id"] == leader).all()
        assert (own["lane"] == event["target_lane"]).all()
        for x in (own["x"], ahead["x"]):
            assert x.min() >= 20.0
            assert x.max() <= 400.0


@FEW
@given(seed=SEEDS)
def test_mirrored_recording_gives_the_same_events(tmp_path_factory, seed):
    folder = tmp_path_factory.mktemp("mirror")
    made(folder, seed)
    turned = altered.save(folder / "turned", altered.mirrored(altered.read(folder)))
    one, other = running.extracted(folder, folder / "a"), running.extracted(turned, folder / "b")
    for name in ("crossings", "events", "event_tracks"):
        pd.testing.assert_frame_equal(one[name], other[name], check_exact=name == "event_tracks", rtol=1e-9)
    assert len(one["crossings"]) > 0
    assert (one["vehicles"]["driving_direction"] + other["vehicles"]["driving_direction"] == 3).all()


@FEW
@given(seed=SEEDS)
def test_order_of_rows_does_not_matter(tmp_path_factory, seed):
    folder = tmp_path_factory.mktemp("shuffle")
    made(folder, seed)
    rows = altered.shuffled(altered.read(folder), np.random.default_rng(seed))
    one = running.extracted(folder, folder / "a")
    other = running.extracted(altered.save(folder / "b", rows), folder / "b" / "work")
    for name in one:
        pd.testing.assert_frame_equal(one[name], other[name], check_exact=True)


@FEW
@given(seed=SEEDS)
def test_vehicle_ids_do_not_matter(tmp_path_factory, seed):
    folder = tmp_path_factory.mktemp("ids")
    made(folder, seed)
    tables, old = altered.renumbered(altered.read(folder), np.random.default_rng(seed))
    one = running.extracted(folder, folder / "a")
    other = running.extracted(altered.save(folder / "b", tables), folder / "b" / "work")
    moments = ["crossing_frame", "start_frame", "end_frame", "reason", "direction", "usable"]
    back = other["crossings"].assign(ego_id=other["crossings"]["ego_id"].map(old))
    pd.testing.assert_frame_equal(
        by_event({"crossings": back})[["ego_id", *moments]], by_event(one)[["ego_id", *moments]]
    )
    chains = {
        (old[event.ego_id], event.crossing_frame): [old[v] for v in event.follower_ids]
        for event in other["events"].itertuples()
    }
    assert chains == {
        (event.ego_id, event.crossing_frame): list(event.follower_ids) for event in one["events"].itertuples()
    }


@FEW
@given(seed=SEEDS)
def test_half_the_frame_rate_gives_the_same_events(tmp_path_factory, seed):
    folder = tmp_path_factory.mktemp("half")
    scene = made(folder, seed, rate=25.0, seconds=14.0)
    coarse = altered.save(folder / "coarse", altered.halved(altered.read(folder)))
    one, other = (
        by_event(running.extracted(folder, folder / "a")),
        by_event(running.extracted(coarse, folder / "b")),
    )
    complete = {truth.vehicle_id for truth in scene.truths if truth.complete}
    one, other = (table[table["ego_id"].isin(complete)].reset_index(drop=True) for table in (one, other))
    assert one["ego_id"].tolist() == other["ego_id"].tolist()
    assert one["reason"].tolist() == other["reason"].tolist()
    for column, tolerance in (("crossing_frame", 0.0401), ("start_frame", 0.2001), ("end_frame", 0.2001)):
        fine, rough = ((table[column] - 1).astype(float) / rate for table, rate in ((one, 25.0), (other, 12.5)))
        assert ((fine - rough).abs() <= tolerance).all()


@pytest.mark.parametrize("recording", [1, 2])
def test_fixtures_give_the_truth_of_their_recorder(tmp_path, recording):
    tables = running.extracted(FIXTURES, tmp_path, recording)
    truth = pd.read_csv(FIXTURES / f"{recording:02d}_truth.csv")
    rate = tables["recordings"]["frame_rate"].iloc[0]
    crossings = tables["crossings"]
    plain = truth[(truth["kind"] == "change") & truth["path_in_view"]]
    errors = []
    for change in plain.itertuples():
        near = (crossings["crossing_frame"] - change.crossing_frame).abs() <= 2
        found = crossings[(crossings["ego_id"] == change.vehicle_id) & near]
        assert len(found) == 1
        start, end = (found["start_frame"].iloc[0] - 1) / rate, (found["end_frame"].iloc[0] - 1) / rate
        errors.append((start - change.moving_from_s, end - change.moving_to_s))
    assert len(errors) > 2
    assert (np.median(np.abs(errors), axis=0) < 0.4).all()
    broken = truth[truth["kind"] == "broken_off"]
    for change in broken.itertuples():
        own = crossings[crossings["ego_id"] == change.vehicle_id]
        assert not own["usable"].any()


def test_recording_without_lane_changes_has_empty_tables(tmp_path):
    scene = random_scene(np.random.default_rng(3), rate=10.0, seconds=15.0)
    scene = Scene([driver.__class__(**{**vars(driver), "plans": ()}) for driver in scene.drivers], 10.0, 15.0)
    write(scene, tmp_path)
    tables = running.extracted(tmp_path, tmp_path / "work")
    assert [len(tables[name]) for name in ("crossings", "events", "event_tracks")] == [0, 0, 0]


def test_numbers_of_the_rule_come_from_the_settings(tmp_path):
    made(tmp_path, 4)
    usual = running.extracted(tmp_path, tmp_path / "a")
    one = running.extracted(tmp_path, tmp_path / "b", extract={"max_followers": 1, "horizon_s": 1.0})
    assert max(map(len, one["events"]["follower_ids"])) == 1
    assert len(one["events"]) == len(usual["events"])
    last = one["event_tracks"].merge(one["events"][["event_id", "duration_s"]])
    assert (last["t"] <= last["duration_s"] + 1.0 + 1e-9).all()
    strict = running.extracted(tmp_path, tmp_path / "c", extract={"min_shift_m": 5.0})
    assert set(strict["crossings"]["reason"]) >= {names.SMALL_SHIFT}
