"""Speed and quality of calibration: each way to fit a follower, as ratios within one run.

    python benchmarks/bench_calibration.py

The follower has 101 samples (100 steps); the GA runs 200 x 200. Times are the least of several runs.
"""

import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from highd_lc.core.car_following import TIME_STEP, FitProblem, objectives_of
from highd_lc.drivers.calibration import fit_follower, pose
from highd_lc.drivers.genetic import GeneticAlgorithm, PymooGeneticAlgorithm, minimise_with_pymoo
from highd_lc.drivers.least_squares import STARTS, Screening, descend, screen
from highd_lc.vocab.settings import CalibrateSettings

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "made"))
from made_followers import NOISE_FREE, NOISY, follower

FOLLOWERS = 200
FIRST_CALL = """
import time; start = time.perf_counter()
import sys; sys.path.insert(0, {tests!r})
import numpy as np
from made_followers import NOISY, follower
from highd_lc.drivers.calibration import fit_follower
from highd_lc.vocab.settings import CalibrateSettings
fit_follower(follower(np.random.default_rng(0), noise=NOISY)[0], CalibrateSettings(), seed=0)
print(time.perf_counter() - start)
"""


def least(work: Callable[[], object], runs: int) -> float:
    """Least time of several runs [s], after one that warms up."""
    work()
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def closed_loop_numpy(problem: FitProblem, x: np.ndarray) -> np.ndarray:
    """The closed-loop objective of candidates x (n, 6), numpy over the population: the common fast way."""
    leader_x, leader_v, recorded_x, recorded_v, _ = problem.track
    v_desire, A, b, B, tau, L = x.T
    v, front = np.full(len(x), recorded_v[0]), np.full(len(x), recorded_x[0])
    errors_x, errors_v = np.zeros(len(x)), np.zeros(len(x))
    for k in range(problem.track.shape[1] - 1):
        desired = np.maximum(v * v / (2 * b) - leader_v[k] ** 2 / (2 * B) + v * tau + L, L)
        closeness = np.exp(np.minimum(1 - (leader_x[k] - front) / desired, 40.0))
        v = np.maximum(v + A * (1 - v / v_desire - closeness) * TIME_STEP, 0.0)
        front = front + v * TIME_STEP
        errors_x += (front - recorded_x[k + 1]) ** 2
        errors_v += (v - recorded_v[k + 1]) ** 2
    return np.sqrt(errors_x * problem.weights[0]) + np.sqrt(errors_v * problem.weights[1])


def speed(problem: FitProblem) -> None:
    """Time of one fit each way."""
    ga, library = GeneticAlgorithm(), PymooGeneticAlgorithm()
    rng = np.random.default_rng
    candidates = np.random.default_rng(1).uniform(problem.lower, problem.upper, (200, 6))
    found = objectives_of(problem, candidates.T)
    np.testing.assert_allclose(found, closed_loop_numpy(problem, candidates), rtol=1e-9)
    numpy_way = least(lambda: minimise_with_pymoo(problem, library, rng(0), closed_loop_numpy), 2)
    compiled_way = least(lambda: library.minimise(problem, rng(0)), 3)
    ga_way = least(lambda: ga.minimise(problem, rng(0)), 40)
    screen_way = least(lambda: Screening().minimise(problem, rng(0)), 60)
    evaluation = least(lambda: objectives_of(problem, candidates.T), 400)
    rows = {
        "pymoo, numpy over the population": numpy_way,
        "pymoo, compiled objective": compiled_way,
        "ga (compiled whole)": ga_way,
        "screen (Sobol + Levenberg-Marquardt)": screen_way,
    }
    for name, seconds in rows.items():
        print(
            f"{name:38s} {seconds * 1e3:9.2f} ms   {numpy_way / seconds:6.1f} x numpy"
            f"   {compiled_way / seconds:6.1f} x compiled"
        )
    steps = len(candidates) * (problem.track.shape[1] - 1)
    print(f"one model step in a population of 200: {evaluation / steps * 1e9:.2f} ns\n")


def threads(problem: FitProblem) -> None:
    """Two threads against one, over the same fits."""
    ga, jobs = GeneticAlgorithm(), range(60)

    def fits(workers: int) -> None:
        with ThreadPoolExecutor(workers) as pool:
            list(pool.map(lambda seed: ga.minimise(problem, np.random.default_rng(seed)), jobs))

    one, two = least(lambda: fits(1), 4), least(lambda: fits(2), 4)
    print(f"ga on 2 threads: {one / two:.2f} x one thread\n")


def first_call() -> None:
    """A new process with a warm compile cache, imports and made-up track included."""
    code = FIRST_CALL.format(tests=str(Path(__file__).parents[1] / "tests" / "made"))
    times = [
        float(subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout)
        for _ in range(4)
    ]
    print(f"first fit in a new process: {min(times[1:]):.2f} s\n")


def quality() -> None:
    """Objectives of made-up followers against the best known of each (8 x the screen, 150 iterations)."""
    for name, noise in (("noise-free", NOISE_FREE), ("noisy", NOISY)):
        ratios = {"ga": [], "ga + polish": [], "screen": []}
        spacing, polished = [], []
        for seed in range(FOLLOWERS):
            track, _ = follower(np.random.default_rng(seed), noise=noise)
            problem = pose(track, CalibrateSettings())
            fit = fit_follower(track, CalibrateSettings(), seed=seed)
            screened = Screening().minimise(problem, np.random.default_rng(seed)).objective
            wide = screen(problem, np.random.default_rng(seed + FOLLOWERS), count=16384, keep=STARTS)
            best = min(fit.objective, screened, descend(problem, wide, iterations=150)[1].min())
            for way, objective in zip(ratios, (fit.objective_ga, fit.objective, screened), strict=True):
                ratios[way].append(max(objective, 1e-9) / max(best, 1e-9))
            spacing.append(fit.quality.rmse_spacing)
            polished.append(fit.objective)
        print(
            f"{FOLLOWERS} {name} followers:"
            f" polished objective below 1e-3 in {np.mean(np.less(polished, 1e-3)):.1%},"
        )
        print(
            f"  spacing RMSE against the record: median {np.median(spacing):.4f} m, largest {max(spacing):.4f} m"
        )
        if noise is NOISY:
            for way, values in ratios.items():
                print(
                    f"  {way:12s} within 2 % of the best known: {np.mean(np.less_equal(values, 1.02)):6.1%}"
                    f"   ratio: median {np.median(values):.3f}, largest {max(values):.3f}"
                )
    print()


if __name__ == "__main__":
    one_problem = pose(follower(np.random.default_rng(0), noise=NOISY)[0], CalibrateSettings())
    speed(one_problem)
    threads(one_problem)
    first_call()
    quality()
