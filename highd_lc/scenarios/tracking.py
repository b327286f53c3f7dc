"""The AV of a scenario as the MPC really drives it: tracked motion, and the followers behind that one.

The AV of scenario 2 in front of HV_1: slower by 5 to 10 m/s at a printed distance of 10 m.

Under the LCM HV_1 cannot brake hard enough when the 10 m are between centres and the AV keeps 15 m/s. The paper
does not say what its 10 m are; both readings are driven.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.quintic import Quintic
from highd_lc.planning.planner import reference_plans
from highd_lc.planning.replay import AvMotion, replay
from highd_lc.scenarios.platoon import gaps, situations
from highd_lc.scenarios.run import Cell, Outcome, Planned, drive_plan, plan_situation
from highd_lc.scoring import charges
from highd_lc.tracking.closed_loop import track
from highd_lc.tracking.multibody import track_multibody
from highd_lc.tracking.plan_tracking import SampledMotion, plan_reference, planned_motion, tracked_motion
from highd_lc.vocab import names
from highd_lc.vocab.scenarios import ScenarioSettings
from highd_lc.vocab.tracking import KINEMATIC, MULTI_BODY, TrackingResult

Row = dict[str, Any]


def contact_rows(settings: ScenarioSettings) -> list[Row]:
    """Every reading, speed of the AV and motion: constant speed and both optima (rows of ``contacts``)."""
    rows: list[Row] = []
    for reading in ("centres", "bumpers"):
        for posed in situations(settings, settings.with_options({"gap_reading": reading})):
            planned = plan_situation(posed, settings, omegas=tuple(settings.weights.values()))
            rows += _rows_of(planned, settings)
    return rows


def _rows_of(planned: Planned, settings: ScenarioSettings) -> Iterator[Row]:
    form, accounting = settings.form, settings.accounting
    plans = {names.CONSTANT: reference_plans(planned.problem, names.CONSTANT)[0].quintic}
    plans |= {p: planned.plan(Cell(form, accounting, omega)) for p, omega in settings.weights.items()}
    posed = planned.situation
    for motion, plan in plans.items():
        row = {
            "scenario": posed.key,
            "gap_reading": posed.options.gap_reading,
            "v_av": posed.v_av,
            "motion": motion,
        }
        yield row | ({"status": planned.status, "collision": None} if plan is None else _contact(planned, plan))


def _contact(planned: Planned, plan: Quintic) -> Row:
    outcome = drive_plan(planned, plan, accounting=names.FOLLOWER_HORIZON, followers=1)
    gap = gaps(outcome.platoon)[0]
    nearest = int(np.argmin(gap))
    return {
        "status": names.SOLVED,
        "gap_start_m": float(gap[0]),
        "min_gap_m": float(gap[nearest]),
        "min_gap_at_s": float(outcome.platoon.t[nearest]),
        "min_clearance_m": _clearance(outcome),
        "hv1_peak_decel": float(-outcome.platoon.a[0].min()),
        "collision": bool(gap[nearest] < 0.0),
    }


def _clearance(outcome: Outcome) -> float:
    """Smallest distance of the ellipses over H, NaN where no obstacle counts."""
    smallest = np.minimum(outcome.replay.clearance_to_T, outcome.replay.clearance_after_T)
    return float(smallest.min()) if smallest.size else np.nan


FloatArray = NDArray[np.float64]


PLANNED = "planned"


def tracking_rows(planned: Planned, settings: ScenarioSettings) -> list[Row]:
    """Benchmark and local optimum, planned and on both cars (rows of ``scenario_tracking``)."""
    rows: list[Row] = []
    for policy, omega in settings.weights.items():
        plan = planned.plan(Cell(settings.form, settings.accounting, omega))
        if plan is not None:
            rows += ({"policy": policy} | row for row in _rows_of_plan(planned, plan, settings))
    return rows


def _rows_of_plan(planned: Planned, plan: Quintic, settings: ScenarioSettings) -> Iterator[Row]:
    dt = settings.vehicle.dt_s
    reference = plan_reference(plan, dt)
    path = np.column_stack([reference.x, reference.y])
    yield {"plant": PLANNED, "status": "planned"} | _losses(planned, path, planned_motion(reference), settings)
    kinematic = track(reference, wheelbase=settings.vehicle.wheelbase_m, settings=settings.tracking)
    yield {"plant": KINEMATIC} | _tracked(planned, kinematic, settings)
    heavy = track_multibody(reference, settings=settings.tracking)
    yield {"plant": MULTI_BODY} | _tracked(planned, heavy, settings)


def _tracked(planned: Planned, result: TrackingResult, settings: ScenarioSettings) -> Row:
    errors = {
        "status": result.status,
        "max_lateral_m": result.max_lateral_m,
        "max_longitudinal_m": float(np.abs(result.errors[:, 0]).max()),
    }
    return errors | _losses(planned, result.states[:, :2], tracked_motion(result), settings)


def _losses(planned: Planned, path: FloatArray, motion: SampledMotion, settings: ScenarioSettings) -> Row:
    """Losses with a motion as the AV's. path: x, y [m] at its samples, shape (n + 1, 2)."""
    problem, dt = planned.problem, settings.vehicle.dt_s
    av = _av_motion(path, motion, len(problem.packed.target_v))
    played = replay(av, problem.packed)
    losses = charges.cumulative_losses(played, problem.terms, dt)
    charged = charges.losses_at(losses, settings.accounting, problem.terms, n=av.n, dt=dt)
    row = {name: charged[name] for name in ("loss_av", "loss_hv", "loss_total")}
    return row | {"hv1_v_min": float(played.v[0].min())}


def _av_motion(path: FloatArray, motion: SampledMotion, samples: int) -> AvMotion:
    n = min(len(path), samples) - 1
    acceleration = np.append(motion.acceleration[:, 0], 0.0)
    columns = (*path.T, *motion.velocity.T, acceleration, motion.charged_jerk)
    padded = []
    for column in columns:
        whole = np.zeros(samples)
        whole[: n + 1] = column[: n + 1]
        padded.append(whole)
    x, y, vx, vy, ax, jerk = padded
    return AvMotion(x, y, vx, vy, ax, jerk, n=n, crossing=n // 2)
