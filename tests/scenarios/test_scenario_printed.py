"""Scenario 3 and the contacts of scenario 2: the printed state as printed, collisions where the numbers say so."""

import numpy as np
import pytest
from few_scenarios import few_scenarios

from highd_lc.planning.scene import scene_weights
from highd_lc.scenarios.ledger import printed_scene, rows_of_printed_state
from highd_lc.scenarios.tracking import contact_rows


def test_the_scene_is_the_printed_state():
    scene = printed_scene(few_scenarios(), 25.0)
    assert np.allclose(-scene.followers.x, [24.23, 59.73, 107.26])
    assert np.allclose(scene.followers.v - 25.0, [5.27, 5.43, 4.56])
    assert scene.origin_leader.x[0] == pytest.approx(43.13)
    assert scene.origin_leader.v[0] == pytest.approx(25.0 - 2.32)
    gap = scene.target_leader.x[0] - 2.5 - (scene.followers.x[0] + 2.5)
    assert gap == pytest.approx(91.07)


def test_weights_are_the_printed_ones():
    assert np.allclose(scene_weights(printed_scene(few_scenarios(), 25.0)), [0.48367, 0.31741, 0.19891], atol=5e-6)


def test_every_speed_form_accounting_and_weight_has_a_row():
    rows = rows_of_printed_state(few_scenarios())
    assert len(rows) == 2 * 2 * 3 * 2
    solved = [row for row in rows if row["status"] == "solved"]
    assert solved
    for row in solved:
        assert row["loss_total"] == pytest.approx(row["loss_av"] + row["loss_hv"])


def test_an_av_at_15_mps_10_m_ahead_of_centres_is_hit():
    rows = {(r["gap_reading"], r["v_av"], r["motion"]): r for r in contact_rows(few_scenarios())}
    hit = rows["centres", 15.0, "constant"]
    assert hit["collision"]
    assert hit["min_gap_m"] < -1.0
    assert hit["min_clearance_m"] < 0.0
    assert not rows["bumpers", 15.0, "constant"]["collision"]
    assert not rows["centres", 20.0, "constant"]["collision"]
    assert rows["centres", 15.0, "constant"]["gap_start_m"] == pytest.approx(5.0)
    assert rows["bumpers", 15.0, "constant"]["gap_start_m"] == pytest.approx(10.0)
