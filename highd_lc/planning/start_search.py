"""Global search over plans with the moment of the start and the gap as further unknowns.

Fifty delays times three gaps times the planner's search would take a second and more. The best objective as a
function of the delay is smooth but for contacts, so: every fifth delay of every gap on a thin grid; from the most
promising ones of each goal, or from all where none holds a feasible plan, the planner's own refinement; then from
delay to delay as long as a goal gains. The planner's pool of the recorded gap without delay is among the starts:
no policy loses to the one that it contains.

All goals go through these steps together: what a start is looked at for is one call of the kernels.
"""

from collections.abc import Hashable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from highd_lc.planning.pool import Goal, Pool, Task, distinct
from highd_lc.planning.search import Row, grid, possible_durations, refine, zoom_rows
from highd_lc.planning.starts import CONTAINED, Best, Key, StartProblem, best_at
from highd_lc.planning.zoom import hides_better

IntArray = NDArray[np.int64]

_DELAY_STEP: Final = 5
_THIN: Final = {False: {"x_nodes": 15}, True: {"x_nodes": 9, "v_nodes": 7}}
"""The thin grid of the fixed and of the free form."""
_DURATION_STEP_FIXED: Final = 4
_DURATION_STEP_FREE: Final = 8
_ROUGH: Final = {"zoom_levels_free": 3}
_FINE: Final = 0.3
"""Window of a zoom that goes on from a rough one, over a step of the grid."""
_UNDECIDED: Final = 0.003
"""Relative error of a rough zoom."""
_LEADING: Final = 3
_PROMISING: Final = 1.25
"""How far above the best value on the thin grid a start may lie to be refined; the grid errs by less."""

_Asked = TypeVar("_Asked", bound=Hashable)


def search_starts(
    posed: StartProblem, goals: list[Goal], known: Mapping[Key, Pool], *, free: bool
) -> dict[Key, Pool]:
    """The candidates of every start that was looked at.

    known: the planner's pool as that of the contained start; for a free end speed all pools of the fixed form.
    """
    found = _Found(posed, dict(known), free)
    coarse = [(gap, d) for gap in range(len(posed.gaps)) for d in _coarse(posed.delays(gap))]
    for key in _worth_a_grid(found, goals, coarse):
        found.lay_grid(key)
    found.refined = {(CONTAINED, goal) for goal in goals}
    leading = [(key, goal) for goal in goals for key in _leading(found, goal) or coarse]
    found.refine(leading + [(key, goal) for key in _after_a_jump(posed) for goal in goals])
    _descend(found, goals)
    return found.pools


@dataclass
class _Found:
    """A search under way: the pool of each start, and what each start was refined for.

    The best of a start is remembered until its pool changes: every step asks for it, of every goal.
    """

    posed: StartProblem
    pools: dict[Key, Pool]
    free: bool
    gridded: set[Key] = field(default_factory=lambda: {CONTAINED})
    whole: set[Key] = field(default_factory=lambda: {CONTAINED})
    refined: set[tuple[Key, Goal]] = field(default_factory=set)
    known: dict[tuple[Key, Goal], tuple[Pool, Best | None]] = field(default_factory=dict)

    def add(self, key: Key, pool: Pool) -> None:
        """More candidates of a start."""
        self.pools[key] = self.pools[key].joined(pool) if key in self.pools else pool

    def lay_grid(self, key: Key) -> None:
        """Plans of a start on the thin grid, once."""
        if key not in self.gridded:
            self.gridded.add(key)
            self.add(key, _thin_grid(self.posed.task(key), self.free))

    def lay_whole_grid(self, key: Key) -> None:
        """Plans of a start on the planner's own grid, once; of the fixed form alone, where it costs little."""
        if not self.free and key not in self.whole:
            self.whole.add(key)
            task = self.posed.task(key)
            self.add(key, grid(task, possible_durations(task), free=False))

    def at(self, key: Key, goal: Goal) -> Best | None:
        """The best candidate of a start."""
        pool, best = self.known.get((key, goal), (None, None))
        if pool is not self.pools[key]:
            best = best_at(key, self.pools[key], goal)
            self.known[key, goal] = self.pools[key], best
        return best

    def everywhere(self, goal: Goal) -> list[Best]:
        """The best of each start that has a feasible candidate, best first, the earliest of equals."""
        found = [best for key in self.pools if (best := self.at(key, goal)) is not None]
        return sorted(found, key=lambda best: (best.objective, best.key))

    def refine(self, wanted: list[tuple[Key, Goal]]) -> None:
        """Bring starts to the planner's precision, each for each goal once."""
        new = [one for one in wanted if one not in self.refined]
        self.refined.update(new)
        for key, goals in _grouped(new).items():
            self.lay_grid(key)
            self.lay_whole_grid(key)
            self.pools[key] = refine(self.posed.task(key), self.pools[key], goals, free=self.free)


