"""Calibrate: every follower's LCM from its car-following before t_start; a pool's driver for those without one.

Beside them the matched controls of a recording's cut-ins: from its tracks to rows of ``controls``.
"""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from highd_lc.core.drive import hardest_braking
from highd_lc.core.lcm import moved_behind
from highd_lc.drivers.calibration import (
    FollowerFit,
    fit_follower,
    fit_idm,
    follower_seed,
    method_name,
    unfitted,
)
from highd_lc.drivers.identifiability import (
    EVERYBODY,
    FittedDrivers,
    Identifiability,
    PoolingStudy,
    identifiability,
    pool_drivers,
    refit,
    study_pooling,
    with_parameters,
)
from highd_lc.drivers.prediction import (
    COVARIATES,
    EXTERNALITY_HORIZONS,
    Rows,
    Scales,
    Starts,
    loss_change,
    match,
    speeds,
    starts,
)
from highd_lc.io import artefacts
from highd_lc.stages import population_tables
from highd_lc.stages.prediction import predict, scales
from highd_lc.stages.responses import Traffic, lane_kilometres, response_rows
from highd_lc.stages.scenes import RecordedFollower, read_scene_tables, recorded_followers, track_of, track_row
from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS, TABLE3_MEANS
from highd_lc.vocab.follower_names import parse
from highd_lc.vocab.job import Combination, Job, JobReport, Problem
from highd_lc.vocab.settings import Settings
from highd_lc.vocab.tables import TABLES

STAGE = "calibrate"
PART_TABLES = ("followers", "follower_tracks", "responses", "controls")

NO_LEADER = "no_leader"
_POOL_METHOD, _PUBLISHED_METHOD = "driver of the pool", "published means"

Row = dict[str, Any]


def run(job: Job) -> JobReport:
    """Fit every follower of a recording's events; write the parts ``followers`` and ``follower_tracks``.

    Who cannot be fitted carries the published means here; ``combine`` gives him a pool's driver.
    """
    fits, tracks, idm = [], [], {}
    for follower in recorded_followers(job.work, job.recording):
        fit, row = fit_row(follower, job.settings)
        idm[follower.event_id, follower.rank] = _idm(follower, fit, row["seed"], job.settings)
        fits.append(row)
        if not fit.reason and follower.track is not None:
            about = {name: row[name] for name in ("event_id", "recording_id", "follower")}
            tracks.append(about | track_row(follower.track))
    followers = _frame("followers", fits)
    responses, failed = _responses(job, followers)
    keys = zip(responses["event_id"], responses["follower"], strict=True)
    responses["idm"] = pd.Series([idm[key] for key in keys], responses.index, dtype=object)
    events = artefacts.read(job.work, "events", recording=job.recording)
    found = control_rows(job.work, job.recording, responses, events, scales(job.settings))
    for name, frame in (
        ("followers", followers),
        ("follower_tracks", _frame("follower_tracks", tracks)),
        ("responses", responses),
        ("controls", _frame("controls", list(found))),
    ):
        artefacts.write_part(job, STAGE, name, frame)
    return JobReport({"fitted": len(tracks), "not fitted": len(fits) - len(tracks)}, failed)


def fit_row(follower: RecordedFollower, settings: Settings) -> tuple[FollowerFit, Row]:
    """A follower's fit, and its columns of ``followers``; the published means where there is none."""
    seed = follower_seed(settings.seed, follower.event_id, follower.rank)
    fit = unfitted(0, NO_LEADER)
    if follower.track is not None:
        hardest = hardest_braking(settings.validation.followers.b_max)
        fit = fit_follower(follower.track, settings.calibrate, seed=seed, hardest=hardest)
    about = {"event_id": follower.event_id, "recording_id": follower.recording_id, "follower": follower.rank}
    return fit, about | _follower_row(follower, fit, settings) | {"seed": seed}


def _idm(follower: RecordedFollower, fit: FollowerFit, seed: int, settings: Settings) -> list[float]:
    """The IDM of a follower who has a fit, where a model asks for it."""
    models = (*settings.calibrate.models, *settings.validation.follower_models)
    if fit.reason or follower.track is None or names.IDM not in {parse(name).base for name in models}:
        return []
    hardest = hardest_braking(settings.validation.followers.b_max)
    found = fit_idm(follower.track, follower.leader_length, settings.calibrate, seed=seed, hardest=hardest)
    return np.delete(found, 3).tolist()


