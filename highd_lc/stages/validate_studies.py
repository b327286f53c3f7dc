"""Rows of the validate stage beside plans and losses: cross scores of every event, studies of the sampled ones.

The value of perfect information about the leaders over the sampled events.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, TypeVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from highd_lc.planning import sqp
from highd_lc.planning.crowd import event_generator
from highd_lc.planning.planner import Plan, PlanningProblem, contact_of, made_once
from highd_lc.planning.pool import Goal, Pool
from highd_lc.planning.replay import Replay
from highd_lc.planning.search import search
from highd_lc.scoring import charges, cross_scores, uncertainty
from highd_lc.scoring.cross_scores import DrawnLosses
from highd_lc.scoring.population import Bootstrap, bootstrap_of, ratio_interval
from highd_lc.scoring.uncertainty import (
    Cell,
    Driven,
    Losses,
    optima,
    with_horizon,
    with_predicted,
    with_recorded,
    with_replanning,
)
from highd_lc.tracking.plan_tracking import PlanTracker
from highd_lc.vocab import names
from highd_lc.vocab.policy import OPTIMAL_POLICIES, PAIRS, POLICIES
from highd_lc.vocab.sections import StatisticsSettings, StudySettings
from highd_lc.vocab.tables import TABLES
from highd_lc.vocab.tables.studies import (
    DRAWN,
    IDM_MOTORWAY,
    KNOWLEDGE,
    RECORDED,
    SECOND_OPINIONS,
)

FloatArray = NDArray[np.float64]
Row = dict[str, Any]
Made = TypeVar("Made")

STUDY_TABLES = (
    "cross_losses",
    "horizon_losses",
    "pareto",
    "pareto_summary",
    "uncertainty",
    "solver_comparison",
    "foresight",
)
"""The parts that are written for each recording."""
COUNTERPART = {policy: POLICIES[policy].counterpart for policy in OPTIMAL_POLICIES}
"""The policy that each optimal one is compared with."""


@dataclass(frozen=True)
class Study:
    """An event under study: its problem and plans, the seed of the run, and the follower model that planned."""

    problem: PlanningProblem
    plans: Sequence[Plan]
    seed: int
    model: str = names.OWN_FIT

    @property
    def settings(self) -> StudySettings:
        """What is asked for."""
        return self.problem.settings.studies

    @cached_property
    def draws(self) -> FloatArray:
        """Drawn parameters of the followers, shape (K, p, 6)."""
        return uncertainty.draws_of(self.problem, max(self.settings.draws, self.settings.replans), seed=self.seed)

    @cached_property
    def optimal(self) -> dict[Cell, Plan]:
        """The plans of the optimal policies by policy and accounting."""
        return {(plan.policy, plan.accounting): plan for plan in self.plans if plan.policy in OPTIMAL_POLICIES}

    @cached_property
    def rescored(self) -> dict[Cell, DrawnLosses]:
        """Followers' loss of each optimal plan as planned (first) and under the draws."""
        drivers = np.concatenate([self.problem.packed.parameters[None], self.draws])
        return _of_each(self.optimal, lambda plan: uncertainty.rescore(self.problem, plan, drivers))

    @cached_property
    def idm(self) -> dict[Cell, DrawnLosses]:
        """Followers' loss of each optimal plan that is one, if all of them are IDM drivers."""
        packed, terms = self.problem.packed, self.problem.terms

        def scored(plan: Plan) -> DrawnLosses:
            assert plan.replay is not None, "asked for plans alone"
            return cross_scores.idm_followers(plan.replay.av, packed, terms, plan.replay.entry)

        return _of_each(self.played, scored)

    @cached_property
    def av_losses(self) -> dict[Cell, tuple[float, float]]:
        """The AV's loss of every optimal plan charged to T and to H."""
        return _of_each(self.optimal, lambda plan: uncertainty.av_loss(self.problem, plan))

    @property
    def played(self) -> dict[Cell, Plan]:
        """The optimal plans that are there: the policies that found none are left out."""
        return {cell: plan for cell, plan in self.optimal.items() if plan.replay is not None}

    @property
    def forms(self) -> list[str]:
        """The forms that were planned, without those whose start is chosen."""
        return self._planned(names.FORMS)

    @property
    def start_forms(self) -> list[str]:
        """The forms that were planned whose start is chosen: none if it is not chosen in this event."""
        return self._planned(names.START_FORMS)

    def _planned(self, forms: Sequence[str]) -> list[str]:
        return [form for form in forms if (PAIRS[form][0], names.EQUAL) in self.optimal]

    @property
    def solvable(self) -> bool:
        """Whether there is anything to plan: the ellipses do not overlap at t_start."""
        return all(plan.status != names.INFEASIBLE_AT_START for plan in self.plans)

    def rng(self, purpose: str) -> np.random.Generator:
        """The event's random generator for one purpose."""
        return event_generator(self.seed, self.problem.scene.event_id, purpose=purpose)


