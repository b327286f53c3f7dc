"""Pages of what went in: quality of the recordings, the lane changes found, and those that are excluded.

Overview pages: a title, some text, and sections of figures and tables.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final, TypeAlias

import pandas as pd
from markupsafe import Markup

from highd_lc.reporting import figures_extraction as figures
from highd_lc.reporting import html, labels
from highd_lc.reporting.follower_words import PAGE as PREDICTION_PAGE
from highd_lc.vocab import names

_NOWHERE: Final[Mapping[str, frozenset[str]]] = MappingProxyType({})


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


def percentage(name: str, title: str, digits: int = 2) -> Column:
    """A column of shares, written in percent."""
    return Column(name, title, "%", digits, 100.0)


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


def believed_section(says: Sequence[str], *, linked: bool) -> Section:
    """What stands in front of every gain. says: see ``follower_words``; linked: whether there is a page on it."""
    link = Markup('More: <a href="{0}">how well followers are predicted</a>.').format(PREDICTION_PAGE)
    text = (*says, link) if linked else tuple(says)
    return Section("How far the followers can be believed", text, anchor="believed")


Further: TypeAlias = Mapping[str, frozenset[str]]
"""Ids of the events that got so far, by a word for it: calibrated, planned, tracked, reported."""


def data_page(
    recordings: pd.DataFrame, crossings: pd.DataFrame, events: pd.DataFrame, further: Further = _NOWHERE
) -> str:
    """Quality of the recordings, funnel and distributions of the lane changes."""
    lead = (
        f"{recordings['recording_id'].nunique()} recordings, {int(recordings['n_vehicles'].sum())} vehicles, "
        f"{len(crossings)} lane-id changes, {len(events)} of them usable. The recorded leader ids confirm who is "
        f"who in {int(events['roles_confirmed'].sum())} of these.",
    )
    return overview_page("data.html", "Data", _data_sections(recordings, crossings, events, further), lead)


def _data_sections(
    recordings: pd.DataFrame, crossings: pd.DataFrame, events: pd.DataFrame, further: Further
) -> Iterator[Section]:
    yield funnel_section(crossings, further)
    figure = html.inline_svg(
        figures.distributions_figure(crossings, events),
        "Distributions of duration, lateral shift, peak lateral speed, gaps at the start and number of followers.",
    )
    yield Section("The lane changes", figure=figure, anchor="distributions")
    yield quality_section(recordings)


def empty_page(here: str, title: str, why: str, crossings: pd.DataFrame) -> str:
    """A page of results of which there are none: why, and what became of the lane-id changes."""
    return overview_page(here, title, [funnel_section(crossings)], (why,))


_CARRIAGEWAYS: Final = {1: "upper", 2: "lower"}
_QUALITY_COLUMNS: Final = (
    Column("recording_id", "Recording", digits=0),
    Column("carriageway", "Carriageway"),
    Column("n_vehicles", "Vehicles", digits=0),
    Column("n_trucks", "Trucks", digits=0),
    Column("frame_rate", "Frame rate", "Hz", 1),
    Column("n_holes", "Holes in tracks", digits=0),
    Column("n_jumps", "Jumps in tracks", digits=0),
    percentage("share_outside", "Rows outside markings"),
    Column("mean_acceleration", "Mean acceleration (bias)", "m/s²", 3),
    Column("disagreement_inner", "Speed against position, inside the section", "m/s", 3),
    percentage("share_lane_changes", "Lane-id changes agree"),
    percentage("share_leader_ids", "Leader ids agree"),
    percentage("share_acceleration", "Acceleration agrees with speed"),
    Column("failed", "Failed cross-checks"),
)


def quality_section(recordings: pd.DataFrame) -> Section:
    """Quality of the data: figure, and a row for each recording and direction."""
    frame = recordings.assign(
        carriageway=recordings["driving_direction"].map(_CARRIAGEWAYS),
        failed=[", ".join(checks).replace("_", " ") for checks in recordings["failed_checks"]],
    )
    figure = html.inline_svg(
        figures.quality_figure(recordings),
        "Bias of the mean forward acceleration by recording and direction, and disagreement of position and speed "
        "along the section.",
    )
    folded = (table_view(frame, _QUALITY_COLUMNS, "All recordings"),)
    return Section("Quality of the data", figure=figure, folded=folded, anchor="quality")


def excluded_page(crossings: pd.DataFrame, further: Further = _NOWHERE) -> str:
    """Every lane-id change that is no event, by reason, with what is known of it. crossings: ``crossings``."""
    usable = int(crossings["usable"].sum())
    lead = (
        f"{len(crossings)} lane-id changes were found: {usable} usable, {len(crossings) - usable} excluded. "
        "Each is excluded for exactly one reason, the first that applies in the order of the table.",
        "A dash for start or end: not in view. highd-lc show ID prints one with the vehicles around it.",
    )
    sections = _excluded_sections(crossings, further)
    return overview_page("excluded.html", "Excluded lane-id changes", sections, lead)


_EXCLUDED_COLUMNS: Final = (
    Column("event_id", "Lane-id change"),
    Column("recording_id", "Recording", digits=0),
    Column("ego_class", "Class"),
    Column("direction", "Direction"),
    Column("origin_lane", "Origin lane", digits=0),
    Column("target_lane", "Target lane", digits=0),
    Column("speed_mps", "Speed", "m/s", 1),
    Column("start_frame", "Start frame", digits=0),
    Column("crossing_frame", "Crossing frame", digits=0),
    Column("end_frame", "End frame", digits=0),
    Column("event_of_vehicle", "Usable change of the vehicle", link="events/{}.html"),
)


def _excluded_sections(crossings: pd.DataFrame, further: Further) -> Iterator[Section]:
    yield funnel_section(crossings, further)
    vehicle = ["recording_id", "ego_id"]
    first = crossings[crossings["usable"]].drop_duplicates(vehicle)[[*vehicle, "event_id"]]
    known = first.rename(columns={"event_id": "event_of_vehicle"})
    excluded = crossings[~crossings["usable"]].merge(known, on=vehicle, how="left")
    excluded["event_of_vehicle"] = excluded["event_of_vehicle"].astype(object).where(lambda ids: ids.notna(), None)
    for reason, rows in ((r, excluded[excluded["reason"] == r]) for r in names.REASONS):
        if len(rows):
            text = f"{labels.REASONS[reason][0].upper()}{labels.REASONS[reason][1:]}"
            yield Section(f"{text} ({len(rows)})", tables=(table_view(rows, _EXCLUDED_COLUMNS),), anchor=reason)


def funnel_section(crossings: pd.DataFrame, further: Further = _NOWHERE) -> Section:
    """What becomes of the lane-id changes: figure, and counts with cars and trucks apart."""
    counts = pd.crosstab(crossings["reason"], crossings["ego_class"])
    counts = counts.reindex(index=["", *names.REASONS], columns=list(names.CLASSES), fill_value=0)
    rows = [_funnel_row(reason, counts.loc[reason].tolist()) for reason in counts.index]
    total = ("all", "", *counts.sum().tolist(), int(counts.to_numpy().sum()))
    columns = (
        Column("class", "Reason"),
        Column("meaning", "Meaning"),
        *(Column(c, f"{c}s", digits=0) for c in names.CLASSES),
        Column("all", "All", digits=0),
    )
    return Section(
        "What becomes of the lane-id changes",
        figure=html.inline_svg(
            figures.funnel_figure(crossings, further), "The funnel; the table holds the numbers."
        ),
        tables=(TableView(columns, (*rows, total, *_further_rows(crossings, further))),),
        anchor="funnel",
    )


_FURTHER: Final = {
    "calibrated": "of the usable ones: the first follower's motion could be fitted",
    "planned": "the local optimum has a plan (fixed end speed, accounting “equal”)",
    "tracked": "that plan could be driven by the controller",
    "reported": "has a page",
}


def _further_rows(crossings: pd.DataFrame, further: Further) -> Iterator[tuple[str | int, ...]]:
    """How far the usable ones got."""
    classes = crossings[crossings["usable"]].set_index("event_id")["ego_class"]
    for word, ids in further.items():
        counts = [int((classes[classes.index.isin(ids)] == kind).sum()) for kind in names.CLASSES]
        yield (word, _FURTHER[word], *counts, sum(counts))


def _funnel_row(reason: str, counts: list[int]) -> tuple[str | int, ...]:
    meaning = labels.REASONS.get(reason, "an event with a page")
    return (reason.replace("_", " ") or "usable", meaning, *counts, sum(counts))
