"""Compiled kernels are cached in a folder of their own version of the code, wherever one can be written."""

import os
import sys
import tempfile
from pathlib import Path

import pytest

from highd_lc.vocab import compile_cache
from highd_lc.vocab.errors import StorageError


@pytest.fixture
def package(tmp_path):
    for layer in ("core", "planning", "vocab"):
        (tmp_path / layer).mkdir()
        (tmp_path / layer / "one.py").write_text(f"# {layer}\n")
    return tmp_path


@pytest.fixture
def nothing_chosen(monkeypatch):
    """No variable of the user's, and numba not to be told of what is tried here."""
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.delitem(sys.modules, "numba", raising=False)
    monkeypatch.setattr(compile_cache, "_trust_files", lambda: None)


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


def _only_below(folder: Path, monkeypatch) -> None:
    """Let nothing be written but below a folder."""
    usual = compile_cache._writable
    monkeypatch.setattr(compile_cache, "_writable", lambda place: folder in place.parents and usual(place))


@pytest.mark.parametrize(
    ("variable", "value", "place"),
    [
        ("XDG_CACHE_HOME", "xdg", "xdg/highd_lc"),
        ("HOME", "home", "home/.cache/highd_lc"),
        ("TMPDIR", "tmp", f"tmp/highd_lc-{os.getuid()}"),
    ],
)
def test_a_package_that_cannot_be_written_leaves_other_places(
    variable, value, place, monkeypatch, tmp_path, nothing_chosen
):
    for name in ("XDG_CACHE_HOME", "HOME", "TMPDIR"):
        monkeypatch.setenv(name, str(tmp_path / "nowhere" / name))
    (tmp_path / value).mkdir()
    monkeypatch.setenv(variable, str(tmp_path / value))
    monkeypatch.setattr(tempfile, "tempdir", None)
    _only_below(tmp_path / value, monkeypatch)
    compile_cache.use_cache_of_this_code()
    chosen = Path(os.environ["NUMBA_CACHE_DIR"])
    assert chosen.parent == tmp_path / place
    assert chosen.is_dir()
    compile_cache.require_cache()


@pytest.mark.parametrize("value", ["", "relative"])
def test_a_cache_home_that_is_no_absolute_path_is_ignored(value, monkeypatch, tmp_path, nothing_chosen):
    monkeypatch.setenv("XDG_CACHE_HOME", value)
    monkeypatch.setenv("HOME", str(tmp_path))
    _only_below(tmp_path, monkeypatch)
    compile_cache.use_cache_of_this_code()
    assert Path(os.environ["NUMBA_CACHE_DIR"]).parent == tmp_path / ".cache" / "highd_lc"


def test_kernels_are_not_read_from_a_folder_that_others_can_write_to(monkeypatch, tmp_path):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    assert list(compile_cache._temporary()) == [tmp_path / f"highd_lc-{os.getuid()}"]
    (tmp_path / f"highd_lc-{os.getuid()}").chmod(0o777)
    assert list(compile_cache._temporary()) == []


def test_no_place_at_all_is_told_with_the_variable_to_set(monkeypatch, nothing_chosen):
    monkeypatch.setattr(compile_cache, "_writable", lambda place: False)
    compile_cache.use_cache_of_this_code()
    assert not os.environ.get("NUMBA_CACHE_DIR")
    with pytest.raises(StorageError, match="name one by NUMBA_CACHE_DIR"):
        compile_cache.require_cache()


@pytest.mark.parametrize("place", ["/proc/kernels", "/dev/null", "/dev/null/kernels"])
def test_a_chosen_folder_that_cannot_be_written_is_told(place, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", place)
    with pytest.raises(StorageError, match=f"NUMBA_CACHE_DIR={place}: compiled kernels cannot be written there"):
        compile_cache.require_cache()
