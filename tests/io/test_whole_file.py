"""Files appear whole or not at all."""

import pytest

from highd_lc.io.atomic import whole_file


def break_off(path):
    with whole_file(path) as sink:
        sink.write(b"half")
        raise RuntimeError


def test_a_file_appears_when_the_block_ends(tmp_path):
    path = tmp_path / "new" / "file.bin"
    with whole_file(path) as sink:
        sink.write(b"all of it")
        assert not path.exists()
    assert path.read_bytes() == b"all of it"


def test_an_error_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "file.bin"
    path.write_bytes(b"old")
    with pytest.raises(RuntimeError):
        break_off(path)
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]
