"""The command line: parses, loads settings, calls the engine, prints. No logic of its own.

Commands import what they run themselves: what one of them does not need would cost it a second of start-up.
"""

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from highd_lc.cli_events import DEFAULT_WORK, Json, Work, add_commands, print_json
from highd_lc.io import settings as settings_file
from highd_lc.vocab.compile_cache import require_cache
from highd_lc.vocab.errors import HighdLcError, InterruptedRunError, StorageError, UsageError
from highd_lc.vocab.job import Options, Outcome, Problem
from highd_lc.vocab.settings import Settings


def open_closed_streams() -> None:
    """Give closed standard streams a place: the next file opened would get their number, and their text."""
    while (descriptor := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(descriptor, True)
    os.close(descriptor)
    sys.stdout = sys.stdout or open(1, "w", closefd=False)  # noqa: SIM115
    sys.stderr = sys.stderr or open(2, "w", closefd=False)  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # no test's stand-in has
            # A name that the encoding lacks, or that is none in any encoding, is shown by its codes.
            stream.reconfigure(errors="backslashreplace")


class PatientConsole(Console):
    """A console that survives a closed pipe: the rest of its text is dropped, work and exit code stay."""

    def on_broken_pipe(self) -> None:
        """Write to nowhere from here on."""
        self.quiet = True
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self.file.fileno())
        os.close(nowhere)


_HELP = "Calibrate and validate lane-change planning on HighD recordings."
app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False, help=_HELP)
# Without a terminal (make, CI, a log) the width is fixed, so that tables are not cut.
console = PatientConsole(width=None if sys.stdout and sys.stdout.isatty() else 100)
errors = PatientConsole(stderr=True, soft_wrap=True, highlight=False)

_HIGHD = Path("data/highd")

Pipeline = Annotated[str | None, typer.Option(help="pipeline: TOML file or shipped name")]
Data = Annotated[Path | None, typer.Option(help="folder of recordings; default data/highd, else synthetic")]
Format = Annotated[
    str | None, typer.Option("--format", metavar="highd|ngsim", help="of the recordings; default: by content")
]
Reports = Annotated[Path, typer.Option(help="folder of the pages")]
Workers = Annotated[int, typer.Option(min=1, max=256, help="local processes")]
Scheduler = Annotated[str | None, typer.Option(help="address of a Dask scheduler")]
Verify = Annotated[bool, typer.Option("--verify", help="hash all inputs instead of trusting size and time")]
Strict = Annotated[bool, typer.Option("--strict", help="stop at the first bad recording")]

Planners = Annotated[
    list[str] | None,
    typer.Option("--planner", metavar="module:function", help="a planner of others, beside ours (repeatable)"),
]

DEFAULT_REPORTS = Path("reports")


class _TerminatedError(KeyboardInterrupt):
    """SIGTERM. No ``except Exception`` on the way takes it for a fault of a recording."""


def _terminate(_signal: int, _frame: object) -> None:
    raise _TerminatedError


@contextmanager
def _signals_as_errors() -> Iterator[None]:
    """Turn SIGINT and SIGTERM into errors with a message and the shell's exit code."""
    before = signal.signal(signal.SIGTERM, _terminate)
    try:
        yield
    except KeyboardInterrupt as error:
        what, number = ("terminated", 15) if isinstance(error, _TerminatedError) else ("interrupted", 2)
        text = f"{what}; what was finished is kept: the same command continues from there"
        raise InterruptedRunError(text, 128 + number) from error
    finally:
        signal.signal(signal.SIGTERM, before)


def _go(
    stage: str | None, settings: Settings, options: Options, *, browser: bool = False, as_json: bool = False
) -> None:
    outcome = Outcome()
    try:
        with _signals_as_errors():
            from highd_lc import engine

            engine.run(settings, options, last=stage, console=errors if as_json else console, outcome=outcome)
    except HighdLcError as error:
        _list([problem for problem in outcome.problems if problem.message not in str(error)])
        raise
    if as_json:
        print_json(console, _results(list(outcome.counts)[-1], options, outcome))
    else:
        _print_confirmed(outcome)
        _print_results(list(outcome.counts)[-1], options, settings.validation.follower_models[0])
    if browser:
        typer.launch(str(_page(options)))
    _end_with_problems(outcome)


def _page(options: Options) -> Path:
    """What to look at first: the page of the event asked for, else the index."""
    first = f"events/{options.events[0]}.html" if options.events else "index.html"
    return (options.reports / first).resolve()


