"""Waves behind lane changes: exact on Newell's followers, nothing of nobody, contacts left out."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from highd_lc.drivers.responses import SAMPLES, TIME_STEP, Responses, Simulated
from highd_lc.scoring.population import Bootstrap
from highd_lc.stages.shock_waves import shock_waves, wave_field
from highd_lc.vocab.tables import TABLES

HOW = Bootstrap(200, 0.95, 1)
LAG, SHIFT = 1.2, 7.0
T = np.arange(SAMPLES) * TIME_STEP


def path(event: int, rank: int, *, lag: float = LAG) -> tuple[np.ndarray, np.ndarray]:
    """Newell: each repeats the path of the one ahead, LAG later and SHIFT upstream. Position and speed."""
    at = T - lag * rank
    depth, middle = 3.0 + 0.2 * event, 2.0 + 0.1 * event
    fine = np.arange(-10.0, 10.0, 0.01)
    speed = 24.0 - depth * np.exp(-((fine - middle) ** 2))
    way = np.cumsum(speed) * 0.01
    way -= np.interp(0.0, fine, way)
    return np.interp(at, fine, way) - SHIFT * rank, np.interp(at, fine, speed)


def platoons(events: int = 12, recordings: int = 6, ranks: int = 2) -> Responses:
    keys = [(event, rank) for event in range(events) for rank in range(1, ranks + 1)]
    own = [path(*key) for key in keys]
    ahead = [path(event, rank - 1) for event, rank in keys]
    x, v, x_ahead, v_ahead = (np.stack([p[k] for p in of], axis=1) for of in (own, ahead) for k in (0, 1))
    n = len(keys)
    numbers = {name: np.zeros(n) for name in ("a_0", "a_lasting", "drift", "time")}
    event, rank = (np.array(of) for of in zip(*keys, strict=True))
    return Responses(
        x=x, v=v, n=np.full(n, SAMPLES), before_x=x_ahead + 30.0, before_v=v_ahead, before_length=np.full(n, 4.6),
        x_ahead=x_ahead, v_ahead=v_ahead, ahead_length=np.full(n, 4.6), progress=np.ones_like(x),
        time_gap=np.full(n, np.nan), truck=np.zeros(n, bool), rank=rank, event=event, recording=event % recordings,
        location=np.zeros(n, np.int64), **numbers,
    )  # fmt: skip


def as_simulated(responses: Responses) -> Simulated:
    return Simulated(responses.x, responses.v, np.zeros_like(responses.x))


def rows_of(responses: Responses) -> pd.DataFrame:
    return pd.DataFrame({"density": np.where(responses.event % 2 == 0, 9.0, 25.0)})


def table_of(responses: Responses, simulated: Simulated | None = None) -> pd.DataFrame:
    models = {"mine": simulated or as_simulated(responses)}
    return shock_waves(rows_of(responses), responses, models, HOW).set_index(["source", "stratum"])


def test_newells_wave_is_found_with_its_speed_and_lag():
    found = table_of(platoons())
    for source in ("observed", "mine"):
        row = found.loc[(source, "all")]
        assert (row["n_pairs"], row["n_recordings"], row["contacts"]) == (24, 6, 0)
        assert row["passed"] == 24
        assert row["lag_s"] == pytest.approx(LAG, abs=0.02)
        # While the wave passes, the follower is SHIFT upstream of where the leader was.
        assert row["speed_mps"] == pytest.approx(-SHIFT / LAG, rel=0.03)
        assert row["speed_low"] <= row["speed_mps"] <= row["speed_high"]
        assert row["lag_difference_s"] == pytest.approx(0.0, abs=1e-12)
    assert found.loc[("observed", "traffic=free"), "n_pairs"] == 12
    assert found.loc[("unrelated", "all"), "n_pairs"] == 24


def test_followers_that_react_later_are_said_to():
    responses = platoons()
    late = [path(int(e), int(r), lag=LAG + 0.5) for e, r in zip(responses.event, responses.rank, strict=True)]
    x, v = (np.stack([p[k] for p in late], axis=1) for k in (0, 1))
    row = table_of(responses, Simulated(x, v, np.zeros_like(x))).loc[("mine", "all")]
    # HV_1 is 0.5 s late behind the recorded lane changer, HV_2 as much again behind the late HV_1.
    assert row["lag_difference_s"] == pytest.approx(0.5, abs=0.03)
    assert 0.4 < row["lag_difference_low"] <= row["lag_difference_high"] < 0.6


def test_below_five_recordings_there_is_no_interval():
    row = table_of(platoons(recordings=4)).loc[("observed", "all")]
    assert np.isnan([row["speed_low"], row["lag_difference_low"]]).all()
    assert row["reason"] == "fewer than five recordings"
    assert row["speed_mps"] < 0.0


def test_who_is_not_in_view_for_long_enough_is_no_pair():
    responses = platoons()
    n = responses.n.copy()
    n[::2] = 60
    assert table_of(replace(responses, n=n)).loc[("observed", "all"), "n_pairs"] == 12
    assert shock_waves(rows_of(responses), replace(responses, n=n * 0), {}, HOW).empty


def test_a_contact_leaves_no_number_behind():
    responses = platoons()
    x = responses.x.copy()
    x[40:, 0] = responses.x_ahead[40:, 0] + 1.0
    row = table_of(responses, Simulated(x, responses.v, np.zeros_like(x))).loc[("mine", "all")]
    assert (row["contacts"], row["passed"]) == (1, 23)
    clean = table_of(responses).loc[("mine", "all")]
    assert row["lag_s"] == pytest.approx(clean["lag_s"], abs=0.01)


def test_nobody_has_empty_tables():
    nobody = platoons().take(np.zeros(24, bool))
    assert shock_waves(rows_of(nobody), nobody, {"mine": as_simulated(nobody)}, HOW).empty
    field = wave_field(nobody, {"mine": as_simulated(nobody)})
    assert field.empty
    assert list(field.columns) == list(TABLES["wave_field"].column_names)


def test_the_field_holds_the_time_that_was_driven_and_its_relative_speed():
    responses = platoons(events=3)
    field = wave_field(responses, {"mine": as_simulated(responses)})
    observed = field[field["source"] == "observed"]
    assert observed["time_s"].sum() == pytest.approx(6 * 8.0)
    distance = (observed["time_s"] * observed["speed_mps"]).sum()
    moved = responses.x[-1] - responses.x[0] - 8.0 * np.repeat(responses.v_ahead[0, responses.rank == 1], 2)
    assert distance == pytest.approx(moved.sum())
    mine = field[field["source"] == "mine"]
    assert np.array_equal(mine["speed_mps"], observed["speed_mps"])
