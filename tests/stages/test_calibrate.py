import numpy as np
import pandas as pd
import pytest

from highd_lc.core.car_following import objectives_of
from highd_lc.drivers.calibration import pose
from highd_lc.io import artefacts
from highd_lc.stages import calibrate
from highd_lc.stages.scenes import track_of
from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS, TABLE3_MEANS
from highd_lc.vocab.job import Combination, Job, Provenance
from highd_lc.vocab.settings import CalibrateSettings, Settings
from highd_lc.vocab.tables import TABLES

TABLES_WRITTEN = ("followers", "follower_tracks", "summary_lcm", "identifiability", "pooling")
PROVENANCE = Provenance("settings", {}, 1, "code")
SETTINGS = Settings(calibrate=CalibrateSettings(population=30, generations=10))
# Vehicle: length and class. 1 is the ego, 2 the target leader, 3 to 5 the followers, nearest first.
VEHICLES = {
    1: (4.2, "Car"), 2: (12.5, "Truck"), 3: (4.6, "Car"), 4: (9.0, "Truck"), 5: (4.4, "Car"), 9: (4.5, "Car"),
}  # fmt: skip


def motion_rows(event_id, role, vehicle, *, n, x0, window):
    """Rows of a role over n frames that end at t_start; the last window of them before it calibrate."""
    t = np.arange(-n + 1, 1) / 25
    wave = np.sin(0.8 * t + 0.3 * vehicle)
    rows = pd.DataFrame({"t": t, "x": x0 + 25 * t - np.cos(0.8 * t + 0.3 * vehicle) / 0.8, "vx": 25 + wave})
    rows["ax"] = 0.8 * np.cos(0.8 * t + 0.3 * vehicle)
    rows[["y", "vy", "ay"]] = 0.0
    rows["calibration"] = (t < 0) & (np.arange(n) >= n - 1 - window)
    return rows.assign(event_id=event_id, recording_id=int(event_id[:2]), role=role, vehicle_id=vehicle)


def write(work, name, frame, groups):
    parts = [artefacts.to_arrow(name, frame[frame["recording_id"] == g], PROVENANCE) for g in groups]
    artefacts.write_groups(work, name, parts, PROVENANCE)


def blank(table):
    """A row of a table with nothing in it."""
    empty = {"bool": True, "string": "", "int64": 1, "float64": 0.0, "float32": 0.0}
    return {
        column.name: None if column.nullable else empty.get(column.kind, []) for column in TABLES[table].columns
    }


def track_rows(recording):
    """Somebody on the road, whom nobody follows."""
    n = 50
    about = {"recording_id": recording, "vehicle_id": 9, "length": 4.5, "width": 1.8, "lane": 1}
    rows = pd.DataFrame({"frame": np.arange(1, n + 1), "t": np.arange(n) / 25.0, "x": 30.0 + np.arange(n)})
    return rows.assign(
        **{name: 0.0 for name in ("y", "vx", "vy", "ax", "ay")}, **about, leader_id=None, follower_id=None
    )


def event_row(event_id, followers):
    filled = {
        "event_id": event_id,
        "recording_id": int(event_id[:2]),
        "ego_id": 1,
        "ego_class": "Car",
        "direction": "left",
        "origin_lane": 1,
        "target_lane": 2,
        "start_frame": 200,
        "crossing_frame": 250,
        "end_frame": 300,
        "frame_rate": 25.0,
        "duration_s": 4.0,
        "lateral_shift_m": 3.5,
        "target_leader_id": 2,
        "follower_ids": followers,
        "leader_changes_s": [],
        "later_leader_ids": [],
    }
    return blank("events") | filled


def make_work(tmp_path, windows, *, leader=True):
    """A work folder with one event a recording; windows: calibration rows of each follower of each recording."""
    events, rows, vehicles = [], [], []
    for recording, sizes in windows.items():
        event_id, followers = f"{recording:02d}-0001-00250", list(range(3, 3 + len(sizes)))
        events.append(event_row(event_id, followers))
        rows.append(motion_rows(event_id, names.EGO, 1, n=151, x0=0.0, window=0))
        if leader:
            rows.append(motion_rows(event_id, names.TARGET_LEADER, 2, n=151, x0=40.0, window=0))
        for rank, (vehicle, window) in enumerate(zip(followers, sizes, strict=True), start=1):
            role = names.target_follower(rank)
            rows.append(motion_rows(event_id, role, vehicle, n=151, x0=40.0 - 30.0 * rank, window=window))
        for vehicle, (length, kind) in VEHICLES.items():
            vehicles.append(
                {"recording_id": recording, "vehicle_id": vehicle, "driving_direction": 2, "class": kind}
                | {"length": length, "width": 1.8, "first_frame": 1, "last_frame": 400}
                | {"recorded_id": vehicle, "mean_acceleration": 0.0}
            )
    work = tmp_path / "work"
    work.mkdir(parents=True)
    for name, frame in (
        ("events", pd.DataFrame(events)),
        ("event_tracks", pd.concat(rows)),
        ("vehicles", pd.DataFrame(vehicles)),
        (
            "recordings",
            pd.DataFrame([blank("recordings") | {"recording_id": r, "format": "highd"} for r in sorted(windows)]),
        ),
    ):
        ordered = frame.sort_values(list(TABLES[name].order), kind="stable")
        write(work, name, ordered, sorted(windows))
    for recording in windows:
        table = artefacts.to_arrow("tracks", track_rows(recording), PROVENANCE)
        artefacts.write(artefacts.partition(work, "tracks", recording), table)
    return work


