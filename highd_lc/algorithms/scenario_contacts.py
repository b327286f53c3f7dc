"""The AV of scenario 2 in front of HV_1: slower by 5 to 10 m/s at a printed distance of 10 m.

Under the LCM HV_1 cannot brake hard enough when the 10 m are between centres and the AV keeps 15 m/s. The paper
does not say what its 10 m are; both readings are driven.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from highd_lc.algorithms.planner import reference_plans
from highd_lc.algorithms.platoon import gaps
from highd_lc.algorithms.scenario import situations
from highd_lc.algorithms.scenario_run import Cell, Outcome, Planned, drive_plan, plan_situation
from highd_lc.core.quintic import Quintic
from highd_lc.vocab import names
from highd_lc.vocab.scenarios import ScenarioSettings

Row = dict[str, Any]


def contact_rows(settings: ScenarioSettings) -> list[Row]:
    """Every reading, speed of the AV and motion: constant speed and both optima (rows of ``contacts``)."""
    rows: list[Row] = []
    for reading in ("centres", "bumpers"):
        for posed in situations(settings, settings.with_options({"gap_reading": reading})):
            planned = plan_situation(posed, settings, omegas=(1.0, settings.loss.omega_av))
            rows += _rows_of(planned, settings)
    return rows


def _rows_of(planned: Planned, settings: ScenarioSettings) -> Iterator[Row]:
    form, accounting = settings.form, settings.accounting
    plans = {
        names.CONSTANT: reference_plans(planned.problem, names.CONSTANT)[0].quintic,
        names.BENCHMARK: planned.plan(Cell(form, accounting, 1.0)),
        names.LOCAL_OPTIMUM: planned.plan(Cell(form, accounting, settings.loss.omega_av)),
    }
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