def _responses(job: Job, followers: pd.DataFrame) -> tuple[pd.DataFrame, tuple[Problem, ...]]:
    """What the recording's followers did behind the lane changers; and the events of which none is known."""
    settings = job.settings.validation
    tables = read_scene_tables(job.work, job.recording, settings, fits=followers)
    about = artefacts.read(job.work, "recordings", recording=job.recording)
    location = int(about["location_id"].iloc[0]) if len(about) else 0
    failed: list[str] = []
    traffic = Traffic(tables.vehicles, lane_kilometres(about))
    rows = list(response_rows(tables, settings, traffic, location=location, failed=failed))
    return _frame("responses", rows), tuple(Problem(job.recording, STAGE, text) for text in failed)


def _frame(name: str, rows: list[Row]) -> pd.DataFrame:
    return pd.DataFrame(rows, columns=list(TABLES[name].column_names), dtype=None if rows else object)


def _follower_row(follower: RecordedFollower, fit: FollowerFit, settings: Settings) -> Row:
    row = {
        "vehicle_id": follower.vehicle_id,
        "class": follower.vehicle_class,
        "leader_length_m": follower.leader_length,
        "n_samples": fit.n_samples,
    }
    if fit.reason:
        return row | _published() | {"status": names.TABLE3, "reason": fit.reason}
    L_replay = moved_behind(float(fit.parameters[-1]), follower.leader_length, follower.replay_leader_length)
    method = method_name(settings.calibrate)
    return row | _fit_columns(fit) | {"L_replay": L_replay, "status": names.FITTED, "reason": "", "method": method}


def _fit_columns(fit: FollowerFit) -> Row:
    """What a refit changes: parameters, quality, dispersion."""
    return {
        **dict(zip(PARAMETERS, fit.parameters.tolist(), strict=True)),
        "objective": fit.objective,
        "objective_ga": fit.objective_ga,
        "rmse_spacing_m": fit.quality.rmse_spacing,
        "rmse_speed_mps": fit.quality.rmse_speed,
        "rmse_acceleration": fit.quality.rmse_acceleration,
        "nrmse_spacing": fit.quality.nrmse_spacing,
        "theil_u": fit.quality.theil_u,
        "paper_j": fit.quality.paper_j,
        "at_bound": list(fit.at_bound),
        "spread": {p: float(s) for p, s in zip(PARAMETERS, fit.spread, strict=True) if np.isfinite(s)},
    }


def _published() -> Row:
    """The published means: fitted behind leaders whose length nobody printed, so L is left as it is."""
    parameters = dict(zip(PARAMETERS, TABLE3_MEANS.as_array().tolist(), strict=True))
    about = {"leader_length_m": np.nan, "at_bound": [], "spread": {}, "method": _PUBLISHED_METHOD}
    return parameters | {"L_replay": TABLE3_MEANS.L} | about


def combine(combination: Combination) -> JobReport:
    """Finish the followers, then predict with them; write the artefacts."""
    frame = _finished(combination)
    predict(combination, frame)
    return JobReport({"followers": len(frame)})


def _finished(combination: Combination) -> pd.DataFrame:
    """Study the fits, draw them together if wanted, give the unfitted their pools; write the artefacts, return the
    table ``followers``.
    """
    work, recordings, settings = combination.work, sorted(combination.recordings), combination.settings.calibrate
    rows, tracks = (_joined(work, name, recordings) for name in PART_TABLES[:2])
    lengths = _replay_leader_lengths(work, recordings)
    fitted = [row for row in rows if row["status"] == names.FITTED]
    drivers = _drivers(fitted, tracks)
    identified, pooling = _studies(drivers, combination)
    if settings.pooling == "penalised" and fitted:
        best = 0.0 if pooling is None else pooling.best_strength
        hardest = hardest_braking(combination.settings.validation.followers.b_max)
        drawn = refit(drivers, settings, strength=settings.pooling_strength or best, hardest=hardest)
        drivers = with_parameters(drivers, drawn)
        _replace(fitted, drawn, lengths)
    _fill_pools(rows, fitted, drivers, combination, lengths)
    frame = _frame("followers", rows)
    artefacts.write_frame(work, "followers", frame, combination.provenance)
    artefacts.concatenate(work, STAGE, "follower_tracks", recordings, combination.provenance)
    own = frame[frame["status"] == names.FITTED]
    for name, table in (
        ("summary_lcm", population_tables.summarise_fits(own)),
        ("identifiability", population_tables.identifiability_rows(identified, own)),
        ("pooling", population_tables.pooling_rows(pooling)),
    ):
        artefacts.write_frame(work, name, table, combination.provenance)
    return frame


