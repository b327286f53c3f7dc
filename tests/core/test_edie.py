"""Edie's measures: exact clipping, totals that add up, the paper's Table 2 from Table 1."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from highd_lc.core.edie import (
    Trajectories,
    clip_to_grid,
    clip_to_rectangle,
    edie,
    traffic_states,
    trajectories_of,
    trajectories_of_rows,
)
from highd_lc.vocab.errors import ShapeError

POSITIONS = st.lists(st.floats(-50.0, 150.0, allow_subnormal=False), min_size=2, max_size=12)


def one(t, x):
    return Trajectories(np.asarray(t, float), np.asarray(x, float), np.array([0, len(t)]))


def test_straight_line_through_one_cell():
    cells = clip_to_grid(
        one([0.0, 10.0], [-50.0, 50.0]), x_edges=np.array([0.0, 20.0]), t_edges=np.array([0.0, 6.0])
    )
    assert cells.distance[0, 0] == pytest.approx(10.0)
    assert cells.time[0, 0] == pytest.approx(1.0)
    assert cells.speed[0, 0] == pytest.approx(10.0)
    assert cells.flow[0, 0] == pytest.approx(10.0 / 120.0)
    assert cells.density[0, 0] == pytest.approx(1.0 / 120.0)


def test_standing_vehicle_on_a_border_counts_once():
    cells = clip_to_grid(
        one([0.0, 4.0], [10.0, 10.0]), x_edges=np.array([0.0, 10.0, 20.0]), t_edges=np.array([0.0, 4.0])
    )
    assert cells.time.sum() == pytest.approx(4.0)
    assert cells.time[1, 0] == pytest.approx(4.0)


def test_empty_cells_are_nan():
    cells = clip_to_grid(one([0.0, 1.0], [0.0, 1.0]), x_edges=np.arange(3.0), t_edges=np.arange(3.0))
    empty = cells.time == 0.0
    assert empty.sum() == 3
    for measure in (cells.flow, cells.speed, cells.density):
        assert np.array_equal(np.isnan(measure), empty)


def test_a_hole_breaks_the_trajectory():
    cells = clip_to_grid(
        one([0.0, 1.0, 2.0, 3.0], [0.0, 1.0, np.nan, 3.0]),
        x_edges=np.array([0.0, 5.0]),
        t_edges=np.array([0.0, 5.0]),
    )
    assert cells.distance[0, 0] == pytest.approx(1.0)
    assert cells.time[0, 0] == pytest.approx(1.0)


@settings(max_examples=200, deadline=None)
@given(POSITIONS, st.integers(1, 9), st.integers(1, 9))
def test_distance_and_time_add_up(x, rows, columns):
    t = np.linspace(0.0, 7.3, len(x))
    cells = clip_to_grid(
        one(t, x),
        x_edges=np.linspace(-50.0, 150.001, rows + 1),
        t_edges=np.linspace(0.0, 7.3, columns + 1),
    )
    assert cells.time.sum() == pytest.approx(7.3, abs=1e-9)
    assert cells.distance.sum() == pytest.approx(x[-1] - x[0], abs=1e-8)


@settings(max_examples=60, deadline=None)
@given(POSITIONS)
def test_grid_equals_fine_sampling(x):
    """Twin: very fine sampling, each small piece counted where its middle lies."""
    t = np.linspace(0.0, 5.0, len(x))
    x_edges, t_edges = np.linspace(-40.0, 140.0, 7), np.linspace(0.5, 4.5, 6)
    cells = clip_to_grid(one(t, x), x_edges=x_edges, t_edges=t_edges)
    fine = np.linspace(0.0, 5.0, 40001)
    at = np.interp(fine, t, x)
    middle_t, middle_x = (fine[1:] + fine[:-1]) / 2, (at[1:] + at[:-1]) / 2
    time, _, _ = np.histogram2d(middle_x, middle_t, bins=(x_edges, t_edges), weights=np.diff(fine))
    assert np.allclose(cells.time, time, atol=2e-3)


def test_rectangle_equals_grid_summed_over_vehicles():
    rng = np.random.default_rng(1)
    t = np.arange(0.0, 20.0, 0.1)
    x = np.cumsum(rng.uniform(0.0, 3.0, (6, len(t))), axis=1) - 40.0 * np.arange(6)[:, None]
    tracks = trajectories_of(t, x)
    distance, time = clip_to_rectangle(tracks, x_range=(30.0, 160.0), t_range=(3.05, 14.0))
    cells = clip_to_grid(tracks, x_edges=np.array([30.0, 160.0]), t_edges=np.array([3.05, 14.0]))
    assert distance.sum() == pytest.approx(cells.distance[0, 0])
    assert time.sum() == pytest.approx(cells.time[0, 0])


@pytest.mark.parametrize(
    ("time", "distance", "flow", "speed", "density"),
    [
        (96.30, 1758.72, 1875.963, 65.746, 28.533),
        (92.70, 1786.56, 1905.666, 69.381, 27.467),
        (75.30, 1414.82, 1509.140, 67.641, 22.311),
        (73.20, 1481.01, 1579.746, 72.837, 21.689),
    ],
)
def test_table_2_of_the_paper_from_its_table_1(time, distance, flow, speed, density):
    ours = edie(distance, time, 225.0 * 15.0)
    assert ours[0] == pytest.approx(flow, abs=0.006)
    assert ours[1] == pytest.approx(speed, abs=0.002)
    assert ours[2] == pytest.approx(density, abs=0.001)


def test_rows_in_any_order_make_the_same_trajectories():
    rng = np.random.default_rng(4)
    t = np.arange(0.0, 10.0, 0.04)
    x = 25.0 * t + np.array([[0.0], [-30.0], [-70.0]])
    vehicle = np.repeat([7, 3, 9], len(t))
    rows = rng.permutation(x.size)
    tracks = trajectories_of_rows(vehicle[rows], np.tile(t, 3)[rows], x.ravel()[rows], longest_step=0.1)
    assert tracks.count == 3
    edges = {"x_edges": np.linspace(-80.0, 260.0, 9), "t_edges": np.linspace(0.0, 10.0, 5)}
    made, whole = clip_to_grid(tracks, **edges), clip_to_grid(trajectories_of(t, x), **edges)
    assert np.allclose(made.distance, whole.distance)
    assert np.allclose(made.time, whole.time)


def test_a_vehicle_that_is_away_is_not_drawn_through():
    t = np.concatenate([np.arange(0.0, 2.0, 0.1), np.arange(5.0, 7.0, 0.1)])
    tracks = trajectories_of_rows(np.ones(len(t), int), t, 20.0 * t, longest_step=0.15)
    assert tracks.count == 2
    cells = clip_to_grid(tracks, x_edges=np.array([0.0, 200.0]), t_edges=np.array([0.0, 10.0]))
    assert cells.time[0, 0] == pytest.approx(1.9 + 1.9)


def test_no_rows_no_trajectories():
    tracks = trajectories_of_rows(np.zeros(0, int), np.zeros(0), np.zeros(0), longest_step=0.1)
    assert tracks.count == 0


def test_nobody_in_the_region_is_nan():
    assert np.isnan(edie(0.0, 0.0, 1.0)).all()


@pytest.mark.parametrize("edges", [np.array([1.0]), np.array([2.0, 1.0]), np.array([0.0, np.nan])])
def test_bad_edges_are_named(edges):
    with pytest.raises(ShapeError, match="x_edges"):
        clip_to_grid(one([0.0, 1.0], [0.0, 1.0]), x_edges=edges, t_edges=np.array([0.0, 1.0]))


def test_bad_shapes_are_named():
    with pytest.raises(ShapeError, match="Trajectories"):
        Trajectories(np.zeros(3), np.zeros(2), np.array([0, 3]))
    with pytest.raises(ShapeError, match="starts"):
        Trajectories(np.zeros(3), np.zeros(3), np.array([0, 2]))


def test_traffic_states_begin_at_their_densities():
    assert traffic_states(np.array([0.0, 10.9, 11.0, 21.9, 22.0, 60.0, np.nan])).tolist() == [
        "free", "free", "dense", "dense", "congested", "congested", "",
    ]  # fmt: skip
