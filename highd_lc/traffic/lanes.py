"""Containers of the traffic simulation, one carriageway, its vehicles, its clock, what comes out; lateral paths.

Frame of a carriageway: x along travel from the entry end of the section in view, y left from the right edge,
lanes numbered from 0 = rightmost. Vehicles are records and the rest named tuples because the compiled kernels
take those, and a few arguments compile much faster than many arrays.
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.kernels import kernel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
Records = NDArray[Any]
Record = Any  # one of Records: compiled code reads its fields as attributes

MAX_CHANGES = 6
"""Lane changes that a vehicle may begin on its way."""

KEPT, BROKEN_OFF, RETURN = 0, 1, 2
"""Kinds of a lateral path: kept to its end; broken off after the crossing; the way back from there."""

LCM_AT_ONCE, LCM, IDM = 0, 1, 2
"""Kinds of drivers: the LCM that reacts to everything at once, and those that take their time."""
NOBODY, UNKNOWN = -1, -2
"""A leader that is none, and one that was not asked for yet."""
SINES = 4
"""Sines of a driver's lateral and of its forward unrest."""

VEHICLE = np.dtype(
    [
        # Drawn once. model: LCM_AT_ONCE, LCM or IDM; of the IDM A, b, tau and L are its A, b, T and s0, B is
        # unused. The LCM's L is meant for a leader of REFERENCE_LENGTH. gain: what a change must bring [m/s^2];
        # look_every: how often one is considered [s]; depth: how far past the marking one is broken off [m];
        # per change: duration with lateral speed above 0.1 m/s, pause until the next [s], breaks_off; offset:
        # place in the lane before each and after the last [m].
        *((name, "f8") for name in ("v_desire", "A", "b", "B", "tau", "L")),
        ("model", "i8"),
        # memory, relaxation: times in which an acceleration and a jump of the leader fade [s]; moment: share of a
        # cut-in's way to the marking after which the leader is minded; ignores: how long after it not [s];
        # strength: share of the model's acceleration that is applied; room: braking for who is about to come in
        # [m/s^2], negative = none; presses: braking that a change may demand of the follower [m/s^2];
        # keep_right: bonus of the right lane [m/s^2]; unrest: deviation of the restless acceleration [m/s^2], of
        # SINES sines of angular frequencies pace [rad/s] and phases phase [rad].
        *((name, "f8") for name in ("memory", "relaxation", "moment", "ignores", "strength", "room")),
        *((name, "f8") for name in ("presses", "keep_right", "unrest")),
        *((name, "f8", (SINES,)) for name in ("pace", "phase")),
        *((name, "f8") for name in ("length", "width", "arrival", "gain", "look_every", "depth")),
        *((name, "i8") for name in ("truck", "highest_lane")),
        *((name, "f8", (MAX_CHANGES,)) for name in ("duration", "pause")),
        ("breaks_off", "i8", (MAX_CHANGES,)),
        ("offset", "f8", (MAX_CHANGES + 1,)),
        # State. x: front [m]; v, a: forward; y, vy, ay: lateral, of the centre; look: when a change is
        # considered next [s]; lane: that of the centre; beside: the second lane taken in a change, else -1;
        # changes: paths begun; moving: whether on a path.
        *((name, "f8") for name in ("x", "v", "a", "y", "vy", "ay", "look")),
        *((name, "i8") for name in ("lane", "beside", "changes", "moving")),
        # leader: the vehicle minded last, NOBODY or UNKNOWN; since: when it became the leader [s]; jump_s, jump_v:
        # what was lost in spacing [m] and leader's speed [m/s] then; watched: the vehicle seen coming in last;
        # began: when the present memory began [s]; carried: the acceleration intended then [m/s^2]; crossed:
        # when the last marking was crossed [s].
        *((name, "i8") for name in ("leader", "watched")),
        *((name, "f8") for name in ("since", "jump_s", "jump_v", "began", "carried", "crossed")),
        # The present path y(t - start) = c0 + c1 t + .. + c5 t^5 over seconds.
        *((name, "f8") for name in ("start", "seconds")),
        *((name, "i8") for name in ("origin", "target", "kind")),
        ("c", "f8", (6,)),
    ],
    align=True,
)

PATH = np.dtype(
    [
        ("vehicle", "i8"),
        *((name, "f8") for name in ("start", "until", "seconds")),
        *((name, "i8") for name in ("origin", "target", "kind")),
        ("c", "f8", (6,)),
    ],
    align=True,
)
"""A lateral path as it was driven from start until until; seconds: how long it was meant to take."""

ROW_COLUMNS = ("vehicle", "frame", "x", "v", "a", "y", "vy", "ay")
"""Columns of ``Passage.rows``: index of the vehicle, frame from 0, box centre and its derivatives."""


class Road(NamedTuple):
    """A carriageway. markings: y of the lane markings from the right, 0 first [m], shape (lanes + 1,);
    upstream, section, downstream: length before, in and after the view [m]; drift: acceleration in view that all
    vehicles have in common [m/s^2]."""

    markings: FloatArray
    upstream: float
    section: float
    downstream: float
    drift: float = 0.0


class Clock(NamedTuple):
    """Time of a simulation: step [s], steps a frame, steps before the first frame (t = 0), frames."""

    dt: float
    steps_per_frame: int
    warm_up_steps: int
    frames: int


