"""The page on followers shows the numbers of its tables, and says what is not there."""

import io
import re
from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest
from page_text import rows_of
from rich.console import Console
from sample_event import sample_event
from sample_prediction import (
    DEFAULT,
    HORIZONS,
    MODELS,
    aims,
    dose_response,
    externality,
    nobody,
    prediction,
    prediction_summary,
    sample_prediction,
)
from sample_run import matrix, sample_run, sample_summary
from sample_studies import studies

from highd_lc.reporting import figures_prediction as figures
from highd_lc.reporting import html, labels
from highd_lc.reporting.pages_data import Section, believed_section
from highd_lc.reporting.pages_event import Links, event_page
from highd_lc.reporting.pages_index import index_page, summary_page
from highd_lc.reporting.pages_population import matrix_page
from highd_lc.reporting.pages_prediction import prediction_page
from highd_lc.reporting.pages_studies import studies_page
from highd_lc.reporting.terminal import aims_table, prediction_lines, prediction_table
from highd_lc.scoring.population import Bootstrap, mean_interval_of
from highd_lc.vocab import names


@cache
def page() -> str:
    return prediction_page(sample_prediction())


def section(text: str, anchor: str) -> str:
    return text.split(f'id="{anchor}"')[1].split("</section>")[0]


def shown(value: float, digits: int = 2) -> str:
    return html.number(value, digits)


def test_every_skill_stands_in_the_table_naive_models_first():
    rows = rows_of(page(), after='id="skill"')[1 : 1 + len(MODELS) * len(HORIZONS)]
    assert [row[0] for row in rows[:: len(HORIZONS)]] == [
        "constant speed", "decaying acceleration", "drift and decaying acceleration", "own fit",
        "own fit with relaxation", "Table 3 means", "population (plans)", "population without memory",
    ]  # fmt: skip
    table = sample_prediction().prediction_summary.query("stratum == 'all'").set_index(["model", "horizon_s"])
    for row, (model, horizon) in zip(rows, [(m, h) for m in MODELS for h in HORIZONS], strict=True):
        of = table.loc[model, horizon]
        numbers = [of[f"skill_{name}{end}"] for name in ("constant", "naive") for end in ("", "_low", "_high")]
        assert row[1:9] == [f"{horizon:g}", str(of["n_events"]), *map(shown, numbers)]


def test_likeness_has_simulated_beside_recorded_and_counts_contacts():
    tables = sample_prediction()
    rows = {row[0]: row for row in rows_of(page(), after='id="likeness"')[1 : 1 + len(MODELS)]}
    at = tables.prediction_summary.query("stratum == 'all' and horizon_s == 5").set_index("model")
    own = tables.prediction.query("horizon_s == 5").groupby("model")[["loss_simulated", "loss_recorded"]].mean()
    for model, row in zip((names.OWN_FIT, names.TABLE3), (rows["own fit"], rows["Table 3 means"]), strict=True):
        means = ("peak_decel_simulated", "peak_decel_recorded", "comfort_simulated", "comfort_recorded")
        numbers = [*(at.loc[model, name] for name in means), *own.loc[model], at.loc[model, "loss_error"]]
        assert row[1] == "40"
        assert row[7:14] == list(map(shown, numbers))
    assert [rows[m][14:16] for m in ("own fit", "Table 3 means")] == [["0", "1"], ["2", "1"]]


def test_the_dose_response_has_its_classes_in_order_and_their_numbers():
    rows = rows_of(page(), after='id="dose"')[1:20]
    assert list(dict.fromkeys(row[0] for row in rows)) == ["< 20", "20 .. 35", "35 .. 60", "> 60"]
    assert [row[1] for row in rows[:5]] == ["< −2", "−2 .. 0", "0 .. 2", "2 .. 5", "> 5"]
    table = dose_response().query("horizon_s == 5").set_index(["model", "spacing", "closing"])
    recorded = table.loc["recorded", "< 20", "2 .. 5"]
    n, change = recorded["n_events"], recorded["change"]
    models = [table.loc[m, "< 20", "2 .. 5"] for m in (DEFAULT, names.OWN_FIT, names.TABLE3)]
    expected = [str(n), shown(change), "0.90", shown(0.9 / np.sqrt(n)), *(shown(m["change"]) for m in models)]
    # Table 3 drives into somebody in three events of the class: they are left out, and it is said.
    assert rows[3][2:] == [*expected, "3", "0.30", *(shown(m["peak_decel"]) for m in models)]
    text = section(page(), "dose")
    assert "within the band after 5 s: constant speed 0 of 19, " in text
    assert "population 19 of 19, population without memory 19 of 19." in text


