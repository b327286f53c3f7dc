"""Containers of the traffic simulation: one carriageway, its vehicles, its clock, and what comes out.

Frame of a carriageway: x along travel from the entry end of the section in view, y left from the right edge,
lanes numbered from 0 = rightmost. Vehicles are records and the rest named tuples because the compiled kernels
take those, and a few arguments compile much faster than many arrays.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
Records = NDArray[Any]
Record = Any  # one of Records: compiled code reads its fields as attributes

MAX_CHANGES = 6
"""Lane changes that a vehicle may begin on its way."""

KEPT, BROKEN_OFF, RETURN = 0, 1, 2
"""Kinds of a lateral path: kept to its end; broken off after the crossing; the way back from there."""

VEHICLE = np.dtype(
    [
        # Drawn once. L is meant for a leader of REFERENCE_LENGTH. gain: what a change must bring [m/s^2];
        # look_every: how often one is considered [s]; depth: how far past the marking one is broken off [m];
        # per change: duration with lateral speed above 0.1 m/s, pause until the next [s], breaks_off; offset:
        # place in the lane before each and after the last [m].
        *((name, "f8") for name in ("v_desire", "A", "b", "B", "tau", "L")),
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


class Traffic(NamedTuple):
    """The simulation, changed in place. vehicles: records ``VEHICLE``; order: those on the road, downstream
    first; counts: vehicles on the road, paths logged; waiting, lane_first: next vehicle to enter each lane and
    the lanes' first ones; last: scratch, a vehicle a lane; log: paths left, records ``PATH``."""

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
    return Traffic(
        vehicles=drivers.vehicles.copy(),
        order=np.zeros(n, np.int64),
        counts=np.zeros(2, np.int64),
        waiting=drivers.lane_first[:-1].copy(),
        lane_first=drivers.lane_first,
        last=np.zeros(lanes, np.int64),
        log=np.zeros(n * (MAX_CHANGES + 1), PATH),
    )
