"""Sections on what a lane change costs the follower, and on the model's error beside the policies' effect."""

from collections.abc import Iterator
from typing import Any, Final

import numpy as np
import pandas as pd

from highd_lc.reporting import figures_prediction as figures
from highd_lc.reporting import follower_words as words
from highd_lc.reporting import html, labels
from highd_lc.reporting.event import PAIRS
from highd_lc.reporting.figures_prediction import source_label
from highd_lc.reporting.pages_data import Column, Section, percentage, table_view
from highd_lc.vocab.tables.prediction import CONTROL, OBSERVED

_UNBALANCED: Final = 0.1


def externality_sections(externality: pd.DataFrame, balance: pd.DataFrame, default: str) -> Iterator[Section]:
    """What a lane change costs HV 1, and how alike the controls are. default: the model that plans."""
    if externality.empty:
        yield Section(
            "What a lane change costs HV 1",
            ("No lane change is in view for long enough to be charged.",),
            anchor="cost",
        )
        return
    rows = _costs(externality)
    order = {s: k for k, s in enumerate(dict.fromkeys((OBSERVED, CONTROL, *labels.in_order(rows["source"]))))}
    rows = rows.assign(label=rows["source"].map(source_label), _place=rows["source"].map(order))
    rows = rows.sort_values(["_place", "horizon_s"], kind="stable")
    yield Section(
        "What a lane change costs HV 1",
        (
            "Change of HV 1's loss beyond that of keeping its speed: as recorded, of matched followers who are "
            "not cut in on, and as each model has it. A model that charges a multiple of what drivers pay is "
            "refuted, whatever its error of speed.",
        ),
        html.inline_svg(
            figures.externality_figure(rows, default), "Mean change of loss; the table holds the numbers."
        ),
        "Dots: means over the events; lines: two standard errors over events.",
        (table_view(rows, _COST_COLUMNS),),
        anchor="cost",
    )
    yield from _balance_sections(balance)


_COST_COLUMNS: Final = (
    Column("label", "Source"),
    Column("horizon_s", "After", "s", 0),
    Column("n", "Events", digits=0),
    Column("mean", "Mean change of loss", digits=3),
    Column("error", "standard error", digits=3),
    Column("n_paired", "Events with controls", digits=0),
    Column("beyond", "Beyond the controls", digits=3),
    Column("beyond_error", "standard error", digits=3),
)


def _costs(externality: pd.DataFrame) -> pd.DataFrame:
    """Mean change of loss by source and horizon, by itself and beyond that of the controls of the same events."""
    wide = externality.pivot_table(index=["event_id", "horizon_s"], columns="source", values="loss_change")
    controls = wide[CONTROL] if CONTROL in wide else pd.Series(np.nan, index=wide.index)
    parts = [_cost(source, wide[source], wide[source] - controls) for source in wide.columns]
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=["source", "horizon_s"])


def _cost(source: str, own: pd.Series, beyond: pd.Series) -> pd.DataFrame:
    one, other = (values.groupby("horizon_s").agg(["mean", "sem", "count"]) for values in (own, beyond))
    found = one.rename(columns={"sem": "error", "count": "n"})
    found[["beyond", "beyond_error", "n_paired"]] = other
    if source == CONTROL:
        found[["beyond", "beyond_error"]] = np.nan
    return found.reset_index().assign(source=source)


def _balance_sections(balance: pd.DataFrame) -> Iterator[Section]:
    if balance.empty:
        return
    apart = balance["standardised_difference"].abs() > _UNBALANCED
    listed = ", ".join(balance.loc[apart, "covariate"]).replace("_", " ")
    found = f"Apart by more: {listed}." if listed else "None is apart by more."
    columns = (
        Column("label", "Matched on"),
        Column("n", "Events", digits=0),
        Column("mean_event", "Mean of the followers", digits=3),
        Column("mean_control", "Mean of their controls", digits=3),
        Column("standardised_difference", "Standardised difference", digits=3),
    )
    rows = balance.assign(label=[name.replace("_", " ") for name in balance["covariate"]])
    text = f"Controls are alike up to {_UNBALANCED:g} standard deviations of the followers. {found}"
    yield Section("How alike the controls are", (text,), tables=(table_view(rows, columns),), anchor="balance")


def error_sections(prediction: pd.DataFrame, losses: pd.DataFrame, told: Any) -> Iterator[Section]:
    """The model's error in HV 1's loss beside the policies' effect, event by event and together.

    told: the row of ``prediction_summary`` whose error is told in words, None if there is none.
    """
    effects = {form: words.effect_by_event(losses, form) for form in PAIRS}
    effects = {form: values for form, values in effects.items() if len(values)}
    if told is None or not effects:
        return
    errors = _loss_errors(prediction, told.model, told.horizon_s)
    rows = [_beside(form, errors, values) for form, values in effects.items()]
    figure = figures.error_figure(errors.to_numpy(float), {f: v.to_numpy(float) for f, v in effects.items()})
    yield Section(
        "Error over effect",
        (
            f"Error: HV 1's loss, simulated minus recorded, over {told.horizon_s:g} s in view. Effect: the "
            "followers' loss under the local optimum minus that under the benchmark, over the whole accounted "
            "time (accounting “equal”), which lets the effect appear larger beside the error than it is.",
        ),
        html.inline_svg(
            figure, "Shares of events by absolute error and by absolute effect; numbers in the table."
        ),
        tables=(table_view(pd.DataFrame(rows), _BESIDE_COLUMNS),),
        anchor="error",
    )


_BESIDE_COLUMNS: Final = (
    Column("form", "Form"),
    Column("n_error", "Events with an error", digits=0),
    Column("error", "Mean absolute error", digits=3),
    Column("error_median", "median", digits=3),
    Column("n_effect", "Events with an effect", digits=0),
    Column("effect", "Mean absolute effect", digits=3),
    Column("effect_median", "median", digits=4),
    Column("net", "Mean effect with its sign", digits=3),
    Column("ratio", "Error over effect", digits=2),
    percentage("share", "Error larger, of events with both", 1),
)


def _loss_errors(prediction: pd.DataFrame, model: str, horizon: float) -> pd.Series:
    first = (prediction["follower"] == 1) & (prediction["horizon_s"] == horizon)
    rows = prediction[first & (prediction["model"] == model)].set_index("event_id")
    return (rows["loss_simulated"] - rows["loss_recorded"]).dropna()


def _beside(form: str, errors: pd.Series, effects: pd.Series) -> dict[str, object]:
    error, effect = errors.abs(), effects.abs()
    both = pd.concat([error.rename("error"), effect.rename("effect")], axis=1, join="inner")
    return {
        "form": labels.FORMS[form],
        "n_error": len(error),
        "error": error.mean(),
        "error_median": error.median(),
        "n_effect": len(effect),
        "effect": effect.mean(),
        "effect_median": effect.median(),
        "net": effects.mean(),
        "ratio": words.error_over_effect(error.mean(), effect.mean()),
        "share": (both["error"] > both["effect"]).mean() if len(both) else np.nan,
    }
