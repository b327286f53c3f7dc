"""Validate: every event through the planner and the MPC, scored under every accounting; then the population."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from highd_lc.io import artefacts
from highd_lc.planning import planner
from highd_lc.planning.planner import Plan, PlanningProblem
from highd_lc.planning.robust import RobustProblem, plan_robust
from highd_lc.planning.safety import av_pairs
from highd_lc.planning.scene import Scene
from highd_lc.planning.start_planner import plan_starts
from highd_lc.scoring import charges
from highd_lc.scoring.charges import Scores
from highd_lc.stages import closed_loop
from highd_lc.stages.other_planners import OtherPlan, OtherPlanners, leaderboard, other_rows
from highd_lc.stages.population_tables import (
    STARTED,
    cross_scores,
    gain_map,
    horizon_sensitivity,
    leave_one_out,
    solver_summary,
    start_map,
    worse_for_somebody,
)
from highd_lc.stages.responses import loss_in_view
from highd_lc.stages.safety_price import price_rows, safety_price, safety_violations
from highd_lc.stages.scene_drivers import judged_drivers
from highd_lc.stages.scenes import (
    SceneTables,
    driven_by,
    read_scene_tables,
    recorded_motions,
    scene_makers,
)
from highd_lc.stages.statistics import (
    PolicyLosses,
    situations,
    summarise_losses,
    validation_matrix,
)
from highd_lc.stages.sumo_scores import SumoTracker, sumo_rows, sumo_summary
from highd_lc.stages.tracking_tables import Planned, tracking_contacts, tracking_rows, tracking_summary
from highd_lc.stages.trajectories import (
    JudgedDrivers,
    Trace,
    judged_traces,
    other_traces,
    planned_traces,
    recorded_traces,
    write_traces,
)
from highd_lc.stages.validate_robust import (
    Judges,
    crowd_for,
    event_gains,
    judges_of,
    robust_summary,
    situation_ranking,
    trackers_of,
)
from highd_lc.stages.validate_samples import Samples, pareto_rows, plan_row, samples
from highd_lc.stages.validate_studies import (
    STUDY_TABLES,
    Study,
    cross_rows,
    foresight_rows,
    foresight_summary,
    horizon_rows,
    solver_rows,
    uncertainty_rows,
)
from highd_lc.tracking.plan_tracking import PlanTracker
from highd_lc.vocab import names
from highd_lc.vocab.errors import told
from highd_lc.vocab.job import Combination, Job, JobReport, Problem
from highd_lc.vocab.policy import ACCOUNTINGS
from highd_lc.vocab.settings import ValidateSettings
from highd_lc.vocab.tables import TABLES

STAGE = "validate"
PART_TABLES = (
    "plans", "losses", "tracking", "safety_losses", *STUDY_TABLES, "other_plans",
    closed_loop.DRIVES, closed_loop.REPLANS, closed_loop.MOTIONS, "sumo_followers",
)  # fmt: skip

Row = dict[str, Any]


def run(job: Job) -> JobReport:
    """Plan, score and track every event of a recording, study the sampled ones; write all of ``PART_TABLES``, and
    the motions of the events chosen for that.
    """
    chosen, settings = samples(job), job.settings.validation
    rows: dict[str, list[Row]] = {name: [] for name in PART_TABLES}
    traces: list[Trace] = []
    problems = []
    others_asked = OtherPlanners.of(settings.planners)
    judges = judges_of(job.work, settings)
    tables = read_scene_tables(job.work, job.recording, settings, also=judges.every)
    judged = judged_drivers(job.work, job.recording) if chosen.traced else {}
    makers, drives = scene_makers(tables, settings), closed_loop.Drives.of(job, tables, chosen.replanned, judges)
    for event, (event_id, scene_of) in zip(tables.events.itertuples(), makers, strict=True):
        try:
            planned = _planned(scene_of(), tables, job, chosen, judges)
            others = others_asked.plans(planned[0])
            found = list(_event_rows(planned, job, chosen, others))
            found += drives.rows(planned[0])
            traced: list[Trace] = []
            if event_id in chosen.traced:
                traced += _traces(event, planned, tables, settings, judged)
                traced += other_traces(planned[0], others)
        except Exception as error:
            # One bad event never stops the others, and is left out as a whole: it is listed with its reason.
            problems.append(Problem(job.recording, STAGE, told(event_id, error)))
            continue
        traces += traced
        for name, row in found:
            rows[name].append({"event_id": event_id, "recording_id": job.recording, **row})
    for name, of_table in rows.items():
        artefacts.write_part(job, STAGE, name, _frame(name, of_table))
    write_traces(job, traces)
    others_asked.log_times(job)
    drives.log_times()
    return JobReport({name: len(of_table) for name, of_table in rows.items()}, tuple(problems))


def _frame(name: str, rows: list[Row]) -> pd.DataFrame:
    return pd.DataFrame(rows, columns=list(TABLES[name].column_names), dtype=None if rows else object)


def _planned(scene: Scene, tables: SceneTables, job: Job, chosen: Samples, judges: Judges) -> list[Planned]:
    """The event as planned with each follower model that plans it, the default one first."""
    default, *others = job.settings.validation.follower_models
    found = []
    for model in (default, *(others if scene.event_id in chosen.also else ())):
        own = scene if model == default else driven_by(scene, model, tables)
        problem = planner.pose(own, job.settings.validation)
        plans = planner.plan_all(problem)
        if scene.event_id in chosen.started:
            plans += plan_starts(problem)
        heavy, judging = False, {}
        if model == default:
            heavy = scene.event_id in chosen.multi_body
            if scene.event_id in chosen.robust:
                judging = trackers_of(problem, judges, tables)
                crowd = crowd_for(problem, judging, judges, seed=job.settings.seed)
                plans += plan_robust(RobustProblem(problem, crowd))
        found.append(Planned(model, PlanTracker(problem), plans, heavy, judging))
    return found


def _event_rows(
    planned: list[Planned], job: Job, chosen: Samples, asked: Sequence[OtherPlan]
) -> Iterator[tuple[str, Row]]:
    for one in planned:
        for name, row in _planned_rows(one):
            yield name, {"followers": one.model, **row}
        study = Study(one.tracker.problem, one.plans, job.settings.seed, one.model)
        others = {other.model: other.tracker for other in planned if other is not one}
        simulated = {}
        if one is planned[0] and study.problem.scene.event_id in chosen.simulated:
            simulated[names.SUMO] = SumoTracker(study.problem, job.settings.seed)
        for row in cross_rows(study, others, {**one.judges, **simulated}):
            yield "cross_losses", row
        for sumo in simulated.values():
            for row in sumo_rows(one, sumo):
                yield "sumo_followers", row
        if one is planned[0]:
            yield from _study_rows(study, chosen)
            scores = _scores(one)
            for row in other_rows(one, asked, partial(_scored, one.tracker.problem, scores)):
                yield "other_plans", row


def _planned_rows(planned: Planned) -> Iterator[tuple[str, Row]]:
    """Plans, losses and tracking of an event with one follower model."""
    problem, plans = planned.tracker.problem, planned.plans
    scores = _scores(planned)
    for plan in plans:
        yield "plans", plan_row(problem, plan)
        yield "losses", loss_row(problem, plan, scores)
    for row in tracking_rows(planned):
        yield "tracking", row


def _scores(planned: Planned) -> Scores:
    unchanged = next(plan for plan in planned.plans if plan.policy == names.NO_LANE_CHANGE)
    return Scores(planned.tracker.problem, unchanged)


def _scored(problem: PlanningProblem, scores: Scores, plan: Plan) -> Row:
    """The columns of ``plans`` and ``losses`` of one plan."""
    return plan_row(problem, plan) | loss_row(problem, plan, scores)


def _study_rows(study: Study, chosen: Samples) -> Iterator[tuple[str, Row]]:
    """The studies that an event was sampled for, each row with its table."""
    event_id = study.problem.scene.event_id
    if event_id in chosen.studied:
        yield from _sampled_rows(study)
    if event_id in chosen.priced:
        for row in price_rows(study):
            yield "safety_losses", row
    if event_id in chosen.foreseen:
        for row in foresight_rows(study):
            yield "foresight", row
    if event_id in chosen.compared:
        for row in solver_rows(study):
            yield "solver_comparison", row


def _traces(
    event: Any, planned: list[Planned], tables: SceneTables, settings: ValidateSettings, judged: JudgedDrivers
) -> Iterator[Trace]:
    """Everybody's recorded motion, and what each follower model makes of it."""
    yield from recorded_traces(event.event_id, recorded_motions(event, tables, settings.loss.horizon_s))
    for one in planned:
        yield from planned_traces(one)
    yield from judged_traces(planned, judged)


