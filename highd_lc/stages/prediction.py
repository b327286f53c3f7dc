"""Tables of how followers are predicted: models of each follower, errors, summary, dose-response, externality."""

from collections.abc import Hashable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from highd_lc.core.drive import hardest_braking
from highd_lc.drivers import models
from highd_lc.drivers.prediction import (
    CLOSINGS,
    COVARIATES,
    EXTERNALITY_HORIZONS,
    HORIZONS,
    SPACINGS,
    CrossFit,
    Judged,
    Scales,
    class_labels,
    in_view,
    judge,
    loss_change,
)
from highd_lc.drivers.responses import TIME_STEP, Behaviours, Responses, Simulated, simulate
from highd_lc.io import artefacts
from highd_lc.planning.scene import MOMENT_OF
from highd_lc.scoring.population import cluster_interval
from highd_lc.stages.responses import load_population, responses_of, save_population
from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS
from highd_lc.vocab.job import Combination
from highd_lc.vocab.settings import Settings
from highd_lc.vocab.tables import TABLES
from highd_lc.vocab.tables.prediction import CONTROL, OBSERVED, RECORDED

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Judgement:
    """Followers under every model. rows: of ``responses``, with class and ids; simulated: by model."""

    rows: pd.DataFrame
    responses: Responses
    simulated: dict[str, Simulated]
    behaviours: dict[str, tuple[str, Behaviours]]
    folds: NDArray[np.object_]


def scales(settings: Settings) -> Scales:
    """How followers' losses are scaled in a run."""
    loss = settings.validation.loss
    return Scales(loss.v_ref_hv, loss.comfort_scale, loss.efficiency_scale)


def predict(combination: Combination, followers: pd.DataFrame) -> None:
    """Fit the population, judge every model and write the tables of prediction. followers: the finished table."""
    work, settings = combination.work, combination.settings
    recordings = sorted(combination.recordings)
    rows, controls = (_parts(work, name, recordings) for name in ("responses", "controls"))
    responses = responses_of(rows)
    given = settings.validation.followers.population
    moment = MOMENT_OF[settings.validation.planner.leader_from]
    crossfit = CrossFit(responses, given=load_population(Path(given)) if given else None, moment=moment)
    judgement = judge_all(
        rows, responses, _fits(rows, followers), crossfit, _chosen(settings),
        hardest=hardest_braking(settings.validation.followers.b_max),
    )  # fmt: skip
    errors, how = prediction(judgement, scales(settings)), settings.validation
    confidence = how.statistics.confidence
    for name, frame in (
        ("responses", rows),
        ("controls", controls),
        ("follower_models", follower_models(judgement)),
        ("prediction", errors),
        ("prediction_summary", prediction_summary(errors, how.follower_models[0], confidence=confidence)),
        ("dose_response", dose_response(errors)),
        ("externality", externality(judgement, scales(settings), controls)),
        ("externality_balance", externality_balance(controls)),
    ):
        table = artefacts.to_arrow(name, frame, combination.provenance)
        artefacts.write_groups(work, name, iter([table]), combination.provenance)
    save_population(work / "population.toml", crossfit.everybody())


def _parts(work: Path, name: str, recordings: list[int]) -> pd.DataFrame:
    """The rows of all recordings, none where there is none."""
    parts = [artefacts.read_part(work, "calibrate", name, recording) for recording in recordings]
    columns = list(TABLES[name].column_names)
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=columns, dtype=object)


def _chosen(settings: Settings) -> tuple[str, ...]:
    """The models that are judged: those of the setting, and those that plan.

    A population from a file cannot be fitted without a part.
    """
    wanted = dict.fromkeys((*settings.calibrate.models, *settings.validation.follower_models))
    given = bool(settings.validation.followers.population)
    return tuple(name for name in wanted if not (given and models.parse(name).removed))


def _fits(rows: pd.DataFrame, followers: pd.DataFrame) -> models.Fits:
    """The LCM of each response's follower."""
    keyed = followers.set_index(["event_id", "follower"])
    own = keyed.loc[list(zip(rows["event_id"], rows["follower"], strict=True))] if len(rows) else keyed.iloc[:0]
    parameters = own[list(PARAMETERS)].to_numpy(np.float64)
    fitted = (own["status"] == names.FITTED).to_numpy()
    return models.Fits(parameters, own["leader_length_m"].to_numpy(np.float64), fitted)


