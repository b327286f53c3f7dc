"""Limits of speed, acceleration and jerk: codes and margins against dense sampling, an interval that is safe."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from highd_lc.core.quintic import Quintic, sample, speed_extrema
from highd_lc.planning.limits import CONSTRAINTS, Limits, forward_interval, limits, margins, violation, violations
from highd_lc.vocab.sections import ConstraintSettings

LIMIT = Limits(v_min=5.0, v_max=50.0, acceleration=8.0, jerk=8.0)

plans = st.builds(
    Quintic,
    v0=st.floats(6, 49),
    D=st.sampled_from([-4.0, -2.5, 2.5, 4.0]),
    T=st.integers(20, 100).map(lambda n: n / 10),
    x_final=st.floats(10, 480),
    v_end=st.floats(5, 50),
)


def code(plan: Quintic, limit: Limits = LIMIT) -> int:
    return violation(plan.T, plan.x_final - plan.v0 * plan.T, plan.v_end - plan.v0, plan.v0, plan.D, limit)


def sampled_margins(plan: Quintic) -> dict[str, float]:
    s = sample(plan, np.linspace(0.0, plan.T, 5001))
    speed = np.hypot(s.vx, s.vy)
    return {
        "jerk_y": LIMIT.jerk - np.abs(s.jy).max(),
        "acceleration_y": LIMIT.acceleration - np.abs(s.ay).max(),
        "speed": min(speed.min() - LIMIT.v_min, LIMIT.v_max - speed.max()),
        "acceleration_x": LIMIT.acceleration - np.abs(s.ax).max(),
        "jerk_x": LIMIT.jerk - np.abs(s.jx).max(),
    }


@given(plans)
def test_margins_are_those_of_dense_sampling(plan):
    found, wanted = margins(plan, LIMIT), sampled_margins(plan)
    assert set(found) == set(wanted) == set(CONSTRAINTS) - {"curvature", "yaw_rate"}, "these are a profile's"
    for name in found:
        assert found[name] == pytest.approx(wanted[name], abs=2e-4 * (1 + abs(wanted[name])))
        assert found[name] <= wanted[name] + 1e-9, "optimistic"


@given(plans)
def test_the_code_names_a_constraint_that_is_violated_or_none(plan):
    found = code(plan)
    wanted = sampled_margins(plan)
    if found == 0:
        assert min(wanted.values()) > -1e-3
    else:
        assert wanted[CONSTRAINTS[found - 1]] < 1e-3


def test_the_first_violation_in_order_counts():
    # Everything is violated: the lateral jerk is tested first.
    assert code(Quintic(v0=10.0, D=4.0, T=2.0, x_final=90.0, v_end=49.0)) == 1
    assert CONSTRAINTS[0] == "jerk_y"


def test_the_jerk_alone_implies_three_seconds():
    straight = [Quintic(v0=25.0, D=3.5, T=T, x_final=25.0 * T, v_end=25.0) for T in (2.9, 3.0)]
    assert [code(plan) for plan in straight] == [1, 0]


def test_many_at_once_are_the_same_as_one_by_one():
    rng = np.random.default_rng(0)
    T, delta, change = np.array([3.0, 5.0, 9.0]), rng.uniform(-30, 30, (3, 50)), rng.uniform(-8, 8, (3, 50))
    found = violations(T, delta, change, 25.0, 3.0, LIMIT)
    for row in range(3):
        wanted = [violation(T[row], d, c, 25.0, 3.0, LIMIT) for d, c in zip(delta[row], change[row], strict=True)]
        assert found[row].tolist() == wanted
    assert len(np.unique(found)) > 3


def test_a_speed_is_refused_without_its_exact_extremum_only_where_that_breaks_the_limit():
    rng = np.random.default_rng(4)
    count = 0
    for T, delta in zip(rng.uniform(3.5, 10, 400), rng.normal(0, 60, 400), strict=True):
        change = rng.normal(0, 6)
        low, high = speed_extrema(delta / T**2, change / T, 25.0, 3.0, T)
        breaks = low < LIMIT.v_min or high > LIMIT.v_max
        assert (violation(T, delta, change, 25.0, 3.0, LIMIT) == 1 + CONSTRAINTS.index("speed")) == breaks
        count += breaks
    assert 50 < count < 350


def test_driving_backwards_is_no_way_to_keep_the_lowest_speed():
    # hypot(xdot, ydot) alone would pass: |xdot| is large while the car reverses.
    plan = Quintic(v0=10.0, D=3.0, T=10.0, x_final=-60.0, v_end=10.0)
    slow = Limits(v_min=0.0, v_max=50.0, acceleration=50.0, jerk=50.0)
    assert code(plan, slow) == 1 + CONSTRAINTS.index("speed")


@given(plans)
def test_nothing_feasible_lies_outside_the_forward_interval(plan):
    if code(plan) == 0:
        delta, change = plan.x_final - plan.v0 * plan.T, plan.v_end - plan.v0
        low, high = forward_interval(np.array([plan.T]), np.array([change]), plan.v0, LIMIT)
        # The interval takes xdot for the speed: that much lower may xdot be than the lowest speed.
        slack = (LIMIT.v_min - np.sqrt(max(LIMIT.v_min**2 - (1.875 * plan.D / plan.T) ** 2, 0.0))) * plan.T / 1.875
        assert low[0] - slack - 1e-6 <= delta <= high[0] + 1e-6


def test_slow_events_may_stay_slow():
    settings = ConstraintSettings()
    assert limits(30.0, settings).v_min == 5.0
    assert limits(3.0, settings).v_min == pytest.approx(2.4)


def test_a_car_above_the_highest_speed_has_no_plan_that_keeps_it():
    limit = limits(52.0, ConstraintSettings())
    assert limit.v_max == 50.0
    for x_final in (480.0, 500.0, 520.0):
        assert code(Quintic(v0=52.0, D=3.0, T=10.0, x_final=x_final, v_end=45.0), limit) == 1 + CONSTRAINTS.index(
            "speed"
        )
