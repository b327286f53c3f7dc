"""Which events of a run are studied more closely: seeded samples, the same in every process and order.

Rows of the Pareto study: for each form with a free end speed, with and without the choice of the start.

Rows of the table of plans.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from highd_lc.io import artefacts
from highd_lc.planning import pareto
from highd_lc.planning.pareto import Points
from highd_lc.planning.planner import Plan, PlanningProblem
from highd_lc.planning.replay import own_duration
from highd_lc.planning.starts import StartProblem, pose_starts
from highd_lc.scoring.uncertainty import stratified_sample
from highd_lc.stages.validate_studies import Study
from highd_lc.vocab import names
from highd_lc.vocab.job import Job
from highd_lc.vocab.sections import StudySettings
from highd_lc.vocab.settings import ValidateSettings
from highd_lc.vocab.tables.studies import FRONT, SWEEP

_ALL = 2**62
_MOST_TRACED = 1000
"""Up to this many events, ``trajectories = "auto"`` writes the motions of all of them."""
_TRACED = {"auto": 500, "sample": 500, "all": _ALL, "none": 0}
_MOST_FOLLOWERS = 3
"""Strata of the sample tell this many followers from fewer, and more no further."""


@dataclass(frozen=True)
class Samples:
    """Ids of the events that are studied, of those on which the solvers are compared, of those whose start is
    chosen as well, of those among them that are planned with predicted leaders, of those whose plans the
    multi-body car drives, of those that the further follower models plan too, of those planned robustly as
    well, of those with written motions, of those that are planned under both safety profiles, of those that
    are planned under every choice of the multiverse, of those that are driven in the closed loop, and of those
    that are replayed in SUMO.
    """

    studied: frozenset[str]
    compared: frozenset[str]
    started: frozenset[str]
    foreseen: frozenset[str]
    multi_body: frozenset[str]
    also: frozenset[str]
    robust: frozenset[str]
    traced: frozenset[str]
    priced: frozenset[str]
    varied: frozenset[str]
    replanned: frozenset[str]
    simulated: frozenset[str]


def samples(job: Job) -> Samples:
    """The run's samples, drawn from all events of all recordings by class, direction and number of followers."""
    settings = job.settings.validation
    drawn_at = artefacts.path_of(job.work, "events").stat().st_mtime_ns
    drawn = _drawn(job.work, drawn_at, settings, job.settings.seed)
    if not settings.studies.chosen:
        return drawn
    studies = [
        "studied",
        "compared",
        "started",
        "foreseen",
        "multi_body",
        "robust",
        "priced",
        "varied",
        "replanned",
    ]
    studies += ["simulated"] * (settings.sumo.events > 0)  # which needs SUMO
    return replace(drawn, **dict.fromkeys(studies, frozenset(settings.studies.chosen)))


@lru_cache(maxsize=1)
def _drawn(work: Path, written: int, settings: ValidateSettings, seed: int) -> Samples:
    """The samples, drawn once for all recordings that a process works on. written: when the events were [ns]."""
    events = artefacts.read(work, "events", columns=["event_id", "ego_class", "direction", "follower_ids"])
    count = events["follower_ids"].map(len).clip(upper=_MOST_FOLLOWERS)
    strata = dict(
        zip(events["event_id"], zip(events["ego_class"], events["direction"], count, strict=True), strict=True)
    )
    sample = partial(stratified_sample, strata, seed=seed)
    studies = settings.studies
    started = sample({"none": 0, "sample": studies.start_sample, "all": _ALL}[settings.planner.start])
    starts = {event: stratum for event, stratum in strata.items() if event in started}
    every = settings.trajectories == "auto" and len(strata) <= _MOST_TRACED
    return Samples(
        studied=sample(studies.sample),
        compared=sample(studies.solver_sample),
        started=started,
        foreseen=stratified_sample(starts, studies.foresight_sample, seed=seed),
        multi_body=sample(studies.multibody_sample),
        also=sample(settings.followers.also_sample),
        robust=sample(settings.robust.sample),
        traced=sample(_ALL if every else _TRACED[settings.trajectories]),
        priced=sample(studies.safety_sample),
        varied=sample(settings.multiverse.sample),
        replanned=sample(settings.closed_loop.events),
        simulated=sample(settings.sumo.events),
    )


Row = dict[str, Any]
Found = tuple[Points, Points]
"""Front by NSGA-II and sweep over omega_AV."""


def pareto_rows(study: Study) -> Iterator[tuple[str, Row]]:
    """Rows of ``pareto`` and ``pareto_summary`` under the primary accounting, free end speed."""
    chooses = names.FREE_START in study.start_forms
    for form in (names.FREE, names.FREE_START) if chooses else (names.FREE,):
        if not study.solvable:
            yield "pareto_summary", {"form": form, "n_front": 0, "evaluations": 0}
            continue
        posed = pose_starts(study.problem)
        front, swept = _with_start(study, posed) if form == names.FREE_START else _without(study)
        best = pareto.knee(front)
        for row in _point_rows(study, posed, front, swept, best):
            yield "pareto", {"form": form} | row
        yield "pareto_summary", {"form": form} | _summary(front, swept, best, study.settings)


def _without(study: Study) -> Found:
    task, omegas = study.problem.task, study.settings.omegas
    space = pareto.plan_space(task)
    return _front(study, space, "nsga2"), pareto.sweep(task, names.PRIMARY_ACCOUNTING, omegas)


def _with_start(study: Study, posed: StartProblem) -> Found:
    space = pareto.start_space(posed)
    swept = pareto.sweep_starts(posed, names.PRIMARY_ACCOUNTING, study.settings.omegas)
    return _front(study, space, "nsga2 start"), swept


