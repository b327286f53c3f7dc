"""The engine: runs stages over recordings, skips what is up to date, lists what failed."""

import time
from dataclasses import replace
from functools import partial
from pathlib import Path

from rich.console import Console

from highd_lc.execution import Cluster, Execution, InProcess, LocalProcesses
from highd_lc.io import atomic, highd_files, workspace
from highd_lc.io.inputs import find_inputs
from highd_lc.io.records import Records
from highd_lc.io.settings import digest, resolved
from highd_lc.stage_run import STAGES, StageRun
from highd_lc.vocab.job import JobReport, Options, Outcome
from highd_lc.vocab.settings import Settings


def run(settings: Settings, options: Options, *, last: str, console: Console) -> Outcome:
    """Run the pipeline's stages up to ``last``.

    Raises InputError if no recording is usable, StorageError if a folder cannot be written, ClusterError if the
    scheduler is of no use. What was finished before stays finished.
    """
    if options.scheduler is not None:
        options = _absolute(options)
    with workspace.lock(options.work):
        _remove_stale(options)
        try:
            atomic.write_text(options.work / "settings.json", resolved(settings))
            data = options.data or _synthesize(settings, options, console)
            return _run_stages(settings, options, data, last=last, console=console)
        finally:
            _remove_stale(options)


def _remove_stale(options: Options) -> None:
    """Clear away what runs and workers that were killed in the middle of a file left of it."""
    for folder in (options.work, options.reports):
        atomic.remove_stale(folder)


def _absolute(options: Options) -> Options:
    """With paths that mean the same in any working folder."""
    data = options.data and options.data.resolve()
    return replace(options, data=data, work=options.work.resolve(), reports=options.reports.resolve())


def _run_stages(settings: Settings, options: Options, data: Path, *, last: str, console: Console) -> Outcome:
    recordings = highd_files.discover(data)
    if (folders := highd_files.folders(data)) != [data]:
        console.print(f"recordings found in {' and '.join(map(str, folders))}", markup=False, soft_wrap=True)
    stages = [stage for stage in settings.stages if STAGES.index(stage) <= STAGES.index(last)]
    with _execution(options, len(recordings), stages) as execution:
        inputs = find_inputs(data, options.work, verify=options.verify)
        workspace.drop_other_recordings(options.work, inputs.keys)
        outcome, keys = Outcome(list(inputs.problems)), inputs.keys
        for name in stages:
            started = time.perf_counter()
            keys = StageRun(name, settings, options, inputs, keys).bring_up_to_date(execution, outcome, console)
            seconds = time.perf_counter() - started
            entry = {"stage": name, "seconds": round(seconds, 3), "counts": outcome.counts[name]}
            workspace.append_log(options.work, entry)
    return outcome


def _synthesize(settings: Settings, options: Options, console: Console) -> Path:
    """The embedded recordings, made once for their settings."""
    wanted, folder, records = settings.synthetic, options.work / "synthetic", Records(options.work)
    key = digest(wanted, workspace.code_version())
    if records.finished("synthesize", key) is None:
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
        records.remember("synthesize", key, report=report, files=())
    return folder


def _execution(options: Options, recordings: int, stages: list[str]) -> Execution:
    """A Dask cluster, local processes, or this process."""
    if options.scheduler is not None:
        return Cluster(options.scheduler, probe=partial(_surroundings, options.work))
    workers = min(options.workers, recordings)
    modules = [f"highd_lc.stages.{stage}" for stage in stages]
    return LocalProcesses(workers, preload=modules) if workers > 1 else InProcess()


def _surroundings(work: Path) -> str:
    """What has to be the same wherever a job runs: the code, and the work folder as it is seen from there."""
    try:
        seen = atomic.content_hash(work / "settings.json")
    except OSError as error:
        seen = f"cannot be read: {error.strerror}"
    return f"code {workspace.code_version()}, work folder {seen}"
