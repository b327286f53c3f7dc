"""The sentences on a chosen start tell what the tables hold."""

from dataclasses import replace

from sample_event import plan_row, sample_event

from highd_lc.reporting.pages_event import start_sentences
from highd_lc.vocab import names


def with_start(delay_s: float, gap: str):
    report = sample_event()
    plan = plan_row(names.LOCAL_OPTIMUM_START, names.EQUAL, 5.0, 0.0) | {"delay_s": delay_s, "gap": gap}
    before = report.loss(names.LOCAL_OPTIMUM)
    loss = before | {
        "policy": names.LOCAL_OPTIMUM_START,
        "loss_av": before["loss_av"] + 0.25,
        "loss_hv": before["loss_hv"] - 1.5,
        "loss_total": before["loss_total"] - 1.25,
        "loss_hv_each": [before["loss_hv_each"][0] - 4.5, *before["loss_hv_each"][1:]],
        "peak_follower_decel": 0.4,
    }
    return replace(report, plans=(*report.plans, plan), losses=(*report.losses, loss))


def test_a_wait_is_told_with_what_it_costs_and_saves():
    (text,) = start_sentences(with_start(1.9, names.gap_behind(1)))
    assert "waits 1.9 s and goes into the gap behind HV 1" in text
    assert "The AV pays 0.25 of loss; the followers together save 1.50 of loss" in text
    assert "(HV 1 −4.50, HV 2 +0.00, HV 3 +0.00)" in text
    assert "Strongest braking of a follower: 0.4 instead of 1.2 m/s²" in text


def test_a_start_that_changes_nothing_says_so():
    (text,) = start_sentences(with_start(0.0, names.RECORDED_GAP))
    assert text.endswith("no other start and no other gap is better than the recorded ones.")


def test_without_a_chosen_start_there_is_nothing_to_say():
    assert start_sentences(sample_event()) == []
