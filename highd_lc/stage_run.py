"""The stages, and one of them over a run's recordings: what is up to date, what is to be done, what failed."""

import hashlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from importlib import import_module
from operator import attrgetter
from pathlib import Path
from types import ModuleType
from typing import Final

from pydantic import BaseModel
from rich.console import Console

from highd_lc.execution import Execution
from highd_lc.io import atomic, workspace
from highd_lc.io.atomic import Written
from highd_lc.io.choices import choices_text
from highd_lc.io.settings import digest
from highd_lc.io.workspace import Inputs, Records
from highd_lc.progress import Shown, shown
from highd_lc.vocab.errors import ClusterError, HighdLcError, InputError, StorageError, WorkerLostError, told
from highd_lc.vocab.follower_names import parse, source_of
from highd_lc.vocab.job import (
    CarryOut,
    Combination,
    Job,
    JobReport,
    Options,
    Outcome,
    Problem,
    Provenance,
    ReportRequest,
)
from highd_lc.vocab.settings import Settings

Dependency = BaseModel | int | str


@dataclass(frozen=True)
class Stage:
    """A step of the pipeline: work on each recording, then a combination of what was made of all of them.

    name: also that of its module in ``highd_lc.stages``.
    settings: what it reads beyond the settings that its inputs were made with; its own section first.
    tables: artefacts that are the recordings' parts joined, if that is all of the combination.
    reads_data: it reads the files of the data folder, which may change meanwhile.
    finds_events: from here on it is known which events there are.
    reads_tables: what it does is looked up in the tables of the stages before.
    files: settings that name a file which is read; empty = none.
    functions: settings that name functions of others, whose source counts as well.
    pools: a recording's results depend on all recordings (class pools), not only on its own.
    """

    name: str
    settings: tuple[str, ...]
    tables: tuple[str, ...] = ()
    reads_data: bool = False
    finds_events: bool = False
    reads_tables: bool = False
    pools: bool = False
    files: tuple[str, ...] = ()
    functions: tuple[str, ...] = ()

    @property
    def module_name(self) -> str:
        """The full name of its module."""
        return f"highd_lc.stages.{self.name}"

    @property
    def module(self) -> ModuleType:
        """Its module, imported when there is work for it: all of them take a second and more."""
        return import_module(self.module_name)

    def run(self, job: Job, request: ReportRequest | None) -> JobReport:
        """Do the work on one recording."""
        done: JobReport = self.module.run(job)
        return done

    def combined(self, combination: Combination, request: ReportRequest | None, execution: Execution) -> "Done":
        """Have the finished parts turned into artefacts where the recordings are worked on: with what is imported
        there already.
        """
        try:
            (result,) = dict(execution.results({0: partial(_combine, self, combination)})).values()
            return result()
        except WorkerLostError as error:  # which takes the number of a call for that of a recording
            text = f"{self.name}: a process was killed, and again when it ran alone (out of memory?)"
            raise WorkerLostError(text) from error

    def combine(self, combination: Combination) -> JobReport:
        """Turn the finished parts into artefacts."""
        if not self.tables:
            combined: JobReport = self.module.combine(combination)
            return combined
        from highd_lc.io import artefacts  # a third of a second, where the stages themselves are not imported

        work, recordings, about = combination.work, combination.recordings, combination.provenance
        return JobReport({t: artefacts.concatenate(work, self.name, t, recordings, about) for t in self.tables})

    def depends_on(self, settings: Settings, options: Options, request: ReportRequest | None) -> list[Dependency]:
        """What its work on a recording depends on beside its inputs and the code."""
        found = [attrgetter(name)(settings) for name in self.settings]
        plain = [repr(value) if isinstance(value, float) else value for value in found]
        choices = [choices_text(settings.validation)] if self.name == "multiverse" else []
        return plain + self._contents(settings) + self._functions(settings) + choices

    def _contents(self, settings: Settings) -> list[Dependency]:
        """Hashes of the files that its settings name; who reads a missing one says so."""
        paths = [Path(attrgetter(name)(settings)) for name in self.files if attrgetter(name)(settings)]
        if wanted := [one for name in self.functions for one in attrgetter(name)(settings)]:
            from highd_lc.stages.other_planners import sources  # seconds, and few runs have planners of others

            paths += sources(wanted)
        return [hashlib.sha256(path.read_bytes()).hexdigest() for path in paths if path.is_file()]

    def _functions(self, settings: Settings) -> list[Dependency]:
        """The source text of follower models of a researcher's own, where it reads follower models."""
        if "calibrate" not in self.settings:
            return []
        models = (*settings.calibrate.models, *settings.validation.follower_models)
        return [text for name in dict.fromkeys(models) if (text := source_of(parse(name).base))]

    def files_beside(self, settings: Settings, files: Iterable[Path]) -> list[Path]:
        """What its work on a recording reads beside the files that the recording is read from. files: those."""
        return []

    def neighbours(self, options: Options) -> list[str]:
        """What only the combination depends on, and no stage of a run makes."""
        return []

    def request(self, settings: Settings, options: Options) -> ReportRequest | None:
        """What of a report is wanted, which depends on the results of all recordings; None of other stages."""
        return None

    def refuse_senseless(self, options: Options) -> None:
        """Raises UsageError if the options ask the stage for what there cannot be."""

    def refuse_unknown(self, options: Options) -> None:
        """Raises UsageError if the options ask the stage for events that were not found."""


