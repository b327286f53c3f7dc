"""Global search over plans: every T on its grid, x_final (and v_end) on a grid, then zooming in.

``search`` is the entry: it makes the ``grid`` and has it refined (``refine``).

The objective is not smooth and its feasible set has holes, so no single descent finds the best plan (equations.md
7). One simulation of a candidate serves every accounting and every weight of the AV: all candidates that were
ever simulated form a pool, and each policy takes the best of it. So a policy cannot lose to another one in its
own objective.

Basins: the candidates of a pool that are lower than all around them, in the coordinates of the search's grid.

A plan is described by its duration, by ``change`` = v_end - v0 and by its bend = delta - change T / 2: how far it
falls behind or gets ahead of the plan whose speed changes smoothly. Bend and change are nearly independent of each
other. The grid's nodes over each lie at widest s |s|, evenly spaced in s.

Refinement of a pool: across edges, about the best basins of each goal, along T, and to the last digits.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.kernels import kernel, plain
from highd_lc.planning.contacts import WIDTH
from highd_lc.planning.limits import CONSTRAINTS, forward_interval, violations
from highd_lc.planning.pool import Goal, Pool, Task, distinct
from highd_lc.planning.safety import starts_critically
from highd_lc.planning.zoom import Starts, hides_better, refine_edges, zoom

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_LOOKED_AT: Final = 150
"""Lowest candidates, each the lowest of its line over x_final, among which basins are told apart."""
_DURATIONS: Final = 2
_NODES: Final = 1.6
"""How far around a basin's candidate is the lowest: in durations of the pool, in nodes of the grid."""

Head = tuple[int, int]
"""The best candidate of a basin and the goal whose basin it is."""


class Widest(NamedTuple):
    """Largest bend [m] and change [m/s] that the limits of jerk and speed leave, each of the durations' shape."""

    bend: FloatArray
    change: FloatArray


def widest(task: Task, T: FloatArray) -> Widest:
    """What the limits leave at durations T [s]: |bend| <= j T^3 / 60, |change| <= j T^2 / 6."""
    span = task.limit.v_max - task.limit.v_min
    return Widest(
        np.minimum(task.limit.jerk * T**3 / 60.0, span * T / 1.875),
        np.minimum(task.limit.jerk * T**2 / 6.0, span),
    )


