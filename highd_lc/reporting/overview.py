"""Overview pages: a title, some text, and sections of figures and tables."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd
from markupsafe import Markup

from highd_lc.reporting import html


@dataclass(frozen=True)
class Column:
    """A column of a table on a page: which column of the frame, its title and unit, and how cells are written.

    digits: decimals of a number, None = text. scale: what numbers are multiplied by. link: address with ``{}``
    for the cell's text, None = no link.
    """

    name: str
    title: str
    unit: str = ""
    digits: int | None = None
    scale: float = 1.0
    link: str | None = None


@dataclass(frozen=True)
class TableView:
    """A table as it stands on a page."""

    columns: tuple[Column, ...]
    rows: tuple[tuple[Any, ...], ...]
    caption: str = ""


@dataclass(frozen=True)
class Section:
    """A part of a page: heading, paragraphs, points (heading and paragraphs each), a figure with its caption,
    tables, and tables behind a click.
    """

    title: str = ""
    text: tuple[str | Markup, ...] = ()
    figure: Markup | None = None
    caption: str = ""
    tables: tuple[TableView, ...] = ()
    folded: tuple[TableView, ...] = ()
    anchor: str = ""
    points: tuple[tuple[str, tuple[str, ...]], ...] = ()


def table_view(frame: pd.DataFrame, columns: Sequence[Column], caption: str = "") -> TableView:
    """The chosen columns of a frame as a table."""
    cells = [[_cell(value, column) for value in frame[column.name].tolist()] for column in columns]
    return TableView(tuple(columns), tuple(zip(*cells, strict=True)), caption)


def _cell(value: Any, column: Column) -> Any:
    if column.digits is None:
        return "–" if value is None or value == "" else value
    return None if html.is_missing(value) else column.scale * value


def overview_page(here: str, title: str, sections: Iterable[Section], lead: Sequence[str | Markup] = ()) -> str:
    """A page from its sections. here: its file name."""
    context = {"root": "", "here": here, "title": title, "lead": lead, "sections": list(sections)}
    return html.render("overview.html", context)
