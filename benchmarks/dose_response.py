"""How drivers respond to a car that changes lane in front of them: ours beside the published aggregates of HighD.

python benchmarks/dose_response.py WORK

WORK is a work folder after ``highd-lc extract``. HV_1 is the follower on the target lane that is nearest at
t_start; its change of speed and its peak braking are grouped by spacing (front to front, to the ego) and closing
speed (v_HV1 - v_ego) at t_start. The carriageway's drift, the median acceleration of all its vehicles, is taken
out of the changes of speed. Drivers that change lane themselves are left out. Below stand the errors of models
that know nothing of the lane change, the drift left in.
"""

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from highd_lc.io import artefacts

SECONDS = (3.0, 5.0, 8.0)
_SMOOTHING_S, _BEFORE_S, _DECAY_S = 1.0, 0.5, 3.0
_OWN_CHANGE_M = 1.9  # a driver who moves that far sideways changes lane himself


class Cell(NamedTuple):
    """A row of the published table: bounds of spacing [m] and closing speed [m/s], events, mean change of speed
    after 3, 5 and 8 s [m/s], standard deviation after 5 s, peak braking, mean and 95 % [m/s^2]."""

    spacing: tuple[float, float]
    closing: tuple[float, float]
    n: int
    after: tuple[float, float, float]
    sd: float
    peak: tuple[float, float]


_INF = np.inf
PUBLISHED = (
    Cell((0, 20), (-_INF, -2), 226, (-0.04, -0.08, -0.16), 0.68, (0.16, 0.59)),
    Cell((0, 20), (-2, 0), 18, (0.09, 0.08, 0.28), 1.31, (0.24, 0.61)),
    Cell((0, 20), (0, 2), 13, (-0.82, -1.21, -1.38), 1.21, (0.57, 1.02)),
    Cell((20, 35), (-_INF, -2), 48, (-0.03, -0.14, -0.72), 0.88, (0.20, 0.81)),
    Cell((20, 35), (-2, 0), 19, (-0.08, -0.26, -1.29), 0.85, (0.37, 1.91)),
    Cell((20, 35), (0, 2), 17, (-0.37, -0.37, -0.01), 1.24, (0.40, 1.12)),
    Cell((20, 35), (2, 5), 16, (-0.90, -1.49, -1.88), 1.65, (0.55, 1.28)),
    Cell((35, 60), (-_INF, -2), 21, (0.25, 0.11, 0.31), 0.77, (0.13, 0.54)),
    Cell((35, 60), (-2, 0), 16, (0.40, 0.68, 1.16), 1.19, (0.18, 0.64)),
    Cell((35, 60), (0, 2), 13, (-0.43, -0.88, -1.29), 2.07, (0.33, 1.16)),
    Cell((35, 60), (2, 5), 29, (-0.84, -1.88, -2.98), 1.96, (0.69, 1.49)),
    Cell((35, 60), (5, _INF), 21, (-1.46, -2.79, -3.81), 2.30, (0.84, 2.06)),
    Cell((60, _INF), (-_INF, -2), 20, (-0.02, 0.09, 0.58), 0.55, (0.13, 0.35)),
    Cell((60, _INF), (0, 2), 17, (0.00, -0.12, -1.63), 0.96, (0.28, 0.93)),
    Cell((60, _INF), (2, 5), 33, (-0.40, -0.73, -1.75), 1.78, (0.44, 1.56)),
    Cell((60, _INF), (5, _INF), 60, (-1.18, -2.34, -4.65), 2.51, (0.95, 2.42)),
)
PUBLISHED_EVENTS, PUBLISHED_PEAK = 640, 0.3
PUBLISHED_ERRORS = {"constant speed": (0.73, 1.23, 1.93), "decaying acceleration, 3 s": (0.47, 0.90, 1.51)}
"""Median, mean and root mean square of the error of HV_1's speed after 5 s [m/s]."""


def drifts(work: Path) -> dict[tuple[int, int], float]:
    """Median forward acceleration [m/s^2] of each recording's carriageways."""
    vehicles = artefacts.read(work, "vehicles")[["recording_id", "vehicle_id", "driving_direction"]]
    found: dict[tuple[int, int], float] = {}
    for recording, known in vehicles.groupby("recording_id"):
        rows = pd.read_parquet(artefacts.tracks_folder(work, int(recording)), columns=["vehicle_id", "ax"])
        medians = rows.merge(known, on="vehicle_id").groupby("driving_direction")["ax"].median()
        found |= {(int(recording), int(direction)): float(a) for direction, a in medians.items()}
    return found


def responses(work: Path) -> pd.DataFrame:
    """One row an event with an HV_1: spacing, closing, changes of speed, peak braking, errors of naive models."""
    events, vehicles = artefacts.read(work, "events"), artefacts.read(work, "vehicles")
    known = vehicles.set_index(["recording_id", "vehicle_id"])
    length, carriageway = known["length"], known["driving_direction"]
    tracks = artefacts.read(work, "event_tracks")
    tracks = tracks[tracks["role"].isin(("ego", "target_follower_1"))]
    of_role = {key: rows.sort_values("t") for key, rows in tracks.groupby(["event_id", "role"])}
    drift = drifts(work)
    found = []
    for event in events.itertuples():
        ego, follower = (of_role.get((event.event_id, role)) for role in ("ego", "target_follower_1"))
        if ego is None or follower is None:
            continue
        lengths = [length[event.recording_id, int(rows["vehicle_id"].iloc[0])] for rows in (ego, follower)]
        moving = drift[event.recording_id, int(carriageway[event.recording_id, event.ego_id])]
        row = _response(ego, follower, lengths, moving, event.frame_rate)
        if row is not None:
            found.append({"event_id": event.event_id, **row})
    return pd.DataFrame(found)


