"""What lies behind an event's tables, computed again for drawing: loss surface, fits, tracking."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from highd_lc.algorithms.following_window import RecordedMotion, following_track
from highd_lc.algorithms.planner import FORM_OF, PlanningProblem
from highd_lc.algorithms.surface import ON_SURFACE, SurfacePoint, loss_surface
from highd_lc.algorithms.tracked_motion import plan_reference
from highd_lc.algorithms.tracker import Controller, controller, errors_and_inputs
from highd_lc.core.car_following import TIME_STEP, simulate
from highd_lc.core.drive import hardest_braking
from highd_lc.core.quintic import Quintic
from highd_lc.reporting.event import Box, FitTrace, Row, Surface, TrackTrace
from highd_lc.vocab import names
from highd_lc.vocab.lcm_parameters import PARAMETERS
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
    return Surface(drawn.T, drawn.x_offset, drawn.loss_av, drawn.loss_hv, drawn.feasible)


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
    errors, inputs = errors_and_inputs(reference, wheelbase=scene.wheelbase, settings=settings, shared=shared)
    return TrackTrace(
        policy=policy,
        plant=KINEMATIC,
        t=scene.dt * np.arange(len(errors)),
        lateral=errors[:, 1],
        longitudinal=errors[:, 0],
        v=inputs[:, 0],
        delta=inputs[:, 1],
    )


@cache
def _controller(settings: TrackingSettings, dt: float) -> Controller:
    """One controller for all plans of a process, as in ``track_many``: every step overwrites its memory."""
    return controller(settings, dt)
