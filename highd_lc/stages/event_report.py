"""One recording's artefacts to the reports of its events: rows as they are, recorded motion on the page's grid."""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from highd_lc.algorithms import planner
from highd_lc.io import artefacts
from highd_lc.io.scenes import Columns, SceneTables, read_scene_tables
from highd_lc.reporting import labels
from highd_lc.reporting.event import Box, EventReport, Path, Play, Row
from highd_lc.stages.event_plays import leads, policy_plays, surrounding
from highd_lc.stages.event_traces import Track, fit_traces, surface_of, track_traces
from highd_lc.vocab import names
from highd_lc.vocab.job import Job
from highd_lc.vocab.scene import Scene
from highd_lc.vocab.settings import ValidateSettings

FloatArray = NDArray[np.float64]
Tracks = Mapping[str, Track]

PERIOD: Final = 0.1
"""Time step of all motions on a page [s]: the planner's, and the finest that a page to be shared may carry."""
_READ: Final = ("plans", "losses", "tracking")


@dataclass(frozen=True)
class RecordingTables:
    """What the artefacts hold of one recording; tracks by event and role, other rows by table and event."""

    scenes: SceneTables
    events: tuple[Row, ...]
    tracks: Mapping[str, Tracks]
    boxes: Mapping[int, Box]
    directions: Mapping[int, int]
    markings: Mapping[int, FloatArray]
    rows: Mapping[str, Mapping[str, tuple[Row, ...]]]
    provenance: tuple[tuple[str, str], ...]


def read_tables(job: Job) -> RecordingTables:
    """Read everything that the pages of a recording's events show."""
    scenes = read_scene_tables(job.work, job.recording, job.settings.validation.planner)
    roads = artefacts.read(job.work, "recordings", recording=job.recording)
    ids, directions = (scenes.vehicles[name].tolist() for name in ("vehicle_id", "driving_direction"))
    rows = {name: _by_event(artefacts.read(job.work, name, recording=job.recording)) for name in _READ}
    return RecordingTables(
        scenes=scenes,
        events=tuple(scenes.events.to_dict("records")),
        tracks=_by_event_and_role(scenes.tracks),
        boxes={vehicle: Box(*size) for vehicle, size in scenes.sizes.items()},
        directions=dict(zip(ids, directions, strict=True)),
        markings=dict(zip(roads["driving_direction"], roads["markings"], strict=True)),
        rows={**rows, "followers": _by_event(scenes.followers)},
        provenance=_provenance(job),
    )


def _by_event(frame: pd.DataFrame) -> dict[str, tuple[Row, ...]]:
    groups: dict[str, list[Row]] = defaultdict(list)
    titles = list(frame.columns)
    # Through an array of objects: value by value, text in arrow's memory costs twenty times as much.
    columns = [frame[title].to_numpy(object).tolist() for title in titles]
    for values in zip(*columns, strict=True):
        row = dict(zip(titles, values, strict=True))
        groups[row["event_id"]].append(row)
    return {event_id: tuple(rows) for event_id, rows in groups.items()}


def _by_event_and_role(tracks: Mapping[tuple[str, ...], Columns]) -> dict[str, dict[str, Track]]:
    grouped: dict[str, dict[str, Track]] = defaultdict(dict)
    for (event_id, role), rows in tracks.items():
        motion = (rows[name] for name in ("t", "x", "y", "vx", "ax"))
        grouped[event_id][role] = Track(int(rows["vehicle_id"][0]), *motion, rows["calibration"])
    return grouped


def _provenance(job: Job) -> tuple[tuple[str, str], ...]:
    source = job.provenance
    inputs = tuple((f"input {name}", digest) for name, digest in sorted(source.inputs.items()))
    return (("code version", source.code), ("settings hash", source.settings), ("seed", str(source.seed)), *inputs)


def event_report(event: Row, tables: RecordingTables, scene: Scene, settings: ValidateSettings) -> EventReport:
    """Everything that the page of an event shows."""
    event_id = str(event["event_id"])
    tracks = tables.tracks[event_id]
    grid = PERIOD * np.arange(round(settings.loss.horizon_s / PERIOD) + 1)
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
        plays=(*policy_plays(problem, of_event["plans"]), _recorded_play(event, tracks, grid)),
        plans=of_event["plans"],
        losses=of_event["losses"],
        fits=of_event["followers"],
        fit_traces=fit_traces(tracks, boxes, of_event["followers"], b_max=settings.followers.b_max),
        tracking=of_event["tracking"],
        track_traces=track_traces(problem, of_event["plans"]),
        surface=surface_of(problem, of_event["plans"]),
        provenance=tables.provenance,
        leads=leads(scene),
    )


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


def _recorded_play(event: Row, tracks: Tracks, grid: FloatArray) -> Play:
    ego = _path(tracks[names.EGO], grid)
    ranks = range(1, len(event["follower_ids"]) + 1)
    return Play(
        policy=labels.RECORDED,
        accountings=names.ACCOUNTINGS,
        T=float(event["duration_s"]),
        ego=ego,
        jerk=np.full(ego.x.size, np.nan),
        followers=tuple(_path(tracks[names.target_follower(rank)], grid) for rank in ranks),
        measured=True,
    )
