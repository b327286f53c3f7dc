"""The engine: runs stages over recordings, skips what is up to date, lists what failed."""

import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rich.console import Console

from highd_lc.execution import Cluster, Execution, InProcess, LocalProcesses
from highd_lc.io import atomic, workspace
from highd_lc.io.choices import choices_text, variants_of
from highd_lc.io.formats import format_of
from highd_lc.io.settings import digest, resolved
from highd_lc.io.workspace import Records, find_inputs
from highd_lc.progress import announce_compiling
from highd_lc.stage_run import STAGES, Stage, StageRun
from highd_lc.vocab.job import JobReport, Options, Outcome, Provenance
from highd_lc.vocab.settings import Settings

if TYPE_CHECKING:
    import pandas as pd

_OF_REPORTS: Final[dict[str, Any]] = {"role": "reports", "name": ".lock", "below": ("", "events")}
"""How the folder of the pages is owned: what else is below it has other owners."""


def run(
    settings: Settings, options: Options, *, last: str | None, console: Console, outcome: Outcome | None = None
) -> Outcome:
    """Run the stages up to ``last``, None = the last one that the pipeline lists.

    outcome: filled as the run goes on, for callers that need its problems even if it fails. Raises UsageError if
    the options name what does not exist, SettingsError if a planner cannot be found, InputError if no recording is
    usable, StorageError if a folder cannot be written, ClusterError if the scheduler cannot be used. What was
    finished before stays finished.
    """
    outcome = outcome or Outcome()
    if options.scheduler is not None:
        options = _absolute(options)
    _refuse_at_once(settings, options)
    stages = _up_to({last} if last is not None else set(settings.stages))
    with ExitStack() as folders:
        folders.enter_context(workspace.owned(options.work))
        if "report" in (stage.name for stage in stages):
            folders.enter_context(workspace.owned(options.reports, **_OF_REPORTS))
        atomic.write_text(options.work / "settings.json", resolved(settings))
        if options.scheduler is None:  # a cluster's workers have kernels of their own
            announce_compiling(console)
        try:
            data = options.data or _synthesize(settings, options, console)
            _run_stages(settings, options, data, stages=stages, console=console, outcome=outcome)
        except Exception as error:
            workspace.log_error(options.work, error)
            raise
    return outcome


def preview(settings: Settings, options: Options, *, last: str | None) -> list[dict[str, Any]]:
    """What ``run`` would do, without doing or writing anything: one row a stage.

    Rows: stage, recordings (how many there are), to_do (how many have work to do), combines (whether tables are
    made), None = known once the stages before are done. Raises what ``run`` raises before it runs a stage.
    """
    _refuse_at_once(settings, options)
    stages = _up_to({last} if last is not None else set(settings.stages))
    data = options.data or _embedded(settings, options)
    if data is None:
        count = settings.synthetic.recordings
        names = ["synthesize", *(stage.name for stage in stages)]
        return [{"stage": name, "recordings": count, "to_do": count, "combines": True} for name in names]
    source = format_of(data, settings.ingest.format)
    inputs = find_inputs(data, options.work, source=source, verify=options.verify, keep=False)
    keys, rows = inputs.keys, list[dict[str, Any]]()
    for stage in stages:
        to_do, combines = None, None
        # Which pages are wanted is looked up in the tables of the stages before.
        if not stage.reads_tables or not any(row["combines"] for row in rows):
            pending, combines, keys = StageRun(stage, settings, options, inputs, keys).forecast()
            to_do = len(pending)
        rows.append({"stage": stage.name, "recordings": len(keys), "to_do": to_do, "combines": combines})
    return rows


def _refuse_at_once(settings: Settings, options: Options) -> None:
    """Refuse options and settings that cannot be meant, before anything is done."""
    for stage in STAGES:
        stage.refuse_senseless(options)
    if choices_text(settings.validation):
        variants_of(settings.validation)
    if settings.validation.planners:
        from highd_lc.stages.other_planners import OtherPlanners  # seconds, and few runs have any

        OtherPlanners.of(settings.validation.planners)
    if settings.validation.sumo.events:
        from highd_lc.io.sumo_replay import refuse_missing

        refuse_missing()


def compare_with_truth(settings: Settings, options: Options, *, console: Console) -> list[str]:
    """Bring the run up to calibrate, set its drivers beside the true ones, and say how near they come.

    Raises InputError, before anything is run where that can be known, if no recording comes with its drivers.
    """
    from highd_lc.stages import truth

    if options.data is not None:
        truth.true_drivers(options.data, format_of(options.data, settings.ingest.format).discover(options.data))
    with workspace.owned(options.reports, **_OF_REPORTS):  # which is refused now, not after the run
        run(settings, options, last="calibrate", console=console)
        data = options.data or options.work / "synthetic"
        with workspace.owned(options.work):
            inputs = {path.name: atomic.content_hash(path) for path in sorted(data.rglob("*_truth_drivers.csv"))}
            about = Provenance(digest(settings), inputs, settings.seed, workspace.code_version())
            table = truth.run(data, options.work, options.reports, settings, about)
    return list(truth.said(table))


