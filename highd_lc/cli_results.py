"""What a command ends with: counts, tables, problems and the page, as text or as JSON."""

from pathlib import Path
from typing import Any

import typer

from highd_lc.cli_console import console, errors
from highd_lc.vocab.job import Options, Outcome, Problem

_TABLES_OF = {
    "calibrate": ("summary_lcm", "prediction_summary"),
    "validate": ("prediction_summary", "validation_matrix", "leaderboard"),
    "report": ("prediction_summary", "validation_matrix", "leaderboard"),
}
"""The tables whose numbers a command ends with."""


def page(options: Options) -> Path:
    """What to look at first: the page of the event asked for, else the index."""
    first = f"events/{options.events[0]}.html" if options.events else "index.html"
    return (options.reports / first).resolve()


def print_results(outcome: Outcome, options: Options, model: str) -> None:
    """Print what the last stage of a run found. model: the follower model that plans."""
    stage = _last(outcome)
    _print_confirmed(outcome)
    if stage == "calibrate":
        _print_fits(options.work)
    if stage in ("validate", "report"):
        _print_gains(options.work, model)
    if stage == "report":
        console.print(f"report: {page(options)}", soft_wrap=True)


def _last(outcome: Outcome) -> str:
    """The stage that a run ended with; the multiverse belongs to validate."""
    return [stage for stage in outcome.counts if stage != "multiverse"][-1]


def _print_confirmed(outcome: Outcome) -> None:
    counts = outcome.counts.get("extract", {})
    if n_events := counts.get("events"):
        confirmed = counts["roles_confirmed"]
        text = f"roles confirmed by the recorded leader ids: {confirmed} of {n_events} events"
        console.print(f"{text} ({confirmed / n_events:.1%})", soft_wrap=True, highlight=False)


def _print_fits(work: Path) -> None:
    from highd_lc.io import artefacts
    from highd_lc.reporting.terminal import aims_table, lcm_table, prediction_lines, prediction_table
    from highd_lc.stages.prediction_tables import is_judged

    console.print(lcm_table(artefacts.read(work, "summary_lcm")))
    if is_judged(work):
        summary = artefacts.read(work, "prediction_summary")
        console.print(prediction_table(summary))
        lines = prediction_lines(summary, artefacts.read(work, "dose_response"))
        console.print(*lines, sep="\n", markup=False, highlight=False)
        console.print(aims_table(artefacts.read(work, "prediction_aims")))


def _print_gains(work: Path, model: str) -> None:
    from highd_lc.io import artefacts
    from highd_lc.reporting.terminal import leaderboard_table, matrix_table, price_words
    from highd_lc.stages.prediction_tables import followers_believed

    console.print(*followers_believed(work, model), sep="\n", markup=False, highlight=False)
    console.print(matrix_table(artefacts.read(work, "validation_matrix")))
    board = artefacts.read(work, "leaderboard")
    if len(board):
        console.print(leaderboard_table(board))
    console.print(price_words(artefacts.read(work, "safety_price")))


def results(outcome: Outcome, options: Options) -> dict[str, Any]:
    """What a command ends with, as values: counts, problems, the tables it prints, the page."""
    from highd_lc.io import artefacts
    from highd_lc.io.event_description import records

    stage = _last(outcome)
    told = [{"recording": p.recording, "stage": p.stage, "warning": p.warning} for p in outcome.problems]
    problems = [about | {"message": p.message} for about, p in zip(told, outcome.problems, strict=True)]
    tables = {name: records(artefacts.read(options.work, name)) for name in _TABLES_OF.get(stage, ())}
    where = {"report": str(page(options))} if stage == "report" else {}
    return {"counts": outcome.counts, "problems": problems, **tables, **where}


def preview_lines(rows: list[dict[str, Any]]) -> list[str]:
    """What a run would do, in words. rows: of ``engine.preview``."""
    lines = [f"{row['stage']}: {_forecast(row)}" for row in rows]
    return [*lines, "nothing was run, and nothing written"]


def _forecast(row: dict[str, Any]) -> str:
    if row["to_do"] is None:
        return "known once the stages before it are done"
    if row["to_do"]:
        return f"{row['to_do']} of {row['recordings']} recordings to do"
    return "tables to put together" if row["combines"] else "up to date"


def list_problems(problems: list[Problem]) -> None:
    """Print problems on the standard error, a line each."""
    for problem in problems:
        errors.print(f"{'warning: ' * problem.warning}{problem.stage}: {problem.message}", markup=False)


def end_with_problems(outcome: Outcome) -> None:
    """List the problems; exit code 4 if anything was skipped."""
    list_problems(outcome.problems)
    if any(not problem.warning for problem in outcome.problems):
        raise typer.Exit(4)
