"""One carriageway filmed: drivers drawn, traffic simulated, lane keeping and tracking errors added.

Random numbers depend on (seed, recording, carriageway, lane, vehicle) alone, so neither the order nor the number
of recordings changes a recording, and a longer one begins like a shorter one.
"""

from dataclasses import dataclass

import numpy as np

from highd_lc.algorithms.traffic import simulate
from highd_lc.algorithms.traffic_drivers import Inflow, draw_drivers
from highd_lc.algorithms.traffic_state import Clock, Drivers, FloatArray, IntArray, Records, Road
from highd_lc.algorithms.traffic_view import add_sines
from highd_lc.vocab.recorder import RecorderSettings

_UPSTREAM, _DOWNSTREAM = 700.0, 300.0
_END_ZONE = 20.0  # where vehicles are cut by the edge of the picture [m] (HIGHD, pitfall 3)
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
    seconds: float,
    settings: RecorderSettings,
) -> Film:
    """Film a carriageway.

    markings: y of the lane markings from the right edge, 0 first [m]; key: (seed, recording, carriageway); flow:
    inflow a lane [veh/h]; acceleration_bias: error of the forward accelerations seen [m/s^2]; seconds: length of
    the film.
    """
    road = Road(markings, _UPSTREAM, settings.section_m, _DOWNSTREAM)
    clock = _clock(settings.frame_rate, seconds)
    inflow = Inflow(
        flow,
        settings.truck_share,
        settings.lane_change_rate,
        settings.return_share,
        start=-_WARM_UP_SECONDS,
        end=seconds,
    )
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
