"""What the safety profile costs the search: an event under ``practice`` against ``paper``, turn by turn.

    python benchmarks/bench_safety.py [EVENTS [ROUNDS]]

Random lane changes with three followers in easy traffic that have a plan under both profiles; every search serves
both weights of the AV under all three accountings. CPU time of one core, medians over the rounds; then a candidate
alone. The drive after T is bounded under ``practice`` alone, the step at T is charged under both.
"""

import sys
import time
from pathlib import Path

import numpy as np

from highd_lc.planning.candidates import evaluate
from highd_lc.planning.pool import Task
from highd_lc.planning.search import search
from highd_lc.vocab.safety import PAPER, PRACTICE
from highd_lc.vocab.settings import ValidateSettings

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "made"))
from random_scenes import GOALS, random_scene, task_of

EVENTS, ROUNDS, ASKED = 12, 7, 1.3
EASY = 0.4
"""Divides the crowding of the scenes: with less room most have no plan under ``practice``."""
DURATIONS = np.arange(30, 101, 5)
PROFILES = {name: ValidateSettings.model_validate({"safety": {"profile": name}}) for name in (PAPER, PRACTICE)}


def search_ms(task: Task) -> tuple[float, float]:
    """CPU time of both forms' searches [ms]: the fixed one, and what the free one adds."""
    started = time.process_time()
    fixed = search(task, GOALS)
    between = time.process_time()
    search(task, GOALS, known=fixed)
    return 1e3 * (between - started), 1e3 * (time.process_time() - between)


def candidate_us(task: Task) -> float:
    """CPU time of a candidate [us]."""
    rng, T = np.random.default_rng(0), DURATIONS[:, None] * 0.1
    change = rng.uniform(-3.0, 3.0, (len(DURATIONS), 96))
    delta = change * T / 2.0 + rng.uniform(-0.25, 0.25, change.shape) * T**2
    started = time.process_time()
    evaluate(DURATIONS, delta, change, task.scene, task.terms)
    return 1e6 * (time.process_time() - started) / change.size


def feasible_pairs(events: int) -> list[dict[str, Task]]:
    """Events with a plan under both profiles, as tasks of each."""
    found: list[dict[str, Task]] = []
    for seed in range(50 * events):
        scene = random_scene(np.random.default_rng(seed), 3, crowding=EASY)
        tasks = {name: task_of(scene, settings) for name, settings in PROFILES.items()}
        pools = [search(task, GOALS) for task in tasks.values()]
        if all(pool.best(goal) is not None for pool in pools for goal in GOALS):
            found.append(tasks)
        if len(found) == events:
            break
    return found


def main() -> None:
    """Time both profiles turn by turn."""
    events, rounds = (int(value) for value in (*sys.argv[1:], *(str(EVENTS), str(ROUNDS))[len(sys.argv) - 1 :]))
    pairs = feasible_pairs(events)
    search_ms(pairs[0][PRACTICE])
    times = np.array(
        [[[search_ms(tasks[name]) for name in PROFILES] for tasks in pairs] for _ in range(rounds)]
    )  # rounds, events, profiles, forms
    for place, form in enumerate(("fixed form", "free form adds")):
        per_round = times[..., place].mean(axis=1)
        paper, practice = np.median(per_round, axis=0)
        ratio = float(np.median(per_round[:, 1] / per_round[:, 0]))
        print(f"{form:<15} p = 3: {paper:6.1f} ms under paper, {practice:6.1f} under practice: {ratio:.2f} x")
    both = np.median(times.sum(axis=-1).mean(axis=1), axis=0)
    print(f"an event, both forms: {both[1] / both[0]:.2f} x (asked: {ASKED})")
    each = np.median([[candidate_us(tasks[n]) for n in PROFILES] for tasks in pairs for _ in range(20)], axis=0)
    print(f"a candidate: {each[0]:.2f} us under paper, {each[1]:.2f} us under practice: {each[1] / each[0]:.2f} x")


if __name__ == "__main__":
    main()
