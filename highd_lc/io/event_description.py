"""One lane change in words: its frames, its roles, or why it is not used."""

from pathlib import Path
from typing import Any

import pandas as pd

from highd_lc.io import artefacts
from highd_lc.vocab.errors import UsageError

_FRAMES = ("start_frame", "crossing_frame", "end_frame")


def describe_event(work: Path, event_id: str) -> str:
    """What the artefacts say of one lane-id change, usable or not, as lines of text.

    Raises UsageError if there is none of that id, ArtefactError if extraction has not run.
    """
    crossings = artefacts.read(work, "crossings")
    ids = crossings["event_id"].tolist()  # arrow compares with UTF-8 alone, and an argument may be anything
    found = crossings[[known == event_id for known in ids]]
    if found.empty:
        raise UsageError(f"no lane-id change {event_id!r}{_nearest(ids, event_id)}")
    crossing = found.iloc[0]
    lines = [_headline(crossing), _verdict(crossing), _frames(crossing)]
    if crossing["usable"]:
        recording = int(crossing["recording_id"])
        events = artefacts.read(work, "events", recording=recording)
        tracks = artefacts.read(work, "event_tracks", recording=recording)
        vehicles = artefacts.read(work, "vehicles", recording=recording)
        event = events[events["event_id"] == event_id].iloc[0]
        lines += _details(event, tracks[tracks["event_id"] == event_id], vehicles)
    return "\n".join(lines)


def _nearest(ids: list[str], event_id: str) -> str:
    """The ids of the same vehicle, or the first of all, for somebody who mistyped the frame."""
    known = [*(known for known in ids if known.startswith(event_id[:7])), *ids][:3]
    return f"; known are {', '.join(known)}, ..." if known else "; there is none at all"


def _headline(crossing: "pd.Series[Any]") -> str:
    origin, target = (
        "outside" if pd.isna(crossing[side]) else crossing[side] for side in ("origin_lane", "target_lane")
    )
    side = f" to the {crossing['direction']}" if crossing["direction"] else ""
    return (
        f"{crossing['event_id']}: recording {crossing['recording_id']}, vehicle {crossing['ego_id']} "
        f"({crossing['ego_class']}){side}, lane {origin} -> {target} (1 = rightmost)"
    )


def _verdict(crossing: "pd.Series[Any]") -> str:
    return "usable" if crossing["usable"] else f"not usable: {crossing['reason']}"


def _frames(crossing: "pd.Series[Any]") -> str:
    words = [f"{c.split('_')[0]} {'not found' if pd.isna(crossing[c]) else crossing[c]}" for c in _FRAMES]
    return f"frames: {', '.join(words)}"


def _details(event: "pd.Series[Any]", tracks: pd.DataFrame, vehicles: pd.DataFrame) -> list[str]:
    confirmed = "confirmed by" if event["roles_confirmed"] else "not all as in"
    return [
        f"duration {event['duration_s']:.2f} s, lateral shift {event['lateral_shift_m']:+.2f} m, "
        f"peak lateral speed {event['peak_lateral_speed_mps']:.2f} m/s",
        f"roles at the start ({confirmed} the file's leader ids):",
        _line("role", "vehicle", "class", "x [m]", "v [m/s]", "from [s]", "to [s]", "fit on [s]"),
        *(_role(role, rows, vehicles, event["frame_rate"]) for role, rows in tracks.groupby("role", sort=False)),
    ]


def _role(role: object, rows: pd.DataFrame, vehicles: pd.DataFrame, rate: float) -> str:
    vehicle = int(rows["vehicle_id"].iloc[0])
    kind = vehicles.loc[vehicles["vehicle_id"] == vehicle, "class"].iloc[0]
    start = rows.iloc[int(rows["t"].abs().argmin())]  # a later leader may come into view after the start
    numbers = (start["x"], start["vx"], rows["t"].min(), rows["t"].max(), rows["calibration"].sum() / rate)
    return _line(role, vehicle, kind, *(f"{number:.2f}" for number in numbers))


def _line(first: object, *others: object) -> str:
    return f"  {first!s:<18}" + "".join(f"{other!s:>12}" for other in others)