def _of_each(plans: Mapping[Cell, Plan], make: Callable[[Plan], Made]) -> dict[Cell, Made]:
    """What is made of each plan by policy and accounting."""
    return dict(zip(plans, made_once(list(plans.values()), make), strict=True))


def foresight_rows(study: Study) -> Iterator[Row]:
    """Rows of ``foresight``: both policies that choose their start, with each kind of knowledge of the leaders."""
    if not study.solvable:
        return
    kinds = zip(KNOWLEDGE, (with_recorded, with_predicted, with_replanning), strict=True)
    for knowledge, drive in kinds:
        for policy in PAIRS[names.START]:
            omega = POLICIES[policy].omega_av(study.problem.settings.loss.omega_av)
            found = _foreseen(drive(study.problem, Goal(names.EQUAL, omega)))
            yield {"policy": policy, "knowledge": knowledge, **found}


def _foreseen(driven: Driven) -> Row:
    row: Row = {"loss_av": driven.loss_av, "loss_hv": driven.loss_hv, "objective": driven.objective}
    row |= {"touches": driven.touches, "plannings": driven.plannings}
    choice = driven.choice
    if choice is None:
        return row | {"delay_s": np.nan, "gap": "", "T": np.nan}
    return row | {"delay_s": choice.delay_s, "gap": choice.gap, "T": choice.T}


def cross_rows(
    study: Study, others: Mapping[str, PlanTracker], judges: Mapping[str, PlanTracker] | None = None
) -> Iterator[Row]:
    """Rows of ``cross_losses``: every optimal plan charged to T and to H, with each model of the followers.

    others: the event posed with the other follower models that score; judges: with further ones, for the plans
    that start at t_start.
    """
    by_others = {model: _of_each(study.played, partial(_scored_by, other)) for model, other in others.items()}
    at_start = {cell: plan for cell, plan in study.played.items() if not POLICIES[plan.policy].chooses_start}
    further = {m: judge for m, judge in (judges or {}).items() if m not in others}
    by_judges = {model: _of_each(at_start, partial(_scored_by, judge)) for model, judge in further.items()}
    for (policy, accounting), plan in study.optimal.items():
        row: Row = {"policy": policy, "accounting": accounting, "planned_with": study.model}
        scoring = by_others if POLICIES[policy].chooses_start else by_others | by_judges
        if plan.replay is None:
            for model in (study.model, *SECOND_OPINIONS, *scoring):
                yield row | {"scored_with": model, "contacts_to_T": 0, "contacts_to_H": 0}
            continue
        row["contact_after_T"] = bool((plan.replay.clearance_after_T < 0.0).any())
        counterpart = study.rescored[COUNTERPART[policy], accounting]
        scored = _as_planned(study, (policy, accounting), counterpart)
        scored |= {model: found[policy, accounting] for model, found in scoring.items()}
        for model, losses in scored.items():
            yield row | {"scored_with": model} | losses


def _as_planned(study: Study, cell: Cell, counterpart: DrawnLosses) -> dict[str, Row]:
    """Losses of a plan by the drivers that planned it, by those drawn about them, and by the IDM.

    counterpart: followers' loss of the policy that it is compared with: a mean over draws is one over the same
    draws for both.
    """
    own, idm, av = study.rescored[cell], study.idm[cell], study.av_losses[cell]
    found: dict[str, Row] = {}
    for model, charged, drivers in (
        (study.model, own, slice(0, 1)),
        (IDM_MOTORWAY, idm, slice(None)),
        (DRAWN, own, slice(1, None)),
    ):
        found[model] = {"av_to_T": av[0], "av_to_H": av[1]}
        for end, to_T, losses in (("T", True, charged.to_T), ("H", False, charged.to_H)):
            met = charged.touches(to_T=to_T)
            left_out = (met | counterpart.touches(to_T=to_T) if model == DRAWN else met)[drivers]
            kept = losses[drivers][~left_out]
            found[model] |= {f"hv_to_{end}": float(kept.mean()) if len(kept) else np.nan}
            found[model] |= {f"contacts_to_{end}": int(left_out.sum())}
    if played := study.optimal[cell].replay:
        found[study.model] |= _peaks(played, found[study.model])
    return found


