"""The lane-id changes of a recording: which are complete lane changes, who is around them, which are usable."""

from dataclasses import dataclass, replace

import numpy as np

from highd_lc.algorithms.lane_change import LaneChange, find_lane_changes
from highd_lc.algorithms.lateral_motion import Path, Rule
from highd_lc.algorithms.roles import Maneuver, Roles, find_roles
from highd_lc.algorithms.track_index import ABSENT, Traffic
from highd_lc.vocab import names


@dataclass(frozen=True)
class Crossing:
    """A lane-id change. ego: vehicle index; crossing_frame, start_frame, end_frame: -1 = not found; reason:
    why it is not usable, empty if it is; roles: of a complete lane change.
    """

    ego: int
    change: LaneChange
    crossing_frame: int
    start_frame: int
    end_frame: int
    reason: str
    roles: Roles | None


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
            found.append(crossing)
    return found


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