def _print_confirmed(outcome: Outcome) -> None:
    counts = outcome.counts.get("extract", {})
    if n_events := counts.get("events"):
        confirmed = counts["roles_confirmed"]
        text = f"roles confirmed by the recorded leader ids: {confirmed} of {n_events} events"
        console.print(f"{text} ({confirmed / n_events:.1%})", soft_wrap=True, highlight=False)


def _print_results(stage: str, options: Options, model: str) -> None:
    if stage not in _TABLES_OF:
        return
    from highd_lc.io import artefacts
    from highd_lc.reporting.terminal import (
        aims_table,
        lcm_table,
        leaderboard_table,
        matrix_table,
        prediction_lines,
        prediction_table,
        price_words,
    )
    from highd_lc.stages.prediction_tables import followers_believed, is_judged

    if stage == "calibrate":
        console.print(lcm_table(artefacts.read(options.work, "summary_lcm")))
        if is_judged(options.work):
            summary = artefacts.read(options.work, "prediction_summary")
            console.print(prediction_table(summary))
            lines = prediction_lines(summary, artefacts.read(options.work, "dose_response"))
            console.print(*lines, sep="\n", markup=False, highlight=False)
            console.print(aims_table(artefacts.read(options.work, "prediction_aims")))
    if stage in ("validate", "report"):
        console.print(*followers_believed(options.work, model), sep="\n", markup=False, highlight=False)
        console.print(matrix_table(artefacts.read(options.work, "validation_matrix")))
        board = artefacts.read(options.work, "leaderboard")
        if len(board):
            console.print(leaderboard_table(board))
        console.print(price_words(artefacts.read(options.work, "safety_price")))
    if stage == "report":
        console.print(f"report: {_page(options)}", soft_wrap=True)


_TABLES_OF = {
    "calibrate": ("summary_lcm", "prediction_summary"),
    "validate": ("prediction_summary", "validation_matrix", "leaderboard"),
    "report": ("prediction_summary", "validation_matrix", "leaderboard"),
}
"""The tables whose numbers a command ends with."""


def _results(stage: str, options: Options, outcome: Outcome) -> dict[str, Any]:
    """What a command ends with, as values: counts, problems, the tables it prints, the page."""
    from highd_lc.io import artefacts
    from highd_lc.io.event_description import records

    told = [{"recording": p.recording, "stage": p.stage, "warning": p.warning} for p in outcome.problems]
    problems = [about | {"message": p.message} for about, p in zip(told, outcome.problems, strict=True)]
    tables = {name: records(artefacts.read(options.work, name)) for name in _TABLES_OF.get(stage, ())}
    page = {"report": str(_page(options))} if stage == "report" else {}
    return {"counts": outcome.counts, "problems": problems, **tables, **page}


def _list(problems: list[Problem]) -> None:
    for problem in problems:
        errors.print(f"{'warning: ' * problem.warning}{problem.stage}: {problem.message}", markup=False)


def _end_with_problems(outcome: Outcome) -> None:
    _list(outcome.problems)
    if any(not problem.warning for problem in outcome.problems):
        raise typer.Exit(4)


def _settings(pipeline: str | None, data: Path | None, format_: str | None = None) -> Settings:
    found = settings_file.load(settings_file.find_pipeline(pipeline or ("demo" if data is None else "highd")))
    return found if format_ is None else settings_file.with_ingest(found, {"format": format_})


def _data(data: Path | None) -> Path | None:
    if data is not None and not data.is_dir():
        raise UsageError(f"{data}: not a folder; give the folder of the recordings' CSVs")
    return data or (_HIGHD if _HIGHD.is_dir() and any(map(_is_data, _HIGHD.iterdir())) else None)


def _is_data(path: Path) -> bool:
    """Whether a file is somebody's: neither hidden nor what a desktop or a repository leaves in a folder."""
    name = path.name.lower()
    return not (
        name.startswith((".", "__")) or name in ("thumbs.db", "desktop.ini") or path.stem.lower() == "readme"
    )


