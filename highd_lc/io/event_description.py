"""Lane changes in words and as tables: the list of all, and one with its frames, roles, or why it is not used."""

import json
from pathlib import Path
from typing import Any

import pandas as pd

from highd_lc.io import artefacts
from highd_lc.vocab import names
from highd_lc.vocab.errors import UsageError

_FRAMES = ("start_frame", "crossing_frame", "end_frame")
_OF_EVENTS = ["event_id", "duration_s", "lateral_shift_m", "follower_ids"]
ANY: str = "any"
"""Stands for every reason why a change of lane is not used."""


def list_events(
    work: Path,
    *,
    direction: str | None = None,
    vehicle_class: str | None = None,
    recordings: tuple[int, ...] = (),
    reason: str | None = None,
) -> pd.DataFrame:
    """The lane changes of a work folder.

    Args:
        work: folder in which extraction has run.
        direction: ``left`` or ``right`` only.
        vehicle_class: of the ego, ``Car`` or ``Truck`` only.
        recordings: of these recordings only; empty = all.
        reason: None = the usable ones; a code = those not used for that reason; ``any`` = all that are not used.

    Returns:
        A row a change: the columns of ``crossings``; of usable ones duration_s [s], lateral_shift_m [m] and
        n_followers as well, missing for the others.

    Raises:
        UsageError: a word is unknown, or one of the recordings has no change of lane.
        ArtefactError: extraction has not run.
    """
    _refuse_unknown(direction=(direction, (names.LEFT, names.RIGHT)), reason=(reason, (*names.REASONS, ANY)))
    _refuse_unknown(**{"class": (vehicle_class, names.CLASSES)})
    found = artefacts.read(work, "crossings")
    if missing := sorted(set(recordings) - set(found["recording_id"])):
        known = ", ".join(f"{n}" for n in sorted(set(found["recording_id"]))[:10])
        raise UsageError(f"recording {missing[0]} has no change of lane in {work}; known are {known or 'none'}")
    kept = found["usable"] == (reason is None)
    for column, value in (("direction", direction), ("ego_class", vehicle_class)):
        kept &= value is None or found[column] == value
    kept &= not recordings or found["recording_id"].isin(recordings)
    kept &= reason in (None, ANY) or found["reason"] == reason
    return _with_events(found[kept], artefacts.read(work, "events")[_OF_EVENTS])


def _refuse_unknown(**chosen: tuple[str | None, tuple[str, ...]]) -> None:
    for option, (value, allowed) in chosen.items():
        if value is not None and value not in allowed:
            raise UsageError(f"--{option} {value!r}: one of {', '.join(allowed)} is needed")


def _with_events(found: pd.DataFrame, events: pd.DataFrame) -> pd.DataFrame:
    """Changes of lane with what is known of the usable ones alone."""
    counts = pd.array([len(ids) for ids in events["follower_ids"]], dtype="Int64")
    of_events = events.drop(columns="follower_ids").assign(n_followers=counts)
    return found.merge(of_events, on="event_id", how="left")


def list_text(found: pd.DataFrame) -> str:
    """The lane changes of ``list_events`` as lines of text, a dash where something is missing."""
    counts = found.select_dtypes("Int64")  # pandas writes their missing values as <NA> whatever it is told
    shown = found.assign(**{str(c): counts[c].astype(object).where(counts[c].notna(), "-") for c in counts})
    return shown.to_string(index=False, na_rep="-") if len(shown) else "none"


def records(frame: pd.DataFrame) -> list[dict[str, Any]]:
    """A table as JSON has it: a row an object, what is missing is null."""
    rows: list[dict[str, Any]] = json.loads(frame.to_json(orient="records", double_precision=15))
    return rows


def event_facts(work: Path, event_id: str) -> dict[str, Any]:
    """What the artefacts say of one lane-id change, as values: its columns, and of a usable one its roles.

    Raises UsageError if there is none of that id, ArtefactError if extraction has not run.
    """
    crossing = _crossing(work, event_id)
    about = records(crossing.to_frame().T)[0]
    if not crossing["usable"]:
        return about
    event, tracks, vehicles = _event_tables(work, crossing)
    roles = [_role_facts(role, rows, vehicles) for role, rows in tracks.groupby("role", sort=False)]
    return about | records(event.to_frame().T)[0] | {"roles": roles}


def _role_facts(role: object, rows: pd.DataFrame, vehicles: pd.DataFrame) -> dict[str, Any]:
    vehicle = int(rows["vehicle_id"].iloc[0])
    about = vehicles[vehicles["vehicle_id"] == vehicle].iloc[0]
    start = rows.iloc[int(rows["t"].abs().argmin())]
    return {
        "role": str(role),
        "vehicle_id": vehicle,
        "class": about["class"],
        "length_m": float(about["length"]),
        "width_m": float(about["width"]),
        "x_m": float(start["x"]),
        "vx_mps": float(start["vx"]),
        "from_s": float(rows["t"].min()),
        "to_s": float(rows["t"].max()),
        "calibration_samples": int(rows["calibration"].sum()),
    }


def describe_event(work: Path, event_id: str) -> str:
    """What the artefacts say of one lane-id change, usable or not, as lines of text.

    Raises UsageError if there is none of that id, ArtefactError if extraction has not run.
    """
    crossing = _crossing(work, event_id)
    lines = [_headline(crossing), _verdict(crossing), _frames(crossing)]
    if crossing["usable"]:
        lines += _details(*_event_tables(work, crossing))
    return "\n".join(lines)


def _crossing(work: Path, event_id: str) -> "pd.Series[Any]":
    crossings = artefacts.read(work, "crossings")
    ids = crossings["event_id"].tolist()  # arrow compares with UTF-8 alone, and an argument may be anything
    found = crossings[[known == event_id for known in ids]]
    if found.empty:
        raise UsageError(f"no lane-id change {event_id!r}{_nearest(ids, event_id)}")
    return found.iloc[0]


def _event_tables(work: Path, crossing: "pd.Series[Any]") -> tuple["pd.Series[Any]", pd.DataFrame, pd.DataFrame]:
    """A usable event's row, its rows of ``event_tracks``, and the vehicles of its recording."""
    recording, event_id = int(crossing["recording_id"]), crossing["event_id"]
    events, tracks, vehicles = (
        artefacts.read(work, name, recording=recording) for name in ("events", "event_tracks", "vehicles")
    )
    return events[events["event_id"] == event_id].iloc[0], tracks[tracks["event_id"] == event_id], vehicles


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
