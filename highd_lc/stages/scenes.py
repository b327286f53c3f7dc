"""Scenes of a recording: from events, event tracks, vehicles and fitted followers to the planner's arrays.

Followers' tracks between tables and arrays: from event tracks to windows, from windows to rows and back.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from highd_lc.core.car_following import FollowingTrack
from highd_lc.core.drive import UNBOUNDED, drive_behind
from highd_lc.core.kinematics import hermite, local_polynomial
from highd_lc.core.losses import command_jerk
from highd_lc.drivers.calibration import RecordedMotion, following_track
from highd_lc.extraction.track_index import unbroken
from highd_lc.io import artefacts
from highd_lc.planning.scene import Followers, Human, Motion, NextLeader, Scene, leaders_of
from highd_lc.stages.scene_drivers import Columns, driven, grouped, read_drivers
from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS, TABLE3_MEANS
from highd_lc.vocab.settings import PlannerSettings, ValidateSettings

FloatArray = NDArray[np.float64]

TIME_STEP = 0.1
"""Step of the planner's time grid [s] (equations.md 2)."""
_TRACK_COLUMNS = ["t", "x", "y", "vx", "vy", "ax", "ay", "vehicle_id", "calibration"]


@dataclass(frozen=True)
class SceneTables:
    """What the scenes of a recording are made from, for those who read the same tables too.

    events, vehicles, followers: as read; tracks: of each event and role, its rows of ``event_tracks``; sizes:
    length and width of each vehicle [m]; drivers: by follower model, the default one first, of each event what of
    its followers a scene needs, nearest first.
    """

    events: pd.DataFrame
    vehicles: pd.DataFrame
    followers: pd.DataFrame
    tracks: dict[tuple[str, ...], Columns]
    sizes: dict[int, tuple[float, float]]
    drivers: dict[str, dict[tuple[str, ...], Columns]]


def scene_makers(tables: SceneTables, settings: ValidateSettings) -> Iterator[tuple[str, Callable[[], Scene]]]:
    """Each event's id, in the order of the events table, with what makes its scene, of the default follower model.

    A scene that cannot be made does not stand in the others' way.
    """
    events: Iterable[Any] = tables.events.itertuples()
    for event in events:
        yield event.event_id, partial(make_scene, event, tables, settings)


def of_own_fits(settings: ValidateSettings) -> ValidateSettings:
    """The settings with everybody driven by his own fit: for who has nothing but fits."""
    own = settings.followers.model_copy(update={"model": names.OWN_FIT, "also": ()})
    planner = settings.planner.model_copy(update={"parameters": "fitted"})
    return settings.model_copy(update={"followers": own, "planner": planner})


def read_scene_tables(
    work: Path,
    recording: int,
    settings: ValidateSettings,
    *,
    fits: pd.DataFrame | None = None,
    also: tuple[str, ...] = (),
) -> SceneTables:
    """Read what the scenes of a recording are made from.

    fits: its rows of ``followers``, where the artefact does not exist yet; they are its only follower model then.
    also: follower models that plan nothing.
    Raises ArtefactError if an artefact is missing, or does not hold a follower model of the settings.
    """
    rows = artefacts.read(work, "event_tracks", recording=recording)
    vehicles = artefacts.read(work, "vehicles", recording=recording)
    followers = artefacts.read(work, "followers", recording=recording) if fits is None else fits
    models = dict.fromkeys((*settings.follower_models, *also)) if fits is None else (names.OWN_FIT,)
    events = artefacts.read(work, "events", recording=recording)
    sizes = zip(vehicles["length"], vehicles["width"], strict=True)
    return SceneTables(
        events=events,
        vehicles=vehicles,
        followers=followers,
        tracks=grouped("event_tracks", rows, by=["event_id", "role"], order="t", columns=_TRACK_COLUMNS),
        sizes=dict(zip(vehicles["vehicle_id"].tolist(), sizes, strict=True)),
        drivers={model: read_drivers(work, recording, followers, model) for model in models},
    )


