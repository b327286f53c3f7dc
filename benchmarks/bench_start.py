"""Choosing the start: time of an event with p = 3 (to be under 300 ms), and coarse-to-fine against every start.

CPU time of one core. The exhaustive search runs the planner's own search at every delay of every gap.
"""

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "made"))
from random_scenes import random_scene

from highd_lc.planning.planner import goals, overlap_at_start, pose
from highd_lc.planning.search import search
from highd_lc.planning.start_planner import start_pools
from highd_lc.planning.start_search import search_starts
from highd_lc.planning.starts import CONTAINED, best_of, pose_starts
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
    """The best of each goal over every delay of every gap, of the fixed and of the free form."""
    posed, wanted = pose_starts(problem), goals(problem)
    best = {names.START: {}, names.FREE_START: {}}
    for key in [(gap, int(d)) for gap in range(len(posed.gaps)) for d in posed.delays(gap)]:
        fixed = search(posed.task(key), wanted)
        for form, pool in ((names.START, fixed), (names.FREE_START, search(posed.task(key), wanted, known=fixed))):
            for goal in wanted:
                found = best_of({key: pool}, goal)
                if found:
                    best[form][goal] = min(best[form].get(goal, np.inf), found.objective)
    return best


def compare(problem):
    """How much faster than every start, and by how much the best of each form and goal is worse."""
    quick, mine = cpu(both_forms, problem)
    slow, every = cpu(every_start, problem)
    pairs = [
        (best_of(mine[form], goal), value) for form, of_goal in every.items() for goal, value in of_goal.items()
    ]
    return slow / quick, [one.objective / value - 1.0 if one else np.inf for one, value in pairs]


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
