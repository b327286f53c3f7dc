"""Progress where nobody sees a bar: a line at a stage's start, regularly, and at its end."""

import io
import time

import pytest
from rich.console import Console

from highd_lc import progress


def told(total: int, pending: int, work) -> list[str]:
    sink = io.StringIO()
    with progress.shown(Console(file=sink, width=200), "extract", total=total, pending=pending) as shown:
        work(shown)
    return sink.getvalue().splitlines()


def test_a_line_at_the_start_and_one_at_the_end():
    def work(shown):
        shown.advance()
        shown.advance()
        shown.combine()

    first, last = told(3, 2, work)
    assert first == "extract: 2 recordings to do, 1 up to date"
    assert last.startswith("extract: 2 of 2 recordings, ")


def test_what_is_up_to_date_is_one_line():
    assert told(3, 0, lambda shown: None) == ["extract: up to date"]
    assert len(told(3, 0, lambda shown: shown.combine())) == 2


def test_nothing_to_read_is_not_said_to_be_up_to_date():
    assert told(0, 0, lambda shown: None) == ["extract: no recording that can be read"]


def test_a_long_stage_is_told_of_while_it_lasts(monkeypatch):
    monkeypatch.setattr(progress, "EVERY_S", 0.01)

    def work(shown):
        shown.advance()
        time.sleep(0.2)
        shown.combine()
        time.sleep(0.2)

    lines = told(2, 2, work)
    assert any(line.startswith("extract: 1 of 2 recordings, ") and line.endswith("s so far") for line in lines)
    assert any("putting the tables together" in line for line in lines)


def test_an_error_ends_the_lines():
    sink = io.StringIO()
    with (
        pytest.raises(ZeroDivisionError),
        progress.shown(Console(file=sink), "extract", total=1, pending=1),
    ):
        raise ZeroDivisionError
    assert sink.getvalue() == "extract: 1 recording to do\n"


def test_a_terminal_shows_a_bar():
    sink = io.StringIO()
    console = Console(file=sink, force_terminal=True, color_system=None, width=100)
    with progress.shown(console, "extract", total=2, pending=1) as shown:
        shown.advance()
        shown.combine()
    assert "2/2 recordings" in sink.getvalue()
    assert "to do" not in sink.getvalue()


def announced(kernels, monkeypatch) -> str:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(kernels))
    sink = io.StringIO()
    progress.announce_compiling(Console(file=sink, width=80))
    return sink.getvalue()


def test_compiling_is_told_while_kernels_are_being_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(progress, "EVERY_S", 0.05)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))

    def work(shown):
        time.sleep(0.12)
        (tmp_path / "lcm.command-1.py312.0123.nbc").touch()
        time.sleep(0.2)

    lines = told(2, 2, work)
    assert ["compiling kernels" in line for line in lines].count(True) == 1


def test_compiling_is_announced_until_there_are_kernels(tmp_path, monkeypatch):
    said = announced(tmp_path, monkeypatch)
    assert said.startswith("first use of this version: its kernels are compiled")
    assert said.count("\n") == 1
    (tmp_path / "core_0123").mkdir()
    (tmp_path / "core_0123" / "lcm.command-1.py312.0123.nbc").touch()
    assert announced(tmp_path, monkeypatch) == ""
