"""Report and scenarios lead to each other, whichever was made first; nothing leads to what is not there."""

import io
import re
import shutil
from pathlib import Path

import pytest
from rich.console import Console
from shared_runs import copied

from highd_lc import engine
from highd_lc.reporting.html import PAGES
from highd_lc.reporting.pages_scenarios import PAGES as SCENARIO_PAGES
from highd_lc.reporting.pages_scenarios import scenario_page
from highd_lc.stages.overview_pages import link_to_scenarios, missing_pages


def links(page: Path) -> set[str]:
    return set(re.findall(r' href="(?!data:)([^"#]+)', page.read_text(encoding="utf-8")))


def dead(reports: Path) -> list[tuple[str, str]]:
    pages = reports.rglob("*.html")
    return [(page.name, link) for page in pages for link in links(page) if not (page.parent / link).is_file()]


def make_scenarios(reports: Path) -> None:
    """What the scenarios' stage leaves beside a report, without what it simulates."""
    folder = reports / "scenarios"
    folder.mkdir(parents=True, exist_ok=True)
    back = (reports / "index.html").is_file()
    for name, title in SCENARIO_PAGES:
        (folder / name).write_text(scenario_page(name, title, [], lead=[], back=back), encoding="utf-8")
    link_to_scenarios(folder)


@pytest.fixture
def make_report(quick_run, made_once_pages, tmp_path):
    """Bring a copy of a finished run up to date, into its folder of reports, where there is nothing yet."""
    options = copied(quick_run, tmp_path, reports=False)

    def make() -> Path:
        engine.run(quick_run.settings, options, last="report", console=Console(file=io.StringIO()))
        return options.reports

    return make


def pages_of(reports: Path) -> list[str]:
    """The pages that the report of the work folder beside it has."""
    return [name for name, _ in PAGES if name not in missing_pages(reports.parent / "work")]


def every_page_is_linked(reports: Path) -> bool:
    there = all("scenarios/index.html" in links(reports / name) for name in pages_of(reports))
    return there and all("../index.html" in links(reports / "scenarios" / name) for name, _ in SCENARIO_PAGES)


def contents(reports: Path) -> dict[str, bytes]:
    return {str(p.relative_to(reports)): p.read_bytes() for p in reports.rglob("*.html")}


def test_the_order_of_report_and_scenarios_does_not_matter(make_report):
    reports = make_report()
    alone = contents(reports)
    assert not any("scenarios/index.html" in links(reports / name) for name in pages_of(reports))
    make_scenarios(reports)
    assert every_page_is_linked(reports)
    scenarios_last = contents(reports)

    shutil.rmtree(reports / "scenarios")
    assert contents(make_report()) == alone
    for name in pages_of(reports):
        (reports / name).unlink()
    make_scenarios(reports)
    assert dead(reports / "scenarios") == []
    assert every_page_is_linked(make_report())
    assert contents(reports) == scenarios_last
    assert dead(reports) == []


def test_scenarios_that_come_and_go_cost_no_page_of_an_event(make_report):
    reports = make_report()
    before = {path: path.stat().st_mtime_ns for path in (reports / "events").iterdir()}
    folder = reports / "scenarios"
    folder.mkdir()
    (folder / "index.html").write_text("made by hand, knows nothing of the report")
    assert "scenarios/index.html" in links(make_report() / "summary.html")
    shutil.rmtree(folder)
    assert "scenarios/index.html" not in links(make_report() / "summary.html")
    assert {path: path.stat().st_mtime_ns for path in (reports / "events").iterdir()} == before


def test_scenarios_elsewhere_leave_what_lies_above_alone(tmp_path):
    page = scenario_page("index.html", "A page", [], lead=[], back=False)
    (tmp_path / "index.html").write_text("<!-- room for scenarios/index.html -->")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "index.html").write_text(page)
    link_to_scenarios(tmp_path / "elsewhere")
    assert links(tmp_path / "index.html") == set()
    assert dead(tmp_path) == [("index.html", "ledger.html")]