def test_aims_stand_with_their_values_and_verdicts():
    text = section(page(), "aims")
    rows = rows_of(page(), after='id="aims"')[1:8]
    assert rows[0] == ["skill against constant speed", "5", "0.55", "at least 0.50", "met"]
    assert rows[1] == ["bias of speed [m/s]", "5", "−0.30", "−0.10 to 0.10", "not met"]
    assert rows[2][2:] == ["12 of 16", "at least 12", "met"]
    assert rows[3][2:] == ["–", "–", "not known: fewer than five events"]
    assert rows[4][2:] == ["0.50", "0.20 to 0.40 (observed 0.30, interval over recordings)", "not met"]
    assert rows[5][2:] == ["1 of 55", "at most 2", "met"]
    assert "Table 3 means" in text
    assert "The model meets 3 of the 6 aims" in section(page(), "believed")
    assert "1 cannot be judged here" in section(page(), "believed")


def test_each_recording_has_its_skill_and_a_verdict(undrawn):
    tables = sample_prediction()
    rows = tables.prediction_summary.copy()
    one = (rows["stratum"] == "recording=06") & (rows["model"] == DEFAULT) & (rows["horizon_s"] == 5.0)
    skill = ["skill_constant", "skill_constant_low", "skill_constant_high"]
    rows.loc[one, skill] = [-0.12, -0.20, -0.04]
    none = (rows["stratum"] == "recording=02") & (rows["model"] == DEFAULT)
    rows.loc[none, [*skill, "reason"]] = [0.3, np.nan, np.nan, "fewer than five events"]
    text = prediction_page(replace(tables, prediction_summary=rows))
    strata = section(text, "strata")
    assert "recording 06: −0.12 (−0.20 .. −0.04), below 0" in strata
    assert "recording 02: 0.30, not told from 0 (fewer than five events)" in strata
    assert "recording 01: 0.50 (0.40 .. 0.60), above 0" in strata
    below = "In 1 of 6 recordings its skill after 5 s is below 0: recording 06: −0.12 (−0.20 .. −0.04), below 0."
    assert below in section(text, "believed").replace("\u00a0", " ")
    assert "below 0" not in section(page(), "believed")
    lines = prediction_lines(rows, dose_response())
    assert lines[1] == "  constant_speed: 0 of 19"
    assert lines[-1] == "  recording 06: −0.12 (−0.20 .. −0.04), below 0"


@pytest.mark.parametrize(
    "classes",
    [
        ["< 20", "20 - 35", "35 - 60", "> 60"],
        ["< -2", "-2 .. 0", "0 .. 2", "2 .. 5", "> 5"],
        ["< 5", "5-10", "> 10"],
    ],
)
def test_classes_stand_in_their_order(classes):
    assert figures.classes_in_order(pd.Series(sorted(classes))) == classes


def test_strata_hold_every_model():
    rows = rows_of(page(), after='id="strata"')
    assert [row[:3] for row in rows[1:3]] == [["class: Car", "1", "30"], ["class: Car", "2", "30"]]
    assert ["constant speed", "recording: 06", "8", "4"] in [row[:4] for row in rows]


def test_strata_stand_in_the_order_of_their_classes(undrawn):
    tables = sample_prediction(6, 2)
    classes = ("spacing=20 .. 35", "spacing=< 20", "recording=10", "recording=02")
    whole = tables.prediction_summary.query("stratum == 'all'")
    rows = pd.concat([whole, *(whole.assign(stratum=name) for name in classes)])
    text = prediction_page(replace(tables, prediction_summary=rows))
    shown_first = [row[0] for row in rows_of(text, after='id="strata"') if row[1:2] == ["5"]][:4]
    spacings = ["spacing to HV 1: < 20 m", "spacing to HV 1: 20 .. 35 m"]
    assert shown_first == [*spacings, "recording: 02", "recording: 10"]


def test_costs_are_means_by_source_and_beyond_the_controls():
    rows = rows_of(page(), after='id="cost"')
    wide = externality(prediction()).query("horizon_s == 5").pivot_table(
        index=["event_id", "recording_id"], columns="source", values="loss_change"
    )  # fmt: skip
    assert [row[0] for row in rows[1:6:2]] == ["observed", "controls, not cut in on", "constant speed"]
    for name, source in (("observed", "observed"), ("own fit", names.OWN_FIT)):
        row = next(row for row in rows if row[:2] == [name, "5"])
        beyond = (wide[source] - wide["control"]).dropna()
        assert row[2:] == [
            "40", *over_recordings(wide[source]), shown(wide["observed"].mean(), 3),
            "–" if source == "observed" else "1.6 times", str(len(beyond)), *over_recordings(beyond),
        ]  # fmt: skip
    said = section(page(), "cost").replace("\u00a0", " ")
    assert "Over 5 s drivers pay 0.32 (" in said
    assert "population 0.17, 0.53 times; own fit 0.50, 1.6 times; Table 3 means 0.74, 2.3" in said
    assert next(row for row in rows if row[:2] == ["constant speed", "5"])[7] == "inside"


