"""Platoons: equilibrium, twin and bad input."""

import numpy as np
import pandas as pd
import pytest

import highd_lc as lc


def steady(v, seconds=30.0, dt=0.1):
    t = np.arange(round(seconds / dt) + 1) * dt
    return pd.DataFrame({"t": t, "x": v * t, "v": v})


@pytest.mark.parametrize("v", [8.0, 15.0, 20.0])
def test_in_equilibrium_nobody_moves_against_another(v):
    """a = 0 where 1 - v / v_desire = exp(1 - s / s*): s = s* (1 - ln(1 - v / v_desire))."""
    p = lc.SIMULATION
    desired = v**2 * (1.0 / (2.0 * p.b) - 1.0 / (2.0 * p.B)) + v * p.tau + p.L
    spacing = desired * (1.0 - np.log(1.0 - v / p.v_desire))
    platoon = lc.simulate_platoon(steady(v), drivers=[p] * 4, spacing=spacing)
    assert np.abs(platoon["a"]).max() < 1e-9
    np.testing.assert_allclose(platoon["spacing"], spacing, atol=1e-6)
    np.testing.assert_allclose(platoon["gap"], spacing - 5.0, atol=1e-6)


def test_each_vehicle_is_the_leader_of_the_next():
    leader = steady(20.0)
    leader["v"] = 20.0 + 2.0 * np.sin(leader["t"])
    leader["x"] = np.concatenate([[0.0], np.cumsum(leader["v"].to_numpy()[1:])]) * 0.1
    whole = lc.simulate_platoon(leader, drivers=[lc.SIMULATION] * 3, spacing=40.0, speed=20.0)
    first = whole[whole["vehicle"] == 1].reset_index(drop=True)
    rest = lc.simulate_platoon(first, drivers=[lc.SIMULATION] * 2, spacing=40.0, speed=20.0)
    np.testing.assert_allclose(rest["x"], whole.loc[whole["vehicle"] > 1, "x"], atol=1e-9)


def test_a_fit_drives_as_its_parameters():
    leader, fit = steady(20.0), lc.DriverFit(lc.SIMULATION, 4.5, None, (), {}, 0.0, 0, "fitted", "")
    mine, theirs = (lc.simulate_platoon(leader, [driver], spacing=30.0) for driver in (fit, lc.SIMULATION))
    pd.testing.assert_frame_equal(mine, theirs)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"leader": steady(20.0).drop(columns="v")}, "column 'v' is missing"),
        ({"leader": steady(20.0).iloc[:1]}, "1 samples"),
        ({"leader": steady(20.0).drop(index=4)}, "steps of t"),
        ({"leader": steady(float("nan"))}, "finite"),
        ({"drivers": []}, "drivers: none"),
        ({"spacing": 0.0}, "spacing = 0"),
        ({"length": -1.0}, "length = -1"),
        ({"b_max": float("nan")}, "b_max = nan"),
        ({"speed": -3.0}, "speed = -3"),
    ],
)
def test_what_makes_no_sense_is_refused_in_one_line(change, words):
    given = {"leader": steady(20.0), "drivers": [lc.SIMULATION], "spacing": 30.0} | change
    with pytest.raises(lc.UsageError, match=words) as caught:
        lc.simulate_platoon(given.pop("leader"), given.pop("drivers"), **given)
    assert "\n" not in str(caught.value)
