"""What tracking makes of the plans: planned against tracked, each plan on each car, and by policy and plant.

Every plan of the primary accounting on the bicycle, a sample on both cars.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from highd_lc.planning.planner import Plan, contact_of, made_once
from highd_lc.planning.replay import Replay
from highd_lc.tracking.plan_tracking import DrivenPlan, PlanTracker, loss_av, planned_motion
from highd_lc.vocab import names
from highd_lc.vocab.tables import TABLES
from highd_lc.vocab.tracking import KINEMATIC, LOST, MULTI_BODY, PLANTS, SOFTENED

Row = dict[str, Any]

_LOSSES = ("loss_av_planned", "loss_av_tracked", "loss_hv_planned", "loss_hv_tracked")


def tracking_summary(tracking: pd.DataFrame) -> pd.DataFrame:
    """One row a policy and plant. tracking: the artefact."""
    rows = []
    for plant in PLANTS:
        for policy in names.POLICIES:
            found = tracking[(tracking["plant"] == plant) & (tracking["policy"] == policy)]
            if len(found):
                rows.append({"policy": policy, "plant": plant, **_figures(found)})
    return pd.DataFrame(rows, columns=list(TABLES["tracking_summary"].column_names))


def tracking_contacts(tracking: pd.DataFrame) -> pd.DataFrame:
    """How often whose drives have which contact, and why. tracking: the artefact, of all follower models."""
    met = tracking[tracking["contact"].ne("")].rename(columns={"contact_cause": "cause"})
    met = met.assign(reference=met["policy"].isin(names.REFERENCE_POLICIES))
    columns = list(TABLES["tracking_contacts"].column_names)
    rows = [
        [*key, one["event_id"].nunique(), int((~one["reference"]).sum()), int(one["reference"].sum())]
        for key, one in met.groupby(columns[:4], sort=True)
    ]
    return pd.DataFrame(rows, columns=columns)


def _figures(found: pd.DataFrame) -> dict[str, Any]:
    driven = found[found["rmse_lateral_m"].notna()]
    lists = driven["violations"]
    return {
        "n_driven": len(driven),
        "not_driven": len(found) - len(driven),
        "lost": int((driven["status"] == LOST).sum()),
        "softened": int((driven["status"] == SOFTENED).sum()),
        "qp_failures": int(driven["qp_failures"].sum()),
        "rmse_lateral_median_m": float(driven["rmse_lateral_m"].median()),
        "rmse_lateral_largest_m": float(driven["rmse_lateral_m"].max()),
        "max_lateral_m": float(driven["max_lateral_m"].max()),
        **{name: float(driven[name].mean()) for name in _LOSSES},
        "share_violating": _share(len(broken) > 0 for broken in lists),
        "contacts": int(driven["contact"].ne("").sum()),
        "share_touching": _share(any(name.startswith("clearance_") for name in broken) for broken in lists),
        "share_touching_planned": _share(driven["min_clearance_planned_m"] < 0.0),
    }


def _share(cases: Iterable[bool]) -> float:
    """Share of the cases that hold; NaN of none."""
    known = list(cases)
    return sum(known) / len(known) if known else float("nan")


_FIGURES = (
    "rmse_lateral_m",
    "max_lateral_m",
    "rmse_longitudinal_m",
    "rmse_heading_rad",
    "max_slack",
    "qp_failures",
)


Drive = tuple[Plan, str, DrivenPlan | None]
"""A plan on a plant; None without a plan."""


@dataclass(frozen=True)
class Planned:
    """An event as planned with a follower model.

    multi_body: whether the multi-body car drives the plans too; judges: the event with other follower models that
    plan nothing.
    """

    model: str
    tracker: PlanTracker
    plans: list[Plan]
    multi_body: bool
    judges: Mapping[str, PlanTracker] = field(default_factory=dict)

    @cached_property
    def drives(self) -> list[Drive]:
        """Every plan of the primary accounting that changes lane, on each plant.

        Policies often choose the same plan, whose replay they share: it is driven once.
        """
        plans = [
            p for p in self.plans if p.accounting == names.PRIMARY_ACCOUNTING and p.policy != names.NO_LANE_CHANGE
        ]
        plants = (KINEMATIC, MULTI_BODY) if self.multi_body else (KINEMATIC,)
        driven = made_once(plans, lambda plan: [self.tracker.drive(plan, plant) for plant in plants])
        return [
            (plan, *one)
            for plan, of_plan in zip(plans, driven, strict=True)
            for one in zip(plants, of_plan, strict=True)
        ]


def tracking_rows(planned: Planned) -> Iterator[Row]:
    """A row for each policy that changes lane, and plant."""
    known: list[tuple[DrivenPlan, Row]] = []
    for plan, plant, driven in planned.drives:
        row: Row = {"status": plan.status, "contact": "", "contact_cause": ""}
        if driven is not None:
            of_same = next((row for other, row in known if other is driven), None)
            row = driven_row(planned.tracker, driven) if of_same is None else of_same
            known.append((driven, row))
        yield {"policy": plan.policy, "plant": plant} | row


def tracking_row(tracker: PlanTracker, plan: Plan, plant: str) -> Row:
    """What tracking makes of a plan on a plant, by the columns of ``tracking``."""
    driven = tracker.drive(plan, plant)
    row: Row = {"policy": plan.policy, "plant": plant, "status": plan.status, "contact": "", "contact_cause": ""}
    return row if driven is None else row | driven_row(tracker, driven)


def driven_row(tracker: PlanTracker, driven: DrivenPlan) -> Row:
    """With a plan that cannot be driven, the status alone: every number is missing, none is 0."""
    row: Row = {"status": driven.result.status, "contact": "", "contact_cause": ""}
    if driven.replay is None:
        return row
    row |= {name: getattr(driven.result, name) for name in _FIGURES}
    return row | _judged(tracker, driven, driven.replay) | {"violations": tracker.violations(driven)}


def _judged(tracker: PlanTracker, driven: DrivenPlan, tracked: Replay) -> Row:
    """Planned against tracked: losses and clearance."""
    plan, planned, terms = driven.plan, driven.planned, tracker.problem.terms
    met = contact_of(tracker.problem, plan.policy, tracked, plan.accounting)
    return {
        "loss_av_tracked": float(loss_av(driven.motion, terms).loss),
        "loss_av_planned": float(loss_av(planned_motion(driven.reference), terms).loss),
        "contact": met,
        "contact_cause": tracker.cause(plan, met),
        "loss_hv_tracked": np.nan if met else tracker.loss_hv(plan, tracked),
        "loss_hv_planned": np.nan if plan.contact else tracker.loss_hv(plan, planned),
        "min_clearance_tracked_m": min(tracker.clearances(plan, tracked).values(), default=np.nan),
        "min_clearance_planned_m": min(tracker.clearances(plan, planned).values(), default=np.nan),
    }
