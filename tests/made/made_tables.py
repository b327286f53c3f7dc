"""The tables of one made lane change, as scenes are read from them: recorded rows at 25 Hz of every role."""

import numpy as np
import pandas as pd

from highd_lc.stages.scenes import SceneTables
from highd_lc.vocab.driver import PARAMETERS, TABLE3_MEANS

RATE, DURATION, SHIFT = 25.0, 6.0, 3.5
EVENT = "01-0001-00100"
LENGTH = {1: 4.5, 2: 4.0, 3: 5.0, 4: 4.6, 5: 15.0, 6: 4.2}
VEHICLE_OF = {
    "ego": 1, "origin_leader": 2, "target_leader": 3, "target_follower_1": 4,
    "target_leader_2": 5, "target_leader_3": 6,
}  # fmt: skip
PLACE = {
    "ego": (0.0, 0.0), "origin_leader": (60.0, 0.0), "target_leader": (40.0, SHIFT),
    "target_follower_1": (-30.0, SHIFT), "target_leader_2": (90.0, SHIFT), "target_leader_3": (140.0, SHIFT),
}  # fmt: skip


def speed(t):
    """Everybody's speed [m/s]."""
    return 30.0 + np.sin(0.5 * t)


def way(t):
    """The way driven at that speed since t = 0 [m]."""
    return 30.0 * t + 2.0 * (1.0 - np.cos(0.5 * t))


def rows(role, first=-2.0, last=10.0):
    """Recorded rows of a role; the ego changes lane over 0 .. 6 s by a quintic."""
    t = np.arange(round(first * RATE), round(last * RATE) + 1) / RATE
    x0, y0 = PLACE[role]
    u = np.clip(t / DURATION, 0.0, 1.0)
    z = 6 * u**5 - 15 * u**4 + 10 * u**3
    y = y0 + (SHIFT if role == "ego" else 0.0) * z
    return {
        "t": t, "x": x0 + way(t), "y": y, "vx": speed(t), "vy": np.gradient(y, t), "ax": 0.5 * np.cos(0.5 * t),
        "ay": 0.0 * t, "vehicle_id": np.full(len(t), VEHICLE_OF[role]), "calibration": t < 0.0,
    }  # fmt: skip


def torn(track, first, last):
    """Rows without those from one time to another [s]; later ones are 200 m further back."""
    kept = (track["t"] < first - 1e-9) | (track["t"] > last + 1e-9)
    after = track["t"] > last
    return {name: np.where(after & (name == "x"), v - 200.0, v)[kept] for name, v in track.items()}


def tables(tracks, *, changes=(), later=()):
    """Scene tables of the event. tracks: rows by role; changes, later: of ``events``."""
    event = {
        "event_id": EVENT, "ego_id": 1, "frame_rate": RATE, "duration_s": DURATION, "lateral_shift_m": SHIFT,
        "start_frame": 100, "crossing_frame": 175,
        "leader_changes_s": list(changes), "later_leader_ids": list(later),
    }  # fmt: skip
    means = dict(zip(PARAMETERS, TABLE3_MEANS.as_array(), strict=True))
    fits = {name: np.array([value]) for name, value in means.items()}
    fits |= {"follower": np.array([1]), "leader_length_m": np.array([5.0]), "spread": np.array([{}], dtype=object)}
    nothing = pd.DataFrame()
    return SceneTables(
        events=pd.DataFrame([event]),
        vehicles=nothing,
        followers=nothing,
        tracks={(EVENT, role): track for role, track in tracks.items()},
        sizes={vehicle: (length, 1.9) for vehicle, length in LENGTH.items()},
        drivers={"own_fit": {(EVENT,): fits}},
    )
