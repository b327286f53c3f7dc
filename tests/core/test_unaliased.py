"""Kernels that take the option compute the same as without."""

import numpy as np
from numba import njit

from highd_lc.core.kernels import UNALIASED


def _running_sum(values: np.ndarray, out: np.ndarray) -> None:
    for i in range(1, len(values)):
        out[i] = out[i - 1] + values[i]


def test_arguments_that_share_no_memory_give_the_same_result():
    plain, marked = njit(_running_sum), njit(**UNALIASED)(_running_sum)
    values = np.arange(100.0)
    results = []
    for kernel in (plain, marked):
        out = np.zeros(100)
        kernel(values, out)
        results.append(out)
    assert np.array_equal(*results)
    assert np.array_equal(results[0], np.cumsum(values))
