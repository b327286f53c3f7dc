"""The wish and the room to change lane."""

import numpy as np
from numba import njit

from highd_lc.traffic.following import lcm_behind, needed_braking, wish_behind
from highd_lc.traffic.lanes import BROKEN_OFF, LCM_AT_ONCE, RETURN, Records, Road, Traffic, end_path, lay_path

_HARDEST_BRAKING = 3.0  # what a change may demand of the follower or of the driver [m/s^2]
_SMALLEST_GAP = 3.0  # room ahead and behind at the start of a change [m] ...
_SMALLEST_TIME_GAP = 0.2  # ... and more with speed [s]
_CLOSING_TIME_GAP = 0.6  # ... that drivers who do not react at once leave a vehicle that does not fall back [s]
_OPENING = 2.0  # by so much faster, a driver changes lane just ahead of another [m/s]
_HELD_UP = 0.1  # braking that a driver would not take for the right lane [m/s^2]
_PASSING = 2.0  # by so much faster than who is behind there a driver moves to the right [m/s]
_RETURN_SECONDS = 5.0


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
def may_follow(vehicles: Records, follower: int, leader: int, driver: int) -> bool:
    """Whether one vehicle could get behind another just now, in the eyes of the driver who changes lane.

    A driver who reacts at once asks its model for the braking. Others look at the gap and at the braking that
    avoids a contact, and change just ahead of a vehicle that they have passed.
    """
    behind, ahead, mine = vehicles[follower], vehicles[leader], vehicles[driver]
    gap = ahead.x - ahead.length - behind.x
    at_once = mine.model == LCM_AT_ONCE
    if at_once:
        if gap < _SMALLEST_GAP + _SMALLEST_TIME_GAP * behind.v:
            return False
        return lcm_behind(vehicles, follower, leader) >= -_HARDEST_BRAKING
    closing = behind.v - ahead.v
    if gap < _SMALLEST_GAP or (closing > -_OPENING and gap < _SMALLEST_GAP + _CLOSING_TIME_GAP * behind.v):
        return False
    return bool(needed_braking(gap, behind.v, ahead.v, ahead.a) <= mine.presses)


@njit(cache=True, nogil=True)
def wanted_lane(traffic: Traffic, road: Road, vehicle: int) -> int:
    """The adjacent lane that brings most acceleration, if that is enough and there is room; else -1."""
    vehicles, me = traffic.vehicles, traffic.vehicles[vehicle]
    now = me.a
    if me.model != LCM_AT_ONCE:
        now = wish_behind(vehicles, road, vehicle, neighbours(traffic, vehicle, me.lane)[0])
    best, most = -1, me.gain
    for side in (-1, 1):
        lane = me.lane + side
        if lane < 0 or lane > me.highest_lane:
            continue
        ahead, behind = neighbours(traffic, vehicle, lane)
        wish = wish_behind(vehicles, road, vehicle, ahead)
        gain = wish - now - side * me.keep_right
        if side < 0 and me.model != LCM_AT_ONCE:
            passed = behind < 0 or me.v > vehicles[behind].v + _PASSING
            gain = gain + me.gain if passed and wish >= -_HELD_UP else -np.inf
        elif me.model != LCM_AT_ONCE and behind >= 0 and me.v_desire < vehicles[behind].v:
            continue
        if gain <= most or (ahead >= 0 and not may_follow(vehicles, vehicle, ahead, vehicle)):
            continue
        if behind < 0 or may_follow(vehicles, behind, vehicle, vehicle):
            best, most = lane, gain
    return best


@njit(cache=True, nogil=True)
def may_return(traffic: Traffic, vehicle: int) -> bool:
    """Whether the lane that was left still has room."""
    ahead, behind = neighbours(traffic, vehicle, traffic.vehicles[vehicle].origin)
    if ahead >= 0 and not may_follow(traffic.vehicles, vehicle, ahead, vehicle):
        return False
    return behind < 0 or may_follow(traffic.vehicles, behind, vehicle, vehicle)


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
