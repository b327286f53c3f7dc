"""Which recorded rows belong to an event: each role's motion, and the followers' calibration windows."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.algorithms.extraction import Crossing
from highd_lc.algorithms.neighbours import NOBODY
from highd_lc.algorithms.roles import Roles
from highd_lc.algorithms.track_index import TIE, Traffic, find_row
from highd_lc.vocab import names

FloatArray = NDArray[np.float64]
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
    the earliest of these and at least a second before its start, the others from the start. The rows of a role are
    consecutive frames: they end where its track is broken.
    """
    windows = _windows(traffic, event, roles)
    begin = event.start_frame
    firsts = [_first_frame(traffic, window, begin) for window in windows] + [begin]
    early = min(*firsts, begin - round(_CONTEXT_S * traffic.rate))
    last = event.end_frame + int(horizon_s * traffic.rate)
    nothing = slice(0, 0)
    parts = [
        (names.EGO, event.ego, early, begin, nothing),
        (names.ORIGIN_LEADER, roles.origin_leader, begin, begin, nothing),
        (names.ORIGIN_FOLLOWER, roles.origin_follower, begin, begin, nothing),
        (names.TARGET_LEADER, roles.target_leader, firsts[0], begin, nothing),
    ]
    for place, later in enumerate(event.successors):
        if later.frame <= last:
            parts.append((names.target_leader(place + 2), later.vehicle, begin, later.frame, nothing))
    for place, follower in enumerate(roles.followers):
        first = min(firsts[place], firsts[place + 1])
        parts.append((names.target_follower(place + 1), follower, first, begin, windows[place]))
    return [
        RoleRows(role, vehicle, _between(traffic, vehicle, (first, last), around), window)
        for role, vehicle, first, around, window in parts
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


def _between(traffic: Traffic, vehicle: int, frames: tuple[int, int], around: int) -> slice:
    """Rows of a vehicle from the first to the last of two frames without a break around a frame."""
    run = traffic.index.run(vehicle, around)
    places = np.searchsorted(traffic.index.frame[run], [frames[0], frames[1] + 1])
    return slice(run.start + int(places[0]), run.start + int(places[1]))


def calibration_rows(traffic: Traffic, follower: int, leader: int, *, lane: int, before_frame: int) -> slice:
    """Rows of the follower's calibration window: the longest run of consecutive frames before t_start in which
    it is on ``lane`` behind ``leader``, both inside the usable part of the section and seen without a break from
    then until ``before_frame``. Empty without a leader.
    """
    if leader == NOBODY:
        return slice(0, 0)
    direction = traffic.direction[follower]
    runs = [traffic.index.frame[traffic.index.run(who, before_frame)] for who in (follower, leader)]
    unbroken_from = max((int(run[0]) for run in runs if len(run)), default=0)
    span = traffic.index.span(follower)
    follows = (traffic.lane[span] == lane) & (traffic.leader_id[span] == traffic.ids[leader])
    follows &= traffic.index.frame[span] >= unbroken_from
    first, stop = _longest_run(
        traffic.index.starts,
        traffic.index.frame,
        traffic.x,
        follows,
        (follower, leader),
        before_frame,
        (traffic.entry[direction] - TIE, traffic.stop[direction] + TIE),
    )
    return slice(int(first), int(stop))


@njit(cache=True, nogil=True)
def _longest_run(
    starts: IntArray,
    frame: IntArray,
    x: FloatArray,
    follows: NDArray[np.bool_],
    pair: tuple[int, int],
    before_frame: int,
    section: tuple[float, float],
) -> tuple[int, int]:
    """First row and end of the longest run; follows: whether each of the follower's rows may belong to it."""
    follower, leader = pair
    best_first = best_stop = run_first = starts[follower]
    for row in range(starts[follower], starts[follower + 1]):
        if frame[row] >= before_frame:
            break
        ahead = find_row(starts, frame, leader, frame[row]) if follows[row - starts[follower]] else -1
        good = ahead >= 0 and x[row] >= section[0] and x[ahead] <= section[1]
        if not good:
            run_first = row + 1
            continue
        if row > run_first and frame[row] != frame[row - 1] + 1:
            run_first = row
        if row + 1 - run_first >= best_stop - best_first:
            best_first, best_stop = run_first, row + 1
    return best_first, best_stop
