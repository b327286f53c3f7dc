"""A run that is killed at any moment goes on where it was, and ends as if nothing had happened."""

import os
import random
import time
from pathlib import Path

import pytest
from faulty_runs import Place, Run, contents, finished_files, run, steps_of

_LONG = bool(os.environ.get("HIGHD_LC_FAULTS"))
_BY_STEP, _BY_TIME = (35, 15) if _LONG else (3, 2)
"""SIGKILLs while a file is written, and at any moment with two workers; `make test-faults` asks for more."""


@pytest.fixture
def place(tmp_path: Path) -> Place:
    return Place(tmp_path)


def _untouched(before: dict[Path, tuple[int, int]], place: Place) -> None:
    after = finished_files(place)
    assert {path: after.get(path) for path in before} == before


def test_killed_while_writing_it_goes_on(undisturbed: Place, tmp_path: Path) -> None:
    steps = random.Random(1).sample(range(1, steps_of(undisturbed)), _BY_STEP)
    for step in steps:
        place = Place(tmp_path / str(step))
        code, said = run(place, "--workers", "1", dies_at=step)
        assert code == -9, said
        before = finished_files(place)
        code, said = run(place, "--workers", "1")
        assert code == 0, said
        _untouched(before, place)
        assert contents(place) == contents(undisturbed), f"killed at step {step}"


def test_killed_again_and_again_it_arrives(undisturbed: Place, place: Place) -> None:
    moments = random.Random(2)
    for _ in range(_BY_TIME):
        before = finished_files(place)
        running = Run(place, "--workers", "2")
        time.sleep(moments.uniform(0.2, 2.0))
        running.process.kill()
        running.end()
        _untouched(before, place)
    code, said = run(place, "--workers", "2")
    assert code == 0, said
    assert contents(place) == contents(undisturbed)


def test_unchanged_nothing_is_done_twice(undisturbed: Place) -> None:
    before, log = finished_files(undisturbed), (undisturbed.work / "run.log").read_text()
    code, said = run(undisturbed, "--workers", "1")
    assert code == 0, said
    assert finished_files(undisturbed) == before
    assert len((undisturbed.work / "run.log").read_text()) > len(log)


@pytest.mark.parametrize("name", ["parts/extract/01/events.parquet", "losses.parquet", "../reports/index.html"])
def test_a_file_that_is_gone_or_torn_is_made_again(undisturbed: Place, name: str) -> None:
    path = undisturbed.work / name
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    code, said = run(undisturbed, "--workers", "1")
    assert code == 0, said
    assert path.read_bytes() == whole


def test_two_runs_in_one_work_folder_are_refused(place: Place) -> None:
    first = Run(place, "--workers", "1")
    while not (place.work / "settings.json").exists():
        time.sleep(0.01)
    code, said = run(Place(place.root / "second", options=(*place.options, "--work", str(place.work))))
    assert code == 2
    assert "another run is using this work folder" in said
    assert len(said.splitlines()) == 1
    first.process.kill()
    first.end()
    code, said = run(place, "--workers", "1", stage="ingest")
    assert code == 0, said
