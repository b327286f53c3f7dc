"""The two pages to begin with: the index of all events and the summary.

The index is a table that a reader searches, sorts and filters in the browser. The summary shows the population's
results on one screen, with links to everything behind them.
"""

import base64
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
import pandas as pd
from markupsafe import Markup

from highd_lc.reporting import figures_population as figures
from highd_lc.reporting import html, labels
from highd_lc.reporting.certainty_words import beside, no_interval
from highd_lc.reporting.figures_population import ALL
from highd_lc.reporting.figures_studies import gain_map_figure
from highd_lc.reporting.pages_data import (
    Column,
    Further,
    Section,
    funnel_section,
    overview_page,
    percentage,
    quality_section,
    table_view,
)
from highd_lc.reporting.pages_followers import table3_section
from highd_lc.reporting.pages_population import distribution_section, extremes_section, matrix_section, with_labels
from highd_lc.reporting.pages_robust import hidden_words, quoted
from highd_lc.reporting.pages_studies import pareto_section
from highd_lc.reporting.run_words import Said
from highd_lc.vocab import names
from highd_lc.vocab.policy import PAIRS

_ACCOUNTINGS: Final = (names.EQUAL, names.FOLLOWER_HORIZON, names.PAPER)
CELLS: Final = tuple((form, accounting) for form in PAIRS for accounting in _ACCOUNTINGS)
"""Forms and accountings that the table may speak of, the primary one first."""
_COLUMNS: Final = (
    {"key": "event_id", "title": "Event", "kind": "event", "width": 9.5},
    {"key": "recording_id", "title": "Recording", "kind": "number", "digits": 0, "width": 6.2},
    {"key": "ego_class", "title": "Class", "kind": "text", "width": 4.5},
    {"key": "direction", "title": "Direction", "kind": "text", "width": 5.5},
    {"key": "duration_s", "title": "Duration", "unit": "s", "kind": "number", "digits": 1, "width": 5.5},
    {"key": "followers", "title": "Followers", "kind": "number", "digits": 0, "width": 6},
    {"key": "status", "title": "Status", "kind": "text", "width": 7},
    {"key": "total_benchmark", "title": "Benchmark loss", "kind": "number", "digits": 2, "width": 6.8},
    {"key": "total_local", "title": "Local loss", "kind": "number", "digits": 2, "width": 5},
    {"key": "gain", "title": "Gain", "unit": "%", "kind": "gain", "width": 8},
    {"key": "spark", "title": "HV 1 speed", "kind": "spark", "width": 8},
)
STATUSES: Final = tuple(labels.STATUSES)
SPARK_SECONDS: Final = 15
_SPARK_STEP: Final = 0.2


@dataclass(frozen=True)
class IndexTables:
    """Artefacts of a whole run: events, crossings, plans, losses, validation_matrix, and event_pages."""

    events: pd.DataFrame
    crossings: pd.DataFrame
    plans: pd.DataFrame
    losses: pd.DataFrame
    matrix: pd.DataFrame
    pages: pd.DataFrame


def index_page(tables: IndexTables, *, raw: bool = False, says: str = "", believed: Section | None = None) -> str:
    """The index page of a run.

    raw: whether the event pages carry unrounded recorded motion; says: what the run says, see ``run_words``;
    believed: what stands in front of it, see ``pages_prediction``.
    """
    events, crossings = tables.events, tables.crossings
    excluded = crossings.loc[~crossings["usable"], "reason"].value_counts()
    planned = set(tables.plans["policy"].unique())
    present = [cell for cell in CELLS if PAIRS[cell[0]][1] in planned]
    context = {
        "root": "",
        "here": "index.html",
        "raw": raw,
        "says": says,
        "believed": believed,
        "n_events": len(events),
        "n_recordings": int(events["recording_id"].nunique()),
        "n_crossings": len(crossings),
        "n_excluded": int(excluded.sum()),
        "reasons": [(code, labels.REASONS[code], int(excluded.get(code, 0))) for code in names.REASONS],
        "accountings": [labels.ACCOUNTING_NAMES[accounting] for accounting in _ACCOUNTINGS],
        "first": list(_first_looks(tables)),
        "matrix": _matrix(tables.matrix),
        "why": _why_no_interval(tables.matrix),
        "filters": _filters(events, tables.plans),
        "cells": [
            (_key(cell), f"{labels.FORMS[cell[0]]}, {labels.ACCOUNTING_NAMES[cell[1]].lower()}")
            for cell in present
        ],
        "spark_seconds": SPARK_SECONDS,
        "payload": index_payload(tables, present),
    }
    return html.render("index.html", context)


