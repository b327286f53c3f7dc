"""The MPC's QP: prediction against simulation, Riccati and LQR, optimality, both solvers, bounds."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import solve_discrete_are
from tracking_baselines import error_model

from highd_lc.tracking.mpc import Qp, assemble, kkt_residuals, mpc_parameters, new_memory, solve, solve_qp
from highd_lc.vocab.tracking import TrackingSettings

WHEELBASE, DT = 2.7, 0.1
WIDE = {"speed_max": 99.0, "acceleration_max": 50.0, "steering_max": 1.2, "steering_rate_max": 10.0}


def steady_rows(n, v=25.0, phi=0.02, delta=0.004):
    """Reference rows whose A and B are the same at every sample."""
    return np.tile([0.0, 0.0, phi, v, delta], (n, 1))


def changing_rows(rng, n):
    columns = (
        rng.normal(size=n),
        rng.normal(size=n),
        rng.uniform(-0.2, 0.2, n),
        rng.uniform(5.0, 35.0, n),
        rng.uniform(-0.05, 0.05, n),
    )
    return np.column_stack(columns)


def assembled(error, input_error, rows, *, settings):
    p = mpc_parameters(settings, DT)
    memory = new_memory(p)
    assemble(np.asarray(error, float), np.asarray(input_error, float), rows, 0, WHEELBASE, p, memory)
    return p, memory


def augmented(rows, i=0):
    """Aa, Ba of the augmented state [psi error; previous input error] at sample i."""
    A, B = error_model(rows[i, 3], rows[i, 2], rows[i, 4], dt=DT, wheelbase=WHEELBASE)
    Aa = np.block([[A, B], [np.zeros((2, 3)), np.eye(2)]])
    return Aa, np.vstack([B, np.eye(2)])


@pytest.mark.parametrize(("horizon", "control_horizon"), [(6, 4), (1, 1), (5, 5), (10, 2)])
def test_condensed_prediction_equals_simulating_the_augmented_model(horizon, control_horizon):
    rng = np.random.default_rng(horizon)
    rows = changing_rows(rng, horizon)
    error, input_error = rng.normal(size=3), rng.normal(size=2)
    increments = rng.normal(size=(control_horizon, 2))
    chosen = TrackingSettings(horizon=horizon, control_horizon=control_horizon)
    _, memory = assembled(error, input_error, rows, settings=chosen)
    condensed = memory.free + memory.theta @ increments.ravel()
    xi, simulated = np.concatenate([error, input_error]), []
    for i in range(horizon):
        Aa, Ba = augmented(rows, i)
        xi = Aa @ xi + Ba @ (increments[i] if i < control_horizon else np.zeros(2))
        simulated.append(xi[:3])
    np.testing.assert_allclose(condensed, np.concatenate(simulated), atol=1e-11)


def test_theta_is_block_lower_triangular():
    rows = changing_rows(np.random.default_rng(1), 6)
    _, memory = assembled(np.zeros(3), np.zeros(2), rows, settings=TrackingSettings())
    for i in range(6):
        for j in range(4):
            block = memory.theta[3 * i : 3 * i + 3, 2 * j : 2 * j + 2]
            assert bool(np.any(block)) == (j <= i)


def test_objective_equals_the_cost_written_out():
    rng = np.random.default_rng(2)
    rows, error, input_error = changing_rows(rng, 6), rng.normal(size=3), rng.normal(size=2)
    p, memory = assembled(error, input_error, rows, settings=TrackingSettings())

    def cost(z):
        E = (memory.free + memory.theta @ z[:-1]).reshape(6, 3)
        E[:, 2] *= rows[:, 3]
        return (p.R * E**2).sum() + (p.Q * z[:-1].reshape(4, 2) ** 2).sum() + p.rho * z[-1] ** 2

    z = rng.normal(size=9)
    quadratic = 0.5 * z @ memory.H @ z + memory.f @ z
    assert quadratic == pytest.approx(cost(z) - cost(np.zeros(9)), rel=1e-12)


def first_move(xi, rows, **options):
    _, memory = assembled(xi[:3], xi[3:], rows, settings=TrackingSettings(**WIDE, **options))
    assert solve(memory) > 0
    assert not memory.lam.any()
    return memory.z[:2].copy()


def riccati_gain(P, Aa, Ba, Q):
    return np.linalg.solve(Q + Ba.T @ P @ Ba, Ba.T @ P @ Aa)


def stage_weights(rows):
    """C' R C and Q of the default settings; the heading's weight goes with v_r^2."""
    p = mpc_parameters(TrackingSettings(), DT)
    return np.diag([p.R[0], p.R[1], p.R[2] * rows[0, 3] ** 2, 0.0, 0.0]), np.diag(p.Q)


XI = np.array([0.02, -0.015, 0.001, 0.01, -0.0005])


def test_6_4_equals_four_riccati_steps():
    rows = steady_rows(6)
    Aa, Ba = augmented(rows)
    CRC, Q = stage_weights(rows)
    # After four moves the input is held: three more errors are charged.
    P = sum(np.linalg.matrix_power(Aa, i).T @ CRC @ np.linalg.matrix_power(Aa, i) for i in range(3))
    for _ in range(4):
        K = riccati_gain(P, Aa, Ba, Q)
        P = CRC + (Aa - Ba @ K).T @ P @ (Aa - Ba @ K) + K.T @ Q @ K
    np.testing.assert_allclose(first_move(XI, rows), -K @ XI, atol=1e-12)


def test_with_the_dare_matrix_as_terminal_cost_the_first_move_is_the_lqr():
    rows = steady_rows(6)
    Aa, Ba = augmented(rows)
    CRC, Q = stage_weights(rows)
    P = solve_discrete_are(Aa, Ba, CRC, Q)
    _, memory = assembled(XI[:3], XI[3:], rows, settings=TrackingSettings(horizon=6, control_horizon=6))
    # Terminal weight on the augmented state instead of R on the last error.
    held = np.tile(np.eye(2), 6)
    last_theta = np.vstack([memory.theta[-3:], held])
    last_free = np.concatenate([memory.free[-3:], XI[3:]])
    extra = P - CRC
    H = memory.H[:-1, :-1] + 2 * last_theta.T @ extra @ last_theta
    f = memory.f[:-1] + 2 * last_theta.T @ extra @ last_free
    move = -np.linalg.solve(H, f)[:2]
    np.testing.assert_allclose(move, -riccati_gain(P, Aa, Ba, Q) @ XI, atol=1e-12)


def test_a_long_horizon_approaches_the_lqr():
    rows = steady_rows(60)
    Aa, Ba = augmented(rows)
    CRC, Q = stage_weights(rows)
    K = riccati_gain(solve_discrete_are(Aa, Ba, CRC, Q), Aa, Ba, Q)
    np.testing.assert_allclose(first_move(XI, rows, horizon=60, control_horizon=60), -K @ XI, atol=1e-9)


STATES = st.tuples(*[st.floats(-2, 2)] * 2, st.floats(-0.3, 0.3), st.floats(-3, 3), st.floats(-0.1, 0.1))


@settings(max_examples=60, deadline=None)
@given(STATES, st.integers(0, 2**32 - 1))
def test_kkt_conditions_hold_at_the_solution(xi, seed):
    rows = changing_rows(np.random.default_rng(seed), 6)
    _, m = assembled(xi[:3], xi[3:], rows, settings=TrackingSettings())
    assert solve(m) > 0
    scale = 1.0 + np.abs(m.f).max() + np.abs(m.lam).max()
    stationarity, feasibility, complementarity = kkt_residuals(m.H, m.f, m.A, m.upper, m.z, m.lam)
    assert stationarity < 1e-9 * scale
    assert feasibility < 1e-5
    assert complementarity < 1e-5 * scale


@settings(max_examples=60, deadline=None)
@given(STATES, st.integers(0, 2**32 - 1))
def test_bounds_are_never_violated_by_more_than_the_slack(xi, seed):
    rows = changing_rows(np.random.default_rng(seed), 6)
    p, m = assembled(xi[:3], xi[3:], rows, settings=TrackingSettings())
    assert solve(m) > 0
    slack, moves = m.z[-1], np.cumsum(m.z[:-1].reshape(4, 2), axis=0)
    inputs = rows[:4, 3:] + np.asarray(xi[3:]) + moves
    before = np.vstack([rows[0, 3:] + np.asarray(xi[3:]), inputs[:-1]])
    room = slack * p.softening + 2e-6
    assert slack >= -1e-12
    assert np.all(inputs <= p.input_upper + room)
    assert np.all(inputs >= p.input_lower - room)
    assert np.all(np.abs(inputs - before) <= p.increment + room)


@pytest.mark.parametrize("seed", range(12))
def test_both_solvers_agree(seed):
    rng = np.random.default_rng(seed)
    rows = changing_rows(rng, 6)
    size = np.array([1.0, 1.0, 0.1, 1.0, 0.02]) * (seed + 1) / 4
    _, m = assembled(
        rng.normal(size=3) * size[:3], rng.normal(size=2) * size[3:], rows, settings=TrackingSettings()
    )
    qp = Qp(m.H.copy(), m.f.copy(), m.A.copy(), m.upper.copy())
    ours, theirs = solve_qp(qp, solver="daqp"), solve_qp(qp, solver="osqp")
    assert ours.solved
    assert theirs.solved
    np.testing.assert_allclose(ours.z, theirs.z, atol=1e-5)
    assert ours.active == theirs.active
    assert theirs.active or seed < 4  # the larger errors reach bounds


def test_numbers_that_are_not_finite_are_not_handed_to_the_solver():
    rows = steady_rows(6)
    for error in ([np.nan, 0, 0], [0, np.inf, 0]):
        _, memory = assembled(error, np.zeros(2), rows, settings=TrackingSettings())
        assert solve(memory) == 0
