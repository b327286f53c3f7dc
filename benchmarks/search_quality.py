"""The global search against a very fine grid: quality and time of settings of the search, side by side.

    python benchmarks/search_quality.py [--events 100] [--forms fixed free] [--profiles paper practice]
                                        [--reacting] [--variants x_nodes=32 "v_nodes=12 zoom_starts=4"]

Random lane changes, each event in easy and in tight traffic, both weights of the AV under all three accountings
(docs/planner.md). A variant names settings of the planner that differ from the defaults; the defaults come first.
Each case counts by how much its objective lies above the grid's. CPU time of the search over that of the defaults,
event by event in turn.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

from highd_lc.planning.pool import Pool, Task
from highd_lc.planning.search import search
from highd_lc.vocab.safety import PROFILES, SafetySettings
from highd_lc.vocab.settings import PlannerSettings, ValidateSettings

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "made"))
from fine_grid import fine_grid
from random_scenes import GOALS, random_scene, reacting, task_of

CROWDING = (1.0, 2.5)
NODES = {"fixed": {"nodes": 801}, "free": {"nodes": 121, "changes": 41}}
LEVELS = (0.001, 0.0001)


def main() -> None:
    """A table of each form and safety profile, one row a variant."""
    asked = _arguments()
    variants = [{}, *(dict(part.split("=") for part in one.split()) for one in asked.variants)]
    for profile in asked.profiles:
        for form in asked.forms:
            table = _compared(form, profile, variants, events=asked.events, reacts=asked.reacting)
            print(
                f"{form} form, profile {profile}{', followers that react' * asked.reacting}:\n{table}", flush=True
            )


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--events", type=int, default=100, help="seeds; each in easy and in tight traffic")
    parser.add_argument("--forms", nargs="+", choices=NODES, default=list(NODES))
    parser.add_argument("--profiles", nargs="+", choices=PROFILES, default=list(PROFILES))
    parser.add_argument("--reacting", action="store_true", help="followers that react in every way")
    parser.add_argument("--variants", nargs="*", default=[], help='for example "x_nodes=32 v_nodes=12"')
    return parser.parse_args()


def _compared(form: str, profile: str, variants: list[dict[str, str]], *, events: int, reacts: bool) -> str:
    excess: list[list[float]] = [[] for _ in variants]
    seconds = np.zeros((len(variants), 2 * events))
    for event, (seed, crowding) in enumerate((s, c) for s in range(events) for c in CROWDING):
        tasks = [_task(seed, crowding, profile, variant, reacts) for variant in variants]
        fine = np.array(fine_grid(tasks[0], GOALS, **NODES[form]))
        for v, task in enumerate(tasks):
            found, seconds[v, event] = _lowest(task, form)
            # A goal that neither finds feasible says nothing; what only one of them finds is infinitely better.
            known = np.isfinite(fine) | np.isfinite(found)
            with np.errstate(invalid="ignore"):
                excess[v] += (found / fine - 1.0)[known].tolist()
    rows = [_row(v, np.array(e), s / seconds[0]) for v, e, s in zip(variants, excess, seconds, strict=True)]
    above = " | ".join(f"> {level:.2%} worse" for level in LEVELS)
    return "\n".join(
        [f"| settings | cases | {above} | worst | grid worse by up to | time |", "|---" * 7 + "|", *rows]
    )


def _task(seed: int, crowding: float, profile: str, variant: dict[str, str], reacts: bool) -> Task:
    settings = ValidateSettings(
        safety=SafetySettings(profile=profile), planner=PlannerSettings.model_validate(variant)
    )
    rng = np.random.default_rng(seed)
    scene = random_scene(rng, crowding=crowding)
    return task_of(reacting(scene, rng, moment=0.5) if reacts else scene, settings)


def _lowest(task: Task, form: str) -> tuple[np.ndarray, float]:
    """Each goal's lowest objective, and the CPU seconds of the form's own search, the better of two."""
    known = search(task, GOALS) if form == "free" else None
    spent = []
    for _ in range(2):
        started = time.process_time()
        pool: Pool = search(task, GOALS, known=known)
        spent.append(time.process_time() - started)
    return np.array([pool.objective(goal).min(initial=np.inf) for goal in GOALS]), min(spent)


def _row(variant: dict[str, str], excess: np.ndarray, ratio: np.ndarray) -> str:
    name = " ".join(f"{key} {value}" for key, value in variant.items()) or "defaults"
    shares = " | ".join(f"{int((excess > level).sum())}" for level in LEVELS)
    worst, best = float(excess.max()), max(float(-excess.min()), 0.0)
    return f"| {name} | {len(excess)} | {shares} | {worst:.4%} | {best:.2%} | x {np.median(ratio):.2f} |"


if __name__ == "__main__":
    main()
