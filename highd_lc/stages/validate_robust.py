"""Plans of who does not know the followers, and all plans under every follower model (equations.md 7.4)."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from highd_lc.io import artefacts
from highd_lc.planning import planner
from highd_lc.planning.crowd import Crowd, crowd_of, event_generator
from highd_lc.planning.planner import PlanningProblem
from highd_lc.scoring.population import Bootstrap, bootstrap_of, mean_interval, ratio_interval, seen
from highd_lc.stages.population_tables import tiles
from highd_lc.stages.scenes import SceneTables, driven_by
from highd_lc.stages.statistics import PolicyLosses
from highd_lc.tracking.plan_tracking import PlanTracker
from highd_lc.vocab import names
from highd_lc.vocab.policy import PAIRS, ROBUST_PAIRS
from highd_lc.vocab.sections import StatisticsSettings
from highd_lc.vocab.settings import ValidateSettings
from highd_lc.vocab.tables import TABLES
from highd_lc.vocab.tables.robust import EXPECTED, WORST

Row = dict[str, Any]

_HORIZONS: Final = (5.0, 8.0)
"""Times after t_start at which a model needs skill [s]."""


@dataclass(frozen=True)
class Judges:
    """Follower models of a run beside the default one. every: all that answer the lane changer; skilful: those of
    them that predict better than the best naive model, the best first.
    """

    every: tuple[str, ...]
    skilful: tuple[str, ...]


def judges_of(work: Path, settings: ValidateSettings) -> Judges:
    """The follower models that calibrate judged; none where no event is planned robustly."""
    if settings.robust.sample == 0:
        return Judges((), ())
    return judges_among(artefacts.read(work, "prediction_summary"), settings.follower_models[0])


def judges_among(summary: pd.DataFrame, default: str) -> Judges:
    """The same from the rows of ``prediction_summary``. default: the model that plans."""
    rows = summary[(summary["stratum"] == "all") & summary["horizon_s"].isin(_HORIZONS)]
    rows = rows[~rows["model"].isin((*names.NAIVE_MODELS, default))]
    skill = rows.groupby("model")["skill_naive"].min().sort_index().sort_values(ascending=False, kind="stable")
    return Judges(tuple(sorted(skill.index)), tuple(skill.index[skill > 0.0]))


def trackers_of(problem: PlanningProblem, judges: Judges, tables: SceneTables) -> dict[str, PlanTracker]:
    """The event posed with every follower model beside the default one."""
    posed = {model: driven_by(problem.scene, model, tables) for model in judges.every}
    return {model: PlanTracker(planner.pose(scene, problem.settings)) for model, scene in posed.items()}


def crowd_for(problem: PlanningProblem, trackers: dict[str, PlanTracker], judges: Judges, *, seed: int) -> Crowd:
    """Who the followers of an event may be. trackers: see ``trackers_of``; seed: of the run."""
    robust, scene = problem.settings.robust, problem.scene
    return crowd_of(
        problem.packed,
        scene.followers.spread,
        [trackers[model].problem.packed for model in judges.skilful],
        robust=robust,
        rng=event_generator(seed, scene.event_id, purpose="crowd"),
    )


_POLICIES: Final = {
    form: (*PAIRS[form], robust) for form, (_, robust) in zip(names.FORMS, ROBUST_PAIRS.values(), strict=True)
}
"""Of each form: benchmark, local optimum, robust local optimum."""


def event_gains(cross: pd.DataFrame, models: Sequence[str]) -> pd.DataFrame:
    """The table ``event_gains``: what each event's plans gain under the models of positive skill.

    cross: ``cross_losses`` of the plans made with the default model; models: that one first, then the others.
    """
    rows = [row for cell in _cells(cross) for row in _event_rows(cell, models)]
    return pd.DataFrame(rows, columns=list(TABLES["event_gains"].column_names))


@dataclass(frozen=True)
class _Cell:
    """The totals of one form and accounting: one row an event, columns policy and model; NaN after a contact."""

    form: str
    accounting: str
    totals: pd.DataFrame
    recordings: pd.Series

    @property
    def policies(self) -> tuple[str, str, str]:
        return _POLICIES[self.form]

    def gain(self, policy: str) -> pd.DataFrame:
        """Gain of a policy over the benchmark, one row an event, one column a model."""
        own, benchmark = (self.totals.xs(name, axis=1, level="policy") for name in (policy, self.policies[0]))
        return pd.DataFrame(1.0 - own / benchmark)


def _cells(cross: pd.DataFrame) -> Iterator[_Cell]:
    robust = cross.loc[cross["policy"].isin(names.ROBUST_POLICIES), "event_id"].unique()
    rows = cross[cross["event_id"].isin(robust)]
    recordings = rows.groupby("event_id")["recording_id"].first()
    for form, accounting in product(_POLICIES, names.ACCOUNTINGS):
        chosen = rows[(rows["accounting"] == accounting) & rows["policy"].isin(_POLICIES[form])]
        if set(chosen["policy"]) == set(_POLICIES[form]):
            av = "av_to_H" if accounting == names.EQUAL else "av_to_T"
            hv = "hv_to_T" if accounting == names.PAPER else "hv_to_H"
            totals = chosen.assign(total=chosen[av] + chosen[hv]).pivot_table(
                index="event_id", columns=["policy", "scored_with"], values="total", dropna=False
            )
            yield _Cell(form, accounting, totals, recordings.reindex(totals.index))


def _event_rows(cell: _Cell, models: Sequence[str]) -> Iterator[Row]:
    for policy in cell.policies[1:]:
        gains = cell.gain(policy).reindex(columns=list(models))
        known = gains.notna().any(axis=1)
        for event_id, of_event in gains[known].iterrows():
            yield {
                "event_id": event_id,
                "recording_id": int(cell.recordings[str(event_id)]),
                "form": cell.form,
                "accounting": cell.accounting,
                "policy": policy,
                "n_models": int(of_event.notna().sum()),
                "gain": of_event[models[0]],
                "gain_expected": of_event.mean(),
                "gain_worst": of_event.min(),
                "worst_model": of_event.idxmin(),
            }


def robust_summary(
    cross: pd.DataFrame, models: Sequence[str], statistics: StatisticsSettings, *, seed: int
) -> pd.DataFrame:
    """The table ``robust_summary``: local optimum and robust one side by side, on the same events.

    cross, models: see ``event_gains``.
    """
    bootstrap = bootstrap_of(statistics, seed=seed)
    rows = [row for cell in _cells(cross) for row in _summary_rows(cell, models, bootstrap)]
    return pd.DataFrame(rows, columns=list(TABLES["robust_summary"].column_names))


def _summary_rows(cell: _Cell, models: Sequence[str], bootstrap: Bootstrap) -> Iterator[Row]:
    about = {"form": cell.form, "accounting": cell.accounting}
    for model in cell.totals.columns.unique("scored_with"):
        for policy, columns in _of_model(cell, model, bootstrap):
            yield about | {"policy": policy, "scored_with": model, "skilful": model in models} | columns
    for measure in (EXPECTED, WORST):
        for policy, columns in _over_models(cell, models, measure, bootstrap):
            yield about | {"policy": policy, "scored_with": measure, "skilful": True} | columns


def _of_model(cell: _Cell, model: str, bootstrap: Bootstrap) -> Iterator[tuple[str, Row]]:
    """Gain by the ratio of sums under one model, over the events in which all three plans have a total."""
    benchmark, local, robust = (cell.totals[policy][model] for policy in cell.policies)
    both = benchmark.notna() & local.notna() & robust.notna()
    recordings = cell.recordings[both].to_numpy()
    for policy, own in zip(cell.policies[1:], (local, robust), strict=True):
        totals = own[both].to_numpy(), benchmark[both].to_numpy()
        ratio = ratio_interval(recordings, *totals, bootstrap)
        gain = 1.0 - totals[0].sum() / totals[1].sum() if both.any() else np.nan
        beyond = (local - own)[both].to_numpy() / totals[1]
        yield policy, _columns(gain, (1.0 - ratio.high, 1.0 - ratio.low), beyond, recordings, len(both), bootstrap)


def _over_models(
    cell: _Cell, models: Sequence[str], measure: str, bootstrap: Bootstrap
) -> Iterator[tuple[str, Row]]:
    """Mean over events of an event's mean or least gain over the models of positive skill."""
    gains = [cell.gain(policy).reindex(columns=list(models)) for policy in cell.policies[1:]]
    both = gains[0].notna().all(axis=1) & gains[1].notna().all(axis=1)
    recordings = cell.recordings[both].to_numpy()
    found = [g[both].mean(axis=1) if measure == EXPECTED else g[both].min(axis=1) for g in gains]
    for policy, own in zip(cell.policies[1:], found, strict=True):
        interval = mean_interval(recordings, own.to_numpy(), bootstrap)
        beyond = (own - found[0]).to_numpy()
        ends = interval.low, interval.high
        yield policy, _columns(own.mean(), ends, beyond, recordings, len(both), bootstrap)


