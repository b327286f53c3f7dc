"""The study's judgement and tables, on few plans."""

import numpy as np
import pytest
from tracking_cases import (
    HEADING_GRID,
    HORIZONS,
    SPEED_GRID,
    SPEEDS,
    STEERING_GRID,
    WHEELBASE,
    Figures,
    StudyRow,
    SweepRow,
    baseline_table,
    constant,
    copes_until,
    disturbance_table,
    judge,
    lane_change,
    measurement_noise,
    nominal_plans,
    plant_run,
    recovery_plans,
    sensitivity_table,
    sweep_rank,
)

from highd_lc.tracking.closed_loop import Disturbance, track
from highd_lc.vocab.tracking import KINEMATIC, MULTI_BODY, TrackingSettings

SETTINGS = TrackingSettings()
PLANS = [lane_change(25.0, 3.5, 5.5), lane_change(15.0, -3.5, 5.5, speed_change=2.0)]


def test_plans_end_where_they_should():
    for v0, plan in zip(np.repeat(SPEEDS, 4), nominal_plans(), strict=True):
        assert abs(plan.y[-1]) == pytest.approx(3.5)
        assert plan.speed[0] == pytest.approx(v0)
    assert len(recovery_plans()) == 6


def test_figures_are_those_of_the_results():
    results = [track(plan, wheelbase=WHEELBASE, settings=SETTINGS) for plan in PLANS]
    figures = judge(plant_run(KINEMATIC, settings=SETTINGS), PLANS)
    lateral = np.concatenate([r.errors[:, 1] for r in results])
    assert figures.rmse_lateral_m == pytest.approx(np.sqrt(np.mean(lateral**2)))
    assert figures.max_lateral_m == max(r.max_lateral_m for r in results)
    assert figures.settled_m == max(np.abs(r.errors[-10:, 1]).max() for r in results)
    assert figures.comfort_ratio == pytest.approx(1.0, abs=0.05)
    assert figures.copes
    assert (figures.n_plans, figures.n_lost, figures.qp_failures) == (2, 0, 0)


def test_a_car_that_is_lost_does_not_cope():
    run = plant_run(KINEMATIC, settings=SETTINGS, disturb=constant(Disturbance((0.0, 2.0, 0.0))))
    figures = judge(run, PLANS)
    assert figures.n_lost == 2
    assert not figures.copes


def test_noise_is_seeded_by_the_plans_number():
    draw = measurement_noise(0.1, seed=3)
    first, again, other = draw(PLANS[0], 0).noise, draw(PLANS[0], 0).noise, draw(PLANS[0], 1).noise
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)
    assert first.std(axis=0) == pytest.approx([0.1, 0.1, 0.01], rel=0.4)


def row(level, *, copes):
    figures = Figures(1, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0, 0, 0, copes)
    return StudyRow("MPC", KINEMATIC, "offset", level, "m", figures)


def test_coping_ends_at_the_first_level_that_fails():
    assert copes_until([row(1.0, copes=True), row(2.0, copes=False), row(3.0, copes=True)]) == {
        (KINEMATIC, "offset"): 1.0
    }
    assert copes_until([row(1.0, copes=False)]) == {(KINEMATIC, "offset"): None}


def test_disturbances_grow_the_error():
    rows = disturbance_table(PLANS, settings=SETTINGS, plants=[KINEMATIC], seed=1)
    for quantity in ("lateral offset", "heading offset", "noise", "shorter wheelbase", "longer wheelbase"):
        errors = [r.figures.rmse_lateral_m for r in rows if r.quantity == quantity]
        assert errors == sorted(errors), quantity


def test_sensitivity_has_the_defaults_in_its_middle():
    rows = sensitivity_table(PLANS, settings=SETTINGS, plants=[KINEMATIC])
    assert len(rows) == 6 * 5 + len(HORIZONS)
    default = judge(plant_run(KINEMATIC, settings=SETTINGS), PLANS)
    same = [r for r in rows if r.level == 1.0 or (r.quantity == "N_p, with N_c = 4" and r.level == 6)]
    assert len(same) == 7
    assert all(r.figures == default for r in same if r.quantity != "slack_penalty")


def test_the_slacks_weight_is_judged_where_bounds_bind():
    rows = sensitivity_table(PLANS[:1], settings=SETTINGS, plants=[KINEMATIC])
    slack = [r.figures.max_slack for r in rows if r.quantity == "slack_penalty"]
    assert slack == sorted(slack, reverse=True)
    assert slack[-1] > 0.0


def test_the_sweep_ranks_what_meets_first_and_calm_before_restless():
    def entry(worst, comfort):
        figures = Figures(1, 0.0, worst, 0.0, 0.0, 0.0, comfort, 0, 0, 0, True)
        return SweepRow(SETTINGS, figures, figures, figures)

    restless, calm, inexact = entry(0.04, 2.0), entry(0.04, 1.5), entry(0.06, 1.0)
    assert sorted([inexact, restless, calm], key=sweep_rank) == [calm, restless, inexact]


def test_the_defaults_lie_on_the_sweeps_grid():
    assert SETTINGS.weight_heading in HEADING_GRID
    assert SETTINGS.weight_steering_increment in STEERING_GRID
    assert SETTINGS.weight_speed_increment in SPEED_GRID
    assert SETTINGS.weight_lateral == SETTINGS.weight_longitudinal == 1.0


def test_baselines_and_mpc_are_judged_alike_on_both_plants():
    rows = baseline_table(PLANS[:1], settings=SETTINGS, plants=[KINEMATIC, MULTI_BODY], seed=1)
    assert {(r.controller, r.plant) for r in rows} == {
        (c, p) for c in ("MPC", "LQR", "pure pursuit") for p in (KINEMATIC, MULTI_BODY)
    }
    nominal = {r.controller: r.figures for r in rows if r.quantity == "nominal" and r.plant == KINEMATIC}
    assert nominal["MPC"].max_lateral_m < nominal["pure pursuit"].max_lateral_m
