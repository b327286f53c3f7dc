"""What compiled kernels have in common.

How one is compiled:

    @kernel(error_model="numpy", **UNALIASED)

A random stream for compiled kernels: SplitMix64 (Steele, Lea and Flood 2014), seeded from a numpy Generator.

The state is one word owned by the caller, so that a stream is the same in any thread and any process.

An option for compiled kernels: what they write shares no memory with their other array arguments.

Without it LLVM checks before every inner loop whether what is written overlaps what is read, and goes back to
memory in between: the planner's kernel takes 1.6 times as long, a least-squares fit 1.7 times. numba knows the
flag, but ``njit`` does not offer it; so it is offered here, and left out where a version of numba has none.

    @kernel(**UNALIASED)

Products and sums that are fused by name, and the bits of a number.

A call of a C function by its address, so that kernels that are compiled once can call what is given at run time.
"""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core.compiler import Flags
from numba.core.cpu import CPUTargetOptions
from numba.core.options import TargetOptions
from numba.extending import intrinsic
from numpy.typing import NDArray


def _offered() -> dict[str, Any]:
    if "noalias" not in Flags.options:
        return {}
    CPUTargetOptions.noalias = TargetOptions.Mapping("noalias")  # type: ignore[no-untyped-call]  # numba has no types
    return {"noalias": True}


UNALIASED = _offered()
"""Keyword arguments for ``kernel``."""


_Function = TypeVar("_Function", bound=Callable[..., Any])


def kernel(**options: Any) -> Callable[[_Function], _Function]:
    """A decorator: ``njit`` for a kernel that is kept from run to run and leaves the threads of Python free.

    Without the wrapper by which C would call it: nobody does, and compiling all would take a twentieth longer.
    """
    shared = {"cache": True, "nogil": True, "no_cfunc_wrapper": True} | options
    return cast("Callable[[_Function], _Function]", njit(**shared))


_GAMMA = np.uint64(0x9E3779B97F4A7C15)
_MIX_1 = np.uint64(0xBF58476D1CE4E5B9)
_MIX_2 = np.uint64(0x94D049BB133111EB)
_S11, _S27, _S30, _S31 = np.uint64(11), np.uint64(27), np.uint64(30), np.uint64(31)


def new_stream(rng: np.random.Generator) -> NDArray[np.uint64]:
    """A stream's state, shape (1,), drawn from rng."""
    return rng.integers(0, 2**64, size=1, dtype=np.uint64)


@njit(inline="always")
def _mix(z: np.uint64) -> float:
    """A word of the sequence as a number in [0, 1), 53 random bits."""
    z = (z ^ (z >> _S30)) * _MIX_1
    z = (z ^ (z >> _S27)) * _MIX_2
    z = z ^ (z >> _S31)
    return float(np.int64(z >> _S11)) * 1.1102230246251565e-16


@kernel()
def next_uniform(stream: NDArray[np.uint64]) -> float:
    """The stream's next number in [0, 1)."""
    stream[0] += _GAMMA
    return _mix(stream[0])


@kernel()
def fill_uniform(stream: NDArray[np.uint64], target: NDArray[np.float64], first: int, count: int) -> None:
    """The stream's next count numbers in [0, 1) into target[first : first + count], vectorised."""
    start = stream[0]
    for i in range(count):
        target[first + i] = _mix(start + np.uint64(i + 1) * _GAMMA)
    stream[0] = start + np.uint64(count) * _GAMMA


def plain(values: Any, dtype: Any = np.float64) -> NDArray[Any]:
    """An array as kernels are compiled for: contiguous, writable, of its own memory.

    A kernel is compiled anew for a column of a table, a view that leaves out every other value, or an array that
    may not be written to, and so is every kernel that it calls.
    """
    return np.array(values, dtype, order="C")


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


def _fused_multiply_add(typingctx: Any, a: Any, b: Any, c: Any) -> Any:
    """a b + c, rounded once."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.fma(*args)

    return types.float64(types.float64, types.float64, types.float64), codegen


bits_of: Any = intrinsic(_bits)
float_of: Any = intrinsic(_float)
fused: Any = intrinsic(_fused_multiply_add)
"""a b + c, rounded once; in kernels alone. Left to the compiler, last bits would depend on what it inlines."""


CALL_VALUES = 10
"""Numbers that a function called by ``call_at`` takes."""


@intrinsic
def _call_at(
    typing: Any, address: Any, a: Any, b: Any, c: Any, d: Any, e: Any, f: Any, g: Any, h: Any, i: Any, j: Any
) -> Any:
    """The value of the C function ``double (*)(double, ..)`` at an address, for ten numbers."""
    del typing, address, a, b, c, d, e, f, g, h, i, j  # numba reads them from the signature
    double = ir.DoubleType()
    kind = ir.FunctionType(double, [double] * CALL_VALUES).as_pointer()

    def call(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        del context, signature
        return builder.call(builder.inttoptr(values[0], kind), values[1:])

    return types.float64(types.int64, *[types.float64] * CALL_VALUES), call


call_at: Any = _call_at
"""The value of the C function ``double (*)(double, ..)`` at an address, for ten numbers; in kernels alone."""
