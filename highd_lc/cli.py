"""The command line: parses, loads settings, calls the engine, prints. No logic of its own.

Commands import what they run themselves: what one of them does not need would cost it a second of start-up.
"""

from highd_lc import one_thread  # noqa: F401  before anything imports numpy

# isort: split

import logging
import sys
import traceback
from contextlib import nullcontext
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from highd_lc.cli_console import (
    PLAIN,
    console,
    errors,
    open_closed_streams,
    print_json,
    show_tracebacks,
    signals_as_errors,
)
from highd_lc.cli_events import DEFAULT_WORK, Json, Work, add_commands
from highd_lc.cli_results import end_with_problems, list_problems, page, preview_lines, print_results, results
from highd_lc.io import settings as settings_file
from highd_lc.vocab.compile_cache import require_cache
from highd_lc.vocab.errors import HighdLcError, StorageError, UsageError, told
from highd_lc.vocab.job import Options, Outcome
from highd_lc.vocab.settings import Settings

_HELP = "Calibrate and validate lane-change planning on HighD recordings."
_DEBUG = "--debug"


class _Commands(TyperGroup):
    """The commands; --debug may stand behind a command's name too."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Move it to the front, unless it stands behind --, which ends the options."""
        options, rest = (args[: args.index("--")], args[args.index("--") :]) if "--" in args else (args, [])
        others = [option for option in options if option != _DEBUG]
        return super().parse_args(ctx, [_DEBUG] * (len(others) < len(options)) + others + rest)


app = typer.Typer(cls=_Commands, no_args_is_help=True, pretty_exceptions_enable=False, help=_HELP)
_HIGHD = Path("data/highd")


def _shipped(incomplete: str = "") -> list[str]:
    """Names of the shipped pipelines of recordings that begin with something."""
    names = (path.stem for path in settings_file.shipped_pipelines())
    return [name for name in names if name.startswith(incomplete)]


_WHICH = f"TOML file or shipped name: {', '.join(_shipped())}; default: highd with data, demo without"
Pipeline = Annotated[str | None, typer.Option(help=_WHICH, autocompletion=_shipped)]
Data = Annotated[Path | None, typer.Option(help="folder of recordings; default data/highd, else synthetic")]
Format = Annotated[
    str | None,
    typer.Option("--format", metavar="highd|ngsim|tgsim|exid", help="of the recordings; default: by content"),
]
Reports = Annotated[Path, typer.Option(help="folder of the pages")]
Workers = Annotated[int, typer.Option(min=1, max=256, help="local processes")]
Scheduler = Annotated[str | None, typer.Option(help="address of a Dask scheduler")]
DryRun = Annotated[bool, typer.Option("--dry-run", help="say what would run, and run and write nothing")]
Verify = Annotated[bool, typer.Option("--verify", help="hash all inputs instead of trusting size and time")]
Strict = Annotated[bool, typer.Option("--strict", help="stop at the first bad recording")]

Planners = Annotated[
    list[str] | None,
    typer.Option("--planner", metavar="module:function", help="a planner of others, beside ours (repeatable)"),
]

DEFAULT_REPORTS = Path("reports")
_SCENARIOS = settings_file.SCENARIOS
_WITHOUT_PLANS = ("ingest", "extract", "calibrate")
"""Stages that need no kernel of the planner."""


def _go(
    stage: str | None,
    settings: Settings,
    options: Options,
    *,
    browser: bool = False,
    as_json: bool = False,
    dry_run: bool = False,
) -> None:
    from highd_lc import engine
    from highd_lc.api.compiling import compiling_ahead

    if dry_run:
        rows = engine.preview(settings, options, last=stage)
        print_json({"dry_run": rows}) if as_json else console.print(*preview_lines(rows), sep="\n", **PLAIN)
        return
    outcome = Outcome()
    try:
        plans_here = stage not in _WITHOUT_PLANS and options.scheduler is None
        with signals_as_errors(), compiling_ahead() if plans_here else nullcontext():
            engine.run(settings, options, last=stage, console=errors if as_json else console, outcome=outcome)
    except HighdLcError as error:
        list_problems([problem for problem in outcome.problems if problem.message not in str(error)])
        raise
    if as_json:
        print_json(results(outcome, options))
    else:
        print_results(outcome, options, settings.validation.follower_models[0])
    if browser:
        typer.launch(str(page(options)))
    end_with_problems(outcome)


def _settings(pipeline: str | None, data: Path | None, format_: str | None = None) -> Settings:
    found = settings_file.load_pipeline(pipeline or ("demo" if data is None else "highd"), Settings)
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
        dry_run: DryRun = False,
    ) -> None:
        folder = _data(data)
        options = Options(folder, work, reports, workers, scheduler, verify, strict)
        settings = settings_file.with_planners(_settings(pipeline, folder, format_), planner or ())
        _go(None if name == "run" else name, settings, options, as_json=json_, dry_run=dry_run)

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
_ANIMATE = "like --event, with the motion as an animated GIF beside the page (repeatable)"
_OPEN = "open the report, or the event's page, in a browser once it is made"


