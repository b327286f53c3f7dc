"""What the errors of prediction come to: summary by stratum, dose-response, balance, aims (equations.md 3.13).

A model and the recorded drivers are compared over the same events; who is left out is counted.
"""

from collections.abc import Iterable, Iterator, Mapping
from itertools import product
from operator import itemgetter
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from highd_lc.core.edie import traffic_states
from highd_lc.drivers.prediction import (
    CLOSINGS,
    COVARIATES,
    EXTERNALITY_HORIZONS,
    SPACINGS,
    class_labels,
)
from highd_lc.io import artefacts
from highd_lc.reporting.follower_words import LOSS_COLUMNS, effects_of, followers_say
from highd_lc.scoring.population import LEAST_CLUSTERS, Bootstrap, known_mean, mean_interval_of, ratio_interval
from highd_lc.vocab import names
from highd_lc.vocab.tables import TABLES
from highd_lc.vocab.tables.prediction import (
    AIMS,
    FEW_EVENTS,
    FEW_RECORDINGS,
    JUDGED,
    OBSERVED,
    OVER_EVENTS,
    OVER_RECORDINGS,
    RECORDED,
)

FloatArray = NDArray[np.float64]
Arrays = Mapping[str, NDArray[Any]]
"""Columns of some rows of a table."""
IntArray = NDArray[np.int64]
Row = dict[str, Any]

LEAST_IN_CLASS: Final = LEAST_CLUSTERS
"""Classes of the dose-response with fewer events than this have no band."""


def strata(frame: pd.DataFrame) -> Iterator[tuple[str, pd.Series]]:
    """By stratification the stratum of each row of ``prediction``; null where it is in none."""
    traffic = pd.Series(traffic_states(frame["density_vehpkm"].to_numpy(np.float64)), frame.index)
    kinds = {
        "class": frame["class"],
        "spacing": _classes(frame["spacing_m"], SPACINGS),
        "closing": _classes(frame["closing_mps"], CLOSINGS),
        "traffic": traffic.where(traffic != ""),
        "recording": frame["recording_id"],
    }
    yield "all", pd.Series("all", frame.index, dtype="category")
    yield from ((kind, _named(kind, of)) for kind, of in kinds.items())


def _named(kind: str, values: pd.Series) -> pd.Series:
    """Words of a stratification, each once: a string a row would be the larger part of a large table."""
    pattern = "{}={:02d}" if kind == "recording" else "{}={}"
    return values.map({value: pattern.format(kind, value) for value in values.dropna().unique()}).astype(
        "category"
    )


def _classes(values: pd.Series, bounds: tuple[float, ...]) -> pd.Series:
    labels = np.array(class_labels(bounds), dtype=object)
    return pd.Series(labels[np.searchsorted(bounds, values, side="right")], values.index)


def prediction_summary(table: pd.DataFrame, default: str, *, bootstrap: Bootstrap) -> pd.DataFrame:
    """The table ``prediction_summary`` of HV_1. default: the model that plans."""
    others = table["follower"] != 1
    first = table[~others] if others.any() else table
    columns = list(TABLES["prediction_summary"].column_names)
    if first.empty:
        return pd.DataFrame(columns=columns, dtype=object)
    rows: list[Row] = []
    for kind, label in strata(first):
        # By places: groups of their own are a copy of the table.
        groups: dict[Any, Any] = first.groupby([label, "horizon_s"], observed=True).indices
        for (stratum, horizon), places in sorted(groups.items(), key=itemgetter(0)):
            about = {"stratum": str(stratum), "horizon_s": float(str(horizon))}
            found = _Stratum(first.iloc[places], bootstrap, alone=kind == "recording")
            rows += [about | row | {"default": row["model"] == default} for row in found.rows()]
    return pd.DataFrame(rows, columns=columns).sort_values(["model", "stratum", "horizon_s"], ignore_index=True)


