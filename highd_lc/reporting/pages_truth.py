"""The page of the fitted drivers beside the true ones: constants, response curves, prediction."""

from collections.abc import Iterator
from typing import Final

import numpy as np
import pandas as pd

from highd_lc.reporting import figures_prediction as figures
from highd_lc.reporting import html, labels
from highd_lc.reporting.pages_data import Column, Section, overview_page, percentage, table_view
from highd_lc.vocab.driver import PARAMETERS, UNITS
from highd_lc.vocab.tables.fits import TRUE, TRUTH_HORIZONS
from highd_lc.vocab.tables.prediction import RECORDED

PAGE: Final = "truth.html"
_TRUTH: Final = "truth"
_AT: Final = 5.0
_CLASS: Final = ["spacing", "closing"]
_CONSTANTS: Final = {
    **labels.PARAMETERS,
    "memory_s": "memory",
    "relaxation_s": "relaxation",
    "moment": "moment, share of the way",
}
_OTHER_UNITS: Final = {"memory_s": "s", "relaxation_s": "s"}
_LEAST: Final = 3
"""Fewer followers than this are no class of a response."""


def truth_page(table: pd.DataFrame) -> str:
    """Constants, response curves and prediction of the fitted drivers beside the true ones. table: ``truth``."""
    lead = (
        "These recordings were made, so the drivers are known. Both the fitted and the true driver are simulated "
        "behind the recorded lane changer from the follower's recorded state at the start; what is compared is "
        "whom the fits take the drivers for, not noise.",
    )
    return overview_page(PAGE, "Truth beside fit", _sections(table), lead)


def _sections(table: pd.DataFrame) -> Iterator[Section]:
    if table.empty:
        yield Section(text=("No follower of a usable lane change has a known driver.",))
        return
    yield _recovery_section(table)
    yield _response_section(table)
    yield _constants_section(table)


def recovery(table: pd.DataFrame) -> pd.DataFrame:
    """By model and horizon how far the response curves of the first followers are from the truth.

    off: root mean square, over followers, of the difference between the class means of fitted and true change of
    speed, over that of the true ones. Classes of fewer than three followers count nowhere. mae, mae_true: mean
    absolute error of speed of fitted and true drivers [m/s]; noise and unrest are in both.
    """
    rows = []
    first = table[table["follower"] == 1]
    for model, own in first.groupby("model", sort=False):
        for horizon in TRUTH_HORIZONS:
            curve = response(own, horizon)
            weights, true = curve["n"].to_numpy(float), curve[_TRUTH].to_numpy(float)
            size = float(np.sqrt((weights * true**2).sum()))
            off = float(np.sqrt((weights * (curve["fitted"] - true) ** 2).sum()))
            at = f"_{horizon:g}s"
            rows.append(
                {
                    "model": model,
                    "horizon_s": horizon,
                    "n": int(weights.sum()),
                    "classes": len(curve),
                    "off": off / size if size > 0.0 else np.nan,
                    "mae": own[f"error{at}"].abs().mean(),
                    "mae_true": own[f"error{TRUE}{at}"].abs().mean(),
                }
            )
    return pd.DataFrame(rows)


def response(own: pd.DataFrame, horizon: float) -> pd.DataFrame:
    """Mean change of speed by class of spacing and closing speed: fitted, true, recorded. own: of one model."""
    at = f"_{horizon:g}s"
    seen = own.dropna(subset=[f"change{at}", f"change{TRUE}{at}"])
    groups = seen.groupby(_CLASS)
    curve = pd.DataFrame(
        {
            "n": groups.size(),
            "fitted": groups[f"change{at}"].mean(),
            _TRUTH: groups[f"change{TRUE}{at}"].mean(),
            RECORDED: groups[f"change_recorded{at}"].mean(),
            "sd": groups[f"change_recorded{at}"].std(ddof=0),
        }
    )
    return curve[curve["n"] >= _LEAST].reset_index()


