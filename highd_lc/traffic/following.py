"""How a driver follows: LCM or IDM, at once or with memory, relaxation and a moment of reaction.

A driver that is not at once intends a = m a_0 + (1 - m) a_model with m = exp(-t / memory): t since a vehicle began
to come in, or the leader changed without that; a_0 what it intended then. What it lost in spacing and in the
leader's speed as it minded the new leader is given back to the model and fades linearly over the relaxation (Keane
and Gao, Transportation Research C, 2021). Need overrides both, with the true spacing.
"""

import math

import numpy as np

from highd_lc.core.kernels import kernel
from highd_lc.core.lcm import IdmParameters, desired_spacing, idm_acceleration, lcm_acceleration
from highd_lc.traffic.lanes import (
    IDM,
    LCM_AT_ONCE,
    NOBODY,
    REFERENCE_LENGTH,
    SINES,
    UNKNOWN,
    IntArray,
    Record,
    Records,
    Road,
)

HARDEST_BRAKING = 9.0
"""What a dry road allows [m/s^2]."""
NEED = 1.5
"""Braking that avoids a contact from which on nothing else counts [m/s^2]; it begins to count at half of it."""
DRIFT_SPEED = 28.0
"""Speed at which the acceleration in common is the drift [m/s]; it is proportional to speed."""

_STANDSTILL = 2.0  # gap that an emergency leaves [m] ...
_LEAST_TIME_GAP = 0.15  # ... and more with speed [s]
_OPENING = 0.5  # by so much slower than its leader a driver gets away from it [m/s]
_END_CLOSING = 1 / 3  # shortest time in which a closing speed is braked away [s]
_DRIFTING_BEYOND = 100.0  # before and after the view in which the drift acts as well [m]
_DESIRED = 3.0  # no jump is relaxed beyond so many desired spacings
_SEES_BESIDE = 60.0  # spacing within which room is made for a vehicle that is about to come in [m]
_MEMORIES = 5.0  # nothing is remembered after so many memories


@kernel()
def lcm_behind(vehicles: Records, follower: int, leader: int) -> float:
    """Acceleration [m/s^2] of one vehicle behind another; leader -1 is a free road."""
    me = vehicles[follower]
    spacing, v_leader, L = np.inf, 0.0, me.L
    if leader >= 0:
        spacing = vehicles[leader].x - me.x
        v_leader = vehicles[leader].v
        L += vehicles[leader].length - REFERENCE_LENGTH
    return lcm_acceleration(me.v, spacing, v_leader, me.v_desire, me.A, me.b, me.B, me.tau, L)


@kernel()
def common_speed(x: float, road: Road) -> float:
    """Speed [m/s] that all vehicles at a place have gained by the drift; 0 in the middle of the view."""
    reach = 0.5 * road.section + _DRIFTING_BEYOND
    return road.drift / DRIFT_SPEED * min(max(x - 0.5 * road.section, -reach), reach)


@kernel()
def _common_acceleration(x: float, v: float, road: Road) -> float:
    inside = -_DRIFTING_BEYOND < x < road.section + _DRIFTING_BEYOND
    return road.drift * v / DRIFT_SPEED if inside else 0.0


@kernel()
def _model(me: Record, v: float, spacing: float, v_leader: float, leader_length: float) -> float:
    """Acceleration [m/s^2] that a driver's model commands; an infinite spacing is a free road."""
    if me.model == IDM:
        own = IdmParameters(me.v_desire, me.tau, me.L, me.A, me.b, HARDEST_BRAKING)
        return idm_acceleration(v, spacing - leader_length, v_leader, own)
    L = me.L + leader_length - REFERENCE_LENGTH
    a = lcm_acceleration(v, spacing, v_leader, me.v_desire, me.A, me.b, me.B, me.tau, L)
    return max(a, -HARDEST_BRAKING)


@kernel()
def _desired(me: Record, v: float, leader_length: float) -> float:
    """Spacing [m] that a driver's model desires behind a leader of the same speed."""
    if me.model == IDM:
        return float(me.L + v * me.tau + leader_length)
    return desired_spacing(v, v, me.b, me.B, me.tau, me.L + leader_length - REFERENCE_LENGTH)


@kernel()
def wish_behind(vehicles: Records, road: Road, follower: int, leader: int) -> float:
    """Acceleration [m/s^2] of one vehicle's model behind another, without memory; leader -1 is a free road."""
    me = vehicles[follower]
    if me.model == LCM_AT_ONCE:
        return lcm_behind(vehicles, follower, leader)
    v = max(me.v - common_speed(me.x, road), 0.0)
    if leader < 0:
        return _model(me, v, np.inf, 0.0, 0.0)
    other = vehicles[leader]
    v_leader = max(other.v - common_speed(other.x, road), 0.0)
    return _model(me, v, other.x - me.x, v_leader, other.length)


@kernel()
def needed_braking(gap: float, v: float, v_leader: float, a_leader: float) -> float:
    """Braking [m/s^2] that keeps a follower off a leader who goes on braking as it does.

    Constant braking over the room that is left, but no more than what ends the closing in a third of a second;
    where the gap is below the least one, what opens it at half a metre a second. Continuous in all arguments.
    """
    closing, room = v - v_leader, gap - _STANDSTILL - _LEAST_TIME_GAP * v
    need = 0.0
    if closing > 0.0:
        ends = closing / _END_CLOSING
        need = min(closing * closing / (2.0 * room), ends) if room > 0.0 else ends
        need += max(-a_leader, 0.0) * min(closing, 1.0)
    if room < 0.0 and closing > -_OPENING:
        need = max(need, (closing + _OPENING) / _END_CLOSING * min(-room, 1.0))
    return need


