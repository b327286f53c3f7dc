"""Ingest: a recording's files to tracks, vehicles, and a line on each carriageway's quality."""

from dataclasses import replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from highd_lc.extraction.data_quality import (
    ENTRY,
    EXIT,
    INNER,
    VehicleFacts,
    disagreement,
    mean_speed_change,
    vehicle_facts,
)
from highd_lc.io import artefacts, highd
from highd_lc.io.formats import format_of
from highd_lc.io.highd import Parts, Recording, split_tracks
from highd_lc.io.highd_csv import fault
from highd_lc.stages.cross_checks import Verdict, files_by_kind, findings, verdicts
from highd_lc.vocab import names
from highd_lc.vocab.cross_checks import CROSS_CHECKS
from highd_lc.vocab.errors import InputError
from highd_lc.vocab.job import Job, JobReport, Problem

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

STAGE = "ingest"
# Share of vehicles whose tracks may be broken before it is more than a tracker's usual losses.
_LARGEST_SHARE_BROKEN = 0.05
# Most vehicles broken, into parts that are shorter than a lane change by far: no recording of vehicles at all.
_SHREDDED_SHARE, _SHREDDED_S = 0.5, 1.0


def run(job: Job) -> JobReport:
    """Read the recording's CSVs and write its tracks and the parts ``vehicles`` and ``recordings``.

    Checks are of the file as it is; the tracks written are unbroken (see ``io.highd``). Raises InputError,
    before anything is written, naming file, column and row of the first fault, or the columns that contradict each
    other in nearly all vehicles of a direction. Where some do it is a problem in the report.
    """
    settings = job.settings.ingest
    source = format_of(job.data, settings.format)
    recording = source.read(job.data, job.recording, settings)
    quality, failed = _quality(recording, job)
    if any(verdict.is_error for verdict in failed):
        # Missing frames make other columns contradict each other as well: they are the cause to name.
        _refuse_shreds(split_tracks(recording), job)
    _refuse(failed)
    if settings.remove_bias:
        recording = _without_bias(recording, quality)
    parts = split_tracks(recording)
    _refuse_shreds(parts, job)
    rows = highd.write(job.work, parts.recording, job.provenance)
    vehicles = artefacts.write_part(job, STAGE, "vehicles", _vehicles(parts))
    quality["n_jumps"] = [parts.jumps(direction) for direction in quality["driving_direction"]]
    quality["format"] = source.name
    artefacts.write_part(job, STAGE, "recordings", quality)
    noted = (Problem(job.recording, STAGE, note, warning=True) for note in recording.notes)
    problems = (*noted, *_problems(job.recording, failed), *_broken(parts))
    return JobReport({"rows": rows, "vehicles": vehicles}, problems)


def _refuse_shreds(parts: Parts, job: Job) -> None:
    """Raise InputError if frames are missing or positions jump all over the recording: nobody is seen for long."""
    broken, everybody = _n_broken(parts)
    seconds = float(parts.recording.road.tracks.index.counts.mean()) / parts.recording.meta.frame_rate
    if broken > _SHREDDED_SHARE * everybody and seconds < _SHREDDED_S:
        text = (
            f"{broken} of {everybody} vehicles miss frames or jump again and again, {len(parts.breaks)} times in "
            f"all: nobody is followed for more than {seconds:.1f} s on average; are frames left out, ids mixed up?"
        )
        files = format_of(job.data, job.settings.ingest.format).input_files(job.data, job.recording)
        raise fault(files[2], text, column="frame")


def _n_broken(parts: Parts) -> tuple[int, int]:
    """Ids that were split, and all ids."""
    return len({one.vehicle_id for one in parts.breaks}), len(np.unique(parts.recorded_id))


def _broken(parts: Parts) -> list[Problem]:
    """What is told of the tracks that were split; no warning any more if they are many."""
    broken, everybody = _n_broken(parts)
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
            "mean_acceleration": _mean_accelerations(recording),
            "recorded_id": parts.recorded_id,
        }
    )


def _mean_accelerations(recording: Recording) -> FloatArray:
    """Each vehicle's change of forward speed over its time in view [m/s^2]; NaN for a single row."""
    index, vx = recording.road.tracks.index, recording.road.tracks.vx
    first, last = index.starts[:-1], index.starts[1:] - 1
    seconds = (index.frame[last] - index.frame[first]) / recording.meta.frame_rate
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(seconds > 0.0, (vx[last] - vx[first]) / seconds, np.nan))


def _without_bias(recording: Recording, quality: pd.DataFrame) -> Recording:
    bias = dict(zip(quality["driving_direction"], quality["mean_acceleration"], strict=True))
    tracks = recording.road.tracks
    of_vehicle = np.array([bias[direction] for direction in recording.vehicles.direction])
    ax = tracks.ax - np.repeat(of_vehicle, tracks.index.counts)
    return replace(recording, road=replace(recording.road, tracks=replace(tracks, ax=ax)))


def _refuse(failed: list[Verdict]) -> None:
    """Raise the first contradictions of a recording that are errors, the most telling first."""
    errors = [verdict for verdict in failed if verdict.is_error]
    if errors:
        errors.sort(key=lambda verdict: list(CROSS_CHECKS).index(verdict.check.name))
        more = f" (and {len(errors) - 1} more contradictions)" if len(errors) > 1 else ""
        raise InputError(f"{errors[0].text}{more}")


def _problems(recording: int, failed: list[Verdict]) -> list[Problem]:
    return [Problem(recording, STAGE, verdict.text, warning=not verdict.check.listed) for verdict in failed]


def _quality(recording: Recording, job: Job) -> tuple[pd.DataFrame, list[Verdict]]:
    """The table ``recordings``: a row for each direction that has vehicles; and the cross-checks that failed."""
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
    found, files = findings(recording, facts), files_by_kind(job)
    said = format_of(job.data, settings.format)
    rows: list[dict[str, object]] = []
    failed: list[Verdict] = []
    for direction in np.unique(metas.direction).tolist():
        own = np.flatnonzero(metas.direction == direction)
        failed += (own_failed := verdicts(found, own, direction=direction, files=files, said=said))
        rows.append(
            {
                **_road(recording, direction),
                **_counts(recording, facts, own),
                **_motion(recording, own, trim=settings.trim_ends_m),
                **{f"share_{name}": finding.share(own) for name, finding in found.items()},
                "bias_removed": settings.remove_bias,
                "failed_checks": [verdict.short for verdict in own_failed],
            }
        )
    return pd.DataFrame(rows), failed


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
