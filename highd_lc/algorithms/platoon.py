"""A platoon of LCM drivers behind a given motion, compiled: 10 to 10,000 followers (SPEC section 13).

Position and spacing are those of front bumpers. Semi-implicit Euler, all vehicles on the states of the same
instant, as in ``replay.follow``; because of that the followers are independent within a step and the vehicle is
the innermost, vectorised loop.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.core.drive import UNBOUNDED, advance, lcm_command
from highd_lc.vocab.errors import ShapeError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

NO_LEADER = np.inf
"""Front of a leader that is not there."""


@dataclass(frozen=True)
class PlatoonStart:
    """p followers at the first instant, nearest to the lead first.

    front: front bumpers [m], descending; v [m/s], length [m], each of shape (p,); parameters: LCM, shape (p, 6).
    Raises ShapeError when the shapes differ.
    """

    front: FloatArray
    v: FloatArray
    length: FloatArray
    parameters: FloatArray

    def __post_init__(self) -> None:
        p = len(self.front)
        for name, shape in (("v", (p,)), ("length", (p,)), ("parameters", (p, 6))):
            if np.shape(getattr(self, name)) != shape:
                raise ShapeError(f"PlatoonStart.{name}: {np.shape(getattr(self, name))}, expected {shape}")


@dataclass(frozen=True)
class Lead:
    """What the first follower drives behind: front [m] and speed [m/s] at each instant, shape (N + 1,); length.

    An infinite front (``NO_LEADER``) is a free road. length [m]: of the vehicle in front, for gaps.
    """

    front: FloatArray
    v: FloatArray
    length: float


@dataclass(frozen=True)
class Platoon:
    """Motion of p followers at the instants t [s], shape (n,): front [m], v [m/s], commanded a [m/s^2].

    front, v, a: shape (p, n); length [m]: shape (p,); lead: what they drove behind at the same instants.
    """

    t: FloatArray
    front: FloatArray
    v: FloatArray
    a: FloatArray
    length: FloatArray
    lead: Lead


def equal_drivers(
    count: int, *, speed: float, spacing: float, parameters: FloatArray, length: float
) -> PlatoonStart:
    """A platoon of equal drivers, the first one's front at 0.

    speed [m/s], spacing [m] front to front, length [m] of everybody, parameters: shape (6,).
    """
    return PlatoonStart(
        front=-spacing * np.arange(count, dtype=np.float64),
        v=np.full(count, speed),
        length=np.full(count, length),
        parameters=np.tile(parameters, (count, 1)),
    )


def drive_platoon(
    start: PlatoonStart, lead: Lead, *, dt: float, held: int = 0, every: int = 1, hardest: float = UNBOUNDED
) -> Platoon:
    """Drive the platoon behind the lead over all of its instants.

    dt [s]; held: first instant at which they drive by LCM, before it everybody keeps the speed; every: keep each
    that many-th instant only (for thousands of followers). hardest: bound of commanded braking [m/s^2, positive].
    """
    if lead.front.shape != lead.v.shape or every < 1:
        raise ShapeError(f"Lead.v has shape {lead.v.shape}, front has {lead.front.shape}; every = {every}")
    p, kept = len(start.front), (len(lead.front) - 1) // every + 1
    front, v, a = (np.empty((kept, p)) for _ in range(3))
    parameters = np.ascontiguousarray(start.parameters.T)
    state = start.front.copy(), start.v.copy()
    _drive(*state, parameters, lead.front, lead.v, dt, hardest, held, every, front, v, a)
    seen = Lead(lead.front[::every], lead.v[::every], lead.length)
    return Platoon(np.arange(kept, dtype=np.float64) * (every * dt), front.T, v.T, a.T, start.length, seen)


@njit(cache=True, nogil=True, fastmath={"contract", "arcp"}, error_model="numpy")
def _drive(
    x: FloatArray,
    v: FloatArray,
    parameters: FloatArray,
    lead_front: FloatArray,
    lead_v: FloatArray,
    dt: float,
    hardest: float,
    held: int,
    every: int,
    out_x: FloatArray,
    out_v: FloatArray,
    out_a: FloatArray,
) -> None:
    p = len(x)
    v_desire, A, b, B, tau, L = (
        parameters[0],
        parameters[1],
        parameters[2],
        parameters[3],
        parameters[4],
        parameters[5],
    )
    spacing, ahead_v, a = np.empty(p), np.empty(p), np.zeros(p)
    for k in range(len(lead_front)):
        if k >= held:
            spacing[0], ahead_v[0] = lead_front[k] - x[0], lead_v[k]
            for i in range(1, p):
                spacing[i], ahead_v[i] = x[i - 1] - x[i], v[i - 1]
            for i in range(p):
                a[i] = lcm_command(
                    v[i], spacing[i], ahead_v[i], v_desire[i], A[i], b[i], B[i], tau[i], L[i], hardest
                )
        if k % every == 0:
            row = k // every
            for i in range(p):
                out_x[row, i], out_v[row, i], out_a[row, i] = x[i], v[i], a[i]
        for i in range(p):
            x[i], v[i] = advance(x[i], v[i], a[i], dt)


def spacings(platoon: Platoon) -> FloatArray:
    """Spacing of each follower to the one in front, front to front [m], shape (p, n); infinite on a free road."""
    ahead = np.vstack([platoon.lead.front, platoon.front[:-1]])
    return np.asarray(ahead - platoon.front, dtype=np.float64)


def gaps(platoon: Platoon) -> FloatArray:
    """Gap of each follower, bumper to bumper [m], shape (p, n): negative = driven into the one in front."""
    ahead_length = np.concatenate([[platoon.lead.length], platoon.length[:-1]])
    bumpers: FloatArray = spacings(platoon) - ahead_length[:, None]
    return bumpers


def time_headways(platoon: Platoon) -> FloatArray:
    """Time headway = spacing / speed [s], shape (p, n); NaN below 0.1 m/s or on a free road."""
    spacing = spacings(platoon)
    known = np.isfinite(spacing) & (platoon.v > 0.1)
    return np.where(known, spacing / np.where(known, platoon.v, 1.0), np.nan)


def passing_times(platoon: Platoon, x: float) -> FloatArray:
    """When each front passes x [m], by straight lines between the instants [s], shape (p,).

    NaN where it does not pass within the run, or starts beyond x.
    """
    front = platoon.front
    after = np.argmax(front >= x, axis=1)
    rows = np.arange(len(front))
    passed = (front[:, -1] >= x) & (after > 0)
    before = np.maximum(after - 1, 0)
    step = front[rows, after] - front[rows, before]
    share = (x - front[rows, before]) / np.where(step > 0.0, step, 1.0)
    at = platoon.t[before] + share * (platoon.t[after] - platoon.t[before])
    return np.where(passed, at, np.nan)


def travel_time(platoon: Platoon, section: tuple[float, float]) -> float:
    """Total travel time of the followers over a section [s]; section: from x to x [m].

    NaN unless everybody drives through all of it: a part of the travel time says nothing.
    """
    entered, left = passing_times(platoon, section[0]), passing_times(platoon, section[1])
    return float(np.sum(left - entered))
