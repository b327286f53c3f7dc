"""Choosing the start: time of an event with p = 3 (to be under 300 ms), and coarse-to-fine against every start.

CPU time of one core. The exhaustive search runs the planner's own search at every delay of every gap.
"""

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "algorithms"))
from random_scenes import random_scene

from highd_lc.algorithms.planner import goals, overlap_at_start, pose
from highd_lc.algorithms.search import search
from highd_lc.algorithms.start_planner import start_pools
from highd_lc.algorithms.start_search import search_starts
from highd_lc.algorithms.starts import CONTAINED, best_of, pose_starts
from highd_lc.vocab import names
from highd_lc.vocab.settings import ValidateSettings

EVENTS, CHECKED = 30, 6


def problems(waiting):
    """Events of random scenes whose pools without a choice of the start are searched already."""
    settings = ValidateSettings()
    planner = settings.planner.model_copy(update={"waiting": waiting})
    settings = settings.model_copy(update={"planner": planner})
    posed = [pose(random_scene(np.random.default_rng(seed)), settings) for seed in range(EVENTS)]
    return [problem for problem in posed if not overlap_at_start(problem) and len(problem.pools)]


def cpu(action, *arguments):
    """CPU seconds of an action, and its result."""
    begin = time.process_time()
    result = action(*arguments)
    return time.process_time() - begin, result


def fixed_form(problem):
    """The starts of the fixed form."""
    known = {CONTAINED: problem.pools[names.FIXED]}
    return search_starts(pose_starts(problem), goals(problem), known, free=False)


def both_forms(problem):
    """The starts of both forms."""
    return start_pools(pose_starts(problem), goals(problem))


def every_start(problem):
    """The candidates of every delay of every gap, fixed form."""
    posed, wanted = pose_starts(problem), goals(problem)
    keys = [(gap, int(d)) for gap in range(len(posed.gaps)) for d in posed.delays(gap)]
    return {key: search(posed.task(key), wanted) for key in keys}


def compare(problem):
    """How much faster than every start, and by how much the best of each goal is worse."""
    quick, mine = cpu(fixed_form, problem)
    slow, every = cpu(every_start, problem)
    pairs = [(best_of(mine, goal), best_of(every, goal)) for goal in goals(problem)]
    return slow / quick, [one.objective / other.objective - 1.0 for one, other in pairs if one and other]


def main():
    for waiting in ("constant", "lcm"):
        events = problems(waiting)
        both_forms(events[0])
        for label, action in (("fixed end speed", fixed_form), ("both forms", both_forms)):
            times = [1e3 * cpu(action, problem)[0] for problem in events]
            print(f"{waiting}: {label}: median {np.median(times):.0f} ms, worst {max(times):.0f} ms")
        ratios, excess = zip(*(compare(problem) for problem in events[:CHECKED]), strict=True)
        worse = np.concatenate(excess)
        print(
            f"{waiting}: {np.median(ratios):.0f} times faster than every start; worst excess {worse.max():.1e}, "
            f"{np.mean(worse > 1e-3):.1%} of {len(worse)} cases above 0.1 %"
        )


if __name__ == "__main__":
    main()
