"""One stage over the recordings of a run: what is up to date, what has to be done, what failed."""

import logging
import os
import traceback
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from importlib import import_module
from types import ModuleType

from pydantic import BaseModel
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from highd_lc.execution import Execution
from highd_lc.io import artefacts, atomic, workspace
from highd_lc.io.atomic import Written
from highd_lc.io.settings import digest
from highd_lc.io.workspace import Inputs, Records
from highd_lc.vocab.errors import ClusterError, HighdLcError, InputError, StorageError, WorkerLostError, told
from highd_lc.vocab.job import Combination, Job, JobReport, Options, Outcome, Problem, Provenance, ReportRequest
from highd_lc.vocab.settings import Settings

STAGES = ("ingest", "extract", "calibrate", "validate", "report")
JOINED = {"ingest": ("vehicles", "recordings"), "extract": ("crossings", "events", "event_tracks")}
"""Tables of the stages whose artefacts are nothing but the parts of all recordings in one."""
_FATAL = (StorageError, ClusterError)
"""Errors that are not of one recording: the others would meet them too."""

log = logging.getLogger("highd_lc")

Done = tuple[JobReport, list[Written]]


@dataclass(frozen=True)
class StageRun:
    """A stage of a run. keys: of each recording's input to it, which are those of the stages before."""

    name: str
    settings: Settings
    options: Options
    inputs: Inputs
    keys: dict[int, str]

    def bring_up_to_date(self, execution: Execution, outcome: Outcome, console: Console) -> dict[int, str]:
        """Do what has to be done; the keys of the results by recording, without those that failed."""
        reports = self._finished()
        pending = [recording for recording in self.inputs.files if recording in self.keys.keys() - reports.keys()]
        reports |= self._work(pending, execution, outcome, console)
        self._drop_failed(reports)
        finished = {r: self._key(r) for r in self.keys if r in reports}
        outcome.problems += [problem for r in finished for problem in reports[r].problems]
        self._require(finished, outcome)
        together = digest(*finished.values(), self.name, *self._neighbours)
        combined = None if pending else self._records.finished(self.name, together)
        if combined is None:
            combined = self._combine_anew(tuple(sorted(finished)), together, execution)
        # What the artefacts hold is what the recordings' parts hold: counted once.
        outcome.counts[self.name] = _totals(reports.values()) | combined.counts
        # What follows a combination depends on all recordings (class pools), not only on its own.
        everybody = self.name == "calibrate"
        return {r: digest(key, together) if everybody else key for r, key in finished.items()}

    @property
    def _records(self) -> Records:
        return Records(self.options.work, self.options.verify)

    def _finished(self) -> dict[int, JobReport]:
        """Recordings without work to do. Those that single events leave alone keep their records and pages."""
        found = {r: self._records.finished(self.name, self._key(r), r) for r in self.keys if not self._idle(r)}
        idle = {r: JobReport() for r in self.keys if self._idle(r)}
        return idle | {recording: done for recording, done in found.items() if done is not None}

    def _idle(self, recording: int) -> bool:
        return self._request is not None and self._request.leaves_alone(recording)

    def _work(
        self, pending: list[int], execution: Execution, outcome: Outcome, console: Console
    ) -> dict[int, JobReport]:
        """Run the pending recordings; those that fail are listed, the others go on."""
        reports: dict[int, JobReport] = {}
        failed: list[Problem] = []
        with _progress(console) as progress:
            done = len(self.keys) - len(pending)
            bar = progress.add_task(self.name, total=len(self.keys), completed=done)
            for recording, result in execution.results({r: self._call(r) for r in pending}):
                try:
                    reports[recording] = self._remember(recording, *result())
                except _FATAL:
                    raise
                except HighdLcError as error:
                    failed.append(Problem(recording, self.name, str(error), lost=True))
                except Exception as error:
                    log.debug(traceback.format_exc())
                    text = told(f"recording {recording:02d}", error)
                    failed.append(Problem(recording, self.name, text, lost=True))
                progress.advance(bar)
        outcome.problems += sorted(failed, key=lambda problem: problem.recording)
        return dict(sorted(reports.items()))

    def _call(self, recording: int) -> Callable[[], Done]:
        """The work on a recording, to be carried out wherever. Its record goes first: see ``io.workspace``."""
        self._records.forget(self.name, recording)
        inputs = {f"{recording:02d}": self.keys[recording]}
        data, work = self.inputs.data, self.options.work
        job = Job(recording, data, work, self.settings, self._provenance(inputs))
        return partial(_execute, self.name, job, self._request)

    def _remember(self, recording: int, report: JobReport, files: list[Written]) -> JobReport:
        if self.name == "ingest":
            self.inputs.refuse_changed(recording)
        key = self._key(recording)
        self._records.remember(self.name, key, report=report, files=files, recording=recording)
        return report

    def _drop_failed(self, reports: dict[int, JobReport]) -> None:
        """What was made of a recording before it failed is of other inputs or settings."""
        for recording in self.keys.keys() - reports.keys():
            workspace.drop_recording(self.options.work, recording, STAGES[STAGES.index(self.name) :])

    def _require(self, finished: dict[int, str], outcome: Outcome) -> None:
        lost = [p.message for p in outcome.problems if p.lost]
        if finished and not (self.options.strict and lost):
            return
        more = f" (and {len(lost) - 1} more)" if len(lost) > 1 else ""
        raise InputError(f"{lost[0]}{more}")

    def _combine_anew(self, recordings: tuple[int, ...], together: str, execution: Execution) -> JobReport:
        self._records.forget(self.name)
        with atomic.collected() as files:
            report = self._combine(recordings, execution)
        self._records.remember(self.name, together, report=report, files=files)
        return report

    def _combine(self, recordings: tuple[int, ...], execution: Execution) -> JobReport:
        inputs = {f"{r:02d}": self.keys[r] for r in recordings}
        combination = Combination(recordings, self.options.work, self.settings, self._provenance(inputs))
        if self._request is not None:
            report, carry_out = stage_module(self.name), partial(_carry_out, execution)
            counted: JobReport = report.combine(combination, request=self._request, carry_out=carry_out)
            return counted
        if self.name in JOINED:
            counts = {
                name: artefacts.concatenate(self.options.work, self.name, name, recordings, combination.provenance)
                for name in JOINED[self.name]
            }
            return JobReport(counts)
        combined: JobReport = stage_module(self.name).combine(combination)
        return combined

    def _key(self, recording: int) -> str:
        """What the stage's work on a recording depends on."""
        return digest(self.keys[recording], self.name, workspace.code_version(), *self._dependencies)

    @cached_property
    def _dependencies(self) -> list[BaseModel | int | str]:
        """Settings that the stage reads, beyond those that its inputs were made with."""
        s = self.settings
        if self._request is not None:
            pictures = "all" if self._request.pictures is None else digest(*sorted(self._request.pictures))
            place = os.path.relpath(self.options.reports.resolve(), self.options.work.resolve())
            return [s.report, place, pictures, *self.options.events, *self.options.vector]
        sections: dict[str, list[BaseModel | int | str]] = {
            "ingest": [s.ingest],
            "extract": [s.extract, s.ingest],
            "calibrate": [s.calibrate, s.validation.followers, s.validation.loss, s.validation.statistics, s.seed],
            "validate": [s.validation, s.seed],
        }
        return sections[self.name]

    @property
    def _neighbours(self) -> list[str]:
        """What only the combination depends on, and no stage of this run makes."""
        if self.name != "report":
            return []
        found: list[str] = stage_module(self.name).neighbours(self.options.reports)
        return found

    @cached_property
    def _request(self) -> ReportRequest | None:
        """What of a report is wanted, which depends on the results of all recordings."""
        if self.name != "report":
            return None
        o = self.options
        wanted: ReportRequest = stage_module(self.name).choose(
            o.work,
            self.settings.report,
            reports=o.reports,
            events=o.events,
            vector=o.vector,
            model=self.settings.validation.follower_models[0],
        )
        return wanted

    def _provenance(self, inputs: dict[str, str]) -> Provenance:
        """What the stage's artefacts carry: settings of later stages are not of their making."""
        s = self.settings
        sections = (s.ingest, s.extract, s.calibrate, s.validation, s.report)
        used = digest(*sections[: STAGES.index(self.name) + 1])
        return Provenance(used, inputs, s.seed, workspace.code_version())


