"""The multiverse: a sample of events planned anew under every defensible choice (equations.md 12.7)."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from highd_lc.io import artefacts
from highd_lc.io.choices import Variant, variants_of
from highd_lc.planning.planner import PlanningProblem, plan_one, pose
from highd_lc.planning.scene import Scene
from highd_lc.stages.safety_price import plan_losses
from highd_lc.stages.scene_drivers import read_drivers
from highd_lc.stages.scenes import SceneTables, driven_by, make_scene, read_scene_tables, scene_makers
from highd_lc.stages.statistics import PolicyLosses, situations, validation_matrix
from highd_lc.stages.validate_samples import samples
from highd_lc.vocab import names
from highd_lc.vocab.errors import ArtefactError, told
from highd_lc.vocab.job import Combination, Job, JobReport, Problem
from highd_lc.vocab.policy import PAIRS
from highd_lc.vocab.settings import ValidateSettings
from highd_lc.vocab.tables import TABLES

Row = dict[str, Any]

STAGE: Final = "multiverse"
LOSSES: Final = "multiverse_losses"
_BENCHMARK, _LOCAL = PAIRS[names.FIXED]


def run(job: Job) -> JobReport:
    """Plan the sampled events of a recording under every choice; writes ``multiverse_losses``.

    Events that validate could not plan are listed there, and left out here.
    """
    planned = artefacts.read_part(job.work, "validate", "losses", job.recording, columns=["event_id"])
    sample = samples(job).varied & frozenset(planned["event_id"])
    rows, problems = _plan_sample(job, sample) if sample else ([], [])
    columns = list(TABLES[LOSSES].column_names)
    artefacts.write_part(job, STAGE, LOSSES, pd.DataFrame(rows, columns=columns, dtype=None if rows else object))
    return JobReport({LOSSES: len(rows)}, tuple(problems))


def _plan_sample(job: Job, sample: frozenset[str]) -> tuple[list[Row], list[Problem]]:
    """What the sampled events of a recording come to, and which of them cannot be planned so."""
    settings = job.settings.validation
    tables = read_scene_tables(job.work, job.recording, settings)
    varied = Multiverse.of(job, tables, sample)
    rows: list[Row] = []
    problems = []
    for event, (event_id, scene_of) in zip(
        tables.events.itertuples(), scene_makers(tables, settings), strict=True
    ):
        if event_id not in varied.sample:
            continue
        try:
            found = list(varied.rows(event, pose(scene_of(), settings)))
        except Exception as error:
            # One bad event never stops the others, and is left out as a whole: it is listed with its reason.
            problems.append(Problem(job.recording, STAGE, told(event_id, error)))
            continue
        rows += [{"event_id": event_id, "recording_id": job.recording, **row} for row in found]
    return rows, problems


def combine(combination: Combination) -> JobReport:
    """Join the parts and write the table ``multiverse``."""
    work, settings = combination.work, combination.settings
    artefacts.concatenate(work, STAGE, LOSSES, combination.recordings, combination.provenance)
    found = multiverse(work, situations(work), settings=settings.validation, seed=settings.seed)
    artefacts.write(
        artefacts.path_of(work, "multiverse"), artefacts.to_arrow("multiverse", found, combination.provenance)
    )
    return JobReport({"multiverse": len(found)})


@dataclass(frozen=True)
class Multiverse:
    """What a recording's sampled events are planned under.

    tables: with the drivers of every follower model that a variant names, as far as calibrate made them; sample:
    ids of the events.
    """

    variants: tuple[Variant, ...]
    tables: SceneTables
    sample: frozenset[str]

    @classmethod
    def of(cls, job: Job, tables: SceneTables, sample: frozenset[str]) -> "Multiverse":
        """The variants of the run's settings. tables: of the recording."""
        mine = sample & frozenset(tables.events["event_id"])
        variants = variants_of(job.settings.validation) if mine else ()
        drivers = dict(tables.drivers)
        for model in {variant.settings.follower_models[0] for variant in variants} - drivers.keys():
            with suppress(ArtefactError):  # calibrated without it: such a variant has no events
                drivers[model] = read_drivers(job.work, job.recording, tables.followers, model)
        return cls(variants, replace(tables, drivers=drivers), mine)

    def rows(self, event: Any, problem: PlanningProblem) -> Iterator[Row]:
        """Rows of ``multiverse_losses`` of a sampled event.

        event: row of ``events``; problem: as the run poses it, with the default follower model.
        """
        posed = _Posed(event, problem, self.tables)
        for variant in self.variants:
            found = posed.of(variant.settings)
            if found is not None:
                yield from _variant_rows(variant, found)


