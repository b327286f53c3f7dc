"""Drawn drivers: spread around the published table, independent of each other and of how many are drawn."""

import numpy as np
import pytest

from highd_lc.traffic.drivers import Inflow, draw_drivers
from highd_lc.vocab.driver import LOWER_BOUNDS, PARAMETERS, TABLE3_MEANS, UPPER_BOUNDS

HOUR = 3600.0


def draw(*, lanes: int = 3, seconds: float = HOUR, flow: float = 1200.0, truck_share: float = 0.15):
    inflow = Inflow(flow, truck_share, 0.5, 0.05, start=0.0, end=seconds)
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
    inflow = Inflow(1200.0, 0.15, 0.0, 0.05, start=0.0, end=HOUR)
    vehicles = draw_drivers([np.random.default_rng(lane) for lane in range(2)], inflow).vehicles
    assert vehicles["look"].min() > 100 * HOUR
