"""Who drives the followers of a scene: from rows of ``followers`` or ``follower_models`` to a scene's drivers."""

from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from highd_lc.core.lcm import moved_behind
from highd_lc.io import artefacts
from highd_lc.planning.scene import Followers, Motion
from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS, TABLE3_MEANS
from highd_lc.vocab.errors import ArtefactError
from highd_lc.vocab.follower_names import parse
from highd_lc.vocab.tables.prediction import FOLLOWER_MODELS

FloatArray = NDArray[np.float64]

Columns = dict[str, NDArray[Any]]
"""Columns of a few rows of a table."""

_FIT_COLUMNS = ["follower", "leader_length_m", "spread", *PARAMETERS]
_MODEL_COLUMNS = [c for c in FOLLOWER_MODELS.column_names if c not in ("event_id", "recording_id", "fold")]
_FROM_FITS: Final = (names.OWN_FIT, names.MEAN, names.TABLE3)
"""Follower models whose drivers stand in ``followers``; all others in ``follower_models``."""


def grouped(
    name: str, frame: pd.DataFrame, *, by: list[str], order: str, columns: list[str]
) -> dict[tuple[str, ...], Columns]:
    """Columns of each group's rows. Slices of a table in its order: a frame a group costs ten times as much.

    Raises ArtefactError if the table is in another order.
    """
    keys = [frame[column].array for column in by]
    changes = np.zeros(max(len(frame) - 1, 0), bool)
    for key in keys:
        changes |= np.asarray(key[1:] != key[:-1], bool)
    along = frame[order].to_numpy()
    starts = np.flatnonzero(np.concatenate([[True], changes])) if len(frame) else np.zeros(0, int)
    # Keys of the groups alone are taken out: value by value, text in arrow's memory is slow.
    names_of = list(zip(*(key.take(starts).tolist() for key in keys), strict=True))
    if len(set(names_of)) < len(names_of) or not np.all(changes | (along[1:] >= along[:-1])):
        raise ArtefactError(f"{name}: rows are not ordered by {', '.join([*by, order])}")
    arrays = {column: frame[column].to_numpy() for column in columns}
    return {
        key: {column: values[first:stop] for column, values in arrays.items()}
        for key, (first, stop) in zip(names_of, pairwise([*starts.tolist(), len(frame)]), strict=True)
    }


def read_drivers(
    work: Path, recording: int, followers: pd.DataFrame, model: str
) -> dict[tuple[str, ...], Columns]:
    """Of each event what a scene needs of its followers under a model. Raises ArtefactError without that model."""
    grouping = partial(grouped, by=["event_id"], order="follower")
    if model in _FROM_FITS:
        return grouping("followers", _alike(work, followers, model), columns=_FIT_COLUMNS)
    rows = artefacts.read(work, "follower_models", recording=recording)
    rows = rows[rows["model"] == model]
    # An event that could not be made a scene of has no rows; validate lists it.
    whole = followers[followers["event_id"].isin(rows["event_id"])]
    if len(rows) < len(whole) or len(rows) == 0 < len(followers):
        have = f"model {model!r}: {len(rows)} of the {len(followers)} followers of recording {recording:02d}"
        raise ArtefactError(f"follower_models: {have}; calibrate with that model, or choose another")
    return grouping("follower_models", rows, columns=_MODEL_COLUMNS)


def judged_drivers(work: Path, recording: int) -> dict[str, dict[tuple[str, ...], Columns]]:
    """By model that prediction judges, what of each event's followers a scene needs."""
    rows = artefacts.read(work, "follower_models", recording=recording)
    found = {}
    for model in rows["model"].unique():
        own = rows[rows["model"] == model]
        found[str(model)] = grouped(
            "follower_models", own, by=["event_id"], order="follower", columns=_MODEL_COLUMNS
        )
    return found


def behind_recorded(followers: Followers, drivers: Columns, model: str) -> Followers:
    """The followers with the drivers that prediction judges: a model's rows of ``follower_models`` of an event."""
    return replace(followers, **_behaviour(drivers, parse(model).base))


def _alike(work: Path, fits: pd.DataFrame, model: str) -> pd.DataFrame:
    """The followers with the parameters that a model of the fits gives them, and the leader length of their L."""
    if model == names.OWN_FIT:
        return fits
    columns = [*PARAMETERS, "leader_length_m"]
    everybody = artefacts.read(work, "followers", columns=["status", *columns])
    fitted = everybody.loc[everybody["status"] == names.FITTED, columns]
    if model == names.TABLE3 or fitted.empty:
        return fits.assign(**dict(zip(columns, [*TABLE3_MEANS.as_array(), np.nan], strict=True)))
    return fits.assign(**fitted.mean())


def driven(
    followers: Followers, drivers: Columns, model: str, ego_length: float, target_leader: Motion | None
) -> Followers:
    """The followers with a model's drivers: its rows of an event."""
    if model not in _FROM_FITS:
        return replace(followers, **_behaviour(drivers, parse(model).base))
    L, behind = float(drivers["L"][0]), float(drivers["leader_length_m"][0])
    bare: dict[str, Any] = {name: Followers.__dataclass_fields__[name].default for name in _BEHAVIOUR}
    return replace(
        followers,
        parameters=_parameters(drivers, [ego_length, *followers.length[:-1]]),
        L_no_change=moved_behind(L, behind, target_leader.length if target_leader is not None else behind),
        spread=_spread(drivers),
        **bare,
    )


_BEHAVIOUR: Final = ("family", "memory", "relaxation", "need", "a_0", "drift", "moment")


def _behaviour(drivers: Columns, base: str) -> dict[str, Any]:
    """What of the followers a model decides, from an event's rows of ``follower_models``."""
    parameters = np.stack([drivers[name] for name in PARAMETERS], axis=1).astype(np.float64)
    family, first_L = str(drivers["family"][0]), float(drivers["L_before"][0])
    if family == names.FUNCTION:
        family, parameters = base, _of_function(drivers["parameters"])
        first_L = float(parameters[0, -1])
    return {
        "parameters": parameters,
        "L_no_change": first_L,
        "spread": _spread(drivers) if base == names.POPULATION else None,
        "family": family,
        "memory": drivers["memory_s"].astype(np.float64),
        "relaxation": drivers["relaxation_s"].astype(np.float64),
        "need": drivers["need"].astype(np.float64),
        "a_0": drivers["a_0"].astype(np.float64),
        "drift": drivers["drift"].astype(np.float64),
        "moment": drivers["moment"].astype(np.float64),
    }


def _spread(drivers: Columns) -> FloatArray:
    return np.array([[row.get(p, 0.0) for p in PARAMETERS] for row in map(dict, drivers["spread"])])


def _of_function(rows: NDArray[Any]) -> FloatArray:
    """The parameters of a function of somebody's own where kernels have the LCM's six, shape (p, 6)."""
    out = np.zeros((len(rows), len(PARAMETERS)))
    for slots, row in zip(out, rows, strict=True):
        values = list(dict(row).values())
        slots[: len(values)] = values
    return out


def _parameters(fits: Columns, leader_lengths: list[float]) -> FloatArray:
    """LCM of each follower, L moved behind its leader of the replay (= L_replay of a fit), shape (p, 6)."""
    parameters = np.stack([fits[name] for name in PARAMETERS], axis=1).astype(np.float64)
    old_and_new = zip(fits["L"], fits["leader_length_m"], leader_lengths, strict=True)
    parameters[:, -1] = [moved_behind(*lengths) for lengths in old_and_new]
    return parameters
