"""Words, tables and figures of the scenarios' pages, from small tables made up here."""

import itertools

import numpy as np
import pandas as pd
import pytest

from highd_lc.reporting import labels
from highd_lc.reporting import pages_scenarios as pages
from highd_lc.reporting.figures_scenarios import PrintedLosses, loss_figure, printed_state_figure, weight_figure
from highd_lc.reporting.figures_space_time import (
    LaneState,
    SpeedMap,
    growth_figure,
    lane_state_figure,
    speed_maps_figure,
)
from highd_lc.reporting.tables_scenarios import reach
from highd_lc.reporting.terminal import claims_table
from highd_lc.vocab import names

CELLS = list(itertools.product(names.FORMS, names.ACCOUNTINGS))
PRINTED = {names.BENCHMARK: PrintedLosses(21.42, 28.64), names.LOCAL_OPTIMUM: PrintedLosses(26.94, 17.70)}


def claims(**changes):
    row = {
        "claim": "hv_loss_falls",
        "scenario": "2_15",
        "statement": "the local optimum lowers the followers' loss",
        "printed": "",
        "default_verdict": "holds",
        "cells": 3,
        "holds": 2,
        "fails": 0,
        "unchanged": 1,
        "holds_under": ["default", "bumpers"],
        "fails_under": ["weighted"],
        "no_plan_under": [],
        "not_valid_under": ["spacing_20"],
    }
    return pd.DataFrame([row | changes | {"form": form, "accounting": a} for form, a in CELLS])


def scenario_cells():
    rows = []
    for (form, accounting), omega in itertools.product(CELLS, (0.1, 0.5, 1.0)):
        parts = dict.fromkeys(("av_comfort", "av_efficiency", "hv_comfort", "hv_efficiency"), 10.0 + omega)
        totals = {"loss_av": 10.0 + omega, "loss_hv": 10.0 + omega, "loss_total": 20.0 + 2 * omega}
        rows.append({"form": form, "accounting": accounting, "omega_av": omega, "v_start": 25.0, "not_valid": ""})
        rows[-1] |= parts | totals
    return pd.DataFrame(rows)


def test_words():
    assert labels.scenario("2_15") == "2, AV 15 m/s"
    assert labels.scenario("3") == "3"
    assert pages.quantity_words("rectangle_time_s 4") == "time in the rectangle, HV 4"
    assert pages.quantity_words("loss_total") == "total loss"
    assert pages.quantity_words("change loss_hv") == "relative change of followers' loss"
    assert labels.scenario("table_3") == "Table 3"


def test_claims_show_verdict_and_count_in_every_cell():
    section = pages.claims_section(claims())
    (row,) = section.tables[0].rows
    assert row[:3] == ("followers' loss falls", "2, AV 15 m/s", "–")
    assert row[3:] == ("holds 2/3",) * 6
    details = section.folded[0].rows
    assert len(details) == 6
    assert details[0][-4:] == ("default, bumpers", "weighted", "–", "spacing_20")


def test_claims_of_a_sweep_are_counted_not_listed():
    section = pages.claims_section(claims(), title="Claims over the sweep", what="combinations")
    assert not section.folded
    assert "combinations" in section.text[0]


def test_claims_on_the_terminal():
    table = claims_table(claims(default_verdict="fails"))
    assert table.row_count == 1
    assert list(table.columns[2].cells) == ["NO 2/3"]


def test_markdown_has_a_line_for_every_number_and_contradiction():
    ledger = pd.DataFrame(
        {
            "key": ["1:benchmark:loss_av", "1:local_optimum@0.1:loss_hv", "2_15:benchmark:rectangle_time_s 1"],
            "scenario": ["1", "1", "2_15"],
            "policy": ["benchmark", "local_optimum", "benchmark"],
            "quantity": ["loss_av", "loss_hv", "rectangle_time_s 1"],
            "unit": ["", "", "s"],
            "published": [21.42, 14.14, 10.8],
            "ours": [10.36, np.nan, 10.0],
            "ratio": [0.48, np.nan, 0.93],
            "verdict": ["not reproduced", "no plan", "near"],
            "nearest": [21.4, np.nan, 10.5],
            "nearest_cell": ["default, free, equal", "", "own_speed, fixed, paper"],
            "not_valid": "",
        }
    )
    arithmetic = pd.DataFrame(
        {
            "statement": ["a sum", "another"],
            "computation": ["1 + 1 = 2", "1 + 2 = 3"],
            "printed": [2.0, 4.0],
            "verdict": ["consistent", "inconsistent"],
        }
    )
    text = pages.ledger_markdown(ledger, claims(), arithmetic=arithmetic)
    assert (
        "| 1 | AV loss | Benchmark | 21.42 | 10.36 | 0.48 | not reproduced | 21.40 | default, free, equal |"
        in text
    )
    assert "| 1 | followers' loss | omega_AV 0.1 | 14.14 | – | – | no plan | – |  |" in text
    assert "rectangle" not in text.split("## Claims")[0].replace("Table 1", "")
    assert "1 + 2 = 3" in text
    assert "1 + 1 = 2" not in text
    assert "over the sweep" not in text
    swept = pages.ledger_markdown(ledger, claims(), arithmetic=arithmetic, swept=claims(holds=1))
    assert "holds 1/3" in swept.split("## Claims over the sweep")[1]


