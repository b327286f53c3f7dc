"""The global search: time an event, and the same search with its candidates simulated by numpy, as a ratio.

Then the candidates alone: followers that react against bare ones, turn by turn.

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
from highd_lc.planning.candidates import evaluate
from highd_lc.planning.pool import Pool, Task
from highd_lc.planning.search import search

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "made"))
import planner_twin
from random_scenes import GOALS, REACTIONS, random_scene, reacting, task_of

EVENTS, TWINS = 40, 3
SCENES, ROUNDS, CANDIDATES, ASKED = 8, 40, 96, 1.15
DURATIONS = np.arange(30, 101, 5)
PARTS = ("memory", "need", "a_0", "drift")


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


def candidate_us(task: Task) -> float:
    """CPU time of a candidate [us]: plans that keep a positive speed, of every half second's duration."""
    rng, T = np.random.default_rng(0), DURATIONS[:, None] * 0.1
    change = rng.uniform(-3.0, 3.0, (len(DURATIONS), CANDIDATES))
    delta = change * T / 2.0 + rng.uniform(-0.25, 0.25, change.shape) * T**2
    started = time.process_time()
    evaluate(DURATIONS, delta, change, task.scene, task.terms)
    return 1e6 * (time.process_time() - started) / change.size


def compare_reactions() -> None:
    """The same scenes with bare followers and with followers that react, turn by turn; medians over the turns."""
    scenes = [random_scene(np.random.default_rng(s), 3) for s in range(SCENES)]
    cases = {"bare": [task_of(scene) for scene in scenes]}
    for name, parts in (("memory, need, drift", PARTS), ("relaxation as well", tuple(REACTIONS))):
        generators = [np.random.default_rng(s) for s in range(SCENES)]
        made = [reacting(one, rng, moment=0.5, parts=parts) for one, rng in zip(scenes, generators, strict=True)]
        cases[name] = [task_of(scene) for scene in made]
    turns = np.array([[sum(map(candidate_us, tasks)) / SCENES for tasks in cases.values()] for _ in range(ROUNDS)])
    for place, name in enumerate(cases):
        ratio = np.median(turns[:, place] / turns[:, 0])
        print(
            f"a candidate, p = 3, {name:<22}{np.median(turns[:, place]):5.2f} us, {ratio:.2f} x (asked: {ASKED})"
        )


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
    compare_reactions()


if __name__ == "__main__":
    main()
