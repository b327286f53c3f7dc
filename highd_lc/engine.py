"""The engine: runs stages over recordings, skips what is up to date, lists what failed."""

import logging
import time
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from multiprocessing import get_context
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from highd_lc.io import artefacts, highd, synthetic, workspace
from highd_lc.io.settings import digest, resolved
from highd_lc.stages import calibrate, extract, ingest, report, validate
from highd_lc.vocab.errors import HighdLcError, InputError
from highd_lc.vocab.job import Combination, Job, JobReport, Problem, Provenance, ReportRequest
from highd_lc.vocab.settings import Settings

STAGES = ("ingest", "extract", "calibrate", "validate", "report")
_JOINED = {"ingest": ("vehicles", "recordings"), "extract": ("crossings", "events", "event_tracks")}
_MODULES = [f"highd_lc.stages.{stage}" for stage in STAGES]

log = logging.getLogger("highd_lc")


@dataclass(frozen=True)
class Options:
    """Where a run reads and writes, and how it is carried out.

    data: folder of the CSVs, None = recordings that are synthesized into the work folder; workers: local
    processes; scheduler: address of a Dask scheduler instead; verify: hash inputs again; strict: any bad
    recording ends the run; events: ids whose pages are wanted, none = all.
    """

    data: Path | None
    work: Path
    reports: Path
    workers: int = 2
    scheduler: str | None = None
    verify: bool = False
    strict: bool = False
    events: tuple[str, ...] = ()
    vector: tuple[str, ...] = ()


@dataclass
class Outcome:
    """What a run did: problems to list, counts by stage."""

    problems: list[Problem] = field(default_factory=list)
    counts: dict[str, dict[str, int]] = field(default_factory=dict)


def run(settings: Settings, options: Options, *, last: str, console: Console) -> Outcome:
    """Run the pipeline's stages up to ``last``. Raises InputError if no recording is usable."""
    with workspace.lock(options.work):
        workspace.write_text(options.work / "settings.json", resolved(settings))
        data = options.data or _synthesize(settings, options.work, console)
        return _run_stages(settings, options, data, last=last, console=console)


def _run_stages(settings: Settings, options: Options, data: Path, *, last: str, console: Console) -> Outcome:
    keys = _input_keys(data, options)
    workspace.drop_other_tracks(options.work, keys)
    outcome = Outcome()
    with _executor(options, len(keys)) as executor:
        for stage in (s for s in settings.stages if STAGES.index(s) <= STAGES.index(last)):
            started = time.perf_counter()
            keys = _run_stage(_Stage(stage, settings, options, data, keys), executor, outcome, console)
            seconds = time.perf_counter() - started
            entry = {"stage": stage, "seconds": round(seconds, 3), "counts": outcome.counts[stage]}
            workspace.append_log(options.work, entry)
    return outcome


def _input_keys(data: Path, options: Options) -> dict[int, str]:
    """A hash of each recording's input files."""
    hashes = workspace.InputHashes.open(options.work, verify=options.verify)
    recordings = highd.discover(data)
    keys = {r: digest(*(hashes.of(path) for path in highd.input_files(data, r))) for r in recordings}
    hashes.save()
    return keys


def _synthesize(settings: Settings, work: Path, console: Console) -> Path:
    """The embedded recordings, made once for their settings."""
    wanted, folder = settings.synthetic, work / "synthetic"
    key = digest(wanted, workspace.code_version())
    if workspace.finished(work, "synthesize", key) is None:
        console.print(f"no data given: synthesizing {wanted.recordings} recordings in {folder}")
        for old in folder.glob("*.csv"):
            old.unlink()
        synthetic.synthesize(
            folder,
            recordings=wanted.recordings,
            seconds=wanted.seconds,
            seed=wanted.seed,
            settings=wanted.recorder,
        )
        workspace.remember(work, "synthesize", key, JobReport({"recordings": wanted.recordings}))
    return folder


@contextmanager
def _executor(options: Options, jobs: int) -> Iterator[Executor | None]:
    """Local processes, a Dask cluster, or nothing for work in this process."""
    if options.scheduler is not None:
        from distributed import Client

        with Client(options.scheduler) as client:
            yield client.get_executor(pure=False)
    elif min(options.workers, jobs) <= 1:
        yield None
    else:
        # Forking a process that runs threads (pyarrow's) may deadlock: a clean server forks instead.
        context = get_context("forkserver")
        context.set_forkserver_preload(_MODULES)
        with ProcessPoolExecutor(min(options.workers, jobs), mp_context=context) as executor:
            yield executor


@dataclass(frozen=True)
class _Stage:
    """A stage of a run. keys: of each recording's input to it, which are those of the stages before."""

    name: str
    settings: Settings
    options: Options
    data: Path
    keys: dict[int, str]

    def key(self, recording: int) -> str:
        """What the stage's work on a recording depends on."""
        return digest(self.keys[recording], self.name, workspace.code_version(), *self._dependencies())

    def _dependencies(self) -> list[object]:
        s = self.settings
        return {
            "ingest": [s.ingest],
            "extract": [s.extract, s.ingest],
            "calibrate": [s.calibrate, s.seed],
            "validate": [s.validation, s.seed],
            "report": [
                s.report,
                str(self.options.reports.resolve()),
                *self.options.events,
                *self.options.vector,
            ],
        }[self.name]

    def provenance(self, inputs: dict[str, str]) -> Provenance:
        """What the stage's artefacts carry."""
        return Provenance(digest(self.settings), inputs, self.settings.seed, workspace.code_version())

    def job(self, recording: int) -> Job:
        """The stage's work on one recording."""
        inputs = {f"{recording:02d}": self.keys[recording]}
        return Job(recording, self.data, self.options.work, self.settings, self.provenance(inputs))