def _stage_command(name: str, text: str) -> None:
    def command(
        pipeline: Pipeline = None,
        data: Data = None,
        work: Work = DEFAULT_WORK,
        reports: Reports = DEFAULT_REPORTS,
        workers: Workers = 2,
        scheduler: Scheduler = None,
        verify: Verify = False,
        strict: Strict = False,
        format_: Format = None,
        planner: Planners = None,
        json_: Json = False,
    ) -> None:
        folder = _data(data)
        options = Options(folder, work, reports, workers, scheduler, verify, strict)
        settings = settings_file.with_planners(_settings(pipeline, folder, format_), planner or ())
        _go(None if name == "run" else name, settings, options, as_json=json_)

    app.command(name=name, help=text)(command)


_stage_command("ingest", "Read the CSVs into tracks.")
_stage_command("extract", "Find lane changes and their followers.")
_stage_command("calibrate", "Fit the LCM to every follower.")
_stage_command("validate", "Replay every event through planner and MPC.")
_stage_command("run", "All stages of the pipeline in order, skipping what is up to date.")


_EVENT = "make only this event's page, with its PNG unless --png none (repeatable)"
_PNG = (
    "which events get a PNG beside their page; auto: all up to 500 events, else top; others' PNGs of earlier runs "
    "are removed; default: the pipeline's, which is auto if it says nothing"
)
_TOP = (
    "how many events are top: those whose gain is farthest from 0, either way (fixed end speed, accounting "
    "equal); alone it means --png top; the next run without it draws the others again; default: the pipeline's, "
    "else 50"
)
_OPEN = "open the report, or the event's page, in a browser once it is made"


def _print_version(wanted: bool) -> None:
    if wanted:
        console.print(f"highd-lc {version('highd-lc')}", highlight=False)
        raise typer.Exit


_VERSION = typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version and exit.")


@app.callback()
def _before_all(version_: Annotated[bool, _VERSION] = False) -> None:
    require_cache()


@app.command()
def report(
    pipeline: Pipeline = None,
    data: Data = None,
    work: Work = DEFAULT_WORK,
    reports: Reports = DEFAULT_REPORTS,
    workers: Workers = 2,
    scheduler: Scheduler = None,
    verify: Verify = False,
    strict: Strict = False,
    event: Annotated[list[str] | None, typer.Option(help=_EVENT)] = None,
    png: Annotated[str | None, typer.Option(metavar="all|top|none|auto", help=_PNG)] = None,
    top: Annotated[int | None, typer.Option(min=1, metavar="N", help=_TOP)] = None,
    raw: Annotated[bool, typer.Option("--raw", help="draw raw coordinates: such pages may not be shared")] = False,
    vector: Annotated[list[str] | None, typer.Option(help="also pdf or svg of the events drawn")] = None,
    open_: Annotated[bool, typer.Option("--open", help=_OPEN)] = False,
    format_: Format = None,
    planner: Planners = None,
    json_: Json = False,
) -> None:
    """Make the pages and figures."""
    folder = _data(data)
    settings = settings_file.with_planners(_settings(pipeline, folder, format_), planner or ())
    wanted = png or (None if top is None else "top")
    changes = {"png": wanted, "top": top, "raw": raw or None}
    settings = settings_file.with_report(settings, {k: v for k, v in changes.items() if v is not None})
    if settings.report.raw:
        errors.print("warning: pages with raw coordinates may not be shared (HighD's licence)")
    options = Options(
        folder, work, reports, workers, scheduler, verify, strict, tuple(event or ()), tuple(vector or ())
    )
    _go("report", settings, options, browser=open_, as_json=json_)


add_commands(app, console, errors)


@app.command()
def truth(
    pipeline: Pipeline = None,
    data: Data = None,
    work: Work = DEFAULT_WORK,
    reports: Reports = DEFAULT_REPORTS,
    workers: Workers = 2,
) -> None:
    """Compare the fitted drivers with the true ones of made recordings (NN_truth_drivers.csv)."""
    from highd_lc import engine

    folder = _data(data)
    options = Options(folder, work, reports, workers)
    with _signals_as_errors():
        lines = engine.compare_with_truth(_settings(pipeline, folder), options, console=console)
    console.print(*lines, sep="\n", markup=False, highlight=False, soft_wrap=True)
    console.print(f"truth: {(reports / 'truth.html').resolve()}", soft_wrap=True)


