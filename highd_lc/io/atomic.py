"""Files that are complete or absent: temporary name, flush to disk, rename; and a ledger of what was written."""

import hashlib
import os
import secrets
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from highd_lc.vocab.errors import StorageError

_SUFFIX = ".tmp"


@dataclass(frozen=True)
class Written:
    """A file that was written. size in bytes; sha256: of its content, the first 16 hexadecimal digits."""

    path: Path
    size: int
    sha256: str


_ledger: ContextVar[list[Written] | None] = ContextVar("ledger", default=None)


@contextmanager
def collected() -> Iterator[list[Written]]:
    """What this thread writes inside the ``with``, in the order of writing."""
    written: list[Written] = []
    token = _ledger.set(written)
    try:
        yield written
    finally:
        _ledger.reset(token)


@contextmanager
def replacing(path: Path, *, durable: bool = True) -> Iterator[BinaryIO]:
    """A file to write to that takes the place of ``path`` once it is complete, and leaves nothing if it fails.

    durable: outlives a power failure too. What is written by the thousand does without: the size in the ledger
    tells a torn file. Raises StorageError if it cannot be written.
    """
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(4)}{_SUFFIX}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with temporary.open("w+b") as sink:
            yield sink
            sink.flush()
            if durable:
                os.fsync(sink.fileno())
            _enter(path, sink)
        temporary.replace(path)
        if durable:
            _sync_folder(path.parent)
    except OSError as error:
        raise StorageError(f"{path}: cannot be written: {_reason(error)}") from error
    finally:
        # What stopped the writing is the error to be told, not that its remains cannot be removed either.
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def write_bytes(path: Path, data: bytes, *, durable: bool = True) -> None:
    """Write a file. Raises StorageError if it cannot be written."""
    with replacing(path, durable=durable) as sink:
        sink.write(data)


def write_text(path: Path, text: str) -> None:
    """Write a small file in UTF-8. Raises StorageError if it cannot be written."""
    write_bytes(path, text.encode("utf-8"))


def remove_stale(folder: Path, below: Iterable[str] = ("**",)) -> None:
    """Remove what processes that were killed left unfinished in parts of a folder that nobody else uses.

    below: patterns of its subfolders, "" = the folder itself, "**" = everything.
    """
    for path in [path for part in below for path in folder.glob(os.path.join(part, f".*{_SUFFIX}"))]:
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise StorageError(f"{path}: cannot be removed: {_reason(error)}") from error


def content_hash(path: Path) -> str:
    """Hash of a file's content, as in the ledger. Raises OSError if it cannot be read."""
    with path.open("rb") as source:
        return _hash(source)


def _hash(source: BinaryIO) -> str:
    return hashlib.file_digest(source, "sha256").hexdigest()[:16]  # type: ignore[arg-type]  # readinto is no part of BinaryIO


def _enter(path: Path, sink: BinaryIO) -> None:
    ledger = _ledger.get()
    if ledger is not None:
        size = sink.seek(0, os.SEEK_END)
        sink.seek(0)
        ledger.append(Written(path, size, _hash(sink)))


def _sync_folder(folder: Path) -> None:
    """Flush a folder's entries: without it a rename may not outlive a power failure. Windows opens no folders."""
    if os.name != "posix":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _reason(error: OSError) -> str:
    return " ".join((error.strerror or str(error)).split())


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """A binary file that takes its place when the block ends without an error, and leaves nothing otherwise."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with temporary.open("wb") as sink:
            yield sink
            sink.flush()
            os.fsync(sink.fileno())
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