def _print_version(wanted: bool) -> None:
    if wanted:
        console.print(f"highd-lc {version('highd-lc')}", highlight=False)
        raise typer.Exit


_VERSION = typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version and exit.")


_TRACES = typer.Option(
    _DEBUG, help="show tracebacks on the standard error; those of a run are always in work/run.log"
)


@app.callback()
def _before_all(version_: Annotated[bool, _VERSION] = False, debug: Annotated[bool, _TRACES] = False) -> None:
    show_tracebacks(debug)
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
    animate: Annotated[list[str] | None, typer.Option(metavar="EVENT", help=_ANIMATE)] = None,
    open_: Annotated[bool, typer.Option("--open", help=_OPEN)] = False,
    format_: Format = None,
    planner: Planners = None,
    json_: Json = False,
    dry_run: DryRun = False,
) -> None:
    """Make the pages and figures."""
    folder = _data(data)
    settings = settings_file.with_planners(_settings(pipeline, folder, format_), planner or ())
    wanted = png or (None if top is None else "top")
    changes = {"png": wanted, "top": top, "raw": raw or None}
    settings = settings_file.with_report(settings, {k: v for k, v in changes.items() if v is not None})
    if settings.report.raw:
        errors.print("warning: pages with raw coordinates may not be shared (HighD's licence)")
    events = tuple(dict.fromkeys([*(event or ()), *(animate or ())]))
    kinds = (*(vector or ()), *(["gif"] if animate else ()))
    options = Options(folder, work, reports, workers, scheduler, verify, strict, events, kinds)
    _go("report", settings, options, browser=open_, as_json=json_, dry_run=dry_run)


add_commands(app)


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
    with signals_as_errors():
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
    with signals_as_errors():
        options = Options(folder, work, reports, workers)
        where = errors if json_ else console
        table, text = engine.multiverse(settings, options, console=where, outcome=outcome)
    page = (reports / "multiverse.html").resolve()
    if json_:
        print_json({"range": text, "multiverse": records(table), "page": str(page)})
    else:
        console.print(multiverse_table(table))
        console.print(text, markup=False, highlight=False)
        console.print(f"multiverse: {page}", soft_wrap=True)
    end_with_problems(outcome)


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
    with signals_as_errors():
        recorder = _settings(pipeline, None).synthetic.recorder
        made = makers[with_](
            out, recordings=recordings, seconds=seconds, seed=seed, settings=recorder, workers=workers
        )
    console.print(f"{len(made)} recordings in {out}", soft_wrap=True)


@app.command()
def scenarios(
    out: Annotated[Path, typer.Option(help="folder of tables, figures and pages")] = DEFAULT_REPORTS / "scenarios",
    sweep: Annotated[bool, typer.Option("--sweep", help="also every combination of the options")] = False,
    pipeline: Annotated[str, typer.Option(help="TOML file; scenarios: the shipped one")] = _SCENARIOS,
    work: Work = DEFAULT_WORK,
    workers: Workers = 2,
) -> None:
    """Run the paper's scenarios and enter them beside every published number."""
    from highd_lc.progress import announce_compiling
    from highd_lc.reporting.terminal import claims_table
    from highd_lc.stages import scenarios as scenario_stage
    from highd_lc.vocab.scenarios import ScenarioSettings

    settings = settings_file.load_pipeline(pipeline, ScenarioSettings)
    announce_compiling(console)
    what = f"scenarios{' and every combination of the options' * sweep}"
    if not console.is_terminal:  # which shows it until they are done
        console.print(f"{what}: under way", highlight=False)
    with console.status(what):
        made = scenario_stage.run(settings, out, sweep=sweep, work=work, threads=workers)
    console.print(claims_table(made.frames["claims"]))
    if made.skipped:
        errors.print(f"recordings left out: {made.skipped}", markup=False)
    console.print(f"scenarios: {made.page.resolve()}", soft_wrap=True)


def main() -> None:
    """Entry point: every error is one line on stderr and its exit code."""
    open_closed_streams()
    try:
        app()
    except HighdLcError as error:
        _end(str(error), error.exit_code)
    except OSError as error:
        # The file system refused something that no layer below gives a name of its own to.
        refused = error.filename is not None and error.strerror is not None
        _end(f"{error.filename}: {error.strerror}" if refused else str(error), StorageError.exit_code)
    except Exception as error:
        _end(f"{told('unexpected', error)}; {_DEBUG} shows where, a run's log too", HighdLcError.exit_code)


def _end(text: str, code: int) -> None:
    logging.getLogger("highd_lc").debug(traceback.format_exc())
    errors.print(f"highd-lc: {text}", markup=False)
    sys.exit(code)


if __name__ == "__main__":
    main()
