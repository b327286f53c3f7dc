"""The command line's streams: what it prints on, how signals end it, where tracebacks go."""

import json
import logging
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

from rich.console import Console

from highd_lc.vocab.errors import InterruptedRunError

PLAIN: Final[dict[str, Any]] = {"markup": False, "highlight": False, "soft_wrap": True}
"""How text is printed that is not ours to decorate or to break."""


def open_closed_streams() -> None:
    """Give closed standard streams a place: the next file opened would get their number, and their text."""
    while (descriptor := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(descriptor, True)
    os.close(descriptor)
    sys.stdout = sys.stdout or open(1, "w", closefd=False)  # noqa: SIM115
    sys.stderr = sys.stderr or open(2, "w", closefd=False)  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # no test's stand-in has
            # A name that the encoding lacks, or that is none in any encoding, is shown by its codes.
            stream.reconfigure(errors="backslashreplace")


class PatientConsole(Console):
    """A console that survives a closed pipe: the rest of its text is dropped, work and exit code stay."""

    def on_broken_pipe(self) -> None:
        """Write to nowhere from here on."""
        self.quiet = True
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self.file.fileno())
        os.close(nowhere)


# Without a terminal (make, CI, a log) the width is fixed, so that tables are not cut.
console = PatientConsole(width=None if sys.stdout and sys.stdout.isatty() else 100)
errors = PatientConsole(stderr=True, soft_wrap=True, highlight=False)


def print_json(values: Any) -> None:
    """JSON alone on the standard output, whatever the terminal's width."""
    console.print(json.dumps(values, indent=1), **PLAIN)


class _ToStandardError(logging.Handler):
    """Prints on whatever the standard error is at that moment."""

    def emit(self, record: logging.LogRecord) -> None:
        errors.print(self.format(record), **PLAIN)


def show_tracebacks(wanted: bool) -> None:
    """Show the tracebacks of all errors on the standard error, or leave them to the log."""
    log = logging.getLogger("highd_lc")
    log.handlers = [_ToStandardError()] if wanted else []
    log.setLevel(logging.DEBUG if wanted else logging.WARNING)


class _TerminatedError(KeyboardInterrupt):
    """SIGTERM. No ``except Exception`` on the way takes it for a fault of a recording."""


def _terminate(_signal: int, _frame: object) -> None:
    raise _TerminatedError


@contextmanager
def signals_as_errors() -> Iterator[None]:
    """Turn SIGINT and SIGTERM into errors with a message and the shell's exit code."""
    before = signal.signal(signal.SIGTERM, _terminate)
    try:
        yield
    except KeyboardInterrupt as error:
        what, number = ("terminated", 15) if isinstance(error, _TerminatedError) else ("interrupted", 2)
        text = f"{what}; what was finished is kept: the same command continues from there"
        raise InterruptedRunError(text, 128 + number) from error
    finally:
        signal.signal(signal.SIGTERM, before)
