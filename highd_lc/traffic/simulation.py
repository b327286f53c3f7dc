"""Multi-lane traffic on one carriageway, with lane changes on smooth lateral paths.

Every driver follows by a model and in a manner of its own (``following``). A driver considers to change lane at
times of its own and does so if that raises its model's acceleration enough and neither it nor its new follower
would have to brake hard (``wanted_lane``). Drivers that react at once watch the leaders of both lanes until their
centre crosses the marking, and follow who changes in front of them from the start of the path on, as the planner
assumes; others follow the leader of the lane that they move to. The lateral path is a quintic polynomial from the
present lateral state to the place in the target lane.
"""

import numpy as np

from highd_lc.core.kernels import kernel
from highd_lc.traffic.following import common_speed, drive, lcm_behind, needed_braking, wish_behind
from highd_lc.traffic.lanes import (
    BROKEN_OFF,
    KEPT,
    LCM_AT_ONCE,
    LOGGED,
    MAX_CHANGES,
    NOBODY,
    PRESENT,
    RETURN,
    ROW_COLUMNS,
    Clock,
    Drivers,
    FloatArray,
    Passage,
    Records,
    Road,
    Traffic,
    begin_change,
    empty_traffic,
    end_path,
    follow_path,
    lay_path,
)

_LANE_CHANGE_FROM = 150.0  # nobody changes lane in the first metres after the entry [m]
_GENTLE_BRAKING = 0.5  # at most this much braking is asked of a vehicle as it enters [m/s^2]
_ENTRY_SPEED = 0.93  # speed on entering a free road, as a share of the desired one
_ROWS_A_BLOCK = 65536


def simulate(drivers: Drivers, road: Road, clock: Clock) -> Passage:
    """Drive all vehicles through the carriageway and record what is in view, frame by frame.

    The state is recorded before the step that starts at it: position, speed and the acceleration commanded
    there belong to one instant. Semi-implicit Euler; all vehicles act on the states of the same instant.
    """
    traffic = empty_traffic(drivers)
    blocks = []
    step, last_step = -clock.warm_up_steps, clock.frames * clock.steps_per_frame
    while step < last_step:
        block = np.empty((_ROWS_A_BLOCK, len(ROW_COLUMNS)))
        step, n = _advance(step, traffic, road, clock, block)
        blocks.append(block[:n])
    for vehicle in traffic.order[: traffic.counts[PRESENT]]:
        if traffic.vehicles[vehicle]["moving"]:
            me = traffic.vehicles[vehicle]
            end_path(traffic, vehicle, me["start"] + me["seconds"])
    paths = traffic.log[: traffic.counts[LOGGED]]
    return Passage(np.concatenate(blocks), paths[np.argsort(paths["start"], kind="stable")])


