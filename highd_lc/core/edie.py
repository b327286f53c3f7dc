"""Edie's measures of trajectories in regions of space and time (paper, equations 25 to 27), by exact clipping.

    q = d(A) / |A|,    k = t(A) / |A|,    v = d(A) / t(A)

d(A) and t(A) are the distance and the time that all vehicles together spend in the region A, |A| its area in
metre seconds. A trajectory runs straight between its samples and is cut at the region's borders, so that distance
and time of neighbouring cells add up to what was travelled. A sample that is not finite breaks a trajectory.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.kernels import kernel
from highd_lc.vocab.errors import ShapeError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Trajectories:
    """Trajectories of many vehicles, one after another.

    t [s], ascending within a vehicle, and x [m], each of shape (n,); starts, shape (m + 1,): vehicle i has the
    samples starts[i] .. starts[i + 1] - 1. Raises ShapeError when they do not fit.
    """

    t: FloatArray
    x: FloatArray
    starts: IntArray

    def __post_init__(self) -> None:
        if self.t.shape != self.x.shape or self.t.ndim != 1:
            raise ShapeError(f"Trajectories.x has shape {self.x.shape}, t has {self.t.shape}")
        if len(self.starts) < 1 or self.starts[0] != 0 or self.starts[-1] != len(self.t):
            raise ShapeError(f"Trajectories.starts must run from 0 to {len(self.t)}")
        if np.any(np.diff(self.starts) < 0):
            raise ShapeError("Trajectories.starts must not descend")

    @property
    def count(self) -> int:
        """Number of vehicles m."""
        return len(self.starts) - 1


@dataclass(frozen=True)
class Cells:
    """Distance [m] and time [s] of all vehicles in the cells of a grid, and the cells' area [m s].

    Each of shape (space cells, time cells). The measures are NaN in a cell that nobody enters.
    """

    distance: FloatArray
    time: FloatArray
    area: FloatArray

    @property
    def flow(self) -> FloatArray:
        """q = d(A) / |A| [veh/s] (equation 25)."""
        return np.where(self.time > 0.0, self.distance / self.area, np.nan)

    @property
    def density(self) -> FloatArray:
        """k = t(A) / |A| [veh/m] (equation 27)."""
        return np.where(self.time > 0.0, self.time / self.area, np.nan)

    @property
    def speed(self) -> FloatArray:
        """v = d(A) / t(A) [m/s] (equation 26)."""
        known = self.time > 0.0
        return np.where(known, self.distance / np.where(known, self.time, 1.0), np.nan)


def trajectories_of(t: FloatArray, x: FloatArray) -> Trajectories:
    """Trajectories of p vehicles on one time grid. t: shape (n,) [s]; x: shape (p, n) [m]."""
    p, n = x.shape
    return Trajectories(np.tile(t, p), np.ascontiguousarray(x).ravel(), np.arange(p + 1) * n)


def trajectories_of_rows(vehicle: IntArray, t: FloatArray, x: FloatArray, *, longest_step: float) -> Trajectories:
    """Trajectories of a recording's rows in any order, each row a vehicle's position at a time.

    vehicle: ids, t [s], x [m], each of shape (n,). Where a vehicle is missing for more than longest_step [s] (left
    out by the caller because it was on another lane, say), its trajectory ends and another one begins.
    """
    order = np.lexsort((t, vehicle))
    vehicle, t, x = vehicle[order], t[order].astype(np.float64), x[order].astype(np.float64)
    breaks = (np.diff(vehicle) != 0) | (np.diff(t) > longest_step)
    starts = np.concatenate([[0], np.flatnonzero(breaks) + 1, [len(t)]]) if len(t) else np.zeros(1, np.int64)
    return Trajectories(t, x, starts)


def clip_to_grid(tracks: Trajectories, *, x_edges: FloatArray, t_edges: FloatArray) -> Cells:
    """Distance and time of all vehicles in the cells of a grid.

    Args:
        tracks: trajectories of all vehicles; what lies outside the grid is left out.
        x_edges: ascending borders of the cells [m], at least two.
        t_edges: ascending borders of the cells [s], at least two.

    Returns:
        The sums of each cell.

    Raises:
        ShapeError: borders do not ascend, or there are fewer than two.
    """
    for name, edges in (("x_edges", x_edges), ("t_edges", t_edges)):
        if len(edges) < 2 or not np.all(np.diff(edges) > 0.0):
            raise ShapeError(f"{name} must ascend and hold at least two borders, got {len(edges)}")
    shape = (len(x_edges) - 1, len(t_edges) - 1)
    distance, time = np.zeros(shape), np.zeros(shape)
    _clip_all(tracks.t, tracks.x, tracks.starts, x_edges, t_edges, distance, time)
    return Cells(distance, time, np.outer(np.diff(x_edges), np.diff(t_edges)))


def clip_to_rectangle(
    tracks: Trajectories, *, x_range: tuple[float, float], t_range: tuple[float, float]
) -> tuple[FloatArray, FloatArray]:
    """Distance and time of each vehicle in one rectangle (Table 1 of the paper).

    Args:
        tracks: trajectories of m vehicles.
        x_range: first and last x of the rectangle [m].
        t_range: its first and last time [s].

    Returns:
        Distance [m] and time [s], each of shape (m,).
    """
    distance, time = np.zeros((tracks.count, 1)), np.zeros((tracks.count, 1))
    x_edges, t_edges = np.array(x_range, dtype=np.float64), np.array(t_range, dtype=np.float64)
    for i in range(tracks.count):
        one = slice(tracks.starts[i], tracks.starts[i + 1])
        whole = np.array([0, one.stop - one.start])
        _clip_all(tracks.t[one], tracks.x[one], whole, x_edges, t_edges, distance[i : i + 1], time[i : i + 1])
    return distance[:, 0], time[:, 0]


def edie(distance: float, time: float, area: float) -> tuple[float, float, float]:
    """Edie's measures of a region (equations 25 to 27).

    Args:
        distance: d(A), driven by all vehicles in the region [m].
        time: t(A), spent by all vehicles in it [s].
        area: |A| [m s].

    Returns:
        Flow [veh/h], speed [km/h] and density [veh/km]; NaN in a region that nobody enters.
    """
    if time <= 0.0:
        return np.nan, np.nan, np.nan
    return 3600.0 * distance / area, 3.6 * distance / time, 1000.0 * time / area


DENSITIES: Final = (11.0, 22.0)
"""Densities above which traffic is dense, and congested [veh/km and lane]."""
TRAFFIC_STATES: Final = ("free", "dense", "congested")


def traffic_states(density: FloatArray) -> NDArray[np.object_]:
    """The traffic state at each density [veh/km and lane], shape (n,); empty where the density is not known."""
    words = np.array([*TRAFFIC_STATES, ""], dtype=object)
    place = np.searchsorted(DENSITIES, density, side="right")
    return np.asarray(words[np.where(np.isfinite(density), place, len(TRAFFIC_STATES))])


@kernel()
def _clip_all(
    t: FloatArray,
    x: FloatArray,
    starts: IntArray,
    x_edges: FloatArray,
    t_edges: FloatArray,
    distance: FloatArray,
    time: FloatArray,
) -> None:
    for vehicle in range(len(starts) - 1):
        for k in range(starts[vehicle], starts[vehicle + 1] - 1):
            if np.isfinite(x[k]) and np.isfinite(x[k + 1]) and np.isfinite(t[k]) and np.isfinite(t[k + 1]):
                _clip_segment(t[k], t[k + 1], x[k], x[k + 1], x_edges, t_edges, distance, time)


@kernel()
def _clip_segment(
    t0: float,
    t1: float,
    x0: float,
    x1: float,
    x_edges: FloatArray,
    t_edges: FloatArray,
    distance: FloatArray,
    time: FloatArray,
) -> None:
    """Share a straight piece among the cells that it passes, walking from border to border.

    The next border in time is t_edges[column + 1]; in space x_edges[row + 1] forwards, x_edges[row] backwards.
    """
    columns, rows = len(t_edges) - 1, len(x_edges) - 1
    forwards = x1 >= x0
    column = np.searchsorted(t_edges, t0, side="right") - 1
    if forwards:
        row = np.searchsorted(x_edges, x0, side="right") - 1
    else:
        row = np.searchsorted(x_edges, x0, side="left") - 1
    at = 0.0
    while at < 1.0:
        to_t = to_x = 1.0
        if column + 1 <= columns and t_edges[column + 1] < t1:
            to_t = (t_edges[column + 1] - t0) / (t1 - t0)
        if forwards and row + 1 <= rows and x_edges[row + 1] < x1:
            to_x = (x_edges[row + 1] - x0) / (x1 - x0)
        elif not forwards and row >= 0 and x_edges[row] > x1:
            to_x = (x_edges[row] - x0) / (x1 - x0)
        # Rounding may put a border behind the point reached: the piece between them is empty then.
        to = max(at, min(to_t, to_x))
        if 0 <= column < columns and 0 <= row < rows:
            distance[row, column] += (to - at) * (x1 - x0)
            time[row, column] += (to - at) * (t1 - t0)
        if to_t <= to and to_t < 1.0:
            column += 1
        if to_x <= to and to_x < 1.0:
            row += 1 if forwards else -1
        at = to
