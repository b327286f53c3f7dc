"""The two meta files of a synthetic recording, computed from its printed tracks as HighD's agree with theirs."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from highd_lc.io.synthetic_highd import Site, Tracks
from highd_lc.vocab import names

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