@app.command()
def multiverse(
    pipeline: Pipeline = None,
    data: Data = None,
    work: Work = DEFAULT_WORK,
    reports: Reports = DEFAULT_REPORTS,
    workers: Workers = 2,
    choices: Annotated[
        str | None, typer.Option(metavar="FILE", help="table of choices (TOML); default: the pipeline's")
    ] = None,
    sample: Annotated[int | None, typer.Option(min=0, help="events; default: the pipeline's, else 60")] = None,
    format_: Format = None,
    json_: Json = False,
) -> None:
    """Plan a sample of events under every defensible choice: the range of the gain, the specification curve."""
    from highd_lc import engine
    from highd_lc.io.event_description import records
    from highd_lc.reporting.terminal import multiverse_table

    folder = _data(data)
    asked = {"choices": choices, "sample": sample}
    settings = settings_file.with_multiverse(
        _settings(pipeline, folder, format_), {k: v for k, v in asked.items() if v is not None}
    )
    outcome = Outcome()
    with _signals_as_errors():
        options = Options(folder, work, reports, workers)
        where = errors if json_ else console
        table, text = engine.multiverse(settings, options, console=where, outcome=outcome)
    page = (reports / "multiverse.html").resolve()
    if json_:
        print_json(console, {"range": text, "multiverse": records(table), "page": str(page)})
    else:
        console.print(multiverse_table(table))
        console.print(text, markup=False, highlight=False)
        console.print(f"multiverse: {page}", soft_wrap=True)
    _end_with_problems(outcome)


@app.command()
def synthesize(
    out: Annotated[Path, typer.Argument(help="folder to write to")],
    recordings: Annotated[int, typer.Option(min=1, max=200, help="number of recordings")] = 3,
    seconds: Annotated[float, typer.Option(min=5, max=3600, help="length of each [s]")] = 90.0,
    seed: Annotated[int, typer.Option(min=0, help="seed")] = 1,
    workers: Annotated[int, typer.Option(min=1, max=256, help="threads")] = 2,
    pipeline: Annotated[
        str,
        typer.Option(
            help="who drives: recorder_model (all by the LCM at once), demo (a mixture like real drivers), "
            "recorder_idm, recorder_population, or a file"
        ),
    ] = "recorder_model",
    with_: Annotated[
        str, typer.Option("--with", metavar="own|sumo", help="whose traffic; sumo: its drivers and lane changes")
    ] = "own",
) -> None:
    """Write synthetic recordings in HighD's format, with their truth beside them."""
    from highd_lc.io import sumo, synthetic

    makers = {"own": synthetic.synthesize, "sumo": sumo.synthesize}
    if with_ not in makers:
        raise UsageError(f"--with {with_!r}: one of {', '.join(makers)} is needed")
    with _signals_as_errors():
        recorder = _settings(pipeline, None).synthetic.recorder
        made = makers[with_](
            out, recordings=recordings, seconds=seconds, seed=seed, settings=recorder, workers=workers
        )
    console.print(f"{len(made)} recordings in {out}", soft_wrap=True)


@app.command()
def scenarios(
    out: Annotated[Path, typer.Option(help="folder of tables, figures and pages")] = DEFAULT_REPORTS / "scenarios",
    sweep: Annotated[bool, typer.Option("--sweep", help="also every combination of the options")] = False,
    pipeline: Pipeline = "scenarios",
    work: Work = DEFAULT_WORK,
    workers: Workers = 2,
) -> None:
    """Run the paper's scenarios and enter them beside every published number."""
    from highd_lc.reporting.terminal import claims_table
    from highd_lc.stages import scenarios as scenario_stage
    from highd_lc.vocab.scenarios import ScenarioSettings

    settings = settings_file.load_model(settings_file.find_pipeline(pipeline or "scenarios"), ScenarioSettings)
    with console.status("scenarios and every combination of the options" if sweep else "scenarios"):
        made = scenario_stage.run(settings, out, sweep=sweep, work=work, threads=workers)
    console.print(claims_table(made.frames["claims"]))
    if made.skipped:
        errors.print(f"recordings left out: {made.skipped}", markup=False)
    console.print(f"scenarios: {made.page.resolve()}", soft_wrap=True)


def main() -> None:
    """Entry point: every known error is one line on stderr and its exit code."""
    open_closed_streams()
    try:
        app()
    except HighdLcError as error:
        errors.print(f"highd-lc: {error}", markup=False)
        sys.exit(error.exit_code)
    except OSError as error:
        # The file system refused something that no layer below gives a name of its own to.
        errors.print(f"highd-lc: {error}", markup=False)
        sys.exit(StorageError.exit_code)


if __name__ == "__main__":
    main()
