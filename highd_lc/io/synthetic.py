"""The synthetic recorder: recordings in HighD's format, of simulated traffic whose truth is known.

Beside the three CSVs of a recording stand NN_truth.csv (every lane change) and NN_truth_drivers.csv (every
driver's model, parameters and manner); the CSVs themselves hold nothing that a camera could not have seen.

A fast CSV writer for tables of integers and of numbers with two decimals, as HighD prints them.
"""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from highd_lc.core.kernels import kernel
from highd_lc.io.atomic import whole_file
from highd_lc.io.synthetic_highd import (
    HAS_DECIMALS,
    TRACK_COLUMNS,
    Site,
    Tracks,
    draw_occasion,
    encode,
    recording_meta,
    tracks_meta,
)
from highd_lc.traffic.film import Film, film_carriageway
from highd_lc.traffic.lanes import (
    BROKEN_OFF,
    IDM,
    LCM,
    LCM_AT_ONCE,
    REFERENCE_LENGTH,
    RETURN,
    FloatArray,
    IntArray,
    Record,
    Records,
)
from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS
from highd_lc.vocab.sections import RecorderSettings

MOVING = 0.1
"""Lateral speed of the path whose passings are reported [m/s] (equations.md 11.6)."""
TRUTH_COLUMNS = (
    "vehicle_id", "kind", "origin_lane", "target_lane", "start_s", "moving_from_s", "crossing_s", "moving_to_s",
    "end_s", "start_frame", "crossing_frame", "end_frame", "complete_in_view", "path_in_view", "origin_leader_id",
    "origin_follower_id", "target_leader_id", "target_follower_ids", "target_follower_spacings_m",
)  # fmt: skip
_FINE = 0.001
_KINDS = {BROKEN_OFF: "broken_off", RETURN: "return"}

_MODELS = {LCM_AT_ONCE: "lcm at once", LCM: "lcm", IDM: "idm"}
_OF_THE_IDM = {"idm_A": "A", "idm_b": "b", "idm_T": "tau", "idm_s0": "L"}
_MANNER = {
    "memory_s": "memory",
    "relaxation_s": "relaxation",
    "reaction_moment": "moment",
    "reaction_strength": "strength",
    "ignores_s": "ignores",
    "unrest_mps2": "unrest",
}


@dataclass(frozen=True)
class _Change:
    """A true change: lanes from 0 = rightmost, times [s] of the path's start and end and of the moments
    between which its lateral speed is above ``MOVING``."""

    driver: int
    kind: str
    origin: int
    target: int
    start: float
    end: float
    moving_from: float
    moving_to: float


def truth_table(film: Film, ids: IntArray, *, frame_rate: float) -> pd.DataFrame:
    """One row a true lane change of a carriageway whose crossing is in view, vehicle by vehicle.

    Lanes: 1 = rightmost. Times in s from the recording's frame 1, of the whole path, seen or not; ``moving_*``:
    when the path's lateral speed passes 0.1 m/s. ``crossing_frame``: the first with the true box centre in the
    target lane. Leaders and followers (0 = none): in ``start_frame``, the frame nearest to ``moving_from_s``, by
    the fronts of the vehicles in view; ``target_follower_spacings_m``: from front to front along the chain.
    """
    lanes = np.searchsorted(film.road.markings, film.true[:, 3], side="right") - 1
    order = np.argsort(film.driver, kind="stable")
    bounds = np.searchsorted(film.driver[order], np.arange(len(ids) + 1))
    rows = []
    for change in _changes(film.paths):
        seen = order[bounds[change.driver] : bounds[change.driver + 1]]
        crossing = _crossing(change, lanes[seen], film.frame[seen] / frame_rate)
        if crossing >= 0:
            rows.append(_truth_row(change, film, lanes, seen=seen, crossing=crossing, ids=ids, rate=frame_rate))
    return pd.DataFrame(rows, columns=list(TRUTH_COLUMNS))


