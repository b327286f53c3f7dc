"""The formats of recordings that can be read: one protocol, one module a format, chosen by what a folder holds."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Protocol

from highd_lc.io import highd_files, ngsim_files, tgsim_files
from highd_lc.io.highd_csv import fault, first_line, lookalike
from highd_lc.vocab.errors import InputError
from highd_lc.vocab.settings import IngestSettings

if TYPE_CHECKING:
    from highd_lc.io.highd import Recording
    from highd_lc.io.highd_tables import RecordingMeta

AUTO = "auto"


class Format(Protocol):
    """A way in which somebody publishes recordings. All conventions of a format stay in its modules."""

    name: str
    columns: ClassVar[Mapping[str, str]]
    """Of HighD's columns, those of the file that take their place, where their names differ."""

    def found_in(self, data: Path) -> bool:
        """Whether a folder, or one below it, holds a file of this format."""

    def discover(self, data: Path) -> list[int]:
        """Numbers of the recordings, ascending. Raises InputError if there is none."""

    def folders(self, data: Path) -> list[Path]:
        """The folders in which the files were found."""

    def remarks(self, data: Path) -> list[str]:
        """What of the folder is left out, and why, in words."""

    def input_files(self, data: Path, recording: int) -> tuple[Path, Path, Path]:
        """The files that tell of the recording, of its vehicles and of its tracks; they may be one."""

    def read(self, data: Path, recording: int, settings: IngestSettings) -> "Recording":
        """Read a recording into road coordinates. Raises InputError naming file, column and row of a fault."""

    def read_meta(self, data: Path, recording: int, settings: IngestSettings) -> "RecordingMeta":
        """Its frame rate and markings. Raises InputError."""


class _HighD:
    """HighD: three CSV files a recording (see ``io.highd``)."""

    name = "highd"
    columns: ClassVar[Mapping[str, str]] = {}

    def found_in(self, data: Path) -> bool:
        return bool(highd_files.any_in(data))

    def discover(self, data: Path) -> list[int]:
        return highd_files.discover(data)

    def folders(self, data: Path) -> list[Path]:
        return highd_files.folders(data)

    def remarks(self, data: Path) -> list[str]:
        return []

    def input_files(self, data: Path, recording: int) -> tuple[Path, Path, Path]:
        return highd_files.input_files(data, recording)

    def read(self, data: Path, recording: int, settings: IngestSettings) -> "Recording":
        from highd_lc.io import highd

        return highd.read_recording(data, recording)

    def read_meta(self, data: Path, recording: int, settings: IngestSettings) -> "RecordingMeta":
        from highd_lc.io.highd_tables import read_recording_meta

        return read_recording_meta(highd_files.input_files(data, recording)[0])


class _Ngsim:
    """NGSIM as US DOT publishes it: one file with all columns, one or several periods in it (see ``io.ngsim``)."""

    name = "ngsim"
    columns: ClassVar[Mapping[str, str]] = ngsim_files.PLACE_OF

    def found_in(self, data: Path) -> bool:
        return bool(ngsim_files.find_files(data))

    def discover(self, data: Path) -> list[int]:
        return list(range(1, 1 + len(ngsim_files.periods(data))))

    def folders(self, data: Path) -> list[Path]:
        return sorted({path.parent for path in ngsim_files.find_files(data)})

    def remarks(self, data: Path) -> list[str]:
        return ngsim_files.left_out(data)

    def input_files(self, data: Path, recording: int) -> tuple[Path, Path, Path]:
        path = ngsim_files.period(data, recording).path
        return path, path, path

    def read(self, data: Path, recording: int, settings: IngestSettings) -> "Recording":
        from highd_lc.io import ngsim

        return ngsim.read_recording(ngsim_files.period(data, recording), recording, settings.ngsim_smoothing)

    def read_meta(self, data: Path, recording: int, settings: IngestSettings) -> "RecordingMeta":
        return self.read(data, recording, settings).meta


