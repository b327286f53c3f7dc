import hashlib
from pathlib import Path

import pytest

from highd_lc.io import atomic
from highd_lc.vocab.errors import StorageError


def test_a_file_takes_the_place_of_the_old_one_when_it_is_complete(tmp_path: Path) -> None:
    path = tmp_path / "new" / "file"
    atomic.write_text(path, "old")
    with atomic.replacing(path) as sink:
        sink.write(b"new")
        sink.flush()
        assert path.read_text() == "old"
    assert path.read_text() == "new"
    assert list(path.parent.iterdir()) == [path]


def _close_too_early(path: Path) -> None:
    with atomic.replacing(path) as sink:
        sink.write(b"new")
        sink.close()


def test_what_fails_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "file"
    atomic.write_text(path, "old")
    with pytest.raises(ValueError, match="closed"):
        _close_too_early(path)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_the_ledger_tells_size_and_hash_of_what_was_written_inside(tmp_path: Path) -> None:
    atomic.write_text(tmp_path / "before", "x")
    with atomic.collected() as written:
        atomic.write_bytes(tmp_path / "inside", b"abc", durable=False)
    atomic.write_text(tmp_path / "after", "x")
    sha256 = hashlib.sha256(b"abc").hexdigest()[:16]
    assert written == [atomic.Written(tmp_path / "inside", 3, sha256)]
    assert atomic.content_hash(tmp_path / "inside") == sha256


def test_a_folder_that_is_a_file_is_an_error_with_the_path(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(StorageError, match=r"file/below: cannot be written: (File exists|Not a directory)"):
        atomic.write_text(tmp_path / "file" / "below", "x")


def test_only_unfinished_files_are_stale(tmp_path: Path) -> None:
    for name in (".file.0123abcd.tmp", "file.tmp", ".hidden", "file"):
        (tmp_path / "below").mkdir(exist_ok=True)
        (tmp_path / "below" / name).touch()
    atomic.remove_stale(tmp_path)
    assert {path.name for path in (tmp_path / "below").iterdir()} == {"file.tmp", ".hidden", "file"}