def _matrix(matrix: pd.DataFrame) -> list[tuple[str, list[str]]]:
    """Gain over all events, and that of the added loss, by form (rows) and accounting (columns)."""
    whole = {(row.form, row.accounting): row for row in matrix[matrix["stratum"] == ALL].itertuples(index=False)}
    present = [form for form in PAIRS if (form, names.PRIMARY_ACCOUNTING) in whole]
    return [
        row
        for form in present
        for row in (
            (labels.FORMS[form], [_gain(whole[form, a]) for a in _ACCOUNTINGS]),
            (
                "the same, of what the change adds",
                [_gain(whole[form, a], "gain_incremental") for a in _ACCOUNTINGS],
            ),
        )
    ]


def _gain(row: Any, name: str = "gain") -> str:
    """A gain with its interval, if it has one."""
    return beside(row, name).partition(" (no interval")[0]


def _why_no_interval(matrix: pd.DataFrame) -> list[str]:
    """Why gains have no interval, each reason once."""
    whole = matrix[(matrix["stratum"] == ALL) & matrix["gain"].notna() & matrix["gain_low"].isna()]
    return list(dict.fromkeys(no_interval(int(n)) for n in whole["n_clusters"]))


_FEW: Final = 3


def _first_looks(tables: IndexTables) -> Iterator[Section]:
    """What a reader looks for: the events at both ends, and how the gains are spread."""
    if not len(tables.losses) or not len(tables.events):
        return
    yield extremes_section(tables.losses, tables.events, _FEW)
    yield distribution_section(tables.losses, tables.events)


def _key(cell: tuple[str, str]) -> str:
    return "/".join(cell)


def _filters(events: pd.DataFrame, plans: pd.DataFrame) -> list[tuple[str, str, list[Any]]]:
    statuses = sorted({labels.STATUSES[s] for s in plans.loc[plans["policy"].isin(PAIRS[names.FIXED]), "status"]})
    return [
        ("recording_id", "Recording", sorted(events["recording_id"].unique().tolist())),
        ("ego_class", "Class", sorted(events["ego_class"].unique().tolist())),
        ("direction", "Direction", sorted(events["direction"].unique().tolist())),
        ("status", "Status", statuses),
    ]


def index_payload(tables: IndexTables, cells: Iterable[tuple[str, str]] = CELLS) -> dict[str, Any]:
    """Columns and rows of the table, ready for JSON; per form and accounting the columns that depend on it."""
    rows = [_row(event, spark) for event, spark in zip(_events(tables), _sparks(tables), strict=True)]
    chosen = list(cells)
    return {
        "columns": list(_COLUMNS),
        "rows": rows,
        "cells": [_key(cell) for cell in chosen],
        "statuses": list(labels.STATUSES.values()),
        "values": {_key(cell): _values(tables, cell) for cell in chosen},
    }


def _events(tables: IndexTables) -> Iterable[Any]:
    return tables.events.itertuples(index=False)


def _row(event: Any, spark: list[str] | None) -> list[Any]:
    known = {
        "event_id": event.event_id,
        "recording_id": event.recording_id,
        "ego_class": event.ego_class,
        "direction": event.direction,
        "duration_s": round(event.duration_s, 1),
        "followers": len(event.follower_ids),
        "spark": spark,
    }
    return [known.get(str(column["key"])) for column in _COLUMNS]


