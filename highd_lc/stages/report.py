"""Report: a page and a picture of each event, then the pages of the whole run.

Python's search for cycles of garbage, put off while thousands of objects are made that are none.
"""

import gc
import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from highd_lc.io import artefacts, atomic
from highd_lc.reporting import html
from highd_lc.reporting.animation import ANIMATION, event_gif
from highd_lc.reporting.event import EventReport
from highd_lc.reporting.figures_event import VECTOR_FORMATS, EventPainter, event_vector
from highd_lc.reporting.html import TO_SCENARIOS
from highd_lc.reporting.pages_event import Links, event_page, failed_page
from highd_lc.reporting.pages_index import SPARK_SECONDS
from highd_lc.stages.event_report import event_report, read_tables
from highd_lc.stages.overview_pages import (
    OVERVIEW_PAGES,
    Overview,
    has_scenarios,
    link_to_report,
    missing_pages,
    page_of,
)
from highd_lc.stages.scenes import scene_makers
from highd_lc.vocab import names
from highd_lc.vocab.errors import StorageError, UsageError, told
from highd_lc.vocab.job import CarryOut, Combination, Job, JobReport, Problem, ReportRequest, one_by_one
from highd_lc.vocab.policy import PAIRS
from highd_lc.vocab.settings import ReportSettings, ValidateSettings
from highd_lc.vocab.tables import TABLES


@contextmanager
def put_off() -> Iterator[None]:
    """No search inside the ``with``; afterwards one, of what was made inside alone.

    For work that makes many objects and hardly a cycle: what nobody refers to any more is freed at once all the
    same. A search takes its time of every table that is held, again and again: a tenth of all time of a page.
    """
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        gc.collect(0)
        if was_on:
            gc.enable()


STAGE = "report"
_EVENT_ID = re.compile(r"\d{2,}-\d{4,}-\d{5,}")
_KINDS = ("png", *VECTOR_FORMATS, ANIMATION)
_MOST_AUTOMATIC = 500
"""Up to this many events, ``png = "auto"`` draws all of them."""


def refuse_senseless(events: tuple[str, ...], vector: tuple[str, ...]) -> None:
    """Raises UsageError if an event's id is none, or a format is not among the vector formats."""
    for kind in vector:
        if kind not in VECTOR_FORMATS and not (events and kind == ANIMATION):
            raise UsageError(f"vector {kind!r}: choose from {', '.join(VECTOR_FORMATS)}")
    for event in events:
        if not _EVENT_ID.fullmatch(event):
            raise UsageError(f"event {event!r}: an id is RR-VVVV-FFFFF: recording, ego, crossing frame")


def known_events(work: Path, events: tuple[str, ...]) -> pd.DataFrame:
    """Ids and recordings of the usable events. Raises UsageError if one asked for is not among them."""
    known = artefacts.read(work, "events", columns=["event_id", "recording_id"])
    unknown = sorted(set(events) - set(known["event_id"]))
    if unknown:
        text = f"not among the {len(known)} usable events of {work}, which `highd-lc list` shows"
        raise UsageError(f"event {unknown[0]!r}: {text}")
    return known


def choose(
    work: Path,
    settings: ReportSettings,
    *,
    reports: Path,
    model: str = ValidateSettings().follower_models[0],
    events: tuple[str, ...] = (),
    vector: tuple[str, ...] = (),
) -> ReportRequest:
    """What to make: pages of the events named (none named: all), and pictures as the settings ask.

    model: the default follower model; vector: further formats of the pictures, "pdf" or "svg". Raises UsageError
    if an event is not among the usable ones, or a format is another.
    """
    refuse_senseless(events, vector)
    of_event = known_events(work, events)
    known = of_event["event_id"]
    wanted = frozenset(events) if events else None
    recordings = frozenset(of_event.loc[known.isin(events), "recording_id"].tolist()) if events else None
    if settings.png == "none":
        return ReportRequest(reports, wanted, frozenset(), vector, recordings)
    every = settings.png == "all" or (settings.png == "auto" and len(known) <= _MOST_AUTOMATIC)
    pictures = wanted if events else None if every else top_events(work, settings.top, model)
    return ReportRequest(reports, wanted, pictures, vector, recordings)


