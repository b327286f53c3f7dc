"""The multi-body car: the package's own equations, integration, the closed loop."""

import numpy as np
import pytest
from tracking_plans import quintic_reference

from highd_lc.tracking import multibody
from highd_lc.tracking.multibody import MultiBodyPlant, track_multibody
from highd_lc.vocab.tracking import INVALID_REFERENCE, LOST, TRACKED, Reference, TrackingSettings

SETTINGS = TrackingSettings()


@pytest.fixture(scope="module")
def model():
    return multibody


def test_wheelbase_is_that_of_parameter_set_2(model):
    assert pytest.approx(2.58, abs=0.005) == model.WHEELBASE


@pytest.mark.parametrize("seed", range(6))
def test_compiled_equations_equal_the_packages_to_the_last_bit(model, seed):
    from vehiclemodels.parameters_vehicle2 import parameters_vehicle2
    from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb

    rng = np.random.default_rng(seed)
    states = model.start_state(rng.uniform(1.0, 40.0) if seed else 0.05, 0.1)
    states += rng.normal(size=29) * 1e-2 * (seed > 0)
    order = (rng.normal() * 0.3, rng.normal() * 4.0)
    theirs = vehicle_dynamics_mb(list(states), list(order), parameters_vehicle2())
    np.testing.assert_array_equal(model.rate(states.copy(), order, model.car()), theirs)


def test_friction_scales_the_peak_of_the_tyres_only(model):
    dry, wet = model.car(), model.car(0.5)
    assert (wet.tire.p_dx1, wet.tire.p_dy1) == (0.5 * dry.tire.p_dx1, 0.5 * dry.tire.p_dy1)
    assert wet.tire._replace(p_dx1=dry.tire.p_dx1, p_dy1=dry.tire.p_dy1) == dry.tire
    assert wet._replace(tire=dry.tire) == dry


def test_the_rear_axle_starts_where_it_is_put(model):
    plant = MultiBodyPlant(np.array([3.0, -2.0, 0.3]), 20.0)
    np.testing.assert_allclose(plant.pose(), [3.0, -2.0, 0.3], atol=1e-12)
    np.testing.assert_allclose(plant.velocity(), [20.0 * np.cos(0.3), 20.0 * np.sin(0.3)], atol=1e-12)


def test_velocity_is_the_poses_derivative(model):
    plant = MultiBodyPlant(np.zeros(3), 20.0)
    held = np.array([22.0, 0.02])
    for _ in range(10):
        plant.advance(held, 0.1)
    before = plant.pose()
    velocity = plant.velocity()
    plant.substeps = 1
    plant.advance(held, 1e-4)
    np.testing.assert_allclose((plant.pose() - before)[:2] / 1e-4, velocity, atol=5e-3)


def test_servos_reach_what_is_ordered(model):
    plant = MultiBodyPlant(np.zeros(3), 20.0)
    for _ in range(20):
        plant.advance(np.array([22.0, 0.01]), 0.1)
    assert np.hypot(*plant.velocity()) == pytest.approx(22.0, abs=0.05)
    assert plant._states[2] == pytest.approx(0.01, abs=1e-6)


def test_integration_error_is_a_hundredth_of_the_tracking_error(model):
    reference = quintic_reference(25.0, 3.5, 4.0)
    used = track_multibody(reference, settings=SETTINGS)
    fine = track_multibody(reference, settings=SETTINGS, substeps=400)
    difference = np.abs(used.states - fine.states).max()
    assert difference < 0.01 * used.max_lateral_m


@pytest.mark.parametrize(("shift", "T"), [(3.5, 5.5), (-3.5, 5.5), (3.5, 4.0), (3.5, 3.0)])
def test_tracks_at_25_mps(model, shift, T):
    result = track_multibody(quintic_reference(25.0, shift, T), settings=SETTINGS)
    assert result.status == TRACKED
    assert result.max_lateral_m < 0.15
    assert result.qp_failures == 0


def test_ice_ends_in_a_status_with_finite_numbers(model):
    result = track_multibody(quintic_reference(35.0, 3.5, 3.0), settings=SETTINGS, friction=0.05)
    assert result.status == LOST
    for part in (result.states, result.inputs, result.velocity, result.errors):
        assert np.all(np.isfinite(part))


def test_a_reference_that_is_not_finite_is_a_status(model):
    good = quintic_reference(25.0, 3.5, 4.0)
    bad = Reference(0.1, good.x * np.nan, good.y, good.xdot, good.ydot, good.xddot, good.yddot)
    assert track_multibody(bad, settings=SETTINGS).status == INVALID_REFERENCE
