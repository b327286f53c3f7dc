"""Made-up tables of predicted followers: three naive models, five others. Made once, not to be changed."""

from dataclasses import replace
from functools import cache
from itertools import product

import numpy as np
import pandas as pd

from highd_lc.reporting.event import PredictionTrace
from highd_lc.reporting.pages_prediction import PredictionTables
from highd_lc.vocab import names
from highd_lc.vocab.tables import TABLES

HORIZONS = (1.0, 2.0, 3.0, 5.0, 8.0)
DEFAULT = "population"
MODELS = {
    names.CONSTANT_SPEED: 1.0, names.DECAYING_ACCELERATION: 0.7, names.DRIFT: 0.65, names.OWN_FIT: 1.6,
    "own_fit+relaxation": 0.9, names.TABLE3: 2.4, DEFAULT: 0.5, "population-memory": 0.8,
}  # fmt: skip
"""Scale of each model's error."""
SPACINGS, CLOSINGS = ("20 .. 35", "35 .. 60", "< 20", "> 60"), ("-2 .. 0", "0 .. 2", "2 .. 5", "< -2", "> 5")


@cache
def prediction(n: int = 40, recordings: int = 6, *, seed: int = 3) -> pd.DataFrame:
    """n events; every fifth is in view for 5 s only. The k-th event's errors grow with k."""
    rng = np.random.default_rng(seed)
    rows = []
    for k in range(n):
        event = f"{1 + k % recordings:02d}-{k:04d}-{100 + 7 * k:05d}"
        closing, sign = rng.normal(1, 3), rng.choice([-1, 1])
        for (model, scale), h in product(MODELS.items(), HORIZONS):
            if h > 5.0 and k % 5 == 0:
                continue
            error = sign * scale * h * (k + 1) / n / 4
            rows.append({
                "event_id": event, "recording_id": 1 + k % recordings, "follower": 1, "model": model,
                "horizon_s": h, "class": names.TRUCK if k % 4 == 0 else names.CAR, "spacing_m": 10.0 + 2 * k,
                "density_vehpkm": 9.0 + k,
                "closing_mps": closing, "speed_mps": 28.0, "error_speed_mps": error,
                "error_position_m": error * h / 2, "rmse_speed_mps": abs(error) / 2,
                "change_simulated_mps": -1.0 + error, "change_recorded_mps": -1.0,
                "peak_decel_simulated": 0.3 + scale / 2, "peak_decel_recorded": 0.3,
                "comfort_simulated": 2 + scale, "comfort_recorded": 2.0,
                "loss_simulated": 9.0 + scale * (k + 1) / n * h, "loss_recorded": 9.0, "contact": False,
                "contact_recorded": False,
                "nrmse_spacing": 0.02 + abs(error) / 100, "theil_u": 0.01 + abs(error) / 200,
                "paper_j": 0.5 + scale,
            })  # fmt: skip
    return pd.DataFrame(rows, columns=list(TABLES["prediction"].column_names))


def prediction_summary(table: pd.DataFrame, *, intervals: bool = True) -> pd.DataFrame:
    """The summary of ``prediction`` over all events, by class and by recording; intervals of +- 0.1."""
    strata = [("all", table)]
    strata += [(f"class={c}", rows) for c, rows in table.groupby("class")]
    strata += [(f"recording={r:02d}", rows) for r, rows in table.groupby("recording_id")]
    rows = [_row(stratum, cell, intervals=intervals) for stratum, part in strata for cell in _cells(part)]
    return pd.DataFrame(rows, columns=list(TABLES["prediction_summary"].column_names))


def _cells(table: pd.DataFrame) -> list[tuple[str, float, pd.DataFrame, pd.DataFrame]]:
    return [
        (model, h, table[(table["model"] == model) & (table["horizon_s"] == h)], table[table["horizon_s"] == h])
        for model, h in product(MODELS, sorted(table["horizon_s"].unique()))
    ]


