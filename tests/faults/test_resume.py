"""A run that is killed at any moment goes on where it was, and ends as if nothing had happened."""

import os
import random
import time
from pathlib import Path

import pytest
from faulty_runs import Place, Run, contents, finished_files, run, steps_of

_LONG = bool(os.environ.get("HIGHD_LC_FAULTS"))
_CHAINS, _KILLS = (10, 5) if _LONG else (1, 2)
"""Runs, and SIGKILLs that each meets before it arrives: in the short form once each way to die."""


@pytest.fixture
def place(tmp_path: Path) -> Place:
    return Place(tmp_path)


def _killed(place: Place, kill: int, chance: random.Random, steps: int) -> None:
    """Start the run and kill it: in the middle of writing, or at any moment with two workers."""
    if kill % 2:
        running = Run(place, "--workers", "2")
        time.sleep(chance.uniform(0.1, 2.0))
        running.process.kill()
    else:
        running = Run(place, "--workers", "1", dies_at=chance.randrange(1, steps // 2))
    code, said = running.end()
    assert code in (-9, 0), said


@pytest.mark.parametrize("chain", range(_CHAINS))
def test_killed_again_and_again_it_arrives(undisturbed: Place, place: Place, chain: int) -> None:
    chance, steps = random.Random(chain), steps_of(undisturbed)
    for kill in range(_KILLS):
        before = finished_files(place)
        _killed(place, kill, chance, steps)
        assert {path: finished_files(place).get(path) for path in before} == before
    before = finished_files(place)
    code, said = run(place, "--workers", "1")
    assert code == 0, said
    assert {path: finished_files(place).get(path) for path in before} == before
    assert contents(place) == contents(undisturbed)


def test_unchanged_nothing_is_done_twice(undisturbed: Place, tmp_path: Path) -> None:
    place = undisturbed.copied(tmp_path / "run")
    before, log = finished_files(place), (place.work / "run.log").read_text()
    code, said = run(place, "--workers", "1")
    assert code == 0, said
    assert finished_files(place) == before
    assert len((place.work / "run.log").read_text()) > len(log)


@pytest.mark.parametrize("name", ["parts/extract/01/events.parquet", "losses.parquet", "../reports/index.html"])
def test_a_file_that_is_gone_or_torn_is_made_again(undisturbed: Place, tmp_path: Path, name: str) -> None:
    place = undisturbed.copied(tmp_path / "run")
    path = place.work / name
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    code, said = run(place, "--workers", "1")
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
