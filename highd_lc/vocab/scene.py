"""Frozen containers of an event as arrays: what the planner reads and nothing else."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """A vehicle's motion on the time grid of a scene, t_k = k dt, k = 0 .. N, and its size.

    x, y: box centre relative to the ego's centre at t_start [m]; v: forward speed [m/s]; a: forward
    acceleration [m/s^2]; all of shape (N + 1,). length, width [m]; observed: number of leading samples that
    were recorded, the rest is predicted.
    """

    x: FloatArray
    y: FloatArray
    v: FloatArray
    a: FloatArray
    length: float
    width: float
    observed: int


@dataclass(frozen=True)
class NextLeader:
    """Who leads the target lane from sample ``since`` on, after the leader before left it; None = nobody."""

    since: int
    motion: Motion | None


@dataclass(frozen=True)
class Human:
    """The ego's recorded motion on the time grid as long as it is in view, at least to T = duration, smoothed.

    x, y: box centre relative to t_start [m]; vx, vy [m/s]; ax, ay [m/s^2]; jx, jy [m/s^3]; all of shape
    (n + 1,). crossing: sample of the lane crossing. comfort_raw: jerk sum of the recorded accelerations over
    0 .. T, unsmoothed [m/s^3]. end: sample of T; None = the last one.
    """

    x: FloatArray
    y: FloatArray
    vx: FloatArray
    vy: FloatArray
    ax: FloatArray
    ay: FloatArray
    jx: FloatArray
    jy: FloatArray
    crossing: int
    comfort_raw: float
    end: int | None = None


@dataclass(frozen=True)
class Followers:
    """The p followers on the target lane at t_start, nearest first.

    x, y: box centres relative to the ego's centre [m], v: speed [m/s], length, width [m], each of shape (p,).
    parameters: LCM of each with L moved behind the AV (L_replay), shape (p, 6). L_no_change: L of the first
    one when it stays behind the target leader [m]. recorded: their recorded motions where in view. spread:
    standard deviation of each parameter, 0 where unknown, shape (p, 6); None: of none.
    """

    x: FloatArray
    y: FloatArray
    v: FloatArray
    length: FloatArray
    width: FloatArray
    parameters: FloatArray
    L_no_change: float
    recorded: tuple[Motion, ...]
    spread: FloatArray | None = None


@dataclass(frozen=True)
class Scene:
    """Everything the planner knows of one lane change, relative to the ego's box centre at t_start.

    v0: the ego's recorded speed at t_start [m/s]; a0: its recorded acceleration [m/s^2]; lateral_shift: D,
    left positive [m]; length, width, wheelbase of the ego [m]; dt: step of the time grid [s]; target_leader,
    origin_leader, origin_follower: motions over 0 .. H, or None (the origin follower's matter at t_start).
    next_leaders: who leads the target lane when the target leader has left it, in the order of time.
    """

    event_id: str
    v0: float
    a0: float
    lateral_shift: float
    length: float
    width: float
    wheelbase: float
    dt: float
    target_leader: Motion | None
    origin_leader: Motion | None
    origin_follower: Motion | None
    followers: Followers
    human: Human
    next_leaders: tuple[NextLeader, ...] = ()
