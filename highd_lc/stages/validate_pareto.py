"""Rows of the Pareto study: for each form with a free end speed, with and without the choice of the start."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from highd_lc.algorithms import pareto, pareto_search
from highd_lc.algorithms.pareto import Points
from highd_lc.algorithms.starts import StartProblem, pose_starts
from highd_lc.stages.validate_studies import Study
from highd_lc.vocab import names
from highd_lc.vocab.settings import StudySettings
from highd_lc.vocab.study_tables import FRONT, SWEEP

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
    space = pareto_search.plan_space(task)
    return _front(study, space, "nsga2"), pareto_search.sweep(task, names.PRIMARY_ACCOUNTING, omegas)


def _with_start(study: Study, posed: StartProblem) -> Found:
    space = pareto_search.start_space(posed)
    swept = pareto_search.sweep_starts(posed, names.PRIMARY_ACCOUNTING, study.settings.omegas)
    return _front(study, space, "nsga2 start"), swept


def _front(study: Study, space: pareto_search.Space | None, purpose: str) -> Points:
    settings = study.settings
    size = {"population": settings.population, "generations": settings.generations}
    return pareto_search.nsga2_front(space, names.PRIMARY_ACCOUNTING, **size, rng=study.rng(purpose))


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