_MEANS = (
    "peak_decel_simulated",
    "peak_decel_recorded",
    "comfort_simulated",
    "comfort_recorded",
    "nrmse_spacing",
    "theil_u",
)
_JUDGED = (*_MEANS, "paper_j", "loss_simulated", "loss_recorded", "contact", "contact_recorded")
_ENDS = ("", "_low", "_high")


class _Stratum:
    """The events of a stratum at a horizon under every model. alone: of one recording, events are the units."""

    def __init__(self, part: pd.DataFrame, bootstrap: Bootstrap, *, alone: bool) -> None:
        self._models, self._bootstrap = dict(_by_model(part, _JUDGED)), bootstrap
        event, events = pd.factorize(part["event_id"], sort=True)
        recordings = np.empty(len(events), np.int64)
        recordings[event] = part["recording_id"]
        self._errors = {name: np.full(len(events), np.nan) for name in self._models}
        for name, of in _by_model(part.assign(_event=event), ("_event", "error_speed_mps")):
            self._errors[name][of["_event"]] = of["error_speed_mps"]
        self._units = np.arange(len(recordings)) if alone else recordings
        known = len(np.unique(self._units)) >= LEAST_CLUSTERS
        self._reason = "" if known else FEW_EVENTS if alone else FEW_RECORDINGS
        self._over = (OVER_EVENTS if alone else OVER_RECORDINGS) if known else ""

    def rows(self) -> Iterator[Row]:
        """A row a model."""
        absolute = {name: np.abs(error) for name, error in self._errors.items()}
        naive = [name for name in names.NAIVE_MODELS if name in absolute]
        best = min(naive, key=lambda name: known_mean(absolute[name])) if naive else ""
        for name, own in self._models.items():
            about = {"model": name, "n_events": len(self._units), "best_naive": best}
            about |= {"interval": self._over, "reason": self._reason}
            yield about | self._errors_of(name, absolute, best) | _motion(own)

    def _errors_of(self, name: str, absolute: Mapping[str, FloatArray], best: str) -> Row:
        error, size = self._errors[name], absolute[name]
        row = self._ratio("bias", error, np.ones(len(error))) | self._ratio("mae", size, np.ones(len(size)))
        squares = self._ratio("rmse", error**2, np.ones(len(error)))
        row |= {key: float(np.sqrt(max(v, 0.0))) if v == v else np.nan for key, v in squares.items()}
        for column, reference in (("skill_constant", names.CONSTANT_SPEED), ("skill_naive", best)):
            against = absolute[reference] if reference in absolute else np.zeros(len(size))
            value, low, high = self._ratio(column, size, against).values()
            row |= dict(zip((column + end for end in _ENDS), (1.0 - value, 1.0 - high, 1.0 - low), strict=True))
        return row

    def _ratio(self, name: str, values: FloatArray, of: FloatArray) -> dict[str, float]:
        """sum(values) / sum(of) with its interval over the units; NaN of nothing."""
        total = float(of.sum())
        if not total > 0.0:
            return dict.fromkeys((name + end for end in _ENDS), np.nan)
        row = {name: float(values.sum()) / total, f"{name}_low": np.nan, f"{name}_high": np.nan}
        if not self._reason:
            found = ratio_interval(self._units, values, of, self._bootstrap)
            least = 0.0 if (values >= 0.0).all() else -np.inf  # so no skill is beyond 1, however wide its interval
            row |= {f"{name}_low": max(found.low, least), f"{name}_high": found.high}
        return row


def _motion(own: Arrays) -> Row:
    """Means of a model's motion over the events without its contacts, and the contacts, also the recorded ones."""
    usable = ~own["contact"].astype(bool)
    row: Row = {name: known_mean(own[name][usable]) for name in _MEANS}
    # A driver that hardly accelerates has a J of any size: the middle one is told.
    row["paper_j"] = _quantile(own["paper_j"][usable], 0.5)
    row["loss_error"] = known_mean(np.abs(own["loss_simulated"] - own["loss_recorded"])[usable])
    row["contacts"] = int((~usable).sum())
    row["contacts_recorded"] = int(own["contact_recorded"].sum())
    return row