def _sampled_rows(study: Study) -> Iterator[tuple[str, Row]]:
    """The studies of the one sample of events."""
    for row in horizon_rows(study):
        yield "horizon_losses", row
    for row in uncertainty_rows(study):
        yield "uncertainty", row
    yield from pareto_rows(study)


def loss_row(problem: PlanningProblem, plan: Plan, scores: Scores) -> Row:
    """The columns of ``losses`` of one plan; what cannot be known is left out."""
    row: Row = {
        "policy": plan.policy,
        "accounting": plan.accounting,
        "recorded_n_samples": 0,
        "follower_n_samples": 0,
    }
    row |= {"loss_hv_each": [], "follower_weights": [], "contact": plan.contact}
    if plan.replay is None:
        return row
    dt, terms, settings = problem.scene.dt, problem.terms, problem.settings.loss
    n, last = plan.replay.av.n, len(plan.replay.av.x) - 1
    _, charged = ACCOUNTINGS[plan.accounting].charged(n, last)
    row["follower_n_samples"] = len(plan.replay.x) * (charged + 1)
    losses = scores.losses(plan.replay)
    if not plan.contact:
        # What a motion costs in which vehicles pass through one another is not a loss.
        row |= charges.losses_at(losses, plan.accounting, terms, n=n, dt=dt)
        row["loss_hv_increment"] = row["loss_hv"] - scores.hv_unchanged(charged)
    if plan.policy == names.HUMAN:
        recorded = problem.scene.followers.recorded
        # Behind the recorded ego both: once it is out of view the simulated ones follow somebody else.
        both = min(charged, plan.replay.av.recorded)
        row |= charges.recorded_loss(recorded, losses, terms, last=both, dt=dt)
        if plan.contact:
            row["loss_hv_simulated"] = np.nan
        row["av_comfort_raw"] = problem.scene.driver.comfort_raw / settings.comfort_scale
        row["loss_hv_in_view_recorded"] = loss_in_view([m.v for m in recorded], problem.scene, terms, settings)
    row |= scores.safety(plan, charged) | scores.once(plan.replay, partial(_whatever_is_charged, problem, plan))
    row["peak_follower_decel"] = charges.peak_deceleration(plan.replay.a, charged)
    return row if not plan.contact else row | {"loss_hv_in_view": np.nan}


