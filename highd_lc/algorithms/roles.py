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
    ego, others = _around(traffic, maneuver)
    origin = neighbours(ego, others[maneuver.origin_lane], max_link_m=max_link_m, max_followers=1)
    target = neighbours(ego, others[maneuver.target_lane], max_link_m=max_link_m, max_followers=max_followers)
    origin_follower = origin.followers[0] if origin.followers else NOBODY
    frame = maneuver.start_frame
    return Roles(
        origin_leader=origin.leader,
        origin_follower=origin_follower,
        target_leader=target.leader,
        followers=target.followers,
        follower_ahead=target.follower_ahead,
        confirmed=_is_chain(traffic, (origin.leader, maneuver.ego, origin_follower), frame)
        and _is_chain(traffic, (target.leader, *target.followers), frame),
    )


def _around(traffic: Traffic, maneuver: Maneuver) -> tuple[Ego, dict[int, Lane]]:
    """The ego, and the other vehicles on the two lanes of its carriageway at t_start."""
    vehicles, rows = traffic.index.in_view(maneuver.start_frame)
    same_way = traffic.direction[vehicles] == traffic.direction[maneuver.ego]
    vehicles, rows = vehicles[same_way], rows[same_way]
    later_rows = traffic.index.rows(vehicles, maneuver.crossing_frame)
    half = traffic.length[vehicles] / 2
    front, rear = traffic.x[rows] + half, traffic.x[rows] - half
    later_front = np.where(later_rows >= 0, traffic.x[later_rows] + half, np.nan)
    lane, others = traffic.lane[rows], vehicles != maneuver.ego
    lanes = {}
    for number in (maneuver.origin_lane, maneuver.target_lane):
        chosen = others & (lane == number)
        lanes[number] = Lane(vehicles[chosen], front[chosen], rear[chosen], later_front[chosen])
    own = int(np.argmin(others))
    return Ego(float(front[own]), float(rear[own]), float(later_front[own])), lanes


def _is_chain(traffic: Traffic, chain: tuple[int, ...], frame: int) -> bool:
    """Whether each vehicle's recorded leader is the one before it in the chain."""
    return all(
        traffic.leader_id[traffic.index.row(follower, frame)] == traffic.id_of(leader)
        for leader, follower in pairwise(chain)
        if follower != NOBODY
    )
