"""What README and pages say of runs is what docs/results.json holds, and that is read from finished runs."""

import importlib.util
import json
import shutil
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[2] / "docs"


@pytest.fixture(scope="module")
def writer():
    about = importlib.util.spec_from_file_location("write_results", DOCS / "write_results.py")
    module = importlib.util.module_from_spec(about)
    about.loader.exec_module(module)
    return module


def test_the_pages_are_as_written(writer, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["write_results.py", "--check"])
    assert writer.main() == 0, capsys.readouterr().out
    monkeypatch.setattr(writer, "rendered", lambda text, store: text + "more")
    assert writer.main() == 1


def test_a_run_is_read_and_shown(writer, pipeline_run):
    store = json.loads(writer.STORE.read_text("utf-8"))
    read = json.loads(json.dumps(writer.read_run(pipeline_run.work)))
    for name in store:
        store[name] |= {**read, "planners": store["planners"]["planners"]}
    gain = read["gain"]["population fixed equal"]
    shown = writer.rendered("<!-- table finding: x -->\nold\n<!-- end -->", store)
    assert "old" not in shown
    assert f"{100.0 * gain['gain']:.2f} %" in shown
    assert f"**{read['ratio']['fixed']['ratio']:.0f}**" in shown
    assert read["code"] in shown
    for name in writer.TABLES:
        lines = writer.table(name, store).splitlines()
        assert len({line.count("|") for line in lines if line.startswith("|")}) == 1
    assert set(read["seconds"]) >= {"ingest", "extract", "calibrate", "validate", "report"}


def test_a_run_up_to_calibrate_tells_how_followers_are_predicted(writer, pipeline_run, tmp_path):
    shutil.copy(pipeline_run.work / "prediction_summary.parquet", tmp_path)
    entries = (
        {"stage": "calibrate", "seconds": 9.5},
        {"stage": "calibrate", "seconds": 0.1},
        {"stage": "ingest", "recording": 1, "error": "InputError: x"},
        {"event_id": "01-0001-00001", "solve_ms_median": 3.0},
    )
    (tmp_path / "run.log").write_text("".join(f"{json.dumps(entry)}\n" for entry in entries))
    read = writer.read_run(tmp_path)
    assert read.keys() == {"code", "seconds", "skill"}
    assert read["seconds"] == {"calibrate": 9.5}