def drivers_table(film: Film, ids: IntArray) -> pd.DataFrame:
    """The drivers of the vehicles in view: model, its parameters, and how each reacts.

    ``model``: "lcm at once", "lcm" or "idm". Parameters of the LCM; L applies behind a leader of
    ``reference_length_m``, and moves with the leader's length. idm_A, idm_b [m/s^2], idm_T [s], idm_s0 [m]: the
    IDM's, with v_desire [m/s]. What is not of a driver's model is empty. memory_s, relaxation_s: times in which an
    acceleration intended before a cut-in began, and the jump of spacing and leader's speed when it is minded,
    fade (0 = none);
    reaction_moment: share of a cut-in's way to the marking from which on it is minded (0 = start, 1 = crossing);
    ignores_s: how long after the crossing it is not minded all the same; reaction_strength: share of the model's
    acceleration that is applied; makes_room_mps2: braking for who is about to come in (empty = none); unrest_mps2:
    standard deviation of an acceleration that nothing explains; drift_mps2: the carriageway's acceleration in
    common, at 28 m/s.
    """
    seen = np.flatnonzero(ids)
    vehicles = film.drivers.vehicles[seen]
    model, idm = vehicles["model"], vehicles["model"] == IDM
    table = pd.DataFrame({"vehicle_id": ids[seen], "class": np.where(vehicles["truck"], names.TRUCK, names.CAR)})
    table["model"] = pd.Series(model).map(_MODELS)
    table["v_desire"] = vehicles["v_desire"]
    for name in PARAMETERS[1:]:
        table[name] = np.where(idm, np.nan, vehicles[name])
    table["reference_length_m"] = np.where(idm, np.nan, REFERENCE_LENGTH)
    for column, name in _OF_THE_IDM.items():
        table[column] = np.where(idm, vehicles[name], np.nan)
    for column, name in _MANNER.items():
        table[column] = vehicles[name]
    table["makes_room_mps2"] = np.where(vehicles["room"] >= 0, vehicles["room"], np.nan)
    table["drift_mps2"] = film.road.drift
    return table


def _changes(paths: Records) -> Iterator[_Change]:
    """The changes in the order of their start; a path broken off and the way back are two changes."""
    for number, path in enumerate(paths):
        kind = int(path["kind"])
        pieces = [path]
        if kind == BROKEN_OFF:
            pieces.append(next(later for later in paths[number + 1 :] if later["vehicle"] == path["vehicle"]))
        yield _change(pieces, kind)


def _change(pieces: list[Record], kind: int) -> _Change:
    """The change along one path or, broken off, two; it lasts while the lateral speed is towards the target."""
    path = pieces[0]
    origin, target = int(path["origin"]), int(path["target"])
    time = np.concatenate([np.arange(piece["start"], piece["until"], _FINE) for piece in pieces])
    speed = np.concatenate([_lateral_speed(piece) for piece in pieces]) * np.sign(target - origin)
    moving = np.flatnonzero(speed > MOVING)
    # The way back begins with the rest of the way out, and the way out ends where the way back begins.
    away = np.flatnonzero(speed < 0)
    before, after = away[away < moving[0]], away[away > moving[-1]]
    return _Change(
        int(path["vehicle"]),
        _KINDS.get(kind, "change"),
        origin,
        target,
        start=float(time[before[-1] + 1 if len(before) else 0]),
        end=float(time[after[0] - 1 if len(after) else -1]),
        moving_from=float(time[moving[0]]),
        moving_to=float(time[moving[-1]]),
    )


def _lateral_speed(path: Record) -> FloatArray:
    t = np.arange(path["start"], path["until"], _FINE) - path["start"]
    speed: FloatArray = np.polynomial.Polynomial(path["c"]).deriv()(t)
    return speed


def _crossing(change: _Change, lane: IntArray, time: FloatArray) -> int:
    """Index of the first row of the vehicle in the target lane after one in the origin lane; -1 if unseen."""
    crosses = (lane[:-1] == change.origin) & (lane[1:] == change.target)
    during = (time[1:] > change.start) & (time[1:] < change.end + 1 / 2)
    hits = np.flatnonzero(crosses & during)
    return int(hits[0]) + 1 if len(hits) else -1


def _truth_row(
    change: _Change, film: Film, lanes: IntArray, *, seen: IntArray, crossing: int, ids: IntArray, rate: float
) -> dict[str, Any]:
    first, last = film.frame[seen[0]] / rate, film.frame[seen[-1]] / rate
    start_frame = round(change.moving_from * rate)
    return {
        "vehicle_id": ids[change.driver],
        "kind": change.kind,
        "origin_lane": change.origin + 1,
        "target_lane": change.target + 1,
        "start_s": change.start,
        "moving_from_s": change.moving_from,
        "crossing_s": film.frame[seen[crossing]] / rate,
        "moving_to_s": change.moving_to,
        "end_s": change.end,
        "start_frame": start_frame + 1,
        "crossing_frame": film.frame[seen[crossing]] + 1,
        "end_frame": round(change.moving_to * rate) + 1,
        "complete_in_view": bool(first <= change.moving_from and change.moving_to <= last),
        "path_in_view": bool(first <= change.start and change.end <= last),
        **_neighbours(change, film, lanes, frame=start_frame, ids=ids),
    }