def _grouped(pairs: Iterable[tuple[Key, _Asked]]) -> dict[Key, list[_Asked]]:
    """What is asked of each start, in order, once."""
    groups: dict[Key, dict[_Asked, None]] = {}
    for key, asked in pairs:
        groups.setdefault(key, {})[asked] = None
    return {key: list(group) for key, group in groups.items()}


def _coarse(delays: IntArray) -> list[int]:
    """Every fifth delay, and the first and the last of each stretch."""
    if not len(delays):
        return []
    edge = np.flatnonzero(np.diff(delays) > 1)
    ends = {int(delays[0]), int(delays[-1]), *delays[edge].tolist(), *delays[edge + 1].tolist()}
    return sorted(ends | set(delays[delays % _DELAY_STEP == 0].tolist()))


def _after_a_jump(posed: StartProblem) -> list[Key]:
    """By LCM the AV's speed may change a lot in the first step, and with it the best shape."""
    jumps = posed.problem.settings.planner.waiting == "lcm" and 1 in posed.delays(CONTAINED[0])
    return [(CONTAINED[0], 1)] if jumps else []


def _worth_a_grid(found: _Found, goals: list[Goal], keys: list[Key]) -> list[Key]:
    """The starts that are not searched yet, without those which the fixed form shows to be hopeless for all goals.

    A start at which every plan of the fixed form touches somebody counts as hopeless, too, unless all starts do:
    measured against the search at every start, nothing is lost by that (docs/start.md).
    """
    limit = [_PROMISING * best[0].objective if (best := found.everywhere(goal)) else np.inf for goal in goals]

    def hopeless(pool: Pool) -> bool:
        return all((pool.objective(g) > most).all() for g, most in zip(goals, limit, strict=True))

    return [key for key in keys if key != CONTAINED and not (key in found.pools and hopeless(found.pools[key]))]


def _thin_grid(task: Task, free: bool) -> Pool:
    thin = replace(task, settings=task.settings.model_copy(update=_THIN[free]))
    step = _DURATION_STEP_FREE if free else _DURATION_STEP_FIXED
    return grid(thin, possible_durations(thin)[::step], free=free)


def _leading(found: _Found, goal: Goal) -> list[Key]:
    """The most promising starts of a goal, no two of them neighbours on the coarse grid."""
    chosen: list[Key] = []
    ranked = found.everywhere(goal)
    for best in ranked:
        near = any(best.key[0] == gap and abs(best.key[1] - d) <= _DELAY_STEP for gap, d in chosen)
        if best.objective > _PROMISING * ranked[0].objective or len(chosen) == _LEADING:
            break
        if not near:
            chosen.append(best.key)
    return chosen


