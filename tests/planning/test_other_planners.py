"""Planners of others: scored as ours to the last bit where they plan the same, faulty ones with a reason."""

import sys
from pathlib import Path

import numpy as np
import pytest

import highd_lc as lc
from highd_lc.core.quintic import sample
from highd_lc.planning.other_planners import ask
from highd_lc.planning.replay import PlannedMotion

sys.path.append(str(Path(__file__).resolve().parents[2]))
from examples.fixed_quintic import fixed_quintic
from examples.mobil_quintic import idm, mobil_quintic

COLUMNS = ("x", "y", "vx", "vy", "ax", "ay", "jx", "jy")


@pytest.fixture(scope="module")
def scene():
    return lc.Scene.of(
        lc.Vehicle(v=28.0),
        leader=lc.Vehicle(x=60.0, v=30.0),
        followers=[lc.Vehicle(x=-45.0, v=30.0), lc.Vehicle(x=-95.0, v=30.0)],
        origin_leader=lc.Vehicle(x=50.0, v=24.0),
    )


def ours(scene, names=COLUMNS):
    """The local optimum's motion as a planner of somebody else's."""
    quintic = lc.plan(scene, lc.LOCAL_OPTIMUM).found.quintic

    def copied(_scene):
        s = sample(quintic, np.arange(round(quintic.T / 0.1) + 1) * 0.1)
        return PlannedMotion(**{name: getattr(s, name) for name in names})

    return copied


@pytest.mark.parametrize("accounting", lc.ACCOUNTINGS)
def test_the_same_motion_costs_the_same(scene, accounting):
    function = ours(scene)
    found = lc.plan(scene, function, accounting=accounting)
    assert (found.status, found.policy, found.reason) == ("solved", "copied", "")
    if accounting == "equal":
        mine = lc.plan(scene, lc.LOCAL_OPTIMUM)
        for name in ("av", "followers", "total", "increment"):
            assert getattr(found.loss, name) == pytest.approx(getattr(mine.loss, name), rel=1e-12)
        assert found.safety == pytest.approx(mine.safety, rel=1e-12)
        assert found.T == mine.T
        clear = {name: value for name, value in mine.margins.items() if name.startswith("clearance")}
        assert {name: found.margins[name] for name in clear} == pytest.approx(clear, rel=1e-12)


def test_its_margins_count_the_lateral_limit_that_a_profile_sets(scene):
    safety = scene.settings.safety.model_copy(update={"lateral_acceleration": 1.0})
    strict = lc.Scene(scene.planned, scene.settings.model_copy(update={"safety": safety}))
    found = lc.plan(strict, fixed_quintic)
    hardest = 10.0 / np.sqrt(3.0) * 3.75 / found.T**2
    assert found.margins["acceleration_y"] == pytest.approx(1.0 - hardest, rel=1e-2)


def test_it_is_tracked_and_drawn_as_ours(scene):
    found, mine = lc.plan(scene, ours(scene)), lc.plan(scene, lc.LOCAL_OPTIMUM)
    assert lc.track(found).rmse_lateral_m == pytest.approx(lc.track(mine).rmse_lateral_m, rel=1e-9)
    assert len(found.plot().axes) == 2
    np.testing.assert_allclose(found.motion["x"], mine.motion["x"], rtol=1e-12)


def test_places_alone_are_enough(scene):
    found, mine = lc.plan(scene, ours(scene, ("x", "y"))), lc.plan(scene, lc.LOCAL_OPTIMUM)
    assert found.loss.av == pytest.approx(mine.loss.av, rel=0.05)
    assert found.loss.followers == pytest.approx(mine.loss.followers, rel=0.05)


