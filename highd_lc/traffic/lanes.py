"""Compiled pieces of the traffic simulation: following, the wish and the room to change lane, the lateral path.

Containers of the traffic simulation: one carriageway, its vehicles, its clock, and what comes out.

Frame of a carriageway: x along travel from the entry end of the section in view, y left from the right edge,
lanes numbered from 0 = rightmost. Vehicles are records and the rest named tuples because the compiled kernels
take those, and a few arguments compile much faster than many arrays.
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.core.lcm import lcm_acceleration

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
Records = NDArray[Any]
Record = Any  # one of Records: compiled code reads its fields as attributes

MAX_CHANGES = 6
"""Lane changes that a vehicle may begin on its way."""

KEPT, BROKEN_OFF, RETURN = 0, 1, 2
"""Kinds of a lateral path: kept to its end; broken off after the crossing; the way back from there."""

VEHICLE = np.dtype(
    [
        # Drawn once. L is meant for a leader of REFERENCE_LENGTH. gain: what a change must bring [m/s^2];
        # look_every: how often one is considered [s]; depth: how far past the marking one is broken off [m];
        # per change: duration with lateral speed above 0.1 m/s, pause until the next [s], breaks_off; offset:
        # place in the lane before each and after the last [m].
        *((name, "f8") for name in ("v_desire", "A", "b", "B", "tau", "L")),
        *((name, "f8") for name in ("length", "width", "arrival", "gain", "look_every", "depth")),
        *((name, "i8") for name in ("truck", "highest_lane")),
        *((name, "f8", (MAX_CHANGES,)) for name in ("duration", "pause")),
        ("breaks_off", "i8", (MAX_CHANGES,)),
        ("offset", "f8", (MAX_CHANGES + 1,)),
        # State. x: front [m]; v, a: forward; y, vy, ay: lateral, of the centre; look: when a change is
        # considered next [s]; lane: that of the centre; beside: the second lane taken in a change, else -1;
        # changes: paths begun; moving: whether on a path.
        *((name, "f8") for name in ("x", "v", "a", "y", "vy", "ay", "look")),
        *((name, "i8") for name in ("lane", "beside", "changes", "moving")),
        # The present path y(t - start) = c0 + c1 t + .. + c5 t^5 over seconds.
        *((name, "f8") for name in ("start", "seconds")),
        *((name, "i8") for name in ("origin", "target", "kind")),
        ("c", "f8", (6,)),
    ],
    align=True,
)

PATH = np.dtype(
    [
        ("vehicle", "i8"),
        *((name, "f8") for name in ("start", "until", "seconds")),
        *((name, "i8") for name in ("origin", "target", "kind")),
        ("c", "f8", (6,)),
    ],
    align=True,
)
"""A lateral path as it was driven from start until until; seconds: how long it was meant to take."""

ROW_COLUMNS = ("vehicle", "frame", "x", "v", "a", "y", "vy", "ay")
"""Columns of ``Passage.rows``: index of the vehicle, frame from 0, box centre and its derivatives."""


class Road(NamedTuple):
    """A carriageway. markings: y of the lane markings from the right, 0 first [m], shape (lanes + 1,);
    upstream, section, downstream: length before, in and after the view [m]."""

    markings: FloatArray
    upstream: float
    section: float
    downstream: float


class Clock(NamedTuple):
    """Time of a simulation: step [s], steps a frame, steps before the first frame (t = 0), frames."""

    dt: float
    steps_per_frame: int
    warm_up_steps: int
    frames: int


@dataclass(frozen=True)
class Drivers:
    """Everything drawn about N vehicles, lane by lane of entry, in the order of their arrival.

    vehicles: records ``VEHICLE`` with the state at 0; lane_first: each lane's first, shape (lanes + 1,). sway:
    unit lane-keeping motion, error: unit tracking errors in x and y, as (angular frequency [rad/s], phase [rad])
    of K equal sines, shapes (N, K, 2) and (N, 2, K, 2).
    """

    vehicles: Records
    lane_first: IntArray
    sway: FloatArray
    error: FloatArray


class Traffic(NamedTuple):
    """The simulation, changed in place. vehicles: records ``VEHICLE``; order: those on the road, downstream
    first; counts: vehicles on the road, paths logged; waiting, lane_first: next vehicle to enter each lane and
    the lanes' first ones; last: scratch, a vehicle a lane; log: paths left, records ``PATH``."""

    vehicles: Records
    order: IntArray
    counts: IntArray
    waiting: IntArray
    lane_first: IntArray
    last: IntArray
    log: Records


