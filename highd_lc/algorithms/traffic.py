"""Multi-lane traffic of LCM drivers on one carriageway, with lane changes on smooth lateral paths.

Every driver follows by the LCM (``core.lcm``) with parameters of its own. A driver considers to change lane at
times of its own and does so if that raises its LCM acceleration enough and neither it nor its new follower
would have to brake hard. Whoever changes lane watches the leaders of both lanes until its centre crosses the
marking; its new follower follows it from the start of the path or from the crossing, by choice. The lateral
path is a quintic polynomial from the present lateral state to the place in the target lane.
"""

import numpy as np
from numba import njit

from highd_lc.algorithms.traffic_drivers import MAX_CHANGES
from highd_lc.algorithms.traffic_lanes import (
    begin_change,
    break_off,
    follow_path,
    lcm_behind,
    log_path,
    wanted_lane,
)
from highd_lc.algorithms.traffic_state import (
    KEPT,
    PATH_WIDTH,
    ROW_COLUMNS,
    Clock,
    Drivers,
    FloatArray,
    Passage,
    Road,
    State,
    empty_state,
)

_LANE_CHANGE_FROM = 150.0  # nobody changes lane in the first metres after the entry [m]
_ROWS_A_BLOCK = 65536
_GENTLE_BRAKING = 0.5  # at most this much braking is asked of a vehicle as it enters [m/s^2]


def simulate(drivers: Drivers, road: Road, clock: Clock, *, react_from_start: bool) -> Passage:
    """Drive all vehicles through the carriageway and record what is in view, frame by frame.

    The state is recorded before the step that starts at it: position, speed and the acceleration commanded
    there belong to one instant. Semi-implicit Euler; all vehicles act on the states of the same instant.
    """
    state = empty_state(drivers, lanes=len(road.markings) - 1)
    log = np.empty((len(drivers.arrival) * (MAX_CHANGES + 1), PATH_WIDTH))
    blocks = []
    step, last_step = -clock.warm_up_steps, clock.frames * clock.steps_per_frame
    while step < last_step:
        block = np.empty((_ROWS_A_BLOCK, len(ROW_COLUMNS)))
        step, n = _advance(step, drivers, road, clock, state, block, log, react_from_start)
        blocks.append(block[:n])
    _log_unfinished(state, log)
    paths = log[: state.counts[1]]
    return Passage(np.concatenate(blocks), paths[np.argsort(paths[:, 1], kind="stable")])


