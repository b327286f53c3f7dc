"""The paper's arithmetic: what is consistent, what is not, and that each line of computation says its result."""

import numpy as np
import pytest

from highd_lc.scenarios.arithmetic import arithmetic_rows

ROWS = {row["key"]: row for row in arithmetic_rows()}


def test_table_2_follows_from_table_1():
    found = [row for key, row in ROWS.items() if key.startswith("table 2")]
    assert len(found) == 12
    for row in found:
        assert row["verdict"] == "consistent"
    flows = [row for row in found if row["unit"] == "veh/h"]
    assert max(abs(row["printed"] - row["computed"]) for row in flows) <= 0.006


def test_the_weights_of_scenario_3_come_out():
    weights = [ROWS[f"weight of HV_{i}, scenario 3"]["computed"] for i in (1, 2, 3)]
    assert np.allclose(weights, [0.48367, 0.31741, 0.19891], atol=5e-6)


def test_four_seconds_at_25_mps():
    assert ROWS["AV efficiency of 4 s at 25 m/s"]["computed"] == pytest.approx(13.9706, abs=5e-5)
    assert ROWS["AV comfort of 4 s at 25 m/s"]["computed"] == pytest.approx(6.7409, abs=5e-5)


def test_what_is_inconsistent():
    odd = {key for key, row in ROWS.items() if row["verdict"] == "inconsistent"}
    assert odd == {
        "AV comfort of 4 s at 25 m/s",
        "free optimum, as printed",
        "duration behind comfort 28.87",
        "height of the rectangle",
        "HV_3 at 20 m/s",
        "shortest time headway",
        "equation 4",
        "C_a, C_b",
        "AV loss, scenario 3, benchmark",
    }


def test_every_line_of_computation_shows_its_result():
    for row in ROWS.values():
        shown = {f"{row['computed']:.{digits}f}" for digits in range(6)} | {f"{row['computed']:g}"}
        assert any(text in row["computation"] for text in shown), row["key"]


def test_keys_are_unique():
    assert len(ROWS) == len(arithmetic_rows())
