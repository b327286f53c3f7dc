"""Compiled pieces of the traffic simulation: following, the wish and the room to change lane, lateral paths."""

import math

import numpy as np
from numba import njit

from highd_lc.algorithms.traffic_state import BROKEN_OFF, KEPT, RETURN, Drivers, FloatArray, Road, State
from highd_lc.core.lcm import lcm_acceleration

REFERENCE_LENGTH = 4.6
"""Length of the leader that a driver's L is meant for [m]; behind another, L moves with the leader's length."""

_HARDEST_BRAKING = 3.0  # what a change may demand of the follower or of the driver [m/s^2]
_SMALLEST_GAP = 3.0  # room ahead and behind at the start of a change [m] ...
_SMALLEST_TIME_GAP = 0.2  # ... and more with speed [s]
_KEEP_RIGHT = 0.1  # bonus of the right lane, malus of the left [m/s^2]
_BREAK_OFF_DEPTH = 0.35  # how far past the marking a change is broken off [m]
_LATERAL_THRESHOLD = 0.1  # lateral speed between whose passings a duration is meant [m/s]
_RETURN_SECONDS = 5.0


@njit(cache=True, nogil=True)
def lcm_behind(
    follower: int, leader: int, lcm: FloatArray, length: FloatArray, x: FloatArray, v: FloatArray
) -> float:
    """Acceleration [m/s^2] of one vehicle behind another; leader -1 is a free road.

    lcm: (N, 6); length, x (fronts) [m], v [m/s]: (N,).
    """
    spacing, v_leader, L = np.inf, 0.0, lcm[follower, 5]
    if leader >= 0:
        spacing = x[leader] - x[follower]
        v_leader = v[leader]
        L += length[leader] - REFERENCE_LENGTH
    return lcm_acceleration(
        v[follower],
        spacing,
        v_leader,
        lcm[follower, 0],
        lcm[follower, 1],
        lcm[follower, 2],
        lcm[follower, 3],
        lcm[follower, 4],
        L,
    )


@njit(cache=True, nogil=True)
def neighbours(vehicle: int, lane: int, state: State) -> tuple[int, int]:
    """The nearest vehicles on a lane ahead of a vehicle's front and not ahead of it; -1 where there is none."""
    ahead, behind = -1, -1
    for k in range(state.counts[0]):
        other = state.active[k]
        if other == vehicle or (state.lane[other] != lane and state.beside[other] != lane):
            continue
        if state.x[other] > state.x[vehicle]:
            ahead = other
        else:
            behind = other
            break
    return ahead, behind


@njit(cache=True, nogil=True)
def has_room(vehicle: int, lane: int, drivers: Drivers, state: State) -> bool:
    """Whether a vehicle may start to move to a lane: gaps, and the braking demanded of itself and behind."""
    ahead, behind = neighbours(vehicle, lane, state)
    if ahead >= 0:
        gap = state.x[ahead] - drivers.length[ahead] - state.x[vehicle]
        if gap < _SMALLEST_GAP + _SMALLEST_TIME_GAP * state.v[vehicle]:
            return False
        if lcm_behind(vehicle, ahead, drivers.lcm, drivers.length, state.x, state.v) < -_HARDEST_BRAKING:
            return False
    if behind >= 0:
        gap = state.x[vehicle] - drivers.length[vehicle] - state.x[behind]
        if gap < _SMALLEST_GAP + _SMALLEST_TIME_GAP * state.v[behind]:
            return False
        if lcm_behind(behind, vehicle, drivers.lcm, drivers.length, state.x, state.v) < -_HARDEST_BRAKING:
            return False
    return True


@njit(cache=True, nogil=True)
def wanted_lane(vehicle: int, drivers: Drivers, road: Road, state: State) -> int:
    """The adjacent lane that brings most acceleration, if that is enough and there is room; else -1."""
    lane = state.lane[vehicle]
    highest = min(drivers.highest_lane[vehicle], len(road.markings) - 2)
    best, most = -1, drivers.gain[vehicle]
    for side in (-1, 1):
        target = lane + side
        if target < 0 or target > highest:
            continue
        ahead, _ = neighbours(vehicle, target, state)
        gain = (
            lcm_behind(vehicle, ahead, drivers.lcm, drivers.length, state.x, state.v)
            - state.a[vehicle]
            - side * _KEEP_RIGHT
        )
        if gain > most and has_room(vehicle, target, drivers, state):
            best, most = target, gain
    return best


@njit(cache=True, nogil=True)
def lane_of(y: float, road: Road) -> int:
    """Lane that holds a lateral position, 0 = rightmost; -1 right of all, lanes left of all."""
    lane = -1
    for marking in road.markings:
        if y >= marking:
            lane += 1
    return lane


