"""Simulated traffic: every row obeys the LCM and semi-implicit Euler, changes are smooth, nobody collides."""

import numpy as np
import pytest

from highd_lc.traffic.drivers import Inflow, draw_drivers
from highd_lc.traffic.lanes import BROKEN_OFF, KEPT, REFERENCE_LENGTH, RETURN, Clock, Drivers, Passage, Road
from highd_lc.traffic.simulation import simulate
from highd_lc.vocab.sections import RecorderSettings

DT = 0.04
SECONDS = 60
MARKINGS = np.array([0.0, 3.7, 7.45, 11.2])
ROAD = Road(MARKINGS, upstream=700.0, section=1000.0, downstream=300.0)


def drive(*, flow: float = 1400.0, seed: int = 5, road: Road = ROAD, **changes):
    settings = RecorderSettings(**{"drivers": "lcm", "truck_share": 0.2, "return_share": 0.0, **changes})
    inflow = Inflow(flow, start=-70.0, end=SECONDS, settings=settings)
    drivers = draw_drivers([np.random.default_rng((seed, lane)) for lane in range(3)], inflow)
    clock = Clock(DT, 1, round(70 / DT), round(SECONDS / DT))
    return drivers, simulate(drivers, road, clock)


@pytest.fixture(scope="module")
def changing() -> tuple[Drivers, Passage]:
    return drive(lane_change_rate=2.0, return_share=0.2)


def lcm(me: np.void, leader: np.void | None, spacing: float, v: float, v_leader: float) -> float:
    """Equations 10 and 11 without delay, L moved behind the leader's length."""
    acceleration = 1 - v / me["v_desire"]
    if leader is not None:
        L = me["L"] + leader["length"] - REFERENCE_LENGTH
        s_star = max(v**2 / (2 * me["b"]) - v_leader**2 / (2 * me["B"]) + v * me["tau"] + L, L)
        acceleration -= np.exp(1 - spacing / s_star)
    return me["A"] * acceleration


def fronts(rows: np.ndarray, drivers: Drivers) -> np.ndarray:
    return rows[:, 2] + drivers.vehicles["length"][rows[:, 0].astype(int)] / 2


def occupied(rows: np.ndarray, paths: np.ndarray, time: float) -> list[set[int]]:
    """The lanes that each vehicle counts on: its own, and until it crosses the one that it moves to."""
    lanes = [{int(np.searchsorted(MARKINGS, y, side="right")) - 1} for y in rows[:, 5]]
    for path in paths[(paths["start"] < time) & (time < paths["until"])]:
        for i in np.flatnonzero(rows[:, 0] == path["vehicle"]):
            lanes[i].add(int(path["target"]))
    return lanes


@pytest.mark.parametrize("lane_change_rate", [0.0, 2.0])
def test_every_acceleration_is_the_lcms_behind_the_leaders_of_all_lanes_taken(lane_change_rate):
    """In particular the new follower reacts from the start of a change, and who changes minds both leaders."""
    drivers, passage = drive(lane_change_rate=lane_change_rate, return_share=0.2)
    checked = changing = 0
    for frame in range(0, 1500, 10):
        rows = passage.rows[passage.rows[:, 1] == frame]
        front, lanes = fronts(rows, drivers), occupied(rows, passage.paths, frame * DT)
        for i, row in enumerate(rows):
            wanted = []
            for lane in lanes[i]:
                ahead = [j for j in range(len(rows)) if lane in lanes[j] and front[j] > front[i]]
                if ahead:
                    j = min(ahead, key=lambda k: front[k])
                    me, leader = (drivers.vehicles[int(rows[k, 0])] for k in (i, j))
                    wanted.append(lcm(me, leader, front[j] - front[i], row[3], rows[j, 3]))
            if len(wanted) == len(lanes[i]):  # else a leader is out of view
                assert row[4] == pytest.approx(min(wanted), abs=1e-9)
                checked += 1
                changing += len(wanted) == 2
    assert checked > 1000
    assert changing > 20 or lane_change_rate == 0


def test_motion_is_semi_implicit_euler_of_its_own_acceleration(changing):
    _, passage = changing
    for vehicle in np.unique(passage.rows[:, 0])[::5]:
        x, v, a = passage.rows[passage.rows[:, 0] == vehicle][:, 2:5].T
        np.testing.assert_allclose(np.diff(v), a[:-1] * DT, atol=1e-9)
        np.testing.assert_allclose(np.diff(x), v[1:] * DT, atol=1e-9)


def test_a_change_goes_from_rest_in_one_lane_to_rest_in_the_next(changing):
    _, passage = changing
    kept = passage.paths[passage.paths["kind"] == KEPT]
    assert len(kept) > 30
    for path in kept:
        y = np.polynomial.Polynomial(path["c"])
        T = path["seconds"]
        for derivative in (1, 2):
            np.testing.assert_allclose(y.deriv(derivative)([0, T]), 0, atol=1e-9)
        assert np.searchsorted(MARKINGS, y([0.0, T])).tolist() == [path["origin"] + 1, path["target"] + 1]
        assert abs(path["target"] - path["origin"]) == 1
        assert path["until"] == pytest.approx(path["start"] + T)


