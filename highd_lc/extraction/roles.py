"""Roles of the vehicles around a lane change at its start, on both lanes (equations.md 11.3).

Also who leads the target lane after its first leader has left it.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from highd_lc.extraction.track_index import ABSENT, TIE, Traffic

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

NOBODY = ABSENT


@dataclass(frozen=True)
class Lane:
    """The vehicles on one lane at an instant, in any order, each of shape (n,).

    vehicle: index; front, rear: x of the bumpers [m]; later_front: x of the front at the crossing, NaN if the
    vehicle is no longer in view then [m].
    """

    vehicle: IntArray
    front: FloatArray
    rear: FloatArray
    later_front: FloatArray


@dataclass(frozen=True)
class Ego:
    """The lane-changing vehicle: x of its bumpers at t_start and of its front at the crossing [m]."""

    front: float
    rear: float
    later_front: float


@dataclass(frozen=True)
class Neighbours:
    """Vehicles around the ego on one lane: leader (NOBODY = none), followers nearest first.

    follower_ahead: whether a follower's front is not behind the ego's.
    """

    leader: int
    followers: tuple[int, ...]
    follower_ahead: bool


def neighbours(ego: Ego, lane: Lane, *, max_link_m: float, max_followers: int) -> Neighbours:
    """Leader and follower chain of the ego on a lane that it is not on.

    A vehicle whose box overlaps the ego's lengthwise is leader or follower by the position of its front at the
    crossing; where it has left the view by then, by its front now. The chain is walked upstream from the ego,
    each link at most ``max_link_m`` front to front.
    """
    ahead = _is_ahead(ego, lane)
    leaders, followers = ahead.nonzero()[0], (~ahead).nonzero()[0]
    chain: list[int] = []
    last = ego.front
    for place in followers[np.argsort(-lane.front[followers], kind="stable")][:max_followers]:
        front = float(lane.front[place])
        if last - front > max_link_m + TIE:
            break
        chain.append(int(lane.vehicle[place]))
        last = front
    first = float(lane.front[followers].max()) if chain else -np.inf
    return Neighbours(
        leader=int(lane.vehicle[leaders[np.argmin(lane.front[leaders])]]) if len(leaders) else NOBODY,
        followers=tuple(chain),
        follower_ahead=first >= ego.front - TIE,
    )


def _is_ahead(ego: Ego, lane: Lane) -> NDArray[np.bool_]:
    alongside = (lane.rear < ego.front - TIE) & (lane.front > ego.rear + TIE)
    later = np.where(np.isnan(lane.later_front), lane.front - ego.front, lane.later_front - ego.later_front)
    return np.where(alongside, later > TIE, lane.front > ego.front)


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


@dataclass(frozen=True)
class Successor:
    """The vehicle (index, NOBODY = none) that leads a lane from a frame on."""

    frame: int
    vehicle: int


def successors(
    traffic: Traffic, leader: int, *, ego: int, lane: int, frame: int, flicker_s: float
) -> tuple[Successor, ...]:
    """Who leads the lane after ``leader``, who leads it in ``frame``, in the order of time.

    The vehicle that leads when one has left is the next one ahead of it on the lane that is in view at that
    moment, else nobody, for good. Who moves in between a leader and those behind it is not looked for: it was not
    on the lane when the event began. ego: vehicle that is nobody's leader; flicker_s: see ``left_at``.
    """
    found: list[Successor] = []
    while leader != NOBODY:
        left = left_at(traffic, leader, lane=lane, frame=frame, flicker_s=flicker_s)
        if left == ABSENT:
            break
        leader, frame = _next_ahead(traffic, leader, ego=ego, lane=lane, frame=left), left
        found.append(Successor(frame, leader))
    return tuple(found)


def left_at(traffic: Traffic, vehicle: int, *, lane: int, frame: int, flicker_s: float) -> int:
    """The first frame from ``frame`` on in which a vehicle has left the lane, -1 = it stays while in view.

    Who is back within ``flicker_s`` [s] has not left.
    """
    run = traffic.index.run(vehicle, frame)
    first = run.start + frame - int(traffic.index.frame[run.start])
    on = np.append(-1, np.flatnonzero(traffic.lane[first : run.stop] == lane))
    away = np.diff(on, append=len(traffic.lane) + round(flicker_s * traffic.rate) + 2) - 1
    off = first + 1 + int(on[np.argmax(away > flicker_s * traffic.rate + TIE)])
    return int(traffic.index.frame[off]) if off < run.stop else ABSENT


def _next_ahead(traffic: Traffic, leader: int, *, ego: int, lane: int, frame: int) -> int:
    """The nearest vehicle on the lane whose front is ahead of the leader's in a frame, NOBODY without one."""
    vehicles, rows = traffic.index.in_view(frame)
    front = traffic.x[rows] + traffic.length[vehicles] / 2
    own = float(front[vehicles == leader][0])
    ahead = (traffic.direction[vehicles] == traffic.direction[leader]) & (traffic.lane[rows] == lane)
    ahead &= (front > own + TIE) & (vehicles != ego)
    return int(vehicles[ahead][np.argmin(front[ahead])]) if ahead.any() else NOBODY
