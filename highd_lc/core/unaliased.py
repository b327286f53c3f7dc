"""An option for compiled kernels: what they write shares no memory with their other array arguments.

Without it LLVM checks before every inner loop whether what is written overlaps what is read, and goes back to
memory in between: the planner's kernel takes 1.6 times as long, a least-squares fit 1.7 times. numba knows the
flag, but ``njit`` does not offer it; so it is offered here, and left out where a version of numba has none.

    @njit(cache=True, nogil=True, **UNALIASED)
"""

from typing import Any

from numba.core.compiler import Flags
from numba.core.cpu import CPUTargetOptions
from numba.core.options import TargetOptions


def _offered() -> dict[str, Any]:
    if "noalias" not in Flags.options:
        return {}
    CPUTargetOptions.noalias = TargetOptions.Mapping("noalias")  # type: ignore[no-untyped-call]
    return {"noalias": True}


UNALIASED = _offered()
"""Keyword arguments for ``njit``."""
