"""The loss surface of an event over (T, x_final), with its feasible region and the plans' own points, as data."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.losses import joint_objective
from highd_lc.planning.planner import PlanningProblem
from highd_lc.planning.pool import Pool
from highd_lc.vocab import names

FloatArray = NDArray[np.float64]

OFFSETS: Final = 31
"""Nodes over x_final - v0 T; odd, so that constant speed is one, and just below two tiles of candidates."""
EVERY: Final = 2
"""Every second duration of the planner's grid has a row."""
ON_SURFACE: Final = (names.CONSTANT, names.HUMAN, *names.FIXED_POLICIES)
"""The policies that are points of the surface: end speed = start speed, or nearly so (human)."""
_SMALLEST_HALF_WIDTH_M: Final = 12.0
_MARGIN: Final = 1.25


@dataclass(frozen=True)
class SurfacePoint:
    """Where a policy lies: T [s] (human: duration) and x_final - v0 T [m] (human: x at the end)."""

    policy: str
    accounting: str
    T: float
    x_offset: float


@dataclass(frozen=True)
class LossSurface:
    """Losses of the fixed form (end speed = start speed) over a grid of T and x_final.

    T [s], shape (m,); x_offset: x_final - v0 T [m], shape (n,), the same for every T; v0 [m/s]. By accounting:
    loss_av, loss_hv, shape (m, n), also where a limit is violated (NaN where vehicles run through each other
    without bound); feasible: boolean, shape (m, n). points: optima, human and constant speed.
    """

    T: FloatArray
    x_offset: FloatArray
    v0: float
    loss_av: Mapping[str, FloatArray]
    loss_hv: Mapping[str, FloatArray]
    feasible: Mapping[str, NDArray[np.bool_]]
    points: tuple[SurfacePoint, ...]

    @property
    def x_final(self) -> FloatArray:
        """Forward distance at T [m], shape (m, n)."""
        return self.v0 * self.T[:, None] + self.x_offset

    def joint(self, accounting: str, omega_av: float) -> FloatArray:
        """Joint objective under an accounting, NaN where infeasible; shape (m, n)."""
        value = joint_objective(self.loss_av[accounting], self.loss_hv[accounting], omega_av)
        return np.where(self.feasible[accounting], value, np.nan)


def loss_surface(problem: PlanningProblem, points: tuple[SurfacePoint, ...]) -> LossSurface:
    """The surface of an event, wide enough for the points."""
    n = problem.task.durations[::EVERY]
    width = max([_MARGIN * abs(point.x_offset) for point in points] + [_SMALLEST_HALF_WIDTH_M])
    x = np.linspace(-width, width, OFFSETS)
    delta = np.tile(x, (n.size, 1))
    pool = problem.task.simulate(n, delta, np.zeros_like(delta))
    # Arrays are shared between accountings that charge a side over the same time.
    av_T, av_H, hv_T, hv_H = (_table(pool, name, n.size) for name in ("av_T", "av_H", "hv_T", "hv_H"))
    return LossSurface(
        T=np.asarray(n * problem.packed.dt, np.float64),
        x_offset=x,
        v0=problem.packed.v0,
        loss_av={names.PAPER: av_T, names.FOLLOWER_HORIZON: av_T, names.EQUAL: av_H},
        loss_hv={names.PAPER: hv_T, names.FOLLOWER_HORIZON: hv_H, names.EQUAL: hv_H},
        feasible={a: pool.feasible(a).reshape(n.size, -1) for a in names.ACCOUNTINGS},
        points=points,
    )


def _table(pool: Pool, name: str, rows: int) -> FloatArray:
    values: FloatArray = np.asarray(getattr(pool, name)).reshape(rows, -1)
    return np.where(np.isfinite(values), values, np.nan)
