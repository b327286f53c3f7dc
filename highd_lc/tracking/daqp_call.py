"""DAQP called from compiled code, without Python between the assembly of a QP and its solution.

The wheel's extension module exports DAQP's C function

    void daqp_quadprog(DAQPResult *result, DAQPProblem *problem, DAQPSettings *settings)

which numba links by name; no address is ever baked into cached code. Where a wheel keeps the function to itself
the same name leads to a callback that asks DAQP's Python interface, which is slower and gives the same bits.

The two records below lay out the leading fields of DAQP's public structs (types.h, api.h); reserved words behind
them leave room for fields that later versions append. ``settings`` is null: DAQP's defaults. ``check_daqp`` solves
a problem of known solution through this door before the first use, so that another layout is an error message and
not a wrong number.
"""

import ctypes
from functools import cache
from typing import Any

import daqp
import llvmlite.binding as llvm
import numpy as np
from numba import types
from numpy.typing import NDArray

from highd_lc.core.kernels import kernel
from highd_lc.vocab.errors import MissingExtraError

FloatArray = NDArray[np.float64]

INFINITY = 1e30
"""DAQP's infinity (constants.h)."""

_INT, _POINTER, _FLOAT = "i4", "i8", "f8"
PROBLEM = np.dtype(
    [
        ("n", _INT),
        ("m", _INT),
        ("ms", _INT),
        ("H", _POINTER),
        ("f", _POINTER),
        ("A", _POINTER),
        ("bupper", _POINTER),
        ("blower", _POINTER),
        ("sense", _POINTER),
        ("break_points", _POINTER),
        ("nh", _INT),
        ("problem_type", _INT),
        ("reserved", _POINTER, (16,)),
    ],
    align=True,
)
RESULT = np.dtype(
    [
        ("x", _POINTER),
        ("lam", _POINTER),
        ("fval", _FLOAT),
        ("soft_slack", _FLOAT),
        ("exitflag", _INT),
        ("iter", _INT),
        ("nodes", _INT),
        ("solve_time", _FLOAT),
        ("setup_time", _FLOAT),
        ("reserved", _POINTER, (16,)),
    ],
    align=True,
)

_SYMBOL = "daqp_quadprog"


def _array(address: int, *shape: int, dtype: Any = np.float64) -> Any:
    """The array of a shape that begins at an address."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    return np.frombuffer((ctypes.c_char * size).from_address(int(address)), dtype).reshape(shape)


def _asked_in_python(result: int, problem: int, settings: int | None) -> None:
    """DAQP's C function by its Python interface. All: addresses of its structs; settings: null, the defaults."""
    p, r = _array(problem, 1, dtype=PROBLEM)[0], _array(result, 1, dtype=RESULT)[0]
    n, m = int(p["n"]), int(p["m"])
    H, f, A = _array(p["H"], n, n), _array(p["f"], n), _array(p["A"], m, n)
    upper, lower, sense = _array(p["bupper"], m), _array(p["blower"], m), _array(p["sense"], m, dtype=np.intc)
    x, fval, flag, info = daqp.solve(*(given.copy() for given in (H, f, A, upper, lower, sense)))
    _array(r["x"], n)[:] = x
    _array(r["lam"], m)[:] = info["lam"]
    r["fval"], r["exitflag"] = fval, flag


_CALLBACK = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p)(_asked_in_python)


def _is_exported() -> bool:
    return hasattr(ctypes.CDLL(daqp.__file__), _SYMBOL)


def ask_python() -> None:
    """Let the kernels ask DAQP's Python interface from here on; those that are linked already are not changed."""
    llvm.add_symbol(_SYMBOL, ctypes.cast(_CALLBACK, ctypes.c_void_p).value)


if _is_exported():
    llvm.load_library_permanently(daqp.__file__)
else:
    ask_python()
_daqp_quadprog: Any = types.ExternalFunction(_SYMBOL, types.void(types.intp, types.intp, types.intp))


@kernel(inline="always")
def daqp_solve(
    H: FloatArray,
    f: FloatArray,
    A: FloatArray,
    upper: FloatArray,
    lower: FloatArray,
    sense: NDArray[np.intc],
    x: FloatArray,
    lam: FloatArray,
    problem: Any,
    result: Any,
) -> int:
    """min 0.5 x'H x + f'x subject to lower <= A x <= upper, written into x (n,) and lam (m,).

    H (n, n) positive definite, f (n,), A (m, n), upper, lower (m,), sense (m,) zeros, all C-contiguous;
    problem, result: records of the dtypes PROBLEM and RESULT, shape (1,). Returns DAQP's exit flag: positive =
    solved, negative = not (-1 infeasible, -2 cycling, -4 iteration limit, -5 not convex).
    """
    p = problem[0]
    p.n, p.m, p.ms = f.shape[0], upper.shape[0], 0
    p.H, p.f, p.A = H.ctypes.data, f.ctypes.data, A.ctypes.data
    p.bupper, p.blower, p.sense = upper.ctypes.data, lower.ctypes.data, sense.ctypes.data
    p.break_points, p.nh, p.problem_type = 0, 0, 0
    r = result[0]
    r.x, r.lam = x.ctypes.data, lam.ctypes.data
    for row in range(upper.shape[0]):
        lam[row] = 0.0
    _daqp_quadprog(result.ctypes.data, problem.ctypes.data, 0)
    return int(r.exitflag)


@cache
def check_daqp() -> None:
    """Raise MissingExtraError unless the compiled call reproduces a QP of known solution; checked once.

    min 0.5 (x1^2 + x2^2) - 2 x1 - x2 subject to x1 + x2 <= 1: x = (1, 0), multiplier 1.
    """
    x, lam = np.zeros(2), np.zeros(1)
    flag = daqp_solve(
        np.eye(2),
        np.array([-2.0, -1.0]),
        np.ones((1, 2)),
        np.ones(1),
        np.full(1, -INFINITY),
        np.zeros(1, np.intc),
        x,
        lam,
        np.zeros(1, PROBLEM),
        np.zeros(1, RESULT),
    )
    if flag != 1 or not np.allclose([*x, *lam], [1.0, 0.0, 1.0], atol=1e-9):
        raise MissingExtraError(f"daqp: the installed version gives x = {x} (flag {flag}) instead of (1, 0)")
