"""The recordings' part of the scenarios: the right event and lane, cells that add up, fitted drivers."""

from pathlib import Path

import numpy as np
import pytest
from running import job

from highd_lc.io import artefacts
from highd_lc.io import settings as settings_file
from highd_lc.stages import calibrate, extract, ingest
from highd_lc.stages.scenario_pages import (
    fitted_drivers,
    has_recordings,
    nearest_event,
    recorded_change,
    state_rows,
)
from highd_lc.stages.scenarios import load_recordings
from highd_lc.vocab.job import Combination
from highd_lc.vocab.scenarios import ScenarioSettings

FIXTURES = Path(__file__).parents[1] / "fixtures"
SETTINGS = settings_file.load_pipeline("scenarios", ScenarioSettings)


@pytest.fixture(scope="module")
def work(tmp_path_factory):
    folder = tmp_path_factory.mktemp("work")
    one = job(FIXTURES, folder, calibrate={"population": 20, "generations": 5})
    for stage, names in (
        (ingest, ("vehicles", "recordings")),
        (extract, ("crossings", "events", "event_tracks")),
    ):
        stage.run(one)
        for name in names:
            artefacts.concatenate(folder, stage.STAGE, name, [1], one.provenance)
    calibrate.run(one)
    calibrate.combine(Combination((1,), folder, one.settings, one.provenance))
    return folder


def test_the_event_has_most_followers(work):
    change, events = recorded_change(work, SETTINGS), artefacts.read(work, "events")
    assert has_recordings(work)
    chosen = events.set_index("event_id").loc[change.event_id]
    assert len(chosen["follower_ids"]) == events["follower_ids"].map(len).max()


def test_cells_hold_the_time_that_the_target_lane_was_driven(work):
    """Twin: each sample stands for one frame; only the ends of a stay on the lane differ."""
    change = recorded_change(work, SETTINGS)
    event = artefacts.read(work, "events").set_index("event_id").loc[change.event_id]
    tracks = artefacts.read_tracks(work, 1)
    ego = tracks[tracks["vehicle_id"] == event["ego_id"]].set_index("frame")
    direction = artefacts.read(work, "vehicles").set_index("vehicle_id")["driving_direction"]
    same = tracks["vehicle_id"].map(direction) == direction[event["ego_id"]]
    t = tracks["t"] - ego.loc[event["crossing_frame"], "t"]
    seen = (t >= change.t_edges[0]) & (t <= change.t_edges[-1])
    lane = tracks[same & seen & (tracks["lane"] == event["target_lane"])]
    step, stays = 1.0 / event["frame_rate"], lane["vehicle_id"].nunique()
    total = change.cells.time.sum()
    assert abs(total - len(lane) * step) <= 2 * step * stays
    assert change.cells.distance.sum() == pytest.approx((lane["vx"] * step).sum(), rel=0.05)
    assert np.nanmean(change.cells.speed) == pytest.approx(lane["vx"].mean(), rel=0.1)


def test_rows_are_the_cells(work):
    change = recorded_change(work, SETTINGS)
    rows = list(state_rows(change))
    assert len(rows) == change.cells.time.size
    for row in rows:
        assert np.isnan(row["flow_veh_h"]) == (row["time_s"] == 0.0)
        if row["time_s"] > 0.0:
            assert row["speed_km_h"] == pytest.approx(row["flow_veh_h"] / row["density_veh_km"])


def test_fitted_drivers_are_those_of_the_table(work):
    followers = artefacts.read(work, "followers")
    drivers, fits = fitted_drivers(work)
    fitted = followers[followers["status"] == "fitted"]
    assert drivers.shape == (len(fitted), 6)
    assert len(drivers) > 0
    assert fits == fitted["paper_j"].median()


def test_the_nearest_event_is_nearest_to_the_printed_state(work):
    """A state taken from an event of its own finds that event."""
    start = artefacts.read(work, "event_tracks")
    start = start[start["t"].abs() < 1e-9]
    wide = start.pivot_table(index="event_id", columns="role", values=["x", "vx"]).dropna(
        subset=[("x", f"target_follower_{rank}") for rank in (1, 2, 3)]
    )
    for event_id, row in wide.iterrows():
        state = SETTINGS.scenario_3.model_copy(
            update={
                "spacings_m": tuple(-row["x", f"target_follower_{r}"] + row["x", "ego"] for r in (1, 2, 3)),
                "speed_differences": tuple(
                    row["vx", f"target_follower_{r}"] - row["vx", "ego"] for r in (1, 2, 3)
                ),
            }
        )
        assert nearest_event(work, SETTINGS.model_copy(update={"scenario_3": state})) == event_id
    assert len(wide) > 0


def test_without_recordings_there_is_nothing(tmp_path):
    assert not has_recordings(tmp_path)
    found, skipped = load_recordings(tmp_path, SETTINGS)
    assert (len(found.fitted), found.change, found.nearest, skipped) == (0, None, "", "")


def test_artefacts_of_no_use_are_left_out_with_a_reason(tmp_path):
    for name in ("events", "vehicles", "followers"):
        (tmp_path / f"{name}.parquet").write_bytes(b"not parquet")
    found, skipped = load_recordings(tmp_path, SETTINGS)
    assert len(found.fitted) == 0
    assert found.change is None
    assert "parquet" in skipped