@dataclass(frozen=True)
class Drivers:
    """Everything drawn about N vehicles, lane by lane of entry, in the order of their arrival.

    vehicles: records ``VEHICLE`` with the state at 0; lane_first: each lane's first, shape (lanes + 1,). sway:
    unit lane-keeping motion, error: unit tracking errors in x and y, as (angular frequency [rad/s], phase [rad])
    of K equal sines, shapes (N, K, 2) and (N, 2, K, 2).
    """

    vehicles: Records
    lane_first: IntArray
    sway: FloatArray
    error: FloatArray


PRESENT, LOGGED = range(2)


class Traffic(NamedTuple):
    """The simulation, changed in place.

    vehicles: records ``VEHICLE``; order: those on the road, downstream first; counts: of vehicles on the road
    (PRESENT) and of paths logged (LOGGED); waiting, lane_first: next vehicle to enter each lane and the lanes'
    first ones; last: scratch, a place in the order a lane; log: paths left, records ``PATH``.
    """

    vehicles: Records
    order: IntArray
    counts: IntArray
    waiting: IntArray
    lane_first: IntArray
    last: IntArray
    log: Records


class Passage(NamedTuple):
    """What passed the view. rows: frame by frame, downstream first, columns ``ROW_COLUMNS``; paths: records
    ``PATH`` in the order of their start."""

    rows: FloatArray
    paths: Records


def empty_traffic(drivers: Drivers) -> Traffic:
    """The state before anybody has entered."""
    n, lanes = len(drivers.vehicles), len(drivers.lane_first) - 1
    vehicles = drivers.vehicles.copy()
    vehicles["leader"] = vehicles["watched"] = UNKNOWN
    vehicles["crossed"] = vehicles["began"] = -np.inf
    return Traffic(
        vehicles=vehicles,
        order=np.zeros(n, np.int64),
        counts=np.zeros(2, np.int64),
        waiting=drivers.lane_first[:-1].copy(),
        lane_first=drivers.lane_first,
        last=np.zeros(lanes, np.int64),
        log=np.zeros(n * (MAX_CHANGES + 1), PATH),
    )


REFERENCE_LENGTH = 4.6
"""Leader's length that a driver's L is meant for [m]; behind another, L moves with the leader's length."""

_LATERAL_THRESHOLD = 0.1  # lateral speed between whose passings a duration is meant [m/s]


@kernel()
def full_duration(duration: float, shift: float) -> float:
    """Duration T [s] of the quintic over |shift| [m] whose speed is above 0.1 m/s for the given time [s].

    The speed 30 |D| u^2 (1 - u)^2 / T passes the threshold at u and 1 - u, so T (1 - 2 u) = duration; u falls
    with T slowly enough that iterating converges.
    """
    T = duration
    for _ in range(30):
        w = math.sqrt(min(_LATERAL_THRESHOLD * T / (30.0 * shift), 0.06))
        T = duration / math.sqrt(1.0 - 4.0 * w)
    return T


@kernel()
def lay_path(me: Record, target: float, seconds: float, time: float) -> None:
    """Lay the quintic from a vehicle's present lateral state to rest at the target y [m] in the given time."""
    T = seconds
    shift = target - me.y - me.vy * T - 0.5 * me.ay * T * T
    speed = -me.vy - me.ay * T
    me.start, me.seconds, me.moving = time, T, 1
    me.c[0], me.c[1], me.c[2] = me.y, me.vy, 0.5 * me.ay
    me.c[3] = (10.0 * shift - 4.0 * speed * T - 0.5 * me.ay * T * T) / T**3
    me.c[4] = (-15.0 * shift + 7.0 * speed * T + me.ay * T * T) / T**4
    me.c[5] = (6.0 * shift - 3.0 * speed * T - 0.5 * me.ay * T * T) / T**5


@kernel()
def begin_change(me: Record, road: Road, lane: int, time: float) -> None:
    """Start a change to an adjacent lane."""
    target = 0.5 * (road.markings[lane] + road.markings[lane + 1]) + me.offset[me.changes + 1]
    lay_path(me, target, full_duration(me.duration[me.changes], abs(target - me.y)), time)
    me.origin, me.target, me.kind = me.lane, lane, KEPT
    me.beside = lane
    me.changes += 1


@kernel()
def end_path(traffic: Traffic, vehicle: int, until: float) -> None:
    """Log a path that ended, or was left, at the given time."""
    me, entry = traffic.vehicles[vehicle], traffic.log[traffic.counts[LOGGED]]
    entry.vehicle, entry.start, entry.until, entry.seconds = vehicle, me.start, until, me.seconds
    entry.origin, entry.target, entry.kind = me.origin, me.target, me.kind
    for k in range(6):
        entry.c[k] = me.c[k]
    traffic.counts[LOGGED] += 1
    me.moving = 0


@kernel()
def follow_path(me: Record, road: Road, time: float) -> None:
    """Move to the lateral state at a time on the path [s]; change lane when the centre is past the marking."""
    t = min(time - me.start, me.seconds)
    c0, c1, c2, c3, c4, c5 = me.c[0], me.c[1], me.c[2], me.c[3], me.c[4], me.c[5]
    me.y = c0 + t * (c1 + t * (c2 + t * (c3 + t * (c4 + t * c5))))
    me.vy = c1 + t * (2 * c2 + t * (3 * c3 + t * (4 * c4 + t * 5 * c5)))
    me.ay = 2 * c2 + t * (6 * c3 + t * (12 * c4 + t * 20 * c5))
    if me.beside >= 0:
        past = me.y - road.markings[max(me.origin, me.target)]
        if past * (me.target - me.origin) >= 0:
            me.lane, me.beside, me.crossed = me.beside, -1, time
