"""One recording's artefacts to the reports of its events: rows as they are, recorded motion on the page's grid.

What lies behind an event's tables, computed again for drawing: loss surface, fits, tracking.

What the policies did in an event, replayed from the tabulated plans for drawing.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any, Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from highd_lc.core.car_following import TIME_STEP, simulate
from highd_lc.core.drive import hardest_braking
from highd_lc.core.quintic import Quintic
from highd_lc.drivers.calibration import RecordedMotion, following_track
from highd_lc.io import artefacts
from highd_lc.planning import planner
from highd_lc.planning.pareto import BLOCKERS, ON_SURFACE, SurfacePoint, loss_surface
from highd_lc.planning.planner import FORM_OF, PlanningProblem
from highd_lc.planning.replay import AvMotion, box_centre, drive_on, follow, human_motion, joins, plan_motion
from highd_lc.planning.scene import PackedScene, Scene
from highd_lc.planning.start_planner import key_of, replay_start
from highd_lc.planning.starts import Key, StartProblem, pose_starts
from highd_lc.reporting import labels
from highd_lc.reporting.event import Box, EventReport, FitTrace, Ground, Path, Play, Row, Surface, TrackTrace
from highd_lc.stages.closed_loop import DRIVES, MOTIONS, REPLANS, loop_plays
from highd_lc.stages.other_pages import OtherRows
from highd_lc.stages.road_images import grounds
from highd_lc.stages.scene_drivers import Columns
from highd_lc.stages.scenes import SceneTables, leads, read_scene_tables, surrounding
from highd_lc.stages.trajectories import prediction_trace
from highd_lc.tracking.closed_loop import Controller, controller, errors_and_inputs
from highd_lc.tracking.plan_tracking import plan_reference
from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS
from highd_lc.vocab.job import Job
from highd_lc.vocab.policy import POLICIES
from highd_lc.vocab.settings import ValidateSettings
from highd_lc.vocab.tables.prediction import RECORDED
from highd_lc.vocab.tracking import KINEMATIC, TrackingSettings

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Track:
    """A vehicle's recorded rows in an event, native frames: t [s] ascending, x, y [m], vx [m/s], ax [m/s^2], and
    whether a row belongs to the calibration window; each of shape (n,).
    """

    vehicle_id: int
    t: FloatArray
    x: FloatArray
    y: FloatArray
    vx: FloatArray
    ax: FloatArray
    calibration: NDArray[np.bool_]


Tracks = Mapping[str, Track]


def surface_of(problem: PlanningProblem, plans: Iterable[Row]) -> Surface:
    """The fixed form's loss surface about the plans' points, for drawing."""
    drawn = loss_surface(problem, tuple(_points(problem, plans)))
    losses = drawn.loss_av, drawn.loss_hv
    return Surface(drawn.T, drawn.x_offset, *losses, drawn.feasible, drawn.blocked, BLOCKERS)


def _points(problem: PlanningProblem, plans: Iterable[Row]) -> Iterator[SurfacePoint]:
    for row in plans:
        if row["policy"] in ON_SURFACE and np.isfinite(row["T"]):
            offset = row["x_final"] - problem.scene.v0 * row["T"]
            yield SurfacePoint(row["policy"], row["accounting"], row["T"], offset)


def fit_traces(
    tracks: Tracks, boxes: Mapping[str, Box], fits: Iterable[Row], *, b_max: float
) -> dict[int, FitTrace]:
    """Recorded against simulated car following of each fitted follower, by its rank. b_max: as in the settings."""
    return {
        row["follower"]: _fit_trace(tracks, boxes, row, b_max) for row in fits if row["status"] == names.FITTED
    }  # fmt: skip


def _fit_trace(tracks: Tracks, boxes: Mapping[str, Box], fit: Row, b_max: float) -> FitTrace:
    rank = fit["follower"]
    role = names.target_follower(rank)
    ahead = names.TARGET_LEADER if rank == 1 else names.target_follower(rank - 1)
    own, leader = tracks[role], tracks[ahead]
    follower = _recorded(own, own.calibration, boxes[role])
    recorded = following_track(follower, _recorded(leader, slice(None), boxes[ahead]))
    parameters = np.array([fit[name] for name in PARAMETERS], dtype=float)
    simulated = simulate(recorded, parameters, hardest=hardest_braking(b_max))
    last = np.floor(min(follower.t[-1], leader.t[-1]) / TIME_STEP + 1e-6)
    return FitTrace(
        t=(last - np.arange(recorded.x.size)[::-1]) * TIME_STEP,
        spacing_recorded=recorded.spacing,
        spacing_simulated=recorded.leader_x - simulated.x,
        speed_recorded=recorded.v,
        speed_simulated=simulated.v,
    )


def _recorded(track: Track, rows: NDArray[np.bool_] | slice, box: Box) -> RecordedMotion:
    return RecordedMotion(track.t[rows], track.x[rows], track.vx[rows], track.ax[rows], box.length)


def track_traces(problem: PlanningProblem, plans: Iterable[Row]) -> tuple[TrackTrace, ...]:
    """The MPC's errors and inputs on each planned policy of the primary accounting, on the kinematic car."""
    chosen = [r for r in plans if r["accounting"] == names.PRIMARY_ACCOUNTING and r["status"] == names.SOLVED]
    # Policies often find the same plan, and driving it is the dearest part of a page.
    driven: dict[tuple[float, ...], TrackTrace] = {}
    traces = []
    for row in (r for r in chosen if r["policy"] in FORM_OF):
        shape = (row["T"], row["x_final"], row["v_end"])
        if shape not in driven:
            driven[shape] = _track_trace(problem, row["policy"], *shape)
        traces.append(replace(driven[shape], policy=row["policy"]))
    return tuple(traces)