def over_recordings(values):
    """Mean and 95 % interval as the table has them, by the functions of the gains."""
    recordings = values.index.get_level_values("recording_id").to_numpy()
    low, high, _ = mean_interval_of(values.to_numpy(), recordings, Bootstrap(2000, 0.95, 1))
    return [shown(v, 3) for v in (values.mean(), low, high)]


def test_covariates_out_of_balance_are_named():
    text = section(page(), "balance")
    assert "Apart by more: spacing m." in text


def test_error_and_effect_stand_side_by_side():
    tables = sample_prediction()
    human = tables.losses.query("policy == 'human' and accounting == 'equal'")
    error = (human["loss_hv_in_view"] - human["loss_hv_in_view_recorded"]).abs()
    assert error.mean() == pytest.approx(0.5)
    fixed, free = rows_of(page(), after='id="error"')[1:3]
    assert fixed[1:6] == ["40", "0.500", shown(error.median(), 3), "0.250", "0.2500"]
    assert fixed[6:] == ["−0.250", "2.00", "2.00", shown(100 * (error > 0.25).mean(), 1)]
    assert free[6:] == ["−1.000", "0.50", "0.50", shown(100 * (error > 1.0).mean(), 1)]


def test_best_median_and_worst_followers_are_linked():
    text = section(page(), "examples")
    ids = [row[0] for row in rows_of(page(), after='id="examples"')]
    events = prediction()["event_id"].unique().tolist()
    assert ids[1:11] == events[:10]
    assert ids[12:22] == events[15:25]
    assert ids[23:33] == events[::-1][:10]
    assert f'href="events/{events[0]}.html"' in text
    assert "Of 40 followers" in text


def test_the_words_stand_first():
    text = page()
    assert text.index('id="believed"') < text.index('id="judged"') < text.index('id="skill"')
    assert "The gain cannot be seen: the error is" in section(text, "believed").replace("\u00a0", " ")


def test_nobody_in_view_is_said_in_words():
    text = prediction_page(nobody())
    assert "is not known: none is in view behind the recorded lane changer" in text
    assert "<table" not in text
    assert "nan" not in text.lower().split("<body")[1]


def test_a_few_recordings_have_no_intervals_and_no_empty_columns():
    text = prediction_page(sample_prediction(7, 1, intervals=False))
    assert text.count("no interval: fewer than five recordings") == 1
    assert rows_of(text, after='id="skill"')[0] == [
        "Model", "After [s]", "Events", "Skill against constant speed", "against the best naive model",
        "Best naive model",
    ]  # fmt: skip
    assert "from" not in rows_of(text, after='id="likeness"')[0]
    assert "nan" not in text.lower().split("<body")[1]


def test_no_interval_is_said_by_the_figure_where_the_words_cannot():
    tables = sample_prediction(7, 1, intervals=False)
    short = tables.prediction_summary[tables.prediction_summary["horizon_s"] < 5.0]
    text = prediction_page(replace(tables, prediction_summary=short))
    assert text.lower().count("no interval: fewer than five recordings") == 1
    assert "No interval" in section(text, "skill")


@pytest.mark.parametrize("left_out", [("dose_response", "externality", "losses"), ("prediction",)])
def test_any_table_may_be_empty(left_out):
    tables = sample_prediction(6, 2)
    text = prediction_page(replace(tables, **{name: getattr(tables, name).iloc[:0] for name in left_out}))
    assert 'id="skill"' in text


def test_a_missing_number_is_a_dash():
    tables = sample_prediction(6, 5)
    numbers = [name for name in tables.prediction_summary if name.startswith(("bias", "skill", "loss", "comfort"))]
    text = prediction_page(
        replace(tables, prediction_summary=tables.prediction_summary.assign(**dict.fromkeys(numbers, np.nan)))
    )
    assert "nan" not in text.lower().split("<body")[1]


