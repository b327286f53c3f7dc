import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymoo.indicators.hv import HV
from pymoo.util.nds.non_dominated_sorting import NonDominatedSorting

from highd_lc.planning.pareto import Points, compare, hypervolume, knee, knee_weights, non_dominated


def points(av: list[float], hv: list[float]) -> Points:
    nothing = np.zeros(len(av))
    number = np.zeros(len(av), np.int64)
    return Points(number, number, number, nothing, nothing, np.array(av, float), np.array(hv, float))


losses = st.lists(st.tuples(st.integers(0, 20), st.integers(0, 20)), min_size=1, max_size=25)


@given(losses)
def test_front_is_what_pymoo_sorts_first(pairs):
    front = non_dominated(points(*map(list, zip(*pairs, strict=True))))
    values = np.array(pairs, float)
    first = values[NonDominatedSorting().do(values, only_non_dominated_front=True)]
    assert {tuple(v) for v in first} == set(zip(front.loss_av, front.loss_hv, strict=True))
    assert (np.diff(front.loss_av) > 0).all()


@given(losses)
def test_hypervolume_equals_pymoos(pairs):
    found = hypervolume(points(*map(list, zip(*pairs, strict=True))), (0.0, 0.0), (22.0, 15.0))
    expected = HV(ref_point=np.array([22.0, 15.0]))(np.array(pairs, float)) / (22.0 * 15.0)
    assert found == pytest.approx(expected, abs=1e-12)


def test_knee_is_the_corner_and_lies_between_the_weights_of_its_edges():
    front = points([1.0, 2.0, 6.0], [10.0, 4.0, 3.0])
    assert knee(front) == 1
    # Towards (1, 10): omega + 6 omega - 6 <= 0; towards (6, 3): 4 omega - (1 - omega) >= 0.
    assert knee_weights(front, 1) == pytest.approx((0.2, 6 / 7))


def test_straight_and_tiny_fronts_have_no_knee():
    assert knee(points([0.0, 1.0, 2.0], [2.0, 1.0, 0.0])) is None
    assert knee(points([0.0, 1.0], [1.0, 0.0])) is None


def test_point_behind_the_hull_is_best_for_no_weight():
    assert np.isnan(knee_weights(points([0.0, 1.5, 2.0], [2.0, 1.9, 0.0]), 1)).all()


def test_comparison_of_a_front_with_itself_finds_no_difference():
    front = points([1.0, 2.0, 6.0], [10.0, 4.0, 3.0])
    same = compare(front, front, (0.2, 0.5, 1.0))
    assert (same.behind, same.ahead) == (0.0, 0.0)
    assert same.hypervolume == same.hypervolume_sweep
    worse = compare(points([1.1, 2.2, 6.6], [11.0, 4.4, 3.3]), front, (0.2, 0.5, 1.0))
    assert worse.behind == pytest.approx(0.1)
    assert compare(points([], []), front, (0.5,)).reference == pytest.approx((np.nan, np.nan), nan_ok=True)