@njit(cache=True, nogil=True)
def _advance(
    step: int,
    drivers: Drivers,
    road: Road,
    clock: Clock,
    state: State,
    rows: FloatArray,
    log: FloatArray,
    react_from_start: bool,
) -> tuple[int, int]:
    """Simulate until the end or until the rows might not hold another frame: (next step, rows written)."""
    n_rows = 0
    while step < clock.frames * clock.steps_per_frame and n_rows + state.counts[0] < len(rows):
        time = step * clock.dt
        _enter(time, drivers, road, state)
        _sort_downstream_first(state)
        _accelerate(drivers, road, state, react_from_start)
        if step >= 0 and step % clock.steps_per_frame == 0:
            n_rows = _record(step // clock.steps_per_frame, drivers, road, state, rows, n_rows)
        _steer(time, drivers, road, state, log)
        _move(time, clock.dt, road, state, log)
        step += 1
    return step, n_rows


def _log_unfinished(state: State, log: FloatArray) -> None:
    for vehicle in state.active[: state.counts[0]]:
        if not np.isnan(state.path[vehicle, 2]):
            log_path(vehicle, state.path[vehicle, 2], state, log)


@njit(cache=True, nogil=True)
def _enter(time: float, drivers: Drivers, road: Road, state: State) -> None:
    """Let the next vehicle of each lane in as soon as it has arrived and the lane has room for it."""
    for lane in range(len(road.markings) - 1):
        new = state.waiting[lane]
        if new >= drivers.lane_first[lane + 1] or drivers.arrival[new] > time:
            continue
        last = -1
        for k in range(state.counts[0]):
            if state.lane[state.active[k]] == lane or state.beside[state.active[k]] == lane:
                last = state.active[k]
        state.x[new] = -road.upstream
        state.v[new] = 0.93 * drivers.lcm[new, 0]
        if last >= 0 and lcm_behind(new, last, drivers.lcm, drivers.length, state.x, state.v) < -_GENTLE_BRAKING:
            state.v[new] = min(state.v[new], state.v[last])
            if lcm_behind(new, last, drivers.lcm, drivers.length, state.x, state.v) < -_GENTLE_BRAKING:
                continue
        state.lane[new] = lane
        state.y[new] = 0.5 * (road.markings[lane] + road.markings[lane + 1]) + drivers.offset[new, 0]
        state.active[state.counts[0]] = new
        state.counts[0] += 1
        state.waiting[lane] += 1


@njit(cache=True, nogil=True)
def _sort_downstream_first(state: State) -> None:
    """Insertion sort: the order hardly changes from step to step."""
    for k in range(1, state.counts[0]):
        vehicle = state.active[k]
        j = k
        while j > 0 and state.x[state.active[j - 1]] < state.x[vehicle]:
            state.active[j] = state.active[j - 1]
            j -= 1
        state.active[j] = vehicle


@njit(cache=True, nogil=True)
def _accelerate(drivers: Drivers, road: Road, state: State, react_from_start: bool) -> None:
    """LCM behind the last vehicle met on each lane, from downstream on; the harder braking of two lanes."""
    last = state.last
    for lane in range(len(last)):
        last[lane] = -1
    for k in range(state.counts[0]):
        vehicle = state.active[k]
        lane, beside = state.lane[vehicle], state.beside[vehicle]
        a = lcm_behind(vehicle, last[lane], drivers.lcm, drivers.length, state.x, state.v)
        if beside >= 0:
            a = min(a, lcm_behind(vehicle, last[beside], drivers.lcm, drivers.length, state.x, state.v))
            if react_from_start:
                last[beside] = vehicle
        state.a[vehicle] = a
        last[lane] = vehicle


@njit(cache=True, nogil=True)
def _record(frame: int, drivers: Drivers, road: Road, state: State, rows: FloatArray, n_rows: int) -> int:
    """Write the vehicles whose centre is in view; returns the number of rows written so far."""
    for k in range(state.counts[0]):
        vehicle = state.active[k]
        centre = state.x[vehicle] - 0.5 * drivers.length[vehicle]
        if 0.0 <= centre <= road.section:
            row = rows[n_rows]
            row[0], row[1], row[2] = vehicle, frame, centre
            row[3], row[4] = state.v[vehicle], state.a[vehicle]
            row[5], row[6], row[7] = state.y[vehicle], state.vy[vehicle], state.ay[vehicle]
            n_rows += 1
    return n_rows


@njit(cache=True, nogil=True)
def _steer(time: float, drivers: Drivers, road: Road, state: State, log: FloatArray) -> None:
    """Begin changes that are due and pay, break off those that are meant to be."""
    for k in range(state.counts[0]):
        vehicle = state.active[k]
        if state.path[vehicle, 2] == state.path[vehicle, 2]:
            meant = drivers.breaks_off[vehicle, state.changes[vehicle] - 1]
            if meant and state.beside[vehicle] < 0 and state.path[vehicle, 6] == KEPT:
                break_off(vehicle, time, drivers, road, state, log)
        elif time >= state.look[vehicle]:
            state.look[vehicle] += drivers.look_every[vehicle]
            if state.changes[vehicle] < MAX_CHANGES and state.x[vehicle] > _LANE_CHANGE_FROM - road.upstream:
                lane = wanted_lane(vehicle, drivers, road, state)
                if lane >= 0:
                    begin_change(vehicle, lane, time, drivers, road, state)
        if state.path[vehicle, 2] <= time:
            log_path(vehicle, state.path[vehicle, 2], state, log)
            state.look[vehicle] = time + drivers.pause[vehicle, state.changes[vehicle] - 1]


@njit(cache=True, nogil=True)
def _move(time: float, dt: float, road: Road, state: State, log: FloatArray) -> None:
    """One step; vehicles past the end of the road leave."""
    kept = 0
    for k in range(state.counts[0]):
        vehicle = state.active[k]
        state.v[vehicle] = max(state.v[vehicle] + state.a[vehicle] * dt, 0.0)
        state.x[vehicle] += state.v[vehicle] * dt
        if state.path[vehicle, 2] == state.path[vehicle, 2]:
            follow_path(vehicle, time + dt, road, state)
        if state.x[vehicle] <= road.section + road.downstream:
            state.active[kept] = vehicle
            kept += 1
        elif state.path[vehicle, 2] == state.path[vehicle, 2]:
            log_path(vehicle, state.path[vehicle, 2], state, log)
    state.counts[0] = kept
