"""Frozen containers of an event as arrays: what the planner reads and nothing else."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Motion:
    """A vehicle's motion on the time grid of a scene (t_k = k dt, k = 0 .. N) and its size.

    x, y: box centre relative to the ego's centre at t_start [m], shape (N + 1,); v: forward speed [m/s], shape
    (N + 1,); length, width [m]; observed: number of leading samples that were recorded, the rest is predicted.
    """

    x: FloatArray
    y: FloatArray
    v: FloatArray
    length: float
    width: float
    observed: int


@dataclass(frozen=True)
class Scene:
    """Everything the planner knows of one lane change, relative to the ego's box centre at t_start.

    v0: the ego's recorded speed at t_start [m/s]; lateral_shift: D, left positive [m]; length, width of the ego
    [m]; wheelbase [m]; dt [s]; target_leader, origin_leader: motions over 0 .. H, or None. Followers on the
    target lane, nearest first, by their states at t_start: follower_x, follower_y (box centres) [m],
    follower_v [m/s], follower_length, follower_width [m], each of shape (p,); follower_parameters: LCM of each,
    L already moved behind the AV (L_replay), shape (p, 6); leader_change_L: what to add to L_replay of the
    first follower when it stays behind the target leader [m]. origin_follower: x, y, v, length, width at
    t_start, shape (5,), empty if there is none. human_*: the ego's smoothed recorded motion over
    0 .. human_duration (a multiple of dt), shape (n + 1,).
    """

    event_id: str
    v0: float
    lateral_shift: float
    length: float
    width: float
    wheelbase: float
    dt: float
    target_leader: Motion | None
    origin_leader: Motion | None
    origin_follower: FloatArray
    follower_x: FloatArray
    follower_y: FloatArray
    follower_v: FloatArray
    follower_length: FloatArray
    follower_width: FloatArray
    follower_parameters: FloatArray
    first_follower_L: float
    human: dict[str, FloatArray] = field(default_factory=dict)