def _whatever_is_charged(problem: PlanningProblem, plan: Plan) -> Row:
    """The columns of ``losses`` that no accounting changes."""
    assert plan.replay is not None, "asked for plans alone"
    scene, settings, row = problem.scene, problem.settings, {}
    if scene.human is not None and scene.followers.recorded:
        row["loss_hv_in_view"] = loss_in_view(list(plan.replay.v), scene, problem.terms, settings.loss)
    if plan.policy != names.NO_LANE_CHANGE:
        pairs, start = av_pairs(plan.replay, problem.packed), round(plan.delay_s / scene.dt)
        row |= charges.lane_change_safety(*pairs, settings.safety, start, scene.dt)
    return row


def combine(combination: Combination) -> JobReport:
    """Join the parts, then write the population's statistics: matrix, summary, cross scores, maps."""
    work = combination.work
    for name in PART_TABLES:
        artefacts.concatenate(work, STAGE, name, combination.recordings, combination.provenance)
    events = situations(work)
    counts = {"events": len(events)}
    for name, frame in _population(combination, events):
        table = artefacts.to_arrow(name, frame, combination.provenance)
        artefacts.write(artefacts.path_of(work, name), table)
        counts[name] = len(frame)
    return JobReport(counts)


def _population(combination: Combination, events: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame]]:
    """The population's tables by name."""
    work, settings, seed = combination.work, combination.settings.validation.statistics, combination.settings.seed
    models = combination.settings.validation.follower_models
    of_model = {
        model: PolicyLosses(artefacts.read(work, "losses", where=[("followers", "==", model)])) for model in models
    }
    each = partial(_of_each_model, of_model)
    profile = combination.settings.validation.safety.profile
    matrix = each(lambda one: validation_matrix(events, one, settings=settings, seed=seed))
    yield "validation_matrix", matrix.assign(safety=profile)
    priced = artefacts.read(work, "safety_losses")
    yield "safety_price", safety_price(priced, settings, seed=seed)
    yield "safety_violations", safety_violations(priced)
    yield "summary_losses", each(lambda one: summarise_losses(one, settings=settings, seed=seed))
    yield "worse_for_somebody", each(lambda one: worse_for_somebody(one, settings))
    yield "gain_map", each(lambda one: gain_map(events, one, settings, seed=seed))
    yield "leave_one_out", each(lambda one: leave_one_out(events, one, settings, seed=seed))
    yield "cross_scores", cross_scores(artefacts.read(work, "cross_losses"), models, settings, seed=seed)
    skilful = (models[0], *judges_of(work, combination.settings.validation).skilful)
    planned = _of_default(work, "cross_losses", models, column="planned_with")
    gains = event_gains(planned, skilful)
    yield "event_gains", gains
    yield "situation_ranking", situation_ranking(events, gains, of_model[models[0]])
    yield "robust_summary", robust_summary(planned, skilful, settings, seed=seed)
    yield "horizon_sensitivity", horizon_sensitivity(artefacts.read(work, "horizon_losses"), settings, seed=seed)
    yield "start_map", start_map(events, _of_default(work, "plans", models, read=STARTED), of_model[models[0]])
    yield "foresight_summary", foresight_summary(artefacts.read(work, "foresight"), settings, seed=seed)
    yield "tracking_summary", tracking_summary(_of_default(work, "tracking", models))
    yield "tracking_contacts", tracking_contacts(artefacts.read(work, "tracking"))
    yield "solver_summary", solver_summary(artefacts.read(work, "solver_comparison"))
    yield "leaderboard", leaderboard(work, models[0])
    yield "sumo_summary", sumo_summary(artefacts.read(work, "sumo_followers"))


def _of_each_model(
    losses: Mapping[str, PolicyLosses], table: Callable[[PolicyLosses], pd.DataFrame]
) -> pd.DataFrame:
    """A table of each follower model, one after the other, the default one first."""
    found = [table(one).assign(followers=model) for model, one in losses.items()]
    filled = [frame for frame in found if len(frame)]
    return pd.concat(filled, ignore_index=True) if filled else found[0]


def _of_default(
    work: Path,
    name: str,
    models: Sequence[str],
    *,
    column: str = "followers",
    read: Sequence[str] | None = None,
) -> pd.DataFrame:
    """The rows of an artefact that the default follower model made.

    column: which names the model; read: the columns that are needed.
    """
    columns = None if read is None else [*read]
    return artefacts.read(work, name, columns=columns, where=[(column, "==", models[0])])
