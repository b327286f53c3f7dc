import numpy as np
import pytest
from scipy.stats import qmc

from highd_lc.drivers.least_squares import sobol


@pytest.mark.parametrize("count", [1, 2, 7, 64, 2048])
def test_points_are_scipys(count):
    expected = qmc.Sobol(6, scramble=False).random_base2(11)[:count].T
    np.testing.assert_array_equal(sobol(count), expected)


def test_every_elementary_interval_of_a_dimension_is_hit_once():
    points = np.sort(sobol(1024), axis=1)
    np.testing.assert_array_equal(np.floor(points * 1024), np.tile(np.arange(1024.0), (6, 1)))
