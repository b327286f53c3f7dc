"""How often intervals over clusters hold the truth that they say they hold, by simulation.

    python benchmarks/coverage_study.py [RUNS]

A run has 3, 5, 8, 16 or 60 recordings of unequal size. Half of the events save nothing; the savings of the others
are lognormal, so that the 5 % of events with the largest ones carry 46 % of all. Recordings differ in what their
events save. The quantity is the ratio of the sums of savings and losses, as every gain is; nominal coverage 95 %.
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.scoring.population import Bootstrap, ratio_interval, share_carried

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

RUNS: Final = 2000
CLUSTERS: Final = (3, 5, 8, 16, 60)
METHODS: Final = ("percentile", "t", "bootstrap_t")
UNLIKE: Final = {"alike": 0.2, "unlike": 0.5}
"""Standard deviation of the logarithm of what a recording's events save."""
_EVENTS, _SIZES, _LOSS, _SAVED, _SAVES = 60.0, 0.6, 0.6, 1.18, 0.5


@dataclass(frozen=True)
class Drawn:
    """A run's events: recording, savings and losses, shape (events,)."""

    recordings: IntArray
    savings: FloatArray
    losses: FloatArray


def drawn(rng: np.random.Generator, clusters: int, unlike: float) -> Drawn:
    """A run of so many recordings."""
    sizes = np.maximum(3, np.rint(_EVENTS * _lognormal(rng, _SIZES, clusters))).astype(np.int64)
    recordings = np.repeat(np.arange(clusters), sizes)
    n = len(recordings)
    each = np.where(rng.random(n) < _SAVES, _lognormal(rng, _SAVED, n), 0.0)
    return Drawn(
        recordings, each * _lognormal(rng, unlike, clusters)[recordings], 30.0 * _lognormal(rng, _LOSS, n)
    )


def _lognormal(rng: np.random.Generator, sigma: float, n: int) -> FloatArray:
    """Draws of mean 1."""
    return np.asarray(rng.lognormal(-0.5 * sigma**2, sigma, n))


TRUTH: Final = _SAVES / 30.0


def cells(runs: int) -> Iterator[str]:
    """A line of the table for each kind of recordings, number of them and method."""
    for kind, unlike in UNLIKE.items():
        for clusters in CLUSTERS:
            rng = np.random.default_rng([7, clusters, round(10 * unlike)])
            made = [drawn(rng, clusters, unlike) for _ in range(runs)]
            for method in METHODS:
                yield f"| {kind} | {clusters} | {method} | {' | '.join(_covered(made, method))} |"


def _covered(made: list[Drawn], method: str) -> Iterator[str]:
    """Coverage, how often the truth lies below and above, the median width over the truth, those without."""
    ends = np.array([_ends(run, method) for run in made])
    given = ~np.isnan(ends[:, 0])
    if not given.any():
        yield from ("none", "", "", "", "100.0")
        return
    low, high = ends[given].T
    for share in (np.mean((low <= TRUTH) & (high >= TRUTH)), np.mean(low > TRUTH), np.mean(high < TRUTH)):
        yield f"{100.0 * share:.1f}"
    yield f"{np.median(high - low) / TRUTH:.2f}"
    yield f"{100.0 * np.mean(~given):.1f}"


def _ends(run: Drawn, method: str) -> tuple[float, float]:
    found = ratio_interval(run.recordings, run.savings, run.losses, Bootstrap(2000, 0.95, 1, method))
    return found.low, found.high


def main() -> None:
    """The table, and what the events are like."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else RUNS
    large = drawn(np.random.default_rng(0), 2000, 0.2)
    print(f"the largest 5 % carry {100.0 * share_carried(large.savings):.0f} %; {runs} runs a line")
    print("| recordings | clusters | method | covers [%] | truth below [%] | above [%] | width | none [%] |")
    print("|---|---|---|---|---|---|---|---|")
    for line in cells(runs):
        print(line, flush=True)


if __name__ == "__main__":
    main()