def _values(tables: IndexTables, cell: tuple[str, str]) -> dict[str, list[Any]]:
    """What depends on form and accounting; the script derives the rest. status: place in ``STATUSES``."""
    form, accounting = cell
    ids = tables.events["event_id"]
    benchmark, local = (_totals(tables.losses, policy, accounting).reindex(ids) for policy in PAIRS[form])
    gain = 100.0 * (1.0 - local / benchmark)
    status = _column(tables.plans, PAIRS[form][1], accounting, "status").reindex(ids)
    place = {name: k for k, name in enumerate(STATUSES)}
    return {
        "status": [place.get(name) for name in status],
        "total_benchmark": _numbers(benchmark, 3),
        "gain": _numbers(gain, 3),
    }


def _totals(losses: pd.DataFrame, policy: str, accounting: str) -> pd.Series:
    return _column(losses, policy, accounting, "loss_total")


def _column(table: pd.DataFrame, policy: str, accounting: str, column: str) -> pd.Series:
    rows = table[(table["policy"] == policy) & (table["accounting"] == accounting)]
    return rows.set_index("event_id")[column]


def _numbers(values: pd.Series, digits: int) -> list[float | None]:
    return [round(v, digits) if np.isfinite(v) else None for v in values.astype(float).tolist()]


def _sparks(tables: IndexTables) -> list[list[str] | None]:
    rows: Iterable[Any] = tables.pages.itertuples(index=False)
    pages = {row.event_id: row for row in rows}
    return [_spark(pages.get(event_id)) for event_id in tables.events["event_id"]]


def _spark(page: Any) -> list[str] | None:
    if page is None or len(page.hv1_speed_benchmark) == 0 or len(page.hv1_speed_local) == 0:
        return None
    start = page.hv1_speed_benchmark[0]
    return [_bytes(np.asarray(v) - start) for v in (page.hv1_speed_benchmark, page.hv1_speed_local)]


def _bytes(differences: Any) -> str:
    levels = np.clip(np.rint(differences / _SPARK_STEP), -128, 127).astype(np.int8)
    return base64.b64encode(levels.tobytes()).decode("ascii")


_NOTHING: Final = 1e-9


@dataclass(frozen=True)
class SummaryTables:
    """Artefacts of a whole run that the summary shows. further: the events that got so far, see ``Further``."""

    events: pd.DataFrame
    crossings: pd.DataFrame
    losses: pd.DataFrame
    matrix: pd.DataFrame
    summary_losses: pd.DataFrame
    summary_lcm: pd.DataFrame
    recordings: pd.DataFrame
    gain_map: pd.DataFrame
    pareto: pd.DataFrame
    pareto_summary: pd.DataFrame
    pages: pd.DataFrame
    further: Further = field(default_factory=dict)


def summary_page(
    tables: SummaryTables, says: Sequence[Said] = (), first: Sequence[Section] = (), *, short: Sequence[Said] = ()
) -> str:
    """The results of a run on one page.

    says: the same in words, see ``run_words``; first: what stands in front of every gain; short: the finding.
    """
    lead = (
        f"{len(tables.events)} lane changes of {tables.events['recording_id'].nunique()} recordings.",
        Markup(
            'More: <a href="index.html">all events</a>, <a href="matrix.html">the matrix by stratum</a>, '
            '<a href="studies.html">robustness</a>, <a href="calibration.html">calibration</a>, '
            '<a href="data.html">data</a>, <a href="excluded.html">excluded lane-id changes</a>.'
        ),
    )
    words = [Section("What this run says", points=tuple(says), anchor="says")] if says else []
    begin = [Section("In short", points=tuple(short), anchor="short")] if short else []
    return overview_page("summary.html", "Summary", [*first, *begin, *words, *_sections(tables)], lead)


def _sections(tables: SummaryTables) -> Iterator[Section]:
    if len(tables.losses):
        yield replace(matrix_section(with_labels(tables.matrix)), title="Local optimum against benchmark")
        yield _losses_section(tables)
        yield distribution_section(tables.losses, tables.events)
        yield _map_section(tables)
        yield extremes_section(tables.losses, tables.events)
    if len(tables.events):
        yield table3_section(tables.summary_lcm)
    if len(tables.losses):
        yield pareto_section(tables.pareto, tables.pareto_summary)
    yield funnel_section(tables.crossings, tables.further)
    yield quality_section(tables.recordings)


