"""The vectorisable exponential against numpy's."""

import numpy as np
from numba import njit

from highd_lc.core.lcm import vector_exp


@njit
def exponentials(x):
    return np.array([vector_exp(value) for value in x])


def test_it_is_as_exact_as_the_format_allows():
    x = np.concatenate([np.linspace(-700, 700, 200_001), np.linspace(-1, 1, 100_001), [0.0, -0.0, 1e-300]])
    np.testing.assert_allclose(exponentials(x), np.exp(x), rtol=1e-15)


def test_exp_of_zero_is_one():
    assert exponentials(np.zeros(1))[0] == 1.0
