"""A work folder: its lock, its log, the hashes of what it was made from, and what no longer belongs in it.

The manifest of a work folder: which parts are finished, under which key, and the files that they consist of.

``parts/<stage>/NN.json`` stands for a stage's work on recording NN, ``parts/<stage>.json`` for its artefacts.
A record is removed before its work begins anew and written after all of its files: what it says is true at any
moment at which the process may be killed.

The recordings that a run starts from: their files, a hash of each, and whether they are what they were.
"""

import hashlib
import json
import logging
import os
import shutil
import traceback
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, TextIO

from highd_lc.io import atomic
from highd_lc.io.atomic import Written
from highd_lc.io.formats import Format
from highd_lc.io.settings import digest
from highd_lc.vocab.errors import HighdLcError, InputError, StorageError, UsageError
from highd_lc.vocab.job import JobReport, Problem
from highd_lc.vocab.tables import PARTITIONED

log = logging.getLogger("highd_lc")


@cache
def code_version() -> str:
    """Version of the package and a hash of its sources: artefacts of other code are made again."""
    package = Path(__file__).parents[1]
    sources = hashlib.sha256()
    for path in sorted(p for p in package.rglob("*") if p.suffix in (".py", ".css", ".js", ".html", ".jinja")):
        sources.update(path.relative_to(package).as_posix().encode() + path.read_bytes())
    return f"{version('highd-lc')}+{sources.hexdigest()[:12]}"


def read_json(path: Path) -> dict[str, Any]:
    """A JSON object from a file; empty if the file is missing or damaged."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


@contextmanager
def owned(
    folder: Path, *, role: str = "work", name: str = "lock", below: Sequence[str] = ("**",)
) -> Iterator[None]:
    """Keep other runs out of a folder, and clear away what killed ones left unfinished in it, before and after.

    role: what the folder is for; name: of the file that is locked; below: patterns of the subfolders that are
    cleared: others have other owners. The kernel releases the lock with the process, however that ends: a crash
    leaves none behind. Raises UsageError if another run is in the folder, StorageError if it cannot be written
    or locked.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle = (folder / name).open("a")
    except OSError as error:
        raise StorageError(f"{folder}: cannot be used as the {role} folder: {error.strerror}") from error
    with handle:
        _lock(handle, folder, role)
        atomic.remove_stale(folder, below)
        try:
            yield
        finally:
            atomic.remove_stale(folder, below)


def _lock(handle: TextIO, folder: Path, role: str) -> None:
    from filelock import lock_descriptor  # not needed to read a work folder

    try:
        locked = lock_descriptor(handle.fileno(), blocking=False)
    except OSError as error:
        needed = f"the {role} folder needs a file system with flock: a local disk, or a mount with locks"
        raise StorageError(f"{folder}: cannot be locked: {error.strerror}; {needed}") from error
    if not locked:
        raise UsageError(f"{folder}: another run is using this {role} folder")


def drop_other_recordings(work: Path, recordings: Iterable[int]) -> None:
    """Remove what was made of recordings that are no longer among the inputs."""
    kept = {f"{recording:02d}" for recording in recordings}
    for name in PARTITIONED.values():
        for folder in (work / name).glob("recording=*"):
            if folder.name.removeprefix("recording=") not in kept:
                _remove_folder(folder)
    for part in (work / "parts").glob("*/*"):
        if part.name.removesuffix(".json") not in kept:
            _remove_folder(part) if part.is_dir() else part.unlink()


def drop_recording(work: Path, recording: int, stages: Iterable[str]) -> None:
    """Remove what the stages made of a recording of which they could not make it anew."""
    name = f"{recording:02d}"
    for stage in stages:
        (work / "parts" / stage / f"{name}.json").unlink(missing_ok=True)
        _remove_folder(work / "parts" / stage / name)
        if stage in PARTITIONED:
            _remove_folder(work / PARTITIONED[stage] / f"recording={name}")


def _remove_folder(folder: Path) -> None:
    if folder.is_dir():
        shutil.rmtree(folder)


def append_log(work: Path, entry: dict[str, Any]) -> None:
    """Add a line to the run's log: wall times live here, so that artefacts are the same from run to run."""
    path = work / "run.log"
    try:
        with path.open("a", encoding="utf-8") as sink:
            sink.write(json.dumps(entry, sort_keys=True) + "\n")
    except OSError as error:
        raise StorageError(f"{path}: cannot be written: {error.strerror}") from error


