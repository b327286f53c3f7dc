"""Who is who at the start of a lane change, on both lanes (SPEC section 11)."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from highd_lc.algorithms.neighbours import NOBODY, Ego, Lane, neighbours
from highd_lc.algorithms.track_index import Traffic


@dataclass(frozen=True)
class Maneuver:
    """A complete lane change: vehicle index of the ego, frames of start and crossing, lanes."""

    ego: int
    start_frame: int
    crossing_frame: int
    origin_lane: int
    target_lane: int


@dataclass(frozen=True)
class Roles:
    """Vehicle indices at t_start, -1 = nobody; followers nearest first. follower_ahead: the first follower's
    front is not behind the ego's. confirmed: the recorded leader ids say the same of all of them.
    """

    origin_leader: int
    origin_follower: int
    target_leader: int
    followers: tuple[int, ...]
    follower_ahead: bool
    confirmed: bool


def find_roles(traffic: Traffic, maneuver: Maneuver, *, max_link_m: float, max_followers: int) -> Roles:
    """Leader and follower on the origin lane, leader and follower chain on the target lane, from geometry."""
    ego = _ego(traffic, maneuver)
    origin = neighbours(
        ego, _lane(traffic, maneuver, maneuver.origin_lane), max_link_m=max_link_m, max_followers=1
    )
    target = neighbours(
        ego,
        _lane(traffic, maneuver, maneuver.target_lane),
        max_link_m=max_link_m,
        max_followers=max_followers,
    )
    origin_follower = origin.followers[0] if origin.followers else NOBODY
    chain = (target.leader, *target.followers)
    return Roles(
        origin_leader=origin.leader,
        origin_follower=origin_follower,
        target_leader=target.leader,
        followers=target.followers,
        follower_ahead=target.follower_ahead,
        confirmed=_is_chain(traffic, (origin.leader, maneuver.ego, origin_follower), maneuver.start_frame)
        and _is_chain(traffic, chain, maneuver.start_frame),
    )


def _ego(traffic: Traffic, maneuver: Maneuver) -> Ego:
    half = float(traffic.length[maneuver.ego]) / 2
    now = traffic.x[traffic.index.row(maneuver.ego, maneuver.start_frame)]
    later = traffic.x[traffic.index.row(maneuver.ego, maneuver.crossing_frame)]
    return Ego(front=float(now) + half, rear=float(now) - half, later_front=float(later) + half)


def _lane(traffic: Traffic, maneuver: Maneuver, lane: int) -> Lane:
    """The other vehicles on a lane of the ego's carriageway at t_start."""
    vehicles, rows = traffic.index.in_view(maneuver.start_frame)
    same_way = traffic.direction[vehicles] == traffic.direction[maneuver.ego]
    chosen = same_way & (traffic.lane[rows] == lane) & (vehicles != maneuver.ego)
    vehicles, rows = vehicles[chosen], rows[chosen]
    half = traffic.length[vehicles] / 2
    later = traffic.index.rows(vehicles, maneuver.crossing_frame)
    return Lane(
        vehicle=vehicles,
        front=traffic.x[rows] + half,
        rear=traffic.x[rows] - half,
        later_front=np.where(later >= 0, traffic.x[later] + half, np.nan),
    )


def _is_chain(traffic: Traffic, chain: tuple[int, ...], frame: int) -> bool:
    """Whether each vehicle's recorded leader is the one before it in the chain."""
    return all(
        traffic.leader_id[traffic.index.row(follower, frame)] == traffic.id_of(leader)
        for leader, follower in pairwise(chain)
        if follower != NOBODY
    )
