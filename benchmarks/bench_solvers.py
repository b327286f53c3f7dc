"""The global search against SLSQP, the method that the paper names: quality and time, as ratios within one run.

    python benchmarks/bench_solvers.py [EVENTS]

Random lane changes among three followers, accounting equal. SLSQP's first start is constant speed over 5.5 s, the
others are random; T is continuous in a descent and rounded both ways at its end.
"""

import sys
import time
from pathlib import Path

import numpy as np

from highd_lc.planning.pool import Goal, Task
from highd_lc.planning.search import search
from highd_lc.planning.sqp import multi_start
from highd_lc.vocab import names

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "made"))
from random_scenes import random_scene, task_of

EVENTS = 100
STARTS = (1, 3, 5, 10)
GOALS = [Goal(names.EQUAL, omega) for omega in (1.0, 0.5)]


def global_optima(task: Task, free: bool) -> tuple[list[float], float]:
    """Joint objectives of both goals, infinite if infeasible, and the seconds spent."""
    started = time.process_time()
    pool = search(task, GOALS)
    pool = search(task, GOALS, known=pool) if free else pool
    seconds = time.process_time() - started
    best = [pool.best(goal) if len(pool) else None for goal in GOALS]
    return [
        np.inf if i is None else float(pool.objective(g)[i]) for g, i in zip(GOALS, best, strict=True)
    ], seconds


def descents(task: Task, free: bool) -> tuple[list[list[float]], float]:
    """Objectives by goal and start, and the seconds spent."""
    started = time.process_time()
    found = [
        [d.objective for d in multi_start(task, goal, free=free, count=max(STARTS), rng=np.random.default_rng(1))]
        for goal in GOALS
    ]
    return found, time.process_time() - started


def share(excess: np.ndarray, level: float) -> str:
    return f"{100.0 * np.mean(excess > level):5.1f} %"


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else EVENTS
    tasks = [task_of(random_scene(np.random.default_rng(seed))) for seed in range(count)]
    global_optima(tasks[0], True)
    descents(tasks[0], True)
    for free in (False, True):
        best, spent, ours = [], 0.0, 0.0
        every = []
        for task in tasks:
            optimum, seconds = global_optima(task, free)
            ours += seconds
            found, seconds = descents(task, free)
            spent += seconds
            for goal in range(len(GOALS)):
                # An event that both find infeasible says nothing.
                if np.isfinite(min([optimum[goal], *found[goal]])):
                    best.append(optimum[goal])
                    every.append(found[goal])
        print(f"{'free' if free else 'fixed'} end speed, {len(best)} cases of {count} events:")
        for starts in STARTS:
            excess = np.min(np.array(every)[:, :starts], axis=1) / np.array(best) - 1.0
            ratio = spent * starts / max(STARTS) / ours
            print(
                f"  SLSQP, {starts:2d} starts: infeasible {100 * np.mean(np.isinf(excess)):4.1f} %,"
                f" > 1 % worse {share(excess, 0.01)}, > 0.1 % worse {share(excess, 0.001)},"
                f" > 0.1 % better {share(-excess, 0.001)}, best {100 * excess.min():+.3f} %,"
                f" {ratio:5.1f} x the time of the global search"
            )


if __name__ == "__main__":
    main()
