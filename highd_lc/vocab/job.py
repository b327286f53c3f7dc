"""What a stage is handed: one recording to work on, or all finished parts to combine.

And what it gives back when it has done a large part: memory.
"""

import contextlib
import ctypes
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, TypeAlias

from highd_lc.vocab.settings import Settings

ALL: Final = -1

CarryOut: TypeAlias = Callable[[Sequence[Callable[[], bytes]]], list[bytes]]
"""A way to carry out calls that do not depend on each other: their results, in the calls' order."""


def one_by_one(calls: Sequence[Callable[[], bytes]]) -> list[bytes]:
    """The plainest ``CarryOut``."""
    return [call() for call in calls]


def give_back_memory() -> None:
    """Return freed memory to the system; after large tables it is gigabytes.

    Arrow keeps what it has freed for the next table, and glibc what lies below something that is still in use.
    """
    with contextlib.suppress(AttributeError):  # not imported as a whole
        if "pyarrow" in sys.modules:
            sys.modules["pyarrow"].default_memory_pool().release_unused()
    with contextlib.suppress(OSError, AttributeError, TypeError):  # another C library
        ctypes.CDLL(None).malloc_trim(0)


@dataclass(frozen=True)
class Provenance:
    """Where an artefact comes from; it travels in the artefact's metadata.

    settings: hash of the settings; inputs: hash of each input; seed: of the run; code: version of the code.
    """

    settings: str
    inputs: dict[str, str]
    seed: int
    code: str


@dataclass(frozen=True)
class Job:
    """One recording for one stage. data: folder of the CSVs; work: folder of the artefacts."""

    recording: int
    data: Path
    work: Path
    settings: Settings
    provenance: Provenance


@dataclass(frozen=True)
class Combination:
    """All parts of a stage, to be turned into its artefacts. recordings: those whose parts are finished."""

    recordings: tuple[int, ...]
    work: Path
    settings: Settings
    provenance: Provenance


@dataclass(frozen=True)
class Problem:
    """Something that was skipped and why: shown at the end, exit code 4.

    warning: nothing was skipped, it is only told; lost: the whole recording was, and the message says why.
    """

    recording: int
    stage: str
    message: str
    warning: bool = False
    lost: bool = False


@dataclass(frozen=True)
class JobReport:
    """What a job did: counts for the log, problems for the user."""

    counts: dict[str, int] = field(default_factory=dict)
    problems: tuple[Problem, ...] = ()


@dataclass(frozen=True)
class ReportRequest:
    """What of a report is wanted.

    reports: folder to write to. events: ids of the events that get a page; None = all, and the overview pages.
    pictures: ids of the events that get a PNG; None = all. vector: further formats, "pdf", "svg", "gif".
    recordings: those that hold such an event; None = all, and no other is to be touched.
    """

    reports: Path
    events: frozenset[str] | None = None
    pictures: frozenset[str] | None = None
    vector: tuple[str, ...] = ()
    recordings: frozenset[int] | None = None

    def leaves_alone(self, recording: int) -> bool:
        """Whether no event of the recording gets a page."""
        return self.recordings is not None and recording not in self.recordings


@dataclass(frozen=True)
class Options:
    """Where a run reads and writes, and how it is carried out.

    data: folder of the CSVs, None = recordings that are synthesized into the work folder; workers: local
    processes; scheduler: address of a Dask scheduler instead; verify: hash inputs and finished files again;
    strict: any bad recording ends the run; events: ids whose pages are wanted, none = all; vector: further
    formats of the pictures.
    """

    data: Path | None
    work: Path
    reports: Path
    workers: int = 2
    scheduler: str | None = None
    verify: bool = False
    strict: bool = False
    events: tuple[str, ...] = ()
    vector: tuple[str, ...] = ()


@dataclass
class Outcome:
    """What a run did: problems to list, counts by stage."""

    problems: list[Problem] = field(default_factory=list)
    counts: dict[str, dict[str, int]] = field(default_factory=dict)