def _row(stratum, cell, *, intervals):
    model, h, mine, every = cell
    mae = every.groupby("model")["error_speed_mps"].apply(lambda e: e.abs().mean())
    best = mae[list(names.NAIVE_MODELS)].idxmin()
    values = {
        "bias": mine["error_speed_mps"].mean(), "mae": mae[model], "rmse": 1.2 * mae[model],
        "skill_constant": 1 - mae[model] / mae[names.CONSTANT_SPEED], "skill_naive": 1 - mae[model] / mae[best],
    }  # fmt: skip
    half = 0.1 if intervals else np.nan
    ends = {f"{name}{end}": v + s * half for name, v in values.items() for end, s in (("_low", -1), ("_high", 1))}
    means = {
        name: mine[name].mean()
        for name in ("peak_decel_simulated", "peak_decel_recorded", "comfort_simulated", "comfort_recorded",
                     "nrmse_spacing", "theil_u", "paper_j")
    }  # fmt: skip
    return {
        "model": model, "stratum": stratum, "horizon_s": h, "n_events": len(mine), **values, **ends, **means,
        "best_naive": best, "loss_error": (mine["loss_simulated"] - mine["loss_recorded"]).abs().mean(),
        "contacts": 2 if model == names.TABLE3 else 0, "contacts_recorded": 1, "default": model == DEFAULT,
        "interval": "recordings" if intervals else "", "reason": "" if intervals else "fewer than five recordings",
    }  # fmt: skip


def dose_response() -> pd.DataFrame:
    """Recorded and every model; classes in the order of their letters, as a table holds them; one is missing."""
    rows = []
    for model, (i, s), (j, c), h in product(
        ("recorded", *MODELS), enumerate(SPACINGS), enumerate(CLOSINGS), (3.0, 5.0, 8.0)
    ):
        if (s, c) == ("> 60", "-2 .. 0"):
            continue
        off = 0.0 if model == "recorded" else MODELS[model] / 10
        rows.append({
            "model": model, "spacing": s, "closing": c, "horizon_s": h, "n_events": 9 + i + j,
            "change": -0.2 * j - off, "sd": 0.9, "peak_decel": 0.3 + off, "peak_decel_95": 0.9,
            "within": None if model == "recorded" else off < 0.1, "change_recorded": -0.2 * j, "sd_recorded": 0.9,
            "peak_decel_recorded": 0.3, "left_out": 3 if model == names.TABLE3 else 0,
        })  # fmt: skip
    return pd.DataFrame(rows, columns=list(TABLES["dose_response"].column_names))


def externality(table: pd.DataFrame) -> pd.DataFrame:
    """Observed, controls and each model at 5 and 8 s; no controls in every third event."""
    rows = []
    for k, event in enumerate(table["event_id"].unique()):
        sources = {"observed": 0.3, "control": 0.1, **{model: 0.3 * scale for model, scale in MODELS.items()}}
        for (source, level), h in product(sources.items(), (5.0, 8.0)):
            controls = 0 if k % 3 == 0 else 4
            if source == "control" and not controls:
                continue
            rows.append({
                "event_id": event, "recording_id": int(event[:2]), "horizon_s": h, "source": source,
                "loss_change": level + 0.01 * (k % 5), "n_controls": controls,
            })  # fmt: skip
    return pd.DataFrame(rows, columns=list(TABLES["externality"].column_names))


def balance() -> pd.DataFrame:
    """One covariate is out of balance."""
    return pd.DataFrame({
        "covariate": ["speed_mps", "spacing_m"], "horizon_s": 5.0, "n": 26, "share_matched": 0.65,
        "mean_event": [28.0, 31.0],
        "mean_control": [28.1, 36.0], "standardised_difference": [0.03, 0.4],
    })  # fmt: skip


def losses(table: pd.DataFrame, change: float = -0.25, error: float = 0.5) -> pd.DataFrame:
    """The local optimum changes the followers' loss by ``change``, with a free end speed by four times that.

    The errors of the model grow from event to event; their mean size is ``error``.
    """
    factor = {names.BENCHMARK: 0, names.LOCAL_OPTIMUM: 1, names.BENCHMARK_FREE: 0, names.LOCAL_OPTIMUM_FREE: 4}
    events = table["event_id"].unique()
    rows = []
    for (k, e), (q, f), a in product(enumerate(events), (*factor.items(), (names.HUMAN, 0)), names.ACCOUNTINGS):
        missed = error * 2 * (k + 1) / (len(events) + 1) * (-1) ** k if q == names.HUMAN else 0.0
        rows.append({
            "event_id": e, "policy": q, "accounting": a, "loss_av": 9.0, "loss_hv": 8.0, "loss_total": 17.0,
            "loss_hv_in_view": 8.0 + f * change + missed,
            "loss_hv_in_view_recorded": 8.0 if q == names.HUMAN else np.nan,
        })  # fmt: skip
    columns = ["event_id", "policy", "accounting", "loss_av", "loss_hv", "loss_total"]
    return pd.DataFrame(rows, columns=[*columns, "loss_hv_in_view", "loss_hv_in_view_recorded"])