def _scored_by(tracker: PlanTracker, plan: Plan) -> Row:
    """Losses of a plan among the followers of another model: the AV moves as planned, and drives on behind whom it
    then meets.
    """
    assert plan.replay is not None, "asked for plans alone"
    planned = plan.replay.av
    copied = {name: getattr(planned, name).copy() for name in ("x", "y", "vx", "vy", "ax", "jerk")}
    copied["ax"][planned.n :] = 0.0  # as the plan ends, before anything was driven after it
    played = tracker.around(plan, replace(planned, **copied))
    av = cross_scores.av_charged(played.av, tracker.problem.terms)
    row: Row = {"av_to_T": av[0], "av_to_H": av[1]}
    for end, accounting in (("T", names.PAPER), ("H", names.EQUAL)):
        met = contact_of(tracker.problem, plan.policy, played, accounting)
        row[f"hv_to_{end}"] = np.nan if met else tracker.loss_hv(replace(plan, accounting=accounting), played)
        row[f"contacts_to_{end}"] = int(bool(met))
    return row | _peaks(played, row)


def _peaks(played: Replay, row: Row) -> Row:
    """Strongest braking of any follower up to T and to H [m/s^2], where the row has no contact up to there."""
    ends = (("T", played.av.n), ("H", len(played.av.x) - 1))
    clear = [(end, last) for end, last in ends if not row[f"contacts_to_{end}"]]
    return {f"peak_to_{end}": charges.peak_deceleration(played.a, last) for end, last in clear}


def horizon_rows(study: Study) -> Iterator[Row]:
    """Rows of ``horizon_losses``: every H asked for, and the run's own."""
    if not study.solvable:
        return
    own = study.problem.settings.loss.horizon_s
    for horizon in sorted({h for h in study.settings.horizons_s if h <= own} | {own}):
        found = _planned(study) if horizon == own else optima(with_horizon(study.problem, horizon))
        for form in study.forms:
            for accounting in names.ACCOUNTINGS:
                row: Row = {"horizon_s": horizon, "form": form, "accounting": accounting}
                for policy, word in zip(PAIRS[form], ("benchmark", "local"), strict=True):
                    av, hv = found[policy, accounting]
                    row |= {f"loss_av_{word}": av, f"loss_hv_{word}": hv}
                yield row


def _planned(study: Study) -> dict[tuple[str, str], Losses]:
    """Losses of the plans that the study was given, by policy and accounting."""
    found = {}
    for policy, accounting in study.optimal:
        cell = policy, accounting
        av, hv = uncertainty.charged_by(accounting, study.av_losses[cell], study.rescored[cell])
        found[cell] = av, float(hv[0])
    return found


def uncertainty_rows(study: Study) -> Iterator[Row]:
    """Rows of ``uncertainty``: the draws planned with, and the plans as they are under the draws."""
    if not study.solvable:
        return
    draws = study.draws[: study.settings.replans]
    replanned = uncertainty.replan(study.problem, draws, chooses_start=bool(study.start_forms))
    spread = study.problem.scene.followers.spread
    known = float(np.mean(np.any(spread > 0.0, axis=1))) if spread is not None else 0.0
    for form in (*study.forms, *study.start_forms):
        benchmark, local = PAIRS[form]
        for accounting in names.ACCOUNTINGS:
            totals = (replanned.total((policy, accounting)) for policy in (local, benchmark))
            row = {"form": form, "accounting": accounting, "spread_known": known}
            row |= _gain_of_draws(uncertainty.relative_gain(*totals), study.problem.settings.statistics.tie_band)
            row |= _kept_columns(study, form, accounting)
            T = replanned.T[local, accounting]
            yield row | {"T_deviation": float(np.nanstd(T)) if np.isfinite(T).any() else np.nan}


def _gain_of_draws(gain: FloatArray, band: float) -> Row:
    known = gain[np.isfinite(gain)]
    row: Row = {"n_replanned": len(known), "infeasible": len(gain) - len(known)}
    if not len(known):
        return row
    better, worse = _shares(known, band)
    of_gain = {"gain_mean": known.mean(), "gain_low": known.min(), "gain_high": known.max()}
    return row | {name: float(v) for name, v in of_gain.items()} | {"share_better": better, "share_worse": worse}


def _shares(gain: FloatArray, band: float) -> tuple[float, float]:
    return float(np.mean(gain > band)), float(np.mean(gain < -band))