def judge_all(
    rows: pd.DataFrame, responses: Responses, fits: models.Fits, crossfit: CrossFit, chosen: tuple[str, ...], *,
    hardest: float,
) -> Judgement:  # fmt: skip
    """Simulate every follower under every chosen model, each behind the simulated follower ahead of it."""
    behaviours: dict[str, tuple[str, Behaviours]] = {}
    simulated = {}
    for name in chosen:
        behaviours[name] = crossfit.drives(name, responses, fits)
        simulated[name] = _chain(*behaviours[name], responses, hardest)
    return Judgement(rows, responses, simulated, behaviours, crossfit.fold_words(responses))


def _chain(family: str, behaviours: Behaviours, responses: Responses, hardest: float) -> Simulated:
    """Rank by rank: who has a simulated follower ahead follows that one."""
    out = Simulated(*(np.empty_like(responses.x) for _ in range(3)))
    ahead_x, ahead_v = responses.x_ahead.copy(), responses.v_ahead.copy()
    for rank in np.unique(responses.rank):
        own = np.flatnonzero(responses.rank == rank)
        part = responses.take(own)
        if rank > 1:
            part = _behind(part, ahead_x[:, own], ahead_v[:, own])
        found = simulate(family, Behaviours(*(values[own] for values in behaviours)), part, hardest=hardest)
        for whole, values in zip(out, found, strict=True):
            whole[:, own] = values
        follower = {int(event): place for event, place in zip(responses.event[own], own, strict=True)}
        for place in np.flatnonzero(responses.rank == rank + 1):
            leader = follower.get(int(responses.event[place]))
            if leader is not None:
                ahead_x[:, place], ahead_v[:, place] = out.x[:, leader], out.v[:, leader]
    return out


def _behind(part: Responses, x: FloatArray, v: FloatArray) -> Responses:
    fields = {name: getattr(part, name) for name in part.__dataclass_fields__}
    return Responses(**{**fields, "x_ahead": x, "v_ahead": v, "before_x": x, "before_v": v})


def follower_models(judgement: Judgement) -> pd.DataFrame:
    """The table ``follower_models``: every follower's constants under every model."""
    parts = []
    for name, (family, b) in judgement.behaviours.items():
        frame = judgement.rows[["event_id", "recording_id", "follower", "vehicle_id"]].copy()
        lcm, own = family == names.LCM, family != names.NO_COMMAND
        values = {
            "model": name, "family": family, "fold": judgement.folds if name.startswith(names.POPULATION) else "",
            "v_desire": b.v_desire if own else np.nan, "A": b.A if own else np.nan, "b": b.b if own else np.nan,
            "B": b.B if lcm else np.nan, "tau": b.tau if own else np.nan, "L": b.L if own else np.nan,
            "L_before": b.L_before if own else np.nan, "memory_s": b.memory, "relaxation_s": b.relaxation,
            "moment": b.moment if own else np.nan, "need": b.need, "a_0": b.a_0, "drift": b.drift,
        }  # fmt: skip
        parts.append(frame.assign(**values))
    return _table("follower_models", parts)


def prediction(judgement: Judgement, scales: Scales) -> pd.DataFrame:
    """The table ``prediction``: every follower, model and horizon that is in view."""
    r, rows = judgement.responses, judgement.rows
    about = rows[["event_id", "recording_id", "follower", "class"]].assign(
        spacing_m=r.x_ahead[0] - r.x[0], closing_mps=r.v[0] - r.v_ahead[0], speed_mps=r.v[0]
    )
    parts = []
    for name, found in judgement.simulated.items():
        for horizon in HORIZONS:
            seen = in_view(r, horizon)
            judged = judge(found, r, horizon, scales)
            parts.append(about.assign(model=name, horizon_s=horizon, **_judged_columns(judged))[seen])
    return _table("prediction", parts)


def _judged_columns(judged: Judged) -> dict[str, NDArray[np.generic]]:
    units = {"error_speed": "_mps", "error_position": "_m", "rmse_speed": "_mps"}
    units |= {"change_simulated": "_mps", "change_recorded": "_mps"}
    return {name + units.get(name, ""): values for name, values in judged._asdict().items()}


def _table(name: str, parts: list[pd.DataFrame]) -> pd.DataFrame:
    table = TABLES[name]
    columns = list(table.column_names)
    if not parts or not sum(map(len, parts)):
        return pd.DataFrame(columns=columns, dtype=object)
    return pd.concat(parts, ignore_index=True)[columns].sort_values(list(table.order), ignore_index=True)


