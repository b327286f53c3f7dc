"""An exponential that LLVM can vectorise.

The exponential is the whole cost of the LCM. ``math.exp`` is a call that stops LLVM from vectorising the loop
around it (numba's wheels carry no vector math library), so the hot kernels use this polynomial instead.
"""

from typing import Any

import numpy as np
from numba import njit, types
from numba.extending import intrinsic

_LOG2_E = 1.4426950408889634
_LN2_HIGH = 6.93147180369123816490e-01
_LN2_LOW = 1.90821492927058770002e-10
# Adding 1.5 * 2**52 leaves the nearest integer in the low bits of the mantissa.
_ROUND = 6755399441055744.0
_C2, _C3, _C4, _C5, _C6, _C7 = 1 / 2, 1 / 6, 1 / 24, 1 / 120, 1 / 720, 1 / 5040
_C8, _C9, _C10, _C11, _C12 = 1 / 40320, 1 / 362880, 1 / 3628800, 1 / 39916800, 1 / 479001600


def _bits(typingctx: Any, value: Any) -> Any:
    """The 64 bits of a float as an integer."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.bitcast(args[0], context.get_value_type(types.int64))

    return types.int64(types.float64), codegen


def _float(typingctx: Any, value: Any) -> Any:
    """The float that 64 bits stand for."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.bitcast(args[0], context.get_value_type(types.float64))

    return types.float64(types.int64), codegen


_bits_of: Any = intrinsic(_bits)
_float_of: Any = intrinsic(_float)


@njit(inline="always", fastmath={"contract"})
def vector_exp(x: float) -> float:
    """exp(x) for -700 <= x <= 700, relative error below 1e-15; outside that range the result is undefined.

    exp(x) = 2**n exp(r), n the integer nearest x / ln 2, |r| <= ln(2)/2, exp(r) by its Taylor series to r**12
    (remainder 2e-16) in Estrin's order.
    """
    shifted = x * _LOG2_E + _ROUND
    n = shifted - _ROUND
    r = (x - n * _LN2_HIGH) - n * _LN2_LOW
    r2 = r * r
    r4 = r2 * r2
    low = (1.0 + r) + r2 * (_C2 + _C3 * r)
    middle = (_C4 + _C5 * r) + r2 * (_C6 + _C7 * r)
    high = (_C8 + _C9 * r) + r2 * (_C10 + _C11 * r) + r4 * _C12
    scale: float = _float_of((_bits_of(shifted) + np.int64(1023)) << np.int64(52))
    return (low + r4 * (middle + r4 * high)) * scale