def _front(study: Study, space: pareto.Space | None, purpose: str) -> Points:
    settings = study.settings
    size = {"population": settings.population, "generations": settings.generations}
    return pareto.nsga2_front(space, names.PRIMARY_ACCOUNTING, **size, rng=study.rng(purpose))


def _point_rows(
    study: Study, posed: StartProblem, front: Points, swept: Points, best: int | None
) -> Iterator[Row]:
    for kind, points in ((FRONT, front), (SWEEP, swept)):
        omegas = study.settings.omegas if kind == SWEEP else (np.nan,) * len(points)
        for k, omega in enumerate(omegas[: len(points)]):
            about = {"kind": kind, "omega_av": omega, "knee": kind == FRONT and k == best}
            yield about | _point(posed, points, k)


def _point(posed: StartProblem, points: Points, k: int) -> Row:
    gap, d = int(points.gap[k]), int(points.delay[k])
    task = posed.task((gap, d)) if d or gap else posed.problem.task
    plan = task.quintic(int(points.n[k]), float(points.delta[k]), float(points.change[k]))
    start = {"delay_s": round(d * posed.problem.packed.dt, 10), "gap": posed.gaps[gap].name}
    losses = {"loss_av": float(points.loss_av[k]), "loss_hv": float(points.loss_hv[k])}
    return {"point": k, "T": plan.T, "x_final": plan.x_final, "v_end": plan.v_end} | start | losses


def _summary(front: Points, swept: Points, best: int | None, settings: StudySettings) -> Row:
    compared = pareto.compare(front, swept, settings.omegas)
    row: Row = {
        "n_front": len(front),
        "evaluations": settings.population * settings.generations,
        "hypervolume": compared.hypervolume,
        "hypervolume_sweep": compared.hypervolume_sweep,
        "reference_av": compared.reference[0],
        "reference_hv": compared.reference[1],
        "front_behind": compared.behind,
        "front_ahead": compared.ahead,
    }
    if best is not None:
        low, high = pareto.knee_weights(front, best)
        row |= {"knee_loss_av": float(front.loss_av[best]), "knee_loss_hv": float(front.loss_hv[best])}
        row |= {"knee_omega_low": low, "knee_omega_high": high}
    return row


_ROUNDING = 1e-9
"""A drive whose limit bounds it is on the limit, but for rounding."""


def plan_row(problem: PlanningProblem, plan: Plan) -> Row:
    """The columns of ``plans`` of one plan."""
    margin = problem.packed.safety.clearance
    clearances = [value + margin for name, value in plan.margins.items() if name.startswith("clearance_")]
    return {
        "policy": plan.policy,
        "accounting": plan.accounting,
        **_shape(problem, plan),
        "delay_s": np.nan if plan.replay is None else plan.delay_s,
        "gap": "" if plan.replay is None else plan.gap,
        "status": plan.status,
        "at_bound": _at_bound(problem, plan),
        "rejected_by": plan.rejected_by,
        "candidates": plan.candidates,
        "min_clearance_m": _finite(min(clearances, default=np.nan)) if plan.replay else np.nan,
        "margins": {name: float(value) for name, value in plan.margins.items() if np.isfinite(value)},
        "moments": plan.moments,
        "fallback": plan.fallback,
        "binding": plan.binding,
        "violations": _violated(plan),
        "contact": plan.contact,
        "contact_after_T": None if plan.replay is None else bool((plan.replay.clearance_after_T < 0.0).any()),
        "braking_after_T": _braking_afterwards(plan),
        "start_acceleration_jump": problem.scene.a0,
        "objective": plan.objective,
    }


def _shape(problem: PlanningProblem, plan: Plan) -> Row:
    """T, x_final and v_end: of the quintic, or of the motion where there is none."""
    if plan.replay is None:
        return {"T": np.nan, "x_final": np.nan, "v_end": np.nan, "v_start": np.nan}
    if plan.quintic is not None:
        q = plan.quintic
        return {"T": q.T, "x_final": q.x_final, "v_end": q.v_end, "v_start": q.v0}
    av = plan.replay.av
    T = round(av.n * problem.scene.dt, 10)
    return {
        "T": T,
        "x_final": float(av.x[av.n] - av.x[0]),
        "v_end": float(av.vx[av.n]),
        "v_start": float(av.vx[0]),
    }


def _braking_afterwards(plan: Plan) -> float:
    """Strongest braking of the AV in its drive after T [m/s^2, positive], NaN without a plan or a drive."""
    if plan.replay is None or plan.replay.av.n + 1 >= len(plan.replay.av.ax):
        return np.nan
    return float(max(0.0, -plan.replay.av.ax[plan.replay.av.n :].min()))


def _at_bound(problem: PlanningProblem, plan: Plan) -> list[str]:
    settings, H = problem.settings.search, (len(problem.packed.target_v) - 1) * problem.packed.dt
    if plan.status == names.REFERENCE:
        human = problem.scene.human if plan.policy == names.HUMAN else None
        return ["T"] if own_duration(human, problem.packed) > H + 1e-9 else []
    if plan.status != names.SOLVED or plan.quintic is None:
        return []
    edge = [b for b in (settings.T_min, min(settings.T_max, H)) if abs(plan.quintic.T - b) < 1e-9]
    waited = 0.0 < settings.max_delay_s <= plan.delay_s + 1e-9
    return (["T"] if edge else []) + (["delay_s"] if waited else []) + plan.at_bound


def _violated(plan: Plan) -> list[str]:
    if plan.status not in (names.REFERENCE, names.CONTACT):
        return []
    return [name for name, margin in plan.margins.items() if margin < -_ROUNDING]


def _finite(value: float) -> float:
    return value if np.isfinite(value) else np.nan