def aims() -> pd.DataFrame:
    """Of the model that plans a few aims: met, not met, not known; of another one alone."""
    about = {"observed": np.nan, "low": np.nan, "high": np.nan, "interval": "", "reason": ""}
    rows = [
        {"aim": "skill_constant", "horizon_s": 5.0, "value": 0.55, "low": 0.5, "n": 40, "met": True},
        {"aim": "bias", "horizon_s": 5.0, "value": -0.3, "low": -0.1, "high": 0.1, "n": 40, "met": False},
        {"aim": "dose_response", "horizon_s": 5.0, "value": 12.0, "low": 12.0, "n": 16, "met": True},
        {"aim": "dose_response", "horizon_s": 8.0, "value": np.nan, "n": 0, "met": None,
         "reason": "fewer than five events"},
        {"aim": "peak_decel", "horizon_s": 5.0, "value": 0.5, "observed": 0.3, "low": 0.2, "high": 0.4, "n": 40,
         "interval": "recordings", "met": False},
        {"aim": "contacts", "horizon_s": 8.0, "value": 1.0, "observed": 2.0, "high": 2.0, "n": 55, "met": True},
    ]  # fmt: skip
    mine = [about | row | {"model": DEFAULT, "default": True} for row in rows]
    other = about | rows[0] | {"model": names.TABLE3, "default": False, "value": -1.4, "met": False}
    return pd.DataFrame([*mine, other], columns=list(TABLES["prediction_aims"].column_names))


def waves(*, intervals: bool = True) -> pd.DataFrame:
    """Observed, unrelated and the model that plans, which passes waves on half a second later."""
    half = 0.5 if intervals else np.nan
    reason = "" if intervals else "fewer than five recordings"
    rows = []
    for source, share, lag in (("observed", 0.6, 1.5), ("unrelated", 0.2, 2.0), (DEFAULT, 0.5, 2.0)):
        speed, later = -6.0 / lag, lag - 1.5
        rows.append({
            "source": source, "stratum": "all", "n_pairs": 40, "n_recordings": 6, "contacts": 0,
            "passed": round(40 * share), "share_passed": share, "lag_s": lag, "displacement_m": -6.0,
            "speed_mps": speed, "speed_low": speed - half, "speed_high": speed + half, "correlation": 0.8,
            "n_both": 12, "lag_difference_s": later, "lag_difference_low": later - 0.4 * half,
            "lag_difference_high": later + 0.4 * half, "reason": reason,
        })  # fmt: skip
    return pd.DataFrame(rows, columns=list(TABLES["shock_waves"].column_names))


def field() -> pd.DataFrame:
    """Two cells of each source; the model that plans is 1 m/s slower in the later one."""
    rows = [
        {"source": source, "x_from_m": -20.0, "x_to_m": -10.0, "t_from_s": t, "t_to_s": t + 0.5, "time_s": 5.0,
         "speed_mps": 2.0 - (t > 0.0 and source == DEFAULT)}
        for source in ("observed", DEFAULT) for t in (0.0, 0.5)
    ]  # fmt: skip
    return pd.DataFrame(rows, columns=list(TABLES["wave_field"].column_names))


@cache
def sample_prediction(n: int = 40, recordings: int = 6, *, intervals: bool = True) -> PredictionTables:
    """What the page on followers shows."""
    table = prediction(n, recordings)
    return PredictionTables(
        prediction=table, prediction_summary=prediction_summary(table, intervals=intervals),
        prediction_aims=aims(),
        dose_response=dose_response(), externality=externality(table), externality_balance=balance(),
        losses=losses(table), shock_waves=waves(intervals=intervals), wave_field=field(),
    )  # fmt: skip


@cache
def nobody() -> PredictionTables:
    """The same without a row."""
    full = sample_prediction(4)
    return replace(full, **{name: getattr(full, name).iloc[:0] for name in PredictionTables.__dataclass_fields__})


def trace() -> PredictionTrace:
    """What an event's page draws of a predicted follower."""
    t = np.arange(0, 8.05, 0.1)
    recorded = 28.0 - 0.1 * t
    gone = np.where(t > 6.0, np.nan, recorded + 0.5)
    return PredictionTrace(t, recorded, {names.CONSTANT_SPEED: np.full(t.size, 28.0), DEFAULT: gone}, DEFAULT)


def many_models() -> PredictionTrace:
    """The same by more models than lines of a chart can be told apart."""
    few = trace()
    others = (*names.NAIVE_MODELS[1:], names.OWN_FIT, names.IDM, names.MEAN, names.TABLE3)
    models = {model: few.recorded + 0.1 * k for k, model in enumerate(others)}
    own = {names.CONSTANT_SPEED: few.models[names.CONSTANT_SPEED], **models, DEFAULT: few.models[DEFAULT]}
    return PredictionTrace(few.t, few.recorded, own, DEFAULT)
