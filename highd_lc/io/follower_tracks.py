"""Followers' tracks between tables and arrays: from event tracks to windows, from windows to rows and back."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from highd_lc.algorithms.following_window import RecordedMotion, following_track
from highd_lc.core.car_following import FollowingTrack
from highd_lc.io import artefacts
from highd_lc.vocab import names

_ROWS = ("leader_x", "leader_v", "x", "v", "a")


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


def recorded_followers(work: Path, recording: int) -> Iterator[RecordedFollower]:
    """Every follower of a recording's events, in the order of the events table."""
    events = artefacts.read(work, "events", recording=recording)
    tracks = artefacts.read(work, "event_tracks", recording=recording)
    vehicles = artefacts.read(work, "vehicles", recording=recording).set_index("vehicle_id")
    motions = {key: rows.sort_values("t") for key, rows in tracks.groupby(["event_id", "role"], sort=False)}
    for event in events.itertuples():
        yield from _followers(event, motions, vehicles)


def _followers(
    event: Any, motions: dict[tuple[str, str], pd.DataFrame], vehicles: pd.DataFrame
) -> Iterator[RecordedFollower]:
    length = vehicles["length"]
    leader, replay_leader = event.target_leader_id, event.ego_id
    leader_role = names.TARGET_LEADER
    for rank, vehicle in enumerate(map(int, event.follower_ids), start=1):
        role = names.target_follower(rank)
        track, leader_length = None, np.nan
        if (event.event_id, leader_role) in motions:
            leader_length = float(length.loc[leader])
            own = motions[event.event_id, role]
            track = following_track(
                _motion(own[own["calibration"]], float(length.loc[vehicle])),
                _motion(motions[event.event_id, leader_role], leader_length),
            )
        yield RecordedFollower(
            event.event_id,
            event.recording_id,
            rank,
            vehicle,
            vehicles["class"].loc[vehicle],
            track,
            leader_length,
            float(length.loc[replay_leader]),
        )
        leader = replay_leader = vehicle
        leader_role = role


def _motion(rows: pd.DataFrame, length: float) -> RecordedMotion:
    return RecordedMotion(*(rows[name].to_numpy(np.float64) for name in ("t", "x", "vx", "ax")), length)


def track_row(track: FollowingTrack) -> dict[str, Any]:
    """A track as the list columns of ``follower_tracks``."""
    return dict(zip(_ROWS, map(np.ndarray.tolist, track.as_array()), strict=True))


def track_of(row: Mapping[str, Any]) -> FollowingTrack:
    """The track of a row of ``follower_tracks``."""
    return FollowingTrack(*(np.asarray(row[name], dtype=np.float64) for name in _ROWS))
