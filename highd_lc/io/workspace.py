"""The book-keeping of a work folder: which parts are finished, and from what they were made."""

import fcntl
import hashlib
import json
import os
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from highd_lc.vocab.errors import UsageError
from highd_lc.vocab.job import JobReport, Problem


@cache
def code_version() -> str:
    """Version of the package and a hash of its sources: artefacts of other code are made again."""
    package = Path(__file__).parents[1]
    sources = hashlib.sha256()
    for path in sorted(p for p in package.rglob("*") if p.suffix in (".py", ".css", ".js", ".html", ".jinja")):
        sources.update(path.relative_to(package).as_posix().encode() + path.read_bytes())
    return f"{version('highd-lc')}+{sources.hexdigest()[:12]}"


def write_text(path: Path, text: str) -> None:
    """Write a small file atomically: temporary name, flush to disk, rename."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with temporary.open("w", encoding="utf-8") as sink:
            sink.write(text)
            sink.flush()
            os.fsync(sink.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def read_json(path: Path) -> dict[str, Any]:
    """A JSON object from a file; empty if the file is missing or damaged."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


@contextmanager
def lock(work: Path) -> Iterator[None]:
    """Keep other runs out of a work folder. Raises UsageError if one is in it.

    The kernel releases the lock with the process, however that ends: a crash leaves none behind.
    """
    work.mkdir(parents=True, exist_ok=True)
    with (work / "lock").open("w") as handle:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise UsageError(f"{work}: another run is using this work folder") from error
        yield


def drop_other_tracks(work: Path, recordings: Iterable[int]) -> None:
    """Remove the tracks of recordings that are no longer among the inputs."""
    kept = {f"recording={recording:02d}" for recording in recordings}
    for folder in (work / "tracks").glob("recording=*"):
        if folder.name not in kept:
            shutil.rmtree(folder)


def append_log(work: Path, entry: dict[str, Any]) -> None:
    """Add a line to the run's log: wall times live here, so that artefacts are the same from run to run."""
    with (work / "run.log").open("a", encoding="utf-8") as sink:
        sink.write(json.dumps(entry, sort_keys=True) + "\n")


@dataclass(frozen=True)
class InputHashes:
    """Content hashes of input files, remembered by size and modification time."""

    store: Path
    known: dict[str, Any]
    verify: bool

    @classmethod
    def open(cls, work: Path, *, verify: bool) -> "InputHashes":
        """The hashes remembered in a work folder; verify: hash every file again."""
        store = work / "inputs.json"
        return cls(store, read_json(store), verify)

    def of(self, path: Path) -> str:
        """Hash of a file's content; "missing" if there is none."""
        try:
            stat = path.stat()
        except OSError:
            return "missing"
        stamp = [stat.st_size, stat.st_mtime_ns]
        entry = self.known.get(str(path.resolve()))
        if self.verify or entry is None or entry[:2] != stamp:
            entry = [*stamp, _hash(path)]
            self.known[str(path.resolve())] = entry
        return str(entry[2])

    def save(self) -> None:
        """Remember the hashes for the next run."""
        write_text(self.store, json.dumps(self.known, indent=1, sort_keys=True))


def _hash(path: Path) -> str:
    with path.open("rb") as source:
        return hashlib.file_digest(source, "sha256").hexdigest()[:16]


def record_of(work: Path, stage: str, recording: int | None = None) -> Path:
    """File that says that a stage has finished a recording (or, without one, its artefacts)."""
    name = f"{stage}.json" if recording is None else f"{stage}/{recording:02d}.json"
    return work / "parts" / name


def finished(work: Path, stage: str, key: str, recording: int | None = None) -> JobReport | None:
    """The report of finished work if it was made under that key; None if it has to be done."""
    record = read_json(record_of(work, stage, recording))
    if record.get("key") != key:
        return None
    problems = tuple(Problem(**problem) for problem in record.get("problems", []))
    return JobReport(record.get("counts", {}), problems)


def remember(work: Path, stage: str, key: str, report: JobReport, recording: int | None = None) -> None:
    """Write down that work is finished: the last step of it."""
    record = {"key": key, **asdict(report)}
    write_text(record_of(work, stage, recording), json.dumps(record, indent=1, sort_keys=True))