def x_nodes(task: Task) -> int:
    """Nodes over x_final: odd, so that the middle one is the smoothest motion."""
    return 2 * ((task.settings.x_nodes - 1) // 2) + 1


def node_step(value: FloatArray, largest: FloatArray, nodes: int) -> FloatArray:
    """Distance from a value to the next node of a grid with that many nodes at largest s |s|, s in [-1, 1]."""
    step = 2.0 / (nodes - 1)
    return largest * step * (2.0 * np.sqrt(np.minimum(np.abs(value) / largest, 1.0)) + step)


def basins(task: Task, pool: Pool, goals: list[Goal]) -> list[Head]:
    """The best basins of each goal that is not like one before it, at most ``zoom_starts`` of them, best first."""
    order = np.lexsort((pool.delta, pool.change, pool.n))
    new_line = (np.diff(pool.n[order]) != 0) | (np.diff(pool.change[order]) != 0)
    place = _places(task, pool)
    heads: list[Head] = []
    for g in distinct(pool, goals):
        value = pool.objective(goals[g])
        lowest = order[_line_minima(value[order], new_line)]
        lowest = lowest[np.argsort(value[lowest], kind="stable")][:_LOOKED_AT]
        heads += [(int(i), g) for i in lowest[_alone(place[lowest])][: task.settings.zoom_starts]]
    return heads


def _places(task: Task, pool: Pool) -> FloatArray:
    """Each candidate's place, shape (M, 3): neighbours are less than 1 apart in every coordinate."""
    T = task.seconds(pool.n)
    largest = widest(task, T)
    _, row = np.unique(pool.n, return_inverse=True)
    bend = _evenly(pool.delta - pool.change * T / 2.0, largest.bend, x_nodes(task))
    change = _evenly(pool.change, largest.change, task.settings.v_nodes)
    return np.stack([row / (_DURATIONS + 0.5), bend / _NODES, change / _NODES], axis=1)


def _evenly(value: FloatArray, largest: FloatArray, nodes: int) -> FloatArray:
    """A value counted in nodes of the grid from the middle one."""
    s: FloatArray = np.sign(value) * np.sqrt(np.abs(value) / largest) * (nodes - 1) / 2.0
    return s


def _line_minima(value: FloatArray, new_line: NDArray[np.bool_]) -> IntArray:
    """Indices of the finite values that are not above their neighbours on the same line."""
    if not len(value):
        return np.empty(0, np.int64)
    edge = np.where(new_line, np.inf, 0.0)
    before = np.concatenate([[np.inf], value[:-1] + edge])
    after = np.concatenate([value[1:] + edge, [np.inf]])
    return np.flatnonzero(np.isfinite(value) & (value <= before) & (value <= after))


@kernel()
def _alone(place: FloatArray) -> NDArray[np.bool_]:
    """Which places, best first, have no better neighbour."""
    alone = np.ones(len(place), np.bool_)
    for i in range(len(place)):
        for j in range(i):
            near = True
            for axis in range(place.shape[1]):
                near &= abs(place[i, axis] - place[j, axis]) < 1.0
            if near:
                alone[i] = False
                break
    return alone


_RIVAL: Final = 0.01
"""Basins that are relatively worse by less than this are followed along T beside the best one."""
_STEPS: Final = (-4, -3, -2, -1, 1, 2, 3, 4)
"""Durations that are tried from each duration reached [samples]."""
_STEPS_UNACCELERATED: Final = {True: (-2, 2), False: ()}
_UNDECIDED: Final = 0.002
_FINALISTS: Final = 3
_BESIDE: Final = 0.5
"""Window of the zoom at a duration beside the one reached, over a step of the grid."""
_FINEST: Final = {True: 0.02, False: 0.03}
"""Window of the last zoom over that of the first, of the free and of the fixed form."""

Row = tuple[int, int, int]
"""A start: duration in samples, index of the candidate that is moved there, goal."""
Place = tuple[int, bool, bool, int]
"""A goal, whether plans of a basin get ahead of the smoothest motion, whether they end faster, a duration."""


def refine(task: Task, pool: Pool, goals: list[Goal], *, free: bool) -> Pool:
    """The pool with finer candidates about the best of each goal; as it is where none may start at all."""
    if starts_critically(task.scene):
        return pool
    pool = refine_edges(task, pool, goals)
    pool, heads = _zoom_heads(task, pool, goals, basins(task, pool, goals), free=free)
    explored: set[Place] = set()
    while rows := _beside(task, pool, _leading(pool, goals, heads), explored, free=free):
        pool, starts = _into_slots(task, pool, goals, rows) if free else (pool, rows)
        pool, found = zoom_rows(task, pool, goals, starts, free=free, window=_BESIDE)
        heads = _stepped(pool, goals, rows, found)
    return _zoom_heads(task, pool, goals, _finalists(pool, goals), free=free, window=_FINEST[free])[0]


def possible_durations(task: Task) -> IntArray:
    """Durations whose lateral motion keeps the limits: it does not depend on the rest."""
    n = task.durations
    zero = np.zeros((len(n), 1))
    scene = task.scene
    codes = violations(task.seconds(n), zero, zero, scene.v0, scene.D, task.limit, scene.start)[:, 0]
    possible: IntArray = n[(codes != 1) & (codes != 2)]
    return possible


def zoom_rows(
    task: Task, pool: Pool, goals: list[Goal], rows: list[Row], *, free: bool, window: float = 1.0
) -> tuple[Pool, IntArray]:
    """The pool with ever finer candidates about those of the rows, and the best one of each row, -1 for none.

    window: width of the first cloud over a step of the grid.
    """
    if not rows:
        return pool, np.empty(0, np.int64)
    n, index, goal = (np.array(column) for column in zip(*rows, strict=True))
    starts = Starts(n, goal, *_window(task, pool, n, index, window=window))
    levels = task.settings.zoom_levels_free if free else task.settings.zoom_levels
    return zoom(task, pool, goals, starts, levels=levels, free=free)


def _zoom_heads(
    task: Task, pool: Pool, goals: list[Goal], heads: list[Head], *, free: bool, window: float = 1.0
) -> tuple[Pool, list[Head]]:
    rows = [(int(pool.n[i]), i, g) for i, g in heads]
    pool, found = zoom_rows(task, pool, goals, rows, free=free, window=window)
    return pool, _stepped(pool, goals, rows, found)


def _window(
    task: Task, pool: Pool, n: IntArray, index: IntArray, *, window: float
) -> tuple[FloatArray, FloatArray]:
    """Centres and frames about candidates that are moved to durations n: as wide as the grid's steps there."""
    change = pool.change[index]
    bend = pool.delta[index] - change * task.seconds(pool.n[index]) / 2.0
    largest = widest(task, task.seconds(n))
    frame = np.zeros((len(n), 2, 2))
    frame[:, 0, 0] = window * node_step(bend, largest.bend, x_nodes(task))
    frame[:, 1, 1] = window * node_step(change, largest.change, task.settings.v_nodes)
    return np.stack([bend, change], axis=1), frame


def _leading(pool: Pool, goals: list[Goal], heads: list[Head]) -> list[Head]:
    """Whose durations to vary next: each goal's best candidate, and the heads of basins that are hardly worse.

    A goal that makes the same of every candidate as one before it needs nothing of its own.
    """
    leading: list[Head] = []
    for g in distinct(pool, goals):
        value, best = pool.objective(goals[g]), pool.best(goals[g])
        if best is not None:
            rivals = [i for i, of in heads if of == g and value[i] <= value[best] * (1.0 + _RIVAL)]
            leading += [(i, g) for i in [best, *rivals]]
    return leading


def _beside(task: Task, pool: Pool, heads: list[Head], explored: set[Place], *, free: bool) -> list[Row]:
    """The heads moved to the durations about theirs, each basin to each duration once.

    The grid has an unaccelerated plan at every duration. With a free end speed it may hide a better one close by.
    """
    allowed, rows = set(possible_durations(task).tolist()), []
    for i, g in heads:
        n, delta, change = int(pool.n[i]), float(pool.delta[i]), float(pool.change[i])
        steps = _STEPS if delta or change else _STEPS_UNACCELERATED[free]
        basin = (g, delta > change * n * task.scene.dt / 2.0, change > 0.0)
        explored.add((*basin, n))
        wanted = [n + step for step in steps if n + step in allowed and (*basin, n + step) not in explored]
        rows += [(m, i, g) for m in wanted]
        explored.update((*basin, m) for m in wanted)
    return rows


def _into_slots(task: Task, pool: Pool, goals: list[Goal], rows: list[Row]) -> tuple[Pool, list[Row]]:
    """Where contacts hide better plans: each row on the best candidate of a line over x_final at its duration.

    A slot between two vehicles is thin across x_final: a line finds it where a cloud falls on either side.
    """
    tight = [hides_better(pool, goal) for goal in goals]
    moved = [row for row in rows if tight[row[2]]]
    if not moved:
        return pool, rows
    n, index, _ = (np.array(column) for column in zip(*moved, strict=True))
    centre, frame = _window(task, pool, n, index, window=1.0)
    bend = centre[:, :1] + frame[:, 0, :1] * np.linspace(-1.0, 1.0, WIDTH)
    change = np.repeat(centre[:, 1:], WIDTH, axis=1)
    lines = task.simulate(n, bend + change * task.seconds(n)[:, None] / 2.0, change)
    found = refine_edges(task, pool.joined(lines), goals)
    return found, [_on_its_line(found, goals, row, len(pool)) if tight[row[2]] else row for row in rows]


def _on_its_line(pool: Pool, goals: list[Goal], row: Row, first: int) -> Row:
    """The row from the best feasible candidate of its line, if there is one; lines begin at ``first``."""
    n, i, g = row
    line = first + np.flatnonzero((pool.n[first:] == n) & (pool.change[first:] == pool.change[i]))
    value = pool.objective(goals[g])[line]
    return (n, int(line[np.argmin(value)]), g) if np.isfinite(value).any() else row


def _finalists(pool: Pool, goals: list[Goal]) -> list[Head]:
    """Each goal's best candidates of its best durations, as long as the last digits may decide between them."""
    heads: list[Head] = []
    for g in distinct(pool, goals):
        value = pool.objective(goals[g])
        near = np.flatnonzero(value <= (1.0 + _UNDECIDED) * value.min(initial=np.inf))
        near = near[np.argsort(value[near], kind="stable")]
        _, first = np.unique(pool.n[near], return_index=True)
        heads += [(int(i), g) for i in near[np.sort(first)][:_FINALISTS] if np.isfinite(value[i])]
    return heads


def _stepped(pool: Pool, goals: list[Goal], rows: list[Row], found: IntArray) -> list[Head]:
    """Each head's candidate, or the best one that its rows have led to where that is better."""
    value = [pool.objective(goal) for goal in goals]
    reached: dict[Head, int] = {}
    for (_, head, g), i in zip(rows, found.tolist(), strict=True):
        last = reached.setdefault((head, g), head)
        if i >= 0 and value[g][i] < value[g][last]:
            reached[head, g] = i
    return [(i, g) for (_, g), i in reached.items()]


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
    low, high = forward_interval(T, change, task.scene.v0, task.limit, task.scene.start.ax)
    # Dense about the smoothest motion, which is also a node: the jerk sum has a kink there.
    nodes = x_nodes(task)
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
        return np.full((len(T), 1, 1), task.change)
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
    if not len(n):
        return dict.fromkeys(CONSTRAINTS, 0)
    T = task.seconds(n)[:, None, None]
    span = (limit.v_min - scene.v0, limit.v_max - scene.v0)
    speeds = np.linspace(*span, _NOMINAL_NODES)
    changes = np.linspace(*span, _NOMINAL_NODES // 3) if free else np.zeros(1)
    shape = (len(n), len(speeds), len(changes))
    delta = np.broadcast_to(speeds[None, :, None] * T, shape).reshape(len(n), -1)
    change = np.broadcast_to(changes[None, None, :], shape).reshape(len(n), -1)
    codes = violations(task.seconds(n), plain(delta), plain(change), scene.v0, scene.D, limit)
    counts = np.bincount(codes.ravel(), minlength=len(CONSTRAINTS) + 1)
    return {name: int(counts[i + 1]) for i, name in enumerate(CONSTRAINTS)}
