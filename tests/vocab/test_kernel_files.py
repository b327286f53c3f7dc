"""A kernel's files that are torn, foreign or locked cost a compilation: no error, and never another result."""

import importlib.util
import threading
from pathlib import Path

import numba
import pytest
from filelock import FileLock

from highd_lc.vocab import compile_cache

_SOURCE = "def thrice(x):\n    return 3.0 * x\n"


def _module(folder: Path):
    (folder / "source.py").write_text(_SOURCE)
    spec = importlib.util.spec_from_file_location("source", folder / "source.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def thrice(tmp_path_factory):
    """Calls the kernel as a new process would: its result, and whether it came from the cache."""
    folder = tmp_path_factory.mktemp("kernel")
    module = _module(folder)

    def call() -> tuple[float, bool]:
        kernel = numba.njit(cache=True)(module.thrice)
        return kernel(14.0), sum(kernel.stats.cache_hits.values()) == 1

    call.cache = folder / "cache"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(numba.config, "CACHE_DIR", str(call.cache))
        assert call() == (42.0, False)
        assert call() == (42.0, True)
        yield call


def _file(thrice, kind: str) -> Path:
    (found,) = thrice.cache.rglob(f"*.{kind}")
    return found


def _flipped(content: bytes) -> bytes:
    middle = len(content) // 2
    return content[:middle] + bytes([content[middle] ^ 0xFF]) + content[middle + 1 :]


_FAULTS = {
    "empty": lambda content: b"",
    "half": lambda content: content[: len(content) // 2],
    "one byte short": lambda content: content[:-1],
    "garbage": lambda content: b"\x80\x05garbage" * 40,
    "text": lambda content: b"<html>not found</html>",
    "other pickle": lambda content: b"N.",
}


@pytest.mark.parametrize("fault", _FAULTS)
@pytest.mark.parametrize("kind", ["nbc", "nbi"])
def test_a_spoilt_file_is_made_anew(thrice, kind, fault):
    path = _file(thrice, kind)
    path.write_bytes(_FAULTS[fault](path.read_bytes()))
    assert thrice() == (42.0, False)
    assert thrice() == (42.0, True)


def test_machine_code_with_a_wrong_bit_is_not_run(thrice):
    path = _file(thrice, "nbc")
    path.write_bytes(_flipped(path.read_bytes()))
    assert thrice() == (42.0, False)
    assert thrice() == (42.0, True)


@pytest.mark.parametrize("kind", ["nbc", "nbi"])
def test_what_cannot_be_read_or_replaced_is_done_without(thrice, kind):
    path = _file(thrice, kind)
    content = path.read_bytes()
    path.unlink()
    path.mkdir()
    assert thrice() == (42.0, False)
    path.rmdir()
    path.write_bytes(content)
    thrice()  # what was compiled in between may be of another index
    assert thrice() == (42.0, True)


def test_what_another_process_compiles_is_waited_for(thrice):
    kept = {path: path.read_bytes() for path in (_file(thrice, "nbc"), _file(thrice, "nbi"))}
    for path in kept:
        path.unlink()
    turn = FileLock(f"{_index(kept)}.lock", thread_local=False)

    def compiled_by_the_other() -> None:
        for path, content in kept.items():
            path.write_bytes(content)
        turn.release()

    turn.acquire()
    threading.Timer(0.3, compiled_by_the_other).start()
    assert thrice() == (42.0, True)


def test_another_process_that_never_ends_is_not_waited_for(thrice, monkeypatch):
    monkeypatch.setattr(compile_cache, "_LONGEST_TURN", 0.05)
    index = _file(thrice, "nbi")
    index.unlink()
    turn = FileLock(f"{index}.lock", thread_local=False)
    other = threading.Thread(target=turn.acquire)
    other.start()
    other.join()
    assert thrice() == (42.0, False)
    turn.release()
    assert thrice() == (42.0, True)


def _index(paths) -> Path:
    (found,) = (path for path in paths if path.suffix == ".nbi")
    return found


@pytest.mark.parametrize(("one", "other"), [(14, 14.5), (14.5, 14), (14.5, 1.5 + 2j), (True, 14.5)])
def test_signatures_compiled_at_once_by_two_processes_are_kept_apart(tmp_path, monkeypatch, one, other):
    """The second process writes its files while the first, which saw the same empty index, is at its own."""
    module = _module(tmp_path)
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "cache"))

    def kernel():
        return numba.njit(cache=True)(module.thrice)

    files = type(kernel()._cache._cache_file)
    usual = files._save_data

    def save_data(self, name, data):
        monkeypatch.setattr(files, "_save_data", usual)
        assert kernel()(other) == 3.0 * other
        usual(self, name, data)

    with monkeypatch.context() as patch:
        patch.setattr(files, "_load_index", lambda self: {})
        monkeypatch.setattr(files, "_save_data", save_data)
        assert kernel()(one) == 3.0 * one
    for value in (one, other, one, other):
        assert kernel()(value) == 3.0 * value
    kept = kernel()
    assert (kept(one), kept(other)) == (3.0 * one, 3.0 * other)
    assert sum(kept.stats.cache_hits.values()) == 2
