"""Time of the compiled platoon (100 followers over 800 s: to be under 50 ms) and of Edie's cells."""

import time

import numpy as np

from highd_lc.core.edie import clip_to_grid, trajectories_of
from highd_lc.scenarios.platoon import Lead, drive_platoon, equal_drivers
from highd_lc.vocab.driver import SIMULATION

DT = 0.1


def run(count, seconds):
    start = equal_drivers(count, speed=25.0, spacing=44.0, parameters=SIMULATION.as_array(), length=5.0)
    n = round(seconds / DT) + 1
    v = 25.0 - 5.0 * (np.arange(n) > 2000)
    lead = Lead(10.0 + np.cumsum(v) * DT, v, 5.0)
    return drive_platoon(start, lead, dt=DT)


def best_of(action, repeats=5):
    action()
    times = []
    for _ in range(repeats):
        begin = time.perf_counter()
        action()
        times.append(time.perf_counter() - begin)
    return min(times)


def main():
    for count in (10, 100, 1000):
        seconds = best_of(lambda c=count: run(c, 800.0), 5 if count < 1000 else 2)
        steps = count * 8001
        print(f"{count:6d} followers x 800 s: {1e3 * seconds:8.1f} ms, {1e9 * seconds / steps:.2f} ns a step")
    platoon = run(100, 800.0)
    tracks = trajectories_of(platoon.t, platoon.front)
    edges = np.linspace(-5000.0, 20000.0, 501), np.arange(0.0, 800.1, 5.0)
    seconds = best_of(lambda: clip_to_grid(tracks, x_edges=edges[0], t_edges=edges[1]))
    print(f"Edie's cells of 100 x 800 s: {1e3 * seconds:.1f} ms")


if __name__ == "__main__":
    main()
