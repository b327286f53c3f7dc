"""What the command line says before any stage runs."""

import json
import shutil
import sys
from importlib.metadata import version
from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner

from highd_lc import cli, cli_results, engine
from highd_lc.io import artefacts
from highd_lc.vocab.job import Options, Outcome

FIXTURES = Path(__file__).parents[1] / "fixtures"


def test_version_is_told():
    found = CliRunner().invoke(cli.app, ["--version"])
    assert (found.exit_code, found.stdout) == (0, f"highd-lc {version('highd-lc')}\n")


@pytest.mark.parametrize(
    "names", [(), (".DS_Store",), (".gitkeep", "README.md"), ("readme.txt", "Thumbs.db"), (".a/",)]
)
def test_a_folder_that_holds_nothing_of_somebody_s_counts_as_empty(tmp_path, monkeypatch, names):
    monkeypatch.chdir(tmp_path)
    Path("data/highd").mkdir(parents=True)
    for name in names:
        (Path("data/highd") / name).touch()
    assert cli._data(None) is None


@pytest.mark.parametrize("name", ["01_tracks.csv", "highD-dataset-v1.0", "notes.txt"])
def test_a_folder_that_holds_anything_else_is_used(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    Path("data/highd").mkdir(parents=True)
    (Path("data/highd") / name).touch()
    assert cli._data(None) == Path("data/highd")


def ended(monkeypatch, capsys, *arguments: object) -> tuple[int, str]:
    """Exit code of the whole command and what it said on the standard error."""
    monkeypatch.setattr(sys, "argv", ["highd-lc", *map(str, arguments)])
    with pytest.raises(SystemExit) as end:
        cli.main()
    return end.value.code, capsys.readouterr().err


@pytest.mark.parametrize("arguments", [("--debug", "run"), ("run", "--debug"), ("run", "--verify", "--debug")])
def test_tracebacks_are_shown_on_request_wherever_it_stands(monkeypatch, capsys, arguments):
    code, said = ended(monkeypatch, capsys, *arguments, "--pipeline", "nowhere")
    assert code == 2
    assert said.startswith("Traceback")
    assert "SettingsError" in said
    code, said = ended(monkeypatch, capsys, *(a for a in arguments if a != "--debug"), "--pipeline", "nowhere")
    assert (code, len(said.splitlines())) == (2, 1)


def test_a_name_that_looks_like_an_option_is_a_name(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    code, said = ended(monkeypatch, capsys, "show", "--", "--debug")
    assert code == 3
    assert "Traceback" not in said


def test_an_unexpected_error_is_one_line_too(monkeypatch, capsys):
    def broken(*_: object) -> None:
        raise ZeroDivisionError("nobody thought of this")

    monkeypatch.setattr(cli, "_settings", broken)
    code, said = ended(monkeypatch, capsys, "run")
    assert code == 1
    assert said.startswith("highd-lc: unexpected: ZeroDivisionError: nobody thought of this; --debug shows where")
    assert len(said.splitlines()) == 1


def test_what_the_file_system_refuses_is_named_with_its_path(monkeypatch, capsys, tmp_path):
    (tmp_path / "file").touch()
    code, said = ended(monkeypatch, capsys, "synthesize", tmp_path / "file" / "below", "--seconds", 5)
    assert (code, said) == (2, f"highd-lc: {tmp_path / 'file' / 'below'}: Not a directory\n")


def test_shipped_pipelines_are_named_by_help_and_completion():
    words = CliRunner().invoke(cli.app, ["run", "--help"], env={"COLUMNS": "300"}).output
    assert "demo, highd, paper_literal" in words
    assert "scenarios" not in words
    assert set(cli._shipped("recorder_")) == {"recorder_idm", "recorder_model", "recorder_population"}
    arguments = {
        "_HIGHD_LC_COMPLETE": "complete_bash",
        "COMP_WORDS": "highd-lc run --pipeline pap",
        "COMP_CWORD": "3",
    }
    assert CliRunner().invoke(cli.app, [], env=arguments, prog_name="highd-lc").output == "paper_literal\n"


@pytest.mark.parametrize(
    ("command", "wrong", "offered"),
    [
        ("run", "scenarios", "demo, highd, paper_literal, recorder_idm, recorder_model, recorder_population"),
        ("scenarios", "demo", "scenarios"),
    ],
)
def test_a_command_offers_the_pipelines_that_it_takes(monkeypatch, capsys, tmp_path, command, wrong, offered):
    monkeypatch.chdir(tmp_path)
    said = f"highd-lc: {wrong}: no such pipeline here; give a TOML file or one of: {offered}\n"
    assert ended(monkeypatch, capsys, command, "--pipeline", wrong) == (2, said)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("report", "--event", "WRONG"), "event 'WRONG': an id is RR-VVVV-FFFFF"),
        (("report", "--vector", "tiff"), "vector 'tiff': choose from pdf, svg"),
        (("report", "--png", "some"), "command line: report.png = 'some'"),
        (("run", "--format", "vhs"), "command line: ingest.format = 'vhs'"),
        (("run", "--planner", "nowhere:plan"), "nowhere"),
        (("run", "--pipeline", "nowhere"), "nowhere: no such pipeline"),
        (("run", "--data", "nowhere"), "nowhere: not a folder"),
        (("multiverse", "--reports", __file__), "cannot be used as the reports folder"),
        (("truth", "--reports", __file__), "cannot be used as the reports folder"),
    ],
)
def test_options_are_refused_before_any_stage_runs(monkeypatch, capsys, tmp_path, options, words):
    where = ("--work", tmp_path / "work") + (() if "--data" in options else ("--data", FIXTURES))
    code, said = ended(monkeypatch, capsys, *options, *where)
    assert code == 2, said
    assert words in said
    assert not (tmp_path / "work" / "run.log").exists()


