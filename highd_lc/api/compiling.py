"""Compiles the planner's kernels in a process of its own, while a first run is still at its recordings.

A run needs them late, and one process would compile one kernel after the other with the rest of the machine idle.
Nobody compiles what another process is at (vocab/compile_cache.py): who needs it waits for its files.
"""

import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from highd_lc.vocab.compile_cache import count_kernels


@contextmanager
def compiling_ahead() -> Iterator[None]:
    """Have kernels compiled beside what is done meanwhile, if none of this version are kept yet."""
    if count_kernels():
        yield
        return
    command = [sys.executable, "-m", __name__]
    # Its input ends with this process, however that ends (``_end_with_input``).
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        yield
    finally:
        process.kill()
        process.communicate()


def compile_planner() -> None:
    """Plan and track a small scene in every way, for the kernels that this takes."""
    from highd_lc.api.plans import compare, plan, track
    from highd_lc.api.scenes import Scene, Vehicle
    from highd_lc.vocab.names import LOCAL_OPTIMUM, POLICIES
    from highd_lc.vocab.tracking import MULTI_BODY

    followers = [Vehicle(x=-45.0, v=30.0), Vehicle(x=-90.0, v=30.0)]
    scene = Scene.of(Vehicle(v=28.0), leader=Vehicle(x=45.0, v=27.0), followers=followers)
    compare(scene, POLICIES)
    track(plan(scene, LOCAL_OPTIMUM))
    track(plan(scene, LOCAL_OPTIMUM), plant=MULTI_BODY)


def _end_with_input() -> None:
    """End this process with its input: who started it has ended."""
    sys.stdin.read()
    os._exit(1)


if __name__ == "__main__":
    threading.Thread(target=_end_with_input, daemon=True).start()
    compile_planner()
