"""The cross-checks of a recording: for each which vehicles have it, which agree, and what may be wrong."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from highd_lc.extraction import data_quality
from highd_lc.extraction.data_quality import Seconds, VehicleFacts
from highd_lc.io.formats import Format, format_of, in_words_of
from highd_lc.io.highd import Recording
from highd_lc.vocab import names
from highd_lc.vocab.cross_checks import CROSS_CHECKS, META, TRACKS, VEHICLES, CrossCheck
from highd_lc.vocab.job import Job

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_NARROWEST_LANE_M, _WIDEST_LANE_M = 2.3, 6.0
# Shortest and longest, narrowest and widest of each class [m], with room for what detectors make of them.
_SIZES = {names.CAR: (1.5, 7.5, 0.5, 3.2), names.TRUCK: (5.0, 30.0, 1.2, 3.6)}
_ENDS = 0.1  # of the section
# Factors to metres and to metres a second.
_LENGTHS = {3.28: "feet", 100.0: "centimetres"}
_SPEEDS = {3.28: "feet a second", 3.6: "km/h", 2.24: "mph"}


@dataclass(frozen=True)
class Finding:
    """Which vehicles have a check, and which of them agree, (vehicles,) each; cause: why some disagree, in words,
    empty if nothing is known.
    """

    known: BoolArray
    agrees: BoolArray
    cause: Callable[[IntArray], str] = field(default=lambda wrong: "")

    def wrong(self, own: IntArray) -> IntArray:
        """Those of some vehicles that have the check and disagree."""
        return own[self.known[own] & ~self.agrees[own]]

    def share(self, own: IntArray) -> float:
        """Share of some vehicles that agree, of those that have the check; NaN if none has it."""
        known = self.known[own]
        return float(self.agrees[own][known].mean()) if known.any() else float("nan")


def findings(recording: Recording, facts: VehicleFacts) -> dict[str, Finding]:
    """Every cross-check of a recording, by its name in the order of ``vocab.cross_checks``."""
    measured = {
        **_sizes(recording),
        **_places(recording, facts),
        **_motions(recording),
        "fastest": _fastest(facts, recording),
        **_neighbours(recording),
        **_metas(recording, facts),
    }
    return {name: measured[name] for name in CROSS_CHECKS}


@dataclass(frozen=True)
class Verdict:
    """A check that vehicles of a direction failed. short: for tables; text: one that names file and column."""

    check: CrossCheck
    short: str
    text: str
    is_error: bool


def verdicts(
    found: dict[str, Finding], own: IntArray, *, direction: int, files: dict[str, Path], said: Format
) -> list[Verdict]:
    """The checks that more vehicles of a direction fail than are let pass. files: by kind; said: names columns."""
    failed = []
    for name, check in CROSS_CHECKS.items():
        wrong, total = found[name].wrong(own), int(found[name].known[own].sum())
        is_error = 0 < check.least <= len(wrong) and len(wrong) >= check.nearly_all * total
        if not is_error and len(wrong) <= max(1 if check.let_pass else 0, check.let_pass * total):
            continue
        count = f"{len(wrong)} of {total} vehicles"
        cause = found[name].cause(wrong)
        column = ", ".join(dict.fromkeys(said.columns.get(one, one) for one in check.column.split(", ")))
        words = in_words_of(said, f"{check.words}{f': {cause}' if cause else ''}")
        place = f"{files[check.file]}: column{'s' * (',' in column)} {column!r}"
        text = f"{place}: {count} of direction {direction} {words}"
        failed.append(Verdict(check, f"{name} ({count})", text, is_error))
    return failed


def files_by_kind(job: Job) -> dict[str, Path]:
    """The files of a recording as messages name them."""
    files = format_of(job.data, job.settings.ingest.format).input_files(job.data, job.recording)
    return dict(zip((META, VEHICLES, TRACKS), files, strict=True))


def _close(name: str, difference: FloatArray, measured: FloatArray | float = 0.0) -> BoolArray:
    check = CROSS_CHECKS[name]
    close: BoolArray = np.abs(difference) <= check.tolerance + check.relative * np.abs(measured) + 1e-9
    return close


def _of_samples(name: str, vehicle: IntArray, agrees: BoolArray, n_vehicles: int) -> tuple[BoolArray, BoolArray]:
    """From samples to vehicles: which have any, and of which the share that the check asks for agrees."""
    total = np.bincount(vehicle, minlength=n_vehicles)
    equal = np.bincount(vehicle[agrees], minlength=n_vehicles)
    return total > 0, equal >= CROSS_CHECKS[name].share * total


def _unit(factor: float, units: dict[float, str], within: float) -> str:
    """A unit that explains why numbers are larger by a factor, as a question; empty if none does."""
    return next((f"in {unit}?" for size, unit in units.items() if abs(factor / size - 1) < within), "")


# --- sizes ---


def _sizes(recording: Recording) -> dict[str, Finding]:
    metas, samples = recording.vehicles, recording.samples
    everyone = np.ones(len(metas.id), dtype=bool)
    low = np.array([_SIZES[c] for c in names.CLASSES])[(metas.vehicle_class == names.TRUCK).astype(int)]
    fits = (low[:, 0] <= metas.length) & (metas.length <= low[:, 1])
    fits &= (low[:, 2] <= metas.width) & (metas.width <= low[:, 3]) & (metas.width <= metas.length)
    found = {"class_sizes": Finding(everyone, fits, lambda wrong: _why_sizes(recording, wrong))}
    vehicle = samples.vehicle
    for name in ("length", "width"):
        seen, of_metas = getattr(samples, name), getattr(metas, name)
        known = np.isfinite(seen)
        agrees = _close(name, (seen - of_metas[vehicle])[known])
        found[name] = Finding(
            *_of_samples(name, vehicle[known], agrees, len(metas.id)),
            partial(_why_other_size, vehicle, seen, of_metas),
        )
    return found


def _why_sizes(recording: Recording, wrong: IntArray) -> str:
    metas = recording.vehicles
    length, width = metas.length[wrong], metas.width[wrong]
    said = f"median length {np.median(length):.4g} m, width {np.median(width):.4g} m"
    if np.median(width > length) == 1:
        return f"{said}: width and height swapped? HighD's width is the length"
    cars = metas.vehicle_class == names.CAR
    if cars.any() and not cars.all() and np.median(metas.length[~cars]) < np.median(metas.length[cars]):
        return f"{said}: Car and Truck swapped?"
    unit = _unit(float(np.median(width)) / 1.9, _LENGTHS, 0.2) or _unit(
        float(np.median(length)) / 4.6, _LENGTHS, 0.2
    )
    return f"{said}{f': {unit}' if unit else ''}"


def _why_other_size(vehicle: IntArray, seen: FloatArray, of_metas: FloatArray, wrong: IntArray) -> str:
    chosen = np.isin(vehicle, wrong) & np.isfinite(seen)
    difference = np.median(of_metas[vehicle][chosen] - seen[chosen])
    return f"the metas say {abs(difference):.2f} m {'more' if difference > 0 else 'less'} at the median"


# --- road ---


def _places(recording: Recording, facts: VehicleFacts) -> dict[str, Finding]:
    metas, tracks = recording.vehicles, recording.road.tracks
    everyone, counts = np.ones(len(metas.id), dtype=bool), tracks.index.counts
    roads = (recording.meta.upper, recording.meta.lower)
    lane_width = np.array([np.median(np.diff(m)) if len(m) > 1 else np.nan for m in roads])[metas.direction - 1]
    outside = facts.outside > (1 - CROSS_CHECKS["carriageway"].share) * counts
    return {
        "lane_width": Finding(
            np.isfinite(lane_width),
            (lane_width >= _NARROWEST_LANE_M) & (lane_width <= _WIDEST_LANE_M),
            lambda wrong: _why_width(float(lane_width[wrong[0]])),
        ),
        "direction": Finding(
            np.abs(facts.travelled) >= CROSS_CHECKS["direction"].signal,
            facts.travelled > 0,
            lambda wrong: _why_backwards(int(metas.direction[wrong[0]])),
        ),
        "carriageway": Finding(everyone, ~outside, lambda wrong: _why_outside(recording, wrong)),
        "lanes": Finding(everyone, recording.road.lane_mismatches <= (1 - CROSS_CHECKS["lanes"].share) * counts),
        "lane_edges": _lane_edges(recording),
    }


def _why_width(width: float) -> str:
    unit = _unit(width / 3.7, _LENGTHS, 0.2)
    return f"{width:.3g} m{f': a recording {unit}' if unit else ''}"


def _why_backwards(direction: int) -> str:
    way = "+x" if direction == 1 else "-x"
    return f"vehicles of direction {direction} drive towards {way}: left-hand traffic, or directions swapped?"


def _why_outside(recording: Recording, wrong: IntArray) -> str:
    # The way of the lane ids says nothing: they may be wrong themselves. Beside the carriageway y says so.
    tracks, meta = recording.road.tracks, recording.meta
    direction = int(recording.vehicles.direction[wrong[0]])
    own, other = (meta.upper, meta.lower) if direction == 1 else (meta.lower, meta.upper)
    if len(own) < 2:
        return "the recordingMeta file has no markings of that carriageway"
    y = np.array([np.median(tracks.y[tracks.index.span(int(v))]) for v in wrong])
    image = own[0] + y if direction == 1 else own[-1] - y
    if len(other) and np.median((other[0] <= image) & (image <= other[-1])) == 1:
        return "they are on the other carriageway: left-hand traffic, or directions swapped?"
    inside = np.median((own[0] <= image) & (image <= own[-1])) == 1
    return "y is inside them, laneId is not" if inside else "markings of another recording, or y in another unit?"


def _lane_edges(recording: Recording) -> Finding:
    metas, tracks, meta = recording.vehicles, recording.road.tracks, recording.meta
    markings = {1: meta.upper - meta.upper[:1], 2: (meta.lower[-1:] - meta.lower)[::-1]}
    vehicle, offset, half_way = data_quality.crossing_offsets(
        tracks.index, tracks.y, tracks.lane, markings=markings, direction=metas.direction
    )
    agrees = np.abs(offset) <= CROSS_CHECKS["lane_edges"].tolerance + half_way
    known, equal = _of_samples("lane_edges", vehicle, agrees, len(metas.id))
    down = np.where(metas.direction[vehicle] == 1, offset, -offset)

    def why(wrong: IntArray) -> str:
        chosen = np.isin(vehicle, wrong)
        share = float(np.median(down[chosen] / metas.width[vehicle][chosen]))
        said = f"y + height / 2 is {np.median(down[chosen]):+.2f} m from it"
        return f"{said}: is y that of the box's centre?" if 0.25 < share < 0.75 else said

    return Finding(known, equal, why)


# --- motion ---


def _motions(recording: Recording) -> dict[str, Finding]:
    tracks = recording.road.tracks
    seconds = data_quality.seconds_of(tracks.index, frame_rate=recording.meta.frame_rate)
    seconds = seconds.chosen(_away_from_ends(recording, seconds))
    pairs = {
        "speed": (tracks.x, tracks.vx),
        "lateral_speed": (tracks.y, tracks.vy),
        "acceleration": (tracks.vx, tracks.ax),
        "lateral_acceleration": (tracks.vy, tracks.ay),
    }
    return {name: _motion(recording, name, seconds, *columns) for name, columns in pairs.items()}


def _motion(
    recording: Recording, name: str, seconds: Seconds, quantity: FloatArray, rate_column: FloatArray
) -> Finding:
    """A column against the quantity whose rate it holds."""
    metas, check, vehicle = recording.vehicles, CROSS_CHECKS[name], seconds.vehicle
    recorded = data_quality.means(rate_column, seconds.first, seconds.frames)
    measured = quantity[seconds.last] - quantity[seconds.first]
    measured *= recording.meta.frame_rate / seconds.frames
    if check.biased:
        for direction in (1, 2):
            own = metas.direction[vehicle] == direction
            recorded[own] -= np.median(recorded[own] - measured[own]) if own.any() else 0.0
    telling = np.abs(measured) >= check.signal
    vehicle, measured, recorded = vehicle[telling], measured[telling], recorded[telling]
    factor = _slopes(vehicle, measured, recorded, len(metas.id))
    if check.factor:
        of_vehicles = np.isfinite(factor), (factor >= 1 / check.factor) & (factor <= check.factor)
    else:
        of_vehicles = _of_samples(name, vehicle, _close(name, recorded - measured, measured), len(metas.id))
    return Finding(*of_vehicles, lambda wrong: _why_motion(recording, name, float(np.median(factor[wrong]))))


def _fastest(facts: VehicleFacts, recording: Recording) -> Finding:
    seconds = recording.road.tracks.index.counts / recording.meta.frame_rate
    speed = np.abs(facts.travelled) / seconds

    def why(wrong: IntArray) -> str:
        return f"{np.median(speed[wrong]):.3g} m/s at the median: positions in feet or centimetres?"

    return Finding(np.ones(len(speed), dtype=bool), speed <= CROSS_CHECKS["fastest"].tolerance, why)


def _slopes(vehicle: IntArray, measured: FloatArray, recorded: FloatArray, n_vehicles: int) -> FloatArray:
    """By which factor what is recorded follows what is measured, of each vehicle; NaN without a sample."""
    both, square = (np.bincount(vehicle, measured * other, n_vehicles) for other in (recorded, measured))
    factors: FloatArray = np.divide(both, square, out=np.full(n_vehicles, np.nan), where=square > 0)
    return factors


def _away_from_ends(recording: Recording, seconds: Seconds) -> BoolArray:
    """Near the ends of the section positions and speeds disagree by up to 0.8 m/s (equations.md 16.3)."""
    entry, stop = recording.road.extent[recording.vehicles.direction - 1][seconds.vehicle].T
    first, last = (recording.road.tracks.x[rows] for rows in (seconds.first, seconds.last))
    low, high = np.minimum(first, last), np.maximum(first, last)
    ends = _ENDS * (stop - entry)
    away: BoolArray = (low >= entry + ends) & (high <= stop - ends)
    return away


def _why_motion(recording: Recording, name: str, factor: float) -> str:
    rate = recording.meta.frame_rate
    said = f"they are {factor:.3g} times as large at the median"
    if factor < -0.2:
        return f"{said}: wrong sign?"
    if abs(factor) <= 0.2:
        return f"{said}: empty, or another quantity?"
    unit = _unit(factor, _SPEEDS, 0.04)
    of_rate = f"frameRate {factor * rate:.3g} instead of {rate:.3g}?" if name == "speed" else ""
    return ", ".join(text for text in (f"{said}: {unit}" if unit else said, of_rate) if text)


# --- neighbours ---


def _neighbours(recording: Recording) -> dict[str, Finding]:
    metas, tracks, rate = recording.vehicles, recording.road.tracks, recording.meta.frame_rate
    found = data_quality.neighbours(
        tracks.index, tracks.x, tracks.lane, ids=metas.id, direction=metas.direction, frame_rate=rate
    )
    leader, follower = found.leader, found.follower
    return {
        "leader_ids": _ids("leader_ids", found.vehicle, tracks.leader_id[found.row], leader, follower, metas.id),
        "follower_ids": _ids(
            "follower_ids", found.vehicle, tracks.follower_id[found.row], follower, leader, metas.id
        ),
        "gaps": _gaps(recording),
    }


def _gaps(recording: Recording) -> Finding:
    metas, tracks, samples = recording.vehicles, recording.road.tracks, recording.samples
    some = np.flatnonzero(np.isfinite(samples.gap) & (samples.gap != 0))
    vehicle, row = samples.vehicle[some], samples.row[some]
    gap = data_quality.gaps_to(
        tracks.index, tracks.x, vehicle=vehicle, row=row, leader_id=tracks.leader_id[row], ids=metas.id,
        length=metas.length,
    )  # fmt: skip
    known = np.isfinite(gap)
    vehicle, difference = vehicle[known], (samples.gap[some] - gap)[known]

    def why(wrong: IntArray) -> str:
        return f"{np.median(difference[np.isin(vehicle, wrong)]):+.3g} m at the median"

    of_vehicles = _of_samples("gaps", vehicle, _close("gaps", difference), len(metas.id))
    return Finding(*of_vehicles, why)


def _ids(
    name: str, vehicle: IntArray, recorded: IntArray, true: IntArray, opposite: IntArray, ids: IntArray
) -> Finding:
    telling = (recorded != 0) | (true != 0)
    vehicle, recorded, true, opposite = (a[telling] for a in (vehicle, recorded, true, opposite))

    def why(wrong: IntArray) -> str:
        chosen = np.isin(vehicle, wrong) & (recorded != true)
        said, other = recorded[chosen], opposite[chosen]
        shares = {
            "it is 0 there: an empty column?": np.mean(said == 0),
            "ids that the file does not hold: vehicles left out, or ids of another recording?": np.mean(
                ~np.isin(said, ids) & (said != 0)
            ),
            "precedingId and followingId swapped?": np.mean((said == other) & (said != 0)),
        }
        text, share = max(shares.items(), key=lambda item: item[1])
        return text if share >= 0.5 else ""

    return Finding(*_of_samples(name, vehicle, recorded == true, len(ids)), why)


# --- metas ---


def _metas(recording: Recording, facts: VehicleFacts) -> dict[str, Finding]:
    metas, index = recording.vehicles, recording.road.tracks.index
    everyone = np.ones(len(metas.id), dtype=bool)
    n_rows = index.counts + recording.duplicates
    # Whether a count of frames holds those in a hole is each tracker's own way: both are let pass.
    spanned = index.frame[index.starts[1:] - 1] - index.frame[index.starts[:-1]] + 1
    n_frames = (n_rows == metas.n_frames) | ((facts.holes > 0) & (spanned == metas.n_frames))
    in_view = (index.frame[index.starts[:-1]] == metas.first_frame) & (
        index.frame[index.starts[1:] - 1] == metas.last_frame
    )
    time_gap = (facts.min_time_gap - metas.min_time_gap) / np.maximum(1.0, metas.min_time_gap)
    return {
        "n_frames": Finding(everyone, n_frames),
        "in_view": Finding(everyone, in_view),
        "lane_changes": Finding(everyone, facts.lane_changes == metas.n_lane_changes),
        "min_gap": Finding(
            (metas.min_gap > 0) & np.isfinite(facts.min_gap), _close("min_gap", facts.min_gap - metas.min_gap)
        ),
        "min_time_gap": Finding(
            (metas.min_time_gap > 0) & np.isfinite(facts.min_time_gap), _close("min_time_gap", time_gap)
        ),
        "travelled": Finding(np.isfinite(metas.travelled), _close("travelled", facts.travelled - metas.travelled)),
    }
