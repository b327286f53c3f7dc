"""Who is who around a lane change: leader and followers of a lane at an instant (SPEC section 11)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from highd_lc.algorithms.track_index import ABSENT, TIE

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
