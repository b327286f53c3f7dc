from pathlib import Path

import pytest

from highd_lc.io import atomic
from highd_lc.io.workspace import Records
from highd_lc.vocab.job import JobReport, Problem

REPORT = JobReport({"events": 3}, (Problem(1, "validate", "01-0001-00001: something"),))


@pytest.fixture
def work(tmp_path: Path) -> Path:
    """A work folder in which validate has finished recording 1, with a file inside and one outside."""
    folder = tmp_path / "work"
    with atomic.collected() as files:
        atomic.write_text(folder / "parts" / "validate" / "01" / "losses", "abc")
        atomic.write_text(tmp_path / "reports" / "page", "abc")
    Records(folder).remember("validate", "key", report=REPORT, files=files, recording=1)
    return folder


def test_finished_work_is_remembered_with_its_report(work: Path) -> None:
    records = Records(work)
    assert records.finished("validate", "key", 1) == REPORT
    assert records.finished("validate", "other key", 1) is None
    assert records.finished("validate", "key", 2) is None
    assert records.finished("validate", "key") is None


def test_forgotten_work_has_to_be_done(work: Path) -> None:
    Records(work).forget("validate", 1)
    assert Records(work).finished("validate", "key", 1) is None
    Records(work).forget("validate", 1)


@pytest.mark.parametrize("name", ["parts/validate/01/losses", "../reports/page"])
def test_work_whose_files_are_gone_or_torn_has_to_be_done(work: Path, name: str) -> None:
    (work / name).write_text("ab")
    assert Records(work).finished("validate", "key", 1) is None
    (work / name).unlink()
    assert Records(work).finished("validate", "key", 1) is None


def test_other_content_of_the_same_size_is_seen_on_demand(work: Path) -> None:
    (work / "parts/validate/01/losses").write_text("xyz")
    assert Records(work).finished("validate", "key", 1) == REPORT
    assert Records(work, verify=True).finished("validate", "key", 1) is None


def test_a_folder_reached_by_a_link_is_the_same_folder(work: Path, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "link").symlink_to(work)
    assert Records(tmp_path / "elsewhere" / "link").finished("validate", "key", 1) == REPORT


@pytest.mark.parametrize("text", ["", "{", "[]", "null", '{"key": "other"}'])
def test_a_damaged_record_is_no_record(work: Path, text: str) -> None:
    (work / "parts" / "validate" / "01.json").write_text(text)
    assert Records(work).finished("validate", "key", 1) is None
