"""The robust search of an event beside the plain one, turn by turn in one run.

    python benchmarks/bench_robust.py [EVENTS]

Random lane changes among three followers that react in every way. Plain: both weights of the AV under all three
accountings, fixed and free form. Robust: the joint goals, for eight drivers that the followers may be. CPU time.
"""

import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from highd_lc.drivers.population import SPREAD
from highd_lc.planning.crowd import Crowd, drawn_crowd
from highd_lc.planning.pool import Goal, Pool, Task
from highd_lc.planning.search import search

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "made"))
from random_scenes import GOALS, random_scene, reacting, task_of

EVENTS, DRAWS, ASKED = 10, 8, 4.0
JOINT = [goal for goal in GOALS if goal.omega_av < 1.0]


def crowd_of(task: Task) -> Crowd:
    """Eight drivers within the population's spread."""
    spread = np.tile(SPREAD, (len(task.scene.follower_x), 1))
    return drawn_crowd(task.scene, spread, DRAWS, np.random.default_rng(1))


def timed(task: Task, goals: list[Goal]) -> tuple[float, float]:
    """CPU time [ms] of the fixed form, and of what the free one adds."""
    started = time.process_time()
    fixed: Pool = search(task, goals)
    between = time.process_time()
    search(task, goals, known=fixed)
    return 1e3 * (between - started), 1e3 * (time.process_time() - between)


def main() -> None:
    """Medians of the ratios over the events."""
    events = int(sys.argv[1]) if len(sys.argv) > 1 else EVENTS
    generators = [np.random.default_rng(seed) for seed in range(events)]
    tasks = [task_of(reacting(random_scene(rng, 3), rng, moment=0.5)) for rng in generators]
    robust = [replace(task, crowd=crowd_of(task)) for task in tasks]
    timed(tasks[0], GOALS)
    timed(robust[0], JOINT)
    turns = np.array([(timed(a, GOALS), timed(b, JOINT)) for a, b in zip(tasks, robust, strict=True)])
    plain, crowded = turns.mean(axis=0)
    print(f"plain search: {plain[0]:.1f} ms fixed, {plain[1]:.1f} ms more for free")
    print(f"robust search, K = {DRAWS}: {crowded[0]:.1f} ms fixed, {crowded[1]:.1f} ms more for free")
    ratio = turns[:, 1].sum(axis=1) / turns[:, 0].sum(axis=1)
    print(f"both forms: {np.median(ratio):.2f} x (asked: below {ASKED:g})")
    print(f"fixed form alone: {np.median(turns[:, 1, 0] / turns[:, 0, 0]):.2f} x")


if __name__ == "__main__":
    main()