def test_names_of_users_models_are_text():
    hostile = "<script>alert(1)</script>"
    tables = sample_prediction(6, 2)
    renamed = {
        name: getattr(tables, name).replace({"own_fit+relaxation": hostile})
        for name in ("prediction", "prediction_summary", "dose_response")
    }
    text = prediction_page(replace(tables, **renamed))
    assert hostile not in text
    assert "&lt;script&gt;" in text


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("own_fit+relaxation", "own fit with relaxation"),
        ("own_fit@crossing+memory", "own fit from the crossing with memory"),
        ("table3@0.3", "Table 3 means from 0.3 of the way"),
        ("population-memory", "population without memory"),
        ("idm+memory-relaxation", "IDM with memory without relaxation"),
        ("my-model", "my-model"),
        ("recorded", "recorded"),
    ],
)
def test_models_have_words(name, words):
    assert labels.follower_model(name) == words


def test_the_model_that_plans_has_a_colour_of_its_own():
    colours = labels.borrowed_colours([*MODELS, "a", "b", "c"], DEFAULT)
    assert [m for m, of in colours.items() if of == colours[DEFAULT]] == [DEFAULT]
    assert set(colours) >= set(MODELS)


def test_skill_figure_draws_every_value_and_marks_what_is_out_of_range():
    table = sample_prediction().prediction_summary.query("stratum == 'all'")
    figure = figures.skill_figure(table, list(MODELS), DEFAULT)
    assert [axes.get_title(loc="left") for axes in figure.axes] == ["1 s", "2 s", "3 s", "5 s", "8 s"]
    lines = figure.axes[3].lines
    dots = [line.get_xdata()[0] for line in lines if line.get_marker() == "o" and len(line.get_xdata()) == 1]
    expected = table.query("horizon_s == 5").set_index("model").loc[list(MODELS), "skill_constant"]
    assert dots == pytest.approx(expected[expected >= -1.0].tolist())
    # Table 3 against both, and own fit against the best naive model.
    assert sum(line.get_marker() == "<" for line in lines) == 3
    assert [text.get_text() for text in figure.axes[0].get_yticklabels() if text.get_fontweight() == "bold"] == [
        "population"
    ]


def printed(summary) -> str:
    console = Console(width=100, file=io.StringIO())
    console.print(prediction_table(summary))
    return console.file.getvalue()


def test_the_terminal_shows_every_model_and_marks_the_one_that_plans():
    lines = printed(sample_prediction().prediction_summary).splitlines()
    of = {line.split()[0]: line for line in lines if line.strip()}
    assert set(MODELS) <= set(of)
    assert of[DEFAULT].split()[1:6] == ["*", "40", "0.50", "0.40..0.60", "0.23"]
    assert of[names.TABLE3].split()[-4:] == ["0.24", "1.50/0.30", of[names.TABLE3].split()[-2], "2/1"]
    assert "…" not in "".join(lines)
    assert max(map(len, lines)) <= 100


def test_the_terminal_lists_the_aims_of_the_model_that_plans():
    console = Console(width=100, file=io.StringIO())
    console.print(aims_table(aims()))
    text = console.file.getvalue()
    assert re.search(r"classes of dose-response within the band +5 s +12 of 16 +at least 12 +met", text)
    assert text.count("skill against constant speed") == 1
    assert max(map(len, text.splitlines())) <= 100


def test_the_terminal_says_what_is_missing():
    text = printed(prediction_summary(prediction(7, 1), intervals=False))
    assert "nan" not in text
    assert "none is predicted" in printed(nobody().prediction_summary)


FIRST = believed_section(["<b>words</b>", "Second."], linked=True)


@pytest.mark.parametrize(
    ("text", "gain"),
    [
        (summary_page(sample_summary(6), [("What went in", ("So.",))], [FIRST]), 'id="says"'),
        (matrix_page(matrix(), [FIRST]), "All events"),
        (studies_page(studies(), [FIRST]), 'id="cross-fixed"'),
        (index_page(sample_run(6), says="Gain.", believed=FIRST), "What this run says"),
    ],
)
def test_pages_with_a_gain_say_first_what_followers_are_worth(text, gain):
    assert text.index("How far the followers can be believed") < text.index(gain)
    assert "&lt;b&gt;words&lt;/b&gt;" in text
    assert '<a href="prediction.html">how well followers are predicted</a>' in text


def test_words_without_a_page_have_no_link():
    assert believed_section(["Words."], linked=False) == Section(
        "How far the followers can be believed", ("Words.",), anchor="believed"
    )


def test_navigation_leaves_out_what_is_not_made():
    whole = matrix_page(matrix())
    less = html.without(whole, ["prediction.html"])
    assert 'href="prediction.html"' in whole
    assert 'href="prediction.html"' not in less
    assert less.count("<a href") == whole.count("<a href") - 1
    event = html.without(event_page(sample_event(), Links()), ["prediction.html"])
    assert "prediction.html" not in event
    assert 'href="../summary.html"' in event
    assert html.without(whole, []) == whole
