"""Errors that a user can act on. Each prints as one line and carries the exit code of the command."""


class HighdLcError(Exception):
    """Anything that ends a command with one line of explanation."""

    exit_code = 1


def told(about: str, error: Exception) -> str:
    """An error in one line: what it is about, its message, and its class if it is no ``HighdLcError``."""
    known = isinstance(error, HighdLcError)
    return " ".join(f"{about}: {'' if known else type(error).__name__ + ': '}{error}".split())


class SettingsError(HighdLcError):
    """A setting is unknown or out of range: names the file, the key and the allowed values."""

    exit_code = 2


class UsageError(HighdLcError):
    """The command was called wrongly: an unknown event, a folder that is no folder."""

    exit_code = 2


class InputError(HighdLcError):
    """An input file cannot be used: names the file, and the column and row where there are any."""

    exit_code = 3


class ArtefactError(HighdLcError):
    """An artefact of an earlier stage is missing, of another schema, or damaged."""

    exit_code = 3


class StorageError(HighdLcError):
    """A folder given for results cannot be used: full, read-only, not permitted. Names the file and the reason."""

    exit_code = 2


class ClusterError(HighdLcError):
    """The Dask cluster cannot be used: not reachable, other code, another file system, or lost."""

    exit_code = 2


class WorkerLostError(HighdLcError):
    """A worker process ended without an error message, and again when its work was repeated."""


class InterruptedRunError(HighdLcError):
    """A signal ended the run; what was finished is kept. exit_code: 128 + number of the signal."""

    def __init__(self, message: str, exit_code: int = 130) -> None:
        super().__init__(message, exit_code)
        self.exit_code = exit_code

    def __str__(self) -> str:
        return str(self.args[0])


class ShapeError(HighdLcError):
    """Arrays given to a function do not fit each other: names the array and its shape."""


class MissingExtraError(HighdLcError):
    """An optional dependency is not installed: names the extra that brings it."""

    exit_code = 2
