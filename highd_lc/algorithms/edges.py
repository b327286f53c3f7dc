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
    if not any(hides_better(pool, goal) for goal in goals):
        return np.empty(0, np.int64), np.empty(0, np.int64)
    order = np.lexsort((pool.delta, pool.change, pool.n))
    low, high = order[:-1], order[1:]
    one_line = (pool.n[low] == pool.n[high]) & (pool.change[low] == pool.change[high])
    one_line &= pool.delta[high] - pool.delta[low] > _NARROW_M
    chosen: set[int] = set()
    for goal in goals:
        obstacle, value = pool.obstacle(goal.accounting), pool.unconstrained(goal)
        promise = np.minimum(value[low], value[high])
        edge = one_line & (obstacle[low] != obstacle[high]) & (promise < _target(pool, goal))
        where = np.flatnonzero(edge)
        chosen |= set(where[np.argsort(promise[where], kind="stable")[:_AT_ONCE]].tolist())
    places = np.array(sorted(chosen), np.int64)
    return low[places], high[places]


def _target(pool: Pool, goal: Goal) -> float:
    best = pool.best(goal)
    return np.inf if best is None else float(pool.unconstrained(goal)[best]) * (1.0 - _WORTHWHILE)


def hides_better(pool: Pool, goal: Goal) -> bool:
    """Whether some infeasible candidate promises more than the best feasible one."""
    return bool((pool.unconstrained(goal) < _target(pool, goal)).any())
