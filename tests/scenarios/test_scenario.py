"""Situations and scenes: where everybody is at t_start, under each reading of the paper."""

import numpy as np
import pytest
from few_scenarios import few_scenarios, situation_of

from highd_lc.core.lcm import equilibrium_spacing
from highd_lc.scenarios.platoon import gaps, scene_of
from highd_lc.scenarios.run import drive_behind, leader_lead


@pytest.mark.parametrize(("reading", "ahead"), [("centres", 10.0), ("bumpers", 15.0)])
def test_hv_1_stands_where_the_reading_says(reading, ahead):
    posed = situation_of("1", gap_reading=reading)
    assert posed.start.front[0] == pytest.approx(-ahead)
    scene = scene_of(posed)
    assert scene.followers.x[0] == pytest.approx(-ahead)
    assert scene.v0 == 25.0
    assert len(scene.followers.x) == 3


def test_a_held_platoon_arrives_with_its_spacing_and_speed():
    posed = situation_of("2_15", spacing_m=40.0)
    assert np.allclose(np.diff(posed.start.front), -40.0)
    assert np.allclose(posed.start.v, 25.0)
    assert posed.approach.t[-1] == 0.0
    assert np.allclose(posed.approach.front[:, -1], posed.start.front)
    assert len(posed.start.front) == 12


def test_a_driving_platoon_without_equilibrium_stretches():
    posed = situation_of("2_15", pre_phase="lcm", v_desire=25.0, platoon_leader="none")
    assert np.all(-np.diff(posed.start.front) > 44.0)
    assert posed.start.front[0] == pytest.approx(-10.0)
    assert np.all(posed.start.v[1:] < 25.0)


def test_a_platoon_in_equilibrium_stays_as_it_is():
    settings = few_scenarios()
    parameters = situation_of("1", v_desire=29.13).start.parameters[0]
    spacing = equilibrium_spacing(25.0, parameters)
    posed = situation_of("1", v_desire=29.13, spacing_m=spacing, platoon_leader="present", pre_phase="lcm")
    assert np.allclose(posed.start.v, 25.0, atol=1e-6)
    assert np.allclose(gaps(drive_behind(posed, leader_lead(posed))), spacing - 5.0, atol=1e-4)
    assert (settings.options.v_desire, settings.options.platoon_leader) == (29.13, "present")


def test_44_m_at_25_mps_are_in_equilibrium_at_29_13():
    parameters = situation_of("1", v_desire=29.13).start.parameters[0]
    assert equilibrium_spacing(25.0, parameters) == pytest.approx(44.0, abs=0.05)


def test_the_platoon_leader_is_the_target_leader():
    scene = scene_of(situation_of("1", platoon_leader="present"))
    assert scene.target_leader.x[0] == pytest.approx(44.0 - 10.0)
    assert np.allclose(np.diff(scene.target_leader.x), 2.5)
    assert scene_of(situation_of("1", platoon_leader="none")).target_leader is None
