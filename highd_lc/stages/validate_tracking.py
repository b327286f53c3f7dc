"""Rows of the table of tracking: every plan of the primary accounting on the bicycle, a sample on both cars."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from highd_lc.algorithms.plan_tracking import DrivenPlan, PlanTracker
from highd_lc.algorithms.planner import Plan, contact_of
from highd_lc.algorithms.replay import Replay
from highd_lc.algorithms.tracked_motion import planned_motion
from highd_lc.vocab import names
from highd_lc.vocab.tracking import KINEMATIC, MULTI_BODY

Row = dict[str, Any]

_FIGURES = (
    "rmse_lateral_m",
    "max_lateral_m",
    "rmse_longitudinal_m",
    "rmse_heading_rad",
    "max_slack",
    "qp_failures",
)


def tracking_rows(tracker: PlanTracker, plans: Sequence[Plan], *, multi_body: bool) -> Iterator[Row]:
    """A row for each policy that changes lane, and plant; multi_body: whether on the multi-body car as well."""
    known: dict[tuple[int, str], Row] = {}
    for plan in plans:
        if plan.accounting == names.PRIMARY_ACCOUNTING and plan.policy != names.NO_LANE_CHANGE:
            for plant in (KINEMATIC, MULTI_BODY) if multi_body else (KINEMATIC,):
                # Policies often choose the same plan, whose replay they share: it is driven once.
                key = id(plan.replay), plant
                if plan.replay is None or key not in known:
                    known[key] = _row(tracker, plan, plant)
                yield known[key] | {"policy": plan.policy}


def _row(tracker: PlanTracker, plan: Plan, plant: str) -> Row:
    """Without a plan, or with one that cannot be driven, the status alone: every number is missing, none is 0."""
    driven = tracker.drive(plan, plant)
    row: Row = {"policy": plan.policy, "plant": plant, "status": plan.status, "contact": ""}
    if driven is None:
        return row
    row["status"] = driven.result.status
    if driven.replay is None:
        return row
    row |= {name: getattr(driven.result, name) for name in _FIGURES}
    return row | _judged(tracker, driven, driven.replay) | {"violations": tracker.violations(driven)}


def _judged(tracker: PlanTracker, driven: DrivenPlan, tracked: Replay) -> Row:
    """Planned against tracked: losses and clearance."""
    plan, planned = driven.plan, driven.planned
    met = contact_of(tracker.problem, plan.policy, tracked, plan.accounting)
    return {
        "loss_av_tracked": tracker.loss_av(driven.motion).loss,
        "loss_av_planned": tracker.loss_av(planned_motion(driven.reference)).loss,
        "contact": met,
        "loss_hv_tracked": np.nan if met else tracker.loss_hv(plan, tracked),
        "loss_hv_planned": np.nan if plan.contact else tracker.loss_hv(plan, planned),
        "min_clearance_tracked_m": min(tracker.clearances(plan, tracked).values(), default=np.nan),
        "min_clearance_planned_m": min(tracker.clearances(plan, planned).values(), default=np.nan),
    }