@kernel()
def _advance(step: int, traffic: Traffic, road: Road, clock: Clock, rows: FloatArray) -> tuple[int, int]:
    """Simulate until the end or until the rows might not hold another frame: (next step, rows written)."""
    n_rows = 0
    while step < clock.frames * clock.steps_per_frame and n_rows + traffic.counts[PRESENT] < len(rows):
        time = step * clock.dt
        _enter(traffic, road, time)
        _sort_downstream_first(traffic)
        _accelerate(traffic, road, time)
        if step >= 0 and step % clock.steps_per_frame == 0:
            n_rows = _record(traffic, road, step // clock.steps_per_frame, rows, n_rows)
        _steer(traffic, road, time)
        _move(traffic, road, time, clock.dt)
        step += 1
    return step, n_rows


@kernel()
def _enter(traffic: Traffic, road: Road, time: float) -> None:
    """Let the next vehicle of each lane in as soon as it has arrived and the lane has room for it."""
    vehicles, order = traffic.vehicles, traffic.order
    for lane in range(len(traffic.waiting)):
        new = traffic.waiting[lane]
        if new >= traffic.lane_first[lane + 1] or vehicles[new].arrival > time:
            continue
        last = -1
        for k in range(traffic.counts[PRESENT]):
            if vehicles[order[k]].lane == lane or vehicles[order[k]].beside == lane:
                last = order[k]
        me = vehicles[new]
        me.x = -road.upstream
        me.v = _ENTRY_SPEED * me.v_desire + common_speed(me.x, road)
        if last >= 0 and wish_behind(vehicles, road, new, last) < -_GENTLE_BRAKING:
            me.v = min(me.v, vehicles[last].v)
            if wish_behind(vehicles, road, new, last) < -_GENTLE_BRAKING:
                continue
        me.lane, me.beside = lane, -1
        me.y = 0.5 * (road.markings[lane] + road.markings[lane + 1]) + me.offset[0]
        order[traffic.counts[PRESENT]] = new
        traffic.counts[PRESENT] += 1
        traffic.waiting[lane] += 1


@kernel()
def _sort_downstream_first(traffic: Traffic) -> None:
    """Insertion sort: the order hardly changes from step to step."""
    vehicles, order = traffic.vehicles, traffic.order
    for k in range(1, traffic.counts[PRESENT]):
        vehicle = order[k]
        j = k
        while j > 0 and vehicles[order[j - 1]].x < vehicles[vehicle].x:
            order[j] = order[j - 1]
            j -= 1
        order[j] = vehicle


@kernel()
def _accelerate(traffic: Traffic, road: Road, time: float) -> None:
    """Every driver's acceleration, from downstream on; at once: the LCM's harder braking of two lanes."""
    vehicles, order, last = traffic.vehicles, traffic.order, traffic.last
    for lane in range(len(last)):
        last[lane] = NOBODY
    for k in range(traffic.counts[PRESENT]):
        me = vehicles[order[k]]
        if me.model == LCM_AT_ONCE:
            ahead = last[me.lane]
            me.a = lcm_behind(vehicles, order[k], order[ahead] if ahead >= 0 else NOBODY)
            if me.beside >= 0:
                ahead = last[me.beside]
                me.a = min(me.a, lcm_behind(vehicles, order[k], order[ahead] if ahead >= 0 else NOBODY))
        else:
            me.a = drive(vehicles, order, last, road, k, time)
        last[me.lane] = k
        if me.beside >= 0:
            last[me.beside] = k


@kernel()
def _record(traffic: Traffic, road: Road, frame: int, rows: FloatArray, n_rows: int) -> int:
    """Write the vehicles whose centre is in view; returns the number of rows written so far."""
    for k in range(traffic.counts[PRESENT]):
        me = traffic.vehicles[traffic.order[k]]
        centre = me.x - 0.5 * me.length
        if 0.0 <= centre <= road.section:
            rows[n_rows, 0], rows[n_rows, 1], rows[n_rows, 2] = traffic.order[k], frame, centre
            rows[n_rows, 3], rows[n_rows, 4] = me.v, me.a
            rows[n_rows, 5], rows[n_rows, 6], rows[n_rows, 7] = me.y, me.vy, me.ay
            n_rows += 1
    return n_rows


@kernel()
def _steer(traffic: Traffic, road: Road, time: float) -> None:
    """Begin changes that are due and pay, break off those that are meant to be, end those that are done."""
    for k in range(traffic.counts[PRESENT]):
        vehicle = traffic.order[k]
        me = traffic.vehicles[vehicle]
        if me.moving:
            if time >= me.start + me.seconds:
                end_path(traffic, vehicle, me.start + me.seconds)
                me.look = time + me.pause[me.changes - 1]
            elif me.kind == KEPT and me.beside < 0 and me.breaks_off[me.changes - 1]:
                break_off(traffic, road, vehicle, time)
        elif time >= me.look:
            me.look += me.look_every
            if me.changes < MAX_CHANGES and me.x > _LANE_CHANGE_FROM - road.upstream:
                lane = wanted_lane(traffic, road, vehicle)
                if lane >= 0:
                    begin_change(me, road, lane, time)


@kernel()
def _move(traffic: Traffic, road: Road, time: float, dt: float) -> None:
    """One step; vehicles past the end of the road leave."""
    kept = 0
    for k in range(traffic.counts[PRESENT]):
        vehicle = traffic.order[k]
        me = traffic.vehicles[vehicle]
        me.v = max(me.v + me.a * dt, 0.0)
        me.x += me.v * dt
        if me.moving:
            follow_path(me, road, time + dt)
        if me.x <= road.section + road.downstream:
            traffic.order[kept] = vehicle
            kept += 1
        elif me.moving:
            end_path(traffic, vehicle, me.start + me.seconds)
    traffic.counts[PRESENT] = kept


_HARDEST_BRAKING = 3.0  # what a change may demand of the follower or of the driver [m/s^2]
_SMALLEST_GAP = 3.0  # room ahead and behind at the start of a change [m] ...
_SMALLEST_TIME_GAP = 0.2  # ... and more with speed [s]
_CLOSING_TIME_GAP = 0.6  # ... that drivers who do not react at once leave a vehicle that does not fall back [s]
_OPENING = 2.0  # by so much faster, a driver changes lane just ahead of another [m/s]
_HELD_UP = 0.1  # braking that a driver would not take for the right lane [m/s^2]
_PASSING = 2.0  # by so much faster than who is behind there a driver moves to the right [m/s]
_RETURN_SECONDS = 5.0


@kernel()
def neighbours(traffic: Traffic, vehicle: int, lane: int) -> tuple[int, int]:
    """The nearest vehicles on a lane ahead of a vehicle's front and not ahead of it; -1 where there is none."""
    vehicles, order = traffic.vehicles, traffic.order
    ahead = -1
    for k in range(traffic.counts[PRESENT]):
        other = order[k]
        if other == vehicle or (vehicles[other].lane != lane and vehicles[other].beside != lane):
            continue
        if vehicles[other].x <= vehicles[vehicle].x:
            return ahead, other
        ahead = other
    return ahead, -1


@kernel()
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


@kernel()
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


@kernel()
def may_return(traffic: Traffic, vehicle: int) -> bool:
    """Whether the lane that was left still has room."""
    ahead, behind = neighbours(traffic, vehicle, traffic.vehicles[vehicle].origin)
    if ahead >= 0 and not may_follow(traffic.vehicles, vehicle, ahead, vehicle):
        return False
    return behind < 0 or may_follow(traffic.vehicles, behind, vehicle, vehicle)


@kernel()
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
