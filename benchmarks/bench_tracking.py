"""Speed of tracking: the compiled control step, other ways to solve the same QP, and the whole population.

    python benchmarks/bench_tracking.py

Ratios are within one run. The population is 8,400 events x 4 plans; as many plans as the share below says are
driven, and the time is scaled.
"""

import time
from collections.abc import Callable

import daqp
import numpy as np
from numba import njit, types
from scipy.optimize import minimize
from tracking_cases import WHEELBASE, lane_change, nominal_plans

from highd_lc.core.kinematics import bicycle_step
from highd_lc.tracking.closed_loop import control, controller, reference_rows, track
from highd_lc.tracking.controllers import MpcController
from highd_lc.tracking.daqp_call import INFINITY
from highd_lc.tracking.mpc import Qp, assemble, mpc_parameters, new_memory, solve_qp
from highd_lc.vocab.tracking import Reference, TrackingSettings

POPULATION = 8_400 * 4
SHARE = 0.25

_clock_gettime = types.ExternalFunction("clock_gettime", types.int32(types.int32, types.intp))
_MONOTONIC = 1


@njit(nogil=True)
def timed_loop(rows, wheelbase, offset, p, memory, elapsed):
    """The closed loop with each control step (assembly and QP) timed: nanoseconds into elapsed, shape (n,)."""
    before, after = np.zeros(2, np.int64), np.zeros(2, np.int64)
    held, state = rows[0, 3:].copy(), rows[0, :3] + offset
    for k in range(elapsed.shape[0]):
        _clock_gettime(_MONOTONIC, before.ctypes.data)
        control(state, held, rows, k, wheelbase, p, memory)
        _clock_gettime(_MONOTONIC, after.ctypes.data)
        elapsed[k] = (after[0] - before[0]) * 1e9 + (after[1] - before[1])
        x, y, phi = bicycle_step(state[0], state[1], state[2], held[0], held[1], p.dt, wheelbase)
        state[0], state[1], state[2] = x, y, phi


def step_times(offset: tuple[float, float, float], repeats: int = 400) -> np.ndarray:
    """Times of single control steps [us] over the nominal plans, the car beginning with that offset."""
    settings, times = TrackingSettings(), []
    p = mpc_parameters(settings, 0.1)
    memory = new_memory(p)
    for reference in nominal_plans():
        rows = reference_rows(reference, WHEELBASE, settings.horizon)
        elapsed = np.zeros(reference.n_steps)
        for repeat in range(repeats // 12 + 1):
            timed_loop(rows, WHEELBASE, np.array(offset), p, memory, elapsed)
            if repeat:
                times.append(elapsed.copy() / 1e3)
    return np.concatenate(times)


def microseconds(call: Callable[[], object], repeats: int) -> float:
    """Median time of a call [us]."""
    call()
    times = []
    for _ in range(repeats):
        started = time.perf_counter()
        call()
        times.append(time.perf_counter() - started)
    return float(np.median(times) * 1e6)


def one_qp() -> Qp:
    """A QP in which bounds bind: the car is a metre ahead and off to the side."""
    settings = TrackingSettings()
    p = mpc_parameters(settings, 0.1)
    memory = new_memory(p)
    rows = reference_rows(lane_change(25.0, 3.5, 5.5), WHEELBASE, settings.horizon)
    assemble(np.array([1.0, 0.3, 0.02]), np.zeros(2), rows, 20, WHEELBASE, p, memory)
    return Qp(memory.H, memory.f, memory.A, memory.upper)


def slsqp(qp: Qp) -> object:
    """The QP by SciPy's general solver, with gradients."""
    bounds = {"type": "ineq", "fun": lambda z: qp.upper - qp.A @ z, "jac": lambda z: -qp.A}
    return minimize(
        lambda z: 0.5 * z @ qp.H @ z + qp.f @ z,
        np.zeros(len(qp.f)),
        jac=lambda z: qp.H @ z + qp.f,
        constraints=[bounds],
        method="SLSQP",
    )


def solvers(step_us: float) -> None:
    """Other ways to solve one step's QP, as multiples of the whole compiled step."""
    qp = one_qp()
    lower, sense = np.full(len(qp.upper), -INFINITY), np.zeros(len(qp.upper), np.intc)
    rows = reference_rows(lane_change(25.0, 3.5, 5.5), WHEELBASE, 6)
    stepwise = MpcController(TrackingSettings(), WHEELBASE, 0.1)
    ways = {
        "daqp from Python, QP only": (
            lambda: daqp.solve(qp.H, qp.f, qp.A, qp.upper, lower, sense),
            2000,
        ),
        "whole step from Python (DAQP)": (
            lambda: stepwise.command(rows[20, :3], rows[19, 3:], rows=rows, k=20),
            500,
        ),
        "OSQP, QP only": (lambda: solve_qp(qp, solver="osqp"), 50),
        "SLSQP, QP only": (lambda: slsqp(qp), 20),
    }
    for name, (call, repeats) in ways.items():
        took = microseconds(call, repeats)
        print(f"  {name:32} {took:9.1f} us  {took / step_us:8.1f} x the compiled step")


def population_plans(n: int) -> tuple[list[Reference], list[float]]:
    """Seeded plans like a population's: 8 to 40 m/s, 3.2 to 8 s, cars and trucks."""
    rng = np.random.default_rng(1)
    plans = [
        lane_change(
            rng.uniform(8.0, 40.0),
            rng.choice([-1.0, 1.0]) * rng.uniform(3.0, 4.0),
            round(rng.uniform(3.2, 8.0), 1),
            speed_change=rng.uniform(-2.0, 2.0),
        )
        for _ in range(n)
    ]
    return plans, list(rng.choice([2.6, 2.8, 6.0], n))


def population() -> None:
    """The whole population on one core."""
    plans, wheelbases = population_plans(round(POPULATION * SHARE))
    wall, cpu = time.perf_counter(), time.process_time()
    settings = TrackingSettings()
    shared = controller(settings, plans[0].dt)
    results = [
        track(plan, wheelbase=wheelbase, settings=settings, shared=shared)
        for plan, wheelbase in zip(plans, wheelbases, strict=True)
    ]
    wall, cpu = (time.perf_counter() - wall) / SHARE, (time.process_time() - cpu) / SHARE
    print(f"  {POPULATION} plans on one core: {wall:.1f} s, {cpu:.1f} s of CPU (asked: 20 s on two cores)")
    lateral = np.concatenate([result.errors[:, 1] for result in results])
    unsolved = sum(result.qp_failures for result in results)
    statuses = {s: sum(r.status == s for r in results) for s in sorted({r.status for r in results})}
    print(f"  lateral RMSE {np.sqrt(np.mean(lateral**2)):.4f} m, largest {np.abs(lateral).max():.4f} m,", end=" ")
    print(f"unsolved QPs {unsolved}, {statuses}")


def main() -> None:
    """Print the table."""
    plan = lane_change(25.0, 3.5, 5.5)
    started = time.perf_counter()
    track(plan, wheelbase=WHEELBASE, settings=TrackingSettings())
    print(f"first plan of this process (compiled or loaded from the cache): {time.perf_counter() - started:.2f} s")
    print("control step, assembly and QP, compiled (asked: median under 15 us)")
    nominal = step_times((0.0, 0.0, 0.0))
    for name, times in (("nominal", nominal), ("bounds binding", step_times((2.0, 0.5, 0.05)))):
        print(f"  {name:32} median {np.median(times):5.2f} us, p99 {np.percentile(times, 99):5.2f} us")
    solvers(float(np.median(nominal)))
    print("population on the kinematic car")
    population()


if __name__ == "__main__":
    main()
