"""Matched controls: followers that nobody cuts in on, alike before the start to those that somebody does.

A control is a vehicle that keeps its lane and its leader from half a second before its start to the horizon. It is
matched to a follower by class, carriageway and lane, and by speed, acceleration, spacing and closing speed within
calipers; the nearest few count (equations.md 3.12).
"""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from highd_lc.drivers.responses import TIME_STEP

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

BEFORE: Final = 0.5
"""Time before the start over which the acceleration is averaged and nothing may change [s]."""
MOST: Final = 5
"""Most controls of a follower."""
COVARIATES: Final = ("speed", "acceleration", "spacing", "closing")
# Largest difference in speed [m/s], acceleration [m/s^2], spacing [m] and closing speed [m/s].
_CALIPERS = np.array([1.5, 0.2, 8.0, 1.0])


class Rows(NamedTuple):
    """A recording's rows, by vehicle and frame, each of shape (N,).

    group: of class, carriageway and lane; leader: vehicle id, -1 = none; spacing [m] and v_leader [m/s]: NaN
    without one.
    """

    vehicle: IntArray
    frame: IntArray
    group: IntArray
    leader: IntArray
    v: FloatArray
    a: FloatArray
    spacing: FloatArray
    v_leader: FloatArray


@dataclass(frozen=True)
class Starts:
    """Moments at which followers could have been cut in on: row in ``Rows``, vehicle, group, covariates (4, n)."""

    row: IntArray
    vehicle: IntArray
    group: IntArray
    covariates: FloatArray


def starts(rows: Rows, rate: float, horizon: float) -> Starts:
    """One start a second of every vehicle that has a leader and keeps it, and its lane, up to the horizon [s]."""
    before, after = round(BEFORE * rate), int(np.ceil(horizon * rate))
    new = np.zeros(len(rows.vehicle), bool)
    new[:1] = True
    for values in (rows.vehicle, rows.group, rows.leader, rows.frame - np.arange(len(rows.frame))):
        new[1:] |= values[1:] != values[:-1]
    run = np.cumsum(new) - 1
    first = np.flatnonzero(new)
    stop = np.append(first[1:], len(run))
    place = np.arange(len(run))
    fits = (place - first[run] >= before) & (stop[run] - place > after) & (rows.leader >= 0)
    chosen = np.flatnonzero(fits & (rows.frame % max(round(rate), 1) == 0))
    sums = np.concatenate([[0.0], np.cumsum(rows.a)])
    acceleration = (sums[chosen + 1] - sums[chosen - before]) / (before + 1)
    closing = rows.v[chosen] - rows.v_leader[chosen]
    covariates = np.stack([rows.v[chosen], acceleration, rows.spacing[chosen], closing])
    good = np.isfinite(covariates).all(axis=0)
    return Starts(chosen[good], rows.vehicle[chosen[good]], rows.group[chosen[good]], covariates[:, good])


def speeds(rows: Rows, chosen: IntArray, rate: float, horizon: float) -> FloatArray:
    """Speeds from the chosen rows on, on the grid of 0.1 s up to the horizon [s], shape (K, n)."""
    at = np.arange(round(horizon / TIME_STEP) + 1)[:, None] * TIME_STEP * rate
    whole = np.minimum(np.floor(at + 1e-9).astype(np.int64), int(np.ceil(horizon * rate)) - 1)
    part = at - whole
    low = rows.v[chosen + whole]
    return np.asarray(low + part * (rows.v[chosen + whole + 1] - low))


def match(group: int, covariates: FloatArray, own: IntArray, candidates: Starts) -> IntArray:
    """Places of a follower's controls among the candidates, nearest first.

    covariates: its own, shape (4,); own: vehicles of its event, which are no controls.
    """
    away = np.abs(candidates.covariates - covariates[:, None]) / _CALIPERS[:, None]
    alike = (candidates.group == group) & (away <= 1.0).all(axis=0) & ~np.isin(candidates.vehicle, own)
    places = np.flatnonzero(alike)
    distance = (away[:, places] ** 2).sum(axis=0)
    nearest = places[np.argsort(distance, kind="stable")]
    # Two starts of one vehicle say nearly the same: the nearer one stands for both.
    _, earliest = np.unique(candidates.vehicle[nearest], return_index=True)
    return nearest[np.sort(earliest)][:MOST]
