import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from highd_lc.core.car_following import (
    TIME_STEP,
    WIDTH,
    FollowingTrack,
    fit_problem,
    objectives_of,
    open_loop_objective,
    simulate,
)
from highd_lc.core.lcm import equilibrium_spacing, lcm_acceleration
from highd_lc.vocab.driver import LOWER_BOUNDS, TABLE3_MEANS, UPPER_BOUNDS

LOWER, UPPER = LOWER_BOUNDS.as_array(), UPPER_BOUNDS.as_array()
MODES = [(open_loop, delayed) for open_loop in (False, True) for delayed in (False, True)]


def wavy_track(n_samples=61, gap=30.0, v0=20.0):
    t = np.arange(n_samples) * TIME_STEP
    leader_v = v0 + 1.5 * np.sin(1.3 * t)
    v = v0 + np.sin(1.3 * t - 0.8)
    leader_x = gap + np.cumsum(leader_v) * TIME_STEP
    x = np.cumsum(v) * TIME_STEP
    return FollowingTrack(leader_x, leader_v, x, v, np.gradient(v, TIME_STEP))


def candidates(n, seed=0):
    return LOWER[:, None] + np.random.default_rng(seed).random((6, n)) * (UPPER - LOWER)[:, None]


def command_twin(v, spacing, leader_v, parameters):
    """Equations 10 and 11 as printed, with the floor and the cap on the exponent."""
    v_desire, A, b, B, tau, L = parameters
    desired = max(v**2 / (2 * b) - leader_v**2 / (2 * B) + v * tau + L, L)
    return A * (1 - v / v_desire - np.exp(np.clip(1 - spacing / desired, -700.0, 40.0)))


def delayed_twin(commands, k, tau):
    """Command of tau seconds before sample k; the first command before there were any."""
    return float(np.interp(k * TIME_STEP - tau, np.arange(len(commands)) * TIME_STEP, commands))


def simulate_twin(track, parameters, delayed):
    v, x, commands, acting = [track.v[0]], [track.x[0]], [], []
    for k in range(len(track.x)):
        commands.append(command_twin(v[k], track.leader_x[k] - x[k], track.leader_v[k], parameters))
        acting.append(delayed_twin(commands, k, parameters[4]) if delayed else commands[k])
        v.append(max(v[k] + acting[k] * TIME_STEP, 0.0))
        x.append(x[k] + v[k + 1] * TIME_STEP)
    return np.array(v[:-1]), np.array(x[:-1]), np.array(acting)


def objective_twin(track, parameters, open_loop, delayed):
    if not open_loop:
        v, x, _ = simulate_twin(track, parameters, delayed)
        spacing = track.leader_x - x
        return np.sqrt(np.mean((spacing - track.spacing) ** 2) / np.mean(track.spacing**2)) + np.sqrt(
            np.mean((v - track.v) ** 2) / np.mean(track.v**2)
        )
    columns = zip(track.v, track.spacing, track.leader_v, strict=True)
    commands = [command_twin(*state, parameters) for state in columns]
    a = [delayed_twin(commands[: k + 1], k, parameters[4]) if delayed else c for k, c in enumerate(commands)]
    weights = 1 / np.maximum(np.abs(track.a), 0.1)
    return np.sum((np.array(a) - track.a) ** 2 * weights) / np.sum(np.abs(track.a))


@pytest.mark.parametrize(("open_loop", "delayed"), MODES)
@pytest.mark.parametrize("n", [1, 13, WIDTH, WIDTH + 5])
def test_kernel_equals_plain_twin(open_loop, delayed, n):
    track = wavy_track(n_samples=31)
    parameters = candidates(n, seed=n)
    found = objectives_of(fit_problem(track, LOWER, UPPER, open_loop=open_loop, delayed=delayed), parameters)
    expected = [objective_twin(track, p, open_loop, delayed) for p in parameters.T]
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("delayed", [False, True])
def test_simulated_motion_equals_plain_twin(delayed):
    track = wavy_track()
    for parameters in candidates(5).T:
        simulated = simulate(track, parameters, delayed=delayed)
        for found, expected in zip(
            (simulated.v, simulated.x, simulated.a), simulate_twin(track, parameters, delayed), strict=True
        ):
            np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-10)


