"""Decisions of the closed loop: how long one takes, by policy; those that find no permitted plan apart.

    python benchmarks/bench_replan.py [EVENTS]

Random lane changes among three followers that react in every way, leaders at constant speed in the AV's eyes,
the bicycle under the MPC. CPU time of everything that a decision does; first plans, which search as the open loop
does, are apart. On a quiet core CPU time is the time that passes.
"""

import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from highd_lc.driving import loop
from highd_lc.vocab import names
from highd_lc.vocab.policy import REPLANNED

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "made"))
from made_drives import case_of, drive, scene_of

EVENTS, ASKED = 40, 20.0


def times(policy: str, events: int) -> dict[str, np.ndarray[Any, Any]]:
    """CPU times [ms] of decisions by kind: first, usual, and those without a permitted plan."""
    found: dict[str, list[float]] = {"first": [], "usual": [], "without a permitted plan": []}
    for seed in range(events):
        for decision in drive(case_of(scene_of(seed), policy, tracker="mpc")).replans:
            kind = "without a permitted plan"
            if decision.verdict in (names.REPLANNED, names.KEPT, names.WAITED):
                kind = "usual" if decision.k else "first"
            found[kind].append(1e3 * decision.seconds)
    return {kind: np.array(values) for kind, values in found.items()}


def main() -> None:
    """Median, 99th percentile and largest time of each policy and kind."""
    events = int(sys.argv[1]) if len(sys.argv) > 1 else EVENTS
    loop.time = SimpleNamespace(perf_counter=time.process_time)  # type: ignore[assignment]
    for policy in REPLANNED:
        drive(case_of(scene_of(1), policy, tracker="mpc"))
        for kind, values in times(policy, events).items():
            if len(values):
                middle, high = np.percentile(values, [50, 99])
                asked = f" (asked: median below {ASKED:g})" if kind == "usual" else ""
                tail = f"p99 {high:.1f} ms, largest {values.max():.1f} ms"
                print(f"{policy}, {kind}: {len(values)} decisions, median {middle:.1f} ms{asked}, {tail}")


if __name__ == "__main__":
    main()