def test_the_ledger_begins_with_what_reproduces_changes_first():
    ledger = pd.DataFrame(
        {
            "key": ["1:benchmark:av_efficiency", "1:benchmark:loss_av", "1:local_optimum:change loss_hv"],
            "scenario": ["1"] * 3,
            "policy": ["benchmark", "benchmark", "local_optimum"],
            "quantity": ["av_efficiency", "loss_av", "change loss_hv"],
            "unit": ["", "", "%"],
            "published": [13.97, 21.42, -38.0],
            "ours": [13.97, 10.36, -41.0],
            "ratio": [1.0, 0.48, 1.08],
            "verdict": ["reproduced", "not reproduced", "not valid"],
            "nearest": [13.97, 21.4, -38.2],
            "nearest_cell": ["default, fixed, equal"] * 3,
            "not_valid": ["", "", "v_max on its bound"],
        }
    )
    arithmetic = pd.DataFrame(
        {"statement": [], "computation": pd.Series([], dtype=str), "printed": [], "verdict": []}
    )
    text = pages.ledger_markdown(ledger, claims(), arithmetic=arithmetic)
    begin = text.split("## Every number")[0]
    assert begin.index("relative change of followers' loss [%]") < begin.index("AV efficiency")
    assert "21.42" not in begin
    assert "followers' loss -41.0 % (printed -38.0 %); not valid, for v_max on its bound" in begin
    assert "of 1 comparisons of local optimum and benchmark 1 come out within 10 %, 0 of them by valid" in begin
    assert "of 2 levels 1 come out within 10 %, 1 of them by valid plans" in begin


def test_weights_figure_shows_the_printed_points():
    figure = weight_figure(
        scenario_cells(), printed={1.0: PRINTED[names.BENCHMARK], 0.5: PRINTED["local_optimum"]}
    )
    marked = [line for line in figure.axes[0].lines if line.get_marker() == "D"]
    assert sorted(line.get_ydata()[0] for line in marked) == pytest.approx(
        [17.7, 21.42, 26.94, 28.64, 44.64, 50.06]
    )
    assert len(figure.axes) == 3


def test_loss_bars_are_half_of_each_part():
    figure = loss_figure(scenario_cells(), printed=PRINTED)
    heights = [patch.get_height() for patch in figure.axes[1].patches]
    assert len(heights) == 16
    assert sum(heights[:4]) == pytest.approx(2 * 11.0)


def test_a_missing_plan_is_said_not_drawn():
    cells = scenario_cells()
    gone = (cells["form"] == names.FREE) & (cells["omega_av"] == 0.5)
    cells.loc[gone, ["loss_total", "av_comfort"]] = np.nan
    figure = loss_figure(cells, printed=PRINTED)
    assert [text.get_text() for text in figure.axes[1].texts].count("no plan") == 1
    assert len(figure.axes[1].patches) == 12


def test_printed_state_has_a_panel_a_cell():
    figure = printed_state_figure(scenario_cells(), printed=PRINTED)
    assert len(figure.axes) == 6


def test_difference_of_speed_maps_is_local_minus_benchmark():
    edges = np.arange(4.0), np.arange(3.0)
    slow, fast = np.full((3, 2), 20.0), np.full((3, 2), 23.0)
    slow[0, 0] = np.nan
    maps = {"AV": {names.BENCHMARK: SpeedMap(*edges, slow), names.LOCAL_OPTIMUM: SpeedMap(*edges, fast)}}
    shown = speed_maps_figure(maps).axes[2].images[0].get_array()
    assert np.ma.getmaskarray(shown)[0, 0]
    assert np.allclose(shown.compressed(), 3.0)


def test_lane_state_draws_the_ego_over_each_measure():
    values = np.full((3, 2), 50.0)
    state = LaneState(np.arange(4.0), np.arange(3.0), values, values, values, (np.arange(2.0), np.arange(2.0)))
    figure = lane_state_figure(state)
    assert all(len(axes.lines) == 3 for axes in figure.axes[:3])


def growth(benchmark, local):
    rows = []
    for policy, drops in ((names.BENCHMARK, benchmark), (names.LOCAL_OPTIMUM, local)):
        rows += [
            {
                "drivers": "d",
                "scenario": "2_15",
                "policy": policy,
                "follower": i,
                "undershoot_mps": v,
                "delay_s": v,
            }
            for i, v in enumerate(drops, start=1)
        ]
    return pd.DataFrame(rows)


def test_reach_is_the_last_follower_helped_or_harmed():
    (row,) = reach(growth([3.0, 2.0, 1.0, 0.5], [1.0, 1.5, 1.02, 0.9])).to_dict("records")
    assert row["last_helped"] == 2
    assert row["last_harmed"] == 4
    assert row["first_benchmark"] == 3.0
    assert row["first_local"] == 1.0
    assert row["delay_saved_s"] == pytest.approx(6.5 - 4.42)


def test_where_somebody_drives_into_another_nothing_is_reached():
    hit = growth([3.0, 2.0], [np.nan, np.nan])
    (row,) = reach(hit).to_dict("records")
    assert row["first_benchmark"] == 3.0
    assert np.isnan([row["last_helped"], row["last_harmed"], row["delay_saved_s"]]).all()


def test_growth_figure_has_a_panel_a_scenario():
    stability = pd.DataFrame({"drivers": ["d", "d"], "speed_mps": [10.0, 20.0], "gain": [1.1, 1.0]})
    figure = growth_figure(stability, growth([3.0, 2.0], [1.0, 1.5]))
    assert figure.axes[1].get_title(loc="left") == "AV at 15 m/s before a platoon at 25 m/s"
    assert len(figure.axes[1].lines) == 2
