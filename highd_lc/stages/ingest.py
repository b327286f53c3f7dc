"""Ingest: a recording's three CSV files to tracks, vehicles, and a line on each carriageway's quality."""

from dataclasses import replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from highd_lc.algorithms import data_quality
from highd_lc.algorithms.track_index import TrackIndex
from highd_lc.io import artefacts, tracks_file
from highd_lc.io.highd import Recording, read_recording
from highd_lc.io.highd_metas import VehicleMetas
from highd_lc.vocab import names
from highd_lc.vocab.job import Job, JobReport, Problem

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

STAGE = "ingest"
# Tolerances of the cross-checks against the metas, which are rounded to 0.01 and computed from values before
# rounding: a gap is the difference of four rounded numbers; the travelled distance that of two centres.
_GAP_TOLERANCE_M = 0.05
_TIME_GAP_TOLERANCE = 0.03
_TRAVELLED_TOLERANCE_M = 0.5
# Share of vehicles that has to agree. HighD itself reaches 0.9998 for lane changes (HIGHD.md).
_NEEDED_SHARE = {"n_frames": 1.0, "lane_changes": 0.999, "min_gap": 0.99, "min_time_gap": 0.99, "travelled": 0.99}


def run(job: Job) -> JobReport:
    """Read the recording's CSVs and write its tracks and the parts ``vehicles`` and ``recordings``.

    Raises InputError, before anything is written, naming file, column and row of the first fault. A failed
    cross-check against the metas is a problem in the report.
    """
    recording = read_recording(job.data, job.recording)
    index = TrackIndex.of(recording.tracks.vehicle, recording.tracks.frame)
    quality = _quality(recording, index, job)
    if job.settings.ingest.remove_bias:
        recording = _without_bias(recording, quality)
    rows = tracks_file.write(job.work, recording, job.provenance)
    vehicles = artefacts.write_part(job, STAGE, "vehicles", _vehicles(recording))
    artefacts.write_part(job, STAGE, "recordings", quality)
    return JobReport({"rows": rows, "vehicles": vehicles}, tuple(_problems(job.recording, quality)))


def _vehicles(recording: Recording) -> pd.DataFrame:
    metas, tracks = recording.vehicles, recording.tracks
    starts = TrackIndex.of(tracks.vehicle, tracks.frame).starts
    return pd.DataFrame(
        {
            "recording_id": recording.number,
            "vehicle_id": metas.id,
            "driving_direction": metas.direction,
            "class": metas.vehicle_class.astype(object),
            "length": metas.length,
            "width": metas.width,
            "first_frame": tracks.frame[starts[:-1]],
            "last_frame": tracks.frame[starts[1:] - 1],
        }
    )


def _without_bias(recording: Recording, quality: pd.DataFrame) -> Recording:
    bias = np.zeros(3)
    bias[quality["driving_direction"]] = quality["mean_acceleration"]
    tracks = recording.tracks
    ax = tracks.ax - bias[recording.vehicles.direction][tracks.vehicle]
    return replace(recording, tracks=replace(tracks, ax=ax))


def _problems(recording: int, quality: pd.DataFrame) -> list[Problem]:
    return [
        Problem(
            recording,
            STAGE,
            f"direction {row.driving_direction}: tracks and tracksMeta disagree on {', '.join(row.failed_checks)}",
        )
        for row in quality.itertuples()
        if row.failed_checks
    ]


def _quality(recording: Recording, index: TrackIndex, job: Job) -> pd.DataFrame:
    """The table ``recordings``: a row for each direction that has vehicles."""
    tracks = recording.tracks
    difference = data_quality.disagreement(index, tracks.x, tracks.vx, rate=recording.meta.frame_rate)
    agreement = _agreement(recording, index)
    holes = data_quality.holes(index)
    rows = []
    for direction in np.unique(recording.vehicles.direction):
        own = recording.vehicles.direction == direction
        rows.append(
            {
                "recording_id": recording.number,
                "driving_direction": direction,
                "bias_removed": job.settings.ingest.remove_bias,
                **_road(recording, int(direction)),
                **_counts(recording, own, holes),
                **_motion(recording, index, own),
                **_disagreement(recording, difference, own, trim=job.settings.ingest.trim_ends_m),
                **_checks(agreement, own),
            }
        )
    return pd.DataFrame(rows)


def _road(recording: Recording, direction: int) -> dict[str, object]:
    meta = recording.meta
    markings = meta.upper - meta.upper[0] if direction == 1 else (meta.lower[-1] - meta.lower)[::-1]
    entry, stop = recording.extent[direction - 1]
    return {
        "location_id": meta.location,
        "frame_rate": meta.frame_rate,
        "markings": markings.round(6),
        "entry_m": entry,
        "exit_m": stop,
    }


