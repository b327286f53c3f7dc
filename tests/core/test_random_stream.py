import numpy as np
from numba import njit

from highd_lc.core.kernels import fill_uniform, new_stream, next_uniform


def test_words_are_those_of_the_published_generator():
    # First outputs of SplitMix64 for seed 1234567 (reference implementation by Vigna).
    words = (6457827717110365317, 3203168211198807973, 9817491932198370423, 4593380528125082431)
    stream = np.array([1234567], dtype=np.uint64)
    for word in words:
        assert next_uniform(stream) == (word >> 11) / 2**53


def test_filling_is_the_same_stream():
    one, many = new_stream(np.random.default_rng(3)), new_stream(np.random.default_rng(3))
    target = np.zeros(1003)
    fill_uniform(many, target, 2, 1000)
    np.testing.assert_array_equal(target[2:1002], [next_uniform(one) for _ in range(1000)])
    assert one[0] == many[0]
    assert target[[0, 1, 1002]].tolist() == [0.0, 0.0, 0.0]


def test_numbers_are_uniform():
    target = np.empty(200_000)
    fill_uniform(new_stream(np.random.default_rng(0)), target, 0, len(target))
    assert target.min() >= 0.0
    assert target.max() < 1.0
    counts = np.histogram(target, bins=100, range=(0, 1))[0]
    # chi-square with 99 degrees of freedom: mean 99, standard deviation 14
    assert np.sum((counts - 2000.0) ** 2 / 2000.0) < 160.0


def test_stream_is_the_same_inside_compiled_code():
    @njit
    def draw(stream):
        return next_uniform(stream) + 10.0 * next_uniform(stream)

    stream = new_stream(np.random.default_rng(5))
    copy = stream.copy()
    assert draw(stream) == next_uniform(copy) + 10.0 * next_uniform(copy)