@njit(cache=True, nogil=True)
def full_duration(duration: float, shift: float) -> float:
    """Duration T [s] of the quintic over |shift| [m] whose speed is above 0.1 m/s for the given time [s].

    The speed 30 |D| u^2 (1 - u)^2 / T passes the threshold at u and 1 - u, so T (1 - 2 u) = duration; u falls
    with T slowly enough that iterating converges.
    """
    T = duration
    for _ in range(30):
        w = math.sqrt(min(_LATERAL_THRESHOLD * T / (30.0 * shift), 0.0624))
        T = duration / math.sqrt(1.0 - 4.0 * w)
    return T


@njit(cache=True, nogil=True)
def start_path(vehicle: int, target: float, seconds: float, time: float, state: State) -> None:
    """Lay the quintic from the present lateral state to rest at the target y [m] in the given time."""
    y, vy, ay = state.y[vehicle], state.vy[vehicle], state.ay[vehicle]
    T = seconds
    shift = target - y - vy * T - 0.5 * ay * T * T
    speed = -vy - ay * T
    path = state.path[vehicle]
    path[1], path[2], path[3] = time, time + T, T
    path[7], path[8], path[9] = y, vy, 0.5 * ay
    path[10] = (10.0 * shift - 4.0 * speed * T - 0.5 * ay * T * T) / T**3
    path[11] = (-15.0 * shift + 7.0 * speed * T + ay * T * T) / T**4
    path[12] = (6.0 * shift - 3.0 * speed * T - 0.5 * ay * T * T) / T**5


@njit(cache=True, nogil=True)
def begin_change(vehicle: int, lane: int, time: float, drivers: Drivers, road: Road, state: State) -> None:
    """Start a change to an adjacent lane."""
    k = state.changes[vehicle]
    centre = 0.5 * (road.markings[lane] + road.markings[lane + 1])
    target = centre + drivers.offset[vehicle, k + 1]
    seconds = full_duration(drivers.duration[vehicle, k], abs(target - state.y[vehicle]))
    start_path(vehicle, target, seconds, time, state)
    state.path[vehicle, 0] = vehicle
    state.path[vehicle, 4], state.path[vehicle, 5], state.path[vehicle, 6] = state.lane[vehicle], lane, KEPT
    state.beside[vehicle] = lane
    state.changes[vehicle] = k + 1


@njit(cache=True, nogil=True)
def log_path(vehicle: int, until: float, state: State, log: FloatArray) -> None:
    """Keep a path that ended, or was left, at the given time."""
    path = state.path[vehicle]
    path[2] = until
    for column in range(len(path)):
        log[state.counts[1], column] = path[column]
    state.counts[1] += 1
    path[2] = np.nan


@njit(cache=True, nogil=True)
def break_off(vehicle: int, time: float, drivers: Drivers, road: Road, state: State, log: FloatArray) -> None:
    """Turn back to the lane left, if there is still room, once the centre is well past the marking."""
    path = state.path[vehicle]
    origin, target = int(path[4]), int(path[5])
    marking = road.markings[max(origin, target)]
    if abs(state.y[vehicle] - marking) < _BREAK_OFF_DEPTH or not has_room(vehicle, origin, drivers, state):
        return
    path[6] = BROKEN_OFF
    log_path(vehicle, time, state, log)
    centre = 0.5 * (road.markings[origin] + road.markings[origin + 1])
    start_path(vehicle, centre + drivers.offset[vehicle, state.changes[vehicle] - 1], _RETURN_SECONDS, time, state)
    path[4], path[5], path[6] = target, origin, RETURN
    state.beside[vehicle] = origin


@njit(cache=True, nogil=True)
def follow_path(vehicle: int, time: float, road: Road, state: State) -> None:
    """Lateral state at a time on the path [s]; the lane when the centre is past the marking."""
    path = state.path[vehicle]
    t = min(time - path[1], path[3])
    c2, c3, c4, c5 = path[9], path[10], path[11], path[12]
    state.y[vehicle] = path[7] + t * (path[8] + t * (c2 + t * (c3 + t * (c4 + t * c5))))
    state.vy[vehicle] = path[8] + t * (2 * c2 + t * (3 * c3 + t * (4 * c4 + t * 5 * c5)))
    state.ay[vehicle] = 2 * c2 + t * (6 * c3 + t * (12 * c4 + t * 20 * c5))
    if state.beside[vehicle] >= 0 and lane_of(state.y[vehicle], road) == state.beside[vehicle]:
        state.lane[vehicle] = state.beside[vehicle]
        state.beside[vehicle] = -1