def _neighbours(change: _Change, film: Film, lanes: IntArray, *, frame: int, ids: IntArray) -> dict[str, Any]:
    """Leaders and followers of the ego on both lanes in a frame; none if it is not in view then."""
    begin, end = np.searchsorted(film.frame, [frame, frame + 1])
    driver, lane = film.driver[begin:end], lanes[begin:end]
    front = film.true[begin:end, 0] + film.drivers.vehicles["length"][driver] / 2
    ego = np.flatnonzero(driver == change.driver)
    own = front[ego[0]] if len(ego) else np.nan
    found = {}
    for name, number in (("origin", change.origin), ("target", change.target)):
        there = (lane == number) & (driver != change.driver)
        ahead = np.flatnonzero(there & (front > own))
        behind = np.flatnonzero(there & (front <= own))
        found[name] = ahead[np.argsort(front[ahead])], behind[np.argsort(-front[behind])]
    chain = found["target"][1]
    spacings = -np.diff(front[chain], prepend=own)
    return {
        "origin_leader_id": _first(ids[driver[found["origin"][0]]]),
        "origin_follower_id": _first(ids[driver[found["origin"][1]]]),
        "target_leader_id": _first(ids[driver[found["target"][0]]]),
        "target_follower_ids": ";".join(str(number) for number in ids[driver[chain]]),
        "target_follower_spacings_m": ";".join(f"{spacing:.2f}" for spacing in spacings),
    }


def _first(numbers: IntArray) -> int:
    return int(numbers[0]) if len(numbers) else 0


_ROWS_A_CHUNK = 32768
_LONGEST_FIELD = 13  # sign, ten digits of an int32, decimal point, separator
_MINUS, _POINT, _ZERO, _COMMA, _NEWLINE = 45, 46, 48, 44, 10


def write_table(path: Path, header: str, table: NDArray[np.int32], *, decimals: NDArray[np.bool_]) -> None:
    """Write a table, shape (rows, columns); columns with decimals hold hundredths and print two decimals."""
    with whole_file(path) as file:
        file.write(header.encode() + b"\n")
        _write_rows(file, table, decimals)


def write_frame(path: Path, frame: pd.DataFrame, *, float_format: str) -> None:
    """Write a small table as CSV."""
    with whole_file(path) as file:
        file.write(frame.to_csv(index=False, float_format=float_format).encode())


def _write_rows(file: BinaryIO, table: NDArray[np.int32], decimals: NDArray[np.bool_]) -> None:
    buffer = np.empty(_ROWS_A_CHUNK * table.shape[1] * _LONGEST_FIELD, np.uint8)
    for start in range(0, len(table), _ROWS_A_CHUNK):
        size = _format_rows(table[start : start + _ROWS_A_CHUNK], decimals, buffer)
        file.write(buffer[:size].data)


@kernel()
def _format_rows(table: NDArray[np.int32], decimals: NDArray[np.bool_], buffer: NDArray[np.uint8]) -> int:
    """Print the rows into the buffer; returns the number of bytes."""
    at = 0
    for row in range(table.shape[0]):
        for column in range(table.shape[1]):
            value = np.int64(table[row, column])
            if value < 0:
                buffer[at] = _MINUS
                at += 1
                value = -value
            if decimals[column]:
                at = _put_digits(value // 100, buffer, at)
                buffer[at] = _POINT
                buffer[at + 1] = _ZERO + value // 10 % 10
                buffer[at + 2] = _ZERO + value % 10
                at += 3
            else:
                at = _put_digits(value, buffer, at)
            buffer[at] = _COMMA
            at += 1
        buffer[at - 1] = _NEWLINE
    return at


@kernel()
def _put_digits(value: np.int64, buffer: NDArray[np.uint8], at: int) -> int:
    """Print a number that is not negative; returns where it ends."""
    digits, limit = 1, 10
    while value >= limit:
        digits += 1
        limit *= 10
    for place in range(at + digits - 1, at - 1, -1):
        buffer[place] = _ZERO + value % 10
        value //= 10
    return at + digits


_TOP_MARGIN, _MEDIAN = 8.5, 4.5
_DRIFT_STREAM = 3  # beside the recording's own stream, 0, and those of its directions
DIRECTIONS = (1, 2)
"""Driving directions: 1 = upper carriageway, 2 = lower (equations.md 15.4)."""


@dataclass(frozen=True)
class Scene:
    """A recording before it is written: the markings, the film of each direction, the tracks table."""

    site: Site
    films: dict[int, Film]
    tracks: Tracks


def synthesize(
    out: Path,
    *,
    recordings: int,
    seconds: float,
    seed: int,
    settings: RecorderSettings | None = None,
    workers: int = 1,
) -> list[int]:
    """Write recordings 1 .. N of the given length [s] into a folder; returns their numbers.

    Recording k depends on the seed, k and the settings alone. workers: threads (the compiled work runs outside
    the interpreter's lock).
    """
    settings = settings or RecorderSettings()
    numbers = list(range(1, recordings + 1))
    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(lambda number: write_recording(out, number, seconds, seed, settings=settings), numbers))
    return numbers