def test_examples_plan_and_stand_beside_ours(scene):
    table = lc.compare(scene, [lc.BENCHMARK, lc.LOCAL_OPTIMUM, fixed_quintic, mobil_quintic])
    assert list(table.index) == ["benchmark", "local_optimum", "fixed_quintic", "mobil_quintic"]
    assert (table["status"] == "solved").all()
    assert table.loc["local_optimum", "loss_total"] <= table.loc["fixed_quintic", "loss_total"] + 1e-9
    assert table.loc["fixed_quintic", "T"] == 5.0


def test_mobil_waits_for_an_unsafe_follower_and_gives_up():
    crowded = lc.Scene.of(lc.Vehicle(v=20.0), followers=[lc.Vehicle(x=-12.0, v=33.0)])
    found = lc.plan(crowded, mobil_quintic)
    assert (found.status, found.reason) == ("infeasible", "MOBIL does not agree to change lane within 5 s")
    assert np.isnan(found.loss.total)
    assert idm((0.0, 20.0, 5.0), (25.0, 20.0, 5.0)) < 0.0 < idm((0.0, 20.0, 5.0), (500.0, 20.0, 5.0))


STRAIGHT = np.arange(41) * 2.8
ACROSS = np.linspace(0.0, 3.75, 41)


@pytest.mark.parametrize(
    ("answer", "reason"),
    [
        (PlannedMotion(STRAIGHT, ACROSS[:-1]), "its columns have the shapes x (41,), y (40,)"),
        (PlannedMotion(STRAIGHT[:3], ACROSS[:3]), "it has 3 samples of 0.1 s: 4 to 151 are needed"),
        (PlannedMotion(np.arange(500.0), np.arange(500.0)), "it has 500 samples"),
        (PlannedMotion(STRAIGHT + 5.0, ACROSS), "it starts at (5.00, 0.00) m, not at the ego"),
        (PlannedMotion(2.0 * STRAIGHT, ACROSS), "it starts at 56.00 m/s, the ego at 28.00 m/s"),
        (PlannedMotion(STRAIGHT, 0.0 * ACROSS), "it ends 0.00 m to the left: the target lane is at 3.75 m"),
        (PlannedMotion(STRAIGHT, np.where(ACROSS == 3.75, np.nan, ACROSS)), "y is not finite"),
        (PlannedMotion("abc", ACROSS), "its motion cannot be read: could not convert string"),
        (None, "it returned NoneType, neither a motion nor a text"),
        (ZeroDivisionError("no gap"), "ZeroDivisionError: no gap"),
    ],
)
def test_a_fault_is_a_row_with_a_reason(scene, answer, reason):
    def planner(_scene):
        if isinstance(answer, Exception):
            raise answer
        return answer

    found = lc.plan(scene, planner)
    assert found.status == "faulty"
    assert found.reason.startswith(reason)
    assert np.isnan(found.loss.total)
    assert ask(planner, scene.planned).motion is None


def test_a_motion_into_somebody_is_a_contact_with_its_margins():
    blocked = lc.Scene.of(
        lc.Vehicle(v=30.0), leader=lc.Vehicle(x=25.0, v=15.0), followers=[lc.Vehicle(x=-40.0, v=30.0)]
    )
    found = lc.plan(blocked, fixed_quintic)
    assert found.status == "contact"
    assert found.contact == "ego_through_target_leader"
    assert min(found.margins.values()) < 0.0
    assert np.isnan(found.loss.total)


def test_a_planner_may_not_take_a_policy_s_name(scene):
    def benchmark(_scene):
        return "nothing"

    with pytest.raises(lc.UsageError, match="called 'benchmark', as a policy is"):
        lc.plan(scene, benchmark)


def test_commonroad_s_reactive_planner_plans_here(scene):
    pytest.importorskip("commonroad_rp", reason="extra peers is not installed")
    from examples.commonroad_reactive import commonroad_reactive

    found = lc.plan(scene, commonroad_reactive)
    assert (found.status, found.reason) == ("solved", "")
    assert abs(found.motion.query("role == 'ego'")["y"].iloc[-1] - 3.75) < 0.5
