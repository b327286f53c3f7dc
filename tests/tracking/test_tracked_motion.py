"""Losses and limits of a tracked motion: against the plan's closed forms and against motions made by hand."""

import numpy as np
import pytest
from tracking_plans import quintic_reference

from highd_lc.core.losses import Charge, LossTerms
from highd_lc.core.quintic import Quintic
from highd_lc.tracking.closed_loop import track
from highd_lc.tracking.plan_tracking import (
    SampledMotion,
    loss_av,
    plan_reference,
    planned_motion,
    tracked_motion,
    violations,
)
from highd_lc.vocab.tracking import TrackingSettings

TERMS = LossTerms(33.54, np.empty(0), False, comfort=0.5 / 8.0, efficiency=0.5 / 25.0, weights=np.empty(0))
LIMITS = {"v_min": 5.0, "v_max": 30.0, "acceleration": 8.0, "jerk": 8.0}


def test_a_plans_reference_is_its_polynomials():
    plan = Quintic(v0=25.0, D=3.5, T=4.0, x_final=104.0, v_end=27.0)
    made, by_hand = plan_reference(plan, 0.1), quintic_reference(25.0, 3.5, 4.0, x_final=104.0, v_end=27.0)
    for name in ("x", "y", "xdot", "ydot", "xddot", "yddot"):
        np.testing.assert_allclose(getattr(made, name), getattr(by_hand, name), atol=1e-12)


def test_the_published_figures_of_a_plan():
    """equations.md 14: T = 4, v0 = 25, v_ref 33.54, N_e 25, D 3.5: efficiency 13.9706, comfort 6.7409."""
    loss = loss_av(planned_motion(quintic_reference(25.0, 3.5, 4.0)), TERMS)
    assert loss.efficiency == pytest.approx(13.9706, abs=1e-4)
    # Comfort by differences: third derivatives over 0.1 s intervals.
    assert loss.comfort == pytest.approx(6.7409, rel=0.01)


def test_differences_converge_to_the_polynomials_jerk():
    def error(dt):
        T, shift = 4.0, 3.5
        motion = planned_motion(quintic_reference(25.0, shift, T, dt=dt))
        u = np.arange(len(motion.speed)) * dt / T
        return np.abs(motion.jerk[:, 1] - shift * (60 - 360 * u + 360 * u**2) / T**3).max()

    assert error(0.01) < 0.2 * error(0.1)


def test_a_steady_motion_costs_efficiency_only():
    motion = SampledMotion(0.1, np.tile([30.0, 0.0], (11, 1)))
    assert loss_av(motion, TERMS) == Charge(0.0, pytest.approx(11 * 3.54 / 25.0))
    assert loss_av(motion, TERMS._replace(av_ref=20.0, one_sided=True)).efficiency == 0.0


def test_tracked_motion_of_a_nominal_plan_costs_what_the_plan_costs():
    reference = quintic_reference(25.0, 3.5, 5.5, v_end=27.0)
    result = track(reference, wheelbase=2.7, settings=TrackingSettings())
    tracked = loss_av(tracked_motion(result), TERMS)
    planned = loss_av(planned_motion(reference), TERMS)
    assert tracked.efficiency == pytest.approx(planned.efficiency, rel=0.01)
    assert tracked.comfort == pytest.approx(planned.comfort, rel=0.1)


def test_violations_are_named_with_their_worst_value():
    velocity = np.array([[4.0, 0.0], [5.0, 0.0], [6.0, 0.0], [31.0, 0.0]])
    found = violations(SampledMotion(0.1, velocity), **LIMITS)
    assert found["speed_min"] == 4.0
    assert found["speed_max"] == 31.0
    assert found["acceleration_x"] == pytest.approx(250.0)
    assert list(found) == ["speed_min", "speed_max", "acceleration_x", "jerk_x"]


def test_a_motion_on_the_limit_is_no_violation():
    assert violations(SampledMotion(0.1, np.tile([30.0, 0.0], (11, 1))), **LIMITS) == {}
    ramp = np.column_stack([10.0 + 0.8 * np.arange(11), np.zeros(11)])
    assert "acceleration_x" not in violations(SampledMotion(0.1, ramp), **LIMITS)
