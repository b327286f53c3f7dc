"""What a run says in words is what its tables hold, whatever they hold."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from sample_run import recordings, sample_run, sample_summary

from highd_lc.reporting.pages_index import index_page, summary_page
from highd_lc.reporting.run_words import RunTables, run_says
from highd_lc.reporting.short_words import in_short, run_in_short
from highd_lc.vocab import names

PAIRS = {"fixed": ("local_optimum", "benchmark"), "free": ("local_optimum_free", "benchmark_free")}
TITLES = {"fixed": "Fixed end speed", "free": "Free end speed"}


def made_up(n: int = 60, **changes) -> RunTables:
    """``sample_run`` with a matrix that has the shares of what was filmed, and two followers who lose."""
    run = sample_run(n)
    return RunTables(
        recordings=recordings(), crossings=run.crossings, events=run.events, losses=run.losses,
        matrix=run.matrix.assign(share_observed=0.8125), worse=worse(), leave_one_out=leave_one_out(),
        confidence=0.95, tie_band=0.001,
    ) if not changes else replace(made_up(n), **changes)  # fmt: skip


def worse() -> pd.DataFrame:
    rows = [
        ("01-0000-00100", "fixed", "equal", "target_follower_1", 0.02),
        ("01-0000-00100", "fixed", "equal", "target_follower_2", 0.31415),
        ("02-0001-00107", "fixed", "equal", "target_follower_1", 0.05),
        ("03-0002-00114", "fixed", "equal", "together", 0.9),
        ("03-0002-00114", "fixed", "paper", "target_follower_1", 0.8),
    ]
    return pd.DataFrame(rows, columns=["event_id", "form", "accounting", "who", "increase"])


def leave_one_out(*gains: float) -> pd.DataFrame:
    gains = gains or (0.011, 0.032)
    return pd.DataFrame({"form": "fixed", "accounting": "equal", "location_id": range(len(gains)), "gain": gains})


def with_cell(run: RunTables, form: str = "fixed", accounting: str = "equal", **values: float) -> RunTables:
    """The run with other numbers in one cell of the matrix."""
    matrix = run.matrix.copy()
    cell = (matrix["stratum"] == "all") & (matrix["form"] == form) & (matrix["accounting"] == accounting)
    matrix.loc[cell, list(values)] = list(values.values())
    return replace(run, matrix=matrix)


def said(run: RunTables, title: str) -> str:
    return " ".join(dict(run_says(run))[title]).replace("\u00a0", " ")


def percents(text: str) -> list[float]:
    return [float(number) for number in re.findall(r"(\d+\.\d+)(?: %| percentage| to)", text)]


def solved(run: RunTables, form: str, accounting: str = "equal") -> pd.DataFrame:
    """Events with a plan of both policies: their recordings, straight from the losses."""
    rows = run.losses[run.losses["accounting"] == accounting]
    wide = rows.pivot_table(index="event_id", columns="policy", values="loss_total")
    both = wide[list(PAIRS[form])].dropna()
    return run.events.set_index("event_id").loc[both.index]


@pytest.mark.parametrize("form", ["fixed", "free"])
def test_the_numbers_are_those_of_the_matrix(form):
    run = made_up()
    row = run.matrix.query(f"stratum == 'all' and form == '{form}' and accounting == 'equal'").iloc[0]
    text = said(run, TITLES[form])
    used = solved(run, form)["recording_id"].nunique()
    gain, low, high = (f"{100 * row[name]:.2f}" for name in ("gain", "gain_low", "gain_high"))
    assert (
        f"{gain} % less total loss than the benchmark (95 % interval {low} to {high} % less, from {used} r" in text
    )
    n = int(row["n_events"] - row["infeasible"])
    better, worse_ = 100 * row["share_better"], 100 * row["share_worse"]
    assert f"Of {n} events the local optimum is better in {better:.1f} %, worse in {worse_:.1f} %" in text
    assert f"within 0.1 % of the benchmark in {100 - better - worse_:.1f} %" in text
    assert f"The AV's loss is {-100 * row['gain_av']:.2f} % higher" in text
    assert f"the followers' together {100 * row['gain_hv']:.2f} % lower: the AV pays, the followers gain." in text
    if row["infeasible"]:
        assert f"{row['infeasible']} events have no feasible plan of both policies and are left out" in text


def test_what_went_in_is_counted():
    run = made_up()
    text = said(run, "What went in")
    excluded = run.crossings[~run.crossings["usable"]]
    assert f"{run.recordings['recording_id'].nunique()} recordings with {len(run.crossings)} lane-id" in text
    assert f"{run.crossings['usable'].sum()} of these can be used as events, from 6 recordings" in text
    assert f"{len(excluded)} cannot" in text
    assert f"({excluded['reason'].value_counts().iloc[0]})" in text


def test_what_the_accounting_changes_is_a_difference_of_gains():
    run = made_up()
    whole = run.matrix[run.matrix["stratum"] == "all"].set_index(["form", "accounting"]).sort_index()["gain"]
    text = said(run, "What the accounting changes")
    for form, title in TITLES.items():
        paper, equal = whole[form, "paper"], whole[form, "equal"]
        assert paper < equal  # so the sentence has to say less, not more
        line = re.search(rf"{title}: (.*?equal”)", text).group(1)
        assert line.startswith(f"{100 * paper:.2f} % less total loss")
        assert f"{100 * (equal - paper):.2f} percentage points less gain than under “equal”" in line


def test_a_gain_of_the_other_sign_under_paper_is_said():
    run = with_cell(made_up(), accounting="paper", gain=-0.02, gain_low=-0.03, gain_high=-0.01)
    text = said(run, "What the accounting changes")
    assert "Fixed end speed: 2.00 % more total loss (95 % interval 1.00 to 3.00 % more, from" in text
    assert "percentage points less gain than under “equal”, with the other sign" in text


def test_those_who_lose_are_counted_one_by_one():
    text = said(made_up(), "Fixed end speed")
    assert "In 2 events a single follower loses more than 0.1 %, the worst off 31.41 %" in text.replace(
        "31.42", "31.41"
    )
    assert "No single follower loses more than 0.1 % in any event" in said(made_up(), "Free end speed")


def test_a_loss_is_told_in_the_same_voice():
    run = with_cell(
        replace(made_up(), omega_av=0.4),
        gain=-0.0123,
        gain_low=-0.02,
        gain_high=-0.004,
        gain_av=-0.03,
        gain_hv=-0.001,
    )
    text = said(run, "Fixed end speed")
    assert "1.23 % more total loss than the benchmark (95 % interval 0.40 to 2.00 % more" in text
    assert "The interval excludes zero: in this run the benchmark has the lower loss." in text
    assert "3.00 % higher, the followers' together 0.10 % higher: both pay." in text
    assert "1.23 % more total loss" in run_in_short(run).replace("\u00a0", " ")


@pytest.mark.parametrize("gain", [0.001, -0.001])
def test_an_interval_around_zero_decides_nothing(gain):
    run = with_cell(replace(made_up(), omega_av=0.4), gain=gain, gain_low=-0.002, gain_high=0.003)
    for text in (said(run, "Fixed end speed"), run_in_short(run).replace("\u00a0", " ")):
        assert f"0.10 % {'less' if gain > 0 else 'more'} total loss" in text
        assert "95 % interval 0.20 % more to 0.30 % less" in text
        assert "The interval includes zero: this run does not tell which of the two has the lower loss." in text
        assert "excludes" not in text


def test_a_bound_at_zero_is_not_past_it():
    run = replace(made_up(), omega_av=0.4)
    text = said(with_cell(run, gain=0.001, gain_low=0.0, gain_high=0.003), "Fixed end speed")
    assert "interval 0.00 to 0.30 % less" in text
    assert "includes zero" in text


def test_what_rounds_to_nothing_is_small_and_nothing_is_nothing():
    text = said(with_cell(made_up(), gain=0.00002, gain_low=0.00001, gain_high=0.003), "Fixed end speed")
    assert "has under 0.01 % less total loss" in text
    assert "interval under 0.01 to 0.30 % less" in text
    same = said(
        with_cell(made_up(), gain=0.0, gain_low=0.0, gain_high=0.0, gain_av=0.0, gain_hv=0.0), "Fixed end speed"
    )
    assert "has no less and no more total loss than the benchmark" in same
    assert "The AV's loss is no lower and no higher, the followers' together no lower and no higher." in same


def test_one_event_in_thousands_is_not_none():
    text = said(with_cell(made_up(), share_better=0.9998, share_worse=0.0002), "Fixed end speed")
    assert "better in 100.0 %, worse in under 0.1 %, and within 0.1 % of the benchmark in 0.0 %" in text


@pytest.mark.parametrize("gain", [(0.01, 0.005, 0.02), (0.001, -0.002, 0.003), (0.01, np.nan, np.nan)])
def test_a_sign_that_the_optimum_guarantees_is_no_finding(gain):
    run = with_cell(made_up(), **dict(zip(("gain", "gain_low", "gain_high"), gain, strict=True)))
    everything = " ".join(t for _, texts in run_says(run) for t in texts) + run_in_short(run)
    assert "zero" not in everything
    assert "That it is not more was certain before" in said(run, "Fixed end speed")
    assert everything.count("was certain before") == 2  # once in all words, once in short
    assert "Something is wrong" not in everything
    lost = with_cell(made_up(), gain=-0.01, gain_low=-0.02, gain_high=-0.001)
    assert "Something is wrong with the planning of this run" in said(lost, "Fixed end speed")


def without_intervals(run: RunTables, n: int) -> RunTables:
    ends = [f"gain{name}_{end}" for name in ("", "_incremental") for end in ("low", "high")]
    return replace(run, matrix=run.matrix.assign(n_clusters=n, **dict.fromkeys(ends, np.nan)))


def test_three_recordings_have_no_interval_and_the_reason_is_given():
    run = without_intervals(made_up(), 3)
    text = said(run, "Fixed end speed")
    assert text.count("(no interval: 3 recordings, at least 5 are needed)") == 2
    assert "95 %" not in text
    assert "Without an interval nothing is known of how far chance carries these numbers." in said(run, "Caution")
    assert "cells of the matrix" not in said(run, "Caution")
    assert "(no interval: 1 recording, at least 5" in said(without_intervals(made_up(), 1), "Fixed end speed")
    sites = replace(run, clusters="location")
    assert "(no interval: 3 locations, at least 5 are needed)" in said(sites, "Fixed end speed")


def test_sixteen_recordings_have_one_and_the_cells_are_counted():
    run = made_up()
    run = replace(run, matrix=run.matrix.assign(n_clusters=16))
    row = run.matrix.query("stratum == 'all' and form == 'fixed' and accounting == 'equal'").iloc[0]
    text = said(run, "Fixed end speed")
    ends = [f"{100 * row[f'gain_incremental_{end}']:.2f}" for end in ("low", "high")]
    assert (
        f"{100 * row['gain_incremental']:.2f} % less (95 % interval {ends[0]} to {ends[1]} % less, from 16 r"
        in text
    )
    assert "it adds 51.5 in all, the benchmark 60.2" in text
    assert "no interval" not in text
    n = len(run.matrix)
    assert (
        f"{n} cells of the matrix have an interval. Of so many 95 % intervals about {0.05 * n:.1f} miss"
        in said(run, "Caution")
    )
    assert f"a coverage of {100 - 5 / n:.2f} % (Bonferroni)" in said(run, "Caution")
    assert "may be too narrow" not in said(run, "Caution")
    assert (
        "with fewer than 60 recordings (here 16)" in said(replace(run, interval="percentile"), "Caution").lower()
    )


def test_the_added_loss_stands_behind_the_total_and_before_who_pays():
    text = said(made_up(), "Fixed end speed")
    places = [
        text.index(words) for words in ("total loss than", "Of the loss that", "In the median", "The AV's loss")
    ]
    assert places == sorted(places)
    assert "the 5 % of events that save most carry 46 % of the sum" in text


@pytest.mark.parametrize(
    ("reason", "words"),
    [("adds_nothing", "plans add no loss"), ("no_reference", "without a lane change are not known")],
)
def test_why_nothing_is_said_of_the_added_loss(reason, words):
    run = made_up()
    matrix = run.matrix.assign(incremental_reason=reason, gain_incremental=np.nan)
    text = said(replace(run, matrix=matrix), "Fixed end speed")
    assert words in text
    assert "nan" not in text


def test_who_was_selected_is_counted_by_speed_class_and_direction():
    run = made_up()
    crossings = run.crossings.assign(speed_mps=np.where(run.crossings["usable"], 5.0, 35.0))
    text = said(replace(run, crossings=crossings), "Who was selected")
    between = crossings[crossings["direction"] != ""]
    cars = between[between["ego_class"] == names.CAR]
    fast = (between["speed_mps"] > 33).sum()
    assert f"below 15 m/s 100 % of {between['usable'].sum()}, from 33 m/s 0 % of {fast}" in text
    assert f"car {100 * cars['usable'].mean():.0f} % of {len(cars)}" in text
    assert "were found, the local optimum has" in text


def test_a_form_in_which_nothing_is_feasible_has_no_number():
    run = made_up()
    losses = run.losses.assign(loss_total=np.nan)
    matrix = run.matrix.assign(infeasible=run.matrix["n_events"], gain=np.nan, gain_low=np.nan, gain_high=np.nan)
    empty = replace(run, losses=losses, matrix=matrix, leave_one_out=leave_one_out(np.nan, np.nan))
    text = said(empty, "Fixed end speed")
    n = int(matrix.query("form == 'fixed' and accounting == 'equal' and stratum == 'all'")["n_events"].iloc[0])
    assert text.endswith(f"No gain can be given: none of {n} events has a feasible plan of both policies.")
    everything = " ".join(t for _, texts in run_says(empty) for t in texts) + run_in_short(empty)
    assert "nan" not in everything
    assert "–" not in everything
    assert "0.00" not in everything


def test_a_form_that_was_not_planned_is_named_and_nothing_more():
    run = made_up()
    fixed = replace(run, matrix=run.matrix[run.matrix["form"] == "fixed"])
    assert "Free end speed" not in dict(run_says(fixed))
    assert said(fixed, "Not planned").startswith("Free end speed; Chosen start, fixed end speed; ")
    assert "Free end speed" not in said(fixed, "What the accounting changes")
    assert "Free end speed" not in said(run, "Not planned")


def test_a_sample_is_called_one():
    run = with_cell(made_up(), n_events=8, infeasible=1)
    assert said(run, "Fixed end speed").startswith("Planned for a sample of 8 of the 60 events. The local optimum")
    assert "1 event has no feasible plan of both policies and is left out" in said(run, "Fixed end speed")
    assert "Fixed end speed: the result rests on 7 events, and a single one can carry it." in said(run, "Caution")


def test_a_run_without_events_says_so_and_nothing_else():
    run = made_up()
    crossings = run.crossings[~run.crossings["usable"]]
    empty = replace(run, events=run.events.iloc[:0], crossings=crossings, matrix=run.matrix.iloc[:0])
    assert [title for title, _ in run_says(empty)] == ["What went in", "What comes out"]
    nothing = (
        "Nothing can be said of the local optimum: no usable event, because not one of "
        f"{len(crossings)} lane-id changes can be used."
    )
    assert said(empty, "What comes out") == run_in_short(empty) == nothing
    none = replace(empty, crossings=crossings.iloc[:0])
    assert "no lane-id change was found" in run_in_short(none)


def test_one_location_is_a_caution():
    run = made_up()
    assert "All recordings are of one location" in said(run, "Caution")
    two = replace(run, recordings=run.recordings.assign(location_id=run.recordings["recording_id"]))
    assert "of one location" not in said(two, "Caution")


def test_what_was_filmed_and_where():
    run = made_up()
    assert said(run, "What was filmed").startswith("81.2 % of the follower-seconds charged")
    without = replace(run, matrix=run.matrix.drop(columns="share_observed"))
    assert "is not available" in said(without, "What was filmed")
    assert said(run, "Other places").endswith(
        "out one of 2 locations after the other: 1.10 to 3.20 % less total loss."
    )
    one = replace(run, leave_one_out=leave_one_out(np.nan))
    assert "All events are of one location" in said(one, "Other places")
    turns = replace(run, leave_one_out=leave_one_out(-0.01, 0.02))
    assert said(turns, "Other places").endswith("1.00 % more to 2.00 % less total loss.")


def test_the_pages_begin_with_the_words_and_escape_them(undrawn):
    hostile = [("<b>title", ("<img src=x>", "50 % & more"))]
    page = summary_page(sample_summary(6), hostile)
    assert "<img" not in page
    assert "&lt;img src=x&gt;" in page
    assert page.index('id="says"') < page.index("Local optimum against benchmark")
    index = index_page(sample_run(6), says="<img src=x>")
    assert "<img" not in index
    assert 'href="summary.html#says"' in index
    assert "What this run says" not in index_page(sample_run(6))


def test_no_number_is_tuned_by_the_name_of_the_policy():
    """Benchmark and local optimum exchanged: the same sentences with the other words."""
    row = {"gain": 0.01, "gain_low": 0.005, "gain_high": 0.02, "gain_av": -0.01, "gain_hv": 0.03}
    turned = {"gain": -0.01, "gain_low": -0.02, "gain_high": -0.005, "gain_av": 0.01, "gain_hv": -0.03}
    better, worse_ = (said(with_cell(made_up(), **r), "Fixed end speed") for r in (row, turned))
    assert percents(better) == percents(worse_)
    assert names.PRIMARY_ACCOUNTING == "equal"


def short(run: RunTables) -> dict[str, str]:
    return {title: " ".join(texts).replace("\u00a0", " ") for title, texts in in_short(run)}


def test_in_short_tells_what_was_found_how_sure_it_is_and_what_would_change_it():
    hidden = "The gain cannot be seen: the error is 14 times the effect (fixed end speed)."
    run = with_cell(replace(made_up(), believed=hidden), gain=0.0123, gain_low=0.004, gain_high=0.02)
    text = short(run)
    assert list(text) == ["What was found", "How sure that is", "What would change it"]
    assert "1.23 % less total loss than the benchmark, as simulated" in text["What was found"]
    assert text["How sure that is"].startswith("95 % interval 0.40 to 2.00 % less")
    assert hidden.removeprefix("The") in text["How sure that is"]
    assert "Under the accounting “paper”" in text["What would change it"]


def test_in_short_refuses_an_interval_of_few_recordings():
    text = short(without_intervals(made_up(), 4))["How sure that is"]
    assert text.startswith("No interval: 4 recordings, at least 5 are needed.")
    assert "Without an interval nothing is known" in text


def test_in_short_says_nothing_of_no_gain():
    assert in_short(with_cell(made_up(), gain=np.nan)) == []


def test_a_share_of_little_is_warned_of():
    run = with_cell(made_up(), total_benchmark=1000.0, added_benchmark=8.0, incremental_reason="")
    assert "All that it adds is 0.8 % of the benchmark's loss" in said(run, "Fixed end speed")
    much = with_cell(made_up(), total_benchmark=1000.0, added_benchmark=300.0, incremental_reason="")
    assert "All that it adds" not in said(much, "Fixed end speed")
