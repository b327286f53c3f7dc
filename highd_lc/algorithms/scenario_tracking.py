"""The AV of a scenario as the MPC really drives it: tracked motion, and the followers behind that one."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from highd_lc.algorithms import scoring
from highd_lc.algorithms.multibody import track_multibody
from highd_lc.algorithms.replay import AvMotion, replay
from highd_lc.algorithms.scenario_run import Cell, Planned
from highd_lc.algorithms.tracked_motion import SampledMotion, motion_of, plan_reference
from highd_lc.algorithms.tracker import track
from highd_lc.core.quintic import Quintic
from highd_lc.vocab import names
from highd_lc.vocab.scenarios import ScenarioSettings
from highd_lc.vocab.tracking import KINEMATIC, MULTI_BODY, TrackingResult

FloatArray = NDArray[np.float64]
Row = dict[str, Any]


@dataclass(frozen=True)
class _AvPath:
    """A sampled path: x, y [m], shape (n + 1,), velocity along and across the road [m/s], shape (n + 1, 2)."""

    x: FloatArray
    y: FloatArray
    velocity: FloatArray


PLANNED = "planned"


def tracking_rows(planned: Planned, settings: ScenarioSettings) -> list[Row]:
    """Benchmark and local optimum, planned and on both cars (rows of ``scenario_tracking``)."""
    rows: list[Row] = []
    for policy, omega in ((names.BENCHMARK, 1.0), (names.LOCAL_OPTIMUM, settings.loss.omega_av)):
        plan = planned.plan(Cell(settings.form, settings.accounting, omega))
        if plan is not None:
            rows += ({"policy": policy} | row for row in _rows_of_plan(planned, plan, settings))
    return rows


def _rows_of_plan(planned: Planned, plan: Quintic, settings: ScenarioSettings) -> Iterator[Row]:
    dt = settings.vehicle.dt_s
    reference = plan_reference(plan, dt)
    velocity = np.column_stack([reference.xdot, reference.ydot])
    motion = _AvPath(reference.x, reference.y, velocity)
    yield {"plant": PLANNED, "status": "planned"} | _losses(planned, motion, settings)
    kinematic = track(reference, wheelbase=settings.vehicle.wheelbase_m, settings=settings.tracking)
    yield {"plant": KINEMATIC} | _tracked(planned, kinematic, settings)
    heavy = track_multibody(reference, settings=settings.tracking)
    yield {"plant": MULTI_BODY} | _tracked(planned, heavy, settings)


def _tracked(planned: Planned, result: TrackingResult, settings: ScenarioSettings) -> Row:
    path = _AvPath(result.states[:, 0], result.states[:, 1], result.velocity)
    errors = {
        "status": result.status,
        "max_lateral_m": result.max_lateral_m,
        "max_longitudinal_m": float(np.abs(result.errors[:, 0]).max()),
    }
    return errors | _losses(planned, path, settings)


def _losses(planned: Planned, path: _AvPath, settings: ScenarioSettings) -> Row:
    """Losses with the path as the AV's motion; its jerk by finite differences, of the plan as of the car."""
    problem, dt = planned.problem, settings.vehicle.dt_s
    av = _av_motion(path, motion_of(path.velocity, dt), len(problem.packed.target_v))
    played = replay(av, problem.packed)
    losses = scoring.cumulative_losses(played, problem.terms, problem.settings.loss, dt)
    charged = scoring.losses_at(losses, settings.accounting, problem.terms, n=av.n, dt=dt)
    row = {name: charged[name] for name in ("loss_av", "loss_hv", "loss_total")}
    return row | {"hv1_v_min": float(played.v[0].min())}


def _av_motion(path: _AvPath, motion: SampledMotion, samples: int) -> AvMotion:
    n = min(len(path.x), samples) - 1
    acceleration = np.append(motion.acceleration[:, 0], 0.0)
    columns = (path.x, path.y, path.velocity[:, 0], path.velocity[:, 1], acceleration, np.abs(motion.jerk).sum(1))
    padded = []
    for column in columns:
        whole = np.zeros(samples)
        whole[: n + 1] = column[: n + 1]
        padded.append(whole)
    x, y, vx, vy, ax, jerk = padded
    return AvMotion(x, y, vx, vy, ax, jerk, n=n, crossing=n // 2)
