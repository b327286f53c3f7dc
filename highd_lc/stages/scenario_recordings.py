"""The recordings' part of the scenarios: traffic around a real lane change, and the fitted drivers."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from highd_lc.algorithms.shock_wave import WaveSpeed, wave_speed
from highd_lc.core.edie import Cells, clip_to_grid, trajectories_of_rows
from highd_lc.io import artefacts
from highd_lc.vocab import names
from highd_lc.vocab.lcm_parameters import PARAMETERS
from highd_lc.vocab.scenarios import RecordedSettings, ScenarioSettings

FloatArray = NDArray[np.float64]
Row = dict[str, Any]

_NEEDED = ("events", "vehicles", "followers")


@dataclass(frozen=True)
class RecordedChange:
    """Traffic on the target lane around a recorded lane change.

    cells: Edie's measures on a grid of x [m] and t [s from the crossing]; ego: t and x of the vehicle that changes
    lane; wave: of the disturbance behind it.
    """

    event_id: str
    x_edges: FloatArray
    t_edges: FloatArray
    cells: Cells
    ego: tuple[FloatArray, FloatArray]
    wave: WaveSpeed


def has_recordings(work: Path | None) -> bool:
    """Whether a work folder holds what the recordings' part needs."""
    return work is not None and all(artefacts.path_of(work, name).is_file() for name in _NEEDED)


def fitted_drivers(work: Path) -> FloatArray:
    """LCM parameters of all followers that were fitted, shape (n, 6), in the order of the table."""
    followers = artefacts.read(work, "followers", columns=["status", *PARAMETERS])
    return followers.loc[followers["status"] == names.FITTED, list(PARAMETERS)].to_numpy(np.float64)


def recorded_change(work: Path, settings: ScenarioSettings) -> RecordedChange | None:
    """The traffic around the lane change with most followers, the first of equals; None without events."""
    events = artefacts.read(work, "events")
    if events.empty:
        return None
    event = events.loc[events["follower_ids"].map(len).idxmax()]
    rows = _carriageway(work, event)
    rows = rows.assign(t=rows["t"] - _crossing_time(event, rows))
    span = settings.recorded
    rows = rows[(rows["t"] >= -span.before_s) & (rows["t"] <= span.after_s)]
    x_edges, t_edges = _edges(rows, span)
    lane = rows[rows["lane"] == event["target_lane"]]
    step = 1.5 / event["frame_rate"]
    tracks = trajectories_of_rows(*(lane[c].to_numpy() for c in ("vehicle_id", "t", "x")), longest_step=step)
    ego = rows[rows["vehicle_id"] == event["ego_id"]].sort_values("t")
    return RecordedChange(
        str(event["event_id"]),
        x_edges,
        t_edges,
        clip_to_grid(tracks, x_edges=x_edges, t_edges=t_edges),
        (ego["t"].to_numpy(), ego["x"].to_numpy()),
        _wave(event, rows, settings.seed),
    )


def _carriageway(work: Path, event: pd.Series) -> pd.DataFrame:
    """Tracks of the ego's recording on its carriageway."""
    recording = int(event["recording_id"])
    vehicles = artefacts.read(work, "vehicles", recording=recording)
    direction = vehicles.set_index("vehicle_id")["driving_direction"]
    columns = ["vehicle_id", "frame", "t", "x", "vx", "lane"]
    tracks = artefacts.read_tracks(work, recording, columns=columns)
    same = direction.index[direction == direction.loc[event["ego_id"]]]
    return tracks[tracks["vehicle_id"].isin(same)]


def _crossing_time(event: pd.Series, rows: pd.DataFrame) -> float:
    crossed = (rows["vehicle_id"] == event["ego_id"]) & (rows["frame"] == event["crossing_frame"])
    return float(rows.loc[crossed, "t"].iloc[0])


def _edges(rows: pd.DataFrame, span: RecordedSettings) -> tuple[FloatArray, FloatArray]:
    low, high = np.floor(rows["x"].min() / span.cell_m), np.ceil(rows["x"].max() / span.cell_m)
    x_edges = np.arange(low, high + 1) * span.cell_m
    t_edges = np.arange(-span.before_s, span.after_s + 1e-9, span.cell_s)
    # A cell that begins before the recording or ends after it would be too empty.
    seen = (t_edges >= rows["t"].min() - 1e-9) & (t_edges <= rows["t"].max() + 1e-9)
    return x_edges, t_edges[seen] if seen.sum() >= 2 else t_edges


def _wave(event: pd.Series, rows: pd.DataFrame, seed: int) -> WaveSpeed:
    """The wave from the ego through its followers, from the begin of the window to its end."""
    chain = [int(event["ego_id"]), *(int(i) for i in event["follower_ids"])]
    wide = rows[rows["vehicle_id"].isin(chain)].pivot_table(
        index="frame", columns="vehicle_id", values=["x", "vx"]
    )
    wide = wide.reindex(range(int(wide.index.min()), int(wide.index.max()) + 1))
    x, v = (wide[name].reindex(columns=chain).to_numpy(np.float64).T for name in ("x", "vx"))
    rng = np.random.default_rng([seed, int(event["recording_id"]), int(event["ego_id"])])
    return wave_speed(x, v - np.nanmean(v, axis=1, keepdims=True), dt=1.0 / float(event["frame_rate"]), rng=rng)


def state_rows(change: RecordedChange) -> Iterator[Row]:
    """The cells around a lane change (rows of ``recorded_state``)."""
    cells = change.cells
    measures = {
        "flow_veh_h": 3600.0 * cells.flow,
        "speed_km_h": 3.6 * cells.speed,
        "density_veh_km": 1000.0 * cells.density,
    }
    for i, j in np.ndindex(cells.time.shape):
        yield {
            "event_id": change.event_id,
            "x_from_m": change.x_edges[i],
            "x_to_m": change.x_edges[i + 1],
            "t_from_s": change.t_edges[j],
            "t_to_s": change.t_edges[j + 1],
            "distance_m": cells.distance[i, j],
            "time_s": cells.time[i, j],
            **{name: values[i, j] for name, values in measures.items()},
        }
