import html as escapes
import re
from dataclasses import replace

import numpy as np
import pytest
from page_text import rows_of
from sample_event import EVENT_ID, infeasible_event, sample_event, unplanned_event
from sample_prediction import trace

from highd_lc.reporting import html
from highd_lc.reporting.event import gain
from highd_lc.reporting.event_rows import LOSS_COLUMNS
from highd_lc.reporting.pages_event import Links, event_page
from highd_lc.vocab import names

_LIMIT = 250_000


def text_of(page: str) -> str:
    body = re.sub(r"<(script|style).*?</\1>", "", page, flags=re.DOTALL)
    return " ".join(escapes.unescape(re.sub(r"<[^>]+>", " ", body)).split())


def loss_cells(page: str, accounting: str, policy: str) -> list[float]:
    table = page.split(f'data-accounting="{accounting}"')[1]
    row = table.split(f'data-policy="{policy}"')[1].split("</tr>")[0]
    return [float(cell.replace("−", "-")) for cell in re.findall(r'<td class="n">([^<]+)</td>', row)]


@pytest.mark.parametrize("policy", names.REFERENCE_POLICIES + names.FIXED_POLICIES + names.FREE_POLICIES)
@pytest.mark.parametrize("accounting", names.ACCOUNTINGS)
def test_losses_on_the_page_are_those_of_the_table(policy, accounting):
    report = sample_event()
    row = report.loss(policy, accounting)
    shown = loss_cells(event_page(report, Links()), accounting, policy)
    truth = [row[name] for name in LOSS_COLUMNS] + row["loss_hv_each"]
    np.testing.assert_allclose(shown, truth, atol=5.1e-4)


def test_gain_is_that_of_the_primary_cell():
    report = sample_event()
    local, benchmark = (report.loss(p)["loss_total"] for p in (names.LOCAL_OPTIMUM, names.BENCHMARK))
    assert report.gain() == pytest.approx(1 - local / benchmark)
    assert f"{100 * report.gain():.2f} %" in text_of(event_page(report, Links()))


def page_with(**changed) -> str:
    report = sample_event()
    return text_of(event_page(replace(report, event={**report.event, **changed}), Links()))


def test_a_page_says_where_the_target_leader_is_and_whether_it_stays():
    assert "55.4 m ahead" in page_with()
    assert "leaves it" not in page_with()
    leaves = page_with(leader_leaves_s=3.24, leader_changes_s=[3.24])
    assert "55.4 m ahead, leaves it after 3.2 s" in leaves
    assert "The leader on that lane leaves it 3.2 s after the start; nobody in view leads from then on" in leaves
    followed = page_with(leader_leaves_s=3.24, leader_changes_s=[3.24], later_leader_ids=[44])
    assert "the next vehicle ahead leads from then on" in followed
    assert "Leader on target lane none" in page_with(gap_ahead_m=np.nan)


@pytest.mark.parametrize(("local", "benchmark"), [(np.nan, 1.0), (1.0, np.nan), (1.0, 0.0)])
def test_gain_is_unknown_without_both_totals(local, benchmark):
    assert np.isnan(gain(local, benchmark))


@pytest.mark.parametrize("p", [1, 3, 10])
def test_a_page_stays_small(p):
    assert len(event_page(sample_event(p), Links(png=True)).encode()) < _LIMIT


def test_a_page_asks_for_nothing():
    page = event_page(sample_event(), Links())
    assert "default-src 'none'" in page
    addresses = set(re.findall(r"https?://[^\s\"')]+", page)) - {"http://www.w3.org/2000/svg"}
    assert not addresses
    assert not re.search(r"<(link|img|iframe)\b|\bsrc=", page)


def test_an_infeasible_event_says_why():
    report = infeasible_event()
    text = text_of(event_page(report, Links()))
    assert "Benchmark; Local optimum: none of 3888 candidates meets all constraints" in text
    assert text.count("none of 3888 candidates") == 1
    assert "Rejected by: lateral jerk 1200, clearance to target leader 34." in text
    assert "−0.75" in text
    assert np.isnan(report.gain())


def test_an_event_without_plans_says_so_and_has_no_empty_sections():
    page = event_page(unplanned_event(), Links())
    assert "This event could not be planned; the run lists why." in text_of(page)
    assert "is planned in its place" not in text_of(page)
    headings = re.findall(r"<h2[^>]*>(.*?)</h2>", page)
    assert headings == ["Motion", "Calibration of the followers", "Provenance"]


def test_an_overlap_at_the_start_says_so():
    report = infeasible_event()
    rows = [
        {**r, "status": names.INFEASIBLE_AT_START} if r["status"] == names.INFEASIBLE else r for r in report.plans
    ]
    text = text_of(event_page(replace(report, plans=tuple(rows)), Links()))
    assert "vehicles overlap already at the start" in text


def test_text_from_data_is_escaped():
    report = sample_event()
    hostile = "<script>alert(1)</script>"
    fits = ({**report.fits[0], "status": names.POOL, "reason": hostile}, *report.fits[1:])
    event = {**report.event, "ego_class": hostile}
    page = event_page(replace(report, fits=fits, event=event, provenance=((hostile, hostile),)), Links())
    assert hostile not in page
    assert page.count("&lt;script&gt;") >= 3


def test_links_lead_to_neighbours_and_pictures():
    page = event_page(sample_event(), Links(previous="07-0001-00001", png=True, vector=("pdf",)))
    assert 'href="07-0001-00001.html" rel="prev"' in page
    assert f'href="{EVENT_ID}.png"' in page
    assert f'href="{EVENT_ID}.pdf"' in page
    assert 'rel="next"' not in page


def test_raw_pages_warn():
    assert "licence of the data" in text_of(event_page(sample_event(), Links(), raw=True))
    assert "licence of the data" not in text_of(event_page(sample_event(), Links()))


def test_model_error_stands_beside_the_effect_over_the_same_samples():
    report = sample_event()
    text = text_of(event_page(report, Links()))
    assert "9.75 as recorded and 9.25 as simulated, a difference of −0.50" in text
    seen = [report.loss(policy)["loss_hv_in_view"] for policy in (names.LOCAL_OPTIMUM, names.BENCHMARK)]
    assert f"changes it by {html.number(seen[0] - seen[1], 2)} against the benchmark" in text


def test_an_effect_without_a_plan_is_said_to_be_unknown():
    assert "What the local optimum changes is not known" in text_of(event_page(infeasible_event(), Links()))


def test_model_error_is_left_out_where_nobody_is_filmed():
    losses = tuple(row | {"loss_hv_in_view_recorded": float("nan")} for row in sample_event().losses)
    assert "Model error" not in text_of(event_page(replace(sample_event(), losses=losses), Links()))


def test_an_event_shows_each_model_s_error():
    text = event_page(replace(sample_event(), prediction=trace()), Links())
    rows = rows_of(text, after='id="h-prediction"')[1:3]
    t = trace().t
    assert rows[0] == ["constant speed", "8.0", "0.8", html.number(np.sqrt(np.mean((0.1 * t) ** 2)), 1)]
    assert rows[1] == ["population (plans)", "6.0", "0.5", "0.5"]


def test_an_event_without_such_motion_has_no_such_section():
    assert "h-prediction" not in event_page(sample_event(), Links())


def test_a_model_out_of_view_has_dashes():
    nowhere = replace(trace(), models={"mine": np.full(trace().t.size, np.nan)})
    text = event_page(replace(sample_event(), prediction=nowhere), Links())
    assert rows_of(text, after='id="h-prediction"')[1] == ["mine", "–", "–", "–"]