def _joined(work: Path, name: str, recordings: list[int]) -> list[Row]:
    """The rows of a part table over all recordings."""
    parts = (artefacts.read_part(work, STAGE, name, recording) for recording in recordings)
    return [{str(key): value for key, value in row.items()} for part in parts for row in part.to_dict("records")]


def _drivers(fitted: list[Row], tracks: list[Row]) -> FittedDrivers:
    """The fitted followers as arrays; both lists hold the same followers in the same order."""
    return FittedDrivers(
        tuple(track_of(row) for row in tracks),
        np.array([[row[p] for p in PARAMETERS] for row in fitted]).reshape(-1, len(PARAMETERS)),
        tuple(row["class"] for row in fitted),
        tuple(row["seed"] for row in fitted),
    )


def _studies(
    drivers: FittedDrivers, combination: Combination
) -> tuple[Identifiability | None, PoolingStudy | None]:
    """Identifiability and pooled fits on a seeded sample; None where the sample is too small."""
    settings, rng = combination.settings.calibrate, np.random.default_rng(combination.settings.seed)
    hardest = hardest_braking(combination.settings.validation.followers.b_max)
    sample = drivers.take(drivers.sample(settings.study_sample, rng))
    identified = pooling = None
    if len(sample) >= 1:
        identified = identifiability(
            sample.tracks, list(sample.parameters), settings, seeds=sample.seeds, hardest=hardest
        )
    if len(sample) >= 2:
        pooling = study_pooling(sample.tracks, settings, rng=rng, hardest=hardest)
    return identified, pooling


def _replace(fitted: list[Row], drawn: list[FollowerFit], lengths: dict[tuple[str, int], float]) -> None:
    """Put other fits in the place of the fitted rows'."""
    for row, fit in zip(fitted, drawn, strict=True):
        row |= _fit_columns(fit)
        new_leader = lengths[row["event_id"], row["follower"]]
        row["L_replay"] = moved_behind(row["L"], row["leader_length_m"], new_leader)


def _fill_pools(
    rows: list[Row],
    fitted: list[Row],
    drivers: FittedDrivers,
    combination: Combination,
    lengths: dict[tuple[str, int], float],
) -> None:
    """Give every unfitted row the common driver of its class, else of everybody, if there is one."""
    settings, rng = combination.settings.calibrate, np.random.default_rng(combination.settings.seed)
    hardest = hardest_braking(combination.settings.validation.followers.b_max)
    elected = {
        pool: _driver_row(fitted[place], [row for row in fitted if pool in (EVERYBODY, row["class"])])
        for pool, place in pool_drivers(drivers, settings, rng=rng, hardest=hardest).items()
    }
    for row in rows:
        pool = row["class"] if row["class"] in elected else EVERYBODY
        if row["status"] == names.FITTED or pool not in elected:
            continue
        row |= elected[pool]
        row["status"] = names.POOL if pool == EVERYBODY else names.CLASS_POOL
        new_leader = lengths[row["event_id"], row["follower"]]
        row["L_replay"] = moved_behind(row["L"], row["leader_length_m"], new_leader)


def _driver_row(driver: Row, members: list[Row]) -> Row:
    """What a pool's rows take from its driver; the spread is that between the pool's drivers."""
    taken = {name: driver[name] for name in (*PARAMETERS, "leader_length_m", "at_bound")}
    spread = {p: float(np.std([row[p] for row in members])) for p in PARAMETERS}
    return taken | {"spread": spread, "method": _POOL_METHOD}


def _replay_leader_lengths(work: Path, recordings: list[int]) -> dict[tuple[str, int], float]:
    """Length of the leader that each follower has in the replay: the ego, then the follower before it."""
    lengths: dict[tuple[str, int], float] = {}
    for recording in recordings:
        events = artefacts.read(
            work, "events", recording=recording, columns=["event_id", "ego_id", "follower_ids"]
        )
        vehicles = artefacts.read(work, "vehicles", recording=recording, columns=["vehicle_id", "length"])
        rows: Iterable[Any] = events.itertuples()
        length = dict(zip(vehicles["vehicle_id"].tolist(), vehicles["length"].tolist(), strict=True))
        lengths |= {
            (event.event_id, rank): length[leader]
            for event in rows
            for rank, leader in enumerate([event.ego_id, *event.follower_ids[:-1]], start=1)
        }
    return lengths


