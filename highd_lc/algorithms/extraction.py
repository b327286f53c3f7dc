"""The lane-id changes of a recording: which are complete lane changes, who is around them, which are usable."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from highd_lc.algorithms.lane_change import LaneChange, find_lane_changes
from highd_lc.algorithms.lateral_motion import Path, Rule
from highd_lc.algorithms.leaders import Successor, successors
from highd_lc.algorithms.roles import Maneuver, Roles, find_roles
from highd_lc.algorithms.track_index import ABSENT, TIE, Traffic
from highd_lc.vocab import names

IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Crossing:
    """A lane-id change. ego: vehicle index; crossing_frame, start_frame, end_frame: -1 = not found; reason:
    why it is not usable, empty if it is; roles: of a complete lane change; successors: of its target leader.
    """

    ego: int
    change: LaneChange
    crossing_frame: int
    start_frame: int
    end_frame: int
    reason: str
    roles: Roles | None
    successors: tuple[Successor, ...] = ()


def with_known_lanes(traffic: Traffic, longest_s: float) -> Traffic:
    """The traffic with lanes in the place of 0 where a vehicle is between the markings for all that.

    Such rows are a tracker's slip if they last no longer than ``longest_s`` [s] between rows with lanes: the
    lateral position says on which of the two lanes around them the vehicle is. Any other 0 stays.
    """
    off = np.flatnonzero(traffic.lane == 0)
    runs = np.split(off, 1 + np.flatnonzero(np.diff(off) > 1)) if len(off) else []
    lane = traffic.lane.copy()
    for rows in runs:
        lane[rows] = _lanes_of(traffic, rows, longest_s)
    return replace(traffic, lane=lane)


def _lanes_of(traffic: Traffic, rows: IntArray, longest_s: float) -> IntArray:
    """Lanes of consecutive rows without one, 0 where they are not known."""
    before, after = int(rows[0]) - 1, int(rows[-1]) + 1
    vehicle = int(np.searchsorted(traffic.index.starts, rows[0], side="right")) - 1
    span, frame = traffic.index.span(vehicle), traffic.index.frame
    if before < span.start or after >= span.stop or frame[after] - frame[before] != len(rows) + 1:
        return np.zeros(len(rows), dtype=np.int64)
    by_position = np.searchsorted(traffic.markings[int(traffic.direction[vehicle])], traffic.y[rows])
    sides = traffic.lane[before], traffic.lane[after]
    known = len(rows) <= longest_s * traffic.rate + TIE and bool(np.isin(by_position, sides).all())
    return by_position if known else np.zeros(len(rows), dtype=np.int64)


def find_crossings(traffic: Traffic, rule: Rule, *, max_link_m: float, max_followers: int) -> list[Crossing]:
    """Every lane-id change of a recording, by vehicle and frame, each usable or with one reason."""
    changed = 1 + np.flatnonzero(np.diff(traffic.lane))
    vehicle = np.searchsorted(traffic.index.starts, changed, side="right") - 1
    egos = np.unique(vehicle[traffic.index.starts[vehicle] != changed])
    found = []
    for ego in egos:
        for change in find_lane_changes(_path(traffic, int(ego)), rule):
            crossing = _crossing(traffic, int(ego), change)
            if not change.reason:
                crossing = _with_roles(traffic, crossing, max_link_m=max_link_m, max_followers=max_followers)
            if not crossing.reason:
                crossing = _with_successors(traffic, crossing, rule.flicker_s)
            found.append(crossing)
    return found


def _with_successors(traffic: Traffic, crossing: Crossing, flicker_s: float) -> Crossing:
    if crossing.roles is None:
        return crossing
    found = successors(
        traffic,
        crossing.roles.target_leader,
        ego=crossing.ego,
        lane=crossing.change.target,
        frame=crossing.start_frame,
        flicker_s=flicker_s,
    )
    return replace(crossing, successors=found)


def _path(traffic: Traffic, vehicle: int) -> Path:
    span = traffic.index.span(vehicle)
    markings = traffic.markings[int(traffic.direction[vehicle])]
    vy = traffic.vy[span].astype(np.float64)
    return Path(traffic.index.frame[span], traffic.lane[span], traffic.y[span], markings, traffic.rate, vy)


def _crossing(traffic: Traffic, ego: int, change: LaneChange) -> Crossing:
    frames = traffic.index.frame[traffic.index.span(ego)]
    start, end = (ABSENT if sample == ABSENT else int(frames[sample]) for sample in (change.start, change.end))
    return Crossing(ego, change, int(frames[change.crossing]), start, end, change.reason, None)


def _with_roles(traffic: Traffic, crossing: Crossing, *, max_link_m: float, max_followers: int) -> Crossing:
    change = crossing.change
    maneuver = Maneuver(crossing.ego, crossing.start_frame, crossing.crossing_frame, change.origin, change.target)
    roles = find_roles(traffic, maneuver, max_link_m=max_link_m, max_followers=max_followers)
    reason = ""
    if not roles.followers:
        reason = names.NO_TARGET_FOLLOWER
    elif roles.follower_ahead:
        reason = names.FOLLOWER_AHEAD
    return replace(crossing, reason=reason, roles=roles)
