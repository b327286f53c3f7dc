"""Responses made for tests: a lane changer of constant speed cuts in ahead of followers."""

import numpy as np

from highd_lc.drivers.responses import NO_LEADER, SAMPLES, TIME_STEP, Responses

T = np.arange(SAMPLES) * TIME_STEP


def made(
    count: int = 40, *, seed: int = 1, recordings: int = 4, crossing_s: float = 2.5, leader: bool = True
) -> Responses:
    """Followers at random spacings and closing speeds; what they did is left at constant speed."""
    rng = np.random.default_rng(seed)
    v_0, v_av = rng.uniform(24, 33, count), rng.uniform(22, 32, count)
    spacing, drift = rng.uniform(15, 70, count), rng.uniform(-0.1, 0.1, count)
    x_ahead = spacing + v_av * T[:, None]
    before_v = v_0 + rng.uniform(-1.5, 1.5, count)
    before_x = spacing + 40.0 + before_v * T[:, None] if leader else np.full((SAMPLES, count), NO_LEADER)
    return Responses(
        x=v_0 * T[:, None],
        v=np.tile(v_0, (SAMPLES, 1)),
        n=np.full(count, SAMPLES),
        before_x=before_x,
        before_v=np.tile(before_v, (SAMPLES, 1)),
        before_length=np.full(count, 4.6),
        x_ahead=x_ahead,
        v_ahead=np.tile(v_av, (SAMPLES, 1)),
        ahead_length=np.full(count, 4.6),
        progress=np.tile(np.clip(0.5 * T / crossing_s, 0, 1)[:, None], (1, count)),
        a_0=(a_0 := rng.normal(0, 0.3, count)),
        a_lasting=0.8 * a_0,
        drift=drift,
        time_gap=np.full(count, np.nan),
        truck=np.zeros(count, bool),
        rank=np.ones(count, np.int64),
        event=np.arange(count),
        recording=np.arange(count) % recordings + 1,
        location=np.zeros(count, np.int64),
        time=np.linspace(0, 600, count),
    )
