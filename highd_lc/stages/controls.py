"""Matched controls of a recording's cut-ins: from its tracks to rows of ``controls``."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from highd_lc.drivers.controls import COVARIATES, Rows, Starts, match, speeds, starts
from highd_lc.drivers.prediction import EXTERNALITY_HORIZONS, Scales, loss_change
from highd_lc.io import artefacts
from highd_lc.vocab import names

Row = dict[str, Any]

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
