"""Kernels are compiled ahead where none are kept, by a process that ends with the run."""

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from highd_lc.api import compiling


@pytest.fixture
def started(monkeypatch):
    """The processes that are started."""
    found = []

    class Noted(subprocess.Popen):
        def __init__(self, *args, **options):
            super().__init__(*args, **options)
            found.append(self)

    monkeypatch.setattr(subprocess, "Popen", Noted)
    return found


def test_a_first_run_has_a_process_beside_it_that_ends_with_it(started, tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    with compiling.compiling_ahead():
        (process,) = started
        assert process.poll() is None
    assert process.poll() is not None


def test_it_ends_with_a_run_that_fails(started, tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    with pytest.raises(KeyError), compiling.compiling_ahead():
        raise KeyError("of the run")
    assert started[0].poll() is not None


@pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="processes are looked up in /proc")
def test_it_ends_with_a_run_that_is_killed(tmp_path):
    killed = """
import os, signal
from highd_lc.api.compiling import compiling_ahead
with compiling_ahead():
    os.kill(os.getpid(), signal.SIGKILL)
"""
    here = {"NUMBA_CACHE_DIR": str(tmp_path)}
    run = subprocess.run([sys.executable, "-c", killed], env=os.environ | here, timeout=60, check=False)
    assert run.returncode == -signal.SIGKILL
    until = time.monotonic() + 30.0
    while _running_with(str(tmp_path)) and time.monotonic() < until:
        time.sleep(0.1)
    assert not _running_with(str(tmp_path))


def _running_with(value: str) -> list[Path]:
    """Processes with a value in their environment."""
    found = []
    for place in Path("/proc").glob("[0-9]*/environ"):
        with suppress(OSError):
            found += [place] if value.encode() in place.read_bytes() else []
    return found


def test_nothing_is_started_where_kernels_are_kept(started, tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    (tmp_path / "kernel.nbc").write_bytes(b"")
    with compiling.compiling_ahead():
        assert not started


def test_its_small_scene_can_be_planned_and_tracked():
    """Nobody reads what the process says: an error would go unseen."""
    compiling.compile_planner()