class _Posed:
    """An event under different settings: what they have in common is made once."""

    def __init__(self, event: Any, problem: PlanningProblem, tables: SceneTables) -> None:
        self._event, self._run, self._tables = event, problem, tables
        self._scenes = {_seen_by(problem.settings): problem.scene}

    def of(self, settings: ValidateSettings) -> PlanningProblem | None:
        """The problem that the settings pose; None where there is no driver of their follower model."""
        if settings is self._run.settings:
            return self._run
        scene, model = self._scene(settings), settings.follower_models[0]
        if model != self._run.settings.follower_models[0]:
            if (scene.event_id,) not in self._tables.drivers.get(model, {}):
                return None
            scene = driven_by(scene, model, self._tables)
        return pose(scene, settings)

    def _scene(self, settings: ValidateSettings) -> Scene:
        """With the followers of the default model."""
        key = _seen_by(settings)
        if key not in self._scenes:
            self._scenes[key] = make_scene(self._event, self._tables, settings)
        return self._scenes[key]


def _seen_by(settings: ValidateSettings) -> tuple[Any, ...]:
    """What of the settings decides how a scene looks."""
    return settings.loss.horizon_s, settings.planner.leaders, settings.planner.human_smoothing_s


def _variant_rows(variant: Variant, problem: PlanningProblem) -> Iterator[Row]:
    """Both policies of the fixed form, with the loss of no lane change beside them."""
    still = plan_one(problem, names.NO_LANE_CHANGE, variant.accounting)
    unchanged = sum(plan_losses(problem, still).values())
    for policy in (_BENCHMARK, _LOCAL):
        plan = plan_one(problem, policy, variant.accounting)
        yield {
            "variant": variant.name,
            "policy": policy,
            "accounting": variant.accounting,
            "status": plan.status,
            "contact": plan.contact,
            "loss_unchanged": unchanged,
            **plan_losses(problem, plan),
        }


def multiverse(work: Path, events: pd.DataFrame, *, settings: ValidateSettings, seed: int) -> pd.DataFrame:
    """The table ``multiverse``: the gain of every variant over its own feasible events.

    Args:
        work: with ``multiverse_losses``; without a row of these the table is empty.
        events: see ``statistics.situations``.
        settings: of the run.
        seed: of the run.
    """
    losses = artefacts.read(work, LOSSES)
    columns = list(TABLES["multiverse"].column_names)
    if losses.empty:
        return pd.DataFrame(columns=columns, dtype=object)
    found = multiverse_rows(losses, events, variants=variants_of(settings), settings=settings, seed=seed)
    return pd.DataFrame(found, columns=columns)


def multiverse_rows(
    losses: pd.DataFrame,
    events: pd.DataFrame,
    *,
    variants: Sequence[Variant],
    settings: ValidateSettings,
    seed: int,
) -> list[Row]:
    """One row a variant. losses: rows of ``multiverse_losses``; the others: see ``multiverse``."""
    by_variant: Mapping[Any, pd.DataFrame] = dict(iter(_as_losses(losses).groupby("variant")))
    rows = []
    for variant in variants:
        found = by_variant.get(variant.name)
        gain = _NOBODY if found is None else _gain(PolicyLosses(found), events, settings, seed=seed)
        rows.append(_choices(variant) | gain)
    return rows


def _as_losses(losses: pd.DataFrame) -> pd.DataFrame:
    """Rows of ``multiverse_losses`` with the columns of ``losses``, and a row of no lane change to each event."""
    planned = losses.assign(loss_total=losses["loss_av"] + losses["loss_hv"])
    still = losses[losses["policy"] == _BENCHMARK].assign(policy=names.NO_LANE_CHANGE, contact="")
    still = still.assign(loss_total=still["loss_unchanged"], loss_av=np.nan, loss_hv=np.nan)
    both = pd.concat([planned, still], ignore_index=True)
    both = both.reindex(columns=["variant", *TABLES["losses"].column_names])
    return both.assign(loss_hv_each=pd.Series([[] for _ in both.index], index=both.index, dtype=object))


def _choices(variant: Variant) -> Row:
    """Every choice as a column."""
    settings = variant.settings
    loss, planner = settings.loss, settings.planner
    return {
        "variant": variant.name,
        "kind": variant.kind,
        "changes": list(variant.changes),
        "followers": settings.follower_models[0],
        "leader_from": planner.leader_from,
        "accounting": variant.accounting,
        "horizon_s": loss.horizon_s,
        "v_ref_av": loss.v_ref_av,
        "v_ref_hv": loss.v_ref_hv,
        "reference": loss.reference,
        "aggregation": loss.aggregation,
        "comfort_scale": loss.comfort_scale,
        "T_max": planner.T_max,
        "leaders": planner.leaders,
        "after": planner.after,
        "handover": loss.handover,
        "safety": settings.safety.profile,
    }


_NOBODY: Final = {"n_events": 0, "n_recordings": 0, "infeasible": 0, "contacts": 0}
"""Of a variant without events: nothing but counts."""
_NUMBERS: Final = (
    *_NOBODY,
    "total_benchmark",
    "total_local",
    "gain",
    "gain_low",
    "gain_high",
    "gain_hv",
    "gain_av",
    "gain_incremental",
)


def _gain(losses: PolicyLosses, events: pd.DataFrame, settings: ValidateSettings, *, seed: int) -> Row:
    """The numbers of the validation matrix's cell over these events."""
    cell = validation_matrix(events, losses, settings.statistics, seed=seed, divided=False).iloc[0]
    return {name: cell[name] for name in _NUMBERS}
