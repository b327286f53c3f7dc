"""Extract: a recording's tracks to its lane changes, the funnel of all lane-id changes, and event tracks."""

from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
from numpy.typing import NDArray

from highd_lc.extraction.lane_change import Crossing, RoleRows, find_crossings, role_rows, with_known_lanes
from highd_lc.extraction.lateral_motion import Rule
from highd_lc.extraction.roles import NOBODY
from highd_lc.extraction.track_index import ABSENT, TrackIndex, Traffic
from highd_lc.io import artefacts, highd
from highd_lc.io.formats import format_of, in_words_of
from highd_lc.io.highd import TrackArrays
from highd_lc.vocab import names
from highd_lc.vocab.errors import InputError
from highd_lc.vocab.job import Job, JobReport
from highd_lc.vocab.settings import ExtractSettings
from highd_lc.vocab.tables import TABLES

IntArray = NDArray[np.int64]
FloatArray = NDArray[np.float64]

STAGE = "extract"
# Below this share of events whose roles the recorded leader ids confirm, the ids are wrong, not the geometry.
_LEAST_CONFIRMED, _FEWEST_EVENTS = 0.1, 5
_OF_VEHICLES = ["vehicle_id", "driving_direction", "class", "length"]
_OF_CARRIAGEWAYS = ["driving_direction", "frame_rate", "markings", "entry_m", "exit_m"]


@dataclass(frozen=True)
class _Recording:
    """A recording's arrays; classes: Car or Truck of each vehicle."""

    number: int
    tracks: TrackArrays
    traffic: Traffic
    classes: NDArray[np.object_]


def run(job: Job) -> JobReport:
    """Read the recording's tracks and write the parts ``crossings``, ``events`` and ``event_tracks``.

    Raises InputError, before anything is written, if the recorded leader ids confirm nearly no event's roles.
    """
    recording, settings = _load(job), job.settings.extract
    crossings = find_crossings(
        recording.traffic,
        _rule(settings),
        max_link_m=settings.max_link_m,
        max_followers=settings.max_followers,
    )
    events = [crossing for crossing in crossings if not crossing.reason]
    confirmed = sum(event.known_roles.confirmed for event in events)
    _refuse_unconfirmed(job, confirmed, len(events))
    artefacts.write_part(job, STAGE, "crossings", _table("crossings", _crossing_rows(recording, crossings)))
    artefacts.write_part(job, STAGE, "events", _table("events", _event_rows(recording, events)))
    rows = _write_event_tracks(job, recording, events)
    reasons = Counter(crossing.reason for crossing in crossings if crossing.reason)
    counts = {"crossings": len(crossings), "events": len(events), "roles_confirmed": confirmed}
    return JobReport({**counts, "event_rows": rows, **reasons})


def _refuse_unconfirmed(job: Job, confirmed: int, n_events: int) -> None:
    """Ingest compares every vehicle's ids; those of the few around a lane change may be wrong all the same."""
    if n_events >= _FEWEST_EVENTS and confirmed < _LEAST_CONFIRMED * n_events:
        found, wrong = format_of(job.data, job.settings.ingest.format), n_events - confirmed
        path = found.input_files(job.data, job.recording)[2]
        text = f"names others than the vehicles ahead in {wrong} of {n_events} lane changes"
        raise InputError(f"{path}: column {in_words_of(found, 'precedingId')!r}: {text}")


def _load(job: Job) -> _Recording:
    tracks = highd.read(job.work, job.recording)
    vehicles = artefacts.read_part(job.work, "ingest", "vehicles", job.recording, columns=_OF_VEHICLES)
    carriageways = artefacts.read_part(job.work, "ingest", "recordings", job.recording, columns=_OF_CARRIAGEWAYS)
    trim = job.settings.ingest.trim_ends_m
    traffic = Traffic(
        index=TrackIndex.of(tracks.vehicle_id, tracks.frame),
        x=tracks.x,
        y=tracks.y,
        vy=tracks.vy,
        lane=tracks.lane,
        leader_id=tracks.leader_id,
        ids=vehicles["vehicle_id"].to_numpy(),
        direction=vehicles["driving_direction"].to_numpy(),
        length=vehicles["length"].to_numpy(),
        markings=dict(zip(carriageways["driving_direction"], carriageways["markings"], strict=True)),
        entry=_by_direction(carriageways, "entry_m") + trim,
        stop=_by_direction(carriageways, "exit_m") - trim,
        rate=float(carriageways["frame_rate"].iloc[0]),
    )
    known = with_known_lanes(traffic, job.settings.extract.flicker_s)
    return _Recording(job.recording, tracks, known, vehicles["class"].to_numpy())


