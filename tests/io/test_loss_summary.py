"""Paired differences of policies: ratios of sums where there is something to divide by, followers one by one."""

import numpy as np
import pandas as pd
import pytest

from highd_lc.stages import statistics
from highd_lc.vocab import names
from highd_lc.vocab.sections import StatisticsSettings

SETTINGS = StatisticsSettings(bootstrap=100)
POLICIES = (names.BENCHMARK, names.LOCAL_OPTIMUM, names.NO_LANE_CHANGE)


def made_losses(increments: dict[str, float], each: dict[str, list[list[float]]]) -> pd.DataFrame:
    """Six events of two recordings: loss_hv_increment of each policy and the followers' losses, else ones."""
    columns = set(statistics._QUANTITIES) - {"worst_follower"}
    rows = [
        {
            "event_id": f"{1 + k % 2:02d}-{k:04d}-00001",
            "recording_id": 1 + k % 2,
            "policy": policy,
            "accounting": names.EQUAL,
            "contact": "",
            **dict.fromkeys(columns, 1.0),
            "loss_hv_increment": increments[policy] * (1 + k),
            "loss_hv_each": each[policy][k % len(each[policy])],
        }
        for policy in POLICIES
        for k in range(6)
    ]
    return pd.DataFrame(rows)


@pytest.fixture(scope="module")
def summary() -> pd.DataFrame:
    losses = made_losses(
        {names.BENCHMARK: 2.0, names.LOCAL_OPTIMUM: 1.0, names.NO_LANE_CHANGE: 1e-16},
        {
            names.BENCHMARK: [[1.0, 2.0], [3.0], []],
            names.LOCAL_OPTIMUM: [[0.5, 2.5], [1.0], []],
            names.NO_LANE_CHANGE: [[1.0, 1.0], [1.0], [1.0]],
        },
    )
    found = statistics.summarise_losses(statistics.PolicyLosses(losses), SETTINGS, seed=1)
    return found.set_index(["policy", "against", "quantity"]).sort_index()


def row(summary: pd.DataFrame, against: str, quantity: str) -> pd.Series:
    return summary.loc[(names.LOCAL_OPTIMUM, against, quantity)]


def test_events_with_a_contact_under_either_policy_are_left_out_and_counted():
    losses = made_losses(dict.fromkeys(POLICIES, 1.0), {policy: [[1.0]] for policy in POLICIES})
    for policy, event in ((names.BENCHMARK, 0), (names.LOCAL_OPTIMUM, 3), (names.NO_LANE_CHANGE, 5)):
        at = (losses["policy"] == policy) & losses["event_id"].str.contains(f"-{event:04d}-")
        losses.loc[at, "contact"] = "target_follower_2_through_target_follower_1"
        losses.loc[at, "min_gap_m"] = -1e6
    found = statistics.summarise_losses(statistics.PolicyLosses(losses), SETTINGS, seed=1)
    gap = found[found["quantity"] == "min_gap_m"].set_index(["policy", "against"])
    pair = gap.loc[(names.LOCAL_OPTIMUM, names.BENCHMARK)]
    assert (pair["n"], pair["contacts"], pair["mean"], pair["mean_against"]) == (4, 2, 1.0, 1.0)
    assert gap.loc[(names.LOCAL_OPTIMUM, names.NO_LANE_CHANGE), "contacts"] == 2


def test_ratio_of_what_is_there(summary):
    assert row(summary, names.BENCHMARK, "loss_hv_increment")["ratio_of_sums"] == pytest.approx(0.5)


def test_no_ratio_to_sums_that_are_rounding_alone(summary):
    nothing = row(summary, names.NO_LANE_CHANGE, "loss_hv_increment")
    assert np.isnan(nothing["ratio_of_sums"])
    assert nothing["mean"] == pytest.approx(3.5)


def test_worst_follower_is_the_one_that_loses_most_and_events_without_a_plan_are_left_out(summary):
    worst = row(summary, names.BENCHMARK, "worst_follower")
    # Of the first two kinds of events: the second follower, 2.0 -> 2.5, and the only one, 3.0 -> 1.0.
    assert worst["n"] == 4
    assert worst["mean"] == pytest.approx((2.5 + 1.0) / 2)
    assert worst["mean_against"] == pytest.approx((2.0 + 3.0) / 2)