class _Tgsim:
    """TGSIM as US DOT publishes it: a file a site, one or several runs in it (see ``io.tgsim``)."""

    name = "tgsim"
    columns: ClassVar[Mapping[str, str]] = tgsim_files.PLACE_OF

    def found_in(self, data: Path) -> bool:
        return bool(tgsim_files.find_files(data))

    def discover(self, data: Path) -> list[int]:
        return list(range(1, 1 + len(tgsim_files.runs(data))))

    def folders(self, data: Path) -> list[Path]:
        return sorted({path.parent for path in tgsim_files.find_files(data)})

    def remarks(self, data: Path) -> list[str]:
        return tgsim_files.left_out(data)

    def input_files(self, data: Path, recording: int) -> tuple[Path, Path, Path]:
        path = tgsim_files.run(data, recording).path
        return path, path, path

    def read(self, data: Path, recording: int, settings: IngestSettings) -> "Recording":
        from highd_lc.io import tgsim

        return tgsim.read_recording(tgsim_files.run(data, recording), recording)

    def read_meta(self, data: Path, recording: int, settings: IngestSettings) -> "RecordingMeta":
        return self.read(data, recording, settings).meta


class _Exid:
    """exiD: recognised, and refused with what is missing; its files are named as HighD's are."""

    name = "exid"
    columns: ClassVar[Mapping[str, str]] = {}

    def found_in(self, data: Path) -> bool:
        return any(lookalike(first_line(path)).startswith("one of exiD") for path in _tracks_in(data)[:1])

    def _refused(self, data: Path) -> InputError:
        return fault(
            data,
            "looks like exiD, which cannot be read: its lanes are ids of a lanelet map and its coordinates go "
            "round bends and ramps: neither lanes side by side nor places along the road are in the files; "
            "expected is highd, ngsim or tgsim",
        )

    def discover(self, data: Path) -> list[int]:
        raise self._refused(data)

    def folders(self, data: Path) -> list[Path]:
        raise self._refused(data)

    def remarks(self, data: Path) -> list[str]:
        raise self._refused(data)

    def input_files(self, data: Path, recording: int) -> tuple[Path, Path, Path]:
        raise self._refused(data)

    def read(self, data: Path, recording: int, settings: IngestSettings) -> "Recording":
        raise self._refused(data)

    def read_meta(self, data: Path, recording: int, settings: IngestSettings) -> "RecordingMeta":
        raise self._refused(data)


def _tracks_in(data: Path) -> list[Path]:
    """The files of tracks that are named as HighD's are."""
    try:
        found = highd_files.find_files(data)
    except InputError:
        return []
    return [path for (_, kind), path in found.items() if kind == "tracks"]


HIGHD: Format = _HighD()
EXID: Format = _Exid()
FORMATS: dict[str, Format] = {known.name: known for known in (HIGHD, _Ngsim(), _Tgsim(), EXID)}
"""By the name that the setting ``ingest.format`` and the option ``--format`` take."""


def format_of(data: Path, name: str) -> Format:
    """The format of a folder's recordings: the one of that name; of ``auto`` the first that the folder holds.

    A folder that holds none is HighD's: its error says what the folder looks like. Raises InputError if the
    folder holds nothing of the format that is asked for.
    """
    if name == AUTO:
        # exiD's files are named as HighD's are: it is looked for first, to be refused with what is missing.
        return next((known for known in (EXID, *FORMATS.values()) if known.found_in(data)), HIGHD)
    if name != HIGHD.name and not FORMATS[name].found_in(data):
        raise fault(data, f"no file of the format {name}, here or in a folder below")
    return FORMATS[name]


def in_words_of(known: Format, text: str) -> str:
    """A text that names HighD's columns, with the names of a format's own; width and height are words in it."""
    return re.sub(r"\b(?!width\b|height\b)\w+\b", lambda word: known.columns.get(word[0], word[0]), text)