def _by_direction(carriageways: pd.DataFrame, column: str) -> FloatArray:
    values = np.full(3, np.nan)
    values[carriageways["driving_direction"]] = carriageways[column]
    return values


def _rule(settings: ExtractSettings) -> Rule:
    return Rule(
        smoothing_s=settings.smoothing_s,
        speed=settings.lateral_speed_mps,
        acceleration=settings.lateral_acceleration_mps2,
        persistence_s=settings.persistence_s,
        clearance_m=settings.clearance_m,
        rest_s=settings.rest_s,
        flicker_s=settings.flicker_s,
        min_shift_m=settings.min_shift_m,
    )


def _table(name: str, rows: list[dict[str, object]]) -> pd.DataFrame:
    return pd.DataFrame(rows, columns=list(TABLES[name].column_names), dtype=object)


def _event_id(recording: _Recording, crossing: Crossing) -> str:
    return f"{recording.number:02d}-{recording.traffic.ids[crossing.ego]:04d}-{crossing.crossing_frame:05d}"


def _crossing_rows(recording: _Recording, crossings: list[Crossing]) -> list[dict[str, object]]:
    return [
        {
            **_identity(recording, crossing),
            "speed_mps": _speed(recording, crossing),
            "origin_lane": crossing.change.origin or None,
            "target_lane": crossing.change.target or None,
            "start_frame": None if crossing.start_frame == ABSENT else crossing.start_frame,
            "end_frame": None if crossing.end_frame == ABSENT else crossing.end_frame,
            "usable": not crossing.reason,
            "reason": crossing.reason,
        }
        for crossing in crossings
    ]


def _speed(recording: _Recording, crossing: Crossing) -> float:
    row = recording.traffic.index.row(crossing.ego, crossing.crossing_frame)
    return round(float(recording.tracks.vx[row]), 4)


def _identity(recording: _Recording, crossing: Crossing) -> dict[str, object]:
    return {
        "event_id": _event_id(recording, crossing),
        "recording_id": recording.number,
        "ego_id": int(recording.traffic.ids[crossing.ego]),
        "ego_class": recording.classes[crossing.ego],
        "direction": _direction(crossing),
        "crossing_frame": crossing.crossing_frame,
    }


def _direction(crossing: Crossing) -> str:
    if not (crossing.change.origin and crossing.change.target):
        return ""
    return names.LEFT if crossing.change.target > crossing.change.origin else names.RIGHT


def _event_rows(recording: _Recording, events: list[Crossing]) -> list[dict[str, object]]:
    return [
        {**_identity(recording, event), **_motion(recording, event), **_roles(recording, event)}
        for event in events
    ]


def _motion(recording: _Recording, event: Crossing) -> dict[str, object]:
    traffic, change = recording.traffic, event.change
    first = traffic.index.span(event.ego).start
    shift = traffic.y[first + change.end] - traffic.y[first + change.start]
    return {
        "origin_lane": change.origin,
        "target_lane": change.target,
        "start_frame": event.start_frame,
        "end_frame": event.end_frame,
        "frame_rate": traffic.rate,
        "duration_s": (event.end_frame - event.start_frame) / traffic.rate,
        "lateral_shift_m": _snapped(shift),
        "peak_lateral_speed_mps": change.peak_speed,
    }


def _roles(recording: _Recording, event: Crossing) -> dict[str, object]:
    roles, traffic = event.known_roles, recording.traffic
    changes = [(later.frame - event.start_frame) / traffic.rate for later in event.successors]
    later_ids = [_id(recording, later.vehicle) for later in event.successors]
    return {
        "gap_ahead_m": _gap(traffic, event.start_frame, roles.target_leader, event.ego),
        "gap_behind_m": _gap(traffic, event.start_frame, event.ego, roles.followers[0]),
        "origin_leader_id": _id(recording, roles.origin_leader),
        "origin_follower_id": _id(recording, roles.origin_follower),
        "target_leader_id": _id(recording, roles.target_leader),
        "follower_ids": [int(traffic.ids[follower]) for follower in roles.followers],
        "roles_confirmed": roles.confirmed,
        "leader_leaves_s": changes[0] if changes else float("nan"),
        "leader_changes_s": changes,
        "later_leader_ids": [vehicle for vehicle in later_ids if vehicle is not None],
    }


