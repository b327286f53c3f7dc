"""Who leads the target lane after its first leader has left it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from highd_lc.algorithms.neighbours import NOBODY
from highd_lc.algorithms.track_index import ABSENT, TIE, Traffic

IntArray = NDArray[np.int64]


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
