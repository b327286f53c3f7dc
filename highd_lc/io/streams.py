"""Standard streams that a command can write to whatever they are: closed, a broken pipe, of another encoding."""

import os
import sys

from rich.console import Console


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
    """A console whose reader may leave: the rest of the text is dropped, the work and its exit code are not."""

    def on_broken_pipe(self) -> None:
        """Write to nowhere from here on."""
        self.quiet = True
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self.file.fileno())
        os.close(nowhere)
