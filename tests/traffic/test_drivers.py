"""Drawn drivers: spread around the published table, independent of each other and of how many are drawn."""

import numpy as np
import pytest

from highd_lc.traffic.drivers import Inflow, draw_drivers
from highd_lc.traffic.lanes import IDM, LCM, LCM_AT_ONCE
from highd_lc.vocab.driver import LOWER_BOUNDS, PARAMETERS, TABLE3_MEANS, UPPER_BOUNDS
from highd_lc.vocab.sections import RecorderSettings

HOUR = 3600.0


def draw(*, lanes: int = 3, seconds: float = HOUR, flow: float = 1200.0, **changes):
    settings = RecorderSettings(**{"drivers": "lcm", "truck_share": 0.15, "lane_change_rate": 0.5, **changes})
    inflow = Inflow(flow, start=0.0, end=seconds, settings=settings)
    return draw_drivers([np.random.default_rng((3, lane)) for lane in range(lanes)], inflow)


def test_a_longer_time_begins_with_the_same_drivers():
    short, long = draw(seconds=100.0), draw(seconds=900.0)
    for lane in range(3):
        a = short.vehicles[short.lane_first[lane] : short.lane_first[lane + 1]]
        b = long.vehicles[long.lane_first[lane] :][: len(a)]
        np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(short.sway[:30], long.sway[:30])


def test_parameters_lie_within_the_bounds_around_the_published_means():
    vehicles = draw().vehicles
    for name in PARAMETERS:
        assert vehicles[name].min() > getattr(LOWER_BOUNDS, name)
        assert vehicles[name].max() < getattr(UPPER_BOUNDS, name)
        assert vehicles[name].mean() == pytest.approx(getattr(TABLE3_MEANS, name), rel=0.1)
        assert vehicles[name].std() > 0.01 * vehicles[name].mean()


@pytest.mark.parametrize("lanes", [2, 3, 4])
@pytest.mark.parametrize("truck_share", [0.0, 0.15, 0.3])
def test_flow_and_trucks_are_as_asked(lanes, truck_share):
    drivers = draw(lanes=lanes, truck_share=truck_share)
    vehicles = drivers.vehicles
    arrived = vehicles["arrival"] < HOUR
    assert arrived.sum() == pytest.approx(1200 * lanes, rel=0.05)
    assert vehicles["truck"][arrived].mean() == pytest.approx(truck_share, abs=0.03)
    assert (np.diff(vehicles["arrival"][: drivers.lane_first[1]]) >= 1.0).all()
    trucks = vehicles["truck"] == 1
    assert (vehicles["highest_lane"][trucks] == 1).all()
    if trucks.any():
        assert vehicles["length"][trucks].min() > vehicles["length"][~trucks].max()


def test_every_lane_has_enough_drivers_for_its_time():
    drivers = draw(seconds=60.0)
    for lane in range(3):
        arrival = drivers.vehicles["arrival"][drivers.lane_first[lane] : drivers.lane_first[lane + 1]]
        assert arrival[-1] > 60.0


def test_no_wish_to_change_lane_means_no_look_within_a_lifetime():
    assert draw(lanes=2, lane_change_rate=0.0).vehicles["look"].min() > 100 * HOUR


def test_the_kind_of_drivers_changes_neither_arrivals_nor_vehicles():
    model, mixture = draw().vehicles, draw(drivers="mixture").vehicles
    for name in ("arrival", "length", "width", "truck", "look", "duration", "offset"):
        np.testing.assert_array_equal(model[name], mixture[name])
    assert not np.array_equal(model["A"], mixture["A"])


@pytest.mark.parametrize("drivers", ["mixture", "idm", "population"])
def test_drivers_that_take_their_time_begin_alike_however_long_the_recording(drivers):
    short, long = draw(seconds=100.0, drivers=drivers), draw(seconds=900.0, drivers=drivers)
    for lane in range(3):
        a = short.vehicles[short.lane_first[lane] : short.lane_first[lane + 1]]
        np.testing.assert_array_equal(a, long.vehicles[long.lane_first[lane] :][: len(a)])


def test_a_mixture_has_the_shares_that_were_asked_for():
    shares = {"idm_share": 0.3, "gentle_share": 0.5, "ignore_share": 0.2, "room_share": 0.4}
    vehicles = draw(drivers="mixture", start_share=0.5, crossing_share=0.2, memory_s=4.0, **shares).vehicles
    lcm, idm = vehicles[vehicles["model"] == LCM], vehicles[vehicles["model"] == IDM]
    assert len(lcm) + len(idm) == len(vehicles)
    assert len(idm) / len(vehicles) == pytest.approx(0.3, abs=0.03)
    assert (lcm["A"] < 1.0).sum() / len(vehicles) == pytest.approx(0.5, abs=0.03)
    assert (vehicles["ignores"] > 0).mean() == pytest.approx(0.2, abs=0.03)
    assert (vehicles["room"] >= 0).mean() == pytest.approx(0.4, abs=0.03)
    assert (vehicles["moment"] == 0).mean() == pytest.approx(0.5, abs=0.03)
    assert (vehicles["moment"] == 1).mean() == pytest.approx(0.2, abs=0.03)
    assert np.median(idm["memory"]) == pytest.approx(4.0, rel=0.05)


def test_the_population_is_within_the_bounds_of_its_published_fit():
    vehicles = draw(drivers="population").vehicles
    bounds = {"A": (0.7, 1.0), "b": (1.8, 2.2), "B": (1.3, 1.5), "tau": (3.1, 3.7), "memory": (6.0, 7.0)}
    for name, (low, high) in bounds.items():
        assert low <= vehicles[name].min() < vehicles[name].max() <= high
    assert set(vehicles["model"]) == {LCM}
    assert (set(vehicles["moment"]), set(vehicles["relaxation"]), set(vehicles["strength"])) == ({1}, {0}, {1})


def test_the_models_drivers_react_at_once_and_rest():
    vehicles = draw(drivers="lcm").vehicles
    assert set(vehicles["model"]) == {LCM_AT_ONCE}
    for name in ("memory", "relaxation", "moment", "ignores", "unrest"):
        assert not vehicles[name].any()
