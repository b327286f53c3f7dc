"""Containers of the traffic simulation: one carriageway, its drivers, its clock, and what comes out.

Frame of a carriageway: x along travel from the entry end of the section in view, y left from the right edge,
lanes numbered from 0 = rightmost. They are named tuples because the compiled kernels take those.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

KEPT, BROKEN_OFF, RETURN = 0, 1, 2
"""Kinds of a lateral path: kept to its end; broken off after the crossing; the way back from there."""

ROW_COLUMNS = ("driver", "frame", "x", "v", "a", "y", "vy", "ay")
"""Columns of ``Passage.rows``: index into the drivers, frame from 0, box centre and its derivatives."""

PATH_COLUMNS = ("driver", "start", "until", "duration", "origin", "target", "kind")
"""First columns of ``Passage.paths``; the six coefficients of y(t - start) follow."""
COEFFICIENTS = slice(7, 13)
PATH_WIDTH = 13


class Road(NamedTuple):
    """A carriageway. markings: y of the lane markings from the right, 0 first [m], shape (lanes + 1,);
    upstream, section, downstream: length before, in and after the view [m]."""

    markings: FloatArray
    upstream: float
    section: float
    downstream: float


class Clock(NamedTuple):
    """Time of a simulation: step [s], steps a frame, steps before the first frame (t = 0), frames."""

    dt: float
    steps_per_frame: int
    warm_up_steps: int
    frames: int


class Drivers(NamedTuple):
    """Everything drawn about N vehicles, lane by lane of entry, in the order of their arrival.

    lane_first: index of each lane's first vehicle, shape (lanes + 1,); arrival: earliest time of entry [s];
    lcm: parameters of the LCM, L behind a leader of ``REFERENCE_LENGTH``, shape (N, 6); length, width [m];
    truck; highest_lane: leftmost lane used; gain: acceleration that a change must bring [m/s^2]; look_first,
    look_every: when a change is considered [s]. A column a lane change, shape (N, M): duration with lateral
    speed above 0.1 m/s [s], pause before the next [s], breaks_off; offset: place in the lane before each and
    after the last [m, left positive], shape (N, M + 1). sway: unit lane-keeping motion, error: unit tracking
    errors in x and y, both as (angular frequency [rad/s], phase [rad]) of K equal sines, shapes (N, K, 2) and
    (N, 2, K, 2).
    """

    lane_first: IntArray
    arrival: FloatArray
    lcm: FloatArray
    length: FloatArray
    width: FloatArray
    truck: BoolArray
    highest_lane: IntArray
    gain: FloatArray
    look_first: FloatArray
    look_every: FloatArray
    duration: FloatArray
    pause: FloatArray
    breaks_off: BoolArray
    offset: FloatArray
    sway: FloatArray
    error: FloatArray


class State(NamedTuple):
    """Where all vehicles are, changed in place. x: front [m]; v, a: forward; y, vy, ay: lateral, of the centre.

    lane: the lane that the centre is in; beside: the second lane occupied during a change, else -1; changes:
    paths begun; look: when a change is considered next [s]; path: the lateral path, columns as in
    ``Passage.paths``, ``until`` is NaN when there is none; active: vehicles on the road, downstream first;
    counts: number of active vehicles, of paths logged; waiting: next vehicle to enter each lane; last: the
    vehicle met last on each lane.
    """

    x: FloatArray
    v: FloatArray
    a: FloatArray
    y: FloatArray
    vy: FloatArray
    ay: FloatArray
    lane: IntArray
    beside: IntArray
    changes: IntArray
    look: FloatArray
    path: FloatArray
    active: IntArray
    counts: IntArray
    waiting: IntArray
    last: IntArray


def empty_state(drivers: Drivers, *, lanes: int) -> State:
    """The state before anybody has entered."""
    n = len(drivers.arrival)
    return State(
        **{name: np.zeros(n) for name in ("x", "v", "a", "y", "vy", "ay")},
        lane=np.full(n, -1),
        beside=np.full(n, -1),
        changes=np.zeros(n, np.int64),
        look=drivers.look_first.copy(),
        path=np.full((n, PATH_WIDTH), np.nan),
        active=np.zeros(n, np.int64),
        counts=np.zeros(2, np.int64),
        waiting=drivers.lane_first[:lanes].copy(),
        last=np.full(lanes, -1),
    )


class Passage(NamedTuple):
    """What passed the view. rows: frame by frame, downstream first, columns ``ROW_COLUMNS``; paths: lateral
    paths in the order of their start, columns ``PATH_COLUMNS`` and six coefficients."""

    rows: FloatArray
    paths: FloatArray
