"""How one driver follows: memory, relaxation, moment of reaction, need; against the equations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from highd_lc.core.lcm import IdmParameters, idm_acceleration, lcm_acceleration
from highd_lc.traffic import following
from highd_lc.traffic.lanes import IDM, LCM, NOBODY, UNKNOWN, VEHICLE, Drivers, Road, empty_traffic

ROAD = Road(np.array([0.0, 3.7, 7.4]), 700.0, 420.0, 300.0)
FREE = {"A": 0.85, "b": 2.0, "B": 1.4, "tau": 3.4, "L": 8.6, "v_desire": 34.0, "strength": 1.0, "room": -1.0}
IDM_PARAMETERS = {"A": 1.0, "b": 1.5, "tau": 1.2, "L": 2.0, "v_desire": 33.0}


def traffic(*cars: dict):
    """Vehicles on the right lane, downstream first; each with its own fields."""
    vehicles = np.zeros(len(cars), VEHICLE)
    made = empty_traffic(Drivers(vehicles, np.array([0, len(cars)]), np.empty(0), np.empty(0)))
    made.vehicles["beside"] = -1
    for number, car in enumerate(cars):
        for name, value in {"model": LCM, "length": 4.6, **FREE, **car}.items():
            made.vehicles[name][number] = value
        made.order[number] = number
    made.counts[0] = len(cars)
    return made


def command(v: float, spacing: float, v_leader: float) -> float:
    names = ("v_desire", "A", "b", "B", "tau", "L")
    return lcm_acceleration(v, spacing, v_leader, *(FREE[name] for name in names))


def behind_a_new_leader(**me) -> tuple:
    """A follower at 25 m/s, 60 m behind a leader of 26 m/s, whose next leader is 30 m ahead at 22 m/s."""
    made = traffic(
        {"x": 60.0, "v": 26.0}, {"x": 30.0, "v": 22.0}, {"x": 0.0, "v": 25.0, "a": 0.3, "leader": 0, **me}
    )
    following.take_leader(made.vehicles, ROAD, 2, 1, 100.0)
    return made, lambda time: following.intention(made.vehicles, ROAD, 2, time)


@pytest.mark.parametrize("elapsed", [0.0, 1.0, 4.0, 12.0])
def test_memory_blends_what_was_intended_with_what_the_model_commands(elapsed):
    _, intention = behind_a_new_leader(memory=6.0)
    m = np.exp(-elapsed / 6.0)
    assert intention(100.0 + elapsed) == pytest.approx(m * 0.3 + (1 - m) * command(25.0, 30.0, 22.0), abs=1e-12)


def test_a_memory_begins_with_the_path_of_who_comes_in_and_not_again_at_the_crossing():
    """A driver that minds from the crossing on: its leader changes 3 s after its memory began."""
    made = traffic(
        {"x": 200.0, "v": 25.0, "lane": 0},
        {"x": 40.0, "v": 22.0, "lane": 1, "beside": 0, "origin": 1, "target": 0, "y": 5.5},
        {"x": 0.0, "v": 25.0, "a": 0.3, "leader": 0, "moment": 1.0, "memory": 6.0},
    )
    me, coming = made.vehicles[2], made.vehicles[1]
    coming["c"][0] = 5.5

    def drive(time):
        return following.drive(made.vehicles, made.order, made.last, ROAD, 2, time)

    made.last[0] = 1
    assert drive(10.0) == pytest.approx(0.3, abs=1e-12)
    m = np.exp(-1.0 / 2.0)
    assert drive(13.0) == pytest.approx(m * 0.3 + (1 - m) * command(25.0, 200.0, 25.0), abs=1e-12)
    coming["lane"], coming["beside"], coming["y"], coming["crossed"] = 0, -1, 3.6, 13.0
    assert drive(13.0) == pytest.approx(m * 0.3 + (1 - m) * command(25.0, 40.0, 22.0), abs=1e-12)
    assert (me["leader"], me["since"], me["began"]) == (1, 13.0, 10.0)


def test_without_memory_and_relaxation_a_driver_is_its_model():
    _, intention = behind_a_new_leader()
    for time in (100.0, 101.0, 130.0):
        assert intention(time) == pytest.approx(command(25.0, 30.0, 22.0), abs=1e-12)


@pytest.mark.parametrize("elapsed", [0.0, 2.0, 4.9, 5.0, 7.5, 10.0, 20.0])
def test_relaxation_gives_back_what_was_lost_and_fades_linearly(elapsed):
    _, intention = behind_a_new_leader(relaxation=10.0)
    spacing = 30.0 + 30.0 * max(1 - elapsed / 10, 0)
    v_leader = 22.0 + 4.0 * max(1 - elapsed / 10, 0)
    assert intention(100.0 + elapsed) == pytest.approx(command(25.0, spacing, v_leader), abs=1e-12)


@given(old=st.floats(35.0, 2000.0))
def test_a_jump_is_capped_at_three_desired_spacings(old):
    made = traffic(
        {"x": old, "v": 26.0}, {"x": 30.0, "v": 22.0}, {"x": 0.0, "v": 25.0, "leader": 0, "relaxation": 10.0}
    )
    following.take_leader(made.vehicles, ROAD, 2, 1, 0.0)
    desired = 25.0**2 / (2 * 2.0) - 25.0**2 / (2 * 1.4) + 25.0 * 3.4 + 8.6
    assert made.vehicles["jump_s"][2] == pytest.approx(min(old, max(30.0, 3 * desired)) - 30.0)


def test_after_a_free_road_the_jump_is_to_the_cap_and_the_own_speed():
    made = traffic({"x": 30.0, "v": 22.0}, {"x": 0.0, "v": 25.0, "leader": NOBODY, "relaxation": 10.0})
    following.take_leader(made.vehicles, ROAD, 1, 0, 0.0)
    desired = 25.0**2 / 4.0 - 25.0**2 / 2.8 + 85.0 + 8.6
    assert made.vehicles["jump_s"][1] == pytest.approx(3 * desired - 30.0)
    assert made.vehicles["jump_v"][1] == pytest.approx(3.0)


def test_the_first_leader_is_no_change():
    made = traffic({"x": 30.0, "v": 22.0}, {"x": 0.0, "v": 25.0, "memory": 5.0, "relaxation": 10.0})
    assert made.vehicles["leader"][1] == UNKNOWN
    following.take_leader(made.vehicles, ROAD, 1, 0, 0.0)
    assert following.intention(made.vehicles, ROAD, 1, 0.0) == pytest.approx(command(25.0, 30.0, 22.0))


def test_an_idm_driver_follows_by_the_idm_at_the_gap():
    made = traffic({"x": 40.0, "v": 22.0, "length": 12.0}, {"v": 25.0, "model": IDM, **IDM_PARAMETERS})
    own = IdmParameters(33.0, 1.2, 2.0, 1.0, 1.5, 9.0)
    wish = following.wish_behind(made.vehicles, ROAD, 1, 0)
    assert wish == pytest.approx(idm_acceleration(25.0, 28.0, 22.0, own), abs=1e-12)
    free = following.wish_behind(made.vehicles, ROAD, 1, NOBODY)
    assert free == pytest.approx(1 - (25 / 33) ** 4, abs=1e-12)


@pytest.mark.parametrize(("y", "moment", "minded"), [
    (1.85, 0.0, True), (1.85, 0.3, False), (2.5, 0.3, True), (2.5, 0.4, False), (3.69, 1.0, False),
])  # fmt: skip
def test_a_cut_in_is_minded_from_the_drivers_share_of_its_way_on(y, moment, minded):
    """From y = 1.85 m to the marking at 3.7 m."""
    cars = traffic({"lane": 0, "beside": 1, "origin": 0, "target": 1, "y": y}, {"lane": 1, "moment": moment})
    cars.vehicles["c"][0, 0] = 1.85
    assert following.reacts_to(cars.vehicles[1], cars.vehicles[0], 1, ROAD, 0.0) == minded


@pytest.mark.parametrize(("time", "minded"), [(10.0, False), (12.9, False), (13.1, True)])
def test_some_ignore_a_cut_in_for_a_while_after_it_crossed(time, minded):
    cars = traffic({"lane": 1, "crossed": 10.0}, {"lane": 1, "ignores": 3.0})
    assert following.reacts_to(cars.vehicles[1], cars.vehicles[0], 1, ROAD, time) == minded
    cars.vehicles["crossed"][0] = -np.inf
    assert following.reacts_to(cars.vehicles[1], cars.vehicles[0], 1, ROAD, time)


@given(closing=st.floats(0.1, 10.0), room=st.floats(5.0, 200.0), v=st.floats(10.0, 40.0))
def test_the_braking_needed_ends_at_the_least_gap(closing, room, v):
    gap = 2.0 + 0.15 * v + room
    need = following.needed_braking(gap, v, v - closing, 0.0)
    assert need == pytest.approx(min(closing**2 / (2 * room), 3 * closing), rel=1e-6)
    braking = following.needed_braking(gap, v, v - closing, -2.0)
    assert braking == pytest.approx(need + 2.0 * min(closing, 1.0), rel=1e-6)
    assert following.needed_braking(gap, v, v + closing, -2.0) == 0.0


@pytest.mark.parametrize("leader_braking", [2.0, 5.0, 8.0])
@pytest.mark.parametrize("manner", [
    {"memory": 20.0}, {"relaxation": 60.0, "jump_s": 200.0}, {"strength": 0.1}, {"model": IDM, **IDM_PARAMETERS},
])  # fmt: skip
def test_need_overrides_everything(leader_braking, manner):
    """Whatever is remembered or relaxed, nobody runs into a leader that brakes to a standstill, 20 m ahead."""
    cars = traffic(
        {"x": 24.6, "v": 28.0},
        {"v": 28.0, "a": 0.5, "carried": 0.5, "leader": 0, "moment": 1.0, "began": 0.0, **manner},
    )
    lead, me = cars.vehicles[0], cars.vehicles[1]
    cars.last[:] = 0
    for step in range(800):
        lead["a"] = -leader_braking if lead["v"] > 0 else 0.0
        me["a"] = following.drive(cars.vehicles, cars.order, cars.last, ROAD, 1, 0.04 * step)
        assert me["a"] >= -following.HARDEST_BRAKING
        for car in (lead, me):
            car["v"] = max(car["v"] + 0.04 * car["a"], 0.0)
            car["x"] += 0.04 * car["v"]
        assert lead["x"] - lead["length"] > me["x"]
    assert me["v"] < 1.0


def test_unrest_has_its_deviation():
    rng = np.random.default_rng(1)
    cars = traffic({"unrest": 0.2})
    cars.vehicles["pace"][0], cars.vehicles["phase"][0] = rng.uniform(0.1, 0.7, 4), rng.uniform(0, 6, 4)
    noise = [following.unrest(cars.vehicles[0], time) for time in np.arange(0, 5000, 0.5)]
    assert np.std(noise) == pytest.approx(0.2, rel=0.05)
    assert np.mean(noise) == pytest.approx(0.0, abs=0.01)