class Passage(NamedTuple):
    """What passed the view. rows: frame by frame, downstream first, columns ``ROW_COLUMNS``; paths: records
    ``PATH`` in the order of their start."""

    rows: FloatArray
    paths: Records


def empty_traffic(drivers: Drivers) -> Traffic:
    """The state before anybody has entered."""
    n, lanes = len(drivers.vehicles), len(drivers.lane_first) - 1
    return Traffic(
        vehicles=drivers.vehicles.copy(),
        order=np.zeros(n, np.int64),
        counts=np.zeros(2, np.int64),
        waiting=drivers.lane_first[:-1].copy(),
        lane_first=drivers.lane_first,
        last=np.zeros(lanes, np.int64),
        log=np.zeros(n * (MAX_CHANGES + 1), PATH),
    )


REFERENCE_LENGTH = 4.6
"""Leader's length that a driver's L is meant for [m]; behind another, L moves with the leader's length."""

_HARDEST_BRAKING = 3.0  # what a change may demand of the follower or of the driver [m/s^2]
_SMALLEST_GAP = 3.0  # room ahead and behind at the start of a change [m] ...
_SMALLEST_TIME_GAP = 0.2  # ... and more with speed [s]
_KEEP_RIGHT = 0.1  # bonus of the right lane, malus of the left [m/s^2]
_RETURN_SECONDS = 5.0
_LATERAL_THRESHOLD = 0.1  # lateral speed between whose passings a duration is meant [m/s]


@njit(cache=True, nogil=True)
def lcm_behind(vehicles: Records, follower: int, leader: int) -> float:
    """Acceleration [m/s^2] of one vehicle behind another; leader -1 is a free road."""
    me = vehicles[follower]
    spacing, v_leader, L = np.inf, 0.0, me.L
    if leader >= 0:
        spacing = vehicles[leader].x - me.x
        v_leader = vehicles[leader].v
        L += vehicles[leader].length - REFERENCE_LENGTH
    return lcm_acceleration(me.v, spacing, v_leader, me.v_desire, me.A, me.b, me.B, me.tau, L)


@njit(cache=True, nogil=True)
def neighbours(traffic: Traffic, vehicle: int, lane: int) -> tuple[int, int]:
    """The nearest vehicles on a lane ahead of a vehicle's front and not ahead of it; -1 where there is none."""
    vehicles, order = traffic.vehicles, traffic.order
    ahead = -1
    for k in range(traffic.counts[0]):
        other = order[k]
        if other == vehicle or (vehicles[other].lane != lane and vehicles[other].beside != lane):
            continue
        if vehicles[other].x <= vehicles[vehicle].x:
            return ahead, other
        ahead = other
    return ahead, -1


@njit(cache=True, nogil=True)
def may_follow(vehicles: Records, follower: int, leader: int) -> bool:
    """Whether one vehicle could get behind another just now: the gap, and the braking that it demands."""
    gap = vehicles[leader].x - vehicles[leader].length - vehicles[follower].x
    if gap < _SMALLEST_GAP + _SMALLEST_TIME_GAP * vehicles[follower].v:
        return False
    return lcm_behind(vehicles, follower, leader) >= -_HARDEST_BRAKING


@njit(cache=True, nogil=True)
def wanted_lane(traffic: Traffic, road: Road, vehicle: int) -> int:
    """The adjacent lane that brings most acceleration, if that is enough and there is room; else -1."""
    me = traffic.vehicles[vehicle]
    best, most = -1, me.gain
    for side in (-1, 1):
        lane = me.lane + side
        if lane < 0 or lane > me.highest_lane:
            continue
        ahead, behind = neighbours(traffic, vehicle, lane)
        gain = lcm_behind(traffic.vehicles, vehicle, ahead) - me.a - side * _KEEP_RIGHT
        if gain <= most or (ahead >= 0 and not may_follow(traffic.vehicles, vehicle, ahead)):
            continue
        if behind < 0 or may_follow(traffic.vehicles, behind, vehicle):
            best, most = lane, gain
    return best


@njit(cache=True, nogil=True)
def may_return(traffic: Traffic, vehicle: int) -> bool:
    """Whether the lane that was left still has room."""
    ahead, behind = neighbours(traffic, vehicle, traffic.vehicles[vehicle].origin)
    if ahead >= 0 and not may_follow(traffic.vehicles, vehicle, ahead):
        return False
    return behind < 0 or may_follow(traffic.vehicles, behind, vehicle)


