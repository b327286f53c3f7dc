"""One carriageway filmed: drivers drawn, traffic simulated, lane keeping and tracking errors added.

Random numbers depend on (seed, recording, carriageway, lane, vehicle) alone, so neither the order nor the number
of recordings changes a recording, and a longer one begins like a shorter one.

What a camera makes of the traffic in view: lane keeping and tracking errors added, neighbours found.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.kernels import kernel
from highd_lc.traffic.drivers import Inflow, draw_drivers
from highd_lc.traffic.lanes import Clock, Drivers, FloatArray, IntArray, Records, Road
from highd_lc.traffic.simulation import simulate
from highd_lc.vocab.sections import RecorderSettings

LEADER, FOLLOWER = 0, 1
LEFT_LEADER, LEFT_ALONGSIDE, LEFT_FOLLOWER = 2, 3, 4
RIGHT_LEADER, RIGHT_ALONGSIDE, RIGHT_FOLLOWER = 5, 6, 7
"""Columns of ``find_neighbours``."""


class Frames(NamedTuple):
    """Vehicles in view, frame by frame. first: first row of each frame, shape (frames + 1,); x: centre along
    travel [m]; length [m]; lane: increasing to the driver's left."""

    first: IntArray
    x: FloatArray
    length: FloatArray
    lane: IntArray


def add_sines(
    motion: FloatArray, time: FloatArray, *, driver: IntArray, sines: FloatArray, deviation: float
) -> None:
    """Add a sum of K equal sines of the given standard deviation [m] to position, speed and acceleration.

    motion: (n, 3), changed in place; time [s] and driver (index into sines): (n,); sines: (N, K, 2), angular
    frequency [rad/s] and phase [rad].
    """
    if deviation > 0:
        _add_sines(motion, time, driver, sines, deviation * np.sqrt(2 / sines.shape[1]))


@kernel()
def _add_sines(
    motion: FloatArray, time: FloatArray, driver: IntArray, sines: FloatArray, amplitude: float
) -> None:
    for row in range(len(time)):
        for k in range(sines.shape[1]):
            omega = sines[driver[row], k, 0]
            angle = omega * time[row] + sines[driver[row], k, 1]
            sine, cosine = amplitude * np.sin(angle), amplitude * np.cos(angle)
            motion[row, 0] += sine
            motion[row, 1] += omega * cosine
            motion[row, 2] -= omega * omega * sine


def find_neighbours(frames: Frames) -> NDArray[np.int64]:
    """Rows of the eight neighbours of every row, shape (n, 8), -1 where there is none.

    On the own lane the nearest centre ahead and behind; on the lanes beside, alongside is who overlaps
    lengthwise (the nearest centre), ahead and behind are the nearest of the others.
    """
    return _find_neighbours(frames.first, frames.x, frames.length, frames.lane)


@kernel()
def _find_neighbours(first: IntArray, x: FloatArray, length: FloatArray, lane: IntArray) -> NDArray[np.int64]:
    found = np.empty((len(x), 8), np.int64)
    nearest = np.empty(8)
    for frame in range(len(first) - 1):
        for i in range(first[frame], first[frame + 1]):
            for column in range(8):
                nearest[column] = np.inf
                found[i, column] = -1
            for j in range(first[frame], first[frame + 1]):
                side = lane[j] - lane[i]
                if j == i or abs(side) > 1:
                    continue
                distance = x[j] - x[i]
                column = _relation(side, distance, 0.5 * (length[i] + length[j]))
                if abs(distance) < nearest[column]:
                    nearest[column] = abs(distance)
                    found[i, column] = j
    return found


@kernel()
def _relation(side: int, distance: float, overlap: float) -> int:
    """Column of a neighbour at a distance ahead, on the own lane (0), to the left (1) or right (-1)."""
    if side == 0:
        return LEADER if distance > 0 else FOLLOWER
    column = LEFT_LEADER if side == 1 else RIGHT_LEADER
    if abs(distance) < overlap:
        return column + 1
    return column if distance > 0 else column + 2