def strata(frame: pd.DataFrame) -> dict[str, pd.Series]:
    """The classes of each stratification of rows of ``prediction``."""
    spacing = _classes(frame["spacing_m"], SPACINGS, "m")
    closing = _classes(frame["closing_mps"], CLOSINGS, "m/s")
    speed = _classes(frame["speed_mps"], (10.0, 20.0, 30.0), "m/s")
    return {
        "all": pd.Series("all", frame.index),
        "class": "class " + frame["class"],
        "spacing": "spacing " + spacing,
        "closing": "closing " + closing,
        "speed": "speed " + speed,
        "recording": "recording " + frame["recording_id"].map("{:02d}".format),
    }


def _classes(values: pd.Series, bounds: tuple[float, ...], unit: str) -> pd.Series:
    labels = np.array(class_labels(bounds, unit), dtype=object)
    return pd.Series(labels[np.searchsorted(bounds, values, side="right")], values.index)


def prediction_summary(table: pd.DataFrame, default: str, *, confidence: float) -> pd.DataFrame:
    """The table ``prediction_summary`` of HV_1. default: the model that plans."""
    first = table[table["follower"] == 1]
    columns = list(TABLES["prediction_summary"].column_names)
    if first.empty:
        return pd.DataFrame(columns=columns, dtype=object)
    rows = []
    for label in strata(first).values():
        for (stratum, horizon), part in first.groupby([label, "horizon_s"], sort=True):
            rows += list(_summary_rows(str(stratum), float(str(horizon)), part, default, confidence))
    return pd.DataFrame(rows, columns=columns).sort_values(["model", "stratum", "horizon_s"], ignore_index=True)


def _summary_rows(
    stratum: str, horizon: float, part: pd.DataFrame, default: str, confidence: float
) -> Iterator[dict[str, object]]:
    errors = part.pivot_table(index="event_id", columns="model", values="error_speed_mps")
    clusters = part.groupby("event_id")["recording_id"].first().reindex(errors.index).to_numpy()
    absolute = errors.abs()
    mean: dict[Hashable, float] = absolute.mean().to_dict()
    naive = [name for name in names.NAIVE_MODELS if name in mean]
    best = min(naive, key=mean.__getitem__) if naive else ""
    for name, own in part.groupby("model", sort=False):
        error, size = errors[name].to_numpy(), absolute[name].to_numpy()
        usable = ~own["contact"].to_numpy(bool)
        row: dict[str, object] = {"model": name, "stratum": stratum, "horizon_s": horizon, "n_events": len(error)}
        row |= _with_interval("bias", error, clusters, confidence)
        row |= _with_interval("mae", size, clusters, confidence)
        squares = _with_interval("rmse", error**2, clusters, confidence)
        row |= {
            key: float(np.sqrt(max(value, 0.0))) if value == value else np.nan for key, value in squares.items()
        }
        for column, reference in (("skill_constant", names.CONSTANT_SPEED), ("skill_naive", best)):
            row |= _skill(column, size, absolute, reference, clusters, confidence)
        row |= {name_: float(own.loc[usable, name_].mean()) if usable.any() else np.nan for name_ in _MEANS}
        loss_error = (own["loss_simulated"] - own["loss_recorded"]).abs()[usable]
        row |= {
            "best_naive": best,
            "loss_error": float(loss_error.mean()) if usable.any() else np.nan,
            "contacts": int((~usable).sum()),
            "default": name == default,
        }
        yield row


_MEANS = ("peak_decel_simulated", "peak_decel_recorded", "comfort_simulated", "comfort_recorded")


def _with_interval(
    name: str, values: FloatArray, clusters: NDArray[np.int64], confidence: float
) -> dict[str, float]:
    low, high = cluster_interval(values, np.ones(len(values)), clusters, confidence=confidence)
    return {name: float(values.mean()), f"{name}_low": low, f"{name}_high": high}


def _skill(
    column: str, size: FloatArray, absolute: pd.DataFrame, reference: str, clusters: NDArray[np.int64],
    confidence: float,
) -> dict[str, float]:  # fmt: skip
    """1 - mean |error| over that of a reference model; the interval is that of the ratio over recordings."""
    if reference not in absolute or not absolute[reference].sum() > 0.0:
        return dict.fromkeys((column, f"{column}_low", f"{column}_high"), np.nan)
    against = absolute[reference].to_numpy()
    low, high = cluster_interval(size, against, clusters, confidence=confidence)
    return {
        column: 1.0 - float(size.sum() / against.sum()),
        f"{column}_low": 1.0 - high,
        f"{column}_high": 1.0 - low,
    }


