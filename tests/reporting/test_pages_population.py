import html as escapes
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest
from page_text import rows_of
from sample_run import calibration, matrix, recordings, sample_run, sample_summary
from sample_studies import studies

from highd_lc.reporting import labels
from highd_lc.reporting.pages_data import data_page, excluded_page
from highd_lc.reporting.pages_followers import calibration_page
from highd_lc.reporting.pages_index import IndexTables, index_page, summary_page
from highd_lc.reporting.pages_population import dictionary_page, matrix_page
from highd_lc.reporting.pages_studies import StudyTables, studies_page
from highd_lc.reporting.terminal import matrix_table
from highd_lc.stages import population_tables, statistics
from highd_lc.vocab import names
from highd_lc.vocab.driver import TABLE3_MEANS
from highd_lc.vocab.tables import TABLES


@cache
def robustness() -> str:
    return studies_page(studies())


@cache
def of_matrix() -> str:
    return matrix_page(matrix())


@cache
def of_calibration() -> str:
    return calibration_page(calibration())


@cache
def summary() -> str:
    return summary_page(sample_summary())


def test_the_matrix_shows_every_cell_with_its_interval():
    page = of_matrix()
    shown = {(row[0], row[1]): row for row in rows_of(page)[1:7]}
    assert len(shown) == 6
    whole = matrix().query("stratum == 'all'")
    for row in whole.itertuples(index=False):
        form = "Fixed end speed" if row.form == "fixed" else "Free end speed"
        accounting = {"paper": "Paper", "follower_horizon": "Follower horizon", "equal": "Equal"}[row.accounting]
        cells = shown[form, accounting]
        assert cells[2] == str(row.n_events)
        assert cells[7:10] == [f"{100 * v:.2f}" for v in (row.gain, row.gain_low, row.gain_high)]


def test_the_primary_accounting_leads():
    first = rows_of(of_matrix())[1]
    assert first[:2] == ["Fixed end speed", "Equal"]


def test_strata_have_their_tables():
    page = of_matrix()
    for form in names.FORMS:
        for accounting in names.ACCOUNTINGS:
            rows = rows_of(page, after=f'id="{form}-{accounting}"')
            assert [row[0] for row in rows[1:3]] == ["Car", "Truck"]


def test_table_3_stands_side_by_side():
    rows = rows_of(of_calibration(), after='id="table3"')
    desired = rows[1]
    mean = TABLE3_MEANS.v_desire
    assert desired[0] == "desired speed v_desire"
    assert desired[-3:] == [f"{1.2 * mean:.2f}", f"{mean:.2f}", "12.5"]
    assert rows[7][0] == "Quantity"
    assert rows[8][0] == "objective of the fit"


def test_where_parameters_come_from_adds_up():
    rows = rows_of(of_calibration(), after="Where the parameters come from")
    assert rows[1:5] == [["fitted", "20"], ["class pool", "10"], ["pool of all", "0"], ["Table 3 means", "10"]]


def test_every_excluded_lane_change_is_listed_under_its_reason():
    crossings = sample_run().crossings
    page = excluded_page(crossings)
    for reason, group in crossings[~crossings["usable"]].groupby("reason"):
        section = page[page.index(f'id="{reason}"') :].split("</section>")[0]
        assert all(event_id in section for event_id in group["event_id"])
        assert f"{labels.REASONS[reason][1:]} ({len(group)})" in escapes.unescape(section)


def test_the_funnel_adds_up_to_all_crossings():
    crossings = sample_run().crossings
    rows = rows_of(excluded_page(crossings), after='id="funnel"')
    body = rows[1 : 3 + len(names.REASONS)]
    assert body[-1][-1] == str(len(crossings))
    assert sum(int(row[-1]) for row in body[:-1]) == len(crossings)
    assert all(int(row[-1]) == int(row[-2]) + int(row[-3]) for row in body)


def test_the_funnel_goes_on_to_the_page():
    crossings = sample_run().crossings
    usable = crossings.loc[crossings["usable"], "event_id"].tolist()
    further = {
        "calibrated": frozenset(usable[:20]),
        "planned": frozenset(usable[:9]),
        "reported": frozenset(usable),
    }
    rows = rows_of(excluded_page(crossings, further), after='id="funnel"')
    counts = {row[0]: row[-1] for row in rows}
    assert [counts[word] for word in further] == ["20", "9", str(len(usable))]


def test_what_is_known_of_an_excluded_change_stands_beside_it():
    crossings = sample_run().crossings
    excluded = crossings[~crossings["usable"]].iloc[0]
    same = crossings["usable"] & (crossings.index == crossings.index[0])
    crossings.loc[same, ["recording_id", "ego_id"]] = excluded[["recording_id", "ego_id"]].tolist()
    page = excluded_page(crossings)
    row = next(part for part in page.split("<tr>") if f">{excluded['event_id']}<" in part)
    assert f'href="events/{crossings["event_id"].iloc[0]}.html"' in row
    assert '<td class="n">25.0</td>' in row
    assert page.count('href="events/') == 1


