import json
import math
import re

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from highd_lc.reporting import html, labels
from highd_lc.reporting.drawing import INK
from highd_lc.vocab import names


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (1.2345, 2, "1.23"),
        (-1.2345, 2, "−1.23"),
        (-0.0001, 2, "0.00"),
        (7, 0, "7"),
        (float("nan"), 2, "–"),
        (math.inf, 2, "–"),
        (None, 2, "–"),
        (pd.NA, 2, "–"),
    ],
)
def test_numbers(value, digits, text):
    assert html.number(value, digits) == text


def test_percent():
    assert html.percent(0.0123) == "1.23 %"
    assert html.percent(float("nan")) == "–"


def test_cells_take_one_precision_or_one_each():
    assert html.cells([1.0, None], 1) == '<td class="n">1.0</td><td class="n">–</td>'
    assert html.cells([(1.0, 2), (2.0, 0)]) == '<td class="n">1.00</td><td class="n">2</td>'


def test_cells_of_every_kind_stand_side_by_side():
    values = [1.0, -2.5, float("nan"), -0.001, math.inf, 3]
    assert html.cells(values, 2) == "".join(html.cells([value], 2) for value in values)
    assert html.cells([*values, None], 2) == html.cells(values, 2) + html.cells([None], 2)
    assert html.cells([], 2) == html.cells(iter(()), 2) == ""


def test_json_cannot_leave_its_script_element():
    hostile = {"a": "</script><script>alert(1)</script>", "b": "<!--", "c": "\u2028&"}
    text = html.json_script(hostile)
    assert "<" not in text
    assert ">" not in text
    assert json.loads(text) == hostile


def test_json_refuses_nan():
    with pytest.raises(ValueError, match="not JSON compliant"):
        html.json_script([np.nan])


def test_every_word_has_a_label():
    assert set(names.POLICIES) < set(labels.POLICIES)
    assert set(labels.REASONS) == set(names.REASONS)
    assert set(labels.STATUSES) == {*names.PLAN_STATUSES, names.FAULTY}
    assert set(labels.FIT_STATUSES) == set(names.FIT_STATUSES)
    assert set(labels.ACCOUNTINGS) == set(labels.ACCOUNTING_NAMES) == set(names.ACCOUNTINGS)


def test_strata_are_said_with_their_units():
    assert labels.stratum("spacing=15 to 30") == "spacing to HV 1: 15 to 30 m"
    assert labels.stratum("class=Car") == "class: Car"
    assert labels.stratum("all") == "all"


def test_policies_differ_in_colour_on_both_grounds():
    looks = labels.POLICIES.values()
    assert len({look.light for look in looks}) == len(labels.POLICIES)
    assert len({look.dark for look in looks}) == len(labels.POLICIES)


def luminance(colour: str) -> float:
    channels = np.array([int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)])
    linear = np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def contrast(a: str, b: str) -> float:
    dark, light = sorted((luminance(a), luminance(b)))
    return (light + 0.05) / (dark + 0.05)


@pytest.mark.parametrize("policy", labels.POLICIES)
def test_lines_stand_out_from_the_ground(policy):
    look = labels.POLICIES[policy]
    # WCAG 1.4.11: 3:1 for graphics.
    assert contrast(look.light, "#ffffff") >= 3.0
    assert contrast(look.dark, "#14171a") >= 3.0


def test_figures_take_the_colours_of_the_page():
    figure = Figure()
    axes = figure.add_subplot()
    axes.plot([0, 1], color=labels.POLICIES[names.BENCHMARK].light)
    axes.set_title("a < b", color=INK)
    svg = html.inline_svg(figure, 'says "more" < less')
    assert svg.startswith("<svg ")
    assert "var(--policy-benchmark)" in svg
    assert "currentColor" in svg
    assert INK not in svg
    assert "#ffffff" not in svg
    assert 'aria-label="says &#34;more&#34; &lt; less"' in svg


def test_equal_figures_give_equal_svg():
    def draw():
        figure = Figure()
        figure.add_subplot().plot([0, 1], [1, 0])
        return html.inline_svg(figure, "line")

    assert draw() == draw()


def test_style_defines_a_colour_for_every_policy():
    sheet = html.style("base")
    for policy in labels.POLICIES:
        assert re.search(rf"--policy-{policy}: light-dark\(", sheet)


def test_of_links_to_pages_that_are_not_made_the_words_stay():
    page = (
        '<nav>\n<a href="prediction.html">P</a>\n</nav><p><a href="../prediction.html">How</a> '
        '<a href="data.html">D</a>'
    )
    assert html.without(page, ["prediction.html"]) == '<nav>\n</nav><p>How <a href="data.html">D</a>'
    assert html.without(page, []) == page
