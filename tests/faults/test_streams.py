"""Streams that are closed, left or of another encoding, and odd names: no traceback, the right exit code."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from faulty_runs import Place, copy_of_fixtures

_LONG = bool(os.environ.get("HIGHD_LC_FAULTS"))
_COMMAND = [sys.executable, "-c", "from highd_lc.cli import main; main()"]
_ASCII = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0", "PYTHONIOENCODING": "ascii"}


def _shell(line: str, *arguments: object, **variables: str) -> subprocess.CompletedProcess[bytes]:
    """A line of bash in which "$@" is the command."""
    command = ["bash", "-c", f"set -o pipefail; {line}", "bash", *_COMMAND, *map(os.fspath, arguments)]
    done = subprocess.run(command, capture_output=True, env=os.environ | variables)
    assert b"Traceback" not in done.stderr
    assert b"Error" not in done.stderr
    return done


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ('"$@" >&-', 0),
        ('"$@" >&- 2>&-', 0),
        ('"$@" <&- >&- 2>&-', 0),
        ('"$@" | true', 0),
        ('"$@" > /dev/full', 2),
    ],
)
def test_what_cannot_be_written_ends_no_command(undisturbed: Place, line: str, code: int) -> None:
    shown = next((undisturbed.reports / "events").glob("*.html")).stem
    assert _shell(line, "show", shown, "--work", undisturbed.work).returncode == code
    if code == 0:
        assert _shell(line, "show", "99-0000-00000", "--work", undisturbed.work).returncode == 2


@pytest.mark.parametrize("line", ['"$@" >&-', '"$@" | head -c 1'])
def test_a_run_nobody_listens_to_does_its_work(tmp_path: Path, line: str) -> None:
    place = Place(tmp_path)
    done = _shell(line, *place.arguments("--workers", "2", stage="extract")[1:])
    assert done.returncode == 0
    assert (place.work / "events.parquet").exists()


@pytest.mark.parametrize(
    ("name", "variables"),
    [
        (b"l\xe4nge", _ASCII),
        ("速度 ☃".encode(), _ASCII),
        ("länge".encode(), {"PYTHONIOENCODING": "ascii"}),
        *([(b"l\xe4nge", {}), ("länge".encode(), _ASCII)] if _LONG else []),
    ],
)
def test_a_name_that_the_encoding_lacks_is_a_name(tmp_path: Path, name: bytes, variables: dict[str, str]) -> None:
    place = Place(Path(os.fsdecode(os.fsencode(tmp_path) + b"/" + name)))
    place = Place(place.root, data=copy_of_fixtures(place.root / "data"))
    done = _shell('"$@"', *place.arguments("--workers", "1", stage="extract")[1:], **variables)
    assert done.returncode == 0, done.stderr
    assert (place.work / "events.parquet").exists()
    shutil.rmtree(place.data)
    done = _shell('"$@"', *place.arguments(stage="extract")[1:], **variables)
    assert done.returncode == 2
    assert b"not a folder" in done.stderr


@pytest.mark.parametrize("event", [b"\xe4", "99-0000-0000☃".encode()])
def test_an_event_that_is_no_text_is_not_there(undisturbed: Place, event: bytes) -> None:
    done = _shell('"$@"', "show", event, "--work", undisturbed.work, **_ASCII)
    assert done.returncode == 2
    assert b"no lane-id change" in done.stderr
