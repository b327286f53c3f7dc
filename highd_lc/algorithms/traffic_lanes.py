"""Compiled pieces of the traffic simulation: following, the wish and the room to change lane, the lateral path."""

import math

import numpy as np
from numba import njit

from highd_lc.algorithms.traffic_state import BROKEN_OFF, KEPT, RETURN, Record, Records, Road, Traffic
from highd_lc.core.lcm import lcm_acceleration

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
