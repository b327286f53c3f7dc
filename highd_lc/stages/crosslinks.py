"""Report and scenarios in one folder: which of them is there, and the links between finished pages."""

from pathlib import Path
from typing import Final

from highd_lc.io.atomic import whole_file
from highd_lc.reporting import html, pages_scenarios
from highd_lc.reporting.html import TO_REPORT, TO_SCENARIOS, Crosslink

_SCENARIOS: Final = "scenarios"


def has_scenarios(reports: Path) -> bool:
    """Whether the scenarios' pages lie where the report's link leads."""
    return (reports / TO_SCENARIOS.href).is_file()


def link_to_scenarios(scenarios: Path) -> None:
    """Let the report above the scenarios' folder lead to them, if there is one and its link does."""
    if scenarios.resolve().name == _SCENARIOS:
        _open(scenarios.resolve().parent, html.PAGES, TO_SCENARIOS)


def link_to_report(reports: Path) -> None:
    """Let the scenarios' pages below a report's folder lead to it, if there are any."""
    _open(reports / _SCENARIOS, pages_scenarios.PAGES, TO_REPORT)


def _open(folder: Path, pages: tuple[tuple[str, str], ...], crosslink: Crosslink) -> None:
    # Not by io.atomic: its ledger would make the pages of the one command results of the other.
    for path in (folder / name for name, _ in pages):
        before = path.read_bytes() if path.is_file() else b""
        after = crosslink.opened(before)
        if after != before:
            with whole_file(path) as sink:
                sink.write(after)