def test_the_dictionary_holds_every_column_of_every_table():
    page = dictionary_page()
    for table in TABLES.values():
        rows = rows_of(page, after=f'id="{table.name}"')[1 : 1 + len(table.columns)]
        assert [row[0] for row in rows] == list(table.column_names)
        assert [row[3] for row in rows] == [column.meaning for column in table.columns]


def test_the_summary_links_best_and_worst_events():
    page = summary()
    best = rows_of(page, after="Largest gains")[1:11]
    worst = rows_of(page, after="Smallest gains")[1:11]
    gains = [float(row[-1].replace("−", "-")) for row in best]
    assert gains == sorted(gains, reverse=True)
    assert float(worst[0][-1].replace("−", "-")) == min(float(r[-1].replace("−", "-")) for r in worst)
    assert f'href="events/{best[0][0]}.html"' in page


def test_the_summary_shows_the_primary_accounting_only_and_names_unknown_quantities():
    rows = rows_of(summary(), after="Losses by policy")
    assert rows[1][:3] == ["Local optimum", "Benchmark", "total loss"]
    assert any("some_new_quantity" in row for row in rows)


def test_failed_cross_checks_are_shown():
    rows = rows_of(summary(), after='id="quality"')
    assert [row[-1] for row in rows[1:5]] == ["–", "–", "travelled", "–"]


def test_a_run_in_which_nothing_is_feasible_still_has_a_summary():
    tables = sample_summary(6)
    losses = tables.losses.assign(loss_total=float("nan"), loss_av=float("nan"), loss_hv=float("nan"))
    page = summary_page(replace(tables, losses=losses, gain_map=tables.gain_map.assign(gain=float("nan"))))
    assert "Largest gains" in page


def test_beliefs_and_pooling_are_told_in_words():
    page = of_calibration()
    assert "Believable one by one: L." in page
    rows = rows_of(page, after='id="pooling"')
    assert [row[0] for row in rows[1:4]] == ["not at all: own fit", "strength 0.1", "entirely: the median drives"]
    assert rows[2][1:] == ["0.1250", "0.0875", "75", "4"]


def two_models():
    """The matrix of a default model and of one that planned a sample."""
    other = matrix().assign(followers="table3", n_events=9)
    other[["gain", "gain_low", "gain_high"]] -= 0.5
    return pd.concat([matrix(), other], ignore_index=True)


def test_the_matrix_shows_both_follower_models_the_default_first_and_strata_of_that_one():
    page = matrix_page(two_models())
    titles, *rows = rows_of(page)[:13]
    assert titles[0] == "Followers"
    assert [row[0] for row in rows] == ["own fit"] * 6 + ["Table 3 means"] * 6
    one = of_matrix()
    assert "Followers" not in rows_of(one)[0][0]
    assert page.count("by stratum</h2>") == one.count("by stratum</h2>") > 0


def test_the_terminal_names_the_follower_models_only_if_there_are_several():
    one, both = matrix_table(matrix()), matrix_table(two_models())
    assert [column.header for column in one.columns][:2] == ["form", "accounting"]
    assert [column.header for column in both.columns][:3] == ["followers", "form", "charged"]
    assert list(both.columns[0].cells) == ["own_fit"] * 6 + ["table3"] * 6


def test_the_terminal_holds_the_added_gain_and_says_why_there_is_no_interval():
    table = matrix_table(matrix())
    cells = dict(
        zip((column.header for column in table.columns), (list(c.cells) for c in table.columns), strict=True)
    )
    whole = matrix().query("stratum == 'all'")
    assert cells["added"] == [f"{100 * v:.2f}" for v in whole["gain_incremental"]]
    assert "no interval" not in str(table.caption)
    few = matrix_table(matrix().assign(n_clusters=3, gain_low=np.nan, gain_high=np.nan))
    assert str(few.caption).endswith("; no interval: 3 recordings, at least 5 are needed")


def test_the_matrix_s_cells_are_counted():
    assert "18 cells of the matrix have an interval. Of so many 95 % intervals about 0.9 miss" in matrix_page(
        matrix()
    )
    few = matrix_page(matrix().assign(n_clusters=3, gain_low=np.nan, gain_high=np.nan))
    assert "No cell has an interval." in few
    assert few.count("No interval: 3 recordings, at least 5 are needed.") == 1


def test_cross_scores_hold_every_number():
    table = studies().cross_scores
    for form in names.FORMS:
        rows = rows_of(robustness(), after=f'id="cross-{form}"')[1:37]
        gains = table.loc[table["form"] == form, "gain"]
        assert [row[6] for row in rows] == [f"{100 * g:.2f}".replace("-", "−") for g in gains]


