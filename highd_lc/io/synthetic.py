"""The synthetic recorder: recordings in HighD's format, of simulated traffic whose truth is known.

Beside the three CSVs of a recording stand NN_truth.csv (every lane change) and NN_truth_drivers.csv (every
driver's model, parameters and manner); the CSVs themselves hold nothing that a camera could not have seen.

A fast CSV writer for tables of integers and of numbers with two decimals, as HighD prints them.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pandas as pd
from numba import njit
from numpy.typing import NDArray

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
from highd_lc.io.synthetic_truth import drivers_table, truth_table
from highd_lc.traffic.film import Film, film_carriageway
from highd_lc.vocab.recorder import RecorderSettings

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


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
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
    name, rate = f"{recording:02d}", settings.frame_rate
    truth, drivers = truth_of(scene, rate)
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
    site = _draw_site(rng, settings)
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


def _draw_site(rng: np.random.Generator, settings: RecorderSettings) -> Site:
    """Lane widths of a motorway, 3.5 to 3.95 m, markings to the centimetre as HighD prints them."""
    upper = _TOP_MARGIN + np.concatenate([[0.0], np.cumsum(rng.uniform(3.5, 3.95, settings.upper_lanes))])
    below = upper[-1] + _MEDIAN
    lower = below + np.concatenate([[0.0], np.cumsum(rng.uniform(3.5, 3.95, settings.lower_lanes))])
    return Site(np.round(upper, 2), np.round(lower, 2))