def everything_below(folder: Path) -> dict[Path, int]:
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*")}


def preview(pipeline_run, work: Path, **report: object) -> dict[str, dict[str, object]]:
    settings = pipeline_run.settings.model_copy(
        update={"report": pipeline_run.settings.report.model_copy(update=report)}
    )
    options = Options(pipeline_run.data, work, pipeline_run.reports)
    return {row["stage"]: row for row in engine.preview(settings, options, last="report")}


def test_a_dry_run_says_what_would_run_and_writes_nothing(pipeline_run, tmp_path):
    before = everything_below(pipeline_run.work.parent)
    done = preview(pipeline_run, pipeline_run.work)
    assert [(row["to_do"], row["combines"]) for row in done.values()] == [(0, False)] * 6
    redrawn = preview(pipeline_run, pipeline_run.work, png="none")
    assert {name for name, row in redrawn.items() if row["to_do"]} == {"report"}
    assert everything_below(pipeline_run.work.parent) == before
    anew = preview(pipeline_run, tmp_path / "work")
    assert [row["to_do"] for row in anew.values()] == [2, 2, 2, 2, 2, None]
    assert not (tmp_path / "work").exists()


def test_a_dry_run_without_data_would_synthesize(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    found = CliRunner().invoke(cli.app, ["extract", "--dry-run", "--json"])
    rows = json.loads(found.stdout)["dry_run"]
    assert [row["stage"] for row in rows] == ["synthesize", "ingest", "extract"]
    words = CliRunner().invoke(cli.app, ["extract", "--dry-run"]).stdout.splitlines()
    assert words[-1] == "nothing was run, and nothing written"
    assert list(tmp_path.iterdir()) == []


def test_what_goes_wrong_is_in_the_log_with_its_traceback(tmp_path, monkeypatch, capsys):
    data = tmp_path / "data"
    data.mkdir()
    (data / "01_tracks.csv").write_text("nothing of the kind\n")
    for name in ("01_tracksMeta.csv", "01_recordingMeta.csv"):
        shutil.copy(FIXTURES / name, data)
    code, said = ended(monkeypatch, capsys, "ingest", "--data", data, "--work", tmp_path / "work", "--workers", 1)
    assert code == 3, said
    entries = [json.loads(line) for line in (tmp_path / "work" / "run.log").read_text().splitlines()]
    assert entries[0]["stage"] == "ingest"
    assert entries[0]["recording"] == 1
    assert entries[0]["traceback"].startswith("Traceback")
    assert entries[0]["error"].startswith("InputError: ")
    assert "Traceback" not in said


def test_validate_ends_with_its_own_tables_though_the_multiverse_comes_after_it(monkeypatch):
    outcome = Outcome(counts={"extract": {}, "validate": {}, "multiverse": {}})
    read = []
    monkeypatch.setattr(artefacts, "read", lambda work, name: read.append(name) or pd.DataFrame())
    found = cli_results.results(outcome, Options(None, Path("work"), Path("reports")))
    assert read == ["prediction_summary", "validation_matrix", "leaderboard"]
    assert found["validation_matrix"] == []
