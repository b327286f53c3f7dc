"""Growth along a platoon: equilibrium placement, drops of known runs, stability rows."""

import numpy as np
import pytest
from few_scenarios import few_scenarios, situation_of

from highd_lc.scenarios.run import drive_behind, leader_lead, no_lane_change
from highd_lc.scenarios.waves import drops, growth_rows, published_drivers, stability_rows, with_drivers
from highd_lc.vocab.driver import TABLE3_MEANS


def test_other_drivers_stand_in_equilibrium():
    rng = np.random.default_rng(2)
    parameters = TABLE3_MEANS.as_array() * rng.uniform(0.95, 1.05, (6, 6))
    posed = with_drivers(situation_of("2_20", platoon_leader="present"), parameters)
    driven = drive_behind(posed, leader_lead(posed))
    assert posed.start.front[0] == pytest.approx(-10.0)
    assert np.allclose(driven.v, 25.0, atol=1e-5)


def test_drops_of_a_run_are_those_of_its_speeds():
    posed = with_drivers(situation_of("2_20", platoon_leader="present"), np.tile(TABLE3_MEANS.as_array(), (4, 1)))
    unchanged = no_lane_change(posed)
    dip, below, delay = drops(unchanged, unchanged)
    assert np.allclose(dip, 0.0)
    assert np.allclose(below, 0.0, atol=1e-5)
    assert np.allclose(delay, 0.0)


def test_rows_of_every_driver_set_with_an_equilibrium():
    drivers = {"Table 3 mean": TABLE3_MEANS.as_array()[None, :], "slow": published_drivers()["simulation"]}
    rows = growth_rows(few_scenarios(), drivers)
    assert {row["drivers"] for row in rows} == {"Table 3 mean"}
    assert {row["scenario"] for row in rows} == {"1", "2_15", "2_20"}
    first = [r for r in rows if r["follower"] == 1 and r["policy"] == "benchmark" and r["scenario"] == "2_15"]
    assert len(first) == 1
    assert first[0]["collision"] == np.isnan(first[0]["dip_mps"])
    slower = [r for r in rows if r["follower"] == 1 and r["policy"] == "benchmark" and r["scenario"] == "2_20"]
    assert not slower[0]["collision"]
    assert slower[0]["dip_mps"] >= 5.0
    assert slower[0]["delay_s"] > 0.0


def test_stability_is_told_only_where_half_of_the_drivers_have_an_equilibrium():
    rows = stability_rows(published_drivers())
    simulation = [row for row in rows if row["drivers"] == "simulation"]
    assert max(row["speed_mps"] for row in simulation) < 25.0
    assert all(row["stable"] == (row["gain"] <= 1.0) for row in rows)
    assert not simulation[0]["stable"]