class _Pages(Stage):
    """The stage that writes the pages named by its request, outside the work folder."""

    def run(self, job: Job, request: ReportRequest | None) -> JobReport:
        done: JobReport = self.module.run(job, request=request)
        return done

    def combined(self, combination: Combination, request: ReportRequest | None, execution: Execution) -> "Done":
        carry_out: CarryOut = partial(_carry_out, execution)  # pages are made side by side
        with atomic.collected() as files:
            report: JobReport = self.module.combine(combination, request=request, carry_out=carry_out)
        return report, files

    def depends_on(self, settings: Settings, options: Options, request: ReportRequest | None) -> list[Dependency]:
        wanted = None if request is None else request.pictures
        pictures = "all" if wanted is None else digest(*sorted(wanted))
        place = workspace.relative(options.reports, options.work)
        sections = super().depends_on(settings, options, request)
        return [*sections, place, pictures, *options.events, *options.vector]

    def files_beside(self, settings: Settings, files: Iterable[Path]) -> list[Path]:
        if not settings.report.raw:
            return []
        from highd_lc.io.highd_image import picture_beside  # few runs draw the road

        picture = picture_beside(files)
        return [] if picture is None else [picture]

    def neighbours(self, options: Options) -> list[str]:
        found: list[str] = self.module.neighbours(options.reports)
        return found

    def request(self, settings: Settings, options: Options) -> ReportRequest | None:
        o = options
        wanted: ReportRequest = self.module.choose(
            o.work,
            settings.report,
            reports=o.reports,
            events=o.events,
            vector=o.vector,
            model=settings.validation.follower_models[0],
        )
        return wanted

    def refuse_senseless(self, options: Options) -> None:
        if options.events or options.vector:
            self.module.refuse_senseless(options.events, options.vector)

    def refuse_unknown(self, options: Options) -> None:
        if options.events:
            self.module.known_events(options.work, options.events)


_FITTED_WITH = (
    "validation.followers",
    "validation.loss",
    "validation.statistics",
    "validation.planner.human_smoothing_s",
    "validation.planner.leader_from",
    "validation.planner.parameters",
)
STAGES: Final = (
    Stage("ingest", ("ingest",), ("vehicles", "recordings"), reads_data=True),
    Stage("extract", ("extract", "ingest"), ("crossings", "events", "event_tracks"), finds_events=True),
    Stage(
        "calibrate", ("calibrate", *_FITTED_WITH, "seed"), pools=True, files=("validation.followers.population",)
    ),
    Stage("validate", ("validation_alone", "seed"), functions=("validation.planners",)),
    Stage("multiverse", ("validation", "seed")),
    _Pages("report", ("report",), reads_tables=True),
)
"""Each needs all before it. The multiverse is a part of validate that is brought up to date by itself."""

_FATAL = (StorageError, ClusterError)
"""Errors that are not of one recording: the others would meet them too."""

Done = tuple[JobReport, list[Written]]


