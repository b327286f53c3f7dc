"""What the command line says before any stage runs."""

from importlib.metadata import version
from pathlib import Path

import pytest
from typer.testing import CliRunner

from highd_lc import cli


def test_version_is_told():
    found = CliRunner().invoke(cli.app, ["--version"])
    assert (found.exit_code, found.stdout) == (0, f"highd-lc {version('highd-lc')}\n")


@pytest.mark.parametrize(
    "names", [(), (".DS_Store",), (".gitkeep", "README.md"), ("readme.txt", "Thumbs.db"), (".a/",)]
)
def test_a_folder_that_holds_nothing_of_somebody_s_counts_as_empty(tmp_path, monkeypatch, names):
    monkeypatch.chdir(tmp_path)
    Path("data/highd").mkdir(parents=True)
    for name in names:
        (Path("data/highd") / name).touch()
    assert cli._data(None) is None


@pytest.mark.parametrize("name", ["01_tracks.csv", "highD-dataset-v1.0", "notes.txt"])
def test_a_folder_that_holds_anything_else_is_used(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    Path("data/highd").mkdir(parents=True)
    (Path("data/highd") / name).touch()
    assert cli._data(None) == Path("data/highd")