def _track_trace(problem: PlanningProblem, policy: str, T: float, x_final: float, v_end: float) -> TrackTrace:
    scene = problem.scene
    plan = Quintic(v0=scene.v0, D=scene.lateral_shift, T=T, x_final=x_final, v_end=v_end)
    settings = problem.settings.tracking
    shared = _controller(settings, scene.dt)
    reference = plan_reference(plan, scene.dt)
    driven = errors_and_inputs(reference, wheelbase=scene.wheelbase, settings=settings, shared=shared)
    errors, inputs, states = driven
    return TrackTrace(
        policy=policy,
        plant=KINEMATIC,
        t=scene.dt * np.arange(len(errors), dtype=np.float64),
        lateral=errors[:, 1],
        longitudinal=errors[:, 0],
        v=inputs[:, 0],
        delta=inputs[:, 1],
        path=_driven_path(states, inputs[:, 0], scene),
    )


def _driven_path(states: FloatArray, v: FloatArray, scene: Scene) -> Path:
    """The box centre's motion of a car whose rear axle has these x, y and headings. v: its speed [m/s]."""
    half, heading = scene.wheelbase / 2.0, states[:, 2]
    x = states[:, 0] + half * (np.cos(heading) - 1.0)
    return Path(x, states[:, 1] + half * np.sin(heading), v, np.gradient(v, scene.dt))


@cache
def _controller(settings: TrackingSettings, dt: float) -> Controller:
    """One controller for all plans of a process: every step overwrites its memory."""
    return controller(settings, dt)


Three = tuple[FloatArray, FloatArray, FloatArray]
Driven = tuple[AvMotion, Three]
"""The AV's motion, and the followers' x [m], v [m/s], a [m/s^2], each of shape (p, N + 1)."""


def policy_plays(problem: PlanningProblem, plans: Iterable[Row]) -> Iterator[Play]:
    """The motions behind an event's rows of ``plans``; rows with the same plan share one."""
    groups = _accountings_of(plans)
    posed = pose_starts(problem) if any(POLICIES[key[0]].chooses_start for key in groups) else None
    # Policies often find the same plan: it is driven once. Human and "no lane change" drive something else.
    driven: dict[tuple[Any, ...], Play] = {}
    for (policy, *shape, delay_s, v_start, gap), accountings in groups.items():
        of = policy if policy in (names.HUMAN, names.NO_LANE_CHANGE) else ""
        motion = (of, *shape, delay_s, v_start, gap)
        if motion not in driven:
            if POLICIES[policy].chooses_start and posed is not None:
                run = _delayed(posed, key_of(posed, gap, delay_s), v_start, *shape)
            else:
                run = _replayed(problem, policy, *shape)
            driven[motion] = play_of(problem, policy, *run, delay_s=delay_s)
        yield replace(driven[motion], policy=policy, accountings=tuple(accountings))