def _gap(traffic: Traffic, frame: int, ahead: int, behind: int) -> float:
    """Bumper-to-bumper gap between two vehicles [m], NaN without a vehicle ahead."""
    if ahead == NOBODY:
        return float("nan")
    x_ahead, x_behind = (traffic.x[traffic.index.row(vehicle, frame)] for vehicle in (ahead, behind))
    return float(_snapped(x_ahead - x_behind - (traffic.length[ahead] + traffic.length[behind]) / 2))


def _id(recording: _Recording, vehicle: int) -> int | None:
    return None if vehicle == NOBODY else int(recording.traffic.ids[vehicle])


def _snapped(values: NDArray[Any]) -> FloatArray:
    """To the grid of 1e-4, so that a mirrored recording gives the same numbers; never -0.

    Undoes the rounding of positions in sums and of speeds in the tracks artefact: HighD's values have a grid of
    0.01, the halves of its lengths one of 0.005.
    """
    exact: FloatArray = values.astype(np.float64)
    return np.round(exact, 4) + 0.0


def _write_event_tracks(job: Job, recording: _Recording, events: list[Crossing]) -> int:
    """Write the part ``event_tracks``, ordered by event, role and time."""
    horizon = job.settings.extract.horizon_s
    pieces = sorted(
        (
            (event, part)
            for event in events
            for part in role_rows(recording.traffic, event, event.known_roles, horizon_s=horizon)
        ),
        key=lambda piece: (_event_id(recording, piece[0]), piece[1].role),
    )
    columns = _event_track_columns(recording, pieces)
    path = artefacts.part_folder(job.work, STAGE, job.recording) / "event_tracks.parquet"
    return artefacts.write_columns(path, "event_tracks", columns, job.provenance)


def _event_track_columns(recording: _Recording, pieces: list[tuple[Crossing, RoleRows]]) -> dict[str, pa.Array]:
    traffic, tracks = recording.traffic, recording.tracks
    spans = [part.rows for _, part in pieces]
    sizes = np.array([span.stop - span.start for span in spans], dtype=np.int64)
    of_piece = np.repeat(np.arange(len(pieces)), sizes)
    starts = np.array([event.start_frame for event, _ in pieces], dtype=np.int64)
    origins = np.array([traffic.index.row(event.ego, event.start_frame) for event, _ in pieces], dtype=np.int64)
    relative = {
        name: _snapped(_joined(values, spans) - np.repeat(values[origins], sizes))
        for name, values in (("x", tracks.x), ("y", tracks.y))
    }
    columns = {
        **relative,
        **{name: _snapped(_joined(getattr(tracks, name), spans)) for name in ("vx", "vy", "ax", "ay")},
        "vehicle_id": _joined(tracks.vehicle_id, spans),
        "recording_id": np.full(len(of_piece), recording.number),
        "t": (_joined(tracks.frame, spans) - np.repeat(starts, sizes)) / traffic.rate,
        "calibration": _calibration(pieces, sizes),
    }
    return {
        **{name: pa.array(values) for name, values in columns.items()},
        "event_id": _repeated([_event_id(recording, event) for event, _ in pieces], of_piece),
        "role": _repeated([part.role for _, part in pieces], of_piece),
    }


def _joined(values: FloatArray | IntArray, spans: list[slice]) -> FloatArray | IntArray:
    return np.concatenate([values[span] for span in spans]) if spans else values[:0]


def _calibration(pieces: list[tuple[Crossing, RoleRows]], sizes: IntArray) -> NDArray[np.bool_]:
    chosen = np.zeros(int(sizes.sum()), dtype=bool)
    for (_, part), first in zip(pieces, np.cumsum(sizes) - sizes, strict=True):
        shift = int(first) - part.rows.start
        chosen[part.calibration.start + shift : part.calibration.stop + shift] = bool(part.calibration.stop)
    return chosen


def _repeated(words: list[str], of_piece: IntArray) -> pa.Array:
    return pa.array(words, type=pa.string()).take(pa.array(of_piece))