def _by_model(part: pd.DataFrame, columns: Iterable[str]) -> Iterator[tuple[str, Arrays]]:
    """Columns of a table's rows of each model, in the order in which the models first stand there."""
    values = {name: part[name].to_numpy() for name in columns}
    code, models = pd.factorize(part["model"])
    for k, model in enumerate(models):
        yield str(model), {name: column[code == k] for name, column in values.items()}


def _quantile(values: FloatArray, share: float) -> float:
    """Quantile of what is known, NaN of nothing."""
    known = values[~np.isnan(values)]
    return float(np.quantile(known, share)) if len(known) else np.nan


_CHANGE_AND_PEAK: Final = (("change", "_mps"), ("peak_decel", ""))


def dose_response(table: pd.DataFrame) -> pd.DataFrame:
    """The table ``dose_response``: HV_1's change of speed by spacing and closing speed, recorded and simulated.

    Beside each model stand the recorded drivers of the same events: those without a contact of the model.
    """
    first = table[(table["follower"] == 1) & table["horizon_s"].isin((3.0, 5.0, 8.0))]
    columns = list(TABLES["dose_response"].column_names)
    if first.empty:
        return pd.DataFrame(columns=columns, dtype=object)
    rows = []
    keys = [_classes(first["spacing_m"], SPACINGS), _classes(first["closing_mps"], CLOSINGS), first["horizon_s"]]
    for key, part in first.groupby(keys):
        about = dict(zip(("spacing", "closing", "horizon_s"), key, strict=True))
        once = {name: part.drop_duplicates("event_id")[name].to_numpy() for name in _DOSES}
        rows.append(about | {"model": RECORDED, "left_out": 0} | _dose(once, RECORDED))
        rows += [about | {"model": name} | _compared(own) for name, own in _by_model(part, (*_DOSES, "contact"))]
    frame = pd.DataFrame(rows, columns=columns)
    return frame.sort_values(["model", "spacing", "closing", "horizon_s"], ignore_index=True)


def _compared(own: Arrays) -> Row:
    """A model's answer beside the recorded one of the same events."""
    usable = {name: values[~own["contact"].astype(bool)] for name, values in own.items()}
    row, recorded = _dose(usable, "simulated"), _dose(usable, RECORDED)
    row |= {f"{name}_recorded": recorded[name] for name in ("change", "sd", "peak_decel")}
    row["left_out"] = int(own["contact"].sum())
    band = recorded["sd"] / np.sqrt(max(row["n_events"], 1))
    known = row["n_events"] >= LEAST_IN_CLASS
    return row | {"within": bool(abs(row["change"] - recorded["change"]) <= band) if known else None}


_DOSES: Final = tuple(f"{name}_{who}{unit}" for who in ("simulated", RECORDED) for name, unit in _CHANGE_AND_PEAK)


def _dose(events: Arrays, who: str) -> dict[str, float]:
    change, peak = (events[f"{name}_{who}{unit}"] for name, unit in _CHANGE_AND_PEAK)
    known = change[~np.isnan(change)]
    return {
        "n_events": len(change),
        "change": known_mean(change),
        "sd": float(known.std(ddof=1)) if len(known) > 1 else np.nan,
        "peak_decel": known_mean(peak),
        "peak_decel_95": _quantile(peak, 0.95),
    }