def _accountings_of(plans: Iterable[Row]) -> dict[tuple[Any, ...], list[str]]:
    """The accountings that led to each policy and plan (T, x_final, v_end, delay_s, v_start, gap)."""
    groups: dict[tuple[Any, ...], list[str]] = {}
    for row in plans:
        # A start without delay into the recorded gap is the play of the policy that it contains: pages stay small.
        starts_at_once = row["delay_s"] == 0.0 and row["gap"] == names.RECORDED_GAP
        if POLICIES[row["policy"]].chooses_start and starts_at_once:
            continue
        if row["status"] in (names.SOLVED, names.REFERENCE, names.CONTACT):
            key = tuple(row[name] for name in ("policy", "T", "x_final", "v_end", "delay_s", "v_start", "gap"))
            groups.setdefault(key, []).append(row["accounting"])
    return groups


def _delayed(posed: StartProblem, key: Key, v_start: float, T: float, x_final: float, v_end: float) -> Driven:
    D = posed.problem.scene.lateral_shift
    played = replay_start(posed, key, Quintic(v0=v_start, D=D, T=T, x_final=x_final, v_end=v_end))
    return played.av, (played.x, played.v, played.a)


def _replayed(problem: PlanningProblem, policy: str, T: float, x_final: float, v_end: float) -> Driven:
    if policy == names.NO_LANE_CHANGE:
        av, *followers = planner.unchanged_motion(problem)
        return av, (followers[0], followers[1], followers[2])
    if policy == names.HUMAN:
        return _driven(human_motion(problem.scene.driver, problem.packed), problem.packed)
    quintic = Quintic(v0=problem.scene.v0, D=problem.scene.lateral_shift, T=T, x_final=x_final, v_end=v_end)
    return _driven(plan_motion(quintic, problem.packed), problem.packed)


def _driven(av: AvMotion, scene: PackedScene) -> Driven:
    # As ``replay`` does, but without the clearances, which stand in the tables and take most of its time.
    drive_on(av.x, av.y, av.vx, av.ax, av.jerk, av.free_from, scene)
    x, v, a = (np.empty((len(scene.follower_x), len(av.x))) for _ in range(3))
    follow(av.x + scene.length / 2.0, av.vx, joins(av, scene), scene, x, v, a)
    return av, (x, v, a)


def play_of(problem: PlanningProblem, policy: str, av: AvMotion, followers: Three, *, delay_s: float) -> Play:
    """What happens under a policy, by box centres. followers: their x, v and a."""
    scene = problem.scene
    stays = policy == names.NO_LANE_CHANGE
    levels = (np.full(len(av.x), y) for y in scene.followers.y)
    return Play(
        policy=policy,
        accountings=(),
        T=float("nan") if stays else av.n * scene.dt,
        ego=_ego(av, scene, at_rear_axle=policy not in (names.HUMAN, names.NO_LANE_CHANGE)),
        jerk=av.jerk,
        followers=tuple(Path(x, y, v, a) for x, y, v, a in zip(followers[0], levels, *followers[1:], strict=True)),
        measured=policy == names.HUMAN,
        delay_s=delay_s,
    )


def _ego(av: AvMotion, scene: Scene, *, at_rear_axle: bool) -> Path:
    """The box centre's motion."""
    x, y = box_centre(av, scene.wheelbase / 2.0 if at_rear_axle else 0.0)
    return Path(x, y, np.hypot(av.vx, av.vy), av.ax)


PERIOD: Final = 0.1
"""Time step of all motions on a page [s]: the planner's, and the finest that a page to be shared may carry."""
_READ: Final = ("plans", "losses", "tracking")
_DRIVEN: Final = (DRIVES, REPLANS, MOTIONS)