def make_scene(event: Any, tables: SceneTables, settings: ValidateSettings) -> Scene:
    """The scene of an event, a row of ``events``, its followers driven by the default model."""
    ego = _rows(event, names.EGO, tables)
    assert ego is not None, "extraction writes rows of the ego of every event"
    start = int(np.searchsorted(ego["t"], -1e-9))
    length, width = tables.sizes[event.ego_id]
    target_leader = _leader(event, names.TARGET_LEADER, tables, settings)
    return Scene(
        event_id=event.event_id,
        v0=float(ego["vx"][start]),
        a0=float(ego["ax"][start]),
        lateral_shift=float(event.lateral_shift_m),
        length=length,
        width=width,
        wheelbase=settings.tracking.wheelbase_ratio * length,
        dt=TIME_STEP,
        horizon=settings.loss.horizon_s,
        target_leader=target_leader,
        origin_leader=_leader(event, names.ORIGIN_LEADER, tables, settings),
        origin_follower=_leader(event, names.ORIGIN_FOLLOWER, tables, settings),
        followers=_followers(event, tables, target_leader, length, settings),
        human=_human(event, ego, settings.planner),
        next_leaders=tuple(_next_leaders(event, tables, settings)),
    )


def _rows(event: Any, role: str, tables: SceneTables, around: float = 0.0) -> Columns | None:
    """The rows of a role without a break around a time [s]; None without any. Nothing is told of what lies beyond
    a hole.
    """
    track = tables.tracks.get((event.event_id, role))
    if track is None:
        return None
    frame = np.rint(track["t"] * float(event.frame_rate)).astype(np.int64)
    sample = min(int(np.searchsorted(track["t"], around - 1e-9)), len(frame) - 1)
    first, last = unbroken(frame, sample)
    return track if last - first + 1 == len(frame) else {name: v[first : last + 1] for name, v in track.items()}


def _grid(horizon: float) -> FloatArray:
    return np.arange(round(horizon / TIME_STEP) + 1, dtype=np.float64) * TIME_STEP


def _leader(event: Any, role: str, tables: SceneTables, settings: ValidateSettings) -> Motion | None:
    track = _rows(event, role, tables)
    if track is None or track["t"][-1] < 0.0:
        return None
    motion = _motion(track, tables.sizes[int(track["vehicle_id"][0])], settings.loss.horizon_s)
    if settings.planner.leaders == "recorded":
        return motion
    return _predicted(motion, free_road=settings.planner.leaders == "lcm")


def _next_leaders(event: Any, tables: SceneTables, settings: ValidateSettings) -> Iterator[NextLeader]:
    """Who leads the target lane after its leader left it; nobody is foreseen where leaders are predicted."""
    if settings.planner.leaders != "recorded":
        return
    before = _rows(event, names.TARGET_LEADER, tables)
    for place, change in enumerate(event.leader_changes_s):
        since = int(np.ceil(change / TIME_STEP - 1e-6))
        if before is None or change > before["t"][-1] + 1e-9 or since > round(settings.loss.horizon_s / TIME_STEP):
            return
        before = _rows(event, names.target_leader(place + 2), tables, change)
        motion = None
        if before is not None:
            motion = _motion(before, tables.sizes[int(before["vehicle_id"][0])], settings.loss.horizon_s)
        yield NextLeader(since, motion)


def _motion(track: Columns, size: tuple[float, float], horizon: float) -> Motion:
    """Recorded while in view, then at the last recorded speed, and before that at the first one."""
    grid, t = _grid(horizon), track["t"]
    observed = max(1, int(np.searchsorted(grid, t[-1] + 1e-9, side="right")))
    seen = np.clip(grid[:observed], t[0], t[-1])
    unseen = grid[observed:] - t[-1]
    columns = {}
    for position, speed in (("x", "vx"), ("y", "vy")):
        recorded = hermite(t, track[position], track[speed], seen) if len(t) > 1 else track[position][:1]
        ahead = float(position == "x")
        earlier = ahead * track[speed][0] * (grid[:observed] - seen) * (grid[:observed] < t[0])
        later = track[position][-1] + ahead * track[speed][-1] * unseen
        columns[position] = np.concatenate([recorded + earlier, later])
    v = np.concatenate([np.interp(seen, t, track["vx"]), np.full(len(unseen), track["vx"][-1])])
    a = np.concatenate([np.interp(seen, t, track["ax"]), np.zeros(len(unseen))])
    return Motion(columns["x"], columns["y"], v, a, *size, observed=observed)


def recorded_motions(event: Any, tables: SceneTables, horizon: float) -> Iterator[tuple[str, int, Motion]]:
    """Each role of an event with its recorded motion over 0 .. horizon [s], and the first sample that was seen.

    The last one is ``observed`` - 1.
    """
    later = {names.target_leader(place): change for place, change in enumerate(event.leader_changes_s, start=2)}
    followers = (names.target_follower(rank + 1) for rank in range(len(event.follower_ids)))
    for role in (names.EGO, names.ORIGIN_LEADER, names.ORIGIN_FOLLOWER, names.TARGET_LEADER, *later, *followers):
        track = _rows(event, role, tables, later.get(role, 0.0))
        if track is not None and track["t"][-1] >= 0.0:
            first = max(0, int(np.ceil(track["t"][0] / TIME_STEP - 1e-6)))
            yield role, first, _motion(track, tables.sizes[int(track["vehicle_id"][0])], horizon)


