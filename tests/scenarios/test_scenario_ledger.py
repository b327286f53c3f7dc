"""The ledger: each number found in its cell, ratios, verdicts, the nearest cell; missing plans stay missing."""

import numpy as np
import pytest
from few_scenarios import few_scenarios

from highd_lc.scenarios.ledger import Book, ledger_rows, value_of, verdict
from highd_lc.scenarios.run import judged, why_not_valid
from highd_lc.vocab import names
from highd_lc.vocab.published import CHANGES, PUBLISHED, TABLE_3, printed
from highd_lc.vocab.tables.scenarios import (
    COLLISION,
    NEAR,
    NO_FITS,
    NO_PLAN,
    NOT_REPRODUCED,
    NOT_VALID,
    REPRODUCED,
    T_BOUND,
    V_BOUND,
)


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
    assert len(keys) == 17 + 16 + 6 + 80 + 1 + 18


def pair(benchmark, local, **about):
    cells = (("1", "default", "fixed", names.FOLLOWER_HORIZON, omega) for omega in (1.0, 0.5))
    rows = [cell(*key, status="solved", **values) for key, values in zip(cells, (benchmark, local), strict=True)]
    rows[1] |= about
    return Book.of(rows, few_scenarios())


def of_pair(book, quantity):
    return next(r for r in ledger_rows(book) if r["key"] == f"1:local_optimum:{quantity}")


def test_relative_changes_are_of_the_pair_and_judged():
    row = of_pair(pair({"loss_hv": 20.0}, {"loss_hv": 12.2}), "change loss_hv")
    assert row["published"] == -38.0
    assert row["ours"] == row["nearest"] == pytest.approx(-39.0)
    assert row["verdict"] == NEAR
    risen = of_pair(pair({"loss_hv": 20.0}, {"loss_hv": 27.6}), "change loss_hv")
    assert risen["verdict"] == NOT_REPRODUCED


def test_printed_pairs_have_their_own_changes():
    changes = {number.key: number.value for number in CHANGES}
    assert changes["1:local_optimum:change loss_total"] == -10.8
    assert changes["3:local_optimum:change loss_hv"] == pytest.approx(100 * (42.12 / 48.44 - 1))
    for quantity, change in (("loss_total", -10.8), ("loss_hv", -38.0)):
        benchmark, local = (printed("1", policy, quantity) for policy in (names.BENCHMARK, names.LOCAL_OPTIMUM))
        assert 100 * (local / benchmark - 1) == pytest.approx(change, abs=0.5)


def test_differences_of_followers_have_a_least_and_a_most():
    book = pair({"hv_v_min": [10.0, 20.0]}, {"hv_v_min": [11.5, 24.0]})
    assert of_pair(book, "least hv_v_min")["ours"] == pytest.approx(1.5)
    assert of_pair(book, "most hv_v_min")["ours"] == pytest.approx(4.0)


def test_what_is_not_valid_is_never_the_nearest():
    row = of_pair(pair({"loss_hv": 20.0}, {"loss_hv": 12.2}, not_valid=V_BOUND), "change loss_hv")
    assert row["ours"] == pytest.approx(-39.0)
    assert np.isnan(row["nearest"])
    assert (row["verdict"], row["not_valid"]) == (NOT_VALID, V_BOUND)
    hit = of_pair(pair({"loss_hv": 20.0}, {}, not_valid=COLLISION), "change loss_hv")
    assert np.isnan(hit["ours"])
    assert hit["verdict"] == NOT_VALID


def test_the_objective_of_the_fits_stands_beside_the_printed_one():
    def fits(value):
        book = Book.of([], few_scenarios(), fits=value)
        return next(r for r in ledger_rows(book) if r["scenario"] == TABLE_3)

    assert fits(0.095)["verdict"] == NEAR
    assert fits(np.nan)["verdict"] == NO_FITS


def test_a_cell_is_not_valid_on_a_bound_or_in_a_collision():
    planning = few_scenarios().planning(few_scenarios().options)
    good = {"T": 5.0, "av_v_max": 28.0, "min_gap_m": 0.5}
    assert why_not_valid(good, planning) == ""
    assert why_not_valid(good | {"T": 10.0}, planning) == T_BOUND
    assert why_not_valid(good | {"av_v_max": 30.0}, planning) == V_BOUND
    assert why_not_valid(good | {"min_gap_m": -0.1, "T": 2.0}, planning) == f"{COLLISION}, {T_BOUND}"


def test_a_collision_leaves_no_loss_behind():
    planning = few_scenarios().planning(few_scenarios().options)
    hit = {"status": "solved", "T": 5.0, "av_v_max": 28.0, "min_gap_m": -1.0, "loss_hv": 99.0, "hv_v_min": [0.0]}
    assert set(judged(hit, planning)) == {"status", "T", "min_gap_m", "not_valid"}


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
