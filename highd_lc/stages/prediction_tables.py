"""What the errors of prediction come to: summary by stratum, dose-response, balance, aims (equations.md 3.13).

A model and the recorded drivers are compared over the same events; who is left out is counted.
"""

from collections.abc import Hashable, Iterator
from itertools import product
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
from highd_lc.scoring.population import LEAST_CLUSTERS, Bootstrap, mean_interval_of, ratio_interval
from highd_lc.vocab import names
from highd_lc.vocab.tables import TABLES
from highd_lc.vocab.tables.prediction import (
    AIMS,
    FEW_EVENTS,
    FEW_RECORDINGS,
    OBSERVED,
    OVER_EVENTS,
    OVER_RECORDINGS,
    RECORDED,
)

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Row = dict[str, Any]

LEAST_IN_CLASS: Final = LEAST_CLUSTERS
"""Classes of the dose-response with fewer events than this have no band."""


def strata(frame: pd.DataFrame) -> dict[str, pd.Series]:
    """The stratum of each row of ``prediction`` in each stratification; null where it is in none."""
    traffic = pd.Series(traffic_states(frame["density_vehpkm"].to_numpy(np.float64)), frame.index)
    return {
        "all": pd.Series("all", frame.index),
        "class": "class=" + frame["class"],
        "spacing": "spacing=" + _classes(frame["spacing_m"], SPACINGS),
        "closing": "closing=" + _classes(frame["closing_mps"], CLOSINGS),
        "traffic": ("traffic=" + traffic).where(traffic != ""),
        "recording": "recording=" + frame["recording_id"].map("{:02d}".format),
    }


def _classes(values: pd.Series, bounds: tuple[float, ...]) -> pd.Series:
    labels = np.array(class_labels(bounds), dtype=object)
    return pd.Series(labels[np.searchsorted(bounds, values, side="right")], values.index)


def prediction_summary(table: pd.DataFrame, default: str, *, bootstrap: Bootstrap) -> pd.DataFrame:
    """The table ``prediction_summary`` of HV_1. default: the model that plans."""
    first = table[table["follower"] == 1]
    columns = list(TABLES["prediction_summary"].column_names)
    if first.empty:
        return pd.DataFrame(columns=columns, dtype=object)
    rows: list[Row] = []
    for kind, label in strata(first).items():
        for (stratum, horizon), part in first.groupby([label, "horizon_s"], sort=True):
            about = {"stratum": str(stratum), "horizon_s": float(str(horizon))}
            found = _Stratum(part, bootstrap, alone=kind == "recording")
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
_ENDS = ("", "_low", "_high")


class _Stratum:
    """The events of a stratum at a horizon under every model. alone: of one recording, events are the units."""

    def __init__(self, part: pd.DataFrame, bootstrap: Bootstrap, *, alone: bool) -> None:
        self._part, self._bootstrap = part, bootstrap
        self._errors = part.pivot_table(index="event_id", columns="model", values="error_speed_mps")
        recordings = part.groupby("event_id")["recording_id"].first().reindex(self._errors.index).to_numpy()
        self._units = np.arange(len(recordings)) if alone else recordings
        known = len(np.unique(self._units)) >= LEAST_CLUSTERS
        self._reason = "" if known else FEW_EVENTS if alone else FEW_RECORDINGS
        self._over = (OVER_EVENTS if alone else OVER_RECORDINGS) if known else ""

    def rows(self) -> Iterator[Row]:
        """A row a model."""
        absolute = self._errors.abs()
        mean: dict[Hashable, float] = absolute.mean().to_dict()
        naive = [name for name in names.NAIVE_MODELS if name in mean]
        best = min(naive, key=mean.__getitem__) if naive else ""
        for name, own in self._part.groupby("model", sort=False):
            about = {"model": name, "n_events": len(absolute), "best_naive": best}
            about |= {"interval": self._over, "reason": self._reason}
            yield about | self._errors_of(name, absolute, best) | _motion(own)

    def _errors_of(self, name: Hashable, absolute: pd.DataFrame, best: str) -> Row:
        error, size = self._errors[name].to_numpy(), absolute[name].to_numpy()
        row = self._ratio("bias", error, np.ones(len(error))) | self._ratio("mae", size, np.ones(len(size)))
        squares = self._ratio("rmse", error**2, np.ones(len(error)))
        row |= {key: float(np.sqrt(max(v, 0.0))) if v == v else np.nan for key, v in squares.items()}
        for column, reference in (("skill_constant", names.CONSTANT_SPEED), ("skill_naive", best)):
            against = absolute[reference].to_numpy() if reference in absolute else np.zeros(len(size))
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
            row |= {f"{name}_low": found.low, f"{name}_high": found.high}
        return row


def _motion(own: pd.DataFrame) -> Row:
    """Means of a model's motion over the events without its contacts, and the contacts, also the recorded ones."""
    usable = own[~own["contact"].to_numpy(bool)]
    row: Row = {name: float(usable[name].mean()) for name in _MEANS}
    # A driver that hardly accelerates has a J of any size: the middle one is told.
    row["paper_j"] = float(usable["paper_j"].median())
    row["loss_error"] = float((usable["loss_simulated"] - usable["loss_recorded"]).abs().mean())
    row["contacts"] = len(own) - len(usable)
    row["contacts_recorded"] = int(own["contact_recorded"].sum())
    return row


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
        rows.append(about | {"model": RECORDED, "left_out": 0} | _dose(part.drop_duplicates("event_id"), RECORDED))
        rows += [about | {"model": name} | _compared(own) for name, own in part.groupby("model", sort=False)]
    frame = pd.DataFrame(rows, columns=columns)
    return frame.sort_values(["model", "spacing", "closing", "horizon_s"], ignore_index=True)


def _compared(own: pd.DataFrame) -> Row:
    """A model's answer beside the recorded one of the same events."""
    usable = own[~own["contact"].to_numpy(bool)]
    row, recorded = _dose(usable, "simulated"), _dose(usable, RECORDED)
    row |= {f"{name}_recorded": recorded[name] for name in ("change", "sd", "peak_decel")}
    row["left_out"] = len(own) - len(usable)
    band = recorded["sd"] / np.sqrt(max(len(usable), 1))
    known = len(usable) >= LEAST_IN_CLASS
    return row | {"within": bool(abs(row["change"] - recorded["change"]) <= band) if known else None}


def _dose(events: pd.DataFrame, who: str) -> dict[str, float]:
    change, peak = events[f"change_{who}_mps"], events[f"peak_decel_{who}"]
    return {
        "n_events": len(events),
        "change": float(change.mean()),
        "sd": float(change.std(ddof=1)) if len(change) > 1 else np.nan,
        "peak_decel": float(peak.mean()),
        "peak_decel_95": float(peak.quantile(0.95)),
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


def prediction_aims(
    summary: pd.DataFrame, doses: pd.DataFrame, table: pd.DataFrame, charged: pd.DataFrame, *, bootstrap: Bootstrap
) -> pd.DataFrame:
    """The table ``prediction_aims``: what each model has to reach, and whether it does.

    summary: ``prediction_summary``; doses: ``dose_response``; table: ``prediction``; charged: ``externality``.
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
