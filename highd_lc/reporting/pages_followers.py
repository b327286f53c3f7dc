"""The calibration page: Table 3 side by side with ours, and what the fits may be believed for.

Below it the sections on what a lane change costs the follower, and on the model's error beside the effect.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pandas as pd

from highd_lc.reporting import figures_population as figures
from highd_lc.reporting import follower_words as words
from highd_lc.reporting import html, labels
from highd_lc.reporting.event import FitTrace
from highd_lc.reporting.figures_population import ALL
from highd_lc.reporting.figures_prediction import error_figure, externality_figure, source_label
from highd_lc.reporting.figures_studies import fits_figure
from highd_lc.reporting.pages_data import Column, Section, TableView, overview_page, percentage, table_view
from highd_lc.scoring.population import bootstrap_of, mean_interval_of
from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS, UNITS
from highd_lc.vocab.policy import PAIRS
from highd_lc.vocab.sections import StatisticsSettings
from highd_lc.vocab.tables.fits import BELIEVED
from highd_lc.vocab.tables.prediction import CONTROL, OBSERVED


@dataclass(frozen=True)
class CalibrationTables:
    """Artefacts of the calibration; examples: titled fits, each with recorded and simulated spacing and speed."""

    summary: pd.DataFrame
    followers: pd.DataFrame
    identifiability: pd.DataFrame
    pooling: pd.DataFrame
    examples: tuple[tuple[str, FitTrace], ...]


def calibration_page(calibration: CalibrationTables) -> str:
    """Table 3 side by side with ours, and what the fits may be believed for."""
    lead = (
        "Parameters of the LCM (longitudinal control model, a model of car following) fitted to what each "
        "follower did before the lane change, beside the published ones. On a few seconds of data the model is "
        "practically not identifiable: equal errors are reached with very different parameters, and many sit on "
        "a bound.",
    )
    return overview_page("calibration.html", "Calibration", _calibration_sections(calibration), lead)


def _calibration_sections(calibration: CalibrationTables) -> Iterator[Section]:
    summary, followers = calibration.summary, calibration.followers
    yield table3_section(summary)
    fitted = followers[followers["status"] == names.FITTED]
    figure = html.inline_svg(
        figures.parameters_figure(fitted),
        "Histograms of the six LCM parameters; their quantiles stand in the table above.",
    )
    yield Section(f"Distributions over {len(fitted)} fitted followers", figure=figure)
    if calibration.examples:
        yield _examples_section(calibration.examples)
    yield from _belief_sections(calibration.identifiability)
    yield from _pooling_sections(calibration.pooling)
    yield Section("Where the parameters come from", tables=(_status_table(followers),))
    for group, rows in summary[summary["group"] != ALL].groupby("group", sort=False):
        main, folded = _table3_views(_with_units(rows))
        yield Section(f"{group}s alone", tables=main, folded=folded)


def _examples_section(examples: tuple[tuple[str, FitTrace], ...]) -> Section:
    motions = [
        (title, t.spacing_recorded, t.spacing_simulated, t.speed_recorded, t.speed_simulated)
        for title, t in examples
    ]
    titles = ", ".join(title for title, _ in examples)
    figure = html.inline_svg(
        fits_figure(motions), f"Recorded against simulated spacing and speed of fits: {titles}."
    )
    return Section("Best, median and worst fit", figure=figure, anchor="examples")


def _belief_sections(known: pd.DataFrame) -> Iterator[Section]:
    if known.empty:
        return
    believed = known.loc[known["verdict"] == BELIEVED, "parameter"].tolist()
    which = f"Believable one by one: {', '.join(believed)}." if believed else "No parameter is believable alone."
    text = (
        f"{which} The values of a fit belong together: one is made up for by another, so a driver's set "
        "describes his driving while its single numbers need not describe him.",
        f"From {int(known['n'].iloc[0])} fitted followers. Interval: values of a parameter at which the "
        "objective, minimised over the other five, stays within 5 % of the best (median over the followers); "
        "open: it reaches a bound. Spread: standard deviation over seeds of the GA before the polish.",
    )
    rows = known.assign(unit=known["parameter"].map(UNITS))
    tables = (table_view(rows, _BELIEF_COLUMNS),)
    yield Section("Which parameters may be believed", text, tables=tables, anchor="believed")


def _pooling_sections(pooling: pd.DataFrame) -> Iterator[Section]:
    if pooling.empty:
        return
    text = (
        "Each follower is fitted to the first two thirds of its window and judged on the last third. A penalty "
        "draws the fit towards the median of the other followers; its strength is chosen by the other folds.",
    )
    rows = pooling.assign(label=pooling["strength"].map(_strength))
    yield Section("Own fits or pooled ones", text, tables=(table_view(rows, _POOLING_COLUMNS),), anchor="pooling")


def _strength(value: float) -> str:
    if value == 0:
        return "not at all: own fit"
    return f"strength {value:g}" if np.isfinite(value) else "entirely: the median drives"


_BELIEF_COLUMNS: Final = (
    Column("parameter", "Parameter"),
    Column("verdict", "Verdict"),
    percentage("width", "Interval, of the range", 0),
    percentage("share_open", "Interval open", 0),
    percentage("share_at_bound", "On a bound", 0),
    Column("spread", "Spread over GA seeds", digits=2),
    Column("unit", "Unit"),
    Column("partner", "Trades against"),
    Column("correlation", "|r|", digits=2),
)
_POOLING_COLUMNS: Final = (
    Column("label", "Drawn to the pool"),
    Column("held_out_mean", "Held-out error, mean", digits=4),
    Column("held_out_median", "median", digits=4),
    percentage("share_better", "Better than the own fit", 0),
    Column("folds", "Folds that chose it", digits=0),
)
_QUANTILES: Final = (("q25", "25\u00a0%"), ("q50", "50\u00a0%"), ("q75", "75\u00a0%"), ("mean", "mean"))
_TABLE3_COLUMNS: Final = (
    Column("label", "Quantity"),
    Column("unit", "Unit"),
    Column("n", "Followers", digits=0),
    *(
        Column(f"{prefix}{q}", f"{who} {title}", digits=2)
        for q, title in _QUANTILES
        for who, prefix in (("ours", ""), ("paper", "paper_"))
    ),
    percentage("share_at_bound", "On a bound", 1),
)
_FIT_COLUMNS: Final = (
    Column("label", "Quantity"),
    Column("unit", "Unit"),
    Column("n", "Followers", digits=0),
    *(Column(q, title, digits=4) for q, title in _QUANTILES),
)


def table3_section(summary: pd.DataFrame) -> Section:
    """Table 3 of the paper side by side with ours: figure and table."""
    whole = _with_units(summary[summary["group"] == ALL])
    main, folded = _table3_views(whole)
    figure = html.inline_svg(
        figures.table3_figure(whole),
        "Quartiles and mean of each LCM parameter, ours and the paper's; numbers in the table.",
    )
    return Section(
        "Table 3, ours and the paper's",
        figure=figure,
        caption="Bar: 25 % to 75 %; line: median; diamond: mean.",
        tables=main,
        folded=folded,
        anchor="table3",
    )


def _table3_views(labelled: pd.DataFrame) -> tuple[tuple[TableView], tuple[TableView]]:
    """The parameters beside the paper's, and how well they fit."""
    are_parameters = labelled["quantity"].isin(PARAMETERS)
    parameters = table_view(labelled[are_parameters], _TABLE3_COLUMNS)
    return (parameters,), (table_view(labelled[~are_parameters], _FIT_COLUMNS, "How well they fit"),)


