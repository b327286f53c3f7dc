"""Ingest: a recording's three CSV files to tracks, vehicles, and a line on each carriageway's quality."""

from dataclasses import replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from highd_lc.algorithms.data_quality import (
    ENTRY,
    EXIT,
    INNER,
    VehicleFacts,
    disagreement,
    mean_speed_change,
    vehicle_facts,
)
from highd_lc.io import artefacts, tracks_file
from highd_lc.io.highd import Recording, read_recording
from highd_lc.io.highd_parts import Parts, split_tracks
from highd_lc.vocab import names
from highd_lc.vocab.job import Job, JobReport, Problem

IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

STAGE = "ingest"
# Tolerances of the cross-checks against the metas, which are rounded to 0.01 and computed from values before
# rounding: a gap is the difference of four rounded numbers. From where to where a distance is travelled the metas
# do not say: half a vehicle in view at either end is let pass.
_GAP_TOLERANCE_M = 0.05
_TIME_GAP_TOLERANCE = 0.03
_TRAVELLED_TOLERANCE_M = 10.0
# Contradictions in columns that nothing else reads are told and no more; all others end the run with exit code 4.
_TOLD_ONLY = ("min_gap", "min_time_gap", "travelled")
# Share of vehicles that may disagree; one always may where it is above 0. HighD itself has 0.0002 for lane changes
# (HIGHD.md); smallest gaps hang on a single row. A number of rows other than the metas' means a torn file.
_SHARE_LET_PASS = {
    "n_frames": 0.0,
    "lane_changes": 0.001,
    "min_gap": 0.05,
    "min_time_gap": 0.05,
    "travelled": 0.01,
}
# What columns of the tracks may contradict each other: lane ids and y, positions and speeds. Swapped columns or a
# wrong frame rate exceed this by far; HighD's rounding and its section ends do not reach it.
_LARGEST_LANE_MISMATCH = 0.02
_LARGEST_DISAGREEMENT_MPS = 1.0
# Share of vehicles whose tracks may be broken before it is more than a tracker's usual losses.
_LARGEST_SHARE_BROKEN = 0.05


def run(job: Job) -> JobReport:
    """Read the recording's CSVs and write its tracks and the parts ``vehicles`` and ``recordings``.

    Checks are of the file as it is; the tracks written are unbroken (see ``io.highd_parts``). Raises InputError,
    before anything is written, naming file, column and row of the first fault. A failed cross-check against the
    metas is a problem in the report.
    """
    recording = read_recording(job.data, job.recording)
    quality = _quality(recording, job)
    if job.settings.ingest.remove_bias:
        recording = _without_bias(recording, quality)
    parts = split_tracks(recording)
    rows = tracks_file.write(job.work, parts.recording, job.provenance)
    vehicles = artefacts.write_part(job, STAGE, "vehicles", _vehicles(parts))
    quality["n_jumps"] = [parts.jumps(direction) for direction in quality["driving_direction"]]
    artefacts.write_part(job, STAGE, "recordings", quality)
    problems = (*_problems(job.recording, quality), *_broken(parts))
    return JobReport({"rows": rows, "vehicles": vehicles}, problems)


def _broken(parts: Parts) -> list[Problem]:
    """What is told of the tracks that were split; no warning any more if they are many."""
    broken, everybody = len({one.vehicle_id for one in parts.breaks}), len(np.unique(parts.recorded_id))
    few = broken <= max(1, _LARGEST_SHARE_BROKEN * everybody)
    of_all = "" if few else f"; {broken} of {everybody} vehicles"
    text = parts.in_words()
    return [Problem(parts.recording.number, STAGE, text + of_all, warning=few)] if text else []


def _vehicles(parts: Parts) -> pd.DataFrame:
    recording = parts.recording
    metas, index = recording.vehicles, recording.road.tracks.index
    return pd.DataFrame(
        {
            "recording_id": recording.number,
            "vehicle_id": metas.id,
            "driving_direction": metas.direction,
            "class": metas.vehicle_class.astype(object),
            "length": metas.length,
            "width": metas.width,
            "first_frame": index.frame[index.starts[:-1]],
            "last_frame": index.frame[index.starts[1:] - 1],
            "recorded_id": parts.recorded_id,
        }
    )


def _without_bias(recording: Recording, quality: pd.DataFrame) -> Recording:
    bias = dict(zip(quality["driving_direction"], quality["mean_acceleration"], strict=True))
    tracks = recording.road.tracks
    of_vehicle = np.array([bias[direction] for direction in recording.vehicles.direction])
    ax = tracks.ax - np.repeat(of_vehicle, tracks.index.counts)
    return replace(recording, road=replace(recording.road, tracks=replace(tracks, ax=ax)))


def _problems(recording: int, quality: pd.DataFrame) -> list[Problem]:
    return [
        Problem(
            recording,
            STAGE,
            f"recording {recording:02d}, direction {row.driving_direction}: the files contradict themselves: "
            f"{', '.join(row.failed_checks)}",
            warning=all(check.split(" ")[0] in _TOLD_ONLY for check in row.failed_checks),
        )
        for row in quality.itertuples()
        if row.failed_checks
    ]


def _quality(recording: Recording, job: Job) -> pd.DataFrame:
    """The table ``recordings``: a row for each direction that has vehicles."""
    settings = job.settings.ingest
    tracks, metas = recording.road.tracks, recording.vehicles
    facts = vehicle_facts(
        tracks.index,
        tracks.x,
        vx=tracks.vx,
        lane=tracks.lane,
        leader_id=tracks.leader_id,
        ids=metas.id,
        length=metas.length,
    )
    agreement = _agreement(recording, facts)
    rows = []
    for direction in np.unique(metas.direction):
        own = np.flatnonzero(metas.direction == direction)
        rows.append(
            {
                **_road(recording, int(direction)),
                **(counts := _counts(recording, facts, own)),
                **(motion := _motion(recording, own, trim=settings.trim_ends_m)),
                **_shares(agreement, own),
                "bias_removed": settings.remove_bias,
                "failed_checks": [*_failed_metas(agreement, own), *_failed_columns({**counts, **motion})],
            }
        )
    return pd.DataFrame(rows)