@dataclass(frozen=True)
class RecordingTables:
    """What the artefacts hold of one recording; tracks by event and role, other rows by table and event; behind:
    rows of ``trajectories`` behind the recorded ego, by event; identified: rows of ``identifiability``; grounds:
    pictures of the road by event; others: rows of other people's planners.
    """

    scenes: SceneTables
    events: tuple[Row, ...]
    tracks: Mapping[str, Tracks]
    boxes: Mapping[int, Box]
    directions: Mapping[int, int]
    markings: Mapping[int, FloatArray]
    rows: Mapping[str, Mapping[str, tuple[Row, ...]]]
    behind: Mapping[str, pd.DataFrame]
    identified: Mapping[str, Row]
    provenance: tuple[tuple[str, str], ...]
    grounds: Mapping[str, Ground] = field(default_factory=dict)
    others: OtherRows = field(default_factory=OtherRows)


def read_tables(job: Job) -> RecordingTables:
    """Read everything that the pages of a recording's events show, of the default follower model."""
    scenes = read_scene_tables(job.work, job.recording, job.settings.validation)
    roads = artefacts.read(job.work, "recordings", recording=job.recording)
    ids, directions = (scenes.vehicles[name].tolist() for name in ("vehicle_id", "driving_direction"))
    default = job.settings.validation.follower_models[0]
    found = {name: artefacts.read(job.work, name, recording=job.recording) for name in _READ}
    identified: list[Any] = artefacts.read(job.work, "identifiability").to_dict("records")
    recorded = [("policy", "==", RECORDED)]
    behind = artefacts.read_partition(job.work, "trajectories", job.recording, where=recorded)
    rows = {name: _by_event(frame[frame["followers"] == default]) for name, frame in found.items()}
    rows |= {name: _by_event(artefacts.read(job.work, name, recording=job.recording)) for name in _DRIVEN}
    events: list[Any] = scenes.events.to_dict("records")
    return RecordingTables(
        scenes=scenes,
        events=tuple(events),
        tracks=_by_event_and_role(scenes.tracks),
        boxes={vehicle: Box(*size) for vehicle, size in scenes.sizes.items()},
        directions=dict(zip(ids, directions, strict=True)),
        markings=dict(zip(roads["driving_direction"], roads["markings"], strict=True)),
        rows={**rows, "followers": _by_event(scenes.followers)},
        identified={row["parameter"]: row for row in identified},
        grounds=grounds(job, scenes.events, roads) if job.settings.report.raw else {},
        behind={str(event): rows for event, rows in behind.groupby("event_id")},
        provenance=_provenance(job),
        others=OtherRows.read(job),
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
        columns = (rows[name] for name in ("t", "x", "y", "vx", "ax", "calibration"))
        grouped[event_id][role] = Track(int(rows["vehicle_id"][0]), *columns)
    return grouped


def _provenance(job: Job) -> tuple[tuple[str, str], ...]:
    source = job.provenance
    inputs = tuple((f"input {name}", digest) for name, digest in sorted(source.inputs.items()))
    return (("code version", source.code), ("settings hash", source.settings), ("seed", str(source.seed)), *inputs)


def event_report(event: Row, tables: RecordingTables, scene: Scene, settings: ValidateSettings) -> EventReport:
    """Everything that the page of an event shows."""
    event_id = str(event["event_id"])
    tracks = tables.tracks[event_id]
    grid = PERIOD * np.arange(round(settings.loss.horizon_s / PERIOD) + 1, dtype=np.float64)
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
        plays=(
            *policy_plays(problem, of_event["plans"]),
            *tables.others.plays(event_id, followers=len(scene.followers.x)),
            _recorded_play(event, tracks, grid),
            *loop_plays(*(of_event[name] for name in _DRIVEN)),
        ),
        plans=of_event["plans"] + tables.others.plan_rows(event_id),
        losses=of_event["losses"] + tables.others.loss_rows(event_id),
        fits=of_event["followers"],
        fit_traces=fit_traces(tracks, boxes, of_event["followers"], b_max=settings.followers.b_max),
        tracking=of_event["tracking"] + tables.others.tracking_rows(event_id),
        track_traces=(*track_traces(problem, of_event["plans"]), *tables.others.traces(event_id)),
        surface=surface_of(problem, of_event["plans"]),
        provenance=tables.provenance,
        leads=leads(scene),
        identified=tables.identified,
        ground=tables.grounds.get(event_id),
        prediction=prediction_trace(tables.behind.get(event_id), settings.follower_models[0]),
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
