"""highd-lc multiverse: the range and the table on the terminal, the page, and what is refused beforehand."""

import json
import sys

import pytest
from shared_runs import FIXTURES, QUICK, copied
from typer.testing import CliRunner

from highd_lc import cli

CHOICES = """
[[choices]]
name = "H"
keys = ["loss.horizon_s"]
values = [8.0]

[[choices]]
name = "aggregation"
keys = ["loss.aggregation"]
values = ["sum"]
"""


@pytest.fixture(scope="module")
def place(quick_run, tmp_path_factory):
    """The command's options on a copy of a finished run that has no page yet."""
    root = tmp_path_factory.mktemp("multiverse")
    copied(quick_run, root, reports=False)
    (root / "mine.toml").write_text(CHOICES)
    (root / "bad.toml").write_text(CHOICES.replace("8.0", "1.0"))
    folders = ["--data", FIXTURES, "--work", root / "work", "--reports", root / "reports"]
    pipeline = ["--pipeline", QUICK, "--workers", 1]
    return root, ["multiverse", *map(str, [*folders, *pipeline])]


def said(found):
    assert found.exit_code == 0, found.output
    return " ".join(found.stdout.split())


def test_it_ends_with_table_range_and_page(place):
    root, command = place
    words = said(CliRunner().invoke(cli.app, [*command, "--choices", str(root / "mine.toml"), "--sample", "3"]))
    assert "Over 3 defensible ways to ask the question of the same sample of 3 events" in words
    for name in ("H: 8", "aggregation: sum", "run"):
        assert name in words
    page = (root / "reports" / "multiverse.html").read_text()
    assert "Specification curve" in page
    assert "<svg" in page


def test_the_same_as_values(place):
    root, command = place
    options = ["--choices", str(root / "mine.toml"), "--sample", "3", "--json"]
    found = json.loads(CliRunner().invoke(cli.app, [*command, *options]).stdout)
    assert {row["variant"] for row in found["multiverse"]} == {"run", "H: 8", "aggregation: sum"}
    gains = [row["gain"] for row in found["multiverse"]]
    assert gains == sorted(gains)


def test_nothing_asked_for_is_said(place):
    _, command = place
    assert "No event of this run was planned under other choices" in said(
        CliRunner().invoke(cli.app, [*command, "--sample", "0"])
    )


@pytest.mark.parametrize(
    ("choices", "words"),
    [
        ("bad.toml", ("bad.toml: H: 1", "loss.horizon_s", "greater than or equal to 2")),
        ("nowhere.toml", ("nowhere.toml", "no such table", "multiverse")),
    ],
)
def test_a_bad_choice_ends_with_2_before_anything_runs(place, tmp_path, monkeypatch, capsys, choices, words):
    root, _ = place
    options = ["--data", FIXTURES, "--work", tmp_path / "work", "--choices", root / choices]
    monkeypatch.setattr(sys, "argv", ["highd-lc", "multiverse", *map(str, options)])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 2
    text = " ".join(capsys.readouterr().err.split())
    for word in words:
        assert word in text
    assert not (tmp_path / "work" / "recordings.parquet").exists()
