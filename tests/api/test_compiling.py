"""Kernels are compiled ahead where none are kept, by a process that ends with the run."""

import subprocess

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


def test_nothing_is_started_where_kernels_are_kept(started, tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    (tmp_path / "kernel.nbc").write_bytes(b"")
    with compiling.compiling_ahead():
        assert not started


def test_its_small_scene_can_be_planned_and_tracked():
    """Nobody reads what the process says: an error would go unseen."""
    compiling.compile_planner()
