"""Bodies of the tables on an event's page: rows of ``event_rows`` in, lines of a table out.

Each body is one string. A page has a hundred such lines: written by a template, value by value, they take three
times as long.
"""

from collections.abc import Callable, Iterable, Mapping
from functools import cache
from typing import Any

from markupsafe import Markup, escape

from highd_lc.reporting.html import bars, cells, number, policy_head

Line = Mapping[str, Any]


def loss_body(rows: Iterable[Line]) -> Markup:
    """The lines of the table of losses (see ``event_rows.loss_rows``)."""
    return _joined(_loss_line, rows)


def plan_body(rows: Iterable[Line]) -> Markup:
    """The lines of the table of plans (see ``event_rows.plan_rows``)."""
    return _joined(_plan_line, rows)


def safety_body(rows: Iterable[Line]) -> Markup:
    """The lines of the table of safety (see ``event_rows.plan_rows``)."""
    return _joined(_safety_line, rows)


def margin_body(rows: Iterable[Line]) -> Markup:
    """The lines of the table of margins (see ``event_rows.margins``)."""
    return _joined(_margin_line, rows)


def tracking_body(rows: Iterable[Line]) -> Markup:
    """The lines of the table of tracking (see ``event_rows.tracking_row``)."""
    return _joined(_tracking_line, rows)


def _joined(line: Callable[[Line], str], rows: Iterable[Line]) -> Markup:
    return Markup("".join([line(row) for row in rows]))


@cache
def _word(text: str) -> str:
    """A text from data, escaped once for all pages: there are few different ones."""
    return str(escape(text))


def _loss_line(row: Line) -> str:
    head = f'<tr data-policy="{_word(row["policy"])}">{policy_head(row["policy"])}\n<td>{_composition(row)}</td>'
    return f"{head}\n{cells(row['cells'], 3)}{cells(row['each'], 3)}\n</tr>\n"


def _composition(row: Line) -> str:
    """The bars of a loss and what they show in words, or why there is none."""
    if not row["bars"]:
        return _word(row["status"])
    label = f"{_word(row['label'])}: total {number(row['cells'][6], 2)}"
    return f'<div class="bars" role="img" aria-label="{label}">{bars(row["bars"])}</div>'


def _plan_line(row: Line) -> str:
    bad = ' class="bad"' if row["infeasible"] else ""
    head = f"<tr>{policy_head(row['policy'])}<td{bad}>{_word(row['status'])}</td>"
    return f"{head}\n{cells(row['cells'])}<td>{escape(row['remarks'])}</td></tr>\n"


def _safety_line(row: Line) -> str:
    return f"<tr>{policy_head(row['policy'])}{cells(row['safety'])}</tr>\n"


def _margin_line(row: Line) -> str:
    head = f'<tr><th scope="row">{_word(row["name"])}</th><td class="unit">{_word(row["unit"])}</td>'
    return f"{head}{cells(row['margins'], 2)}{cells(row['rejected'], 0)}</tr>\n"


def _tracking_line(row: Line) -> str:
    head = f"<tr>{policy_head(row['policy'])}<td>{_word(row['plant'])}</td><td>{_word(row['status'])}</td>"
    return f"{head}\n{cells(row['cells'])}<td>{_word(row['violations'])}</td></tr>\n"
