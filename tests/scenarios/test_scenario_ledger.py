"""The ledger: each number found in its cell, ratios, verdicts, the nearest cell; missing plans stay missing."""

import numpy as np
import pytest
from few_scenarios import few_scenarios

from highd_lc.scenarios.ledger import Book, ledger_rows, value_of, verdict
from highd_lc.vocab import names
from highd_lc.vocab.published import PUBLISHED
from highd_lc.vocab.tables.scenarios import NEAR, NO_PLAN, NOT_REPRODUCED, REPRODUCED


def cell(scenario, variant, form, accounting, omega, **values):
    return {
        "scenario": scenario,
        "variant": variant,
        "form": form,
        "accounting": accounting,
        "omega_av": omega,
    } | values


def book():
    follower = ("fixed", names.FOLLOWER_HORIZON, 1.0)
    return Book.of(
        [
            cell("1", "default", *follower, status="solved", loss_av=20.0, rectangle_time_s=[1.0, 2.0]),
            cell("1", "default", "fixed", names.EQUAL, 1.0, status="solved", loss_av=21.5),
            cell("1", "paper_literal", "fixed", names.PAPER, 1.0, status="solved", loss_av=7.0),
            cell("1", "bumpers", *follower, status="infeasible"),
        ],
        few_scenarios(),
    )


def test_a_number_is_found_in_its_cells():
    row = next(r for r in ledger_rows(book()) if r["key"] == "1:benchmark:loss_av")
    assert row["published"] == 21.42
    assert row["ours"] == row["follower_horizon"] == 20.0
    assert row["ratio"] == pytest.approx(20.0 / 21.42)
    assert row["equal"] == 21.5
    assert row["paper_literal"] == 7.0
    assert np.isnan(row["paper"])
    assert row["nearest"] == 21.5
    assert row["nearest_cell"] == "default, fixed, equal"
    assert row["verdict"] == NEAR
    assert row["nearest_verdict"] == REPRODUCED


def test_what_is_not_there_is_nan_and_no_plan():
    row = next(r for r in ledger_rows(book()) if r["key"] == "2_15:benchmark:flow_veh_h")
    assert np.isnan(row["ours"])
    assert np.isnan(row["nearest"])
    assert row["verdict"] == row["nearest_verdict"] == NO_PLAN


def test_every_published_number_has_a_row_of_its_own():
    keys = [row["key"] for row in ledger_rows(book())]
    assert len(keys) == len(set(keys)) == len(PUBLISHED)
    assert len(keys) == 17 + 16 + 6 + 80


def test_entries_of_lists_are_found_by_rank():
    row = {"rectangle_time_s": [1.0, 2.0], "loss_av": None}
    assert value_of(row, "rectangle_time_s 2") == 2.0
    assert np.isnan(value_of(row, "rectangle_time_s 3"))
    assert np.isnan(value_of(row, "loss_av"))
    assert np.isnan(value_of({}, "rectangle_time_s 1"))


@pytest.mark.parametrize(
    ("ours", "word"),
    [
        (1.0, REPRODUCED),
        (1.0099, REPRODUCED),
        (0.989, NEAR),
        (1.0999, NEAR),
        (0.89, NOT_REPRODUCED),
        (np.nan, NO_PLAN),
    ],
)
def test_verdicts(ours, word):
    assert verdict(100.0 * ours, 100.0) == word
