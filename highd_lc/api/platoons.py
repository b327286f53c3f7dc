"""A platoon behind a given motion."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from highd_lc.api.fits import Driver, columns_of
from highd_lc.core.drive import hardest_braking
from highd_lc.scenarios.platoon import Lead, PlatoonStart, drive_platoon, gaps, spacings
from highd_lc.vocab.driver import PARAMETERS
from highd_lc.vocab.errors import UsageError


def simulate_platoon(
    leader: pd.DataFrame,
    drivers: Sequence[Driver],
    *,
    spacing: float,
    speed: float | None = None,
    length: float = 5.0,
    leader_length: float = 5.0,
    b_max: float = 9.0,
) -> pd.DataFrame:
    """Drive a platoon of LCM drivers behind a given motion (equations.md 3, 13).

    Each driver commands the acceleration of equations 10 and 11 from the states of the same instant; speed and
    then position follow, v(t + dt) = max(0, v + a dt), x(t + dt) = x + v(t + dt) dt.

    Args:
        leader: a row a sample in equal steps: t [s], x of the box centre [m], v [m/s]; as ``Plan.motion`` has it
            for one role.
        drivers: parameters or fits, nearest to the leader first.
        spacing: at the first sample between all of them, front to front [m].
        speed: of all drivers at the first sample [m/s]; None = the leader's.
        length: of the drivers' vehicles [m].
        leader_length: of the leader [m].
        b_max: hardest braking that a driver commands [m/s^2]; 0 = unbounded.

    Returns:
        A row a vehicle and sample: vehicle (1 = nearest to the leader), t [s], x of the box centre [m], v [m/s],
        commanded a [m/s^2], spacing front to front [m], gap bumper to bumper [m]. A negative gap is a contact.

    Raises:
        UsageError: the leader's samples are not finite or not in equal steps, there is no driver, or a number is
            not allowed.

    Example:
        >>> import highd_lc as lc, numpy as np, pandas as pd
        >>> t = np.arange(601) * 0.1
        >>> leader = pd.DataFrame({"t": t, "x": 20.0 * t, "v": 20.0})
        >>> platoon = lc.simulate_platoon(leader, drivers=[lc.SIMULATION] * 10, spacing=44.0)
        >>> len(platoon), bool((platoon["gap"] > 0.0).all())
        (6010, True)
    """
    dt = _step(leader)
    positive = {"spacing": spacing, "length": length, "leader_length": leader_length}
    other = {"b_max": b_max, "speed": float(leader["v"].iloc[0]) if speed is None else speed}
    bad = [f"{name} = {value}" for name, value in positive.items() if not 0.0 < value < np.inf]
    bad += [f"{name} = {value}" for name, value in other.items() if not 0.0 <= value < np.inf]
    if bad or not len(drivers):
        raise UsageError(
            f"{', '.join(bad) or 'drivers: none'}: a platoon needs a driver and finite positive numbers"
        )
    lead = Lead(
        leader["x"].to_numpy(np.float64) + leader_length / 2.0, leader["v"].to_numpy(np.float64), leader_length
    )
    columns = [columns_of(driver) for driver in drivers]
    start = PlatoonStart(
        front=lead.front[0] - spacing * np.arange(1.0, len(drivers) + 1.0),
        v=np.full(len(drivers), other["speed"]),
        length=np.full(len(drivers), length),
        parameters=np.array([[row[name] for name in PARAMETERS] for row in columns]),
    )
    found = drive_platoon(start, lead, dt=dt, hardest=hardest_braking(b_max))
    p, samples = found.front.shape
    return pd.DataFrame(
        {
            "vehicle": np.repeat(np.arange(1, p + 1), samples),
            "t": np.tile(leader["t"].to_numpy(np.float64), p),
            "x": found.front.ravel() - length / 2.0,
            "v": found.v.ravel(),
            "a": found.a.ravel(),
            "spacing": spacings(found).ravel(),
            "gap": gaps(found).ravel(),
        }
    )


def _step(leader: pd.DataFrame) -> float:
    """The step of the leader's samples [s]. Raises UsageError."""
    missing = [name for name in ("t", "x", "v") if name not in leader]
    if missing:
        raise UsageError(f"leader: column {missing[0]!r} is missing; t, x and v are needed")
    if len(leader) < 2 or not np.isfinite(leader[["t", "x", "v"]].to_numpy(np.float64)).all():
        raise UsageError(f"leader: {len(leader)} samples; two or more, all of them finite, are needed")
    steps = np.diff(leader["t"].to_numpy(np.float64))
    if not steps[0] > 0.0 or np.ptp(steps) > 1e-6:
        raise UsageError(f"leader: steps of t are {steps.min():g} to {steps.max():g} s; equal ones are needed")
    return float(round(steps[0], 9))