def _response(
    ego: pd.DataFrame, follower: pd.DataFrame, lengths: list[float], drift: float, rate: float
) -> dict[str, float] | None:
    t, v, y = (follower[name].to_numpy(float) for name in ("t", "vx", "y"))
    start, ego_start = np.flatnonzero(np.abs(t) < 0.5 / rate), ego[np.abs(ego["t"]) < 0.5 / rate]
    if not len(start) or not len(ego_start):
        return None
    own = np.flatnonzero((t >= 0) & (np.abs(y - y[start[0]]) > _OWN_CHANGE_M))
    seen = (t > -_BEFORE_S - 1) & (t <= (t[own[0]] if len(own) else _INF))
    before = (t <= 0) & (t > -_BEFORE_S)
    v_0, a_0 = v[start[0]], follower["ax"].to_numpy(float)[before].mean()
    spacing = ego_start["x"].iloc[0] - follower["x"].to_numpy(float)[start[0]] + (lengths[0] - lengths[1]) / 2
    row = {
        "spacing": spacing,
        "closing": v_0 - ego_start["vx"].iloc[0],
        "drift": drift,
        "own_change": float(len(own) > 0),
        "peak": _peak_braking(v[seen], t[seen], rate),
    }
    for h in SECONDS:
        at = np.flatnonzero(seen & (np.abs(t - h) < 0.5 / rate))
        change = v[at[0]] - v_0 if len(at) else np.nan
        row[f"after_{h:g}"] = change - drift * h
        row[f"constant_{h:g}"] = change
        row[f"decaying_{h:g}"] = change - a_0 * _DECAY_S * (1 - np.exp(-h / _DECAY_S))
    return row


def _peak_braking(v: np.ndarray, t: np.ndarray, rate: float) -> float:
    """Hardest braking of the smoothed speed within 8 s of t_start [m/s^2]; NaN if less than a second is seen."""
    width = max(round(_SMOOTHING_S * rate), 1)
    if len(v) <= width:
        return float("nan")
    kernel = np.full(width, 1 / width)
    smooth, middle = np.convolve(v, kernel, "valid"), np.convolve(t, kernel, "valid")
    a = np.gradient(smooth, 1 / rate)[(middle >= 0) & (middle <= SECONDS[-1])]
    return float(np.max(-a, initial=0.0)) if len(a) else float("nan")


def print_cells(found: pd.DataFrame) -> None:
    """The dose-response table, ours (published); the last column says whether ours lies within 2 sd / sqrt n."""
    counted = found[found["own_change"] == 0]
    scale = PUBLISHED_EVENTS / max(len(found), 1)
    print(f"{len(found)} events with HV_1; counts are scaled to {PUBLISHED_EVENTS}; ours (published)")
    print(f"{'spacing':>9} {'closing':>9} {'n':>11} {'3 s':>14} {'5 s':>14} {'sd':>13} {'8 s':>14} {'peak':>13}")
    within = 0
    for cell in PUBLISHED:
        inside = counted["spacing"].between(*cell.spacing, inclusive="left")
        rows = counted[inside & counted["closing"].between(*cell.closing, inclusive="left")]
        ours = [rows[f"after_{h:g}"].mean() for h in SECONDS]
        n = rows["after_5"].notna().sum()
        band = 2 * cell.sd * np.sqrt(1 / cell.n + 1 / max(n, 1))
        good = abs(ours[1] - cell.after[1]) <= band
        within += bool(good)
        three, five, eight = (f"{a:6.2f} ({b:5.2f})" for a, b in zip(ours, cell.after, strict=True))
        print(
            f"{_bounds(cell.spacing):>9} {_bounds(cell.closing):>9} {len(rows) * scale:5.0f} ({cell.n:3d}) "
            f"{three} {five} {rows['after_5'].std():5.2f} ({cell.sd:4.2f}) {eight} "
            f"{rows['peak'].mean():5.2f} ({cell.peak[0]:4.2f}) {'' if good else '*'}"
        )
    print(f"after 5 s within 2 standard errors: {within} of {len(PUBLISHED)}")


def _bounds(bounds: tuple[float, float]) -> str:
    low, high = bounds
    if high == _INF:
        return f"> {low:g}"
    return f"< {high:g}" if low in (0, -_INF) and high != 2 else f"{low:g}..{high:g}"


def print_errors(found: pd.DataFrame) -> None:
    """Peak braking, errors of the naive models and drifts."""
    counted = found[found["own_change"] == 0]
    peak = counted["peak"].dropna()
    print(f"peak braking: mean {peak.mean():.2f} ({PUBLISHED_PEAK}), 95 % {peak.quantile(0.95):.2f}, ", end="")
    print(f"beyond 3 m/s^2: {(peak > 3).mean():.1%} (none)")
    for name, column in zip(PUBLISHED_ERRORS, ("constant_5", "decaying_5"), strict=True):
        error = counted[column].abs().dropna()
        ours = (error.median(), error.mean(), np.sqrt((error**2).mean()))
        figures = " / ".join(f"{a:.2f} ({b:.2f})" for a, b in zip(ours, PUBLISHED_ERRORS[name], strict=True))
        print(f"error after 5 s, {name}: median / mean / rms {figures}, {len(error)} events")
    drift = found.groupby(found["event_id"].str[:2])["drift"].agg(["min", "max"])
    print(f"drift {drift['min'].min():.2f} .. {drift['max'].max():.2f} m/s^2 (-0.24 .. 0.29)")


def main(work: Path) -> None:
    """Print the tables of a work folder."""
    found = responses(work)
    print_cells(found)
    print_errors(found)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
