"""Global search over plans: every T on its grid, x_final (and v_end) on a grid, then zooming in.

The objective is not smooth and its feasible set has holes, so no single descent finds the best plan (SPEC section
7). One simulation of a candidate serves every accounting and every weight of the AV: all candidates that were
ever simulated form a pool, and each policy takes the best of it. So a policy cannot lose to another one in its
own objective.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.algorithms.basins import x_nodes
from highd_lc.algorithms.dynamics import CONSTRAINTS, forward_interval, violations
from highd_lc.algorithms.pool import Goal, Pool, Task
from highd_lc.algorithms.refinement import possible_durations, refine

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_NOMINAL_NODES: Final = 33
_NOMINAL_DURATIONS: Final = {False: 1, True: 5}
"""The plain grid has every duration in the fixed form, every fifth in the free form."""


def search(task: Task, goals: list[Goal], *, known: Pool | None = None) -> Pool:
    """All candidates of the search for the best plan of every goal.

    known: the pool of the fixed form, for a search with a free end speed; without it the form is fixed.
    """
    free = known is not None
    n = possible_durations(task)
    if free and len(n):
        n = n[np.unique(np.linspace(0, len(n) - 1, min(task.settings.T_nodes_free, len(n))).astype(int))]
    pool = refine(task, grid(task, n, free=free), goals, free=free)
    return pool if known is None else known.joined(pool)


def grid(task: Task, n: IntArray, *, free: bool) -> Pool:
    """Plans of the durations n [samples] on the nodes of the settings."""
    T = task.seconds(n)[:, None, None]
    change = _changes(task, T, free)
    low, high = forward_interval(T, change, task.scene.v0, task.limit)
    # Dense about the smoothest motion, which is also a node: the jerk sum has a kink there.
    nodes = x_nodes(task, free)
    s = np.linspace(-1.0, 1.0, nodes) + np.zeros((len(n), 1, 1))
    # Every other duration has its nodes in between: the objective changes little from one to the next.
    s[1::2] = np.where(s[1::2] == 0.0, 0.0, s[1::2] - np.sign(s[1::2]) / (nodes - 1))
    centre = np.clip(change * T / 2.0, low, np.maximum(high, low))
    delta = centre + np.where(s < 0.0, centre - low, np.maximum(high - centre, 0.0)) * s * abs(s)
    shape = (len(n), delta[0].size if len(n) else 0)
    return task.simulate(n, delta.reshape(shape), np.broadcast_to(change, delta.shape).reshape(shape))


def _changes(task: Task, T: FloatArray, free: bool) -> FloatArray:
    """Nodes of v_end - v0 [m/s], shape (rows, nodes, 1): the jerk at both ends leaves |change| <= j T^2 / 6."""
    if not free:
        return np.zeros((len(T), 1, 1))
    widest = task.limit.jerk * T**2 / 6.0
    low = np.maximum(task.limit.v_min - task.scene.v0, -widest)
    high = np.minimum(task.limit.v_max - task.scene.v0, widest)
    s = np.linspace(-1.0, 1.0, 2 * (task.settings.v_nodes // 2) + 1)[None, :, None]
    # To end at the reference speed is a node of its own: |v - v_ref| has its kink there.
    reference = np.clip(task.terms.av_ref - task.scene.v0, low, high)
    return np.concatenate([np.where(s < 0.0, -low, high) * s * abs(s), reference], axis=1)


def nominal_rejections(task: Task, *, free: bool) -> dict[str, int]:
    """How many plans of a plain grid each dynamic constraint rejects.

    The grid spans every T (every fifth in the free form), mean speeds from v_min to v_max and, in the free form,
    end speeds from v_min to v_max; a plan counts for the first constraint that it violates.
    """
    n, scene, limit = task.durations[:: _NOMINAL_DURATIONS[free]], task.scene, task.limit
    T = task.seconds(n)[:, None, None]
    span = (limit.v_min - scene.v0, limit.v_max - scene.v0)
    speeds = np.linspace(*span, _NOMINAL_NODES)
    changes = np.linspace(*span, _NOMINAL_NODES // 3) if free else np.zeros(1)
    shape = (len(n), len(speeds), len(changes))
    delta = np.broadcast_to(speeds[None, :, None] * T, shape).reshape(len(n), -1)
    change = np.broadcast_to(changes[None, None, :], shape).reshape(len(n), -1)
    codes = violations(
        task.seconds(n), np.ascontiguousarray(delta), np.ascontiguousarray(change), scene.v0, scene.D, limit
    )
    counts = np.bincount(codes.ravel(), minlength=len(CONSTRAINTS) + 1)
    return {name: int(counts[i + 1]) for i, name in enumerate(CONSTRAINTS)}