def log_error(work: Path, error: BaseException, **about: Any) -> None:
    """Add an error with its traceback to the run's log, and show it where somebody asked for tracebacks.

    about: what it belongs to, as further entries of the line. A log that cannot be written is no other error.
    """
    trace = "".join(traceback.format_exception(error)).rstrip()
    log.debug(trace)
    with suppress(HighdLcError):
        append_log(work, {**about, "error": f"{type(error).__name__}: {error}", "traceback": trace})


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
        """Hash of a file's content. Raises InputError if it cannot be read."""
        try:
            stamp = _stamp(path)
            entry = self.known.get(str(path.resolve()))
            if self.verify or entry is None or entry[:2] != stamp:
                entry = [*stamp, atomic.content_hash(path)]
                self.known[str(path.resolve())] = entry
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {error.strerror}") from error
        return str(entry[2])

    def size_of(self, path: Path) -> int:
        """Size of a file when it was hashed [bytes]."""
        return int(self.known[str(path.resolve())][0])

    def refuse_changed(self, path: Path) -> None:
        """Raises InputError if the file is no longer the one that was hashed."""
        try:
            same = self.known[str(path.resolve())][:2] == _stamp(path)
        except OSError as error:
            raise InputError(f"{path}: vanished during the run: {error.strerror}") from error
        if not same:
            raise InputError(f"{path}: changed during the run; run again to read it anew")

    def save(self) -> None:
        """Remember the hashes for the next run."""
        atomic.write_text(self.store, json.dumps(self.known, indent=1, sort_keys=True))


def _stamp(path: Path) -> list[int]:
    stat = path.stat()
    return [stat.st_size, stat.st_mtime_ns]


def relative(path: Path, base: Path) -> str:
    """Where a path is from a folder's point of view; as it is where no way leads there (another drive)."""
    try:
        return os.path.relpath(path.resolve(), base.resolve())
    except ValueError:
        return str(path.resolve())


@dataclass(frozen=True)
class Records:
    """The records of a work folder. verify: hash the files of finished work instead of looking at their sizes."""

    work: Path
    verify: bool = False

    def finished(self, stage: str, key: str, recording: int | None = None) -> JobReport | None:
        """The report of work finished under that key with all its files in place; None if it has to be done."""
        record = read_json(self._file(stage, recording))
        if record.get("key") != key or not self._in_place(record.get("files", {})):
            return None
        problems = tuple(Problem(**problem) for problem in record.get("problems", []))
        return JobReport(record.get("counts", {}), problems)

    def forget(self, stage: str, recording: int | None = None) -> None:
        """Remove a record: the first step of doing its work anew."""
        self._file(stage, recording).unlink(missing_ok=True)

    def remember(
        self, stage: str, key: str, *, report: JobReport, files: Iterable[Written], recording: int | None = None
    ) -> None:
        """Write down that work is finished: the last step of it."""
        base = self.work.resolve()
        listed = {relative(f.path, base): [f.size, f.sha256] for f in files}
        record = {"key": key, **asdict(report), "files": listed}
        atomic.write_text(self._file(stage, recording), json.dumps(record, indent=1, sort_keys=True))

    def _file(self, stage: str, recording: int | None) -> Path:
        name = f"{stage}.json" if recording is None else f"{stage}/{recording:02d}.json"
        return self.work / "parts" / name

    def _in_place(self, files: dict[str, tuple[int, str]]) -> bool:
        base = self.work.resolve()
        return all(self._is_whole(base / name, size, sha256) for name, (size, sha256) in files.items())

    def _is_whole(self, path: Path, size: int, sha256: str) -> bool:
        try:
            return path.stat().st_size == size and (not self.verify or atomic.content_hash(path) == sha256)
        except OSError:
            return False


@dataclass(frozen=True)
class Inputs:
    """The recordings of a data folder. files: of each readable recording, largest recording first; keys: hash of
    each one's files; problems: recordings that cannot be read.
    """

    data: Path
    files: dict[int, tuple[Path, ...]]
    keys: dict[int, str]
    problems: tuple[Problem, ...]
    hashes: InputHashes

    def refuse_changed(self, recording: int) -> None:
        """Raises InputError if a file of the recording is no longer the one that its key was made of."""
        for path in self.files[recording]:
            self.hashes.refuse_changed(path)


def find_inputs(data: Path, work: Path, *, source: Format, verify: bool, keep: bool = True) -> Inputs:
    """Find the recordings of a folder in a format and hash their files; verify: even those that look unchanged.

    keep: remember the hashes in the work folder. Raises InputError if the folder is missing or holds no recording,
    StorageError if the hashes cannot be kept.
    """
    hashes = InputHashes.open(work, verify=verify)
    files: dict[int, tuple[Path, ...]] = {}
    keys: dict[int, str] = {}
    problems = []
    for recording in source.discover(data):
        try:
            files[recording] = source.input_files(data, recording)
            keys[recording] = digest(*map(hashes.of, files[recording]))
        except InputError as error:
            problems.append(Problem(recording, "ingest", str(error), lost=True))
    if keep:
        hashes.save()
    largest_first = sorted(keys, key=lambda r: (-sum(hashes.size_of(path) for path in files[r]), r))
    return Inputs(data, {r: files[r] for r in largest_first}, keys, tuple(problems), hashes)
