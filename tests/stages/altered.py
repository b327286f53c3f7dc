"""The same recording, told differently: mirrored, shuffled, renumbered, at half the frame rate."""

from pathlib import Path

import numpy as np
import pandas as pd

_KINDS = ("recordingMeta", "tracksMeta", "tracks")
_NEIGHBOURS = (
    "precedingId", "followingId", "leftPrecedingId", "leftAlongsideId", "leftFollowingId", "rightPrecedingId",
    "rightAlongsideId", "rightFollowingId",
)  # fmt: skip


def read(folder: Path) -> list[pd.DataFrame]:
    """recordingMeta, tracksMeta and tracks of recording 1."""
    return [pd.read_csv(folder / f"01_{kind}.csv") for kind in _KINDS]


def save(folder: Path, tables: list[pd.DataFrame]) -> Path:
    """Write the three files back."""
    folder.mkdir(parents=True, exist_ok=True)
    for kind, table in zip(_KINDS, tables, strict=True):
        table.to_csv(folder / f"01_{kind}.csv", index=False, float_format="%.2f")
    return folder


def _turned(markings: str, height: float) -> str:
    return ";".join(f"{height - float(y):.2f}" for y in reversed(markings.split(";")))


def mirrored(tables: list[pd.DataFrame], *, width: float = 433.21, height: float = 61.37) -> list[pd.DataFrame]:
    """The image turned by 180 degrees: direction 1 becomes 2, upper becomes lower."""
    recording, metas, tracks = (table.copy() for table in tables)
    n = sum(len(recording[side].iloc[0].split(";")) for side in ("upperLaneMarkings", "lowerLaneMarkings"))
    upper, lower = recording["upperLaneMarkings"].iloc[0], recording["lowerLaneMarkings"].iloc[0]
    recording["upperLaneMarkings"], recording["lowerLaneMarkings"] = _turned(lower, height), _turned(upper, height)
    metas["drivingDirection"] = 3 - metas["drivingDirection"]
    tracks["x"] = width - tracks["x"] - tracks["width"]
    tracks["y"] = height - tracks["y"] - tracks["height"]
    for column in ("xVelocity", "yVelocity", "xAcceleration", "yAcceleration"):
        tracks[column] = -tracks[column]
    tracks["laneId"] = n + 2 - tracks["laneId"]
    return [recording, metas, tracks]


def shuffled(tables: list[pd.DataFrame], rng: np.random.Generator) -> list[pd.DataFrame]:
    """Rows of the vehicles' files in another order."""
    recording, *others = tables
    return [recording, *(table.iloc[rng.permutation(len(table))] for table in others)]


def renumbered(tables: list[pd.DataFrame], rng: np.random.Generator) -> tuple[list[pd.DataFrame], dict[int, int]]:
    """Other vehicle ids, and the old one of each."""
    recording, metas, tracks = (table.copy() for table in tables)
    new = rng.permutation(np.arange(1, 5 * len(metas)))[: len(metas)]
    translation = dict(zip(metas["id"].tolist(), new.tolist(), strict=True)) | {0: 0}
    metas["id"] = metas["id"].map(translation)
    for column in ("id", *_NEIGHBOURS):
        tracks[column] = tracks[column].map(translation)
    return [recording, metas, tracks], {b: a for a, b in translation.items()}


def halved(tables: list[pd.DataFrame]) -> list[pd.DataFrame]:
    """Every second frame, renumbered from 1."""
    recording, metas, tracks = (table.copy() for table in tables)
    recording["frameRate"] = recording["frameRate"] / 2
    tracks = tracks[tracks["frame"] % 2 == 1].copy()
    tracks["frame"] = (tracks["frame"] + 1) // 2
    by = tracks.groupby("id")["frame"]
    metas = metas[metas["id"].isin(tracks["id"])].set_index("id")
    metas["initialFrame"], metas["finalFrame"], metas["numFrames"] = by.min(), by.max(), by.size()
    changed = (tracks["laneId"].diff() != 0) & (tracks["id"].diff() == 0)
    metas["numLaneChanges"] = changed.groupby(tracks["id"]).sum()
    return [recording, metas.reset_index(), tracks]
