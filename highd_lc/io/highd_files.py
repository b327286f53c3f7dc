"""Where the files of HighD recordings lie: in the folder given, or below it, as people unpack and sort them.

Files of recording RR: RR_recordingMeta.csv, RR_tracksMeta.csv, RR_tracks.csv, in whatever case, each as it is or
packed as .gz. They lie in one folder, or in one for each kind (``Tracks`` and ``Metas``).
"""

import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

from highd_lc.io.highd_csv import fault, first_line, lookalike
from highd_lc.vocab.errors import InputError

Layout = TypeVar("Layout")

KINDS = ("recordingMeta", "tracksMeta", "tracks")
_KIND_OF = {kind.lower(): kind for kind in KINDS}
_FILE = re.compile(r"(\d+)_(recordingMeta|tracksMeta|tracks)\.csv(\.gz)?", re.IGNORECASE)
# Highest number of folders between the one given and the files: what an archive and a sorting hand put there.
_DEPTH = 3
_PACKED, _TABLES = (".zip", ".7z", ".rar", ".tar", ".tgz"), (".csv", ".txt", ".gz")

Files = dict[tuple[int, str], Path]
"""Path by recording and kind."""


def discover(data: Path) -> list[int]:
    """Numbers of the recordings in a folder, ascending: any file of a triple announces its recording.

    Raises InputError if the folder is missing or holds none, or if several folders below it do.
    """
    return sorted({recording for recording, _ in find_files(data)})


def folders(data: Path) -> list[Path]:
    """The folders in which the files were found, ascending: usually ``data`` alone. Raises as ``discover``."""
    return sorted({path.parent for path in find_files(data).values()})


def input_files(data: Path, recording: int) -> tuple[Path, Path, Path]:
    """The recordingMeta, tracksMeta and tracks file of a recording; 1 may be written 1, 01 or 001.

    Raises InputError naming the file that is missing.
    """
    files = find_files(data)
    paths = [files.get((recording, kind)) or _usual(files, recording, kind) for kind in KINDS]
    for path in paths:
        if not path.is_file():
            raise fault(path, "not found")
    return paths[0], paths[1], paths[2]


def _usual(files: Files, recording: int, kind: str) -> Path:
    """Where a file that is missing would be: beside others of its kind, else of its recording."""
    beside = [p for (_, k), p in files.items() if k == kind] + [p for (r, _), p in files.items() if r == recording]
    return beside[0].with_name(f"{recording:02d}_{kind}.csv")


def find_files(data: Path) -> Files:
    """All files of recordings in a folder. Where not all three kinds lie there, the folders below it are searched.

    Raises InputError if there are none, or if a kind lies in more than one folder, so that somebody has to choose.
    """
    if not data.is_dir():
        raise fault(data, "not a folder")
    if not os.access(data, os.R_OK | os.X_OK):
        raise fault(data, "may not be read")
    own = _files_in(data)
    if _kinds(own) == set(KINDS):
        return own
    found = {data: own} | {folder: _files_in(folder) for folder in _folders_below(data)}
    found = {folder: files for folder, files in found.items() if files}
    if not found:
        raise fault(data, "no file named like 01_tracks.csv, here or in a folder below" + _foreign(data))
    if sum(len(_kinds(files)) for files in found.values()) > len(set().union(*map(_kinds, found.values()))):
        more = f", and {len(found) - 2} more" if len(found) > 2 else ""
        first, second = list(found)[:2]
        raise fault(data, f"recordings lie in {first} and in {second}{more}: give one of these folders")
    return {key: path for files in found.values() for key, path in files.items()}


def any_in(data: Path) -> bool:
    """Whether a folder, or one below it, holds a file named like a recording's."""
    return any(_files_in(folder) for level in folders_from(data) for folder in level)


def folders_from(data: Path) -> Iterator[list[Path]]:
    """A folder, then those below it, the nearest first, hidden ones left out; nothing if it is no folder."""
    if data.is_dir():
        yield [data]
        for folder in _folders_below(data):
            yield [folder]


def tables_of(
    data: Path, endings: tuple[str, ...], layout_of: Callable[[Path], Layout | None]
) -> dict[Path, Layout]:
    """The tables of a folder that are of a format; if there is none, of the nearest folder below that has any.

    endings: of the files' names; layout_of: how a table is written, None of one in another format.
    """
    for level in folders_from(data):
        readable = (folder for folder in level if os.access(folder, os.R_OK | os.X_OK))
        paths = (path for folder in readable for path in sorted(folder.iterdir()))
        tables = (path for path in paths if path.suffix.lower() in endings and path.is_file())
        found = {path: layout for path in tables if (layout := layout_of(path)) is not None}
        if found:
            return found
    return {}


def _kinds(files: Files) -> set[str]:
    return {kind for _, kind in files}


def _files_in(folder: Path) -> Files:
    """Of several files for the same, a plain one before a packed one, and 01 before 1 and 001."""
    best: dict[tuple[int, str], tuple[bool, bool, bool, Path]] = {}
    for path in _listed(folder):
        if match := _FILE.fullmatch(path.name):
            key = int(match[1]), _KIND_OF[match[2].lower()]
            rank = not path.is_file(), match[3] is not None, match[1] != f"{key[0]:02d}", path
            best[key] = min(rank, best.get(key, rank))
    return {key: path for key, (*_, path) in best.items()}


def _listed(folder: Path) -> list[Path]:
    """What a folder holds, ascending; nothing if it may not be read."""
    try:
        return sorted(folder.iterdir())
    except OSError:
        return []


def _folders_below(data: Path) -> Iterator[Path]:
    """Folders below, the nearest first, hidden ones left out; links are followed, but nowhere twice."""
    level, known = [data], {data.resolve()}
    for _ in range(_DEPTH):
        inner = [path for folder in level for path in _listed(folder) if path.is_dir()]
        level = []
        for path in inner:
            if not path.name.startswith((".", "__")) and (place := path.resolve()) not in known:
                known.add(place)
                level.append(path)
        yield from level


def _foreign(data: Path) -> str:
    """What there is instead, as an end of a sentence."""
    for path in _listed(data):
        if path.suffix.lower() in _PACKED:
            return f"; there is {path.name}: unpack it"
        if path.suffix.lower() in _TABLES and path.is_file():
            try:
                text = lookalike(first_line(path))
            except InputError:
                continue
            return f"; there is {path.name}" + (f", which looks like {text}" if text else "")
    return ""