def stage_module(stage: str) -> ModuleType:
    """The module of a stage, imported when there is work for it: all of them take a second and more."""
    return import_module(f"highd_lc.stages.{stage}")


def _execute(stage: str, job: Job, request: ReportRequest | None) -> Done:
    """One stage on one recording, in whatever process: its report, and the files that it wrote."""
    module = stage_module(stage)
    with atomic.collected() as files:
        done = module.run(job) if request is None else module.run(job, request=request)
    return done, files


def _carry_out(execution: Execution, calls: Sequence[Callable[[], bytes]]) -> list[bytes]:
    """See ``vocab.job.CarryOut``. Raises what the first call that failed raised."""
    try:
        results = {number: result() for number, result in execution.results(dict(enumerate(calls)))}
    except WorkerLostError as error:  # which takes the number of a call for that of a recording
        text = "overview pages: a process was killed, and again when it ran alone (out of memory?)"
        raise WorkerLostError(text) from error
    return [results[number] for number in range(len(calls))]


def _totals(reports: Iterable[JobReport]) -> dict[str, int]:
    totals: dict[str, int] = {}
    for report_ in reports:
        for name, count in report_.counts.items():
            totals[name] = totals.get(name, 0) + count
    return totals


def _progress(console: Console) -> Progress:
    return Progress(
        TextColumn("{task.description:<10}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("recordings"),
        TimeElapsedColumn(),
        console=console,
    )
