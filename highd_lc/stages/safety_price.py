"""The price of safety: the same events planned under both safety profiles (equations.md 5.8)."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from highd_lc.planning import limits, planner
from highd_lc.planning.planner import Plan, PlanningProblem
from highd_lc.planning.safety import kept
from highd_lc.planning.scene import safety_limits
from highd_lc.scoring import charges
from highd_lc.scoring.population import Bootstrap, bootstrap_of, gain, ratio_interval
from highd_lc.stages.validate_studies import Study
from highd_lc.vocab import names
from highd_lc.vocab.policy import PAIRS
from highd_lc.vocab.safety import PRACTICE, PROFILES
from highd_lc.vocab.sections import StatisticsSettings
from highd_lc.vocab.settings import ValidateSettings
from highd_lc.vocab.tables import TABLES

Row = dict[str, Any]

CLEARANCE = "clearance"
"""The margin around the ellipses, to whomever: one constraint among those of a profile."""
_POLICIES = (*names.REFERENCE_POLICIES, *names.FIXED_POLICIES, *names.FREE_POLICIES)
_ROUNDING = 1e-9


def of_profile(settings: ValidateSettings, profile: str) -> ValidateSettings:
    """The settings with that safety profile, its numbers as they are."""
    return settings.model_copy(update={"safety": settings.safety.model_copy(update={"profile": profile})})


def price_rows(study: Study) -> Iterator[Row]:
    """Rows of ``safety_losses``: the event's plans that start at once, under either profile."""
    settings = study.problem.settings
    for profile in PROFILES:
        problem, plans = study.problem, study.plans
        if profile != settings.safety.profile:
            problem = planner.pose(study.problem.scene, of_profile(settings, profile))
            plans = planner.plan_all(problem)
        still = {plan.accounting: plan for plan in plans if plan.policy == names.NO_LANE_CHANGE}
        unchanged = {accounting: plan_losses(problem, plan) for accounting, plan in still.items()}
        for plan in plans:
            if plan.policy in _POLICIES and plan.policy != names.NO_LANE_CHANGE:
                yield {"safety": profile} | _row(problem, plan, unchanged[plan.accounting])


def _row(problem: PlanningProblem, plan: Plan, unchanged: Row) -> Row:
    row: Row = {"policy": plan.policy, "accounting": plan.accounting, "status": plan.status}
    row |= {"contact": plan.contact, "binding": plan.binding, "violated": []}
    if plan.replay is None:
        return row
    return (
        row
        | plan_losses(problem, plan)
        | {"violated": broken(problem, plan), "loss_unchanged": sum(unchanged.values())}
    )


def plan_losses(problem: PlanningProblem, plan: Plan) -> Row:
    """Losses of AV and followers; none of a plan in which vehicles pass through one another."""
    if plan.replay is None or plan.contact:
        return {"loss_av": np.nan, "loss_hv": np.nan}
    dt, terms = problem.scene.dt, problem.terms
    losses = charges.cumulative_losses(plan.replay, terms, dt)
    found = charges.losses_at(losses, plan.accounting, terms, n=plan.replay.av.n, dt=dt)
    return {name: found[name] for name in ("loss_av", "loss_hv")}


def broken(problem: PlanningProblem, plan: Plan) -> list[str]:
    """Constraints of ``practice`` that a plan breaks, whatever it was planned under."""
    settings, scene = of_profile(problem.settings, PRACTICE), problem.scene
    asked = safety_limits(settings)
    assert plan.replay is not None
    found = kept(plan.replay, problem.packed, asked, start=round(plan.delay_s / scene.dt)).margins
    if plan.quintic is not None:
        limit = limits.limits_of(plan.quintic.v0, settings, scene.wheelbase)
        found = limits.margins(plan.quintic, limit) | found
    nearest = planner.clearance_margins(problem, plan.replay, names.PRIMARY_ACCOUNTING)
    found[CLEARANCE] = min(nearest.values(), default=np.inf) - asked.clearance
    return [name for name, margin in found.items() if margin < -_ROUNDING]


