"""Calibrate: every follower's LCM from its car-following before t_start; pools for those that cannot be fitted."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from highd_lc.algorithms.calibration import FollowerFit, fit_follower, follower_seed, method_name, unfitted
from highd_lc.algorithms.following_window import RecordedMotion, following_track
from highd_lc.io import artefacts
from highd_lc.io.lcm_summary import summarise_fits
from highd_lc.vocab import names
from highd_lc.vocab.job import Combination, Job, JobReport
from highd_lc.vocab.lcm_parameters import PARAMETERS, REPLAY_L_BOUNDS, TABLE3_MEANS
from highd_lc.vocab.tables import TABLES

STAGE = "calibrate"

NO_LEADER = "no_leader"
_COLUMNS = list(TABLES["followers"].column_names)
_POOL_METHOD, _PUBLISHED_METHOD = "median of the pool", "published means"

Row = dict[str, Any]


def run(job: Job) -> JobReport:
    """Fit every follower of a recording's events; write the part ``followers``.

    Who cannot be fitted carries the published means here; ``combine`` gives him a pool's parameters.
    """
    events = artefacts.read(job.work, "events", recording=job.recording)
    tracks = artefacts.read(job.work, "event_tracks", recording=job.recording)
    vehicles = artefacts.read(job.work, "vehicles", recording=job.recording).set_index("vehicle_id")
    motions = {key: rows.sort_values("t") for key, rows in tracks.groupby(["event_id", "role"], sort=False)}
    rows = [row for event in events.itertuples() for row in _event_rows(event, motions, vehicles, job)]
    frame = pd.DataFrame(rows, columns=_COLUMNS, dtype=None if rows else object)
    artefacts.write_part(job, STAGE, "followers", frame)
    fitted = int((frame["status"] == names.FITTED).sum())
    return JobReport({"fitted": fitted, "not fitted": len(frame) - fitted})


def _event_rows(
    event: Any, motions: dict[tuple[str, str], pd.DataFrame], vehicles: pd.DataFrame, job: Job
) -> Iterator[Row]:
    leader_role = names.TARGET_LEADER
    for rank, vehicle in enumerate(event.follower_ids, start=1):
        role = names.target_follower(rank)
        leader = motions.get((event.event_id, leader_role))
        seed = follower_seed(job.settings.seed, event.event_id, rank)
        fit, leader_length = unfitted(0, NO_LEADER), np.nan
        if leader is not None:
            recorded = _motion(leader, vehicles)
            leader_length = recorded.length
            own = motions[event.event_id, role]
            track = following_track(_motion(own[own["calibration"]], vehicles, int(vehicle)), recorded)
            fit = fit_follower(track, job.settings.calibrate, seed=seed)
        new_leader = event.ego_id if rank == 1 else event.follower_ids[rank - 2]
        about = {
            "event_id": event.event_id,
            "recording_id": event.recording_id,
            "follower": rank,
            "vehicle_id": int(vehicle),
            "class": vehicles.loc[vehicle, "class"],
            "method": method_name(job.settings.calibrate),
            "seed": seed,
        }
        yield about | _fit_columns(fit, leader_length, float(vehicles.loc[new_leader, "length"]))
        leader_role = role


def _motion(rows: pd.DataFrame, vehicles: pd.DataFrame, vehicle: int | None = None) -> RecordedMotion:
    """Rows of one vehicle; vehicle is needed where there may be no rows."""
    t, x, v, a = (rows[name].to_numpy(np.float64) for name in ("t", "x", "vx", "ax"))
    who = int(rows["vehicle_id"].iloc[0]) if vehicle is None else vehicle
    return RecordedMotion(t, x, v, a, float(vehicles.loc[who, "length"]))


def _fit_columns(fit: FollowerFit, leader_length: float, new_leader_length: float) -> Row:
    """Columns of a fit, or of the published means where there is none."""
    row = {
        "objective": fit.objective,
        "objective_ga": fit.objective_ga,
        "rmse_spacing_m": fit.quality.rmse_spacing,
        "rmse_speed_mps": fit.quality.rmse_speed,
        "rmse_acceleration": fit.quality.rmse_acceleration,
        "nrmse_spacing": fit.quality.nrmse_spacing,
        "theil_u": fit.quality.theil_u,
        "paper_j": fit.quality.paper_j,
        "n_samples": fit.n_samples,
        "at_bound": list(fit.at_bound),
        "spread": {p: float(s) for p, s in zip(PARAMETERS, fit.spread, strict=True) if np.isfinite(s)},
        "status": names.TABLE3 if fit.reason else names.FITTED,
        "reason": fit.reason,
    }
    if fit.reason:
        return row | _published()
    parameters = dict(zip(PARAMETERS, fit.parameters.tolist(), strict=True))
    L_replay = moved_behind(parameters["L"], leader_length, new_leader_length)
    return row | parameters | {"L_replay": L_replay, "leader_length_m": leader_length}


def _published() -> Row:
    """The published means: fitted behind leaders whose length nobody printed, so L is left as it is."""
    parameters = dict(zip(PARAMETERS, TABLE3_MEANS.as_array().tolist(), strict=True))
    return parameters | {"L_replay": TABLE3_MEANS.L, "leader_length_m": np.nan, "method": _PUBLISHED_METHOD}


def moved_behind(L: float, leader_length: float, new_leader_length: float) -> float:
    """L moved from the leader it was fitted behind to the leader of the replay [m] (SPEC section 3)."""
    return float(np.clip(L - leader_length + new_leader_length, *REPLAY_L_BOUNDS))


def combine(combination: Combination) -> JobReport:
    """Give the unfitted their pools, then write ``followers`` and ``summary_lcm``."""
    work, recordings = combination.work, sorted(combination.recordings)
    parts = [artefacts.read_part(work, STAGE, "followers", recording) for recording in recordings]
    fits = pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=_COLUMNS)
    fitted = fits[fits["status"] == names.FITTED]
    pools = _pools(fitted)
    groups = (_with_pools(part, pools, combination, n) for n, part in zip(recordings, parts, strict=True))
    artefacts.write_groups(work, "followers", groups, combination.provenance)
    summary = summarise_fits(fitted)
    table = artefacts.to_arrow("summary_lcm", summary, combination.provenance)
    artefacts.write_groups(work, "summary_lcm", [table], combination.provenance)
    return JobReport({"followers": len(fits), "fitted": len(fitted)})


def _pools(fitted: pd.DataFrame) -> dict[str, Row]:
    """Parameters of each class's pool and of all (key ``""``), for those that have a fitted follower.

    The median, parameter by parameter: on tracks this short many fits sit on bounds, and a mean would average
    bounds. The pool's leader length is the mean over it.
    """
    groups = {vehicle_class: rows for vehicle_class, rows in fitted.groupby("class")} | {"": fitted}
    return {
        key: {p: float(rows[p].median()) for p in PARAMETERS}
        | {"leader_length_m": float(rows["leader_length_m"].mean()), "reason": "", "method": _POOL_METHOD}
        for key, rows in groups.items()
        if len(rows)
    }


def _with_pools(part: pd.DataFrame, pools: dict[str, Row], combination: Combination, recording: int) -> pa.Table:
    """A recording's rows with pool parameters for those that were not fitted."""
    rows = part.to_dict("records")
    if any(row["status"] != names.FITTED for row in rows) and pools:
        lengths = _replay_leader_lengths(combination, recording)
        for row in rows:
            if row["status"] != names.FITTED:
                own_class = row["class"] in pools
                pool = pools[row["class"] if own_class else ""]
                new_leader = lengths[row["event_id"], row["follower"]]
                row |= pool | {"reason": row["reason"]}
                row["status"] = names.CLASS_POOL if own_class else names.POOL
                row["L_replay"] = moved_behind(pool["L"], pool["leader_length_m"], new_leader)
    frame = pd.DataFrame(rows, columns=_COLUMNS, dtype=None if rows else object)
    return artefacts.to_arrow("followers", frame, combination.provenance)


def _replay_leader_lengths(combination: Combination, recording: int) -> dict[tuple[str, int], float]:
    """Length of the leader that each follower has in the replay: the ego, then the follower before it."""
    events = artefacts.read(combination.work, "events", recording=recording)
    vehicles = artefacts.read(combination.work, "vehicles", recording=recording)
    length = dict(zip(vehicles["vehicle_id"].tolist(), vehicles["length"].tolist(), strict=True))
    return {
        (event.event_id, rank): length[leader]
        for event in events.itertuples()
        for rank, leader in enumerate([event.ego_id, *event.follower_ids[:-1]], start=1)
    }
