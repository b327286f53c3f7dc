"""``highd-lc report``: which pictures --top, --png and --event leave, and what --open opens."""

import re
from pathlib import Path

import pytest
from shared_runs import copied
from typer.testing import CliRunner

from highd_lc import cli
from highd_lc.io import artefacts
from highd_lc.stages import report
from highd_lc.vocab import names
from highd_lc.vocab.errors import UsageError
from highd_lc.vocab.settings import Settings


@pytest.fixture
def command(pipeline_run, tmp_path, monkeypatch, made_once_pages):
    """The command on a copy of a finished run; what it was asked to open is in ``opened``."""
    copied(pipeline_run, tmp_path)
    run = cli_on(pipeline_run, tmp_path, monkeypatch)
    run.opened = []
    monkeypatch.setattr(cli.typer, "launch", run.opened.append)
    return run


def cli_on(pipeline_run, root: Path, monkeypatch):
    """``highd-lc report`` with the settings of a run, on the folders below ``root``."""
    monkeypatch.setattr(cli, "_settings", lambda *_: pipeline_run.settings)
    folders = ["--data", pipeline_run.data, "--work", root / "work", "--reports", root / "reports"]

    def run(*options: str) -> Path:
        arguments = ["report", *map(str, folders), "--workers", "1", *options]
        CliRunner().invoke(cli.app, arguments, catch_exceptions=False)
        return root / "reports"

    return run


@pytest.fixture
def asked_for(pipeline_run, tmp_path, monkeypatch):
    """The pictures that options of the command ask for on a finished run, None = all; nothing is made."""
    run, asked = cli_on(pipeline_run, tmp_path, monkeypatch), []

    def choose(stage: str, settings: Settings, *_: object, **__: object) -> None:
        asked.append(report.choose(pipeline_run.work, settings.report, reports=tmp_path).pictures)

    monkeypatch.setattr(cli, "_go", choose)

    def pictures(*options: str) -> frozenset[str] | None:
        run(*options)
        return asked.pop()

    return pictures


def ranked(work: Path) -> list[str]:
    """Events by how far their gain is from zero, farthest first."""
    losses = artefacts.read(work, "losses").query("accounting == 'equal' and followers == 'population'")
    wide = losses.pivot_table(index="event_id", columns="policy", values="loss_total")
    gain = 1.0 - wide[names.LOCAL_OPTIMUM] / wide[names.BENCHMARK]
    return gain.abs().dropna().sort_values(ascending=False, kind="stable").index.tolist()


def drawn(reports: Path) -> set[str]:
    """Events with a PNG; a page links it if and only if it is there."""
    pictures = {path.stem for path in (reports / "events").glob("*.png")}
    linked = {p.stem for p in (reports / "events").glob("*.html") if f'href="{p.stem}.png"' in p.read_text()}
    assert linked == pictures
    return pictures


def test_top_alone_draws_only_these_and_the_next_run_all_again(pipeline_run, command):
    events = set(artefacts.read(pipeline_run.work, "events")["event_id"])
    order = ranked(pipeline_run.work)
    assert len(order) > 2
    assert drawn(pipeline_run.reports) == events
    reports = command("--top", "2")
    assert drawn(reports) == set(order[:2])
    assert {path.stem for path in (reports / "events").glob("*.html")} == events
    assert drawn(command()) == events


def test_top_says_how_many_where_png_says_top_and_nothing_else(pipeline_run, asked_for):
    assert asked_for("--png", "top", "--top", "1") == set(ranked(pipeline_run.work)[:1])
    assert asked_for("--png", "none", "--top", "1") == set()
    assert asked_for("--png", "all", "--top", "1") is None


def test_more_top_events_than_there_are_draws_those_with_a_gain(pipeline_run, asked_for):
    assert asked_for("--top", "500") == set(ranked(pipeline_run.work))


def test_beyond_500_events_the_top_ones_are_drawn(pipeline_run, tmp_path, monkeypatch):
    monkeypatch.setattr(report, "_MOST_AUTOMATIC", 2)
    settings = pipeline_run.settings.report.model_copy(update={"top": 1})
    request = report.choose(pipeline_run.work, settings, reports=tmp_path)
    assert request.pictures == {ranked(pipeline_run.work)[0]}


def test_one_event_gets_its_picture_whether_top_or_not(pipeline_run, command):
    last = ranked(pipeline_run.work)[-1]
    reports = command("--png", "none")
    assert drawn(reports) == set()
    command("--event", last, "--top", "1", "--open")
    assert drawn(reports) == {last}
    assert command.opened == [str((reports / "events" / f"{last}.html").resolve())]


def test_one_event_costs_its_recording_alone(pipeline_run, command):
    events = artefacts.read(pipeline_run.work, "events")
    chosen = events.iloc[0]
    others = events.loc[events["recording_id"] != chosen["recording_id"], "event_id"].tolist()
    assert others
    reports = command()

    def times() -> dict[str, int]:
        return {event: (reports / "events" / f"{event}.html").stat().st_mtime_ns for event in others}

    before = times()
    command("--event", chosen["event_id"])
    command()
    assert times() == before
    page = (reports / "events" / f"{chosen['event_id']}.html").read_text(encoding="utf-8")
    assert ('rel="next"' in page) == (sum(events["recording_id"] == chosen["recording_id"]) > 1)


def test_open_opens_what_was_made_and_nothing_after_a_mistake(command):
    reports = command("--open")
    assert command.opened == [str((reports / "index.html").resolve())]
    with pytest.raises(UsageError, match="99-0000-00000"):
        command("--open", "--event", "99-0000-00000")
    assert len(command.opened) == 1


@pytest.mark.parametrize("options", [("--top", "0"), ("--png", "some")])
def test_what_cannot_be_drawn_is_refused(options):
    result = CliRunner().invoke(cli.app, ["report", *options])
    assert result.exit_code != 0


def test_help_says_which_events_are_top_and_what_happens_to_the_others():
    said = CliRunner().invoke(cli.app, ["report", "--help"], env={"COLUMNS": "200", "TERM": "dumb"}).output
    said = re.sub(r"[\s│]+", " ", said)
    assert "farthest from 0, either way (fixed end speed, accounting equal)" in said
    assert "alone it means --png top; the next run without it draws the others again" in said
    assert "auto: all up to 500 events, else top; others' PNGs of earlier runs are removed" in said
