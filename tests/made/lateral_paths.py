"""Lateral paths with a known lane change, as arrays."""

import numpy as np

from highd_lc.extraction.lateral_motion import Path, Rule
from highd_lc.vocab.settings import ExtractSettings

LANE = 3.75
MARKINGS = LANE * np.arange(5)
DEFAULTS = ExtractSettings()
RULE = Rule(
    smoothing_s=DEFAULTS.smoothing_s,
    speed=DEFAULTS.lateral_speed_mps,
    acceleration=DEFAULTS.lateral_acceleration_mps2,
    persistence_s=DEFAULTS.persistence_s,
    clearance_m=DEFAULTS.clearance_m,
    rest_s=DEFAULTS.rest_s,
    flicker_s=DEFAULTS.flicker_s,
    min_shift_m=DEFAULTS.min_shift_m,
)


def path(seconds, *changes, rate=25.0, lane=1, noise=0.0, rng=None, noisy_lanes=False):
    """A track from lane ``lane`` on, with changes (start [s], duration [s], lanes to the left)."""
    t = np.arange(round(seconds * rate)) / rate
    y = np.full(len(t), (lane - 0.5) * LANE)
    for start, duration, lanes in changes:
        u = np.clip((t - start) / duration, 0, 1)
        y += lanes * LANE * u**3 * (10 - 15 * u + 6 * u**2)
    seen = y if noise == 0 else y + noise * rng.standard_normal(len(y))
    lanes = 1 + np.floor((seen if noisy_lanes else y) / LANE).astype(np.int64)
    lanes[(lanes < 1) | (lanes > 4)] = 0
    return Path(np.arange(1, len(t) + 1), lanes, seen, MARKINGS, rate)


def moving(start, duration, lanes=1, speed=0.1):
    """Times at which the lateral speed of such a change passes ``speed`` [s]."""
    u = 0.5 - np.sqrt(0.25 - np.sqrt(speed * duration / (30 * LANE * abs(lanes))))
    return start + u * duration, start + (1 - u) * duration
