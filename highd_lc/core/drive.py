"""The step of a follower, once for every kernel: command by its model, bounded braking, semi-implicit Euler.

    a = max(model(v, spacing, v_leader), -hardest),   v <- max(0, v + a dt),   x <- x + v dt

All vehicles move on the states of the same instant. The model alone commands unlimited braking as the spacing
vanishes, the LCM up to exp(40) m/s^2. ``hardest`` [m/s^2, positive] bounds it; infinite = unbounded.

A follower behind a lane change adds memory, a credited jump and a need to its command (equations.md 3.10):

    a = m a_0 + (1 - m) (command(v, spacing + credit, v_leader + credit) + drift),   m = exp(-t / memory)

The braking is at least what stopping behind the leader requires, once that exceeds ``need``; then it is bounded.
The credit is the jump of spacing and speed at a change of leader, and it fades. Where kernels inline the parts,
the family is a constant, so that a driver without these parts takes no longer than its model.

A command of a researcher's own is a Python function. It is compiled to a C function, and its address stands in
the place of the family: kernels call it without having known it when they were compiled.
"""

import ctypes
from collections.abc import Callable
from functools import cache
from typing import Any, Final

import numpy as np
from numba import cfunc, njit, types
from numpy.typing import NDArray

from highd_lc.core.kernels import CALL_VALUES, call_at, fused, kernel
from highd_lc.core.lcm import desired_spacing, idm_command, lcm_acceleration
from highd_lc.vocab import names
from highd_lc.vocab.errors import SettingsError
from highd_lc.vocab.follower_names import command_parameters, own_function

FloatArray = NDArray[np.float64]

NO_COMMAND, LCM, IDM = range(3)
"""Families of the command, by their place in ``vocab.names.FAMILIES``. An IDM has its time gap and its gap at
standstill where the LCM has tau and L. A larger number is the address of a command of one's own, whose parameters
stand where the LCM has its six.
"""
UNBOUNDED: Final = float("inf")
"""The hardest braking of followers whose braking nothing bounds."""
_LARGEST_JUMP = 2.0
_SMALLEST_GAP = 0.1
_MOST = 1e3  # a command of one's own counts as no more than this, and as braking so hard where it is no number
_RESERVE = 1.0  # who brakes in need wants to stop this far behind [m]


def hardest_braking(b_max: float) -> float:
    """The bound of the kernels from the setting ``b_max`` [m/s^2], in which 0 stands for unbounded."""
    return b_max if b_max > 0.0 else UNBOUNDED


def family_code(family: str) -> int:
    """What kernels know a family by: its place in ``names.FAMILIES``, or the address of a command of one's own.

    An address is good in this process alone. Raises SettingsError if there is no such command.
    """
    return names.FAMILIES.index(family) if family in names.FAMILIES else _address(family)


@cache
def _address(base: str) -> int:
    function = own_function(base)
    if function is None:
        raise SettingsError(f"follower model {base!r}: no such function")
    call = _as_c(function, len(command_parameters(function)))
    _KEPT.append(call)
    return int(call.address) if hasattr(call, "address") else int(ctypes.cast(call, ctypes.c_void_p).value or 0)


_KEPT: list[Any] = []
"""C functions live as long as somebody holds them."""


def _as_c(function: Callable[..., float], count: int) -> Any:
    """A command with that many parameters as a C function; where numba cannot compile it, by way of Python."""
    inner = function if hasattr(function, "py_func") else njit(error_model="numpy")(function)
    number = types.float64

    def call(
        v: float, v_leader: float, spacing: float, p: float, q: float, r: float, s: float, t: float, u: float,
        length: float,
    ) -> float:  # fmt: skip
        a = inner(v, v_leader, spacing, (p, q, r, s, t, u)[:count] + (length,))  # noqa: RUF005 numba has no star
        return max(min(a, _MOST), -_MOST) if a == a else -_MOST

    def interpreted(*values: float) -> float:
        a = function(*values[:3], (*values[3 : 3 + count], values[-1]))
        return max(min(a, _MOST), -_MOST) if a == a else -_MOST

    try:
        return cfunc(number(*[number] * CALL_VALUES))(call)
    except Exception:  # of whatever kind numba raises for what it cannot compile
        return ctypes.CFUNCTYPE(ctypes.c_double, *[ctypes.c_double] * CALL_VALUES)(interpreted)


@njit(inline="always")
def bounded(a: float, hardest: float) -> float:
    """A command a [m/s^2] that brakes by ``hardest`` at most."""
    return max(a, -hardest)


@njit(inline="always")
def gentle(a: float, before: float, most: float, step: float) -> float:
    """A command a [m/s^2] of at most ``most`` either way that differs from the one before by ``step`` at most.

    Infinite bounds leave it as it is.
    """
    return min(max(a, max(before - step, -most)), min(before + step, most))


@njit(inline="always")
def advance(x: float, v: float, a: float, dt: float) -> tuple[float, float]:
    """Position [m] and speed [m/s], at least 0, a step dt [s] later under the command a [m/s^2]."""
    faster = max(fused(a, dt, v), 0.0)
    return fused(faster, dt, x), faster


@njit(inline="always")
def lcm_command(
    v: float,
    spacing: float,
    v_leader: float,
    v_desire: float,
    A: float,
    b: float,
    B: float,
    tau: float,
    L: float,
    hardest: float,
) -> float:
    """What an LCM driver commands [m/s^2]: ``core.lcm.lcm_acceleration``, bounded."""
    return bounded(lcm_acceleration(v, spacing, v_leader, v_desire, A, b, B, tau, L), hardest)


