"""Table bodies written as strings: their words come from data, and are text all the same."""

import numpy as np
import pytest

from highd_lc.reporting import event_rows
from highd_lc.vocab import names

HOSTILE = "<b>&\"'"
ESCAPED = "&lt;b&gt;&amp;&#34;&#39;"


def test_words_are_escaped_in_every_body():
    loss = {"policy": names.HUMAN, "bars": [], "status": HOSTILE, "label": "", "cells": [1.0], "each": []}
    plan = {"policy": names.HUMAN, "infeasible": True, "status": HOSTILE, "cells": [(1.0, 1)], "remarks": HOSTILE}
    margin = {"name": HOSTILE, "unit": HOSTILE, "margins": [None], "binds": [], "rejected": []}
    track = {"policy": names.HUMAN, "plant": HOSTILE, "status": HOSTILE, "violations": HOSTILE}
    track |= {"errors": [], "judged": []}
    driven = event_rows.tracking_bodies([track])
    bodies = {
        event_rows.loss_body([loss]): 1,
        event_rows.plan_body([plan]): 2,
        event_rows.margin_body([margin]): 2,
        driven["errors"]: 2,
        driven["judged"]: 2,
    }
    for body, words in bodies.items():
        assert body.count(ESCAPED) == words
        assert HOSTILE not in body


def test_bars_are_told_in_words_with_the_total():
    row = {"policy": names.HUMAN, "bars": [("av-comfort", 12.5)], "label": HOSTILE, "cells": [0.0] * 6 + [7.0]}
    body = event_rows.loss_body([{**row, "status": "", "each": [None]}])
    assert f'aria-label="{ESCAPED}: total 7.00"' in body
    assert "width: 12.5%" in body
    assert body.count('<td class="n">') == 8


def test_an_infeasible_plan_is_marked():
    plan = {"policy": names.HUMAN, "status": "s", "cells": [], "remarks": "", "safety": [(None, 2), (-1.0, 2)]}
    assert '<td class="bad">s</td>' in event_rows.plan_body([{**plan, "infeasible": True}])
    assert 'class="bad"' not in event_rows.plan_body([{**plan, "infeasible": False}])
    assert event_rows.safety_body([plan]).endswith('<td class="n">–</td><td class="n">−1.00</td></tr>\n')


def test_the_constraint_that_binds_is_marked_in_its_plan_s_column():
    row = {"name": "longitudinal jerk", "unit": "m/s³", "margins": [0.5, 0.0, None], "rejected": [3]}
    body = event_rows.margin_body([{**row, "binds": [1]}])
    assert '<td class="n">0.50</td><td class="binding n">0.00</td><td class="n">–</td><td class="n">3</td>' in body
    assert "binding" not in event_rows.margin_body([{**row, "binds": []}])


@pytest.mark.parametrize(
    ("plan", "names"),
    [
        ({"at_bound": ["T", "jerk_x"], "binding": ""}, {"jerk_x"}),
        ({"at_bound": None, "binding": "insertion_gap"}, {"insertion_gap"}),
        ({"at_bound": np.array([]), "binding": None}, set()),
    ],
)
def test_what_binds_is_a_constraint_without_margin_or_the_one_that_forbids(plan, names):
    assert event_rows.binding(plan) == names


def test_no_rows_are_no_lines():
    assert event_rows.loss_body([]) == ""
    assert event_rows.tracking_bodies([]) == {}
