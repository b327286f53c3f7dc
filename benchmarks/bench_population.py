"""Time of cross-fitting the population on HighD's size of followers: 60 recordings, 16,000 responses.

python benchmarks/bench_population.py
"""

import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "made"))

from made_responses import made

from highd_lc.drivers import population
from highd_lc.drivers.population import PRIOR
from highd_lc.drivers.prediction import CrossFit


def responses(count: int) -> population.Responses:
    """Followers as the prior has them, with noise, so that the fit has something to do."""
    bare = made(count, seed=3, recordings=60)
    found = population.respond(PRIOR, bare)
    noise = np.random.default_rng(4).normal(scale=0.3, size=found.v.shape)
    return replace(bare, x=found.x, v=found.v + noise)


def main() -> None:
    """Print wall and CPU time of the population that plans, and with the two that lack a part."""
    for count in (1_000, 16_000):
        fits = CrossFit(responses(count))
        for without in ((), ("memory",), ("relaxation",)):
            wall, cpu = time.perf_counter(), time.process_time()
            folds = len(fits.populations(without))
            wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
            name = "population" + "".join(f"-{part}" for part in without)
            print(f"{count:6d} responses, {name:24s} {folds} folds: {wall:5.1f} s, {cpu:5.1f} s of CPU")


if __name__ == "__main__":
    main()
