"""Two filmed carriageways as HighD's tables: image axes, corners, rounding, ids (equations.md 15.3).

The two meta files are computed from the printed tracks, so that they agree with them as HighD's do.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from highd_lc.traffic.film import Film, Frames, find_neighbours
from highd_lc.traffic.lanes import FloatArray, IntArray
from highd_lc.vocab import names

TRACK_COLUMNS = (
    "frame", "id", "x", "y", "width", "height", "xVelocity", "yVelocity", "xAcceleration", "yAcceleration",
    "frontSightDistance", "backSightDistance", "dhw", "thw", "ttc", "precedingXVelocity", "precedingId",
    "followingId", "leftPrecedingId", "leftAlongsideId", "leftFollowingId", "rightPrecedingId",
    "rightAlongsideId", "rightFollowingId", "laneId",
)  # fmt: skip
HAS_DECIMALS = np.array([2 <= k < 16 for k in range(len(TRACK_COLUMNS))])
_LARGEST = 1_000_000.0  # thw and ttc explode as speeds (or their difference) vanish; HighD prints such numbers


@dataclass(frozen=True)
class Site:
    """Markings of both carriageways in image axes (y down) [m], ascending."""

    upper: FloatArray
    lower: FloatArray

    def markings(self, direction: int) -> FloatArray:
        """Markings of a direction from the driver's right edge, 0 first."""
        from_right = self.upper - self.upper[0] if direction == 1 else (self.lower[-1] - self.lower)[::-1]
        rounded: FloatArray = np.round(from_right, 2)
        return rounded


@dataclass(frozen=True)
class Tracks:
    """A recording's rows by vehicle and frame. table: columns ``TRACK_COLUMNS``, those of ``HAS_DECIMALS`` in
    hundredths; first: first row of each vehicle (id - 1), shape (vehicles + 1,); direction, truck: (vehicles,);
    ids: for each direction (1, 2) the id of each driver, 0 = never in view."""

    table: NDArray[np.int32]
    first: IntArray
    direction: IntArray
    truck: NDArray[np.bool_]
    ids: dict[int, IntArray]


def encode(films: dict[int, Film], site: Site) -> Tracks:
    """The tracks table of the carriageways by driving direction (1 = upper)."""
    ids = _number_vehicles(films)
    table = np.concatenate([_encode_direction(films[d], ids[d], d, site) for d in (1, 2)])
    # Stable: the rows of a vehicle already ascend by frame.
    table = table[np.argsort(table[:, 1], kind="stable")]
    n = max(int(numbers.max(initial=0)) for numbers in ids.values())
    direction, truck = np.zeros(n, np.int64), np.zeros(n, np.bool_)
    for d, film in films.items():
        seen = ids[d] > 0
        direction[ids[d][seen] - 1] = d
        truck[ids[d][seen] - 1] = film.drivers.vehicles["truck"][seen]
    first = np.searchsorted(table[:, 1], np.arange(1, n + 2)).astype(np.int64)
    return Tracks(table, first, direction, truck, ids)


def _number_vehicles(films: dict[int, Film]) -> dict[int, IntArray]:
    """Ids from 1 in the order of first frames, the upper carriageway first within a frame."""
    first_seen = []
    for d, film in films.items():
        drivers, rows = np.unique(film.driver, return_index=True)
        first_seen += [(film.frame[row], d, row, driver) for driver, row in zip(drivers, rows, strict=True)]
    ids = {d: np.zeros(len(film.drivers.vehicles), np.int64) for d, film in films.items()}
    for number, (_, d, _, driver) in enumerate(sorted(first_seen), start=1):
        ids[d][driver] = number
    return ids


def _hundredths(values: FloatArray) -> NDArray[np.int32]:
    return np.rint(100 * values).astype(np.int32)


def _encode_direction(film: Film, ids: IntArray, direction: int, site: Site) -> NDArray[np.int32]:
    """The rows of a carriageway, frame by frame."""
    table = np.zeros((len(film.driver), len(TRACK_COLUMNS)), np.int32, order="F")
    sign = 1 if direction == 2 else -1
    x, v, a, y, vy, ay = film.seen.T
    length, width = (film.drivers.vehicles[name][film.driver] for name in ("length", "width"))
    table[:, 0], table[:, 1] = film.frame + 1, ids[film.driver]
    centre_x = x if direction == 2 else film.road.section - x
    centre_y = site.lower[-1] - y if direction == 2 else site.upper[0] + y
    decimals = (
        centre_x - length / 2, centre_y - width / 2, length, width, sign * v, -sign * vy, sign * a, -sign * ay,
        film.road.section - x, x,
    )  # fmt: skip
    for column, values in enumerate(decimals, start=2):
        table[:, column] = _hundredths(values)
    table[:, 24] = _lane_ids(table, site)
    lane = -sign * table[:, 24].astype(np.int64)
    rows = find_neighbours(Frames(film.first_rows(), np.ascontiguousarray(x), length, lane))
    table[:, 16:24] = np.where(rows >= 0, ids[film.driver[rows]], 0)
    _encode_leader(table, rows[:, 0], x, v, length, sign)
    return table