def _road(recording: Recording, direction: int) -> dict[str, object]:
    meta = recording.meta
    markings = meta.upper - meta.upper[0] if direction == 1 else (meta.lower[-1] - meta.lower)[::-1]
    entry, stop = recording.road.extent[direction - 1]
    return {
        "recording_id": recording.number,
        "driving_direction": direction,
        "location_id": meta.location,
        "frame_rate": meta.frame_rate,
        "markings": markings.round(6),
        "entry_m": entry,
        "exit_m": stop,
    }


def _counts(recording: Recording, facts: VehicleFacts, own: IntArray) -> dict[str, object]:
    n_rows = int(recording.road.tracks.index.counts[own].sum())
    return {
        "n_vehicles": len(own),
        "n_trucks": int((recording.vehicles.vehicle_class[own] == names.TRUCK).sum()),
        "n_rows": n_rows,
        "n_holes": int(facts.holes[own].sum()),
        "n_duplicates": int(recording.duplicates[own].sum()),
        "share_outside": float(facts.outside[own].sum() / n_rows),
        "share_lane_mismatch": float(recording.road.lane_mismatches[own].sum() / n_rows),
    }


def _motion(recording: Recording, own: IntArray, *, trim: float) -> dict[str, object]:
    """Bias of the forward acceleration, and position against speed near the ends and between them."""
    tracks, rate = recording.road.tracks, recording.meta.frame_rate
    entry, stop = recording.road.extent[recording.vehicles.direction[own[0]] - 1]
    found = disagreement(
        tracks.index, tracks.x, tracks.vx, vehicles=own, rate=rate, extent=(entry, stop), trim=trim
    )
    per_vehicle = np.add.reduceat(tracks.ax, tracks.index.starts[:-1])
    return {
        "mean_acceleration": float(per_vehicle[own].sum() / tracks.index.counts[own].sum()),
        "mean_speed_change": mean_speed_change(tracks.index, tracks.vx, vehicles=own, rate=rate),
        "disagreement_entry": found.size[ENTRY],
        "disagreement_inner": found.size[INNER],
        "disagreement_exit": found.size[EXIT],
        "disagreement_profile": found.profile,
    }


def _agreement(recording: Recording, facts: VehicleFacts) -> dict[str, tuple[BoolArray, BoolArray]]:
    """For each cross-check: which vehicles have it, and which of them agree with the metas."""
    metas = recording.vehicles
    everyone = np.ones(len(metas.id), dtype=bool)
    gap_known = (metas.min_gap > 0) & np.isfinite(facts.min_gap)
    time_gap_known = (metas.min_time_gap > 0) & np.isfinite(facts.min_time_gap)
    time_gap_tolerance = _TIME_GAP_TOLERANCE * np.maximum(1.0, metas.min_time_gap)
    index = recording.road.tracks.index
    n_rows = index.counts + recording.duplicates
    # Whether a count of frames holds those in a hole is each tracker's own way: both are let pass.
    spanned = index.frame[index.starts[1:] - 1] - index.frame[index.starts[:-1]] + 1
    n_frames = (n_rows == metas.n_frames) | ((facts.holes > 0) & (spanned == metas.n_frames))
    return {
        "n_frames": (everyone, n_frames),
        "lane_changes": (everyone, facts.lane_changes == metas.n_lane_changes),
        "min_gap": (gap_known, np.abs(facts.min_gap - metas.min_gap) <= _GAP_TOLERANCE_M),
        "min_time_gap": (
            time_gap_known,
            np.abs(facts.min_time_gap - metas.min_time_gap) <= time_gap_tolerance,
        ),
        "travelled": (
            np.isfinite(metas.travelled),
            np.abs(facts.travelled - metas.travelled) <= _TRAVELLED_TOLERANCE_M,
        ),
    }


def _shares(agreement: dict[str, tuple[BoolArray, BoolArray]], own: IntArray) -> dict[str, float]:
    """Share of the vehicles that have a check and agree, NaN if none has it."""
    return {
        f"share_{name}": float(equal[own][known[own]].mean()) if known[own].any() else float("nan")
        for name, (known, equal) in agreement.items()
    }


def _failed_metas(agreement: dict[str, tuple[BoolArray, BoolArray]], own: IntArray) -> list[str]:
    """Checks against the metas in which more vehicles disagree than are let pass."""
    failed = []
    for name, (known, equal) in agreement.items():
        total, wrong = int(known[own].sum()), int((known & ~equal)[own].sum())
        share = _SHARE_LET_PASS[name]
        if wrong > max(1 if share else 0, share * total):
            failed.append(f"{name} ({wrong} of {total} vehicles)")
    return failed


def _failed_columns(quality: dict[str, object]) -> list[str]:
    """Columns of the tracks that contradict each other."""
    failed = []
    if quality["share_lane_mismatch"] > _LARGEST_LANE_MISMATCH:
        failed.append(f"lane ids ({quality['share_lane_mismatch']:.1%} of the rows are not where y says)")
    if quality["disagreement_inner"] > _LARGEST_DISAGREEMENT_MPS:
        failed.append(f"speeds ({quality['disagreement_inner']:.1f} m/s from what the positions say)")
    return failed