def test_the_wave_in_sumo_stands_beside_that_of_the_planning_model():
    rows = rows_of(robustness(), after='id="sumo"')
    shown = [row for row in rows[1:] if row[0] == "Local optimum"]
    assert [row[1] for row in shown[:4]] == ["HV 1", "HV 1", "HV 2", "HV 2"]
    assert [row[2] for row in shown[:4]] == ["own fit", "SUMO"] * 2
    assert shown[0][3:] == ["8", "1", "21.00", "1.50", "2.00"]


def test_without_replays_nothing_is_said_of_sumo():
    full = studies()
    assert 'id="sumo"' not in studies_page(replace(full, sumo_summary=full.sumo_summary.iloc[:0]))


def test_those_who_lose_most_come_first_and_are_linked():
    page = robustness()
    rows = rows_of(page, after='id="worse"')[1:]
    assert len(rows) == 50
    assert rows[0][0] == "01-0060-00100"
    assert rows[0][-2:] == ["60.00", "0.1"]
    assert rows[0][3] == "HV 1"
    assert 'href="events/01-0060-00100.html"' in page


def test_tiles_of_the_gain_map_stand_in_a_table():
    rows = rows_of(summary(), after='id="gain-map"')[1:10]
    assert rows[0][:4] == ["0", "20", "–", "0"]
    assert rows[-1][:4] == ["60", "–", "4", "–"]


def test_a_front_without_a_knee_shows_none():
    rows = rows_of(robustness(), after='id="pareto"')[1:3]
    assert rows[0][7:9] == ["21.50", "21.50"]
    assert rows[1][7:9] == ["–", "–"]


def test_tracking_shows_planned_beside_tracked():
    rows = rows_of(robustness(), after='id="tracking"')
    assert rows[1][:4] == ["kinematic bicycle", "Human", "39", "1"]
    assert rows[1][10:17] == ["12.000", "12.125", "9.000", "9.250", "25.0", "0.0", "12.5"]
    assert [row[:2] for row in rows[4:7]] == [["multi-body car", row[1]] for row in rows[1:4]]


def test_a_run_without_any_event_still_has_its_pages():
    tables, run = sample_summary(6), sample_run(6)
    nothing = {
        name: getattr(tables, name).iloc[:0]
        for name in ("events", "losses", "matrix", "summary_losses", "summary_lcm", "gain_map", "pareto", "pages")
    }
    crossings = tables.crossings[~tables.crossings["usable"]]
    empty = replace(tables, **nothing, crossings=crossings)
    assert "0 lane changes of 0 recordings" in summary_page(empty)
    assert "All events" in matrix_page(empty.matrix)
    fits = calibration()
    none = {name: getattr(fits, name).iloc[:0] for name in ("summary", "followers", "identifiability", "pooling")}
    assert "0 fitted followers" in calibration_page(calibration(**none, examples=()))
    full = studies()
    nobody = {name: getattr(full, name).iloc[:0] for name in StudyTables.__dataclass_fields__}
    assert "No event has anybody who loses" in studies_page(studies(**nobody))
    assert "0 of them usable" in data_page(recordings(), crossings, empty.events)
    index = IndexTables(
        empty.events, crossings, run.plans.iloc[:0], run.losses.iloc[:0], empty.matrix, empty.pages
    )
    assert "0 events" in index_page(index)


@pytest.mark.parametrize("page", [dictionary_page(), of_matrix(), summary(), robustness()])
def test_pages_ask_for_nothing(page):
    assert "default-src 'none'" in page
    namespaces = {"http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"}
    assert set(re.findall(r"https?://[^\s\"'<)]+", page)) <= namespaces


def test_no_share_is_taken_of_nothing():
    tables = sample_summary()
    rounding = tables.summary_losses.assign(mean_against=1e-15, ratio_of_sums=6e15)
    page = summary_page(replace(tables, summary_losses=rounding))
    assert "6000000000000000" not in page


def test_every_quantity_of_the_tables_has_words():
    assert set(statistics._QUANTITIES) <= set(labels.QUANTITIES)
    assert set(population_tables._QUALITY) <= set(labels.FIT_QUALITY)


def test_one_location_leaves_nothing_to_leave_out():
    tables = studies()
    one = replace(tables, leave_one_out=tables.leave_one_out.assign(location_id=101))
    section = studies_page(one).split('id="locations"')[1].split("</section>")[0]
    assert "All events are of one location" in section
    assert "<table" not in section


def test_a_folded_table_is_named_once():
    section = summary().split('id="gain-map"')[1].split("</section>")[0]
    assert section.count("All tiles") == 1
