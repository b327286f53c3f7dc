"""Sequential quadratic programming (SLSQP) from several starts: the method that the paper names, for comparison.

Unknowns (T, x_final) or (T, x_final, v_end). T is continuous while a start descends: losses and separations at a
T between two samples are interpolated between the plans of the same x_final - v0 T and v_end at both samples.
Then T is rounded both ways and the rest descends again. What counts in the end is the exact kernel: a plan that
it finds infeasible is none.

A differentiable stand-in for the clearance between ellipses: what a gradient-based solver may lean on.

The separation of two ellipses at one instant is hypot(dx / (a + a2), dy / (b + b2)) - 1, with a and b the half
extents of the AV's turned ellipse along and across the road. It is free of unit, negative deep inside, and close
to the clearance where it vanishes; the exact test stays with ``contacts``.
"""

from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.core.kernels import kernel
from highd_lc.core.losses import joint_objective
from highd_lc.core.quintic import Quintic, first_past, q_rate, q_shape, z_rate, z_shape
from highd_lc.planning import limits
from highd_lc.planning.limits import forward_interval
from highd_lc.planning.pool import Goal, Pool, Task
from highd_lc.planning.replay import drive_on, follow, origin_follower_motion
from highd_lc.planning.scene import MOMENT, PackedScene
from highd_lc.planning.search import possible_durations
from highd_lc.vocab import names

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def separations(
    n: IntArray, delta: FloatArray, change: FloatArray, scene: PackedScene, *, to_T: bool
) -> FloatArray:
    """Smallest separation of each plan to each obstacle over 0..T (to_T) or 0..H; shape (m, obstacles).

    n, delta, change: plans as in ``candidates.evaluate``, each of shape (m,). Obstacles in the order of
    ``scene.obstacle_roles``.
    """
    obstacles = len(scene.leader_a) + len(scene.follower_x) + (1 if len(scene.origin_follower) else 0)
    out = np.full((len(n), obstacles), np.inf)
    _separations(n, delta, change, scene, to_T, out)
    return out


@njit(inline="always")
def _separation(dx: float, dy: float, a: float, b: float) -> float:
    return float(np.hypot(dx / a, dy / b) - 1.0)


@kernel(error_model="numpy")
def _separations(
    n: IntArray, delta: FloatArray, change: FloatArray, scene: PackedScene, to_T: bool, out: FloatArray
) -> None:
    samples, p, leaders = len(scene.target_v), len(scene.follower_x), len(scene.leader_a)
    x, y, vx, vy = np.empty(samples), np.empty(samples), np.empty(samples), np.zeros(samples)
    ax, jerk = np.empty(samples), np.empty(samples)
    fx, fv, fa = np.empty((p, samples)), np.empty((p, samples)), np.empty((p, samples))
    for w in range(len(n)):
        T = n[w] * scene.dt
        for k in range(n[w] + 1):
            u = k / n[w]
            x[k] = scene.v0 * k * scene.dt + delta[w] * z_shape(u) + T * change[w] * q_shape(u)
            vx[k] = scene.v0 + delta[w] / T * z_rate(u) + change[w] * q_rate(u)
            y[k], vy[k] = scene.D * z_shape(u), scene.D / T * z_rate(u)
        vy[n[w] :], ax[n[w]] = 0.0, 0.0
        drive_on(x, y, vx, ax, jerk, n[w], scene)
        crossing = n[w] // 2
        follow(x + scene.length / 2.0, vx, first_past(scene.reactions[0, MOMENT], n[w]), scene, fx, fv, fa)
        behind = x
        if len(scene.origin_follower):
            behind = origin_follower_motion(x + scene.length / 2.0, vx, crossing, scene)
        for k in range(n[w] + 1 if to_T else samples):
            speed = np.hypot(vx[k], vy[k])
            cos, sin = (vx[k] / speed, vy[k] / speed) if vy[k] != 0.0 else (1.0, 0.0)
            a, b = np.hypot(scene.a * cos, scene.b * sin), np.hypot(scene.a * sin, scene.b * cos)
            cx, cy = x[k] + scene.rear_to_centre * (cos - 1.0), y[k] + scene.rear_to_centre * sin
            for i in range(leaders):
                apart = _separation(
                    scene.leader_x[i, k] - cx,
                    scene.leader_y[i, k] - cy,
                    a + scene.leader_a[i],
                    b + scene.leader_b[i],
                )
                out[w, i] = min(out[w, i], apart)
            for i in range(p):
                apart = _separation(
                    fx[i, k] - cx, scene.follower_y[i] - cy, a + scene.follower_a[i], b + scene.follower_b[i]
                )
                out[w, leaders + i] = min(out[w, leaders + i], apart)
            if len(scene.origin_follower) and k <= crossing:
                a2, b2 = scene.origin_follower[4], scene.origin_follower[5]
                apart = _separation(behind[k] - cx, scene.origin_follower[1] - cy, a + a2, b + b2)
                out[w, leaders + p] = min(out[w, leaders + p], apart)


