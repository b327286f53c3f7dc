"""Folders that fill up or cannot be written, inputs that vanish or change: one line, exit code, nothing torn."""

import errno
import fcntl
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from faulty_runs import Place, contents, copy_of_fixtures, run
from rich.console import Console

from highd_lc import engine
from highd_lc.io import artefacts, settings, workspace
from highd_lc.vocab.errors import StorageError, UsageError
from highd_lc.vocab.job import Options

_LONG = bool(os.environ.get("HIGHD_LC_FAULTS"))


@contextmanager
def _mounted(folder: Path, options: str) -> Iterator[Path]:
    """A small file system in memory; the test is skipped where mounting is not permitted."""
    folder.mkdir(parents=True, exist_ok=True)
    command = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(folder)]
    try:
        made = subprocess.run(command, capture_output=True, text=True)
    except OSError as error:
        pytest.skip(f"mount is not there: {error}")
    if made.returncode:
        pytest.skip(f"mounting is not permitted: {made.stderr.strip()}")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


@pytest.mark.parametrize(("kilobytes", "workers"), [(4, "1"), (160, "1"), (400, "2")])
def test_a_full_disk_is_named_and_the_run_goes_on_where_there_is_room(
    undisturbed: Place, tmp_path: Path, kilobytes: int, workers: str
) -> None:
    with _mounted(tmp_path / "small", f"size={kilobytes}k") as small:
        place = Place(tmp_path / "run")
        place.root.mkdir()
        place.work.symlink_to(small)
        code, said = run(place, "--workers", workers, stage="extract")
        assert code == 2, said
        lines = [line for line in said.splitlines() if line.startswith("highd-lc:")]
        assert len(lines) == 1
        assert "No space left on device" in lines[0]
        assert "Traceback" not in said
        assert not list(small.rglob("*.tmp"))
        for path in small.rglob("*.parquet"):
            artefacts.provenance_of(path)
        subprocess.run(["mount", "-o", "remount,size=64m", str(small)], check=True)
        code, said = run(place, "--workers", workers, stage="extract")
        assert code == 0, said
        assert contents(place).items() <= contents(undisturbed).items()


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    with _mounted(tmp_path / "still", "ro") as still:
        code, said = run(Place(still.parent, options=("--work", str(still))))
    assert code == 2
    assert said == f"highd-lc: {still}: cannot be used as the work folder: Read-only file system\n"


def test_reports_that_cannot_be_written_are_named(undisturbed: Place, tmp_path: Path) -> None:
    place = undisturbed.copied(tmp_path / "run")
    with _mounted(tmp_path / "still", "ro") as still:
        code, said = run(place, "--reports", str(still), "--workers", "1")
    assert code == 2
    assert f"highd-lc: {still}" in said
    assert "Read-only file system" in said
    assert "Traceback" not in said


def test_a_work_folder_that_is_a_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "work").write_text("something else")
    code, said = run(Place(tmp_path))
    assert code == 2
    assert said == f"highd-lc: {tmp_path / 'work'}: cannot be used as the work folder: File exists\n"


def _run_while(place: Place, monkeypatch: pytest.MonkeyPatch, happens: object) -> engine.Outcome:
    """A run in this process; something happens between the hashing of the inputs and their reading."""
    original = engine.find_inputs

    def then(*arguments: object, **options: object) -> object:
        inputs = original(*arguments, **options)
        happens()
        return inputs

    monkeypatch.setattr(engine, "find_inputs", then)
    options = Options(place.data, place.work, place.reports, workers=1)
    return engine.run(settings.load(Path(place.options[1])), options, last="extract", console=Console(quiet=True))


def test_a_recording_that_changes_during_the_run_is_not_believed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = Place(tmp_path, data=copy_of_fixtures(tmp_path / "data"))
    changed = place.data / "01_tracks.csv"
    outcome = _run_while(place, monkeypatch, lambda: os.utime(changed, ns=(1, 1)))
    assert [p.message for p in outcome.problems] == [
        f"{changed}: changed during the run; run again to read it anew"
    ]
    assert not artefacts.partition(place.work, "tracks", 1).exists()
    assert not artefacts.part_folder(place.work, "ingest", 1).exists()
    assert set(artefacts.read(place.work, "events")["recording_id"]) == {2}


def test_a_recording_that_vanishes_during_the_run_is_listed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = Place(tmp_path, data=copy_of_fixtures(tmp_path / "data"))
    gone = place.data / "02_tracksMeta.csv"
    outcome = _run_while(place, monkeypatch, gone.unlink)
    assert [p.message for p in outcome.problems] == [f"{gone}: not found"]
    assert set(artefacts.read(place.work, "events")["recording_id"]) == {1}


