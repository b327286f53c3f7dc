"""Lane keeping and tracking errors as sums of sines; neighbours against their definition."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from highd_lc.traffic import film as view


def sines(n: int, k: int = 4) -> np.ndarray:
    rng = np.random.default_rng(1)
    return np.stack([rng.uniform(0.5, 2.0, (n, k)), rng.uniform(0, 2 * np.pi, (n, k))], axis=2)


def test_speed_and_acceleration_are_the_derivatives_of_the_position():
    time = np.arange(0, 20, 0.001)
    motion = np.zeros((len(time), 3))
    view.add_sines(motion, time, driver=np.ones(len(time), np.int64), sines=sines(2), deviation=0.1)
    np.testing.assert_allclose(np.gradient(motion[:, 0], time)[1:-1], motion[1:-1, 1], atol=1e-6)
    np.testing.assert_allclose(np.gradient(motion[:, 1], time)[1:-1], motion[1:-1, 2], atol=1e-6)


def test_the_standard_deviation_is_the_one_asked_for():
    n = 400
    driver = np.repeat(np.arange(n), 200)
    time = np.tile(np.arange(200) * 0.5, n)
    motion = np.zeros((len(time), 3))
    view.add_sines(motion, time, driver=driver, sines=sines(n), deviation=0.08)
    assert motion[:, 0].std() == pytest.approx(0.08, rel=0.02)


def test_zero_deviation_leaves_the_motion_untouched():
    motion = np.arange(6.0).reshape(2, 3)
    view.add_sines(motion, np.array([0.0, 1.0]), driver=np.zeros(2, np.int64), sines=sines(1), deviation=0.0)
    np.testing.assert_array_equal(motion, np.arange(6.0).reshape(2, 3))


def by_definition(x: np.ndarray, length: np.ndarray, lane: np.ndarray, i: int) -> list[int]:
    def nearest(candidates: list[int]) -> int:
        return min(candidates, key=lambda j: (abs(x[j] - x[i]), j), default=-1)

    others = [j for j in range(len(x)) if j != i]
    own = [j for j in others if lane[j] == lane[i]]
    found = [nearest([j for j in own if x[j] > x[i]]), nearest([j for j in own if x[j] <= x[i]])]
    for side in (1, -1):
        there = [j for j in others if lane[j] == lane[i] + side]
        overlap = [j for j in there if abs(x[j] - x[i]) < (length[i] + length[j]) / 2]
        apart = [j for j in there if j not in overlap]
        found += [
            nearest([j for j in apart if x[j] > x[i]]),
            nearest(overlap),
            nearest([j for j in apart if x[j] <= x[i]]),
        ]
    return found


@settings(deadline=None)
@given(seed=st.integers(0, 10_000), sizes=st.lists(st.integers(0, 12), min_size=1, max_size=4))
def test_neighbours_equal_their_definition(seed, sizes):
    rng = np.random.default_rng(seed)
    n = sum(sizes)
    x, length, lane = rng.uniform(0, 100, n), rng.uniform(3, 18, n), rng.integers(1, 5, n)
    first = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    found = view.find_neighbours(view.Frames(first, x, length, lane))
    for start, end in pairwise(first):
        for i in range(end - start):
            wanted = by_definition(x[start:end], length[start:end], lane[start:end], i)
            assert [j - start if j >= 0 else -1 for j in found[start + i]] == wanted