def _recovery_section(table: pd.DataFrame) -> Section:
    columns = (
        Column("label", "Fitted driver"),
        Column("horizon_s", "After", "s", 0),
        Column("n", "First followers", digits=0),
        Column("classes", "Classes", digits=0),
        percentage("off", "Response off by", 1),
        Column("mae", "Error of speed", "m/s", 2),
        Column("mae_true", "of the true drivers", "m/s", 2),
    )
    rows = recovery(table).assign(label=lambda t: t["model"].map(labels.follower_model))
    text = (
        "Response off by: root mean square difference between the class means of the fitted and the true drivers' "
        "change of speed, over that of the true ones. The true drivers' error of speed is what noise, unrest and "
        "the parts that are not compared (who makes room, drift by place) leave.",
    )
    return Section("How near the fits come", text, tables=(table_view(rows, columns),), anchor="recovery")


def _response_section(table: pd.DataFrame) -> Section:
    first = table[table["follower"] == 1]
    models = list(dict.fromkeys(first["model"]))
    rows, curves = [], {model: response(first[first["model"] == model], _AT) for model in models}
    for model, curve in curves.items():
        rows.append(curve.assign(model=model, change=curve["fitted"]))
    one = next(iter(curves.values()))
    rows += [one.assign(model=name, change=one[name]) for name in (_TRUTH, RECORDED)]
    drawn = pd.concat(rows, ignore_index=True).rename(columns={"n": "n_events"})
    title = f"Change of HV 1's speed within {_AT:g} s by spacing and closing speed"
    figure = html.inline_svg(
        figures.dose_figure(drawn, [_TRUTH, *models], _TRUTH), f"{title}; numbers in the table."
    )
    wide = one.assign(**{model: curve["fitted"] for model, curve in curves.items()})
    wide = wide.sort_values(_CLASS, key=lambda classes: classes.map(figures.class_order))
    wide[_CLASS] = wide[_CLASS].map(figures.class_label)
    columns = [
        Column("spacing", "Spacing", "m"),
        Column("closing", "Closing speed", "m/s"),
        Column("n", "Followers", digits=0),
        Column(_TRUTH, "True drivers", "m/s", 2),
        *(Column(model, labels.follower_model(model), "m/s", 2) for model in models),
        Column(RECORDED, "Recorded", "m/s", 2),
    ]
    view = table_view(wide, columns)
    return Section("Response curves", figure=figure, caption=f"{title}.", tables=(view,), anchor="response")


def _constants_section(table: pd.DataFrame) -> Section:
    rows = []
    for model, own in table.groupby("model", sort=False):
        same = own[own["same_family"]]
        for name in (*PARAMETERS, "memory_s", "relaxation_s", "moment"):
            pair = same[[name, f"{name}{TRUE}"]].dropna()
            difference = pair[name] - pair[f"{name}{TRUE}"]
            rows.append(
                {
                    "label": labels.follower_model(str(model)),
                    "constant": _CONSTANTS.get(name, name),
                    "unit": UNITS.get(name, _OTHER_UNITS.get(name, "")),
                    "n": len(pair),
                    "fitted": pair[name].median(),
                    "true": pair[f"{name}{TRUE}"].median(),
                    "bias": difference.median(),
                    "error": difference.abs().median(),
                }
            )
    other = table[~table["same_family"]].drop_duplicates(["event_id", "follower"])
    why = f"{len(other)} followers have a true driver of another family, and no constants to compare." * bool(
        len(other)
    )
    columns = (
        Column("label", "Fitted driver"),
        Column("constant", "Constant"),
        Column("unit", "Unit"),
        Column("n", "Followers", digits=0),
        Column("fitted", "Median, fitted", digits=2),
        Column("true", "true", digits=2),
        Column("bias", "Median difference", digits=2),
        Column("error", "Median absolute difference", digits=2),
    )
    text = (
        "Only where the fitted driver and the true one are of one family. The true A holds the strength with "
        "which a driver reacts." + f" {why}" * bool(why),
    )
    view = table_view(pd.DataFrame(rows), columns)
    return Section("Constants", text, tables=(view,), anchor="constants")
