"""The index of all events: a table that a reader searches, sorts and filters in the browser."""

import base64
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pandas as pd

from highd_lc.reporting import html, labels
from highd_lc.reporting.event import PAIRS
from highd_lc.reporting.figures_population import ALL
from highd_lc.reporting.pages_data import Section
from highd_lc.vocab import names

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
    present = [cell for cell in CELLS if PAIRS[cell[0]][0] in planned]
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
        "matrix": _matrix(tables.matrix),
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
    """Gain and interval over all events by form (rows) and accounting (columns)."""
    whole = {(row.form, row.accounting): row for row in matrix[matrix["stratum"] == ALL].itertuples(index=False)}
    present = [form for form in PAIRS if (form, names.PRIMARY_ACCOUNTING) in whole]
    return [(labels.FORMS[form], [_interval(whole[form, a]) for a in _ACCOUNTINGS]) for form in present]


def _interval(row: Any) -> str:
    low, high = (html.number(100 * bound, 2) for bound in (row.gain_low, row.gain_high))
    return f"{html.percent(row.gain)} ({low} to {high})"


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
    local, benchmark = (_totals(tables.losses, policy, accounting).reindex(ids) for policy in PAIRS[form])
    gain = 100.0 * (1.0 - local / benchmark)
    status = _column(tables.plans, PAIRS[form][0], accounting, "status").reindex(ids)
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