def top_events(work: Path, count: int, model: str) -> frozenset[str]:
    """The events on which local optimum and benchmark differ most, in either direction (primary cell).

    model: the follower model that planned.
    """
    columns = ["event_id", "followers", "policy", "accounting", "loss_total"]
    losses = artefacts.read(work, "losses", columns=columns)
    losses = losses[losses["followers"] == model]
    primary = losses[losses["accounting"] == names.PRIMARY_ACCOUNTING]
    benchmark, local = (
        primary[primary["policy"] == policy].set_index("event_id")["loss_total"] for policy in PAIRS[names.FIXED]
    )
    difference = (1.0 - local / benchmark).abs().dropna().sort_index()
    return frozenset(difference.nlargest(count).index)


def run(job: Job, *, request: ReportRequest) -> JobReport:
    """Make the pages and pictures of a recording's events, and the part ``event_pages`` that the index draws."""
    problems: list[Problem] = []
    with put_off():
        rows = list(_event_pages(job, request, problems))
    if request.events is None:
        frame = pd.DataFrame(rows, columns=list(TABLES["event_pages"].column_names))
        artefacts.write_part(job, STAGE, "event_pages", frame)
    counts = {"pages": len(rows), "pictures": sum(row["png"] for row in rows)}
    return JobReport(counts, tuple(problems))


def _event_pages(job: Job, request: ReportRequest, problems: list[Problem]) -> Iterator[dict[str, Any]]:
    """Write the pages and pictures of a recording's events; yields the row of ``event_pages`` of each.

    An event whose motions cannot be drawn gets a page that says why, and a problem.
    """
    tables, missing = read_tables(job), missing_pages(job.work)
    ids = [str(event["event_id"]) for event in tables.events]
    scenes = scene_makers(tables.scenes, job.settings.validation)
    for k, (event, (_, scene_of)) in enumerate(zip(tables.events, scenes, strict=True)):
        if request.events is None or event["event_id"] in request.events:
            links = _links(ids, k, request)
            try:
                report = event_report(event, tables, scene_of(), job.settings.validation)
                page = html.without(event_page(report, links, raw=job.settings.report.raw), missing)
                _write_event(report, links, page, request=request)
                yield _page_row(report, job, links)
            except StorageError:
                raise
            except Exception as error:
                problems.append(Problem(job.recording, STAGE, told(ids[k], error)))
                _write_failed(ids[k], problems[-1].message, links, request.reports)


def _links(ids: list[str], k: int, request: ReportRequest) -> Links:
    """What the page of the k-th of a recording's events links to."""
    picture = request.pictures is None or ids[k] in request.pictures
    return Links(
        previous=ids[k - 1] if k > 0 and request.events is None else None,
        next=ids[k + 1] if k + 1 < len(ids) and request.events is None else None,
        png=picture,
        vector=tuple(kind for kind in request.vector if picture or kind == ANIMATION),
    )


@cache
def _painter() -> EventPainter:
    """One painter a process: its painted backgrounds serve all recordings."""
    return EventPainter()


def _write_event(report: EventReport, links: Links, page: str, *, request: ReportRequest) -> None:
    """Write the page and the pictures asked for; pictures of an earlier run that are not are removed."""
    base = request.reports / "events" / report.event_id
    _write(base.with_suffix(".html"), page.encode("utf-8"))
    if links.png:
        _write(base.with_suffix(".png"), _painter().png(report))
    for kind in links.vector:
        drawn = event_gif(report) if kind == ANIMATION else event_vector(report, kind)
        _write(base.with_suffix(f".{kind}"), drawn)
    made = {*links.vector, "png" if links.png else ""}
    for kind in set(_KINDS) - made:
        base.with_suffix(f".{kind}").unlink(missing_ok=True)


