"""Errors that a user can act on. Each prints as one line and carries the exit code of the command."""


class HighdLcError(Exception):
    """Anything that ends a command with one line of explanation."""

    exit_code = 1


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


class ShapeError(HighdLcError):
    """Arrays handed to a function do not fit each other: names the array and its shape."""


class MissingExtraError(HighdLcError):
    """An optional dependency is not installed: names the extra that brings it."""

    exit_code = 2