def multiverse(
    settings: Settings, options: Options, *, console: Console, outcome: Outcome
) -> tuple["pd.DataFrame", str]:
    """Bring the run up to its multiverse and make its page; the table ``multiverse`` and its range."""
    from highd_lc.io import artefacts
    from highd_lc.reporting.pages_multiverse import by_gain, range_words
    from highd_lc.stages.overview_pages import write_multiverse

    with workspace.owned(options.reports, **_OF_REPORTS):
        run(settings, options, last="multiverse", console=console, outcome=outcome)
        with workspace.owned(options.work):
            write_multiverse(options.work, options.reports, settings.validation)
            table = artefacts.read(options.work, "multiverse")
    return by_gain(table), range_words(table)


def _up_to(wanted: set[str]) -> tuple[Stage, ...]:
    """The stages named, and all that come before one of them; the multiverse belongs to validate."""
    wanted = wanted | ({"multiverse"} if "validate" in wanted else set())
    return STAGES[: 1 + max(number for number, stage in enumerate(STAGES) if stage.name in wanted)]


def _absolute(options: Options) -> Options:
    """With paths that mean the same in any working folder."""
    data = options.data and options.data.resolve()
    return replace(options, data=data, work=options.work.resolve(), reports=options.reports.resolve())


def _run_stages(
    settings: Settings,
    options: Options,
    data: Path,
    *,
    stages: Sequence[Stage],
    console: Console,
    outcome: Outcome,
) -> None:
    source = format_of(data, settings.ingest.format)
    recordings = source.discover(data)
    remarks = source.remarks(data)
    if (folders := source.folders(data)) != [data]:
        remarks.insert(0, f"recordings found in {' and '.join(map(str, folders))}")
    for remark in remarks:
        console.print(remark, markup=False, soft_wrap=True)
    with _execution(options, len(recordings), stages) as execution:
        inputs = find_inputs(data, options.work, source=source, verify=options.verify)
        workspace.drop_other_recordings(options.work, inputs.keys)
        outcome.problems += inputs.problems
        keys = inputs.keys
        for stage in stages:
            started = time.perf_counter()
            keys = StageRun(stage, settings, options, inputs, keys).bring_up_to_date(execution, outcome, console)
            seconds = time.perf_counter() - started
            entry = {"stage": stage.name, "seconds": round(seconds, 3), "counts": outcome.counts[stage.name]}
            workspace.append_log(options.work, entry)
            if stage.finds_events:  # the expensive stages follow
                for asked in STAGES:
                    asked.refuse_unknown(options)


def _embedded(settings: Settings, options: Options) -> Path | None:
    """The folder of the embedded recordings; None if they have to be synthesized."""
    made = Records(options.work).finished("synthesize", _embedded_key(settings))
    return None if made is None else options.work / "synthetic"


def _embedded_key(settings: Settings) -> str:
    return digest(settings.synthetic, workspace.code_version())


def _synthesize(settings: Settings, options: Options, console: Console) -> Path:
    """The embedded recordings, made once for their settings."""
    if (found := _embedded(settings, options)) is not None:
        return found
    wanted, folder, records = settings.synthetic, options.work / "synthetic", Records(options.work)
    console.print(f"no data given: synthesizing {wanted.recordings} recordings in {folder}")
    records.forget("synthesize")
    for old in folder.glob("*.csv"):
        old.unlink()
    from highd_lc.io import synthetic  # the traffic simulation: nobody with recordings needs it

    synthetic.synthesize(
        folder,
        recordings=wanted.recordings,
        seconds=wanted.seconds,
        seed=wanted.seed,
        settings=wanted.recorder,
    )
    report = JobReport({"recordings": wanted.recordings})
    records.remember("synthesize", _embedded_key(settings), report=report, files=())
    return folder


def _execution(options: Options, recordings: int, stages: Sequence[Stage]) -> Execution:
    """A Dask cluster, local processes, or this process."""
    if options.scheduler is not None:
        return Cluster(options.scheduler, probe=partial(_surroundings, options.work))
    workers = min(options.workers, recordings)
    modules = [stage.module_name for stage in stages]
    return LocalProcesses(workers, preload=modules) if workers > 1 else InProcess()


def _surroundings(work: Path) -> str:
    """What has to be the same wherever a job runs: the code, and the work folder as it is seen from there."""
    try:
        seen = atomic.content_hash(work / "settings.json")
    except OSError as error:
        seen = f"cannot be read: {error.strerror}"
    return f"code {workspace.code_version()}, work folder {seen}"