def write_recording(out: Path, recording: int, seconds: float, seed: int, *, settings: RecorderSettings) -> None:
    """Simulate one recording and write its five files, each whole; recordingMeta, the smallest, comes last."""
    scene = simulate_recording(recording, seconds, seed, settings=settings)
    tables = truth_of(scene, settings.frame_rate)
    write_scene(out, recording, scene, tables=tables, seed=seed, rate=settings.frame_rate)


def write_scene(
    out: Path, recording: int, scene: Scene, *, tables: tuple[pd.DataFrame, pd.DataFrame], seed: int, rate: float
) -> None:
    """Write a recording's five files. tables: its lane changes and drivers as they are; rate: frames a second."""
    name, (truth, drivers) = f"{recording:02d}", tables
    write_frame(out / f"{name}_truth.csv", truth, float_format="%.3f")
    write_frame(out / f"{name}_truth_drivers.csv", drivers, float_format="%.6g")
    write_table(out / f"{name}_tracks.csv", ",".join(TRACK_COLUMNS), scene.tracks.table, decimals=HAS_DECIMALS)
    vehicles = tracks_meta(scene.tracks)
    write_frame(out / f"{name}_tracksMeta.csv", vehicles, float_format="%.2f")
    occasion = draw_occasion(np.random.default_rng((seed, recording)))
    filmed = scene.films[1].frames / rate
    meta = recording_meta(recording, vehicles, scene.site, seconds=filmed, frame_rate=rate, occasion=occasion)
    write_frame(out / f"{name}_recordingMeta.csv", meta, float_format="%.2f")


def simulate_recording(recording: int, seconds: float, seed: int, *, settings: RecorderSettings) -> Scene:
    """Simulate one recording of the given length [s] in memory."""
    rng = np.random.default_rng((seed, recording, 0))
    site = draw_site(rng, settings)
    flow = settings.flow_veh_per_h * (1 + settings.flow_spread * rng.uniform(-1, 1))
    bias = settings.acceleration_bias_mps2 * rng.uniform(-1, 1)
    drift = _draw_drifts(np.random.default_rng((seed, recording, _DRIFT_STREAM)), settings)
    films = {
        direction: film_carriageway(
            site.markings(direction),
            (seed, recording, direction),
            flow=flow,
            acceleration_bias=bias if direction == 1 else -bias,
            drift=drift[direction],
            seconds=seconds,
            settings=settings,
        )
        for direction in DIRECTIONS
    }
    return Scene(site, films, encode(films, site))


def truth_of(scene: Scene, frame_rate: float) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The lane changes and the drivers of both carriageways, by vehicle and time."""
    tables = [
        (truth_table(film, scene.tracks.ids[d], frame_rate=frame_rate), drivers_table(film, scene.tracks.ids[d]))
        for d, film in scene.films.items()
    ]
    truth, drivers = (pd.concat(parts, ignore_index=True) for parts in zip(*tables, strict=True))
    return truth.sort_values(["vehicle_id", "crossing_frame"]), drivers.sort_values("vehicle_id")


def _draw_drifts(rng: np.random.Generator, settings: RecorderSettings) -> dict[int, float]:
    """Acceleration [m/s^2] that all vehicles of a direction have in common; small ones are more frequent."""
    bound = 0.0 if settings.drivers == "lcm" else settings.drift_mps2
    return {direction: bound * float(rng.uniform(-1, 1, 2).mean()) for direction in DIRECTIONS}


def draw_site(rng: np.random.Generator, settings: RecorderSettings) -> Site:
    """Lane widths of a motorway, 3.5 to 3.95 m, markings to the centimetre as HighD prints them."""
    upper = _TOP_MARGIN + np.concatenate([[0.0], np.cumsum(rng.uniform(3.5, 3.95, settings.upper_lanes))])
    below = upper[-1] + _MEDIAN
    lower = below + np.concatenate([[0.0], np.cumsum(rng.uniform(3.5, 3.95, settings.lower_lanes))])
    return Site(np.round(upper, 2), np.round(lower, 2))
