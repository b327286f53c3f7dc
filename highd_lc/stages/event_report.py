"""One recording's artefacts to the reports of its events: rows as they are, recorded motion on the page's grid."""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path as Folder
from typing import Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from highd_lc.algorithms import planner
from highd_lc.io import artefacts
from highd_lc.reporting import labels
from highd_lc.reporting.event import Box, EventReport, Path, Play, Row
from highd_lc.stages.event_plays import policy_plays, surrounding
from highd_lc.stages.event_traces import Track, fit_traces, surface_of, track_traces
from highd_lc.vocab import names
from highd_lc.vocab.job import Job
from highd_lc.vocab.scene import Scene
from highd_lc.vocab.settings import ValidateSettings

FloatArray = NDArray[np.float64]
Tracks = Mapping[str, Track]

PERIOD: Final = 0.1
"""Time step of all motions on a page [s]: the planner's, and the finest that a page to be shared may carry."""
_GROUPED: Final = ("plans", "losses", "followers", "tracking")


@dataclass(frozen=True)
class RecordingTables:
    """What the artefacts hold of one recording; tracks by event and role, other rows by table and event."""

    events: tuple[Row, ...]
    tracks: Mapping[str, Tracks]
    boxes: Mapping[int, Box]
    directions: Mapping[int, int]
    markings: Mapping[int, FloatArray]
    rows: Mapping[str, Mapping[str, tuple[Row, ...]]]
    provenance: tuple[tuple[str, str], ...]


def read_tables(job: Job) -> RecordingTables:
    """Read everything that the pages of a recording's events show."""
    vehicles = artefacts.read(job.work, "vehicles", recording=job.recording)
    roads = artefacts.read(job.work, "recordings", recording=job.recording)
    return RecordingTables(
        events=tuple(artefacts.read(job.work, "events", recording=job.recording).to_dict("records")),
        tracks=_by_role(artefacts.read(job.work, "event_tracks", recording=job.recording)),
        boxes={v.vehicle_id: Box(v.length, v.width) for v in vehicles.itertuples(index=False)},
        directions=dict(zip(vehicles["vehicle_id"], vehicles["driving_direction"], strict=True)),
        markings=dict(zip(roads["driving_direction"], roads["markings"], strict=True)),
        rows={name: _by_event(job.work, name, job.recording) for name in _GROUPED},
        provenance=_provenance(job),
    )


def _by_event(work: Folder, name: str, recording: int) -> dict[str, tuple[Row, ...]]:
    groups: dict[str, list[Row]] = defaultdict(list)
    frame = artefacts.read(work, name, recording=recording)
    titles = list(frame.columns)
    # Through an array of objects: value by value, text in arrow's memory costs twenty times as much.
    columns = [frame[title].to_numpy(object).tolist() for title in titles]
    for values in zip(*columns, strict=True):
        row = dict(zip(titles, values, strict=True))
        groups[row["event_id"]].append(row)
    return {event_id: tuple(rows) for event_id, rows in groups.items()}


def _by_role(tracks: pd.DataFrame) -> dict[str, dict[str, Track]]:
    """Tracks by event and role. The table is ordered by both, so each is a slice of its columns."""
    ids, roles = (tracks[name].to_numpy(object) for name in ("event_id", "role"))
    changes = 1 + np.flatnonzero((ids[1:] != ids[:-1]) | (roles[1:] != roles[:-1]))
    starts = np.concatenate([[0], changes]) if len(ids) else changes
    stops = np.concatenate([changes, [len(ids)]]) if len(ids) else changes
    vehicle, calibration = tracks["vehicle_id"].to_numpy(), tracks["calibration"].to_numpy(bool)
    columns = [tracks[name].to_numpy(float) for name in ("t", "x", "y", "vx", "ax")]
    grouped: dict[str, dict[str, Track]] = defaultdict(dict)
    for start, stop in zip(starts, stops, strict=True):
        part = slice(start, stop)
        motion = (column[part] for column in columns)
        grouped[ids[start]][roles[start]] = Track(int(vehicle[start]), *motion, calibration[part])
    return grouped


def _provenance(job: Job) -> tuple[tuple[str, str], ...]:
    source = job.provenance
    inputs = tuple((f"input {name}", digest) for name, digest in sorted(source.inputs.items()))
    return (("code version", source.code), ("settings hash", source.settings), ("seed", str(source.seed)), *inputs)


def event_report(event: Row, tables: RecordingTables, scene: Scene, settings: ValidateSettings) -> EventReport:
    """Everything that the page of an event shows."""
    event_id = str(event["event_id"])
    tracks = tables.tracks[event_id]
    paths = _paths(tracks, PERIOD * np.arange(round(settings.loss.horizon_s / PERIOD) + 1))
    divider = _divider(event, tracks[names.EGO])
    of_event = {name: rows.get(event_id, ()) for name, rows in tables.rows.items()}
    problem = planner.pose(scene, settings)
    boxes = {role: tables.boxes[track.vehicle_id] for role, track in tracks.items()}
    return EventReport(
        event=event,
        v0=scene.v0,
        dt=PERIOD,
        divider=divider,
        markings=_markings(event, tables, divider),
        boxes=boxes,
        others={role: Path(m.x, m.y, m.v, m.a) for role, m in surrounding(scene).items()},
        observed={role: m.observed for role, m in surrounding(scene).items()},
        plays=(*policy_plays(problem, of_event["plans"]), _recorded_play(event, paths)),
        plans=of_event["plans"],
        losses=of_event["losses"],
        fits=of_event["followers"],
        fit_traces=fit_traces(tracks, boxes, of_event["followers"]),
        tracking=of_event["tracking"],
        track_traces=track_traces(problem, of_event["plans"]),
        surface=surface_of(problem, of_event["plans"]),
        provenance=tables.provenance,
    )


def _paths(tracks: Tracks, grid: FloatArray) -> dict[str, Path]:
    return {role: _path(track, grid) for role, track in tracks.items()}


def _path(track: Track, grid: FloatArray) -> Path:
    columns = (track.x, track.y, track.vx, track.ax)
    return Path(*(np.interp(grid, track.t, values, left=np.nan, right=np.nan) for values in columns))


def _divider(event: Row, ego: Track) -> float:
    """y of the crossed marking: where the ego's centre passes between the crossing frame and the one before."""
    period = 1.0 / float(event["frame_rate"])
    crossing = (event["crossing_frame"] - event["start_frame"]) * period
    return float(np.interp(crossing - period / 2.0, ego.t, ego.y))


def _markings(event: Row, tables: RecordingTables, divider: float) -> tuple[float, ...]:
    # Lane n lies between markings n - 1 and n, so lanes n and n + 1 share marking n.
    markings = np.asarray(tables.markings[tables.directions[event["ego_id"]]])
    crossed = min(event["origin_lane"], event["target_lane"])
    return tuple((markings - markings[crossed] + divider).tolist())


def _recorded_play(event: Row, paths: Mapping[str, Path]) -> Play:
    ego = paths[names.EGO]
    ranks = range(1, len(event["follower_ids"]) + 1)
    return Play(
        policy=labels.RECORDED,
        accountings=names.ACCOUNTINGS,
        T=float(event["duration_s"]),
        ego=ego,
        jerk=np.full(ego.x.size, np.nan),
        followers=tuple(paths[names.target_follower(rank)] for rank in ranks),
        measured=True,
    )
