"""Single lane changes for other people's tools: the scene of an event as a table, and written as files.

A scene holds everybody of an event every 0.1 s, recorded or as a policy plans and the followers are simulated: box
centres from the ego's centre at t_start, x along the road, y to the left [m].
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
import pyarrow.dataset as ds
from numpy.typing import NDArray

from highd_lc.io import artefacts
from highd_lc.io.event_description import event_facts
from highd_lc.io.export_formats import COLUMNS, STEP_S, WRITERS, ExportScene
from highd_lc.vocab import names
from highd_lc.vocab.errors import ArtefactError, UsageError
from highd_lc.vocab.settings import Settings
from highd_lc.vocab.tables.prediction import RECORDED

FloatArray = NDArray[np.float64]

_LICENCE: Final = (
    "recorded data in HighD's format: its licence allows no redistribution; give --raw to export it for yourself"
)


def export(
    work: Path, event_ids: Sequence[str], to: str, *, policy: str = RECORDED, out: Path, raw: bool = False
) -> list[Path]:
    """Write events in a format; nothing is written unless all of them can be.

    Args:
        work: folder in which the stages up to validate have run.
        event_ids: of the events.
        to: one of ``WRITERS``.
        policy: who plans the ego; ``recorded`` = everybody as recorded.
        out: folder to write to.
        raw: export data in HighD's format all the same.

    Returns:
        The files.

    Raises:
        UsageError: event, policy or format is unknown, or the licence of the data forbids it without ``raw``.
        ArtefactError: the motions of an event were not written.
        MissingExtraError: the format's library is not installed.
    """
    if to not in WRITERS:
        raise UsageError(f"--to {to!r}: one of {', '.join(WRITERS)} is needed")
    scenes = [export_scene(work, event_id, policy=policy, raw=raw) for event_id in dict.fromkeys(event_ids)]
    return [path for scene in scenes for path in WRITERS[to](scene, out)]


def export_scene(work: Path, event_id: str, *, policy: str = RECORDED, raw: bool = False) -> ExportScene:
    """The scene of an event. Raises as ``export``."""
    facts = event_facts(work, event_id)
    if not facts["usable"]:
        raise UsageError(f"{event_id}: not usable ({facts['reason']}): there is no scene of it")
    recording = int(facts["recording_id"])
    quality = artefacts.read(work, "recordings", recording=recording)
    model = _default_model(work)
    motions = _motions(work, event_id, recording, policy, model=model)
    if not raw and quality["format"].iloc[0] == "highd":
        raise UsageError(f"{event_id}: {_LICENCE}")
    sizes = pd.DataFrame(facts["roles"]).set_index("role")
    rows = motions[motions["role"].isin(sizes.index)].copy()
    for column, name in (
        ("vehicle_id", "vehicle_id"),
        ("class", "class"),
        ("length", "length_m"),
        ("width", "width_m"),
    ):
        rows[column] = sizes[name].loc[rows["role"]].to_numpy()
    duration = float(facts["duration_s"]) if policy == RECORDED else _duration(work, facts, policy, model)
    markings = _markings(work, facts, quality, rows)
    return ExportScene(event_id, policy, rows[list(COLUMNS)].reset_index(drop=True), markings, duration)


def _default_model(work: Path) -> str:
    """The follower model that plans every event of a run."""
    path = work / "settings.json"
    try:
        settings = Settings.model_validate_json(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ArtefactError(f"{path}: cannot be read; `highd-lc validate` makes it") from error
    return settings.validation.follower_models[0]


def _motions(work: Path, event_id: str, recording: int, policy: str, *, model: str) -> pd.DataFrame:
    """Everybody's motion with all columns: of the policy those whom it moves, of the others the recorded ones."""
    path = artefacts.partition(work, "trajectories", recording)
    if not path.is_file():
        raise ArtefactError(f"{path}: not found; `highd-lc validate` makes it")
    table = ds.dataset(path).to_table(filter=ds.field("event_id") == event_id)
    found: pd.DataFrame = table.to_pandas()
    if found.empty:
        raise ArtefactError(f"{event_id}: its motions were not written: set validate.trajectories = 'all'")
    recorded = found[(found["policy"] == RECORDED) & (found["kind"] == "recorded")]
    moved = found[(found["policy"] == policy) & (found["kind"] == "simulated") & (found["followers"] == model)]
    if policy == RECORDED:
        moved = moved.iloc[:0]
    elif moved.empty:
        known = ", ".join(sorted(set(found["policy"])))
        raise UsageError(f"{event_id}: no plan of {policy!r}; there are {known}")
    others = recorded[~recorded["role"].isin(set(moved["role"]))]
    chosen = pd.concat([moved, others]).astype({name: float for name in ("t", "x", "y", "vx", "ax")})
    return pd.concat([_complete(rows) for _, rows in chosen.groupby("role", sort=False)])


def _complete(rows: pd.DataFrame) -> pd.DataFrame:
    """A vehicle's rows with lateral speed and acceleration, by central differences, and heading."""
    rows = rows.sort_values("t")
    n = len(rows)
    vy = np.gradient(rows["y"], STEP_S) if n > 1 else np.zeros(n)
    ay = np.gradient(vy, STEP_S) if n > 1 else np.zeros(n)
    heading = np.where(rows["vx"] > 0.5, np.arctan2(vy, np.maximum(rows["vx"], 0.5)), 0.0)
    return rows.assign(t=rows["t"].round(3), vy=vy, ay=ay, heading=heading)


def _duration(work: Path, facts: dict[str, Any], policy: str, model: str) -> float:
    plans = artefacts.read(work, "plans", recording=int(facts["recording_id"]))
    own = plans[(plans["event_id"] == facts["event_id"]) & (plans["policy"] == policy)]
    own = own[(own["accounting"] == names.PRIMARY_ACCOUNTING) & (own["followers"] == model)]
    return float(own["T"].iloc[0])


def _markings(work: Path, facts: dict[str, Any], quality: pd.DataFrame, rows: pd.DataFrame) -> FloatArray:
    """Markings of the event's carriageway in the scene's y."""
    vehicles = artefacts.read(work, "vehicles", recording=int(facts["recording_id"]))
    direction = vehicles.loc[vehicles["vehicle_id"] == facts["ego_id"], "driving_direction"].iloc[0]
    own = quality[quality["driving_direction"] == direction].iloc[0]
    path = artefacts.partition(work, "tracks", int(facts["recording_id"]))
    at = (ds.field("vehicle_id") == int(facts["ego_id"])) & (ds.field("frame") == int(facts["start_frame"]))
    y = ds.dataset(path).to_table(columns=["y"], filter=at)["y"].to_numpy()
    return np.asarray(own["markings"], dtype=np.float64) - float(y[0])
