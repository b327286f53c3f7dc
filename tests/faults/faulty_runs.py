"""Runs in processes of their own, to be killed, interrupted and compared."""

import hashlib
import json
import multiprocessing
import os
import shutil
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from shared_runs import FIXTURES, QUICK

_OF_THE_MACHINE = {"run.log", "inputs.json", "lock"}
"""Files with times and places in them: no artefacts."""

# Forked from a server that has imported everything, a run starts in milliseconds.
_context = multiprocessing.get_context("forkserver")
_STAGES = ("ingest", "extract", "calibrate", "validate", "multiverse", "report")
_context.set_forkserver_preload(["highd_lc.cli", "highd_lc.engine", *(f"highd_lc.stages.{s}" for s in _STAGES)])


@dataclass(frozen=True)
class Place:
    """Folders of a run: the same names below any root."""

    root: Path
    data: Path = FIXTURES
    options: tuple[str, ...] = field(default=("--pipeline", str(QUICK)))

    @property
    def work(self) -> Path:
        return self.root / "work"

    @property
    def reports(self) -> Path:
        return self.root / "reports"

    def copied(self, root: Path, *, data: Path | None = None) -> "Place":
        """A copy that may be changed, of a finished run, with the same settings."""
        shutil.copytree(self.root, root)
        return Place(root, data or self.data, self.options)

    def arguments(self, *more: str, stage: str = "run") -> list[str]:
        folders = ["--data", self.data, "--work", self.work, "--reports", self.reports]
        return ["highd-lc", stage, *map(str, folders), *self.options, *more]


class Run:
    """A run of the command line in a process of its own. dies_at: step of writing at which it is killed."""

    def __init__(self, place: Place, *more: str, stage: str = "run", dies_at: int = 0) -> None:
        place.root.mkdir(parents=True, exist_ok=True)
        self._said = place.root / "said.txt"
        arguments = place.arguments(*more, stage=stage)
        self.process = _context.Process(target=_main, args=(arguments, self._said, dies_at))
        self.process.start()

    def end(self, timeout: float = 600.0) -> tuple[int, str]:
        """Wait for its end: exit code (negative: signal) and what it said."""
        self.process.join(timeout)
        if self.process.is_alive():
            self.process.kill()
            raise TimeoutError(f"still running after {timeout} s: {self._said.read_text()}")
        return self.process.exitcode, self._said.read_text(encoding="utf-8", errors="replace")


def run(place: Place, *more: str, stage: str = "run", dies_at: int = 0) -> tuple[int, str]:
    """Carry out a run: its exit code and what it said on both streams."""
    return Run(place, *more, stage=stage, dies_at=dies_at).end()


def _main(arguments: list[str], said: Path, dies_at: int) -> None:
    sink = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(sink, 1)
    os.dup2(sink, 2)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if dies_at:
        _die_at(dies_at)
    from highd_lc.cli import main

    sys.argv = arguments
    main()


def _die_at(step: int) -> None:
    """Kill this process at a step of its writing: three for each file (opened, written, renamed)."""
    from highd_lc.io import atomic

    original, left = atomic.replacing, step

    def count() -> None:
        nonlocal left
        left -= 1
        if left == 0:
            os.kill(os.getpid(), signal.SIGKILL)

    @contextmanager
    def counted(path: Path, *, durable: bool = True) -> Iterator[object]:
        with original(path, durable=durable) as sink:
            count()
            yield sink
            count()
        count()

    atomic.replacing = counted


def steps_of(place: Place) -> int:
    """Steps of writing that a finished run took: an estimate from the files that it left."""
    return 3 * len(contents(place))


def contents(place: Place) -> dict[str, str]:
    """Hash of every file of a run that has to be the same in any other run."""
    paths = [p for folder in (place.work, place.reports) for p in folder.rglob("*") if p.is_file()]
    return {
        p.relative_to(place.root).as_posix(): hashlib.sha256(p.read_bytes()).hexdigest()
        for p in sorted(paths)
        if p.name not in _OF_THE_MACHINE
    }


def finished_files(place: Place) -> dict[Path, tuple[int, int]]:
    """Inode and time of every file that the manifest calls finished: a file made again has others."""
    records = [p for p in (place.work / "parts").rglob("*.json") if not p.name.startswith(".")]
    listed = [place.work / name for record in records for name in json.loads(record.read_text()).get("files", {})]
    return {p.resolve(): (p.stat().st_ino, p.stat().st_mtime_ns) for p in [*records, *listed]}


def copy_of_fixtures(folder: Path) -> Path:
    """The small recordings in a folder that may be changed."""
    folder.mkdir(parents=True)
    for path in FIXTURES.glob("*_*.csv"):
        if "truth" not in path.name:
            shutil.copy(path, folder)
    return folder


def descendants(session: int) -> list[int]:
    """Processes of a session that still live (Linux)."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _parent, _group, of = stat.read_text().rpartition(")")[2].split()[:4]
        except OSError:
            continue
        if int(of) == session and state != "Z":
            found.append(int(stat.parent.name))
    return found