@given(
    v=st.floats(0, 50),
    spacing=st.floats(-20, 200),
    leader_v=st.floats(0, 50),
    seed=st.integers(0, 2**32 - 1),
)
@settings(max_examples=200, deadline=None)
def test_first_command_is_the_lcm(v, spacing, leader_v, seed):
    parameters = candidates(1, seed)[:, 0]
    track = FollowingTrack(*(np.array([value]) for value in (spacing, leader_v, 0.0, v, 0.0)))
    expected = lcm_acceleration(v, spacing, leader_v, *parameters)
    np.testing.assert_allclose(simulate(track, parameters).a[0], expected, rtol=1e-10, atol=1e-10)


def test_equilibrium_is_kept():
    v, n = 25.0, 200
    spacing = equilibrium_spacing(v, TABLE3_MEANS.as_array())
    x = np.arange(n) * v * TIME_STEP
    track = FollowingTrack(x + spacing, np.full(n, v), x, np.full(n, v), np.zeros(n))
    for delayed in (False, True):
        simulated = simulate(track, TABLE3_MEANS.as_array(), delayed=delayed)
        np.testing.assert_allclose(simulated.v, v, atol=1e-9)
        np.testing.assert_allclose(track.leader_x - simulated.x, spacing, atol=1e-8)


def test_delay_of_whole_steps_shifts_the_commands():
    track = wavy_track()
    parameters = TABLE3_MEANS.as_array()
    parameters[4] = 0.3
    simulated = simulate(track, parameters, delayed=True)
    commands = [
        lcm_acceleration(v, s, u, *parameters)
        for v, s, u in zip(simulated.v, track.leader_x - simulated.x, track.leader_v, strict=True)
    ]
    np.testing.assert_allclose(simulated.a[3:], commands[:-3], atol=1e-9)
    np.testing.assert_allclose(simulated.a[:3], commands[0], atol=1e-9)


@pytest.mark.parametrize(("open_loop", "delayed"), MODES)
def test_every_corner_of_the_box_is_finite_even_through_a_collision(open_loop, delayed):
    corners = np.array(np.meshgrid(*zip(LOWER, UPPER, strict=True))).reshape(6, -1)
    for gap in (-30.0, 0.0, 1e-3, 400.0):
        problem = fit_problem(wavy_track(gap=gap), LOWER, UPPER, open_loop=open_loop, delayed=delayed)
        found = objectives_of(problem, corners)
        assert np.isfinite(found).all()
        assert (found >= 0).all()


def test_speed_never_falls_below_zero_behind_a_wall():
    n = 80
    track = FollowingTrack(np.full(n, 12.0), np.zeros(n), np.zeros(n), np.full(n, 15.0), np.zeros(n))
    simulated = simulate(track, TABLE3_MEANS.as_array())
    assert simulated.v.min() == 0.0
    assert simulated.v[-1] == 0.0


def test_true_parameters_have_objective_zero():
    blank = wavy_track()
    driven = simulate(blank, TABLE3_MEANS.as_array())
    track = FollowingTrack(blank.leader_x, blank.leader_v, driven.x, driven.v, driven.a)
    truth = TABLE3_MEANS.as_array()[:, None]
    assert objectives_of(fit_problem(track, LOWER, UPPER), truth)[0] < 1e-14
    assert open_loop_objective(track, truth[:, 0]) < 1e-20


def test_penalty_adds_to_the_objective():
    problem, parameters = fit_problem(wavy_track(), LOWER, UPPER), candidates(4)
    centre, strength = TABLE3_MEANS.as_array(), np.arange(6.0)
    penalised = problem._replace(centre=centre, strength=strength)
    added = strength @ (parameters - centre[:, None]) ** 2
    found = objectives_of(penalised, parameters)
    np.testing.assert_allclose(found, objectives_of(problem, parameters) + added, rtol=1e-12)


def test_open_loop_objective_is_unavailable_without_acceleration():
    track = wavy_track()
    still = FollowingTrack(track.leader_x, track.leader_v, track.x, track.v, np.zeros_like(track.a))
    assert np.isnan(open_loop_objective(still, TABLE3_MEANS.as_array()))
