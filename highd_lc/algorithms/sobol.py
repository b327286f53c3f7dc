"""A Sobol sequence in six dimensions, without the second that importing scipy's takes."""

from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

_BITS: Final = 30
# Joe and Kuo (2008), "new-joe-kuo-6": degree and coefficients of the primitive polynomial, first directions.
_POLYNOMIALS: Final = ((1, 0, (1,)), (2, 1, (1, 3)), (3, 1, (1, 3, 1)), (3, 2, (1, 1, 1)), (4, 1, (1, 1, 3, 3)))


def _directions(degree: int, coefficients: int, first: tuple[int, ...]) -> NDArray[np.int64]:
    """Direction numbers of one dimension, shape (_BITS,)."""
    m = list(first)
    for k in range(degree, _BITS):
        value = m[k - degree] ^ (m[k - degree] << degree)
        for i in range(1, degree):
            if coefficients >> (degree - 1 - i) & 1:
                value ^= m[k - i] << i
        m.append(value)
    return np.array([value << (_BITS - 1 - k) for k, value in enumerate(m)])


@cache
def sobol(count: int) -> NDArray[np.float64]:
    """The first count points of the sequence in [0, 1)^6, shape (6, count), in Gray-code order."""
    identity = np.array([1 << (_BITS - 1 - k) for k in range(_BITS)])
    directions = np.stack([identity, *(_directions(*polynomial) for polynomial in _POLYNOMIALS)])
    index = np.arange(1, count)
    lowest_bit = np.log2(index & -index).astype(np.int64)
    words = np.zeros((6, count), dtype=np.int64)
    words[:, 1:] = np.bitwise_xor.accumulate(directions[:, lowest_bit], axis=1)
    return words / float(1 << _BITS)