def _run_stage(stage: _Stage, executor: Executor | None, outcome: Outcome, console: Console) -> dict[int, str]:
    """Bring a stage up to date; the keys of its results by recording, without those that failed."""
    work = stage.options.work
    reports: dict[int, JobReport] = {}
    pending = []
    for recording in stage.keys:
        done = workspace.finished(work, stage.name, stage.key(recording), recording)
        if done is None:
            pending.append(recording)
        else:
            reports[recording] = done
    reports |= _work(stage, pending, executor, outcome, console)
    finished = {r: stage.key(r) for r in stage.keys if r in reports}
    for recording in finished:
        outcome.problems += reports[recording].problems
    _require(finished, outcome, stage)
    together = digest(*finished.values(), stage.name)
    if workspace.finished(work, stage.name, together) is None or pending:
        report = _combine(stage, tuple(sorted(finished)))
        workspace.remember(work, stage.name, together, report)
    done = workspace.finished(work, stage.name, together)
    outcome.counts[stage.name] = _totals([*reports.values(), done] if done else [*reports.values()])
    # What follows a combination depends on all recordings (class pools), not only on its own.
    combined = stage.name == "calibrate"
    return {r: digest(key, together) if combined else key for r, key in finished.items()}


def _totals(reports: list[JobReport]) -> dict[str, int]:
    totals: dict[str, int] = {}
    for report_ in reports:
        for name, count in report_.counts.items():
            totals[name] = totals.get(name, 0) + count
    return totals


def _require(finished: dict[int, str], outcome: Outcome, stage: _Stage) -> None:
    failed = [p for p in outcome.problems if p.recording not in finished]
    if finished and not (stage.options.strict and failed):
        return
    first = failed[0].message if failed else "no recording"
    more = f" (and {len(failed) - 1} more)" if len(failed) > 1 else ""
    raise InputError(f"{first}{more}")


def _work(
    stage: _Stage, pending: list[int], executor: Executor | None, outcome: Outcome, console: Console
) -> dict[int, JobReport]:
    """Run the pending recordings of a stage; those that fail are listed, the others go on."""
    reports: dict[int, JobReport] = {}
    request = _report_request(stage) if pending and stage.name == "report" else None
    with _progress(console) as progress:
        bar = progress.add_task(stage.name, total=len(stage.keys), completed=len(stage.keys) - len(pending))
        for recording, result in _results(stage, pending, executor, request):
            try:
                reports[recording] = result()
                key = stage.key(recording)
                workspace.remember(stage.options.work, stage.name, key, reports[recording], recording)
            except HighdLcError as error:
                outcome.problems.append(Problem(recording, stage.name, str(error)))
            except Exception as error:
                log.debug(traceback.format_exc())
                text = f"recording {recording:02d}: {type(error).__name__}: {error}"
                outcome.problems.append(Problem(recording, stage.name, " ".join(text.split())))
            progress.advance(bar)
    return reports


def _results(
    stage: _Stage, pending: list[int], executor: Executor | None, request: ReportRequest | None
) -> Iterator[tuple[int, Callable[[], JobReport]]]:
    """Each recording with a call that gives its report or raises."""
    if executor is None:
        for recording in pending:
            yield recording, partial(_execute, stage.name, stage.job(recording), request)
        return
    futures: dict[Future[JobReport], int] = {
        executor.submit(_execute, stage.name, stage.job(recording), request): recording for recording in pending
    }
    for future in as_completed(futures):
        yield futures[future], future.result


def _execute(stage: str, job: Job, request: ReportRequest | None) -> JobReport:
    """One stage on one recording, in whatever process."""
    if stage == "report":
        assert request is not None
        return report.run(job, request=request)
    modules = {"ingest": ingest, "extract": extract, "calibrate": calibrate, "validate": validate}
    return modules[stage].run(job)


def _report_request(stage: _Stage) -> ReportRequest:
    options = stage.options
    return report.choose(options.work, stage.settings.report, reports=options.reports, events=options.events)


def _combine(stage: _Stage, recordings: tuple[int, ...]) -> JobReport:
    inputs = {f"{r:02d}": stage.keys[r] for r in recordings}
    combination = Combination(recordings, stage.options.work, stage.settings, stage.provenance(inputs))
    if stage.name == "report":
        return report.combine(combination, request=_report_request(stage))
    if stage.name in _JOINED:
        counts = {
            name: artefacts.concatenate(stage.options.work, stage.name, name, recordings, combination.provenance)
            for name in _JOINED[stage.name]
        }
        return JobReport(counts)
    return {"calibrate": calibrate, "validate": validate}[stage.name].combine(combination)


def _progress(console: Console) -> Progress:
    return Progress(
        TextColumn("{task.description:<10}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("recordings"),
        TimeElapsedColumn(),
        console=console,
    )
