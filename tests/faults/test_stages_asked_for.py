"""What a run does of what it is asked for: causes told, options checked first, stages that are needed run."""

import io
from collections.abc import Callable
from pathlib import Path

import pytest
from faulty_runs import Place, run
from rich.console import Console
from shared_runs import FIXTURES, QUICK

from highd_lc import engine
from highd_lc.io import settings
from highd_lc.stages import extract, ingest
from highd_lc.vocab.errors import ArtefactError, InputError
from highd_lc.vocab.job import Job, JobReport, Options, Outcome, Problem


def _extracted(root: Path, *, strict: bool = False) -> Outcome:
    options = Options(FIXTURES, root / "work", root / "reports", workers=1, strict=strict)
    return engine.run(settings.load(QUICK), options, last="extract", console=Console(file=io.StringIO()))


@pytest.fixture
def warned(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every recording is read with a warning."""
    usual = ingest.run

    def with_warning(job: Job) -> JobReport:
        warning = Problem(job.recording, "ingest", f"recording {job.recording:02d}: only told", warning=True)
        return JobReport(usual(job).counts, (warning,))

    monkeypatch.setattr(ingest, "run", with_warning)


@pytest.fixture
def failing(monkeypatch: pytest.MonkeyPatch) -> Callable[[int, Exception], None]:
    """Has extract fail for recordings from a number on."""

    def fail(first: int, error: Exception) -> None:
        usual = extract.run

        def failing_run(job: Job) -> JobReport:
            if job.recording >= first:
                raise error
            return usual(job)

        monkeypatch.setattr(extract, "run", failing_run)

    return fail


_FEW_MODELS = """
[calibrate]
optimiser = "screen"
screened = 64
models = ["constant_speed", "own_fit"]

[validate.followers]
model = "own_fit"
also = []
"""

_CAUSES = [
    (ZeroDivisionError("division by zero"), "recording 01: ZeroDivisionError: division by zero"),
    (InputError("01_tracks.csv: torn"), "01_tracks.csv: torn"),
    (ArtefactError("events: damaged"), "events: damaged"),
]


@pytest.mark.parametrize(("error", "told"), _CAUSES)
def test_the_cause_is_told_and_not_a_warning(
    tmp_path: Path, warned: None, failing: Callable[[int, Exception], None], error: Exception, told: str
) -> None:
    failing(1, error)
    with pytest.raises(InputError) as caught:
        _extracted(tmp_path)
    assert str(caught.value) == f"{told} (and 1 more)"


@pytest.mark.parametrize(("error", "told"), _CAUSES)
def test_a_lost_recording_is_told_from_a_warning(
    tmp_path: Path, warned: None, failing: Callable[[int, Exception], None], error: Exception, told: str
) -> None:
    failing(2, error)
    outcome = _extracted(tmp_path)
    lost = [problem for problem in outcome.problems if problem.lost]
    assert [(p.recording, p.stage, p.message) for p in lost] == [(2, "extract", told.replace("01:", "02:"))]
    assert [problem.recording for problem in outcome.problems if problem.warning] == [1, 2]
    with pytest.raises(InputError, match=str(error)):
        _extracted(tmp_path, strict=True)


def test_strict_ends_at_no_warning(tmp_path: Path, warned: None) -> None:
    assert all(problem.warning for problem in _extracted(tmp_path, strict=True).problems)


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (("--event", "WRONG"), "event 'WRONG': an id is RR-VVVV-FFFFF"),
        (("--event", "1-2-3"), "event '1-2-3': an id is RR-VVVV-FFFFF"),
        (("--vector", "tiff"), "vector 'tiff': choose from pdf, svg"),
        (("--png", "some"), "report.png = 'some'"),
        (("--reports", "/dev/null"), "/dev/null: cannot be used as the reports folder"),
    ],
)
def test_options_are_checked_before_any_stage(tmp_path: Path, options: tuple[str, str], word: str) -> None:
    place = Place(tmp_path)
    code, said = run(place, *options, stage="report")
    assert code == 2
    assert len(said.splitlines()) == 1
    assert word in said
    assert not (place.work / "parts").exists()


def test_an_event_is_looked_for_as_soon_as_events_are_known(tmp_path: Path) -> None:
    place = Place(tmp_path)
    code, said = run(place, "--event", "01-0001-00001", "--workers", "1", stage="report")
    assert code == 2
    assert "event '01-0001-00001': not among the" in said
    assert {path.name for path in (place.work / "parts").iterdir() if path.is_dir()} == {"ingest", "extract"}


@pytest.mark.parametrize(
    ("stages", "command", "done"),
    [
        (["calibrate"], "run", ["ingest", "extract", "calibrate"]),
        (["calibrate", "ingest"], "run", ["ingest", "extract", "calibrate"]),
        (["extract"], "run", ["ingest", "extract"]),
        (["report"], "extract", ["ingest", "extract"]),
        (["ingest"], "calibrate", ["ingest", "extract", "calibrate"]),
    ],
)
def test_a_stage_asked_for_runs_those_before_it(
    tmp_path: Path, stages: list[str], command: str, done: list[str]
) -> None:
    pipeline = tmp_path / "some.toml"
    pipeline.write_text(f"stages = {stages}\n{_FEW_MODELS}")
    place = Place(tmp_path, options=("--pipeline", str(pipeline), "--workers", "1"))
    code, said = run(place, stage=command)
    assert code == 0, said
    assert sorted(path.name for path in (place.work / "parts").iterdir() if path.is_dir()) == sorted(done)
