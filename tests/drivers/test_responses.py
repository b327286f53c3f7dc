"""Followers behind a recorded lane changer: every part of the one equation, against theory and a plain twin."""

import numpy as np
import pytest
from made_responses import T, made

from highd_lc.core.kernels import plain
from highd_lc.core.lcm import lcm_acceleration
from highd_lc.drivers.models import Fits, drives
from highd_lc.drivers.population import PRIOR
from highd_lc.drivers.responses import SETS, Ahead, Behaviours, Responses, ahead_of, simulate, speeds_of_sets
from highd_lc.vocab import names
from highd_lc.vocab.driver import TABLE3_MEANS

HARDEST = 9.0


def fits_of(responses: Responses) -> Fits:
    count = len(responses)
    return Fits(np.tile(TABLE3_MEANS.as_array(), (count, 1)), np.full(count, np.nan), np.ones(count, bool))


def drives_of(name: str, responses: Responses) -> tuple[str, Behaviours]:
    return drives(name, responses, fits_of(responses), PRIOR)


def twin(b: Behaviours, r: Responses, i: int, hardest: float) -> np.ndarray:
    """Speeds of one LCM follower, sample by sample, as the equations have it; without relaxation."""
    x, v, speeds = r.x[0, i], r.v[0, i], []
    for k, t in enumerate(T):
        joined = r.progress[k, i] >= b.moment[i] - 1e-9
        lead_x, lead_v = (r.x_ahead[k, i], r.v_ahead[k, i]) if joined else (r.before_x[k, i], r.before_v[k, i])
        length, L = (r.ahead_length[i], b.L[i]) if joined else (r.before_length[i], b.L_before[i])
        a = lcm_acceleration.py_func(v, lead_x - x, lead_v, b.v_desire[i], b.A[i], b.b[i], b.B[i], b.tau[i], L)
        m = np.exp(-t / b.memory[i]) if b.memory[i] > 0 else 0.0
        a = m * b.a_0[i] + (1 - m) * (a + b.drift[i])
        required = max(v - lead_v, 0.0) ** 2 / (2 * max(lead_x - x - length - 1.0, 0.1))
        if required > b.need[i]:
            a = min(a, -required)
        a = max(a, -hardest)
        speeds.append(v)
        v = max(v + a * 0.1, 0.0)
        x += v * 0.1
    return np.array(speeds)


@pytest.mark.parametrize("name", ["table3", "table3@crossing", "table3@crossing+memory", "population"])
def test_a_simulated_follower_is_that_of_the_plain_equations(name: str) -> None:
    responses = made(12)
    family, b = drives_of(name, responses)
    found = simulate(family, b, responses, hardest=HARDEST)
    for i in range(len(responses)):
        np.testing.assert_allclose(found.v[:, i], twin(b, responses, i, HARDEST), atol=1e-9)


@pytest.mark.parametrize("family", [names.LCM, names.IDM])
@pytest.mark.parametrize("leader", [True, False])
@pytest.mark.parametrize("relaxation", [0.0, 8.0])
def test_sets_side_by_side_are_driven_as_each_by_itself(family: str, leader: bool, relaxation: float) -> None:
    responses = made(20, leader=leader)
    _, b = drives_of("population", responses)
    sets = [b._replace(tau=b.tau * (0.5 + 0.1 * j), relaxation=relaxation + 0.0 * b.tau) for j in range(SETS)]
    joins = responses.joins(b.moment)
    found = speeds_of_sets(
        family,
        Behaviours(*(plain(np.stack(values, axis=1)) for values in zip(*sets, strict=True))),
        Ahead(*(plain(values.T) for values in ahead_of(responses, joins))),
        joins,
        np.stack([responses.x[0], responses.v[0]]),
        every=5,
        hardest=HARDEST,
    )
    for j, one in enumerate(sets):
        np.testing.assert_array_equal(found[:, :, j], simulate(family, one, responses).v[5::5].T)


def test_nothing_happens_at_constant_speed() -> None:
    responses = made()
    found = simulate(*drives_of("constant_speed", responses), responses)
    np.testing.assert_array_equal(found.v, responses.v)


def test_an_acceleration_decays_into_the_drift() -> None:
    responses = made()
    found = simulate(*drives_of("drift", responses), responses)
    fading = 3.0 * (1 - np.exp(-T[:, None] / 3.0))
    expected = responses.v[0] + responses.drift * T[:, None] + (responses.a_0 - responses.drift) * fading
    np.testing.assert_allclose(found.v, expected, atol=0.05)


def test_braking_is_bounded_and_needed_braking_overrides_memory() -> None:
    responses = made(60, seed=3)
    family, b = drives_of("population", responses)
    close = responses.x_ahead - 12.0
    near = Responses(**{n: getattr(responses, n) for n in responses.__dataclass_fields__} | {"x_ahead": close})
    found = simulate(family, b._replace(moment=np.zeros(60)), near, hardest=4.0)
    assert found.a.min() >= -4.0
    gap = close - near.ahead_length - found.x
    closing = np.maximum(found.v - near.v_ahead, 0)
    required = closing**2 / (2 * np.maximum(gap - 1.0, 0.1))
    needed = required > 1.5
    assert needed.any()
    assert (found.a[needed] <= np.maximum(-required[needed], -4.0) + 1e-9).all()


def test_relaxation_credits_the_jump_and_fades() -> None:
    responses = made(30, seed=5)
    family, b = drives_of("table3@crossing", responses)
    relaxed = simulate(family, b._replace(relaxation=np.full(30, 20.0)), responses)
    bare = simulate(family, b, responses)
    joins = responses.joins(b.moment)
    at_once = [np.take_along_axis(found.a, joins[None], 0)[0] for found in (relaxed, bare)]
    # Who gets a slower leader at a smaller spacing reacts to neither at once.
    slower = responses.v_ahead[0] <= responses.before_v[0]
    assert slower.any()
    assert (at_once[0] >= at_once[1] - 1e-9)[slower].all()
    short = simulate(family, b._replace(relaxation=np.full(30, 0.01)), responses)
    # One sample is credited in full: at most its braking is missing.
    np.testing.assert_allclose(short.v, bare.v, atol=0.1 * HARDEST + 0.1)


def test_without_relaxation_memory_and_drift_the_bare_model_is_left() -> None:
    responses = made(20)
    family, b = drives_of("own_fit@start", responses)
    assert family == names.LCM
    zero = np.zeros(20)
    bare = simulate(family, b, responses)
    parts = b._replace(memory=zero, relaxation=zero, drift=zero, need=zero + np.inf, a_0=responses.a_0)
    np.testing.assert_array_equal(simulate(family, parts, responses).v, bare.v)


def test_a_follower_takes_the_lane_changer_as_leader_at_the_moment() -> None:
    responses = made(5, crossing_s=3.0)
    assert responses.joins(np.full(5, 0.5)).tolist() == [30] * 5
    assert responses.joins(np.zeros(5)).tolist() == [0] * 5
