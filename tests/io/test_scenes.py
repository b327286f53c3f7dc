"""Reading scenes: what a recording without any lane change gives."""

import pandas as pd
import pytest

from highd_lc.io.scenes import _grouped
from highd_lc.vocab.errors import ArtefactError


def test_no_rows_are_no_groups():
    nothing = pd.DataFrame({"event_id": [], "t": []})
    assert _grouped("events", nothing, by=["event_id"], order="t", columns=["t"]) == {}


def test_groups_are_ordered_slices():
    rows = pd.DataFrame({"event_id": ["a", "a", "b"], "t": [1.0, 2.0, 0.0]})
    groups = _grouped("event_tracks", rows, by=["event_id"], order="t", columns=["t"])
    assert {key: of["t"].tolist() for key, of in groups.items()} == {("a",): [1.0, 2.0], ("b",): [0.0]}


@pytest.mark.parametrize(("ids", "times"), [("aba", [0.0, 1.0, 2.0]), ("aab", [2.0, 1.0, 3.0])])
def test_rows_in_another_order_are_refused(ids, times):
    rows = pd.DataFrame({"event_id": list(ids), "t": times})
    with pytest.raises(ArtefactError, match="event_tracks: rows are not ordered by event_id, t"):
        _grouped("event_tracks", rows, by=["event_id"], order="t", columns=["t"])