def safety_price(losses: pd.DataFrame, statistics: StatisticsSettings, *, seed: int) -> pd.DataFrame:
    """Gains under both profiles on the events that are feasible under both. losses: ``safety_losses``."""
    rows = []
    for form, (benchmark, local) in ((form, PAIRS[form]) for form in names.FORMS):
        for accounting in names.ACCOUNTINGS:
            chosen = losses[losses["accounting"] == accounting]
            pairs = {profile: _pair(chosen, profile, benchmark, local) for profile in PROFILES}
            if any(pair.empty for pair in pairs.values()):
                continue
            both = np.logical_and.reduce([pair["solved"].to_numpy(bool) for pair in pairs.values()])
            for profile, pair in pairs.items():
                about = {"form": form, "accounting": accounting, "safety": profile}
                rows.append(about | _price(pair, both, bootstrap_of(statistics, seed=seed)))
    return pd.DataFrame(rows, columns=list(TABLES["safety_price"].column_names))


def _pair(losses: pd.DataFrame, profile: str, benchmark: str, local: str) -> pd.DataFrame:
    """One row an event: losses of both policies and of no lane change, and whether there are both."""
    of_profile = losses[losses["safety"] == profile]
    one, other = (
        of_profile[of_profile["policy"] == p].set_index("event_id").sort_index() for p in (local, benchmark)
    )
    total_1, total_0 = (frame["loss_av"].astype(float) + frame["loss_hv"].astype(float) for frame in (one, other))
    known = {"local": total_1, "benchmark": total_0, "unchanged": one["loss_unchanged"].astype(float)}
    pair = pd.DataFrame(known | {"recording_id": one["recording_id"]})
    return pair.assign(solved=pair["local"].notna() & pair["benchmark"].notna())


def _price(pair: pd.DataFrame, both: Any, bootstrap: Bootstrap) -> Row:
    used = pair[both]
    local, benchmark, unchanged = (used[name].to_numpy(float) for name in ("local", "benchmark", "unchanged"))
    ratio = ratio_interval(used["recording_id"].to_numpy(), local, benchmark, bootstrap)
    known = np.isfinite(unchanged)
    return {
        "n_events": len(pair),
        "infeasible": int((~pair["solved"]).sum()),
        "n_both": len(used),
        "total_benchmark": float(benchmark.sum()),
        "total_local": float(local.sum()),
        "gain": gain(local.sum(), benchmark.sum()),
        "gain_low": 1.0 - ratio.high,
        "gain_high": 1.0 - ratio.low,
        "gain_incremental": gain((local - unchanged)[known].sum(), (benchmark - unchanged)[known].sum()),
    }


def safety_violations(losses: pd.DataFrame) -> pd.DataFrame:
    """Share of each policy's plans that break each constraint of ``practice``, under the primary accounting."""
    chosen = losses[(losses["accounting"] == names.PRIMARY_ACCOUNTING) & losses["loss_unchanged"].notna()]
    rows = []
    for profile in PROFILES:
        for policy in _POLICIES:
            of_policy = chosen[(chosen["safety"] == profile) & (chosen["policy"] == policy)]
            if len(of_policy):
                rows += list(_shares(of_policy, {"safety": profile, "policy": policy}))
    return pd.DataFrame(rows, columns=list(TABLES["safety_violations"].column_names))


def _shares(plans: pd.DataFrame, about: Row) -> Iterator[Row]:
    lists = [set(found) for found in plans["violated"]]
    constraints = (*limits.SAFETY, CLEARANCE, "acceleration_after_T", "jerk_after_T", *limits.CONSTRAINTS)
    yield about | {"constraint": "any", "n": len(lists), "share": float(np.mean([bool(f) for f in lists]))}
    for name in constraints:
        share = float(np.mean([name in found for found in lists]))
        yield about | {"constraint": name, "n": len(lists), "share": share}