def _kept_columns(study: Study, form: str, accounting: str) -> Row:
    """Gain of the plans made with the fitted parameters: under these, and under every draw."""
    totals, met = [], np.zeros(len(study.draws) + 1, bool)
    for policy in reversed(PAIRS[form]):
        cell = policy, accounting
        av, hv = uncertainty.charged_by(accounting, study.av_losses[cell], study.rescored[cell])
        met |= study.rescored[cell].touches(to_T=accounting == names.PAPER)
        totals.append(av + hv)
    gain = uncertainty.relative_gain(*totals)
    kept, contacts = gain[1:][~met[1:]], int(met[1:].sum())
    if not np.isfinite(gain[0]) or not len(kept) or not np.isfinite(kept).all():
        return {"n_kept": 0, "contacts": contacts}
    better, worse = _shares(kept, study.problem.settings.statistics.tie_band)
    return {
        "gain": float(gain[0]),
        "n_kept": len(kept),
        "contacts": contacts,
        "gain_kept_mean": float(kept.mean()),
        "share_kept_better": better,
        "share_kept_worse": worse,
    }


def solver_rows(study: Study) -> Iterator[Row]:
    """Rows of ``solver_comparison``: SLSQP against the global search, primary accounting, both policies."""
    if not study.solvable:
        return
    task, loss = study.problem.task, study.problem.settings.loss
    goals = [Goal(names.PRIMARY_ACCOUNTING, omega) for omega in (1.0, loss.omega_av)]
    fixed = search(task, goals)
    for form in study.forms:
        pool = fixed if form == names.FIXED else search(task, goals, known=fixed)
        for goal in goals:
            found = sqp.multi_start(
                task, goal, free=form == names.FREE, count=study.settings.solver_starts, rng=study.rng("sqp")
            )
            yield {"form": form, "accounting": goal.accounting, "omega_av": goal.omega_av} | _compared(
                pool, goal, found, task.scene.dt
            )


def _compared(pool: Pool, goal: Goal, found: list[sqp.Descent], dt: float) -> Row:
    best = min(found, key=lambda descent: descent.objective)
    at = pool.best(goal) if len(pool) else None
    objective = float(pool.objective(goal)[at]) if at is not None else np.nan
    return {
        "objective": objective,
        "objective_sqp": _finite(best.objective),
        "objective_single": _finite(found[0].objective),
        "excess_sqp": _finite(best.objective / objective - 1.0),
        "excess_single": _finite(found[0].objective / objective - 1.0),
        "T": pool.n[at] * dt if at is not None else np.nan,
        "T_sqp": best.n * dt if np.isfinite(best.objective) else np.nan,
        "starts": len(found),
        "feasible_starts": sum(np.isfinite(descent.objective) for descent in found),
        "evaluations": sum(descent.evaluations for descent in found),
    }


def _finite(value: float) -> float:
    return value if np.isfinite(value) else np.nan


def foresight_summary(foresight: pd.DataFrame, statistics: StatisticsSettings, *, seed: int) -> pd.DataFrame:
    """One row a policy and kind of knowledge. foresight: the artefact."""
    bootstrap = bootstrap_of(statistics, seed=seed)
    rows = []
    for policy in PAIRS[names.START]:
        of_policy = foresight[foresight["policy"] == policy]
        known = of_policy[of_policy["knowledge"] == RECORDED].set_index("event_id")
        known = known[known["objective"].notna()]
        for knowledge in KNOWLEDGE if len(known) else ():
            chosen = of_policy[of_policy["knowledge"] == knowledge].set_index("event_id").reindex(known.index)
            compared = _foresight_compared(chosen, known, bootstrap)
            rows.append({"policy": policy, "knowledge": knowledge, **compared})
    return pd.DataFrame(rows, columns=list(TABLES["foresight_summary"].column_names))


def _foresight_compared(chosen: pd.DataFrame, known: pd.DataFrame, bootstrap: Bootstrap) -> dict[str, Any]:
    found = chosen["objective"].notna()
    touching = found & chosen["touches"].eq(True)
    kept = chosen[found & ~touching]
    perfect = known.loc[kept.index]
    own, best = kept["objective"].to_numpy(), perfect["objective"].to_numpy()
    worth = ratio_interval(perfect["recording_id"].to_numpy(), best, own, bootstrap)
    return {
        "n_events": len(chosen),
        "no_plan": int((~found).sum()),
        "touching": int(touching.sum()),
        "n_compared": len(kept),
        "mean_delay_s": float(kept["delay_s"].mean()),
        "share_waiting": float((kept["delay_s"] > 0.0).mean()),
        "objective": float(own.sum()),
        "objective_recorded": float(best.sum()),
        "value_of_information": float(1.0 - best.sum() / own.sum()) if own.sum() > 0.0 else float("nan"),
        "value_low": 1.0 - worth.high,
        "value_high": 1.0 - worth.low,
    }