def _descend(found: _Found, goals: list[Goal]) -> None:
    """Look at the delays next to each goal's best start, and move there as long as the goal gains."""
    seen: set[tuple[Key, Goal]] = set()
    while here := [start for start in _best_starts(found, goals) if start not in seen]:
        seen.update(here)
        found.refine(here)
        leading = _different(found, [(goal, found.everywhere(goal)[0]) for _, goal in here])
        beside = [(key, (goal, best)) for goal, best in leading for key in _beside(found.posed, best.key)]
        for key, asked in _grouped(beside).items():
            _look(found, key, asked)


def _different(found: _Found, leading: list[tuple[Goal, Best]]) -> list[tuple[Goal, Best]]:
    """The goals and their best starts, without goals that one before them speaks for.

    It has the same best start and makes the same of every candidate there, as benchmarks of two accountings do.
    """
    goals_at = _grouped((best.key, goal) for goal, best in leading)
    apart = {(key, goals[g]) for key, goals in goals_at.items() for g in distinct(found.pools[key], goals)}
    return [(goal, best) for goal, best in leading if (best.key, goal) in apart]


def _best_starts(found: _Found, goals: list[Goal]) -> list[tuple[Key, Goal]]:
    return [(best[0].key, goal) for goal in goals if (best := found.everywhere(goal))]


def _beside(posed: StartProblem, key: Key) -> list[Key]:
    """The starts next to one: the same gap, up to four samples earlier or later."""
    allowed = set(posed.delays(key[0]).tolist())
    steps = (step for step in range(1 - _DELAY_STEP, _DELAY_STEP) if step)
    return [(key[0], key[1] + step) for step in steps if key[1] + step in allowed]


def _look(found: _Found, key: Key, asked: list[tuple[Goal, Best]]) -> None:
    """Try plans at another delay, roughly first; those that may gain get their last digits.

    The best plans' shapes are moved there. Where contacts stand in their way other shapes may be better a moment
    later: then those of a thin grid are tried as well.
    """
    task, goals = found.posed.task(key), [goal for goal, _ in asked]
    seeds = [found.pools[best.key].chosen(np.array([best.index])) for _, best in asked]
    rows = [
        (n, g, g)
        for g, (seed, (_, best)) in enumerate(zip(seeds, asked, strict=True))
        for n in _durations(task, int(seed.n[0]), best.key[1] - key[1])
    ]
    if any(hides_better(found.pools[best.key], goal) for goal, best in asked):
        found.lay_grid(key)
        for g, goal in enumerate(goals):
            if (own := found.at(key, goal)) is not None:
                rows.append((int(found.pools[key].n[own.index]), len(seeds), g))
                seeds.append(found.pools[key].chosen(np.array([own.index])))
    if not rows:
        return
    rough = replace(task, settings=task.settings.model_copy(update=_ROUGH)) if found.free else task
    known = seeds[0].joined(*seeds[1:])
    pool, reached = zoom_rows(rough, known, goals, rows, free=found.free)
    if found.free:
        rows = _worthwhile(pool, goals, rows, reached, [best.objective for _, best in asked])
        pool, _ = zoom_rows(task, pool, goals, rows, free=True, window=_FINE)
    found.add(key, pool.chosen(np.arange(len(known), len(pool))))


def _durations(task: Task, n: int, earlier: int) -> list[int]:
    """About the same duration, the same end, and durations that change faster than the delay, as where a vehicle
    has to pass first. earlier: by how many samples the manoeuvre starts earlier.
    """
    wanted = {n - 1, n, n + 1} | {n + k * earlier for k in (1, 2, 3, 4)}
    return sorted(wanted & set(possible_durations(task).tolist()))


def _worthwhile(pool: Pool, goals: list[Goal], rows: list[Row], reached: IntArray, best: list[float]) -> list[Row]:
    """The rows from where they have got to, as far as the last digits may decide."""
    values = [pool.objective(goal) for goal in goals]
    return [
        (n, int(i), g)
        for (n, _, g), i in zip(rows, reached, strict=True)
        if i >= 0 and values[g][i] <= (1.0 + _UNDECIDED) * best[g]
    ]