@njit(cache=True, nogil=True)
def full_duration(duration: float, shift: float) -> float:
    """Duration T [s] of the quintic over |shift| [m] whose speed is above 0.1 m/s for the given time [s].

    The speed 30 |D| u^2 (1 - u)^2 / T passes the threshold at u and 1 - u, so T (1 - 2 u) = duration; u falls
    with T slowly enough that iterating converges.
    """
    T = duration
    for _ in range(30):
        w = math.sqrt(min(_LATERAL_THRESHOLD * T / (30.0 * shift), 0.06))
        T = duration / math.sqrt(1.0 - 4.0 * w)
    return T


@njit(cache=True, nogil=True)
def lay_path(me: Record, target: float, seconds: float, time: float) -> None:
    """Lay the quintic from a vehicle's present lateral state to rest at the target y [m] in the given time."""
    T = seconds
    shift = target - me.y - me.vy * T - 0.5 * me.ay * T * T
    speed = -me.vy - me.ay * T
    me.start, me.seconds, me.moving = time, T, 1
    me.c[0], me.c[1], me.c[2] = me.y, me.vy, 0.5 * me.ay
    me.c[3] = (10.0 * shift - 4.0 * speed * T - 0.5 * me.ay * T * T) / T**3
    me.c[4] = (-15.0 * shift + 7.0 * speed * T + me.ay * T * T) / T**4
    me.c[5] = (6.0 * shift - 3.0 * speed * T - 0.5 * me.ay * T * T) / T**5


@njit(cache=True, nogil=True)
def begin_change(me: Record, road: Road, lane: int, time: float) -> None:
    """Start a change to an adjacent lane."""
    target = 0.5 * (road.markings[lane] + road.markings[lane + 1]) + me.offset[me.changes + 1]
    lay_path(me, target, full_duration(me.duration[me.changes], abs(target - me.y)), time)
    me.origin, me.target, me.kind = me.lane, lane, KEPT
    me.beside = lane
    me.changes += 1


@njit(cache=True, nogil=True)
def end_path(traffic: Traffic, vehicle: int, until: float) -> None:
    """Log a path that ended, or was left, at the given time."""
    me, entry = traffic.vehicles[vehicle], traffic.log[traffic.counts[1]]
    entry.vehicle, entry.start, entry.until, entry.seconds = vehicle, me.start, until, me.seconds
    entry.origin, entry.target, entry.kind = me.origin, me.target, me.kind
    for k in range(6):
        entry.c[k] = me.c[k]
    traffic.counts[1] += 1
    me.moving = 0


@njit(cache=True, nogil=True)
def break_off(traffic: Traffic, road: Road, vehicle: int, time: float) -> None:
    """Turn back to the lane left, if there is still room, once the centre is well past the marking."""
    me = traffic.vehicles[vehicle]
    origin, target = me.origin, me.target
    past = abs(me.y - road.markings[max(origin, target)])
    if past < me.depth or not may_return(traffic, vehicle):
        return
    me.kind = BROKEN_OFF
    end_path(traffic, vehicle, time)
    centre = 0.5 * (road.markings[origin] + road.markings[origin + 1])
    lay_path(me, centre + me.offset[me.changes - 1], _RETURN_SECONDS, time)
    me.origin, me.target, me.kind = target, origin, RETURN
    me.beside = origin


@njit(cache=True, nogil=True)
def follow_path(me: Record, road: Road, time: float) -> None:
    """Move to the lateral state at a time on the path [s]; change lane when the centre is past the marking."""
    t = min(time - me.start, me.seconds)
    c0, c1, c2, c3, c4, c5 = me.c[0], me.c[1], me.c[2], me.c[3], me.c[4], me.c[5]
    me.y = c0 + t * (c1 + t * (c2 + t * (c3 + t * (c4 + t * c5))))
    me.vy = c1 + t * (2 * c2 + t * (3 * c3 + t * (4 * c4 + t * 5 * c5)))
    me.ay = 2 * c2 + t * (6 * c3 + t * (12 * c4 + t * 20 * c5))
    if me.beside >= 0:
        past = me.y - road.markings[max(me.origin, me.target)]
        if past * (me.target - me.origin) >= 0:
            me.lane, me.beside = me.beside, -1