def _lane_ids(table: NDArray[np.int32], site: Site) -> IntArray:
    """searchsorted(markings, y + height / 2) + 1, on the printed numbers; doubled to stay among integers."""
    markings = 2 * np.concatenate([_hundredths(site.upper), _hundredths(site.lower)])
    return np.searchsorted(markings, 2 * table[:, 3] + table[:, 5]) + 1


def _encode_leader(
    table: NDArray[np.int32],
    leader: IntArray,
    x: FloatArray,
    v: FloatArray,
    length: FloatArray,
    sign: int,
) -> None:
    """dhw, thw, ttc and the leader's speed; all 0 without a leader."""
    has = leader >= 0
    gap = x[leader] - x - (length[leader] + length) / 2
    closing = v - v[leader]
    with np.errstate(divide="ignore", invalid="ignore"):
        columns = (gap, np.nan_to_num(gap / v), np.where(closing == 0, 0, gap / closing), sign * v[leader])
    for column, values in enumerate(columns, start=12):
        table[:, column] = np.where(has, _hundredths(np.clip(values, -_LARGEST, _LARGEST)), 0)


_MONTHS = ("09.2017", "10.2017", "05.2018", "06.2018")
_WEEK_DAYS = ("Mon", "Tue", "Wed", "Thu", "Fri")
_SPEED_LIMITS = (-1.0, -1.0, 33.33, 36.11)
_LOCATIONS = 6


@dataclass(frozen=True)
class Occasion:
    """Where and when a recording claims to be made: location 1 to 6, speed limit [m/s, -1 = none], month,
    week day, time of day."""

    location: int
    speed_limit: float
    month: str
    week_day: str
    start_time: str


def draw_occasion(rng: np.random.Generator) -> Occasion:
    """A location and a time; more than half of the recordings are made at location 1, as in HighD."""
    elsewhere = 2 + int(rng.integers(_LOCATIONS - 1))
    return Occasion(
        location=1 if rng.random() < 37 / 60 else elsewhere,
        speed_limit=_SPEED_LIMITS[rng.integers(len(_SPEED_LIMITS))],
        month=_MONTHS[rng.integers(len(_MONTHS))],
        week_day=_WEEK_DAYS[rng.integers(len(_WEEK_DAYS))],
        start_time=f"{rng.integers(8, 19):02d}:{rng.integers(60):02d}",
    )


def tracks_meta(tracks: Tracks) -> pd.DataFrame:
    """One row a vehicle, in the columns of HighD's tracksMeta."""
    table, start, end = tracks.table, tracks.first[:-1], tracks.first[1:] - 1
    speed = np.abs(table[:, 6]) / 100
    return pd.DataFrame(
        {
            "id": table[start, 1],
            "width": table[start, 4] / 100,
            "height": table[start, 5] / 100,
            "initialFrame": table[start, 0],
            "finalFrame": table[end, 0],
            "numFrames": end - start + 1,
            "class": np.where(tracks.truck, names.TRUCK, names.CAR),
            "drivingDirection": tracks.direction,
            "traveledDistance": np.abs(table[end, 2] - table[start, 2]) / 100,
            "minXVelocity": np.minimum.reduceat(speed, start),
            "maxXVelocity": np.maximum.reduceat(speed, start),
            "meanXVelocity": np.add.reduceat(speed, start) / (end - start + 1),
            "minDHW": _smallest_positive(table[:, 12], start),
            "minTHW": _smallest_positive(table[:, 13], start),
            "minTTC": _smallest_positive(table[:, 14], start),
            "numLaneChanges": _lane_changes(tracks),
        }
    )


def _smallest_positive(hundredths: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Smallest positive value of each vehicle; -1 where there is none."""
    smallest = np.minimum.reduceat(np.where(hundredths > 0, hundredths / 100, np.inf), start)
    return np.where(np.isfinite(smallest), smallest, -1.0)


def _lane_changes(tracks: Tracks) -> np.ndarray:
    lane, vehicle = tracks.table[:, 24], tracks.table[:, 1]
    changed = np.zeros(len(lane), np.int64)
    changed[1:] = (lane[1:] != lane[:-1]) & (vehicle[1:] == vehicle[:-1])
    return np.add.reduceat(changed, tracks.first[:-1])


def recording_meta(
    recording: int, meta: pd.DataFrame, site: Site, *, seconds: float, frame_rate: float, occasion: Occasion
) -> pd.DataFrame:
    """The one row of recordingMeta, printed as HighD prints it. meta: the recording's tracksMeta."""
    trucks = int((meta["class"] == names.TRUCK).sum())
    row = {
        "id": recording,
        "frameRate": f"{frame_rate:g}",
        "locationId": occasion.location,
        "speedLimit": f"{occasion.speed_limit:.2f}",
        "month": occasion.month,
        "weekDay": occasion.week_day,
        "startTime": occasion.start_time,
        "duration": f"{seconds:.2f}",
        "totalDrivenDistance": f"{meta['traveledDistance'].sum():.2f}",
        "totalDrivenTime": f"{meta['numFrames'].sum() / frame_rate:.2f}",
        "numVehicles": len(meta),
        "numCars": len(meta) - trucks,
        "numTrucks": trucks,
        "upperLaneMarkings": ";".join(f"{y:.2f}" for y in site.upper),
        "lowerLaneMarkings": ";".join(f"{y:.2f}" for y in site.lower),
    }
    return pd.DataFrame([row])