def dose_response(table: pd.DataFrame) -> pd.DataFrame:
    """The table ``dose_response``: HV_1's change of speed by spacing and closing speed, recorded and simulated."""
    first = table[(table["follower"] == 1) & table["horizon_s"].isin((3.0, 5.0, 8.0))]
    columns = list(TABLES["dose_response"].column_names)
    if first.empty:
        return pd.DataFrame(columns=columns, dtype=object)
    spacing = _classes(first["spacing_m"], SPACINGS, "m")
    closing = _classes(first["closing_mps"], CLOSINGS, "m/s")
    rows = []
    for key, part in first.groupby([spacing, closing, first["horizon_s"]]):
        one = part.drop_duplicates("event_id")
        recorded = _dose(one["change_recorded_mps"], one["peak_decel_recorded"])
        band = recorded["sd"] / np.sqrt(recorded["n_events"])
        rows.append(
            dict(zip(("spacing", "closing", "horizon_s"), key, strict=True)) | {"model": RECORDED} | recorded
        )
        for name, own in part[~part["contact"].astype(bool)].groupby("model", sort=False):
            found = _dose(own["change_simulated_mps"], own["peak_decel_simulated"])
            within = bool(abs(found["change"] - recorded["change"]) <= band) if band == band else None
            rows.append(
                dict(zip(("spacing", "closing", "horizon_s"), key, strict=True))
                | {"model": name, "within": within}
                | found
            )
    frame = pd.DataFrame(rows, columns=columns)
    return frame.sort_values(["model", "spacing", "closing", "horizon_s"], ignore_index=True)


def _dose(change: pd.Series, peak: pd.Series) -> dict[str, float]:
    return {
        "n_events": len(change),
        "change": float(change.mean()),
        "sd": float(change.std(ddof=1)) if len(change) > 1 else np.nan,
        "peak_decel": float(peak.mean()),
        "peak_decel_95": float(peak.quantile(0.95)),
    }


def externality(judgement: Judgement, scales: Scales, controls: pd.DataFrame) -> pd.DataFrame:
    """The table ``externality``: what lane changes cost HV_1, observed, of matched controls, and simulated.

    controls: rows of ``controls``: event_id, horizon_s, loss_change, n_controls.
    """
    r, rows = judgement.responses, judgement.rows
    matched = controls.set_index(["event_id", "horizon_s"])
    parts = []
    for horizon in EXTERNALITY_HORIZONS:
        keep = np.flatnonzero((r.rank == 1) & in_view(r, horizon))
        last = round(horizon / TIME_STEP) + 1
        about = rows.iloc[keep][["event_id", "recording_id"]].assign(horizon_s=horizon)
        found = matched.reindex(list(zip(about["event_id"], about["horizon_s"], strict=True)))
        about["n_controls"] = found["n_controls"].fillna(0).astype(np.int64).to_numpy()
        parts.append(about.assign(source=OBSERVED, loss_change=loss_change(r.v[:last, keep], scales)))
        parts.append(
            about.assign(source=CONTROL, loss_change=found["loss_change"].to_numpy())[about["n_controls"] > 0]
        )
        for name, simulated in judgement.simulated.items():
            met = judge(simulated, r, horizon, scales).contact[keep]
            change = loss_change(simulated.v[:last, keep], scales)
            parts.append(about.assign(source=name, loss_change=change)[~met])
    return _table("externality", parts)


def externality_balance(controls: pd.DataFrame) -> pd.DataFrame:
    """The table ``externality_balance``: how alike the matched events and their controls are."""
    matched = controls[(controls["n_controls"] > 0) & (controls["horizon_s"] == EXTERNALITY_HORIZONS[0])]
    rows = []
    for name in COVARIATES if len(matched) else ():
        event, control = matched[f"event_{name}"], matched[f"control_{name}"]
        spread = float(event.std(ddof=1)) if len(event) > 1 else np.nan
        difference = (event.mean() - control.mean()) / spread if spread > 0.0 else np.nan
        rows.append((name, len(event), event.mean(), control.mean(), difference))
    columns = list(TABLES["externality_balance"].column_names)
    return pd.DataFrame(rows, columns=columns).sort_values("covariate", ignore_index=True)
