"""Edges of what is feasible: where neighbouring candidates differ in what stands in their way.

Beside a contact the best plan lies on an edge, or in a slot between two vehicles that no node of a grid falls
into. Losses are known of infeasible candidates as well, so an interval is worth a look only if its ends promise
less than the best feasible plan: best-first bisection, many intervals at a time.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.algorithms.contacts import LANES
from highd_lc.algorithms.pool import Goal, Pool, Task

IntArray = NDArray[np.int64]

_LEVELS: Final = 6
_AT_ONCE: Final = 24
"""Intervals of each goal that are divided at a level."""
_NARROW_M: Final = 2e-3
_WORTHWHILE: Final = 2e-4
"""Relative gain that an interval must promise."""


def refine_edges(task: Task, pool: Pool, goals: list[Goal]) -> Pool:
    """The pool with finer candidates across the edges that promise more than the best of some goal."""
    between = np.linspace(0.0, 1.0, LANES + 2)[1:-1]
    for _ in range(_LEVELS):
        low, high = _promising(pool, goals)
        if not len(low):
            break
        start, end = pool.delta[low][:, None], pool.delta[high][:, None]
        change = np.repeat(pool.change[low][:, None], LANES, axis=1)
        pool = pool.joined(task.simulate(pool.n[low], start + (end - start) * between, change))
    return pool


def _promising(pool: Pool, goals: list[Goal]) -> tuple[IntArray, IntArray]:
    """The candidates at both ends of each interval to divide."""
    target = {goal: _target(pool, goal) for goal in goals}
    tempting = np.logical_or.reduce([pool.unconstrained(goal) < target[goal] for goal in goals])
    if not tempting.any():
        return np.empty(0, np.int64), np.empty(0, np.int64)
    lined = _on_lines(pool, tempting)
    part = pool.chosen(lined)
    low, high = np.arange(len(part) - 1), np.arange(1, len(part))
    one_line = (part.n[low] == part.n[high]) & (part.change[low] == part.change[high])
    one_line &= part.delta[high] - part.delta[low] > _NARROW_M
    chosen: set[int] = set()
    for goal in goals:
        obstacle, value = part.obstacle(goal.accounting), part.unconstrained(goal)
        promise = np.minimum(value[low], value[high])
        where = np.flatnonzero(one_line & (obstacle[low] != obstacle[high]) & (promise < target[goal]))
        chosen |= set(where[np.argsort(promise[where], kind="stable")[:_AT_ONCE]].tolist())
    places = np.array(sorted(chosen), np.int64)
    return lined[places], lined[places + 1]


def _on_lines(pool: Pool, wanted: NDArray[np.bool_]) -> IntArray:
    """The lines over x_final that hold a wanted candidate, in order: no other one has a promising interval."""
    durations = np.zeros(pool.n.max() + 1, np.bool_)
    durations[pool.n[wanted]] = True
    on = np.flatnonzero(durations[pool.n])
    on = on[np.isin(pool.change[on], pool.change[wanted])]
    return on[np.lexsort((pool.delta[on], pool.change[on], pool.n[on]))]


def _target(pool: Pool, goal: Goal) -> float:
    best = pool.best(goal)
    return np.inf if best is None else float(pool.objective(goal)[best]) * (1.0 - _WORTHWHILE)


def hides_better(pool: Pool, goal: Goal) -> bool:
    """Whether some infeasible candidate promises more than the best feasible one."""
    return bool((pool.unconstrained(goal) < _target(pool, goal)).any())