@dataclass(frozen=True)
class StageRun:
    """A stage of a run. keys: of each recording's input to it, which are those of the stages before."""

    stage: Stage
    settings: Settings
    options: Options
    inputs: Inputs
    keys: dict[int, str]

    def bring_up_to_date(self, execution: Execution, outcome: Outcome, console: Console) -> dict[int, str]:
        """Do what has to be done; the keys of the results by recording, without those that failed."""
        reports = self._finished()
        pending = self._pending(reports)
        with shown(console, self.name, total=len(self.keys), pending=len(pending)) as progress:
            reports |= self._work(pending, execution, outcome, progress)
            self._drop_failed(reports)
            finished = {r: self._key(r) for r in self.keys if r in reports}
            outcome.problems += [problem for r in finished for problem in reports[r].problems]
            self._require(finished, outcome)
            together = self._together(finished)
            combined = None if pending else self._records.finished(self.name, together)
            if combined is None:
                progress.combine()
                combined = self._combine_anew(tuple(sorted(finished)), together, execution)
        # What the artefacts hold is what the recordings' parts hold: counted once.
        outcome.counts[self.name] = _totals(reports.values()) | combined.counts
        return self._handed_on(finished, together)

    def forecast(self) -> tuple[list[int], bool, dict[int, str]]:
        """Recordings with work to do, whether tables have to be made, and the keys handed on; nothing is done."""
        pending = self._pending(self._finished())
        keys = {recording: self._key(recording) for recording in self.keys}
        together = self._together(keys)
        combines = bool(pending) or self._records.finished(self.name, together) is None
        return pending, combines, self._handed_on(keys, together)

    def _pending(self, reports: dict[int, JobReport]) -> list[int]:
        """Recordings with work to do, the largest first."""
        return [recording for recording in self.inputs.files if recording in self.keys.keys() - reports.keys()]

    def _together(self, finished: dict[int, str]) -> str:
        """What the combination depends on."""
        return digest(*finished.values(), self.name, *self.stage.neighbours(self.options))

    def _handed_on(self, finished: dict[int, str], together: str) -> dict[int, str]:
        return {r: digest(key, together) if self.stage.pools else key for r, key in finished.items()}

    @property
    def name(self) -> str:
        """The stage's name."""
        return self.stage.name

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
        self, pending: list[int], execution: Execution, outcome: Outcome, progress: Shown
    ) -> dict[int, JobReport]:
        """Run the pending recordings; those that fail are listed, the others go on."""
        reports: dict[int, JobReport] = {}
        failed: list[Problem] = []
        for recording, result in execution.results({r: self._call(r) for r in pending}):
            try:
                reports[recording] = self._remember(recording, *result())
            except _FATAL:
                raise
            except Exception as error:
                workspace.log_error(self.options.work, error, stage=self.name, recording=recording)
                text = str(error) if isinstance(error, HighdLcError) else told(f"recording {recording:02d}", error)
                failed.append(Problem(recording, self.name, text, lost=True))
            progress.advance()
        outcome.problems += sorted(failed, key=lambda problem: problem.recording)
        return dict(sorted(reports.items()))

    def _call(self, recording: int) -> Callable[[], Done]:
        """The work on a recording, to be carried out wherever. Its record goes first: see ``io.workspace``."""
        self._records.forget(self.name, recording)
        inputs = {f"{recording:02d}": self.keys[recording]}
        data, work = self.inputs.data, self.options.work
        job = Job(recording, data, work, self.settings, self._provenance(inputs))
        return partial(_execute, self.stage, job, self._request)

    def _remember(self, recording: int, report: JobReport, files: list[Written]) -> JobReport:
        if self.stage.reads_data:
            self.inputs.refuse_changed(recording)
        key = self._key(recording)
        self._records.remember(self.name, key, report=report, files=files, recording=recording)
        return report

    def _drop_failed(self, reports: dict[int, JobReport]) -> None:
        """What was made of a recording before it failed is of other inputs or settings."""
        for recording in self.keys.keys() - reports.keys():
            of_these = [stage.name for stage in STAGES[STAGES.index(self.stage) :]]
            workspace.drop_recording(self.options.work, recording, of_these)

    def _require(self, finished: dict[int, str], outcome: Outcome) -> None:
        lost = [p.message for p in outcome.problems if p.lost]
        if finished and not (self.options.strict and lost):
            return
        more = f" (and {len(lost) - 1} more)" if len(lost) > 1 else ""
        raise InputError(f"{lost[0]}{more}")

    def _combine_anew(self, recordings: tuple[int, ...], together: str, execution: Execution) -> JobReport:
        self._records.forget(self.name)
        inputs = {f"{r:02d}": self.keys[r] for r in recordings}
        combination = Combination(recordings, self.options.work, self.settings, self._provenance(inputs))
        report, files = self.stage.combined(combination, self._request, execution)
        self._records.remember(self.name, together, report=report, files=files)
        return report

    def _key(self, recording: int) -> str:
        """What the stage's work on a recording depends on."""
        beside = self.stage.files_beside(self.settings, self.inputs.files[recording])
        known = (self.keys[recording], self.name, workspace.code_version(), *self._dependencies)
        return digest(*known, *map(self.inputs.hashes.of, beside))

    @cached_property
    def _dependencies(self) -> list[Dependency]:
        return self.stage.depends_on(self.settings, self.options, self._request)

    @cached_property
    def _request(self) -> ReportRequest | None:
        return self.stage.request(self.settings, self.options)

    def _provenance(self, inputs: dict[str, str]) -> Provenance:
        """What the stage's artefacts carry: settings of later stages are not of their making."""
        sections = [attrgetter(stage.settings[0])(self.settings) for stage in STAGES]
        used = digest(*sections[: STAGES.index(self.stage) + 1])
        return Provenance(used, inputs, self.settings.seed, workspace.code_version())


def _execute(stage: Stage, job: Job, request: ReportRequest | None) -> Done:
    """One stage on one recording, in whatever process: its report, and the files that it wrote."""
    with atomic.collected() as files:
        done = stage.run(job, request)
    return done, files


def _combine(stage: Stage, combination: Combination) -> Done:
    """The combination of a stage, in whatever process: its report, and the files that it wrote."""
    with atomic.collected() as files:
        done = stage.combine(combination)
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
