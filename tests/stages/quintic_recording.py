"""Recordings in HighD's format whose lane changes are known: independent of the package and of its recorder.

Everybody drives at constant speed; some change lane along a quintic of their own duration. What HighD would
have written (corners, signs of direction 1, neighbours by brute force, rounding to 0.01) is written; what the
pipeline has to find is returned.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd

SECTION = 420.0
LANE = 3.75
MOVING = 0.1


@dataclass(frozen=True)
class Plan:
    """One lane change: when its path starts [s], how long it takes [s], to the left (+1) or right (-1)."""

    start: float
    duration: float
    side: int


@dataclass(frozen=True)
class Driver:
    """A vehicle: box [m], lane from the right (0 = rightmost), x of its centre at t = 0 [m], speed [m/s]."""

    length: float
    width: float
    truck: bool
    direction: int
    lane: int
    x0: float
    speed: float
    plans: tuple[Plan, ...] = ()


@dataclass(frozen=True)
class Truth:
    """A lane change as it was: times at which the lateral speed passes 0.1 m/s and first frame in the new lane.

    complete: whether both times lie in view, with half a second to spare.
    """

    vehicle_id: int
    moving_from: float
    moving_to: float
    crossing_frame: int
    complete: bool


@dataclass
class Scene:
    """A recording to be written. Frames 1 .. n at ``rate`` [Hz]; noise: of the recorded lateral position [m]."""

    drivers: list[Driver]
    rate: float = 25.0
    seconds: float = 40.0
    lanes: tuple[int, int] = (3, 3)
    noise: float = 0.0
    seed: int = 0
    truths: list[Truth] = field(default_factory=list)

    @property
    def markings(self) -> tuple[np.ndarray, np.ndarray]:
        """Image y of the upper and the lower carriageway's markings."""
        upper = 8.0 + LANE * np.arange(self.lanes[0] + 1)
        return upper.round(2), (upper[-1] + 5.0 + LANE * np.arange(self.lanes[1] + 1)).round(2)