def run(work, recordings, settings=SETTINGS):
    reports = [calibrate.run(Job(r, work, work, settings, PROVENANCE)) for r in recordings]
    calibrate.combine(Combination(tuple(recordings), work, settings, PROVENANCE))
    fits = artefacts.read(work, "followers").set_index(["recording_id", "follower"])
    return reports, fits


def test_fits_and_pools(tmp_path):
    # Recording 1: two cars and a truck fitted. Recording 2: all too short. Recording 3: only the car fitted.
    work = make_work(tmp_path, {1: [125, 110, 100], 2: [40, 0, 40], 3: [100]})
    reports, fits = run(work, [1, 2, 3])
    assert [report.counts for report in reports] == [
        {"fitted": 3, "not fitted": 0},
        {"fitted": 0, "not fitted": 3},
        {"fitted": 1, "not fitted": 0},
    ]
    assert fits["status"].tolist() == [names.FITTED] * 3 + [names.CLASS_POOL] * 3 + [names.FITTED]
    assert fits.loc[1, "n_samples"].tolist() == [50, 44, 40]
    assert fits.loc[2, "reason"].tolist() == ["too_short"] * 3
    assert fits.loc[2, "n_samples"].tolist() == [16, 0, 16]
    # The only truck stands for trucks; a car of the pool stands for cars, whole and with its own leader's length.
    taken = [*PARAMETERS, "leader_length_m"]
    assert fits.loc[(2, 2), taken].tolist() == fits.loc[(1, 2), taken].tolist()
    cars = fits[(fits["status"] == names.FITTED) & (fits["class"] == "Car")]
    assert fits.loc[(2, 1), taken].tolist() in cars[taken].to_numpy().tolist()
    assert fits.loc[(2, 1), taken].tolist() == fits.loc[(2, 3), taken].tolist()
    assert fits.loc[(2, 1), "spread"]["tau"] == pytest.approx(cars["tau"].std(ddof=0))
    assert fits.loc[2, "objective"].isna().all()


def test_the_pools_driver_drives_the_pool_best(tmp_path):
    work = make_work(tmp_path, {1: [125, 0, 110], 2: [100, 0, 90], 3: [0]})
    _, fits = run(work, [1, 2, 3])
    cars = fits[fits["status"] == names.FITTED]
    tracks = [track_of(row) for row in artefacts.read(work, "follower_tracks").to_dict("records")]
    candidates = cars[list(PARAMETERS)].to_numpy().T
    objectives = [objectives_of(pose(track, SETTINGS.calibrate), candidates) for track in tracks]
    best = candidates[:, np.argmin(np.mean(objectives, axis=0))]
    assert fits.loc[(3, 1), list(PARAMETERS)].tolist() == best.tolist()


def test_standstill_spacing_moves_with_the_leader(tmp_path):
    work = make_work(tmp_path, {1: [125, 110, 100], 2: [0, 0, 0]})
    _, fits = run(work, [1, 2])
    # The first follower changes from the leader of 12.5 m to the ego of 4.2 m, the others keep theirs.
    assert fits.loc[(1, 1), "leader_length_m"] == 12.5
    assert fits.loc[(1, 1), "L_replay"] == pytest.approx(max(fits.loc[(1, 1), "L"] - 12.5 + 4.2, 2.0))
    for rank, leader in ((2, 3), (3, 4)):
        assert fits.loc[(1, rank), "leader_length_m"] == VEHICLES[leader][0]
        assert fits.loc[(1, rank), "L_replay"] == fits.loc[(1, rank), "L"]
    for rank, leader in ((1, 1), (2, 3), (3, 4)):
        row = fits.loc[(2, rank)]
        moved = np.clip(row["L"] - row["leader_length_m"] + VEHICLES[leader][0], 2.0, 25.0)
        assert row["L_replay"] == pytest.approx(moved)


