"""Claims: each direction judged as stated, ties and missing plans told apart."""

import pytest
from few_scenarios import few_scenarios

from highd_lc.scenarios.claims import CLAIMS, claim_rows, judge
from highd_lc.scenarios.ledger import Book
from highd_lc.vocab import names
from highd_lc.vocab.published import SCENARIO_1, SCENARIO_2

BY_NAME = {claim.name: claim for claim in CLAIMS}
BASE = {
    "status": "solved",
    "v_start": 25.0,
    "v_end": 25.0,
    "av_v_max": 25.1,
    "loss_av": 10.0,
    "loss_hv": 20.0,
    "loss_total": 30.0,
    "ttt_difference_s": 3.0,
    "flow_veh_h": 1700.0,
    "speed_km_h": 75.0,
    "density_veh_km": 22.0,
    "av_ay_max": 1.0,
    "hv_v_min": [20.0] * 10,
}


def book_of(**local):
    rows = []
    for scenario in ("1", "2_15", "2_20", "3"):
        variant = "v_av=25" if scenario == "3" else "default"
        for form in names.FORMS:
            for accounting in names.ACCOUNTINGS:
                key = {"scenario": scenario, "variant": variant, "form": form, "accounting": accounting}
                rows += [key | BASE | {"omega_av": 1.0}, key | BASE | local | {"omega_av": 0.5}]
    return Book.of(rows, few_scenarios())


def judged(claim, **local):
    return judge(
        BY_NAME[claim], "1", variant="default", form=names.FIXED, accounting=names.PAPER, book=book_of(**local)
    )


@pytest.mark.parametrize(
    ("claim", "column", "holds", "fails"),
    [
        ("hv_loss_falls", "loss_hv", 15.0, 25.0),
        ("total_loss_falls", "loss_total", 29.0, 31.0),
        ("av_loss_rises", "loss_av", 11.0, 9.0),
        ("travel_time_falls", "ttt_difference_s", 2.0, 4.0),
        ("av_faster", "av_v_max", 28.0, 24.0),
        ("flow_rises", "flow_veh_h", 1800.0, 1600.0),
        ("speed_rises", "speed_km_h", 80.0, 70.0),
        ("density_falls", "density_veh_km", 20.0, 24.0),
        ("lateral_acceleration_falls", "av_ay_max", 0.8, 1.2),
    ],
)
def test_directions(claim, column, holds, fails):
    assert judged(claim, **{column: holds}) == "holds"
    assert judged(claim, **{column: fails}) == "fails"
    assert judged(claim, **{column: BASE[column] * 1.0005}) == "unchanged"


def test_returning_means_faster_first_and_the_same_speed_at_the_end():
    assert judged("av_returns", av_v_max=28.0) == "holds"
    assert judged("av_returns", av_v_max=28.0, v_end=28.0) == "fails"
    assert judged("av_returns", av_v_max=25.1) == "unchanged"


def test_far_followers_gain_most_means_that_nobody_loses():
    gains = [0.0, 0.0, 0.5, 1.0, 2.0, 5.0, 4.0, 3.0, 2.0, 1.0]
    far = [20.0 + gain for gain in gains]
    assert judged("far_followers_gain", hv_v_min=far) == "holds"
    assert judged("far_followers_gain", hv_v_min=far[::-1]) == "holds"
    assert judged("far_followers_gain", hv_v_min=[28.0, *far[1:]]) == "fails"
    assert judged("far_followers_gain", hv_v_min=[19.0, *far[1:]]) == "fails"
    assert judged("far_followers_gain", hv_v_min=[20.001] * 10) == "unchanged"


def test_a_plan_that_is_not_valid_counts_for_no_claim():
    assert judged("hv_loss_falls", loss_hv=15.0, not_valid="collision") == "not_valid"
    rows = claim_rows(book_of(loss_hv=15.0, not_valid="T on its bound"))
    row = next(r for r in rows if r["claim"] == "hv_loss_falls" and r["scenario"] == "1")
    assert row["default_verdict"] == "not_valid"
    assert row["cells"] == row["holds"] == 0
    assert row["not_valid_under"] == ["default"]


def test_no_plan_and_no_number_are_no_verdict():
    assert judged("hv_loss_falls", status="infeasible") == "no_plan"
    assert judged("travel_time_falls", ttt_difference_s=float("nan")) == "no_plan"


def test_claims_hold_for_the_papers_own_numbers():
    printed = {(n.scenario, n.policy, n.quantity): n.value for n in SCENARIO_1 + SCENARIO_2 if not n.omega_given}
    for claim in CLAIMS:
        for scenario in ("1", "2_15", "2_20"):
            column = {
                "hv_loss_falls": "loss_hv",
                "total_loss_falls": "loss_total",
                "av_loss_rises": "loss_av",
            }.get(
                claim.name,
                {"travel_time_falls": "ttt_difference_s", "flow_rises": "flow_veh_h"}.get(claim.name),
            )
            keys = [(scenario, policy, column) for policy in (names.BENCHMARK, names.LOCAL_OPTIMUM)]
            if all(key in printed for key in keys):
                benchmark, local = ({column: printed[key]} for key in keys)
                assert claim.change(benchmark, local) > 0.0, claim.name


def test_every_claim_has_a_row_in_every_cell():
    rows = claim_rows(book_of(loss_hv=15.0))
    keys = {(r["claim"], r["scenario"], r["form"], r["accounting"]) for r in rows}
    assert len(keys) == len(rows)
    for row in rows:
        assert row["cells"] == row["holds"] + row["fails"] + row["unchanged"]
        assert len(row["holds_under"]) == row["holds"]
