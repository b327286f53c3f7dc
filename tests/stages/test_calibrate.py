import numpy as np
import pandas as pd
import pytest

from highd_lc.io import artefacts
from highd_lc.stages import calibrate
from highd_lc.vocab import names
from highd_lc.vocab.job import Combination, Job, Provenance
from highd_lc.vocab.lcm_parameters import PARAMETERS, TABLE3_MEANS
from highd_lc.vocab.settings import CalibrateSettings, Settings
from highd_lc.vocab.tables import TABLES

PROVENANCE = Provenance("settings", {}, 1, "code")
SETTINGS = Settings(calibrate=CalibrateSettings(population=30, generations=10))
# Vehicle: length and class. 1 is the ego, 2 the target leader, 3 to 5 the followers, nearest first.
VEHICLES = {1: (4.2, "Car"), 2: (12.5, "Truck"), 3: (4.6, "Car"), 4: (9.0, "Truck"), 5: (4.4, "Car")}


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


def event_row(event_id, followers):
    blank = {column.name: {"bool": True, "string": ""}.get(column.kind) for column in TABLES["events"].columns}
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
        "follower_ids": followers,
    }
    return blank | filled


def make_work(tmp_path, windows, *, leader=True):
    """A work folder with one event a recording; windows: calibration rows of each follower of each recording."""
    events, rows, vehicles = [], [], []
    for recording, sizes in windows.items():
        event_id, followers = f"{recording:02d}-0001-00250", list(range(3, 3 + len(sizes)))
        events.append(event_row(event_id, followers))
        if leader:
            rows.append(motion_rows(event_id, names.TARGET_LEADER, 2, n=151, x0=40.0, window=0))
        for rank, (vehicle, window) in enumerate(zip(followers, sizes, strict=True), start=1):
            role = names.target_follower(rank)
            rows.append(motion_rows(event_id, role, vehicle, n=151, x0=40.0 - 30.0 * rank, window=window))
        for vehicle, (length, kind) in VEHICLES.items():
            vehicles.append(
                {"recording_id": recording, "vehicle_id": vehicle, "driving_direction": 2, "class": kind}
                | {"length": length, "width": 1.8, "first_frame": 1, "last_frame": 400}
            )
    work = tmp_path / "work"
    work.mkdir(parents=True)
    for name, frame in (
        ("events", pd.DataFrame(events)),
        ("event_tracks", pd.concat(rows)),
        ("vehicles", pd.DataFrame(vehicles)),
    ):
        ordered = frame.sort_values(list(TABLES[name].order), kind="stable")
        write(work, name, ordered, sorted(windows))
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
    cars = fits[(fits["status"] == names.FITTED) & (fits["class"] == "Car")]
    for parameter in PARAMETERS:
        assert fits.loc[(2, 1), parameter] == pytest.approx(cars[parameter].median())
        assert fits.loc[(2, 2), parameter] == pytest.approx(fits.loc[(1, 2), parameter])
    assert fits.loc[(2, 1), "leader_length_m"] == pytest.approx(cars["leader_length_m"].mean())
    assert fits.loc[2, "objective"].isna().all()


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
    for parameter in PARAMETERS:
        assert fits[parameter].iloc[1] == pytest.approx(fits[parameter].iloc[[0, 2]].median())


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
        found.append([artefacts.path_of(work, table).read_bytes() for table in ("followers", "summary_lcm")])
    assert found[0] == found[1]


def test_a_recording_without_events_has_an_empty_part(tmp_path):
    work = make_work(tmp_path, {1: [125], 2: [100]})
    calibrate.run(Job(3, work, work, SETTINGS, PROVENANCE))
    assert artefacts.read_part(work, calibrate.STAGE, "followers", 3).empty
    _, fits = run(work, [1, 2, 3])
    assert len(fits) == 2
