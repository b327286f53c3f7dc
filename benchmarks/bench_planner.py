"""The global search: time an event, and the same search with its candidates simulated by numpy, as a ratio.

    python benchmarks/bench_planner.py [EVENTS]

Random lane changes; every search serves both weights of the AV under all three accountings. CPU time of one core.
The numpy twin (tests/made/planner_twin.py) is vectorised over the candidates and finds the same plans.
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path
from unittest import mock

import numpy as np

from highd_lc.planning import pool as pool_module
from highd_lc.planning.pool import Pool, Task
from highd_lc.planning.search import search

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "made"))
import planner_twin
from random_scenes import GOALS, random_scene, task_of

EVENTS, TWINS = 40, 3


def fixed(task: Task) -> Pool:
    """The search of the fixed form."""
    return search(task, GOALS)


def free(task: Task) -> Pool:
    """What the free form adds to a fixed one that is known."""
    return search(task, GOALS, known=_KNOWN[id(task)])


_KNOWN: dict[int, Pool] = {}


def mean_ms(work: Callable[[Task], Pool], tasks: list[Task]) -> float:
    """CPU time of an event [ms], mean."""
    started = time.process_time()
    for task in tasks:
        work(task)
    return 1e3 * (time.process_time() - started) / len(tasks)


def main() -> None:
    """Time every form, then the first events once more with numpy."""
    events = int(sys.argv[1]) if len(sys.argv) > 1 else EVENTS
    tasks = {p: [task_of(random_scene(np.random.default_rng(s), p)) for s in range(events)] for p in (3, 10)}
    _KNOWN.update({id(task): fixed(task) for some in tasks.values() for task in some})
    free(tasks[3][0])
    cases = [
        ("fixed form, p = 3", fixed, 3, 10),
        ("fixed form, p = 10", fixed, 10, 30),
        ("free form, p = 3", free, 3, 60),
    ]
    for name, work, p, wanted in cases:
        ours = mean_ms(work, tasks[p])
        some = tasks[p][:TWINS]
        same = mean_ms(work, some)
        with mock.patch.object(pool_module, "evaluate", planner_twin.evaluate):
            twin = mean_ms(work, some)
        print(f"{name:<20}{ours:7.1f} ms an event (asked: {wanted}); with numpy {twin / same:5.0f} x the time")


if __name__ == "__main__":
    main()