@kernel()
def reacts_to(me: Record, other: Record, lane: int, road: Road, time: float) -> bool:
    """Whether a driver reacts to a vehicle ahead that is on its lane, has just come in, or is about to."""
    if other.beside == lane and other.lane != lane:
        way = road.markings[max(other.origin, other.target)] - other.c[0]
        return bool((other.y - other.c[0]) / way >= me.moment)
    return bool(time - other.crossed >= me.ignores)


@kernel()
def unrest(me: Record, time: float) -> float:
    """Acceleration [m/s^2] of a driver that nothing on the road explains."""
    if me.unrest <= 0.0:
        return 0.0
    total = 0.0
    for k in range(SINES):
        total += math.sin(me.pace[k] * time + me.phase[k])
    return float(me.unrest * math.sqrt(2.0 / SINES) * total)


@kernel()
def relaxed_share(me: Record, time: float) -> float:
    """Share of the jumps at the last change of leader that is still given back to the model."""
    if me.relaxation <= 0.0:
        return 0.0
    return float(max(1.0 - (time - me.since) / me.relaxation, 0.0))


@kernel()
def remember(me: Record, road: Road, time: float) -> None:
    """Begin to remember what was intended up to now."""
    me.carried = me.a - unrest(me, time) - _common_acceleration(me.x, me.v, road)
    me.began = time


@kernel()
def take_leader(vehicles: Records, road: Road, vehicle: int, leader: int, time: float) -> None:
    """Follow another leader from now on: what was lost fades, and unless it was seen coming in a memory begins."""
    me = vehicles[vehicle]
    if me.leader == UNKNOWN:
        me.leader, me.since = leader, -np.inf
        return
    share = relaxed_share(me, time)
    spacing, v_leader = np.inf, me.v
    if me.leader >= 0:
        spacing = vehicles[me.leader].x - me.x + share * me.jump_s
        v_leader = vehicles[me.leader].v + share * me.jump_v
    me.jump_s, me.jump_v = 0.0, 0.0
    if leader >= 0:
        new = vehicles[leader]
        now = new.x - me.x
        cap = max(now, _DESIRED * _desired(me, me.v, new.length))
        me.jump_s = max(min(spacing, cap) - now, -0.5 * now)
        me.jump_v = v_leader - new.v
    if leader != me.watched:
        remember(me, road, time)
    me.leader, me.since, me.watched = leader, time, UNKNOWN


@kernel()
def intention(vehicles: Records, road: Road, vehicle: int, time: float) -> float:
    """Acceleration [m/s^2] that a driver intends behind the leader to which it reacts."""
    me = vehicles[vehicle]
    v, elapsed = max(me.v - common_speed(me.x, road), 0.0), time - me.began
    if me.leader >= 0:
        other, share = vehicles[me.leader], relaxed_share(me, time)
        v_leader = max(other.v - common_speed(other.x, road) + share * me.jump_v, 0.0)
        a = _model(me, v, other.x - me.x + share * me.jump_s, v_leader, other.length)
    else:
        a = _model(me, v, np.inf, 0.0, 0.0)
    a *= me.strength
    if elapsed < _MEMORIES * me.memory:
        m = math.exp(-elapsed / me.memory)
        a = m * me.carried + (1.0 - m) * a
    return float(a)


@kernel()
def drive(vehicles: Records, order: IntArray, last: IntArray, road: Road, k: int, time: float) -> float:
    """Acceleration [m/s^2] of the k-th vehicle in the order on the road, downstream first.

    last: place in the order of the nearest vehicle ahead on each lane, -1 = none.
    """
    vehicle = order[k]
    me = vehicles[vehicle]
    lane = me.beside if me.beside >= 0 else me.lane
    leader = NOBODY
    if last[lane] >= 0:
        nearest = order[last[lane]]
        coming = vehicles[nearest].beside == lane and me.beside < 0
        if coming and nearest != me.leader and nearest != me.watched:
            me.watched = nearest
            remember(me, road, time)
    for j in range(last[lane], -1, -1):
        other = vehicles[order[j]]
        here = other.lane == lane or other.beside == lane
        if here and (order[j] == me.leader or reacts_to(me, other, lane, road, time)):
            leader = order[j]
            break
    if leader != me.leader:
        take_leader(vehicles, road, vehicle, leader, time)
    a = intention(vehicles, road, vehicle, time)
    need = 0.0
    for side in range(min(me.lane, lane), max(me.lane, lane) + 1):
        if last[side] >= 0:
            other = vehicles[order[last[side]]]
            gap = other.x - other.length - me.x
            need = max(need, needed_braking(gap, me.v, other.v, other.a))
            about_to_come = other.beside == side and order[last[side]] != me.leader
            if about_to_come and me.room >= 0.0 and other.x - me.x < _SEES_BESIDE and me.v > other.v - 1.0:
                a = min(a, -me.room)
    a += _common_acceleration(me.x, me.v, road) + unrest(me, time)
    urgent = min(max(2.0 * need / NEED - 1.0, 0.0), 1.0)
    return max(min(a, -urgent * need) if urgent > 0.0 else a, -HARDEST_BRAKING)