_UPSTREAM, _DOWNSTREAM = 700.0, 300.0
_END_ZONE = 20.0  # where vehicles are cut by the edge of the picture [m] (equations.md 16.3)
_LONGEST_STEP = 0.04
_WARM_UP_SECONDS = 70
# Streams of random numbers of a carriageway: its lanes use 0, 1, ...
_DETECTION_STREAM = 100


@dataclass(frozen=True)
class Film:
    """What happened on a carriageway in view and what the camera saw of it; rows frame by frame.

    driver, frame (from 0): (n,); true, seen: x, v, a, y, vy, ay of the box centres (x from the section's entry,
    y left from the right edge) [m, s], (n, 6); paths: records ``PATH``.
    """

    drivers: Drivers
    road: Road
    frames: int
    driver: IntArray
    frame: IntArray
    true: FloatArray
    seen: FloatArray
    paths: Records

    def first_rows(self) -> IntArray:
        """First row of each frame, shape (frames + 1,)."""
        return np.searchsorted(self.frame, np.arange(self.frames + 1)).astype(np.int64)


def film_carriageway(
    markings: FloatArray,
    key: tuple[int, ...],
    *,
    flow: float,
    acceleration_bias: float,
    drift: float = 0.0,
    seconds: float,
    settings: RecorderSettings,
) -> Film:
    """Film a carriageway.

    markings: y of the lane markings from the right edge, 0 first [m]; key: (seed, recording, carriageway); flow:
    inflow a lane [veh/h]; acceleration_bias: error of the forward accelerations seen [m/s^2]; drift: true
    acceleration in view that all vehicles have in common [m/s^2]; seconds: length of the film.
    """
    road = Road(markings, _UPSTREAM, settings.section_m, _DOWNSTREAM, drift)
    clock = _clock(settings.frame_rate, seconds)
    inflow = Inflow(flow, start=-_WARM_UP_SECONDS, end=seconds, settings=settings)
    drivers = draw_drivers([np.random.default_rng((*key, lane)) for lane in range(len(markings) - 1)], inflow)
    passage = simulate(drivers, road, clock)
    driver, frame = passage.rows[:, 0].astype(np.int64), passage.rows[:, 1].astype(np.int64)
    time = frame / settings.frame_rate
    true = np.ascontiguousarray(passage.rows[:, 2:])
    add_sines(true[:, 3:], time, driver=driver, sines=drivers.sway, deviation=settings.wander_m)
    seen = _seen(true, time, driver, key=key, drivers=drivers, settings=settings)
    seen[:, 1] -= settings.end_speed_error_mps * _closeness_to_ends(true[:, 0], road.section)
    seen[:, 2] += acceleration_bias
    return Film(drivers, road, clock.frames, driver, frame, true, seen, passage.paths)


def _clock(frame_rate: float, seconds: float) -> Clock:
    steps = int(np.ceil(1 / (frame_rate * _LONGEST_STEP) - 1e-9))
    dt = 1 / (frame_rate * steps)
    return Clock(dt, steps, round(_WARM_UP_SECONDS / dt), max(round(seconds * frame_rate), 1))


def _closeness_to_ends(x: FloatArray, section: float) -> FloatArray:
    """1 at the ends of the section, falling to 0 within ``_END_ZONE``."""
    closeness: FloatArray = np.maximum(1 - np.minimum(x, section - x) / _END_ZONE, 0) ** 2
    return closeness


def _seen(
    true: FloatArray,
    time: FloatArray,
    driver: IntArray,
    *,
    key: tuple[int, ...],
    drivers: Drivers,
    settings: RecorderSettings,
) -> FloatArray:
    """The motion with the tracker's smooth errors, and white noise in the positions."""
    seen = true.copy()
    for axis in (0, 1):
        motion = seen[:, 3 * axis : 3 * axis + 3]
        sines = drivers.error[:, axis]
        add_sines(motion, time, driver=driver, sines=sines, deviation=settings.position_noise_m)
    if settings.detection_noise_m > 0:
        white = np.random.default_rng((*key, _DETECTION_STREAM)).standard_normal((len(true), 2))
        seen[:, [0, 3]] += settings.detection_noise_m * white
    return seen