def test_a_change_broken_off_continues_smoothly_into_its_return(changing):
    _, passage = changing
    broken = np.flatnonzero(passage.paths["kind"] == BROKEN_OFF)
    assert len(broken) >= 2
    for number in broken:
        out = passage.paths[number]
        later = passage.paths[number + 1 :]
        back = later[later["vehicle"] == out["vehicle"]][0]
        assert (back["kind"], back["origin"], back["target"]) == (RETURN, out["target"], out["origin"])
        assert back["start"] == out["until"]
        y_out, y_back = (np.polynomial.Polynomial(path["c"]) for path in (out, back))
        for derivative in (0, 1, 2):
            left = (y_out.deriv(derivative) if derivative else y_out)(out["until"] - out["start"])
            right = (y_back.deriv(derivative) if derivative else y_back)(0)
            assert left == pytest.approx(right, abs=1e-9)


@pytest.mark.parametrize("flow", [900.0, 2200.0])
@pytest.mark.parametrize("kind", ["lcm", "mixture", "idm", "population"])
def test_no_two_boxes_ever_overlap(kind, flow):
    drivers, passage = drive(lane_change_rate=4.0, return_share=0.2, flow=flow, seed=11, drivers=kind)
    rows = passage.rows
    vehicle = rows[:, 0].astype(int)
    length, width = drivers.vehicles["length"][vehicle], drivers.vehicles["width"][vehicle]
    for lag in range(1, 12):
        same_frame = rows[lag:, 1] == rows[:-lag, 1]
        gap_x = np.abs(rows[lag:, 2] - rows[:-lag, 2]) - (length[lag:] + length[:-lag]) / 2
        gap_y = np.abs(rows[lag:, 5] - rows[:-lag, 5]) - (width[lag:] + width[:-lag]) / 2
        assert not (same_frame & (gap_x < 0) & (gap_y < 0)).any()


def test_changes_bring_speed(changing):
    """Most vehicles drive faster some seconds after a change to the left than they did at its start."""
    _, passage = changing
    gains = []
    for path in passage.paths[
        (passage.paths["kind"] == KEPT) & (passage.paths["target"] > passage.paths["origin"])
    ]:
        frames = passage.rows[passage.rows[:, 0] == path["vehicle"]][:, [1, 3]]
        start = frames[frames[:, 0] == round(path["start"] / DT)]
        end = frames[frames[:, 0] == round(path["start"] / DT) + 125]
        if len(start) and len(end):
            gains.append(end[0, 1] - start[0, 1])
    assert len(gains) >= 5
    assert np.median(gains) > 0.5


def test_vehicles_are_recorded_while_their_centre_is_in_view(changing):
    _, passage = changing
    assert passage.rows[:, 2].min() >= 0
    assert passage.rows[:, 2].max() <= ROAD.section
    first = passage.rows[passage.rows[:, 1] == 0]
    assert len(first) > 5  # the road is filled when the recording begins
    for vehicle in np.unique(passage.rows[:, 0]):
        frame = passage.rows[passage.rows[:, 0] == vehicle][:, 1]
        assert (np.diff(frame) == 1).all()


@pytest.fixture(scope="module")
def mixed() -> tuple[Drivers, Passage]:
    return drive(lane_change_rate=2.0, return_share=0.1, drivers="mixture")


def steps(passage: Passage) -> np.ndarray:
    """Changes of acceleration from frame to frame [m/s^2]."""
    rows = passage.rows[np.lexsort((passage.rows[:, 1], passage.rows[:, 0]))]
    return np.abs(np.diff(rows[:, 4]))[np.diff(rows[:, 0]) == 0]


def test_drivers_that_remember_do_not_jump_where_the_models_do(changing, mixed):
    model, mixture = steps(changing[1]), steps(mixed[1])
    assert (model > 0.5).mean() > 3 * (mixture > 0.5).mean()


@pytest.mark.parametrize("kind", ["mixture", "idm", "population"])
def test_braking_is_bounded_and_lanes_are_changed(kind):
    _, passage = drive(lane_change_rate=2.0, drivers=kind, flow=1200.0)
    assert -9.0 <= passage.rows[:, 4].min() < passage.rows[:, 4].max() < 4.0
    assert len(passage.paths) >= 10
    assert 15.0 < np.median(passage.rows[:, 3]) < 35.0


@pytest.mark.parametrize("drift", [-0.2, 0.25])
def test_the_drift_is_what_all_vehicles_accelerate_by(drift):
    """Half of the vehicles have hardly another reason to accelerate."""
    road = ROAD._replace(section=400.0)
    calm = {"lane_change_rate": 0.0, "unrest_mps2": 0.0, "drivers": "mixture", "flow": 900.0}
    passages = [drive(**calm, road=road._replace(drift=a))[1] for a in (0.0, drift)]
    medians = [28.0 * np.median(passage.rows[:, 4] / passage.rows[:, 3]) for passage in passages]
    assert medians[1] - medians[0] == pytest.approx(drift, abs=0.05)


def test_a_drift_is_in_speeds_and_positions_as_well(mixed):
    _, passage = drive(lane_change_rate=0.5, drivers="mixture", road=ROAD._replace(section=400.0, drift=0.25))
    for vehicle in np.unique(passage.rows[:, 0])[::9]:
        x, v, a = passage.rows[passage.rows[:, 0] == vehicle][:, 2:5].T
        np.testing.assert_allclose(np.diff(v), a[:-1] * DT, atol=1e-9)
        np.testing.assert_allclose(np.diff(x), v[1:] * DT, atol=1e-9)
