"""Who waits and for what, and the value of knowing the leaders: exact on small tables."""

import numpy as np
import pandas as pd
import pytest

from highd_lc.stages.population_tables import start_map
from highd_lc.stages.statistics import PolicyLosses
from highd_lc.stages.validate_studies import foresight_summary
from highd_lc.vocab import names
from highd_lc.vocab.sections import StatisticsSettings

IDS = ["01-0001-00001", "01-0002-00002", "02-0003-00003"]
EVENTS = pd.DataFrame({"spacing_m": [5.0, 15.0, 15.0], "closing_mps": [1.0, -7.0, -9.0]}, index=IDS)


def tables():
    rows = []
    for policy, delays, totals in (
        (names.BENCHMARK, [0.0, 0.0, 0.0], [10.0, 20.0, 30.0]),
        (names.BENCHMARK_START, [0.0, 1.0, 3.0], [10.0, 18.0, 24.0]),
        (names.HUMAN, [0.0, 0.0, 0.0], [11.0, 21.0, 31.0]),
    ):
        for event, delay, total in zip(IDS, delays, totals, strict=True):
            gap = names.RECORDED_GAP if delay < 2.0 else names.gap_behind(1)
            rows.append(
                {
                    "event_id": event, "recording_id": int(event[:2]), "policy": policy,
                    "accounting": names.EQUAL, "delay_s": delay, "gap": gap, "objective": total / 2,
                    "loss_av": total / 2, "loss_hv": total / 2, "loss_total": total,
                    "loss_hv_in_view": total / 2,
                    "loss_hv_in_view_recorded": total / 2 - 1.0 if policy == names.HUMAN else np.nan,
                }
            )  # fmt: skip
    return pd.DataFrame(rows)


def test_tiles_and_totals():
    table = tables()
    found = start_map(EVENTS, table, PolicyLosses(table))
    whole = found[found["spacing_low_m"].isna()].iloc[0]
    assert (whole["n_events"], whole["share_events"]) == (3, 1.0)
    assert whole["share_waiting"] == pytest.approx(2 / 3)
    assert whole["share_other_gap"] == pytest.approx(1 / 3)
    assert whole["mean_delay_s"] == pytest.approx(4 / 3)
    assert whole["saved_total"] == pytest.approx(1 - 52 / 60)
    assert (whole["error"], whole["effect"]) == (1.0, pytest.approx(4 / 3))
    assert whole["error_over_effect"] == pytest.approx(3 / 4)
    tiles = found[found["spacing_low_m"].notna()]
    assert tiles["n_events"].tolist() == [1, 2]
    assert tiles["share_events"].sum() == pytest.approx(1.0)
    assert tiles["saved_objective"].tolist() == pytest.approx([0.0, 1 - 42 / 50])


def test_without_starts_there_are_no_rows():
    table = tables()
    assert start_map(EVENTS, table, PolicyLosses(table[table["policy"] == names.BENCHMARK])).empty
    assert start_map(EVENTS, table[table["policy"] == names.BENCHMARK], PolicyLosses(table)).empty


def test_plans_that_touch_or_do_not_exist_are_counted_and_not_charged():
    rows = []
    for knowledge, objectives, touches in (
        ("recorded", [10.0, 20.0, 30.0], [False] * 3),
        ("predicted", [12.0, 1.0, np.nan], [False, True, False]),
        ("replanned", [11.0, 20.0, 30.0], [False] * 3),
    ):
        for event, objective, touching in zip(IDS, objectives, touches, strict=True):
            rows.append(
                {
                    "event_id": event, "recording_id": int(event[:2]), "policy": names.BENCHMARK_START,
                    "knowledge": knowledge, "objective": objective, "touches": touching, "delay_s": 0.5,
                }
            )  # fmt: skip
    found = foresight_summary(pd.DataFrame(rows), StatisticsSettings(), seed=1).set_index("knowledge")
    assert found.loc["predicted", ["n_events", "no_plan", "touching", "n_compared"]].tolist() == [3, 1, 1, 1]
    assert found.loc["predicted", "value_of_information"] == pytest.approx(1 - 10 / 12)
    assert found.loc["replanned", "value_of_information"] == pytest.approx(1 - 60 / 61)
    assert found.loc["recorded", "value_of_information"] == 0.0