FIRST_T = 5.5
"""T of the first start [s], at constant speed: what anybody would start from."""
_SCALE = np.array([1.0, 10.0, 5.0])
"""Units of the unknowns: T in 1 s, delta in 10 m, change in 5 m/s."""
_STEP = 1e-5
_MARGIN = 1e-6
_ITERATIONS = 60


@dataclass(frozen=True)
class Descent:
    """Where one start ended: the best feasible plan (n, delta, change) and its objective, infinite if none."""

    n: int
    delta: float
    change: float
    objective: float
    evaluations: int


@dataclass
class Relaxation:
    """The problem at a continuous T. n: the duration if it is held fixed [samples], else None."""

    task: Task
    goal: Goal
    free: bool
    n: int | None = None
    evaluations: int = 0
    _last: tuple[bytes, float, FloatArray] = field(default=(b"", 0.0, np.empty(0)))

    def unknowns(self, x: FloatArray) -> tuple[float, float, float]:
        """T [s], delta [m], change [m/s] of a point."""
        values = list(x)
        T = self.n * self.task.scene.dt if self.n is not None else float(values.pop(0) * _SCALE[0])
        return T, float(values[0] * _SCALE[1]), float(values[1] * _SCALE[2]) if self.free else 0.0

    def point(self, T: float, delta: float, change: float) -> FloatArray:
        """The point of a plan: the inverse of ``unknowns``."""
        values: FloatArray = np.array([T, delta, change]) / _SCALE
        return values[(1 if self.n is not None else 0) : (3 if self.free else 2)]

    def neighbours(self, T: float) -> tuple[IntArray, float]:
        """The samples below and above T, and the share of the upper one; twice the same if there is no other."""
        dt = self.task.scene.dt
        durations = self.task.durations
        low = int(np.clip(np.floor(T / dt + 1e-9), durations[0], max(durations[-1] - 1, durations[0])))
        return np.array([low, min(low + 1, durations[-1])]), float(np.clip(T / dt - low, 0.0, 1.0))

    def _stencil(self, delta: float, change: float) -> tuple[FloatArray, FloatArray]:
        """The plan itself, moved in delta and moved in change: shape (3,) or (2,) each."""
        deltas = np.array([delta, delta + _STEP * _SCALE[1], delta])
        changes = np.array([change, change, change + _STEP * _SCALE[2]])
        return (deltas, changes) if self.free else (deltas[:2], changes[:2])

    def _gradient(self, values: FloatArray, share: float) -> FloatArray:
        """Gradient over the unknowns from the values at (two durations, stencil, ...)."""
        level = (1.0 - share) * values[0] + share * values[1]
        parts = [(level[i] - level[0]) / _STEP for i in range(1, len(level))]
        if self.n is None:
            parts.insert(0, (values[1, 0] - values[0, 0]) / self.task.scene.dt * _SCALE[0])
        return np.stack(parts, axis=-1)

    def value(self, x: FloatArray) -> float:
        """The joint objective at a point."""
        return self._objective(x)[0]

    def gradient(self, x: FloatArray) -> FloatArray:
        """Its gradient."""
        return self._objective(x)[1]

    def _objective(self, x: FloatArray) -> tuple[float, FloatArray]:
        if self._last[0] != x.tobytes():
            T, delta, change = self.unknowns(x)
            n, share = self.neighbours(T)
            deltas, changes = (np.tile(v, (2, 1)) for v in self._stencil(delta, change))
            pool = self.task.simulate(n, deltas, changes)
            values = joint_objective(*pool.losses(self.goal.accounting), self.goal.omega_av).reshape(2, -1)
            self.evaluations += 1
            level = float((1.0 - share) * values[0, 0] + share * values[1, 0])
            self._last = (x.tobytes(), level, self._gradient(values, share))
        return self._last[1:]

    def margins(self, x: FloatArray) -> FloatArray:
        """Margins of all constraints at a point, in their limit's share; not negative where they hold."""
        T, delta, change = self.unknowns(x)
        n, share = self.neighbours(T)
        apart = self._apart(n, np.array([delta]), np.array([change]))
        return np.concatenate([self._limits(T, delta, change), (1.0 - share) * apart[0, 0] + share * apart[1, 0]])

    def margins_gradient(self, x: FloatArray) -> FloatArray:
        """Their gradients, shape (margins, unknowns)."""
        T, delta, change = self.unknowns(x)
        n, share = self.neighbours(T)
        apart = self._gradient(self._apart(n, *self._stencil(delta, change)), share)
        here = self._limits(T, delta, change)
        steps = np.eye(len(x)) * _STEP
        limits = [(self._limits(*self.unknowns(x + step)) - here) / _STEP for step in steps]
        return np.concatenate([np.stack(limits, axis=-1), apart])

    def _limits(self, T: float, delta: float, change: float) -> FloatArray:
        scene, limit = self.task.scene, self.task.limit
        plan = Quintic(scene.v0, scene.D, T, scene.v0 * T + delta, scene.v0 + change)
        margin = limits.margins(plan, limit)
        scales = {"speed": 10.0, "jerk_x": limit.jerk, "jerk_y": limit.jerk}
        scales |= {"curvature": limit.curvature, "yaw_rate": limit.yaw_rate}
        return np.array([value / scales.get(name, limit.acceleration) for name, value in margin.items()]) - _MARGIN

    def _apart(self, n: IntArray, delta: FloatArray, change: FloatArray) -> FloatArray:
        """Separations at both durations, shape (2, stencil, obstacles)."""
        each = len(delta)
        found = separations(
            np.repeat(n, each),
            np.tile(delta, 2),
            np.tile(change, 2),
            self.task.scene,
            to_T=self.goal.accounting == names.PAPER,
        )
        return np.clip(found, -1.0, 1.0).reshape(2, each, -1) - _MARGIN

    def descend(self, x: FloatArray) -> FloatArray:
        """Where SLSQP ends from x; x itself if it breaks down."""
        settings = self.task.settings
        bounds = [(settings.T_min / _SCALE[0], self.task.durations[-1] * self.task.scene.dt / _SCALE[0])]
        bounds += [(-100.0, 100.0)] * 2
        from scipy.optimize import minimize  # half a second, for a comparison on a sample of events

        result = minimize(
            self.value,
            x,
            method="SLSQP",
            jac=self.gradient,
            bounds=bounds[(1 if self.n is not None else 0) : (3 if self.free else 2)],
            constraints={"type": "ineq", "fun": self.margins, "jac": self.margins_gradient},
            options={"maxiter": _ITERATIONS, "ftol": 1e-7},
        )
        return result.x if np.isfinite(result.x).all() else x


