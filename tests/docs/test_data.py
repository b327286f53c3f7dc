"""The examples of docs/data.md, run on trajectories that are made here, and that of docs/planners.md."""

import re
from pathlib import Path

import numpy as np
import pytest

from highd_lc.stages.trajectories import Trace, write_traces
from highd_lc.vocab.job import Job, Provenance
from highd_lc.vocab.settings import Settings

PAGE = Path(__file__).resolve().parents[2] / "docs" / "data.md"
EXAMPLES = {
    re.search(r"import (\w+)", text)[1]: text
    for text in re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.S)
}
T = np.arange(3) * 0.1


def trace(event_id, policy, role, vx):
    values = np.stack([T, T * vx, 0 * T, vx + T, 0 * T]).astype(np.float32)
    return Trace((event_id, "equal", policy, "population", "simulated", role), values)


@pytest.fixture
def made(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for number, speed in ((1, 20.0), (2, 30.0)):
        job = Job(number, tmp_path, tmp_path / "work", Settings(), Provenance("", {}, 1, ""))
        event = f"{number:02d}-0001-00100"
        others = [trace(event, "benchmark", "target_follower_1", 99.0), trace(event, "local_optimum", "ego", 99.0)]
        write_traces(job, [trace(event, "local_optimum", "target_follower_1", speed), *others])


def test_there_is_an_example_of_each_reader():
    assert list(EXAMPLES) == ["pandas", "polars", "duckdb"]


@pytest.mark.usefixtures("made")
@pytest.mark.parametrize("reader", ["pandas", "polars", "duckdb"])
def test_examples_read_the_mean_over_the_events(reader):
    pytest.importorskip(reader)
    found = {}
    exec(EXAMPLES[reader], found)
    mean = found["mean_speed"]
    speeds = mean.to_numpy() if reader == "pandas" else np.asarray(mean["vx"])
    np.testing.assert_allclose(speeds, 25.0 + T, rtol=1e-6)


def test_the_planner_of_the_page_plans_beside_ours():
    (text,) = re.findall(r"```python\n(.*?)```", PAGE.with_name("planners.md").read_text(), re.S)
    found = {}
    exec(text, found)
    assert found["plan"].status == "solved"
    assert list(found["table"].index) == ["benchmark", "local_optimum", "careful"]
    assert found["tracked"].rmse_lateral_m < 0.1
