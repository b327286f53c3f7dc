"""The motion of an event's page that is taken from artefacts as it is."""

import numpy as np
import pandas as pd
import pytest

from highd_lc.stages.trajectories import prediction_trace
from highd_lc.vocab import names
from highd_lc.vocab.tables import TABLES


def rows(kind, speeds, *, followers="", policy="recorded", role="target_follower_1", accounting="equal", first=0):
    """Rows of ``trajectories`` at 0.1 s from a first sample on, of single precision as in the artefact."""
    t = (0.1 * np.arange(first, first + len(speeds))).astype(np.float32)
    found = {
        "event_id": "01-0001-00100", "accounting": accounting, "policy": policy, "followers": followers,
        "kind": kind, "role": role, "t": t, "x": 0.0, "y": 0.0, "vx": np.asarray(speeds, np.float32), "ax": 0.0,
    }  # fmt: skip
    return pd.DataFrame(found, columns=list(TABLES["trajectories"].column_names))


RECORDED = rows("recorded", [28.0, 27.5, 27.0, 26.5])
POPULATION = rows("simulated", [28.0, 27.75, 27.5], followers="population")
CONSTANT = rows("simulated", [28.0] * 4, followers=names.CONSTANT_SPEED)


def test_recorded_and_simulated_speeds_share_a_grid():
    trace = prediction_trace(
        pd.concat([POPULATION, CONSTANT, RECORDED]).sample(frac=1, random_state=3), "population"
    )
    assert trace.t == pytest.approx([0.0, 0.1, 0.2, 0.3])
    assert trace.recorded == pytest.approx([28.0, 27.5, 27.0, 26.5])
    assert list(trace.models) == [names.CONSTANT_SPEED, "population"]
    assert trace.models[names.CONSTANT_SPEED] == pytest.approx([28.0] * 4)
    assert trace.models["population"] == pytest.approx([28.0, 27.75, 27.5, np.nan], nan_ok=True)
    assert trace.default == "population"


def test_other_vehicles_policies_and_times_before_the_start_do_not_count():
    others = [
        rows("recorded", [1.0] * 4, role=names.EGO), rows("simulated", [2.0] * 4, role="target_follower_2"),
        rows("simulated", [3.0] * 4, followers="population", policy=names.BENCHMARK),
        rows("tracked", [4.0] * 4, followers="population"), rows("recorded", [5.0] * 3, first=-3),
    ]  # fmt: skip
    alone = prediction_trace(pd.concat([RECORDED, POPULATION]), "population")
    among = prediction_trace(pd.concat([*others, RECORDED, POPULATION]), "population")
    assert np.array_equal(alone.recorded, among.recorded)
    assert list(among.models) == ["population"]
    assert np.array_equal(alone.models["population"], among.models["population"], equal_nan=True)


def test_the_same_motion_under_three_accountings_is_one():
    three = [rows("simulated", [28.0, 27.0], followers="idm", accounting=a) for a in names.ACCOUNTINGS]
    trace = prediction_trace(pd.concat([RECORDED, *three]), "population")
    assert trace.models["idm"][:2] == pytest.approx([28.0, 27.0])


@pytest.mark.parametrize("frame", [RECORDED.iloc[:0], RECORDED, POPULATION])
def test_without_either_motion_there_is_nothing_to_show(frame):
    assert prediction_trace(frame, "population") is None
