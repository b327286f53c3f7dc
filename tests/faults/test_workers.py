"""Workers, signals and order: nothing of them shows in the artefacts."""

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from faulty_runs import Place, contents, descendants, run
from rich.console import Console
from shared_runs import QUICK

from highd_lc import engine, execution
from highd_lc.execution import InProcess, LocalProcesses
from highd_lc.io import settings
from highd_lc.io.workspace import Inputs, find_inputs
from highd_lc.stage_run import _carry_out
from highd_lc.vocab.errors import StorageError, WorkerLostError
from highd_lc.vocab.job import Options

_LONG = bool(os.environ.get("HIGHD_LC_FAULTS"))


@pytest.mark.parametrize("workers", [2, 4] if _LONG else [2])
def test_artefacts_do_not_depend_on_how_many_work(undisturbed: Place, tmp_path: Path, workers: int) -> None:
    place = Place(tmp_path)
    code, said = run(place, "--workers", str(workers))
    assert code == 0, said
    assert contents(place) == contents(undisturbed)


def test_artefacts_do_not_depend_on_the_order_of_recordings(
    undisturbed: Place, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place, order = Place(tmp_path), list[int]()

    def turned_round(*arguments: object, **options: object) -> Inputs:
        inputs = find_inputs(*arguments, **options)
        order.extend(reversed(inputs.files))
        return replace(inputs, files={recording: inputs.files[recording] for recording in order})

    monkeypatch.setattr(engine, "find_inputs", turned_round)
    options = Options(place.data, place.work, place.reports, workers=1)
    engine.run(settings.load(QUICK), options, last="validate", console=Console(quiet=True))
    assert order == [1, 2]  # 02 is the larger one
    assert "work/losses.parquet" in contents(place)
    assert contents(place).items() <= contents(undisturbed).items()


def _value(number: int) -> int:
    return number * number


def _die(alone: Path) -> int:
    """Ends its process the first time, and the second if the file says so."""
    again = alone.exists()
    alone.touch()
    if not again or alone.read_text():
        os.kill(os.getpid(), signal.SIGKILL)
    return -1


def _outcomes(calls: dict[int, Callable[[], int]]) -> dict[int, object]:
    found: dict[int, object] = {}
    with LocalProcesses(2, preload=[]) as execution:
        for number, result in execution.results(calls):
            try:
                found[number] = result()
            except (WorkerLostError, ZeroDivisionError) as error:
                found[number] = error
    return found


def test_a_lost_worker_costs_nothing(tmp_path: Path) -> None:
    calls = {n: partial(_value, n) for n in range(6)} | {2: partial(_die, tmp_path / "met")}
    assert _outcomes(calls) == {0: 0, 1: 1, 2: -1, 3: 9, 4: 16, 5: 25}


def test_who_loses_every_worker_is_given_up_alone(tmp_path: Path) -> None:
    (tmp_path / "met").write_text("again")
    calls = {n: partial(_value, n) for n in range(6)} | {2: partial(_die, tmp_path / "met")}
    found = _outcomes(calls)
    assert {n: value for n, value in found.items() if n != 2} == {0: 0, 1: 1, 3: 9, 4: 16, 5: 25}
    assert isinstance(found[2], WorkerLostError)
    assert "recording 02" in str(found[2])


def test_errors_come_back_as_they_are() -> None:
    calls = {1: partial(divmod, 1, 0), 2: partial(_value, 2)}
    found = _outcomes(calls)
    assert isinstance(found[1], ZeroDivisionError)
    assert found[2] == 4
    assert {n: result() for n, result in InProcess().results({3: partial(_value, 3)})} == {3: 9}


def _started(place: Place, until: str) -> subprocess.Popen[str]:
    """The command line in a session of its own, once it has begun a stage."""
    # A shell that runs the tests in the background makes them ignore SIGINT, and their children with them.
    listen = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    program = [sys.executable, "-c", f"{listen}; from highd_lc.cli import main; main()"]
    process = subprocess.Popen(
        program + place.arguments("--workers", "2")[1:],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    while not (place.work / "parts" / until).exists():
        assert process.poll() is None, process.communicate()[1]
        time.sleep(0.01)
    return process


def _survivors(session: int) -> list[int]:
    """Processes of a session that are there after ten seconds."""
    for _ in range(200):
        if not descendants(session):
            break
        time.sleep(0.05)
    return descendants(session)


@pytest.mark.parametrize(
    ("which", "code", "word"), [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 143, "terminated")]
)
def test_a_signal_ends_a_run_with_a_word(
    undisturbed: Place, tmp_path: Path, which: int, code: int, word: str
) -> None:
    place = Place(tmp_path)
    process = _started(place, "extract")
    # As a terminal does it for Ctrl-C: to everybody; as a scheduler does it for SIGTERM: to the one it started.
    os.killpg(process.pid, which) if which == signal.SIGINT else process.send_signal(which)
    _, said = process.communicate(timeout=60)
    assert process.returncode == code, said
    assert said.startswith(f"highd-lc: {word}")
    assert len(said.splitlines()) == 1
    assert _survivors(process.pid) == []
    assert not list(place.root.rglob("*.tmp"))
    assert run(place, "--workers", "1", stage="extract")[0] == 0
    assert "work/events.parquet" in contents(place)
    assert contents(place).items() <= contents(undisturbed).items()


def test_a_killed_run_leaves_no_processes(tmp_path: Path) -> None:
    process = _started(Place(tmp_path), "ingest")
    process.kill()
    process.communicate()
    assert _survivors(process.pid) == []


def _page(number: int) -> bytes:
    return str(number).encode()


def _die_anyway() -> bytes:
    os.kill(os.getpid(), signal.SIGKILL)
    return b""


def test_pages_come_back_in_the_order_of_their_calls() -> None:
    with LocalProcesses(2, preload=[]) as execution:
        assert _carry_out(execution, [partial(_page, n) for n in range(5)]) == [b"0", b"1", b"2", b"3", b"4"]


def test_a_page_that_ends_its_process_is_not_taken_for_a_recording() -> None:
    with LocalProcesses(2, preload=[]) as execution, pytest.raises(WorkerLostError, match=r"^overview pages"):
        _carry_out(execution, [partial(_page, 1), _die_anyway])


_ECHO = """
from functools import partial
from highd_lc.execution import LocalProcesses
if __name__ == "__main__":
    with LocalProcesses(2, preload=[]) as execution:
        print([result() for _, result in execution.results({1: partial(abs, -1)})])
"""


@pytest.mark.parametrize("length", [75, 76])
def test_a_temporary_folder_may_have_any_length(tmp_path: Path, length: int) -> None:
    with tempfile.TemporaryDirectory(dir="/tmp") as root:
        folder = Path(root, "x" * (length - len(root) - 1))
        folder.mkdir()
        program = tmp_path / "echo.py"
        program.write_text(_ECHO)
        environment = os.environ | {"TMPDIR": str(folder)}
        done = subprocess.run([sys.executable, program], env=environment, capture_output=True, text=True)
        assert (done.returncode, done.stdout) == (0, "[1]\n"), done.stderr
        assert list(folder.iterdir()) == []


def test_no_short_temporary_folder_is_told_with_the_variable_to_set(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", "/" + "x" * 90)
    monkeypatch.setattr(execution, "_SHORT_FOLDERS", ("/proc/nowhere",))
    with pytest.raises(StorageError, match=r"^TMPDIR=/x+: .* at most 75 bytes: name a shorter one"):
        LocalProcesses(2, preload=[])