def _predicted(motion: Motion, *, free_road: bool) -> Motion:
    """The same vehicle from its state at t_start: at constant speed, or by LCM on a free road (Table 3 means)."""
    samples = len(motion.x)
    v = np.full(samples, motion.v[0])
    if free_road:
        nobody, driver = (np.full(samples, np.inf), np.zeros(samples)), TABLE3_MEANS.as_array()
        _, v = drive_behind(0.0, float(motion.v[0]), *nobody, driver, UNBOUNDED, TIME_STEP)
    x = motion.x[0] + np.concatenate([[0.0], np.cumsum(v[1:])]) * TIME_STEP
    a = np.gradient(v, TIME_STEP)
    return Motion(x, np.full(samples, motion.y[0]), v, a, motion.length, motion.width, observed=1)


def _followers(
    event: Any,
    tables: SceneTables,
    target_leader: Motion | None,
    ego_length: float,
    settings: ValidateSettings,
) -> Followers:
    """Where the followers are, driven by the default model."""
    model, drivers = next(iter(tables.drivers.items()))
    recorded, sizes = [], []
    for rank in drivers[event.event_id,]["follower"]:
        track = _rows(event, names.target_follower(rank), tables)
        assert track is not None, "extraction writes rows of every follower"
        sizes.append(tables.sizes[int(track["vehicle_id"][0])])
        recorded.append(_motion(track, sizes[-1], settings.loss.horizon_s))
    length, width = np.array(sizes).T
    unknown = np.full((len(length), len(PARAMETERS)), np.nan)
    parked = Followers(
        x=np.array([m.x[0] for m in recorded]),
        y=np.array([m.y[0] for m in recorded]),
        v=np.array([m.v[0] for m in recorded]),
        length=length,
        width=width,
        parameters=unknown,
        L_no_change=np.nan,
        recorded=tuple(recorded),
    )
    return driven(parked, drivers[event.event_id,], model, ego_length, target_leader)


def driven_by(scene: Scene, model: str, tables: SceneTables) -> Scene:
    """The scene with its followers driven by another follower model, one of ``tables.drivers``."""
    drivers = tables.drivers[model][scene.event_id,]
    followers = driven(scene.followers, drivers, model, scene.length, scene.target_leader)
    return replace(scene, followers=followers)


def _human(event: Any, ego: Columns, settings: PlannerSettings) -> Human:
    """The recorded path, smoothed by a local cubic (Savitzky-Golay), and its derivatives at the grid's samples, as
    long as the ego is in view.
    """
    rate = float(event.frame_rate)
    end = round(event.duration_s / TIME_STEP)
    grid = np.arange(max(end, int(ego["t"][-1] / TIME_STEP + 1e-6)) + 1) * TIME_STEP
    smooth = {}
    for axis in ("x", "y"):
        derivatives = local_polynomial(ego[axis], rate, window_s=settings.human_smoothing_s, order=3)
        for prefix, values in zip(("", "v", "a", "j"), derivatives, strict=True):
            smooth[prefix + axis] = np.interp(grid, ego["t"], values)
    to_T = grid[: end + 1]
    raw = sum(command_jerk(np.interp(to_T, ego["t"], ego[a]), TIME_STEP).sum() for a in ("ax", "ay"))
    crossing = round((event.crossing_frame - event.start_frame) / rate / TIME_STEP)
    return Human(**smooth, crossing=int(crossing), comfort_raw=float(raw), end=end)


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
    rows_of_events: Iterable[Any] = events.itertuples()
    for event in rows_of_events:
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


def surrounding(scene: Scene) -> dict[str, Motion]:
    """The vehicles that no policy moves, by role."""
    behind = {} if scene.origin_follower is None else {names.ORIGIN_FOLLOWER: scene.origin_follower}
    return leaders_of(scene) | behind


def leads(scene: Scene) -> tuple[tuple[int, str], ...]:
    """From which sample on which role leads the target lane; empty = nobody."""
    if scene.target_leader is None:
        return ()
    later = enumerate(scene.next_leaders, start=2)
    found = [(one.since, "" if one.motion is None else names.target_leader(rank)) for rank, one in later]
    return ((0, names.TARGET_LEADER), *found)
