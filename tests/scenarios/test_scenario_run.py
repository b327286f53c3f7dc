"""Plans driven: the platoon is the planner's replay continued, losses and rectangle as the definitions say."""

import numpy as np
import pytest
from few_scenarios import few_scenarios, planned, situation_of

from highd_lc.core.quintic import Quintic
from highd_lc.scenarios.run import (
    Cell,
    av_lead,
    drive_behind,
    drive_plan,
    lead_of_motion,
    no_lane_change,
    platoon_loss,
    rectangle_measures,
    rectangle_totals,
    traffic_columns,
)
from highd_lc.vocab import names

FIXED = Cell(names.FIXED, names.FOLLOWER_HORIZON, 0.5)


@pytest.mark.parametrize("key", ["1", "2_20"])
def test_platoon_equals_the_planners_replay(key):
    one = planned(key)
    outcome = drive_plan(one, one.plan(FIXED), accounting=names.FOLLOWER_HORIZON)
    n = outcome.replay.x.shape[1]
    assert np.allclose(outcome.platoon.front[:3, :n], outcome.replay.x, atol=1e-8)
    assert np.allclose(outcome.platoon.v[:3, :n], outcome.replay.v, atol=1e-9)
    assert np.allclose(outcome.platoon.a[:3, :n], outcome.replay.a, atol=1e-8)


def test_losses_recomputed_from_the_platoon():
    one, settings = planned("1"), few_scenarios()
    outcome = drive_plan(one, one.plan(FIXED), accounting=names.FOLLOWER_HORIZON)
    n = round(settings.options.horizon_s / 0.1) + 1
    v, a = outcome.platoon.v[:3, :n], outcome.platoon.a[:3, :n]
    efficiency = np.abs(v - 25.0).sum() / 25.0
    comfort = np.abs(np.diff(a, axis=1)).sum() / 0.1 / 8.0
    assert outcome.losses["hv_efficiency"] == pytest.approx(efficiency, rel=1e-6)
    assert outcome.losses["hv_comfort"] == pytest.approx(comfort, rel=1e-6)
    assert outcome.losses["loss_total"] == pytest.approx(outcome.losses["loss_av"] + outcome.losses["loss_hv"])


@pytest.mark.parametrize("form", names.FORMS)
@pytest.mark.parametrize("accounting", names.ACCOUNTINGS)
def test_each_plan_is_the_best_in_its_own_objective(form, accounting):
    one = planned("1")
    losses = {}
    for omega in (0.1, 0.5, 1.0):
        plan = one.plan(Cell(form, accounting, omega))
        losses[omega] = drive_plan(one, plan, accounting=accounting, followers=3).losses
    for omega in losses:
        own = omega * losses[omega]["loss_av"] + (1 - omega) * losses[omega]["loss_hv"]
        for other in losses.values():
            assert own <= omega * other["loss_av"] + (1 - omega) * other["loss_hv"] + 1e-9


@pytest.mark.parametrize("accounting", names.ACCOUNTINGS)
def test_loss_of_a_run_is_that_of_the_planner(accounting):
    one = planned("2_20")
    outcome = drive_plan(one, one.plan(FIXED), accounting=accounting)
    found = platoon_loss(one.problem, outcome.platoon, accounting=accounting, n=outcome.replay.av.n)
    assert found == pytest.approx(outcome.losses["loss_hv"], rel=1e-9)


def test_av_goes_on_at_its_last_speed():
    posed = situation_of("1")
    lead = av_lead(posed, Quintic(v0=25.0, D=3.5, T=4.0, x_final=110.0, v_end=28.0))
    assert len(lead.front) == posed.instants
    assert lead.front[0] == 0.0
    assert lead.front[40] == pytest.approx(110.0)
    assert np.allclose(np.diff(lead.front[40:]), 2.8)


def test_a_motion_longer_than_the_run_is_cut():
    posed = situation_of("1")
    x = np.arange(2000) * 2.5
    lead = lead_of_motion(posed, x, v=np.full(2000, 25.0))
    assert np.array_equal(lead.front, x[: posed.instants])


def test_from_crossing_hv_1_sees_a_free_road_first():
    posed = situation_of("1", leader_from="crossing", platoon_leader="none")
    lead = av_lead(posed, Quintic(v0=25.0, D=3.5, T=4.0, x_final=100.0, v_end=25.0))
    assert np.isinf(lead.front[:20]).all()
    assert np.isfinite(lead.front[20:]).all()


def test_an_av_that_is_far_away_changes_nothing():
    posed, settings = situation_of("1", platoon_leader="none"), few_scenarios()
    far = lead_of_motion(posed, 5000.0 + np.arange(41) * 2.5, v=np.full(41, 25.0))
    driven, unchanged = drive_behind(posed, far), no_lane_change(posed)
    assert np.allclose(driven.front, unchanged.front, atol=1e-6)
    assert rectangle_measures(driven, settings.rectangle)["flow_veh_h"] == pytest.approx(
        rectangle_measures(unchanged, settings.rectangle)["flow_veh_h"]
    )


def test_rectangle_totals_of_a_held_platoon():
    """At constant speed the distance is the time times it, and HV_1 drives the printed 147.2 m."""
    settings = few_scenarios()
    posed = situation_of("1", v_desire=25.0, spacing_m=500.0, platoon_leader="none")
    distance, time = rectangle_totals(no_lane_change(posed), settings.rectangle)
    assert distance[0] == pytest.approx(147.2, abs=1e-6)
    assert time[0] == pytest.approx(147.2 / 25.0, abs=1e-6)
    assert distance[1] == 0.0


def test_traffic_columns_of_the_unchanged_platoon_add_no_travel_time():
    one, settings = planned("1"), few_scenarios()
    outcome = drive_plan(one, one.plan(FIXED), accounting=names.EQUAL)
    columns = traffic_columns(outcome, outcome.platoon, settings=settings)
    assert columns["ttt_difference_s"] == 0.0
    assert columns["min_time_headway_s"] == pytest.approx(0.4)
    assert columns["min_gap_m"] == pytest.approx(5.0, abs=0.2)
