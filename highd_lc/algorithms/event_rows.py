"""Which recorded rows belong to an event: each role's motion, and the followers' calibration windows."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from highd_lc.algorithms.extraction import Crossing
from highd_lc.algorithms.neighbours import NOBODY
from highd_lc.algorithms.roles import Roles
from highd_lc.algorithms.track_index import Traffic, find_rows
from highd_lc.vocab import names

IntArray = NDArray[np.int64]

# Recorded motion of the ego before its start, so that smoothing it has no edge at the start.
_CONTEXT_S = 1.0


@dataclass(frozen=True)
class RoleRows:
    """A role of an event: its vehicle (index), its rows, and those of them that calibrate it."""

    role: str
    vehicle: int
    rows: slice
    calibration: slice


def role_rows(traffic: Traffic, event: Crossing, roles: Roles, *, horizon_s: float) -> list[RoleRows]:
    """Rows of every role of a usable lane change, until ``horizon_s`` after its end or the end of the track.

    Followers and their leaders come from the first row of the calibration window that needs them, the ego from
    the earliest of these and at least a second before its start, the others from the start.
    """
    windows = _windows(traffic, event, roles)
    firsts = [_first_frame(traffic, window, event.start_frame) for window in windows] + [event.start_frame]
    early = min(*firsts, event.start_frame - round(_CONTEXT_S * traffic.rate))
    nothing = slice(0, 0)
    parts = [
        (names.EGO, event.ego, early, nothing),
        (names.ORIGIN_LEADER, roles.origin_leader, event.start_frame, nothing),
        (names.ORIGIN_FOLLOWER, roles.origin_follower, event.start_frame, nothing),
        (names.TARGET_LEADER, roles.target_leader, firsts[0], nothing),
    ]
    for place, follower in enumerate(roles.followers):
        first = min(firsts[place], firsts[place + 1])
        parts.append((names.target_follower(place + 1), follower, first, windows[place]))
    last = event.end_frame + int(horizon_s * traffic.rate)
    return [
        RoleRows(role, vehicle, _between(traffic, vehicle, first, last), window)
        for role, vehicle, first, window in parts
        if vehicle != NOBODY
    ]


def _windows(traffic: Traffic, event: Crossing, roles: Roles) -> list[slice]:
    chain = (roles.target_leader, *roles.followers)
    return [
        calibration_rows(traffic, follower, leader, lane=event.change.target, before_frame=event.start_frame)
        for leader, follower in pairwise(chain)
    ]


def _first_frame(traffic: Traffic, window: slice, otherwise: int) -> int:
    return int(traffic.index.frame[window.start]) if window.stop > window.start else otherwise


def _between(traffic: Traffic, vehicle: int, first_frame: int, last_frame: int) -> slice:
    span = traffic.index.span(vehicle)
    places = np.searchsorted(traffic.index.frame[span], [first_frame, last_frame + 1])
    return slice(span.start + int(places[0]), span.start + int(places[1]))


def calibration_rows(traffic: Traffic, follower: int, leader: int, *, lane: int, before_frame: int) -> slice:
    """Rows of the follower's calibration window: the longest run of consecutive frames before t_start in which
    it is on ``lane`` behind ``leader``, both inside the usable part of the section. Empty without a leader.
    """
    span = traffic.index.span(follower)
    if leader == NOBODY:
        return slice(span.start, span.start)
    rows = np.arange(span.start, span.stop)
    frame = traffic.index.frame[rows]
    leader_rows = find_rows(traffic.index.starts, traffic.index.frame, np.full(len(rows), leader), frame)
    entry, stop = traffic.entry[traffic.direction[follower]], traffic.stop[traffic.direction[follower]]
    good = (
        (frame < before_frame)
        & (traffic.leader_id[rows] == traffic.ids[leader])
        & (traffic.lane[rows] == lane)
        & (leader_rows >= 0)
        & (traffic.x[rows] >= entry)
        & (traffic.x[leader_rows] <= stop)
        & (traffic.x[leader_rows] >= entry)
    )
    first, last = _longest_run(frame, good)
    return slice(span.start + first, span.start + last)


def _longest_run(frame: IntArray, good: NDArray[np.bool_]) -> tuple[int, int]:
    """First place and end of the longest run of good samples in consecutive frames; the later one of equals."""
    places = np.flatnonzero(good)
    if len(places) == 0:
        return 0, 0
    breaks = np.flatnonzero((np.diff(places) != 1) | (np.diff(frame[places]) != 1))
    firsts = np.concatenate([[0], breaks + 1])
    sizes = np.diff(firsts, append=len(places))
    best = len(sizes) - 1 - int(np.argmax(sizes[::-1]))
    first = int(places[firsts[best]])
    return first, first + int(sizes[best])
