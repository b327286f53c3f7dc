"""Followers' tracks between tables and arrays: from event tracks to windows, from windows to rows and back."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from highd_lc.algorithms.following_window import RecordedMotion, following_track
from highd_lc.core.car_following import FollowingTrack
from highd_lc.io import artefacts
from highd_lc.vocab import names

FloatArray = NDArray[np.float64]

_ROWS = ("leader_x", "leader_v", "x", "v", "a")
_MOTION, _WINDOW = ("t", "x", "vx", "ax"), "calibration"


@dataclass(frozen=True)
class RecordedFollower:
    """A follower of an event. rank: 1 = nearest to the ego; track: its calibration window, None without a leader;
    leader_length: of the leader of that window, NaN without one; replay_leader_length: of the vehicle that it
    follows in a replay, the ego or the follower before it [m].
    """

    event_id: str
    recording_id: int
    rank: int
    vehicle_id: int
    vehicle_class: str
    track: FollowingTrack | None
    leader_length: float
    replay_leader_length: float


@dataclass(frozen=True)
class _Tables:
    """A recording's motions by event and role (see ``_motions``), and each vehicle's class and length."""

    motions: dict[tuple[str, str], FloatArray]
    vehicles: dict[int, tuple[str, float]]

    def motion(self, event_id: str, role: str, vehicle: int, *, window: bool) -> RecordedMotion:
        """The motion of a role, all of it or its calibration window."""
        rows = self.motions[event_id, role]
        t, x, v, a = rows[:-1, rows[-1] > 0] if window else rows[:-1]
        return RecordedMotion(t, x, v, a, self.vehicles[vehicle][1])


def recorded_followers(work: Path, recording: int) -> Iterator[RecordedFollower]:
    """Every follower of a recording's events, in the order of the events table."""
    columns = ["event_id", "recording_id", "ego_id", "target_leader_id", "follower_ids"]
    events = artefacts.read(work, "events", recording=recording, columns=columns)
    vehicles = artefacts.read(work, "vehicles", recording=recording, columns=["vehicle_id", "class", "length"])
    rows = artefacts.read(
        work, "event_tracks", recording=recording, columns=["event_id", "role", *_MOTION, _WINDOW]
    )
    about = zip(vehicles["class"], vehicles["length"].tolist(), strict=True)
    tables = _Tables(_motions(rows), dict(zip(vehicles["vehicle_id"].tolist(), about, strict=True)))
    for event in events.itertuples():
        for rank in range(1, len(event.follower_ids) + 1):
            yield _recorded_follower(event, rank, tables)


def _recorded_follower(event: Any, rank: int, tables: _Tables) -> RecordedFollower:
    chain = [event.target_leader_id, *map(int, event.follower_ids)]
    leader, vehicle = chain[rank - 1], chain[rank]
    leader_role = names.TARGET_LEADER if rank == 1 else names.target_follower(rank - 1)
    track, leader_length = None, np.nan
    if (event.event_id, leader_role) in tables.motions:
        leader_motion = tables.motion(event.event_id, leader_role, leader, window=False)
        own = tables.motion(event.event_id, names.target_follower(rank), vehicle, window=True)
        track, leader_length = following_track(own, leader_motion), leader_motion.length
    return RecordedFollower(
        event.event_id,
        event.recording_id,
        rank,
        vehicle,
        tables.vehicles[vehicle][0],
        track,
        leader_length,
        tables.vehicles[event.ego_id if rank == 1 else leader][1],
    )


def _motions(tracks: pd.DataFrame) -> dict[tuple[str, str], FloatArray]:
    """Rows of each event and role: t, x, vx, ax and whether they calibrate, shape (5, n), ascending in t.

    The artefact is ordered by event, role and t, so that each is a run of rows.
    """
    values = tracks[[*_MOTION, _WINDOW]].to_numpy(np.float64).T
    event, role = tracks["event_id"].to_numpy(), tracks["role"].to_numpy()
    change = (event[1:] != event[:-1]) | (role[1:] != role[:-1])
    starts = np.concatenate([[0], np.flatnonzero(change) + 1]) if len(event) else np.empty(0, dtype=np.int64)
    ends = [*starts[1:], len(event)]
    return {(event[i], role[i]): values[:, i:end] for i, end in zip(starts, ends, strict=False)}


def track_row(track: FollowingTrack) -> dict[str, Any]:
    """A track as the list columns of ``follower_tracks``."""
    return dict(zip(_ROWS, map(np.ndarray.tolist, track.as_array()), strict=True))


def track_of(row: Mapping[str, Any]) -> FollowingTrack:
    """The track of a row of ``follower_tracks``."""
    return FollowingTrack(*(np.asarray(row[name], dtype=np.float64) for name in _ROWS))
