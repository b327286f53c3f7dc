"""Recordings in NGSIM's formats, made from a carriageway in road coordinates: no row of a data set is copied."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from highd_lc.io.highd import Recording, read_recording
from highd_lc.io.synthetic import write_recording
from highd_lc.vocab.sections import RecorderSettings

FOOT = 0.3048
COLUMNS = (
    "Vehicle_ID", "Frame_ID", "Total_Frames", "Global_Time", "Local_X", "Local_Y", "Global_X", "Global_Y",
    "v_Length", "v_Width", "v_Class", "v_Vel", "v_Acc", "Lane_ID", "Preceding", "Following", "Space_Headway",
    "Time_Headway",
)  # fmt: skip
_PORTAL = {"v_Length": "v_length"}  # as data.transportation.gov writes it
CAMERA = RecorderSettings(frame_rate=10.0, position_noise_m=0.0)
"""Without the smooth error of a tracker, which would move a start across its threshold now and then."""
STARTS = (1118846980200, 1118847869000, 1118848754500)
"""Moments at which periods begin [ms]."""


@dataclass(frozen=True)
class Made:
    """A carriageway of a synthetic recording. markings: from the right [m]."""

    recording: Recording
    markings: np.ndarray

    def own(self, name: str) -> np.ndarray:
        """A column of direction 2, of its tracks or its vehicles, a value a row."""
        tracks, metas = self.recording.road.tracks, self.recording.vehicles
        counts = tracks.index.counts
        if hasattr(metas, name):
            values = np.repeat(getattr(metas, name), counts)
        else:
            values = tracks.index.frame if name == "frame" else getattr(tracks, name)
        return values[np.repeat(metas.direction == 2, counts)]


def carriageway(folder: Path, *, seconds: float = 60.0, seed: int = 6, number: int = 1) -> Made:
    """The lower carriageway of a synthetic recording at 10 Hz, as HighD's reader has it."""
    folder.mkdir(parents=True, exist_ok=True)
    write_recording(folder, number, seconds, seed, settings=CAMERA)
    found = read_recording(folder, number)
    lower = found.meta.lower
    return Made(found, (lower[-1] - lower)[::-1])


def table(made: Made, *, start: int = STARTS[0], first_frame: int = 10) -> pd.DataFrame:
    """Its direction 2 as a table with NGSIM's columns, conventions and rounding."""
    x, length, ids, leader = (made.own(name) for name in ("x", "length", "id", "leader_id"))
    frame = made.own("frame") + first_frame - 1
    fronts = pd.Series(x + length / 2, index=pd.MultiIndex.from_arrays([ids, frame]))
    ahead = fronts.reindex(pd.MultiIndex.from_arrays([leader, frame])).to_numpy()
    spacing = np.nan_to_num(ahead - fronts.to_numpy())
    n_lanes = len(made.markings) - 1
    return pd.DataFrame(
        {
            "Vehicle_ID": ids,
            "Frame_ID": frame,
            "Total_Frames": made.own("n_frames"),
            "Global_Time": start + 100 * frame,
            "Local_X": ((made.markings[-1] - made.own("y")) / FOOT).round(3),
            "Local_Y": ((x + length / 2) / FOOT).round(3),
            "Global_X": 6451000.0,
            "Global_Y": 1873000.0,
            "v_Length": (length / FOOT).round(2),
            "v_Width": (made.own("width") / FOOT).round(2),
            "v_Class": np.where(made.own("vehicle_class") == "Truck", 3, 2),
            "v_Vel": (made.own("vx") / FOOT).round(2),
            "v_Acc": (made.own("ax") / FOOT).round(2),
            "Lane_ID": n_lanes + 1 - made.own("lane"),
            "Preceding": leader,
            "Following": made.own("follower_id"),
            "Space_Headway": (spacing / FOOT).round(2),
            "Time_Headway": 0.0,
        }
    )[list(COLUMNS)]


def write_csv(path: Path, rows: pd.DataFrame) -> Path:
    """As a CSV file a period."""
    path.parent.mkdir(parents=True, exist_ok=True)
    rows.to_csv(path, index=False)
    return path


def write_text(path: Path, rows: pd.DataFrame) -> Path:
    """As the text files: blanks between columns, no header."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = ("   ".join(map(str, row)) for row in rows.astype(object).itertuples(index=False))
    path.write_text("\n".join(lines) + "\n")
    return path


def write_portal(path: Path, parts: list[tuple[str, pd.DataFrame]]) -> Path:
    """As the one file of data.transportation.gov: all periods and locations, capitals of its own, a Location."""
    path.parent.mkdir(parents=True, exist_ok=True)
    whole = pd.concat([rows.assign(Location=place) for place, rows in parts], ignore_index=True)
    for name in ("O_Zone", "D_Zone", "Int_ID", "Section_ID", "Direction", "Movement"):
        whole.insert(len(whole.columns) - 5, name, "")
    whole.rename(columns=_PORTAL).to_csv(path, index=False)
    return path
