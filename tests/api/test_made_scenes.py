"""Scenes made by hand, and one policy in them."""

import numpy as np
import pytest

import highd_lc as lc
from highd_lc.planning import planner
from highd_lc.planning.robust import plan_robust
from highd_lc.planning.start_planner import plan_starts

FREE_ROAD = lc.LcmParameters(v_desire=30.0, A=4.0, b=6.0, B=6.0, tau=0.8, L=6.0)


def test_a_reference_at_constant_speed_is_known_in_advance(scene):
    plan = lc.plan(scene, lc.CONSTANT, accounting="paper")
    assert (plan.status, plan.T, plan.v_end) == ("reference", 5.5, 28.0)
    assert plan.x_final == pytest.approx(28.0 * 5.5)
    ego = plan.motion.query("role == 'ego'")
    assert ego["y"].iloc[-1] == pytest.approx(3.75)
    assert ego["t"].iloc[-1] == pytest.approx(scene.settings.loss.horizon_s)


def test_others_keep_their_speed(scene):
    leader = lc.plan(scene, lc.NO_LANE_CHANGE).motion.query("role == 'target_leader'")
    np.testing.assert_allclose(leader["x"], 45.0 + 27.0 * leader["t"])


def test_a_follower_at_its_desired_speed_far_away_loses_nothing():
    far = lc.Vehicle(x=-1000.0, v=30.0, driver=FREE_ROAD)
    plan = lc.plan(lc.Scene.of(lc.Vehicle(v=30.0), followers=[far]), lc.CONSTANT)
    follower = plan.motion.query("role == 'target_follower_1'")
    assert np.abs(follower["v"] - 30.0).max() < 0.02
    assert plan.loss.increment == pytest.approx(0.0, abs=1e-9)


def test_who_is_planned_alone_is_planned_as_among_all(scene):
    everybody = planner.plan_all(scene.problem) + plan_starts(scene.problem) + plan_robust(scene.unknown)
    assert {plan.policy for plan in everybody} == {*lc.POLICIES} - {lc.HUMAN}
    for plan in everybody:
        alone = lc.plan(scene, plan.policy, accounting=plan.accounting).found
        assert (alone.quintic, alone.status, alone.delay_s, alone.gap) == (
            plan.quintic, plan.status, plan.delay_s, plan.gap,
        )  # fmt: skip
        np.testing.assert_array_equal(alone.objective, plan.objective)
        assert alone.margins == plan.margins
        assert alone.rejected_by == plan.rejected_by


def test_no_other_form_is_searched_than_the_asked_one(monkeypatch):
    searched = []
    search = planner.search

    def counted(task, goals, *, known=None):
        searched.append("fixed" if known is None else "free")
        return search(task, goals, known=known)

    monkeypatch.setattr(planner, "search", counted)
    made = lc.Scene.of(lc.Vehicle(v=28.0), followers=[lc.Vehicle(x=-40.0, v=30.0)])
    lc.plan(made, lc.CONSTANT)
    assert searched == []
    lc.plan(made, lc.LOCAL_OPTIMUM)
    lc.plan(made, lc.BENCHMARK)
    assert searched == ["fixed"]
    lc.plan(made, lc.LOCAL_OPTIMUM_FREE)
    assert searched == ["fixed", "free"]


def test_a_human_is_not_to_be_had(scene):
    with pytest.raises(lc.UsageError, match="nobody recorded"):
        lc.plan(scene, lc.HUMAN)
    table = lc.compare(scene, [lc.HUMAN, lc.BENCHMARK])
    assert table["status"].tolist() == ["not_recorded", "solved"]
    assert np.isnan(table.loc[lc.HUMAN, "loss_total"])


def test_without_room_numbers_are_missing_and_margins_say_why():
    made = lc.Scene.of(lc.Vehicle(v=28.0), followers=[lc.Vehicle(x=-1.0, v=28.0)], lateral_shift=1.0)
    plan = lc.plan(made, lc.BENCHMARK)
    assert plan.status == "infeasible_at_start"
    assert plan.margins["clearance_target_follower_1"] < 0.0
    assert np.isnan([plan.T, plan.loss.total, plan.safety["min_gap_m"]]).all()
    assert plan.motion.empty
    assert lc.track(plan).motion.empty
    assert np.isnan(lc.track(plan).rmse_lateral_m)
    with pytest.raises(lc.UsageError, match="no motion to draw"):
        plan.plot()


def test_comparison_has_a_row_a_policy_and_the_optimum_of_the_asked_objective(scene):
    table = lc.compare(scene, lc.POLICIES)
    assert table.index.tolist() == list(lc.POLICIES)
    assert table.loc["local_optimum", "loss_total"] <= table.loc["benchmark", "loss_total"] + 1e-9
    assert table.loc["benchmark", "loss_av"] <= table.loc["local_optimum", "loss_av"] + 1e-9
    assert table.loc["no_lane_change", "loss_hv_increment"] == pytest.approx(0.0, abs=1e-12)


EGO, BEHIND = lc.Vehicle(v=28.0), lc.Vehicle(x=-40.0, v=30.0)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: lc.Scene.of(EGO, followers=[]), "at least one"),
        (lambda: lc.Scene.of(EGO, followers=[BEHIND, lc.Vehicle(x=-20.0)]), "its gap to the one ahead is -25 m"),
        (lambda: lc.Scene.of(EGO, followers=[BEHIND], leader=lc.Vehicle(x=-38.0)), "its gap"),
        (lambda: lc.Scene.of(lc.Vehicle(x=3.0), followers=[BEHIND]), "ego.x = 3.0"),
        (lambda: lc.Scene.of(EGO, followers=[BEHIND], lateral_shift=0.0), "lateral_shift = 0"),
        (lambda: lc.Vehicle(v=-1.0), r"Vehicle\.v = -1"),
        (lambda: lc.Vehicle(x=float("nan")), r"Vehicle\.x = nan"),
        (lambda: lc.Vehicle(length=0.0), r"Vehicle\.length = 0"),
        (lambda: lc.plan(lc.Scene.of(EGO, followers=[BEHIND]), "best"), "policy 'best' is unknown"),
        (lambda: lc.plan(lc.Scene.of(EGO, followers=[BEHIND]), accounting="fair"), "accounting 'fair'"),
    ],
)
def test_what_makes_no_sense_is_refused_in_one_line(call, words):
    with pytest.raises(lc.UsageError, match=words) as caught:
        call()
    assert "\n" not in str(caught.value)


def test_tracking(scene):
    plan = lc.plan(scene)
    tracked = lc.track(plan)
    assert tracked.status == "tracked"
    motion = tracked.motion
    assert motion["t"].iloc[-1] == pytest.approx(plan.T)
    across = np.sqrt(np.mean(motion["error_across_m"] ** 2))
    assert tracked.rmse_lateral_m == pytest.approx(across)
    with pytest.raises(lc.UsageError, match="plant 'tank'"):
        lc.track(plan, plant="tank")
    with pytest.raises(lc.UsageError, match="no lane change"):
        lc.track(lc.plan(scene, lc.NO_LANE_CHANGE))
