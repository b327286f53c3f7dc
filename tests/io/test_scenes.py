"""Reading scenes: what a recording without any lane change gives."""

import pandas as pd

from highd_lc.io.scenes import _grouped


def test_no_rows_are_no_groups():
    nothing = pd.DataFrame({"event_id": [], "t": []})
    assert _grouped(nothing, by=["event_id"], order="t", columns=["t"]) == {}


def test_groups_are_ordered_slices():
    rows = pd.DataFrame({"event_id": ["b", "a", "a"], "t": [0.0, 2.0, 1.0]})
    groups = _grouped(rows, by=["event_id"], order="t", columns=["t"])
    assert {key: of["t"].tolist() for key, of in groups.items()} == {("a",): [1.0, 2.0], ("b",): [0.0]}