def _with_units(summary: pd.DataFrame) -> pd.DataFrame:
    order = {name: k for k, name in enumerate(PARAMETERS)}
    place = summary["quantity"].map(order).fillna(len(order))
    labelled = summary.assign(
        label=summary["quantity"].map(lambda q: labels.PARAMETERS.get(q) or labels.FIT_QUALITY.get(q, (q,))[0]),
        unit=summary["quantity"].map(lambda q: UNITS.get(q) or labels.FIT_QUALITY.get(q, ("", ""))[1]),
        _place=place,
    )
    return labelled.sort_values("_place", kind="stable")


def _status_table(followers: pd.DataFrame) -> TableView:
    counts = followers["status"].value_counts()
    rows = tuple((labels.FIT_STATUSES[s], int(counts.get(s, 0))) for s in names.FIT_STATUSES)
    return TableView((Column("status", "Parameters"), Column("n", "Followers", digits=0)), rows)


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
            "Change of HV 1's loss beyond that of keeping its speed of the start: as recorded, of matched "
            "followers who are not cut in on, and as each model has it. A model that charges a multiple of what "
            "drivers pay is refuted, whatever its error of speed.",
            *_told(rows, default),
        ),
        html.inline_svg(externality_figure(rows, default), "Mean change of loss; the table holds the numbers."),
        "Dots: means over the events; lines: 95 % intervals over recordings, over events where those are fewer "
        "than five.",
        (table_view(rows, _COST_COLUMNS),),
        anchor="cost",
    )
    yield from _balance_sections(balance)