def test_a_recording_that_is_gone_takes_its_results_with_it(undisturbed: Place, tmp_path: Path) -> None:
    place = undisturbed.copied(tmp_path / "run", data=copy_of_fixtures(tmp_path / "data"))
    for path in place.data.glob("01_*"):
        path.unlink()
    code, said = run(place, "--workers", "1", stage="report" if _LONG else "calibrate")
    assert code == 0, said
    left = [name for name in contents(place) if "/01/" in name or "/01.json" in name or "/01-" in name]
    # Pages go with the next report: test_report_stage has them gone.
    assert [name for name in left if _LONG or name.startswith("work/")] == []
    if _LONG:
        alone = Place(tmp_path / "alone", data=place.data)
        assert run(alone, "--workers", "1")[0] == 0
        assert contents(alone) == contents(place)


def test_a_bad_recording_beside_a_good_one_is_listed(tmp_path: Path) -> None:
    place = Place(tmp_path, data=copy_of_fixtures(tmp_path / "data"))
    (place.data / "01_tracksMeta.csv").unlink()
    (place.data / "03_tracks.csv").mkdir()
    code, said = run(place, "--workers", "1", stage="extract")
    assert code == 4
    assert f"ingest: {place.data / '01_tracksMeta.csv'}: not found" in said
    assert "Traceback" not in said
    assert run(place, "--strict", stage="extract")[0] == 3


def test_files_that_may_not_be_read_are_named(tmp_path: Path) -> None:
    place = Place(tmp_path, data=copy_of_fixtures(tmp_path / "data"))
    (place.data / "01_tracks.csv").chmod(0)
    if os.access(place.data / "01_tracks.csv", os.R_OK):
        pytest.skip("this user may read everything")
    code, said = run(place, "--workers", "1", stage="extract")
    assert code == 4
    assert f"ingest: {place.data / '01_tracks.csv'}: cannot be read: Permission denied" in said


@pytest.mark.parametrize("number", [errno.ENOLCK, errno.EINVAL, errno.ENOTSUP, errno.ENOSYS])
def test_a_folder_without_locks_is_named_with_what_it_needs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    def flock(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(fcntl, "flock", flock)
    needed = f"{tmp_path}: cannot be locked: {os.strerror(number)}; the work folder needs a file system with flock"
    with pytest.raises(StorageError) as caught, workspace.owned(tmp_path):
        pass
    assert str(caught.value).startswith(needed)


def test_a_folder_has_one_owner_at_a_time(tmp_path: Path) -> None:
    for _ in range(2):
        with (
            workspace.owned(tmp_path),
            pytest.raises(UsageError, match="using this work"),
            workspace.owned(tmp_path),
        ):
            pass


def test_two_works_do_not_make_pages_in_one_folder_at_once(undisturbed: Place, tmp_path: Path) -> None:
    unfinished = tmp_path / "reports" / "events" / ".01-0001-00001.html.0123abcd.tmp"
    unfinished.parent.mkdir(parents=True)
    place = Place(tmp_path)
    with workspace.owned(place.reports, role="reports", name=".lock", below=()):
        unfinished.touch()
        code, said = run(place, stage="report")
        assert (code, said) == (2, f"highd-lc: {place.reports}: another run is using this reports folder\n")
        assert run(place, "--workers", "1", stage="ingest")[0] == 0
        assert unfinished.exists()


@pytest.mark.parametrize("other", ["scenarios/.page.1.tmp", "elsewhere/figures/.x.tmp", "events/kept.html"])
def test_a_report_clears_away_its_own_files_alone(tmp_path: Path, other: str) -> None:
    own = [tmp_path / ".index.html.0.tmp", tmp_path / "events" / ".01-0001-00001.png.0.tmp"]
    for path in (*own, tmp_path / other):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    with workspace.owned(tmp_path, **engine._OF_REPORTS):
        assert not any(path.exists() for path in own)
    assert (tmp_path / other).exists()


@pytest.mark.parametrize("place", ["/dev/null", "/dev/null/kernels", "/proc/kernels"])
def test_a_cache_of_kernels_that_cannot_be_written_is_told_before_any_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, place: str
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", place)
    command = [sys.executable, "-c", "from highd_lc.cli import main; main()", "ingest", "--work"]
    made = subprocess.run([*command, str(tmp_path / "work")], capture_output=True, text=True)
    assert made.returncode == StorageError.exit_code
    assert made.stderr.count("\n") == 1
    assert f"NUMBA_CACHE_DIR={place}" in made.stderr
    assert not (tmp_path / "work").exists()