def externality_balance(controls: pd.DataFrame, charged: pd.DataFrame) -> pd.DataFrame:
    """The table ``externality_balance``: how alike the matched events and their controls are.

    charged: rows of ``externality``: only events that are charged over the horizon count.
    """
    columns = list(TABLES["externality_balance"].column_names)
    seen = charged.loc[charged["source"] == OBSERVED, ["event_id", "horizon_s"]]
    rows = []
    for horizon in EXTERNALITY_HORIZONS:
        events = seen.loc[seen["horizon_s"] == horizon, "event_id"]
        mine = controls[(controls["horizon_s"] == horizon) & controls["event_id"].isin(events)]
        matched = mine[mine["n_controls"] > 0]
        about = {"horizon_s": horizon, "share_matched": len(matched) / len(events) if len(events) else np.nan}
        rows += [about | _balance(name, matched) for name in (COVARIATES if len(matched) else ())]
    frame = pd.DataFrame(rows, columns=columns)
    return frame.sort_values(["covariate", "horizon_s"], ignore_index=True)


def _balance(name: str, matched: pd.DataFrame) -> Row:
    event, control = matched[f"event_{name}"], matched[f"control_{name}"]
    spread = float(event.std(ddof=1)) if len(event) > 1 else np.nan
    difference = (event.mean() - control.mean()) / spread if spread > 0.0 else np.nan
    row = {"covariate": name, "n": len(event), "mean_event": event.mean(), "mean_control": control.mean()}
    return row | {"standardised_difference": difference}


AIMED: Final = (
    "model", "recording_id", "event_id", "follower", "horizon_s", "contact", "contact_recorded",
    "peak_decel_simulated", "peak_decel_recorded", "comfort_simulated", "comfort_recorded",
)  # fmt: skip
"""Columns of ``prediction`` that tell whether the aims are met."""


def prediction_aims(
    summary: pd.DataFrame, doses: pd.DataFrame, table: pd.DataFrame, charged: pd.DataFrame, *, bootstrap: Bootstrap
) -> pd.DataFrame:
    """The table ``prediction_aims``: what each model has to reach, and whether it does.

    summary: ``prediction_summary``; doses: ``dose_response``; table: ``prediction``, its columns
    ``AIMED``; charged: ``externality``.
    """
    columns = list(TABLES["prediction_aims"].column_names)
    rows: list[Row] = []
    for model in summary["model"].unique() if len(summary) else ():
        mine = summary[summary["model"] == model]
        own = table[table["model"] == model]
        found = [*_skill_aims(mine), *_likeness_aims(own, charged, str(model), bootstrap)]
        found += [*_dose_aims(doses[doses["model"] == model]), _contact_aim(own)]
        rows += [{"model": model, "default": bool(mine["default"].iloc[0])} | row for row in found]
    frame = pd.DataFrame(rows, columns=columns)
    order = frame["aim"].map({name: k for k, name in enumerate(AIMS)})
    return frame.assign(_k=order).sort_values(["model", "_k", "horizon_s"], ignore_index=True)[columns]


AIM_HORIZONS: Final = (5.0, 8.0)


def _skill_aims(mine: pd.DataFrame) -> Iterator[Row]:
    """Skills, bias, and recordings below 0. mine: rows of the summary of one model."""
    whole = mine[mine["stratum"] == "all"].set_index("horizon_s")
    for name, horizon in product(("skill_constant", "skill_naive", "bias"), AIM_HORIZONS):
        if horizon in whole.index:
            cell: Any = whole.loc[horizon]
            yield _aim(name, horizon, float(cell[name]), int(cell["n_events"]))
    each = mine[mine["stratum"].str.startswith("recording=")]
    for at, rows in each[each["horizon_s"].isin(AIM_HORIZONS)].groupby("horizon_s"):
        known = rows.dropna(subset="skill_constant_high")
        value = float((known["skill_constant_high"] < 0.0).sum()) if len(known) else np.nan
        yield _aim("recordings_below", float(str(at)), value, len(known), FEW_EVENTS)