@njit(inline="always")
def lcm_step(
    x: float,
    v: float,
    leader_x: float,
    v_leader: float,
    v_desire: float,
    A: float,
    b: float,
    B: float,
    tau: float,
    L: float,
    hardest: float,
    dt: float,
) -> tuple[float, float, float]:
    """The step of an LCM driver: its command [m/s^2], and front [m] and speed [m/s] a step later.

    x, leader_x: front bumpers [m] (an infinite leader_x is a free road); the rest as in ``lcm_command``; dt [s].
    """
    a = lcm_command(v, leader_x - x, v_leader, v_desire, A, b, B, tau, L, hardest)
    later, faster = advance(x, v, a, dt)
    return a, later, faster


@njit(inline="always")
def family_command(
    family: int,
    v: float,
    spacing: float,
    v_leader: float,
    leader_length: float,
    v_desire: float,
    A: float,
    b: float,
    B: float,
    tau: float,
    L: float,
) -> float:
    """The command of a family [m/s^2], not bounded; 0 of ``NO_COMMAND``."""
    if family == LCM:
        return lcm_acceleration(v, spacing, v_leader, v_desire, A, b, B, tau, L)
    if family == IDM:
        return idm_command(v, spacing - leader_length, v_leader, v_desire, A, b, tau, L)
    if family > IDM:
        a: float = call_at(family, v, v_leader, spacing, v_desire, A, b, B, tau, L, leader_length)
        return a
    return 0.0


@njit(inline="always")
def remembered(t: float, memory: float) -> float:
    """Share m of the acceleration at t_start that persists t [s] later. memory: time constant [s], 0 = none."""
    return np.exp(-t / memory) if memory > 0.0 else 0.0


@njit(inline="always")
def credited(t: float, relaxation: float) -> float:
    """Share of the jump that is credited t [s] after the change of leader, 0 before it.

    relaxation: time in which it fades [s], 0 = none.
    """
    return max(1.0 - t / relaxation, 0.0) if relaxation > 0.0 and t >= 0.0 else 0.0


@njit(inline="always")
def intended(a: float, a_0: float, m: float, drift: float) -> float:
    """A command a [m/s^2] mixed with the acceleration a_0 that persists with share m; drift: of the road."""
    value: float = fused(m, a_0, (1.0 - m) * (a + drift))
    return value


@njit(inline="always")
def in_need(a: float, gap: float, closing: float, need: float) -> float:
    """A command a [m/s^2] no weaker than stopping a metre behind the leader requires, where that exceeds need.

    gap: bumper to bumper [m]; what is left of it counts as 0.1 m at least; closing: speed over the leader's [m/s].
    """
    towards = max(closing, 0.0)
    required = towards * towards / (2.0 * max(gap - _RESERVE, _SMALLEST_GAP))
    return min(a, -required) if required > need else a


@njit(inline="always")
def follower_command(
    family: int,
    v: float,
    spacing: float,
    v_leader: float,
    leader_length: float,
    v_desire: float,
    A: float,
    b: float,
    B: float,
    tau: float,
    L: float,
    credit: float,
    v_credit: float,
    m: float,
    a_0: float,
    drift: float,
    need: float,
    hardest: float,
) -> float:
    """What a follower commands [m/s^2]. credit [m], v_credit [m/s]: what is left of its jump (``jump``)."""
    seen, v_seen = spacing + credit, max(v_leader + v_credit, 0.0)
    a = family_command(family, v, seen, v_seen, leader_length, v_desire, A, b, B, tau, L)
    a = in_need(intended(a, a_0, m, drift), spacing - leader_length, v - v_leader, need)
    return bounded(a, hardest)


@njit(inline="always")
def jump(
    family: int,
    v: float,
    spacing: float,
    v_leader: float,
    old_spacing: float,
    v_old_leader: float,
    b: float,
    B: float,
    tau: float,
    L: float,
) -> tuple[float, float]:
    """What a change of leader takes from a follower's spacing [m] and from its leader's speed [m/s].

    Of the spacing a follower credits no more than it had, and than a multiple of what it desires; without an old
    leader (old_spacing infinite) what it desires, and no speed. What a command of one's own desires is not known:
    it credits what it had, and nothing without an old leader.
    """
    alone = old_spacing == np.inf
    if family > IDM:
        return (0.0, 0.0) if alone else (max(old_spacing - spacing, 0.0), v_old_leader - v_leader)
    wanted = desired_spacing(v, v_leader, b, B, tau, L) if family == LCM else L + v * tau
    had = wanted if alone else min(old_spacing, _LARGEST_JUMP * wanted)
    return max(had - spacing, 0.0), 0.0 if alone else v_old_leader - v_leader


@kernel()
def drive_behind(
    x: float,
    v: float,
    leader_x: FloatArray,
    leader_v: FloatArray,
    parameters: FloatArray,
    hardest: float,
    dt: float,
) -> tuple[FloatArray, FloatArray]:
    """Fronts [m] and speeds [m/s] of one LCM driver at all samples of its leader's, shape (N,), from x and v on.

    leader_x: front bumper [m], infinite = a free road; parameters: LCM, shape (6,).
    """
    v_desire, A, b, B, tau, L = parameters
    front, speed = np.empty(len(leader_x)), np.empty(len(leader_x))
    for k in range(len(leader_x)):
        front[k], speed[k] = x, v
        _, x, v = lcm_step(x, v, leader_x[k], leader_v[k], v_desire, A, b, B, tau, L, hardest, dt)
    return front, speed
