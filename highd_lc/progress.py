"""How far a stage is: a bar on a terminal; elsewhere a line at its start, every 30 seconds and at its end."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final, Protocol

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
)
from rich.text import Text

from highd_lc.vocab.compile_cache import count_kernels

EVERY_S: Final = 30.0
"""Seconds between two lines where nobody sees a bar."""


def announce_compiling(console: Console) -> None:
    """Say that the work begins with compiling if no kernel of this version has been compiled yet."""
    if not count_kernels():
        text = "first use of this version: its kernels are compiled as they are needed"
        console.print(f"{text}, which takes 1 to 4 minutes more, once", highlight=False, soft_wrap=True)


class Shown(Protocol):
    """What is told of a stage's progress."""

    def advance(self) -> None:
        """Another recording is done."""

    def combine(self) -> None:
        """The recordings are done; what was made of them is being put together."""


@contextmanager
def shown(console: Console, stage: str, *, total: int, pending: int) -> Iterator[Shown]:
    """Show the progress of a stage while the block runs. total: recordings; pending: those with work to do."""
    if console.is_terminal:
        with _bar(console) as progress:
            yield _Bar(progress, stage, total, pending)
        return
    lines = _Lines(console, stage, pending)
    lines.begin(total)
    try:
        yield lines
    finally:
        lines.stop()
    lines.conclude()


class _Bar:
    """A bar on a terminal."""

    def __init__(self, progress: Progress, stage: str, total: int, pending: int) -> None:
        self._progress, self._stage = progress, stage
        self._task = progress.add_task(stage, total=total, completed=total - pending)

    def advance(self) -> None:
        self._progress.advance(self._task)

    def combine(self) -> None:
        self._progress.update(self._task, description=f"{self._stage}: tables")


class _Lines:
    """Lines in a log."""

    def __init__(self, console: Console, stage: str, pending: int) -> None:
        self._console, self._stage, self._pending = console, stage, pending
        self._done, self._combines, self._compiling = 0, False, _Compiling()
        self._started, self._ended = time.monotonic(), threading.Event()
        self._clock = threading.Thread(target=self._tell_regularly, daemon=True)

    def begin(self, total: int) -> None:
        finished = total - self._pending
        kept = f", {finished} up to date" if self._pending and finished else ""
        idle = "up to date" if total else "no recording that can be read"
        self._say(f"{_recordings(self._pending)} to do{kept}" if self._pending else idle)
        self._clock.start()

    def advance(self) -> None:
        self._done += 1

    def combine(self) -> None:
        self._combines = True

    def stop(self) -> None:
        self._ended.set()
        self._clock.join()

    def conclude(self) -> None:
        if self._pending or self._combines:
            self._say(f"{self._where()}, {self._seconds():.1f} s")

    def _tell_regularly(self) -> None:
        while not self._ended.wait(EVERY_S):
            doing = ", putting the tables together" if self._combines else ""
            first = ", compiling kernels" if self._compiling.since_last() else ""
            self._say(f"{self._where()}{doing}{first}, {self._seconds():.0f} s so far")

    def _where(self) -> str:
        return f"{self._done} of {_recordings(self._pending)}" if self._pending else "tables"

    def _seconds(self) -> float:
        return time.monotonic() - self._started

    def _say(self, text: str) -> None:
        self._console.print(f"{self._stage}: {text}", markup=False, highlight=False, soft_wrap=True)


def _recordings(count: int) -> str:
    return f"{count} recording{'s' * (count != 1)}"


class _Compiling(ProgressColumn):
    """Whether kernels are being compiled, as far as the files that are kept of them tell."""

    max_refresh = 5.0

    def __init__(self) -> None:
        super().__init__()
        self._kept = count_kernels()

    def since_last(self) -> bool:
        """Whether any has been compiled since this was asked last."""
        before, self._kept = self._kept, count_kernels()
        return self._kept > before

    def render(self, task: Task) -> Text:
        """What a bar says of it."""
        return Text("compiling kernels" if self.since_last() else "")


def _bar(console: Console) -> Progress:
    return Progress(
        TextColumn("{task.description:<10}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("recordings"),
        TimeElapsedColumn(),
        _Compiling(),
        console=console,
    )