def _columns(
    gain: float, ends: tuple[float, float], beyond: Any, recordings: Any, n: int, bootstrap: Bootstrap
) -> Row:
    """beyond: of each event compared, its gain beyond that of the plain local optimum."""
    interval = mean_interval(recordings, beyond, bootstrap)
    return {
        "n_events": n,
        "n_compared": len(beyond),
        "gain": float(gain),
        "gain_low": ends[0],
        "gain_high": ends[1],
        "beyond_plain": float(np.mean(beyond)) if len(beyond) else np.nan,
        "beyond_low": interval.low,
        "beyond_high": interval.high,
    }


def situation_ranking(events: pd.DataFrame, gains: pd.DataFrame, losses: PolicyLosses) -> pd.DataFrame:
    """The table ``situation_ranking``: where each policy gains most, for sure and on average.

    events: see ``statistics.situations``; gains: ``event_gains``; losses: of the default model.
    """
    primary = gains[gains["accounting"] == names.PRIMARY_ACCOUNTING]
    parts = []
    for (form, policy), own in primary.groupby(["form", "policy"]):
        benchmark = _POLICIES[str(form)][0]
        own = own.set_index("event_id").join(losses.in_view(names.PRIMARY_ACCOUNTING, str(policy), benchmark))
        rows = [edges | _situation(own.iloc[inside]) for edges, inside in tiles(events.loc[own.index])]
        frame = pd.DataFrame(rows).assign(form=str(form), policy=str(policy))
        for measure in ("expected", "worst"):
            place = frame[f"gain_{measure}"].rank(ascending=False, method="first")
            frame[f"rank_{measure}"] = place.astype(int)
        parts.append(frame.sort_values("rank_worst"))
    columns = list(TABLES["situation_ranking"].column_names)
    return pd.concat(parts, ignore_index=True)[columns] if parts else pd.DataFrame(columns=columns, dtype=object)


def _situation(own: pd.DataFrame) -> Row:
    means = {name: float(own[name].mean()) for name in ("gain_expected", "gain_worst")}
    about = {"n_events": len(own), "share_positive": float((own["gain_worst"] > 0.0).mean())}
    return about | means | seen(own["error"], own["effect"])