_COST_COLUMNS: Final = (
    Column("label", "Source"),
    Column("horizon_s", "After", "s", 0),
    Column("n", "Events", digits=0),
    Column("mean", "Mean change of loss", digits=3),
    Column("low", "from", digits=3),
    Column("high", "to", digits=3),
    Column("observed", "Observed, same events", digits=3),
    Column("verdict", "Against the observed"),
    Column("n_paired", "Events with controls", digits=0),
    Column("beyond", "Beyond the controls", digits=3),
    Column("beyond_low", "from", digits=3),
    Column("beyond_high", "to", digits=3),
)
_CONFIDENCE: Final = 0.95


def _costs(externality: pd.DataFrame) -> pd.DataFrame:
    """Mean change of loss by source and horizon, and beyond that of the controls of the same events.

    observed: the mean and interval of the recorded drivers in the events that the source has.
    """
    key = ["event_id", "horizon_s", "recording_id"]
    wide = externality.pivot_table(index=key, columns="source", values="loss_change")
    wide = wide.reindex(columns=list(dict.fromkeys((*wide.columns, OBSERVED, CONTROL))))
    rows = []
    for horizon, part in wide.groupby(level="horizon_s"):
        for source in wide.columns:
            own = part[part[source].notna()]
            if len(own):
                rows.append({"source": source, "horizon_s": float(str(horizon)), **_cost(own, source)})
    return pd.DataFrame(rows)


def _cost(own: pd.DataFrame, source: str) -> dict[str, Any]:
    beyond = (own[source] - own[CONTROL]).dropna() if source != CONTROL else own[source].iloc[:0]
    observed = own[OBSERVED].dropna()
    row: dict[str, float] = {"n": len(own), "n_paired": int(own[CONTROL].notna().sum())}
    for name, values in (("", own[source]), ("beyond_", beyond), ("observed_", observed)):
        low, high = _interval(values)
        row |= {name.rstrip("_") or "mean": float(values.mean()), f"{name}low": low, f"{name}high": high}
    return row | {"verdict": "" if source in (OBSERVED, CONTROL) else _verdict(row)}


def _interval(values: pd.Series) -> tuple[float, float]:
    """Over recordings, over events where those are fewer than five (equations.md 12.2)."""
    recordings = values.index.get_level_values("recording_id").to_numpy(np.int64)
    how = bootstrap_of(StatisticsSettings(confidence=_CONFIDENCE), seed=1)
    low, high, _ = mean_interval_of(values.to_numpy(np.float64), recordings, how)
    return low, high


def _told(rows: pd.DataFrame, default: str) -> Iterator[str]:
    """Of each horizon what drivers pay, and what the model that plans, own fits and Table 3 charge them."""
    for horizon, part in rows.groupby("horizon_s"):
        cells = {row["source"]: row for row in part.to_dict("records")}
        chosen = [m for m in dict.fromkeys((default, names.OWN_FIT, names.TABLE3)) if m in cells]
        if chosen and OBSERVED in cells:
            row = cells[OBSERVED]
            ends = f" ({_number(row['low'])} to {_number(row['high'])})" if row["low"] == row["low"] else ""
            charges = "; ".join(
                f"{cells[m]['label']} {_number(cells[m]['mean'])}, {cells[m]['verdict']}" for m in chosen
            )
            yield f"Over {horizon:g} s drivers pay {_number(row['mean'])}{ends}. The models charge: {charges}."


