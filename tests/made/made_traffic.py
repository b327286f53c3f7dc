"""Small traffic as arrays: vehicles at constant speed on given lanes; a camera without error."""

import numpy as np

from highd_lc.extraction.track_index import TrackIndex, Traffic
from highd_lc.vocab.sections import RecorderSettings

RATE = 10.0
FAULTLESS = RecorderSettings(
    drivers="lcm",
    wander_m=0,
    position_noise_m=0,
    detection_noise_m=0,
    end_speed_error_mps=0,
    acceleration_bias_mps2=0,
)
"""A camera without error and drivers by the LCM who hold their line: for tests of exact relations."""


def traffic(vehicles, *, frames=100, entry=0.0, stop=1e9):
    """vehicles: (x at frame 1 [m], speed [m/s], lane or lanes (frames,), length [m]); all drive in direction 2.

    The recorded leader is the nearest vehicle ahead on the same lane.
    """
    t = np.arange(frames) / RATE
    x = np.array([x0 + speed * t for x0, speed, _, _ in vehicles])
    lanes = np.array([np.broadcast_to(lane, frames) for _, _, lane, _ in vehicles])
    leader = np.zeros_like(lanes)
    for v in range(len(vehicles)):
        for f in range(frames):
            ahead = [w for w in range(len(vehicles)) if lanes[w, f] == lanes[v, f] and x[w, f] > x[v, f]]
            if ahead:
                leader[v, f] = 10 * (1 + min(ahead, key=lambda w: x[w, f]))
    n = len(vehicles)
    return Traffic(
        index=TrackIndex.of(np.repeat(np.arange(n), frames), np.tile(np.arange(1, frames + 1), n)),
        x=x.ravel(),
        y=(lanes.ravel() - 0.5) * 3.75,
        vy=np.zeros(lanes.size, np.float32),
        lane=lanes.ravel(),
        leader_id=leader.ravel(),
        ids=10 * np.arange(1, n + 1),
        direction=np.full(n, 2),
        length=np.array([length for *_, length in vehicles], dtype=float),
        markings={2: 3.75 * np.arange(4)},
        entry=np.array([np.nan, np.nan, entry]),
        stop=np.array([np.nan, np.nan, stop]),
        rate=RATE,
    )
