"""Compiled kernels are cached in a folder of their own version of the code."""

import os

import pytest

from highd_lc.vocab import compile_cache


@pytest.fixture
def package(tmp_path):
    for layer in ("core", "algorithms", "vocab"):
        (tmp_path / layer).mkdir()
        (tmp_path / layer / "one.py").write_text(f"# {layer}\n")
    return tmp_path


def test_any_changed_source_gives_another_folder(package):
    before = compile_cache._digest(package)
    assert compile_cache._digest(package) == before
    (package / "core" / "one.py").write_text("# changed\n")
    assert compile_cache._digest(package) != before


def test_a_folder_chosen_by_the_user_stays(monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", "mine")
    compile_cache.use_cache_of_this_code()
    assert os.environ["NUMBA_CACHE_DIR"] == "mine"


def test_numba_uses_the_folder_of_this_code():
    from numba import config

    assert os.environ["NUMBA_CACHE_DIR"] == config.CACHE_DIR


def test_a_read_only_package_falls_back_to_the_users_cache(monkeypatch, tmp_path):
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert compile_cache._writable(tmp_path / "package" / "__pycache__") == tmp_path / "highd_lc"
