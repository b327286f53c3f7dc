"""The calibration page: Table 3 side by side with ours, and what the fits may be believed for."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import pandas as pd

from highd_lc.reporting import figures_population as figures
from highd_lc.reporting import html, labels
from highd_lc.reporting.event import FitTrace
from highd_lc.reporting.figures_population import ALL
from highd_lc.reporting.figures_studies import fits_figure
from highd_lc.reporting.pages_data import Column, Section, TableView, overview_page, percentage, table_view
from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS, UNITS
from highd_lc.vocab.tables.summaries import BELIEVED


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