def _dose_aims(mine: pd.DataFrame) -> Iterator[Row]:
    """Classes within the band. mine: rows of ``dose_response`` of one model."""
    for horizon, rows in mine[mine["horizon_s"].isin(AIM_HORIZONS)].groupby("horizon_s"):
        within = rows["within"].dropna().astype(bool)
        value = float(within.sum()) if len(within) else np.nan
        least = np.ceil(AIMS["dose_response"][0] * len(within)) if len(within) else np.nan
        yield _aim("dose_response", float(str(horizon)), value, len(within), FEW_EVENTS, low=least)


def _likeness_aims(own: pd.DataFrame, charged: pd.DataFrame, model: str, bootstrap: Bootstrap) -> Iterator[Row]:
    """Peak braking, comfort and externality beside the interval of the observed ones, over the same events."""
    first = own[(own["follower"] == 1) & ~own["contact"].astype(bool)]
    for name, horizon in product(("peak_decel", "comfort"), AIM_HORIZONS):
        rows = first[first["horizon_s"] == horizon].dropna(subset=[f"{name}_simulated", f"{name}_recorded"])
        yield from _inside(name, horizon, rows, (f"{name}_simulated", f"{name}_recorded"), bootstrap)
    for horizon in EXTERNALITY_HORIZONS:
        of = charged[charged["horizon_s"] == horizon].set_index("event_id")
        pair = of.loc[of["source"] == OBSERVED, ["recording_id", "loss_change"]]
        simulated = of.loc[of["source"] == model, "loss_change"].rename("simulated")
        pair = pair.join(simulated, how="inner")
        yield from _inside("externality", horizon, pair, ("simulated", "loss_change"), bootstrap)


def _inside(
    name: str, horizon: float, rows: pd.DataFrame, columns: tuple[str, str], bootstrap: Bootstrap
) -> Iterator[Row]:
    if len(rows):
        simulated, observed = (rows[column].to_numpy(np.float64) for column in columns)
        recordings = rows["recording_id"].to_numpy(np.int64)
        low, high, over = mean_interval_of(observed, recordings, bootstrap)
        row = _aim(name, horizon, float(simulated.mean()), len(rows), FEW_EVENTS, low=low, high=high)
        yield row | {"interval": over, "observed": float(observed.mean())}


def _contact_aim(own: pd.DataFrame) -> Row:
    """Contacts of all followers as long as they are in view, beside the recorded ones."""
    met = own.groupby(["event_id", "follower"])[["contact", "contact_recorded"]].any()
    simulated, recorded = met.sum()
    row = _aim("contacts", float(own["horizon_s"].max()), float(simulated), len(met), high=float(recorded))
    return row | {"observed": float(recorded)}


def _aim(
    name: str, horizon: float, value: float, n: int, reason: str = "", *, low: float | None = None,
    high: float | None = None,
) -> Row:  # fmt: skip
    """A row: met where the value lies between low and high, those of the aim unless given; NaN does not bound."""
    lowest, highest = AIMS[name]
    low, high = lowest if low is None else low, highest if high is None else high
    known = value == value and (low == low or high == high)
    met = not (value < low or value > high) if known else None
    row: Row = {"aim": name, "horizon_s": horizon, "value": value, "low": low, "high": high, "n": n}
    return row | {"met": met, "reason": "" if known else reason, "interval": "", "observed": np.nan}


def is_judged(work: Path) -> bool:
    """Whether a work folder holds the tables that say how well its followers are predicted."""
    return all(artefacts.path_of(work, name).is_file() for name in JUDGED)


def followers_believed(work: Path, model: str) -> tuple[str, ...]:
    """How far the simulated followers of a run can be believed, in words (see ``reporting.follower_words``).

    model: the default follower model.
    """
    columns = ["event_id", "policy", "accounting", "followers", *LOSS_COLUMNS]
    losses = artefacts.read(work, "losses", columns=columns)
    losses, known = losses[losses["followers"] == model], is_judged(work)
    summary, aims = (
        artefacts.read(work, name) if known else None for name in ("prediction_summary", "prediction_aims")
    )
    return followers_say(summary, effects_of(losses), aims)