def lateral(driver: Driver, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lateral position left of the carriageway's right edge [m] and lateral speed [m/s]."""
    y = np.full(len(t), (driver.lane + 0.5) * LANE)
    speed = np.zeros(len(t))
    for plan in driver.plans:
        u = np.clip((t - plan.start) / plan.duration, 0, 1)
        y += plan.side * LANE * u**3 * (10 - 15 * u + 6 * u**2)
        speed += plan.side * LANE / plan.duration * 30 * u**2 * (1 - u) ** 2
    return y, speed


def write(scene: Scene, folder: Path, number: int = 1) -> Scene:
    """Write the three files; the scene's truths are filled in."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(scene.seed)
    frames = np.arange(1, round(scene.seconds * scene.rate) + 1)
    parts = [
        part
        for place, driver in enumerate(scene.drivers)
        if len(part := _track(scene, driver, place + 1, frames, rng))
    ]
    rows = pd.concat(parts, ignore_index=True)
    _add_neighbours(rows)
    image = _image(scene, rows)
    image.to_csv(folder / f"{number:02d}_tracks.csv", index=False, float_format="%.2f")
    _metas(image, rows).to_csv(folder / f"{number:02d}_tracksMeta.csv", index=False, float_format="%.2f")
    _recording_meta(scene, rows, number).to_csv(folder / f"{number:02d}_recordingMeta.csv", index=False)
    return scene


def _track(
    scene: Scene, driver: Driver, number: int, frames: np.ndarray, rng: np.random.Generator
) -> pd.DataFrame:
    t = (frames - 1) / scene.rate
    x = driver.x0 + driver.speed * t
    seen = (x > driver.length / 2) & (x < SECTION - driver.length / 2)
    y, vy = lateral(driver, t)
    noisy = y + scene.noise * rng.standard_normal(len(y))
    lane = np.floor(y / LANE).astype(int)
    if seen.any():
        _note_truths(scene, driver, number, t[seen], lane[seen], first=int(frames[seen][0]))
    ay = np.gradient(vy, t) if len(t) > 1 else np.zeros(len(t))
    track = pd.DataFrame({
        "frame": frames, "id": number, "x": x, "y": noisy, "vx": driver.speed, "vy": vy, "ay": ay, "lane": lane,
        "length": driver.length, "width": driver.width, "truck": driver.truck, "direction": driver.direction,
    })  # fmt: skip
    return track[seen].reset_index(drop=True)


def _note_truths(
    scene: Scene, driver: Driver, number: int, t: np.ndarray, lane: np.ndarray, *, first: int
) -> None:
    for plan in driver.plans:
        target = driver.lane + sum(p.side for p in driver.plans if p.start <= plan.start)
        crossings = 1 + np.flatnonzero((lane[1:] == target) & (lane[:-1] == target - plan.side))
        if len(crossings) != 1:
            continue
        s = np.sqrt(MOVING * plan.duration / (30 * LANE))  # u (1 - u) at the moment of 0.1 m/s
        u = 0.5 - np.sqrt(0.25 - s)
        begin, end = plan.start + u * plan.duration, plan.start + (1 - u) * plan.duration
        complete = bool(t[0] + 0.5 <= begin and end <= t[-1] - 0.5)
        scene.truths.append(Truth(number, begin, end, first + int(crossings[0]), complete))


def _add_neighbours(rows: pd.DataFrame) -> None:
    """Leader and follower on the same lane of the same carriageway, and the gap to the leader."""
    order = np.lexsort([rows[c] for c in ("x", "lane", "direction", "frame")])
    place = rows[["frame", "direction", "lane"]].to_numpy()[order]
    ids, x, half = (rows[c].to_numpy()[order] for c in ("id", "x", "length"))
    together = (place[1:] == place[:-1]).all(axis=1)
    behind, ahead = order[:-1][together], order[1:][together]
    gap = x[1:] - x[:-1] - (half[1:] + half[:-1]) / 2
    rows["leader"], rows["follower"], rows["gap"] = 0, 0, 0.0
    rows.loc[behind, "leader"] = ids[1:][together]
    rows.loc[ahead, "follower"] = ids[:-1][together]
    rows.loc[behind, "gap"] = gap[together]


def _image(scene: Scene, rows: pd.DataFrame) -> pd.DataFrame:
    """HighD's own columns: upper-left corners, image axes, lane ids over all markings."""
    upper, lower = scene.markings
    up = (rows["direction"] == 1).to_numpy()
    sign = np.where(up, -1.0, 1.0)
    x = np.where(up, SECTION - rows["x"], rows["x"]) - rows["length"] / 2
    y = np.where(up, upper[0] + rows["y"], lower[-1] - rows["y"]) - rows["width"] / 2
    lane_id = np.where(up, rows["lane"] + 2, len(upper) + len(lower) - rows["lane"])
    zero = np.zeros(len(rows))
    time_gap = np.where(rows["leader"] > 0, rows["gap"] / rows["vx"], 0.0)
    return pd.DataFrame({
        "frame": rows["frame"], "id": rows["id"], "x": x, "y": y, "width": rows["length"],
        "height": rows["width"], "xVelocity": sign * rows["vx"], "yVelocity": -sign * rows["vy"],
        "xAcceleration": zero, "yAcceleration": -sign * rows["ay"], "frontSightDistance": SECTION - rows["x"],
        "backSightDistance": rows["x"], "dhw": rows["gap"], "thw": time_gap, "ttc": zero,
        "precedingXVelocity": zero, "precedingId": rows["leader"], "followingId": rows["follower"],
        **dict.fromkeys(
            ("leftPrecedingId", "leftAlongsideId", "leftFollowingId", "rightPrecedingId", "rightAlongsideId",
             "rightFollowingId"), 0,
        ),
        "laneId": lane_id,
    })  # fmt: skip


def _metas(image: pd.DataFrame, rows: pd.DataFrame) -> pd.DataFrame:
    changed = (image["laneId"].diff() != 0) & (image["id"].diff() == 0)
    gap = rows["gap"].where(rows["leader"] > 0)
    frame = pd.DataFrame({
        "id": image["id"], "width": image["width"], "height": image["height"], "frame": image["frame"],
        "truck": rows["truck"], "direction": rows["direction"], "x": rows["x"], "vx": rows["vx"], "gap": gap,
        "time_gap": gap / rows["vx"], "changed": changed,
    })  # fmt: skip
    by = frame.groupby("id")
    return pd.DataFrame({
        "width": by["width"].first(), "height": by["height"].first(), "initialFrame": by["frame"].min(),
        "finalFrame": by["frame"].max(), "numFrames": by.size(),
        "class": by["truck"].first().map({True: "Truck", False: "Car"}),
        "drivingDirection": by["direction"].first(), "traveledDistance": by["x"].max() - by["x"].min(),
        "minXVelocity": by["vx"].min(), "maxXVelocity": by["vx"].max(), "meanXVelocity": by["vx"].mean(),
        "minDHW": by["gap"].min().fillna(-1.0), "minTHW": by["time_gap"].min().fillna(-1.0), "minTTC": -1.0,
        "numLaneChanges": by["changed"].sum(),
    }).reset_index()  # fmt: skip


def _recording_meta(scene: Scene, rows: pd.DataFrame, number: int) -> pd.DataFrame:
    upper, lower = (";".join(f"{y:.2f}" for y in side) for side in scene.markings)
    one = rows.groupby("id").first()
    return pd.DataFrame([{
        "id": number, "frameRate": scene.rate, "locationId": 3, "speedLimit": -1.0, "month": "09.2017",
        "weekDay": "Tue", "startTime": "08:38", "duration": scene.seconds, "totalDrivenDistance": 0.0,
        "totalDrivenTime": len(rows) / scene.rate, "numVehicles": len(one), "numCars": int((~one["truck"]).sum()),
        "numTrucks": int(one["truck"].sum()), "upperLaneMarkings": upper, "lowerLaneMarkings": lower,
    }])  # fmt: skip


def random_scene(rng: np.random.Generator, **options: object) -> Scene:
    """Dense traffic on both carriageways; a third of the vehicles changes lane in the middle of its way."""
    scene = Scene([], seed=int(rng.integers(2**31)), **options)  # type: ignore[arg-type]
    for direction, lanes in ((1, scene.lanes[0]), (2, scene.lanes[1])):
        for lane in range(lanes):
            scene.drivers += _platoon(rng, direction, lane, lanes, scene.seconds)
    return scene


def _platoon(rng: np.random.Generator, direction: int, lane: int, lanes: int, seconds: float) -> list[Driver]:
    drivers: list[Driver] = []
    base = 27.0 + 2.0 * lane
    x0 = 150.0 + 100 * rng.random()
    while x0 > -base * (seconds - 12.0):
        truck = bool(rng.random() < 0.2)
        length = round(float(rng.uniform(10, 16) if truck else rng.uniform(4, 5.2)), 2)
        speed = base + round(float(rng.uniform(-0.3, 0.3)), 2)
        drivers.append(
            Driver(length, 2.5 if truck else round(float(rng.uniform(1.7, 2.0)), 2), truck, direction, lane,
                   x0, speed, _plans(rng, lane, lanes, x0, speed))
        )  # fmt: skip
        x0 -= float(rng.uniform(45, 110))
    return drivers


def _plans(rng: np.random.Generator, lane: int, lanes: int, x0: float, speed: float) -> tuple[Plan, ...]:
    if rng.random() > 0.35:
        return ()
    sides = [side for side in (-1, 1) if 0 <= lane + side < lanes]
    duration = float(rng.uniform(3.0, 7.5))
    entry = -x0 / speed
    start = entry + float(rng.uniform(-1.0, SECTION / speed - duration + 1.0))
    return (Plan(start, duration, int(rng.choice(sides))),)