def _verdict(row: dict[str, float]) -> str:
    """Whether a mean cost is within the observed interval of the same events, else what multiple it is."""
    if html.is_missing(row["observed_low"]):
        return "no interval"
    if row["observed_low"] <= row["mean"] <= row["observed_high"]:
        return "inside"
    return f"{words.times(row['mean'] / row['observed'])}" if row["observed"] > 0.0 < row["mean"] else "outside"


def _number(value: float) -> str:
    return html.number(value, 2)


def _balance_sections(balance: pd.DataFrame) -> Iterator[Section]:
    if balance.empty:
        return
    apart = balance["standardised_difference"].abs() > _UNBALANCED
    listed = ", ".join(dict.fromkeys(balance.loc[apart, "covariate"])).replace("_", " ")
    found = f"Apart by more: {listed}." if listed else "None is apart by more."
    columns = (
        Column("label", "Matched on"),
        Column("horizon_s", "Over", "s", 0),
        Column("n", "Events", digits=0),
        percentage("share_matched", "Share of the events in view", 0),
        Column("mean_event", "Mean of the followers", digits=3),
        Column("mean_control", "Mean of their controls", digits=3),
        Column("standardised_difference", "Standardised difference", digits=3),
    )
    rows = balance.assign(label=[name.replace("_", " ") for name in balance["covariate"]])
    text = (
        "Controls are matched within the recording, so that they share the drift of their carriageway, and by "
        "lane and class; every change is that from a driver's own speed at the start. "
        f"Controls are alike up to {_UNBALANCED:g} standard deviations of the followers. {found}"
    )
    yield Section("How alike the controls are", (text,), tables=(table_view(rows, columns),), anchor="balance")


def error_sections(losses: pd.DataFrame) -> Iterator[Section]:
    """The model's error in the followers' loss beside the policies' effect on it, event by event and together."""
    found = {form: words.effect_by_event(losses, form) for form in PAIRS}
    found = {form: events for form, events in found.items() if len(events)}
    if not found:
        return
    errors = pd.concat([events["error"] for events in found.values()])
    errors = errors[~errors.index.duplicated()]
    figure = error_figure(
        errors.to_numpy(float), {form: events["effect"].to_numpy(float) for form, events in found.items()}
    )
    yield Section(
        "Error over effect",
        (
            "Both are changes of the same loss: that of all followers, weighted as in every plan, over the "
            "samples in which each is filmed in its lane behind the recorded lane changer, at most 8 s, with "
            "the comfort of the speed smoothed over 1 s. Error: simulated behind the recorded lane changer "
            "minus recorded. Effect: local optimum minus benchmark. Events with a contact under either have none.",
        ),
        html.inline_svg(
            figure, "Shares of events by absolute error and by absolute effect; numbers in the table."
        ),
        tables=(table_view(pd.DataFrame([_beside(f, e) for f, e in found.items()]), _BESIDE_COLUMNS),),
        anchor="error",
    )


_BESIDE_COLUMNS: Final = (
    Column("form", "Form"),
    Column("n", "Events", digits=0),
    Column("error", "Mean absolute error", digits=3),
    Column("error_median", "median", digits=3),
    Column("effect", "Mean absolute effect", digits=3),
    Column("effect_median", "median", digits=4),
    Column("net", "Mean effect with its sign", digits=3),
    Column("ratio", "Error over effect", digits=2),
    Column("ratio_median", "median over events", digits=2),
    percentage("share", "Events with the error larger", 1),
)


def _beside(form: str, events: pd.DataFrame) -> dict[str, object]:
    error, effect = events["error"].abs(), events["effect"].abs()
    each = [words.error_over_effect(e, f) for e, f in zip(error, effect, strict=True)]
    return {
        "form": labels.FORMS[form],
        "n": len(events),
        "error": error.mean(),
        "error_median": error.median(),
        "effect": effect.mean(),
        "effect_median": effect.median(),
        "net": events["effect"].mean(),
        "ratio": words.error_over_effect(error.mean(), effect.mean()),
        "ratio_median": float(np.median(each)),
        "share": (error > effect).mean(),
    }