_DIFFERENCE_COLUMNS: Final = (
    Column("policy_label", "Policy"),
    Column("against_label", "Against"),
    Column("quantity_label", "Quantity"),
    Column("n", "Events", digits=0),
    Column("mean", "Mean", digits=2),
    Column("mean_against", "Mean of the other", digits=2),
    Column("ratio_of_sums", "Ratio of sums", digits=4),
    Column("median_difference", "Median difference", digits=3),
    Column("hodges_lehmann", "the same, Hodges-Lehmann", digits=3),
    Column("difference_low", "Mean difference from", digits=3),
    Column("difference_high", "to", digits=3),
    percentage("share_better", "Better", 1),
    percentage("share_worse", "Worse", 1),
    percentage("share_tied", "Tied", 1),
)


def _losses_section(tables: SummaryTables) -> Section:
    rows = tables.summary_losses
    primary = rows[rows["accounting"] == names.PRIMARY_ACCOUNTING].assign(
        policy_label=lambda t: t["policy"].map(labels.short_policy),
        against_label=lambda t: t["against"].map(labels.short_policy),
        quantity_label=lambda t: t["quantity"].map(labels.QUANTITIES),
    )
    figure = html.inline_svg(
        figures.loss_bars(tables.losses),
        "Mean loss of AV and followers by policy, under each accounting; numbers in the table.",
    )
    caption = "Paired differences under the accounting “equal”; intervals over recordings, none below five."
    # Of nothing no share can be taken: sums that are 0 but for rounding have no ratio.
    nothing = primary["mean_against"].abs() < _NOTHING
    primary = primary.assign(
        quantity_label=primary["quantity_label"].fillna(primary["quantity"]),
        ratio_of_sums=primary["ratio_of_sums"].mask(nothing),
    )
    main = primary["quantity"].isin(("loss_total", "loss_av", "loss_hv"))
    return Section(
        "Losses by policy",
        figure=figure,
        tables=(table_view(primary[main], _DIFFERENCE_COLUMNS, caption),),
        folded=(table_view(primary[~main], _DIFFERENCE_COLUMNS, "Comfort, efficiency and safety"),),
    )


def _map_section(tables: SummaryTables) -> Section:
    tiles = tables.gain_map
    tiles = tiles[(tiles["form"] == names.FIXED) & (tiles["accounting"] == names.PRIMARY_ACCOUNTING)]
    spacing, difference = (tables.pages[c].to_numpy(float) for c in ("hv1_spacing_m", "hv1_speed_difference_mps"))
    figure = gain_map_figure(tiles, spacing, difference)
    return Section(
        "Where local optimality pays",
        (hidden_words(tiles),),
        figure=html.inline_svg(
            figure, "Gain over spacing and speed difference of the first follower at the start."
        ),
        caption="Every dot is an event; a tile's colour is the gain over its events; hatched: not to be quoted. "
        "Fixed end speed, “equal”.",
        folded=(table_view(quoted(tiles, "gain", "gain_low", "gain_high"), _MAP_COLUMNS, "All tiles"),),
        anchor="gain-map",
    )


_MAP_COLUMNS: Final = (
    Column("spacing_low_m", "Spacing from", "m", 0),
    Column("spacing_high_m", "to", "m", 0),
    Column("closing_low_mps", "Speed difference from", "m/s", 0),
    Column("closing_high_mps", "to", "m/s", 0),
    Column("n_events", "Events", digits=0),
    percentage("share_events", "Share of events", 1),
    Column("infeasible", "Infeasible", digits=0),
    Column("contacts", "Contacts", digits=0),
    percentage("gain", "Gain, where it can be seen"),
    percentage("gain_low", "from"),
    percentage("gain_high", "to"),
    Column("error_over_effect", "Error over effect", digits=1),
)