def _write_failed(event_id: str, why: str, links: Links, reports: Path) -> None:
    """Write the page of an event that cannot be shown, for the index and its neighbours link to it."""
    page = failed_page(event_id, why, links)
    _write(reports / "events" / f"{event_id}.html", page.encode("utf-8"))


def _page_row(report: EventReport, job: Job, links: Links) -> dict[str, Any]:
    return {
        "event_id": report.event_id,
        "recording_id": job.recording,
        "png": links.png,
        "hv1_speed_benchmark": _spark(report, names.BENCHMARK),
        "hv1_speed_local": _spark(report, names.LOCAL_OPTIMUM),
        **_first_follower(report),
    }


def _first_follower(report: EventReport) -> dict[str, float]:
    play = next((play for play in report.plays if play.followers), None)
    if play is None:
        return {"hv1_spacing_m": float("nan"), "hv1_speed_difference_mps": float("nan")}
    first, boxes = play.followers[0], report.boxes
    half = (boxes[names.EGO].length - boxes[names.target_follower(1)].length) / 2.0
    return {
        "hv1_spacing_m": float(play.ego.x[0] - first.x[0] + half),
        "hv1_speed_difference_mps": float(first.v[0] - report.v0),
    }


def _spark(report: EventReport, policy: str) -> list[float]:
    play = report.play(policy)
    if play is None or not play.followers:
        return []
    times = np.arange(SPARK_SECONDS + 1) / report.dt
    samples = np.rint(times[times < play.followers[0].v.size]).astype(int)
    return [round(float(v), 2) for v in play.followers[0].v[samples]]


def combine(combination: Combination, *, request: ReportRequest, carry_out: CarryOut = one_by_one) -> JobReport:
    """Make the index and the overview pages from the finished artefacts of the whole run.

    Pages of single events leave them as they are. Scenarios beside the report are linked, there and back.
    carry_out: makes the pages, side by side where it can.
    """
    if request.events is not None:
        return JobReport()
    work, raw, settings = combination.work, combination.settings.report.raw, combination.settings.validation
    artefacts.concatenate(work, STAGE, "event_pages", combination.recordings, combination.provenance)
    model, b_max = settings.follower_models[0], settings.followers.b_max
    overview = Overview(work, raw, settings.statistics, b_max, model, settings.loss.omega_av)
    missing = missing_pages(work)
    wanted = [name for name in OVERVIEW_PAGES if name not in missing]
    pages = dict(zip(wanted, carry_out([partial(page_of, name, overview) for name in wanted]), strict=True))
    scenarios = has_scenarios(request.reports)
    for name, page in pages.items():
        _write(request.reports / name, TO_SCENARIOS.opened(page) if scenarios else page)
    for name in missing:
        (request.reports / name).unlink(missing_ok=True)
    link_to_report(request.reports)
    _remove_stale(
        request.reports / "events", set(artefacts.read(work, "events", columns=["event_id"])["event_id"])
    )
    return JobReport({"overview_pages": len(pages)})


def neighbours(reports: Path) -> list[str]:
    """What the overview pages depend on beside artefacts: whether there are scenarios to link."""
    return ["scenarios"] if has_scenarios(reports) else []


def _remove_stale(folder: Path, events: set[str]) -> None:
    """Remove pages and pictures of events that the run no longer has; nothing else is touched."""
    for path in folder.glob("*.*") if folder.is_dir() else ():
        kind = path.suffix.lstrip(".") in {"html", *_KINDS}
        if kind and _EVENT_ID.fullmatch(path.stem) and path.stem not in events:
            path.unlink()


def _write(path: Path, data: bytes) -> None:
    """Write a page or picture, whole or not at all."""
    atomic.write_bytes(path, data, durable=False)