def test_pool_of_all_serves_a_class_without_fits(tmp_path):
    work = make_work(tmp_path, {1: [125, 0, 100]})
    _, fits = run(work, [1])
    assert fits["status"].tolist() == [names.FITTED, names.POOL, names.FITTED]
    drivers = fits[list(PARAMETERS)].to_numpy().tolist()
    assert drivers[1] in (drivers[0], drivers[2])


def test_tracks_of_the_fitted_come_back(tmp_path):
    work = make_work(tmp_path, {1: [125, 0, 100]})
    _, fits = run(work, [1])
    table = artefacts.read(work, "follower_tracks")
    assert table["follower"].tolist() == [1, 3]
    for row in table.to_dict("records"):
        track, fit = track_of(row), fits.loc[(1, row["follower"])]
        assert len(track.x) == fit["n_samples"]
        problem = pose(track, SETTINGS.calibrate)
        parameters = fit[list(PARAMETERS)].to_numpy(float)[:, None]
        assert objectives_of(problem, parameters)[0] == fit["objective"]


def test_studies_of_the_fits_are_written(tmp_path):
    work = make_work(tmp_path, {1: [125, 110, 100], 2: [120]})
    run(work, [1, 2])
    known = artefacts.read(work, "identifiability")
    assert known["parameter"].tolist() == list(PARAMETERS)
    assert (known["n"] == 4).all()
    assert known["width"].between(0, 1).all()
    pooling = artefacts.read(work, "pooling")
    assert pooling["strength"].iloc[[0, -1]].tolist() == [0.0, np.inf]
    assert pooling["folds"].sum() == 4
    assert (pooling["held_out_mean"] > 0).all()


def test_a_strong_penalty_makes_everybody_drive_alike(tmp_path):
    work = make_work(tmp_path, {1: [125, 110, 100], 2: [120]})
    _, own = run(work, [1, 2])
    calibration = SETTINGS.calibrate.model_copy(update={"pooling": "penalised", "pooling_strength": 1.0})
    _, drawn = run(work, [1, 2], SETTINGS.model_copy(update={"calibrate": calibration}))
    for parameter in ("b", "tau"):
        assert drawn[parameter].std() < 0.5 * own[parameter].std()
    # The objective does not count the penalty: nobody fits his own track better than with his own parameters.
    assert (drawn["objective"] >= 0.98 * own["objective"]).all()
    assert drawn["method"].str.endswith("/pooled").all()


def test_published_means_where_nothing_can_be_fitted(tmp_path):
    work = make_work(tmp_path, {1: [0, 10]}, leader=False)
    _, fits = run(work, [1])
    assert fits["status"].tolist() == [names.TABLE3] * 2
    assert fits["reason"].tolist() == ["no_leader", "too_short"]
    for parameter in PARAMETERS:
        assert (fits[parameter] == getattr(TABLE3_MEANS, parameter)).all()
    assert fits["leader_length_m"].isna().all()
    assert (fits["L_replay"] == fits["L"]).all()
    summary = artefacts.read(work, "summary_lcm")
    assert (summary["n"] == 0).all()
    assert summary["q50"].isna().all()
    for empty in ("follower_tracks", "identifiability", "pooling"):
        assert artefacts.read(work, empty).empty


def test_summary_has_table_3_beside_ours(tmp_path):
    work = make_work(tmp_path, {1: [125, 110, 100]})
    _, fits = run(work, [1])
    summary = artefacts.read(work, "summary_lcm").set_index(["group", "quantity"])
    for parameter in PARAMETERS:
        row = summary.loc[("all", parameter)]
        assert row["n"] == 3
        assert row["q50"] == pytest.approx(fits[parameter].median())
        assert row["mean"] == pytest.approx(fits[parameter].mean())
        assert row["paper_mean"] == getattr(TABLE3_MEANS, parameter)
        assert row["share_at_bound"] == pytest.approx(np.mean([parameter in hit for hit in fits["at_bound"]]))
    assert summary.loc[("Truck", "tau"), "n"] == 1
    assert summary.loc[("Truck", "tau"), "mean"] == pytest.approx(fits.loc[(1, 2), "tau"])


def test_artefacts_do_not_depend_on_the_order_of_recordings(tmp_path):
    windows = {1: [125, 0], 2: [100]}
    found = []
    for name, order in (("a", [1, 2]), ("b", [2, 1])):
        work = make_work(tmp_path / name, windows)
        run(work, order)
        found.append([artefacts.path_of(work, table).read_bytes() for table in TABLES_WRITTEN])
    assert found[0] == found[1]


def test_a_recording_without_events_has_an_empty_part(tmp_path):
    work = make_work(tmp_path, {1: [125], 2: [100]})
    calibrate.run(Job(3, work, work, SETTINGS, PROVENANCE))
    assert artefacts.read_part(work, calibrate.STAGE, "followers", 3).empty
    _, fits = run(work, [1, 2, 3])
    assert len(fits) == 2