def _counts(recording: Recording, own: BoolArray, holes: NDArray[np.int64]) -> dict[str, object]:
    tracks, metas = recording.tracks, recording.vehicles
    rows = own[tracks.vehicle]
    n_rows = int(rows.sum())
    return {
        "n_vehicles": int(own.sum()),
        "n_trucks": int((metas.vehicle_class[own] == names.TRUCK).sum()),
        "n_rows": n_rows,
        "n_holes": int(holes[own].sum()),
        "n_duplicates": int(recording.duplicates[own].sum()),
        "share_outside": float((tracks.lane[rows] == 0).mean()),
        "share_lane_mismatch": float(recording.lane_mismatches[own].sum() / n_rows),
    }


def _motion(recording: Recording, index: TrackIndex, own: BoolArray) -> dict[str, object]:
    tracks = recording.tracks
    change, time = data_quality.mean_speed_change(index, tracks.vx, recording.meta.frame_rate)
    total = float(time[own].sum())
    return {
        "mean_acceleration": float(tracks.ax[own[tracks.vehicle]].mean()),
        "mean_speed_change": float(change[own].sum()) / total if total > 0 else float("nan"),
    }


def _disagreement(
    recording: Recording, difference: FloatArray, own: BoolArray, *, trim: float
) -> dict[str, object]:
    """Position against speed near the ends and between them, and its profile along the section."""
    tracks = recording.tracks
    rows = own[tracks.vehicle]
    x, values = tracks.x[rows], difference[rows]
    entry, stop = recording.extent[recording.vehicles.direction[own][0] - 1]
    first, last = x < entry + trim, x > stop - trim
    size = np.abs(values)
    return {
        "disagreement_entry": data_quality.mean_where(size, first),
        "disagreement_inner": data_quality.mean_where(size, ~first & ~last),
        "disagreement_exit": data_quality.mean_where(size, last),
        "disagreement_profile": data_quality.profile(values, x, entry=entry, stop=stop),
    }


def _agreement(recording: Recording, index: TrackIndex) -> dict[str, tuple[BoolArray, BoolArray]]:
    """For each cross-check: which vehicles have it, and which of them agree with the metas."""
    tracks, metas = recording.tracks, recording.vehicles
    facts = data_quality.vehicle_facts(
        index,
        x=tracks.x,
        vx=tracks.vx,
        lane=tracks.lane,
        leader=_leader_index(tracks.leader_id, metas),
        length=metas.length,
    )
    everyone = np.ones(len(metas.id), dtype=bool)
    gap_known = (metas.min_gap > 0) & np.isfinite(facts.min_gap)
    time_gap_known = (metas.min_time_gap > 0) & np.isfinite(facts.min_time_gap)
    time_gap_error = np.abs(facts.min_time_gap - metas.min_time_gap)
    return {
        "n_frames": (everyone, facts.n_frames + recording.duplicates == metas.n_frames),
        "lane_changes": (everyone, facts.lane_changes == metas.n_lane_changes),
        "min_gap": (gap_known, np.abs(facts.min_gap - metas.min_gap) <= _GAP_TOLERANCE_M),
        "min_time_gap": (
            time_gap_known,
            time_gap_error <= _TIME_GAP_TOLERANCE * np.maximum(1.0, metas.min_time_gap),
        ),
        "travelled": (everyone, np.abs(facts.travelled - metas.travelled) <= _TRAVELLED_TOLERANCE_M),
    }


def _leader_index(leader_id: NDArray[np.int64], metas: VehicleMetas) -> NDArray[np.int64]:
    """Index of the vehicle behind each leader id, -1 = none; looked up once for each run of equal ids."""
    starts = np.flatnonzero(np.diff(leader_id, prepend=-1))
    ids = leader_id[starts]
    index = np.searchsorted(metas.id, ids).clip(max=len(metas.id) - 1)
    index = np.where(metas.id[index] == ids, index, -1)
    return np.repeat(index, np.diff(starts, append=len(leader_id)))


def _checks(agreement: dict[str, tuple[BoolArray, BoolArray]], own: BoolArray) -> dict[str, object]:
    shares, failed = {}, []
    for name, (known, equal) in agreement.items():
        total, agree = int((known & own).sum()), int((known & own & equal).sum())
        shares[f"share_{name}"] = agree / total if total else float("nan")
        if total - agree > max(1, (1 - _NEEDED_SHARE[name]) * total):
            failed.append(f"{name} ({total - agree} of {total} vehicles)")
    return {**shares, "failed_checks": failed}