_LANES = 100  # more than any carriageway has


def control_rows(
    work: Path, recording: int, responses: pd.DataFrame, events: pd.DataFrame, scales: Scales
) -> Iterator[Row]:
    """The rows of ``controls``: for each event and horizon the followers that are like HV_1 before the start."""
    if events.empty:
        return
    rate = float(events["frame_rate"].iloc[0])
    vehicles = artefacts.read(work, "vehicles", recording=recording).set_index("vehicle_id")
    rows = _rows(work, recording, vehicles)
    first = responses[responses["follower"] == 1].set_index("event_id")
    for horizon in EXTERNALITY_HORIZONS:
        candidates = starts(rows, rate, horizon)
        rows_of_events: Iterable[Any] = events.itertuples()
        for event in rows_of_events:
            if event.event_id in first.index:
                about = {"event_id": event.event_id, "recording_id": recording, "horizon_s": horizon}
                vehicle: Any = vehicles.loc[int(event.follower_ids[0])]
                group = _group(vehicle, int(event.target_lane))
                own = np.array([event.ego_id, *event.follower_ids], dtype=np.int64)
                yield about | _matched(
                    first.loc[event.event_id], group, own, candidates, rows, (rate, horizon, scales)
                )


def _matched(
    response: pd.Series,
    group: int,
    own: np.ndarray,
    candidates: Starts,
    rows: Rows,
    how: tuple[float, float, Scales],
) -> Row:
    """Controls of one follower, matched on what it did before the start behind its leader of then."""
    rate, horizon, scales = how
    x, before = response["x"][0], response["before_x"][0]
    mine = np.array([response["v"][0], response["a_0"], before - x, response["v"][0] - response["before_v"][0]])
    chosen = match(group, mine, own, candidates)
    row: Row = {"n_controls": len(chosen), "loss_change": np.nan}
    row |= {f"event_{name}": value for name, value in zip(COVARIATES, mine, strict=True)}
    row |= {f"control_{name}": np.nan for name in COVARIATES}
    if len(chosen):
        series = speeds(rows, candidates.row[chosen], rate, horizon)
        row["loss_change"] = float(loss_change(series, scales).mean())
        means = candidates.covariates[:, chosen].mean(axis=1)
        row |= {f"control_{name}": float(value) for name, value in zip(COVARIATES, means, strict=True)}
    return row


def _group(vehicle: pd.Series, lane: int) -> int:
    """Class, carriageway and lane as one number."""
    return (int(vehicle["driving_direction"]) * 2 + int(vehicle["class"] == names.TRUCK)) * _LANES + lane


def _rows(work: Path, recording: int, vehicles: pd.DataFrame) -> Rows:
    columns = ["vehicle_id", "frame", "x", "vx", "ax", "lane", "leader_id"]
    tracks = artefacts.read_tracks(work, recording, columns=columns)
    tracks = tracks.sort_values(["vehicle_id", "frame"], ignore_index=True)
    ids, frame = tracks["vehicle_id"].to_numpy(np.int64), tracks["frame"].to_numpy(np.int64)
    leader = tracks["leader_id"].fillna(-1).to_numpy(np.int64)
    place = vehicles.index.get_indexer(pd.Index(ids))
    trucks = (vehicles["class"] == names.TRUCK).to_numpy()[place]
    lane = tracks["lane"].fillna(0).to_numpy(np.int64)
    group = (vehicles["driving_direction"].to_numpy()[place] * 2 + trucks) * _LANES + lane
    half = vehicles["length"].to_numpy()[place] / 2.0
    front, v = tracks["x"].to_numpy(np.float64) + half, tracks["vx"].to_numpy(np.float64)
    ahead = _row_of(ids, frame, leader)
    known = ahead >= 0
    spacing = np.where(known, front[ahead] - front, np.nan)
    return Rows(
        ids, frame, group, np.where(known, leader, -1), v, tracks["ax"].to_numpy(np.float64), spacing,
        np.where(known, v[ahead], np.nan),
    )  # fmt: skip


def _row_of(ids: np.ndarray, frame: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """The row of another vehicle in the same frame, -1 where there is none; rows by vehicle and frame."""
    span = int(frame.max(initial=0)) + 1
    key, wanted_key = ids * span + frame, wanted * span + frame
    place = np.minimum(np.searchsorted(key, wanted_key), max(len(key) - 1, 0))
    return np.where((wanted >= 0) & (key[place] == wanted_key), place, -1) if len(key) else place
