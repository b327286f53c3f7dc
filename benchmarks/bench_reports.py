"""Speed and size of the report: pages and pictures an event, the index of thousands, memory over many pages.

    python benchmarks/bench_reports.py

Makes a small synthetic run first (a minute). Times are CPU times of one process; ratios are against a fresh
matplotlib figure of the same event, drawn in the same run. The browser's part is left out where there is none.
"""

import io
import resource
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from highd_lc import engine
from highd_lc.reporting.event import EventReport
from highd_lc.reporting.figures_event import EventPainter, event_figure
from highd_lc.reporting.pages_event import Links, event_page
from highd_lc.reporting.pages_index import index_page
from highd_lc.stages.event_report import event_report, read_tables
from highd_lc.stages.scenes import scene_makers
from highd_lc.vocab.job import Job, Options, Provenance
from highd_lc.vocab.settings import (
    CalibrateSettings,
    PlannerSettings,
    Settings,
    StudySettings,
    SyntheticSettings,
    ValidateSettings,
)

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "reporting"))
from sample_run import sample_run

EVENTS_OF_HIGHD = 8400
PAGES = 400
SETTINGS = Settings(
    synthetic=SyntheticSettings(recordings=1, seconds=120.0),
    calibrate=CalibrateSettings(optimiser="screen"),
    validate=ValidateSettings(
        planner=PlannerSettings(start="none"), studies=StudySettings(sample=0, solver_sample=0, start_sample=0)
    ),
)


def cpu(work: Callable[[], object], runs: int) -> float:
    """CPU time of one run [s], mean over runs after one that warms up."""
    work()
    start = time.process_time()
    for _ in range(runs):
        work()
    return (time.process_time() - start) / runs


def make_run(folder: Path) -> Job:
    """Artefacts up to validate, and the job whose report is measured."""
    work = folder / "work"
    options = Options(None, work, folder / "reports", workers=1)
    engine.run(SETTINGS, options, last="validate", console=Console(quiet=True))
    return Job(1, work / "synthetic", work, SETTINGS, Provenance("", {}, 1, ""))


def reports_of(job: Job) -> list[EventReport]:
    """The reports of a recording's events: tables, scenes, replays, loss surface, fits, tracking."""
    tables = read_tables(job)
    validation = job.settings.validation
    scenes = (make() for _, make in scene_makers(tables.scenes, validation))
    return [event_report(e, tables, s, validation) for e, s in zip(tables.events, scenes, strict=True)]


def peak_memory_mb() -> float:
    """Largest resident memory of this process so far [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def time_events(job: Job) -> None:
    """Print the cost of an event's page and picture, and the memory over many."""
    reports = reports_of(job)
    painter = EventPainter()
    gather = cpu(lambda: reports_of(job), 3) / len(reports)
    render = cpu(lambda: [event_page(r, Links()) for r in reports], 3) / len(reports)
    paint = cpu(lambda: [painter.png(r) for r in reports], 3) / len(reports)
    fresh = cpu(lambda: [event_figure(r).savefig(io.BytesIO(), format="png") for r in reports[:5]], 2) / 5
    sizes = [len(event_page(r, Links()).encode()) for r in reports]
    print(f"events measured                   {len(reports):8d}")
    print(f"gather an event                   {1e3 * gather:8.2f} ms")
    print(f"render its page                   {1e3 * render:8.2f} ms, {max(sizes) / 1e3:.0f} kB the largest")
    print(f"paint its picture                 {1e3 * paint:8.2f} ms, fresh figure {fresh / paint:.1f} x as long")
    pages, pictures = (EVENTS_OF_HIGHD * cost / 2 for cost in (gather + render, paint))
    print(
        f"{EVENTS_OF_HIGHD} pages on two cores          {pages:8.1f} s; with all pictures {pages + pictures:.1f} s"
    )
    before = peak_memory_mb()
    for k in range(PAGES):
        report = replace(reports[k % len(reports)])
        event_page(report, Links())
        painter.png(report)
    print(f"peak memory before and after {PAGES} more: {before:.0f} MB, {peak_memory_mb():.0f} MB")


def time_index(folder: Path) -> None:
    """Print size of the index of all of HighD, and how long a browser takes to show it from disk."""
    run = sample_run(EVENTS_OF_HIGHD)
    start = time.process_time()
    text = index_page(run)
    seconds = time.process_time() - start
    print(f"make the index of {EVENTS_OF_HIGHD} events     {seconds:8.2f} s, {len(text.encode()) / 1e6:.2f} MB")
    path = folder / "index.html"
    path.write_text(text, encoding="utf-8")
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if chromium is None:
        print("load it in a browser                   no Chromium here")
        return
    load, scroll = browse(path, chromium)
    print(f"load it in Chromium               {load:8.2f} s; longest frame while scrolling {1e3 * scroll:.0f} ms")


def browse(path: Path, chromium: str) -> tuple[float, float]:
    """Seconds from navigation to the first rows, and the longest frame of a scroll through all of them."""
    from playwright.sync_api import sync_playwright

    frames = """async () => {
        const frame = document.getElementById('events');
        let longest = 0, before = performance.now();
        for (let k = 1; k <= 120; k++) {
            frame.scrollTop = (frame.scrollHeight / 120) * k;
            await new Promise(requestAnimationFrame);
            const now = performance.now();
            longest = Math.max(longest, now - before);
            before = now;
        }
        return longest / 1000;
    }"""
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page()
        start = time.perf_counter()
        page.goto(path.as_uri())
        page.wait_for_selector("#events tbody a")
        load = time.perf_counter() - start
        longest = page.evaluate(frames)
        browser.close()
    return load, longest


def main() -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        time_events(make_run(folder))
        time_index(folder)


if __name__ == "__main__":
    main()