def starts(task: Task, count: int, *, free: bool, rng: np.random.Generator) -> list[tuple[float, float, float]]:
    """Starts (T, delta, change): constant speed over ``FIRST_T`` first, then random plans inside the limits."""
    found = [(FIRST_T, 0.0, 0.0)]
    durations = possible_durations(task)
    for _ in range(count - 1 if len(durations) else 0):
        T = float(rng.choice(durations) * task.scene.dt)
        widest = task.limit.jerk * T**2 / 6.0
        low = max(task.limit.v_min - task.scene.v0, -widest)
        high = min(task.limit.v_max - task.scene.v0, widest)
        change = float(rng.uniform(low, high)) if free else 0.0
        low_delta, high_delta = forward_interval(np.array(T), np.array(change), task.scene.v0, task.limit)
        found.append((T, float(rng.uniform(low_delta, np.maximum(low_delta, high_delta))), change))
    return found


def descend(task: Task, goal: Goal, start: tuple[float, float, float], *, free: bool) -> Descent:
    """The best feasible plan that one start leads to: T continuous, then on both of its neighbours."""
    relaxed = Relaxation(task, goal, free)
    T, delta, change = relaxed.unknowns(relaxed.descend(relaxed.point(*start)))
    best, evaluations = Descent(0, np.nan, np.nan, np.inf, 0), relaxed.evaluations
    for n in relaxed.neighbours(T)[0]:
        held = Relaxation(task, goal, free, n=int(n))
        ends = held.unknowns(held.descend(held.point(T, delta, change)))
        evaluations += held.evaluations
        # The end of the first descent, rounded, is a plan too.
        for _, d, c in (ends, (T, delta, change)):
            value = float(_exact(task, int(n), d, c).objective(goal)[0])
            if value < best.objective:
                best = Descent(int(n), d, c, value, 0)
    return Descent(best.n, best.delta, best.change, best.objective, evaluations)


def _exact(task: Task, n: int, delta: float, change: float) -> Pool:
    return task.simulate(np.array([n]), np.array([[delta]]), np.array([[change]]))


def multi_start(task: Task, goal: Goal, *, free: bool, count: int, rng: np.random.Generator) -> list[Descent]:
    """Descents from every start, the one from constant speed first."""
    return [descend(task, goal, start, free=free) for start in starts(task, count, free=free, rng=rng)]
