"""Drivers: fits of the Longitudinal Control Model to recorded followers, and platoons of such drivers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from highd_lc.api.recordings import Event, Follower
from highd_lc.core.drive import hardest_braking
from highd_lc.drivers.calibration import Quality
from highd_lc.scenarios.platoon import Lead, Platoon, PlatoonStart, drive_platoon, gaps, spacings
from highd_lc.stages.calibrate import fit_row
from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS, LcmParameters
from highd_lc.vocab.errors import UsageError


@dataclass(frozen=True)
class DriverFit:
    """A driver that was fitted to a follower, or the published means where that was not possible.

    Attributes:
        driver: v_desire [m/s], A, b, B [m/s^2], tau [s], L [m] (equations 10 and 11).
        leader_length: length of the leader that L was fitted behind [m]; NaN for the published means.
        errors: root mean square errors of a simulation over the window (spacing [m], speed [m/s], acceleration
            [m/s^2]) and their relatives; NaN where nothing was fitted.
        bounds_hit: parameters that sit on a bound of Table 3.
        spread: standard deviation of each parameter over equally good fits, where there are several.
        objective: what the fit minimised (equations.md 9).
        n_samples: samples of 0.1 s that were fitted.
        status: ``fitted`` or ``table3``; reason: why nothing was fitted, or "".
    """

    driver: LcmParameters
    leader_length: float
    errors: Quality
    bounds_hit: tuple[str, ...]
    spread: Mapping[str, float]
    objective: float
    n_samples: int
    status: str
    reason: str


Driver: TypeAlias = LcmParameters | DriverFit
"""Who drives a follower: parameters, whose L holds behind whoever is ahead, or a fit, whose L is moved."""


def fit_driver(follower: Follower) -> DriverFit:
    """Fit the LCM to a follower's car-following before the lane change, as ``highd-lc calibrate`` does it.

    The model commands a = A [1 - v / v_desire - exp(1 - s / s*)], with the desired spacing
    s* = v^2 / (2 b) - v_leader^2 / (2 B) + v tau + L (equations 10 and 11; equations.md 3).

    Args:
        follower: of an event.

    Returns:
        The fit; the published means with a ``reason`` where there is too little to fit. A run gives such a
        follower the common driver of its class instead, for which it needs everybody.

    Example:
        >>> import highd_lc as lc
        >>> event = lc.lane_changes(lc.synthesize(seconds=60, seed=6)[0])[0]
        >>> fit = lc.fit_driver(event.followers[0])
        >>> fit.status in ("fitted", "table3") and 0.1 <= fit.driver.tau <= 10.0
        True
    """
    fit, row = fit_row(follower.recorded, follower.settings)
    return DriverFit(
        driver=LcmParameters(*(float(row[name]) for name in PARAMETERS)),
        leader_length=float(row["leader_length_m"]),
        errors=fit.quality,
        bounds_hit=fit.at_bound,
        spread=row["spread"],
        objective=fit.objective,
        n_samples=fit.n_samples,
        status=row["status"],
        reason=row["reason"],
    )


def fit_drivers(event: Event) -> list[DriverFit]:
    """A fit for each follower of an event, see ``fit_driver``.

    Args:
        event: a lane change.

    Returns:
        The fits, nearest follower first.

    Example:
        >>> import highd_lc as lc
        >>> event = lc.lane_changes(lc.synthesize(seconds=60, seed=6)[0])[0]
        >>> len(lc.fit_drivers(event)) == len(event.followers)
        True
    """
    return [fit_driver(follower) for follower in event.followers]


def columns_of(driver: Driver) -> dict[str, Any]:
    """A driver as a scene reads it: parameters, the leader length that L goes with, spread."""
    if isinstance(driver, LcmParameters):
        driver = DriverFit(driver, np.nan, Quality(*[np.nan] * 6), (), {}, np.nan, 0, names.TABLE3, "given")
    values = driver.driver.as_array().tolist()
    about = {"leader_length_m": driver.leader_length, "spread": dict(driver.spread)}
    return dict(zip(PARAMETERS, values, strict=True)) | about


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
    v0 = float(leader["v"].iloc[0]) if speed is None else speed
    _refuse_platoon(
        len(drivers), spacing=spacing, speed=v0, length=length, leader_length=leader_length, b_max=b_max
    )
    lead = Lead(
        leader["x"].to_numpy(np.float64) + leader_length / 2.0, leader["v"].to_numpy(np.float64), leader_length
    )
    start = PlatoonStart(
        front=lead.front[0] - spacing * np.arange(1.0, len(drivers) + 1.0),
        v=np.full(len(drivers), v0),
        length=np.full(len(drivers), length),
        parameters=np.array([[columns_of(driver)[name] for name in PARAMETERS] for driver in drivers]),
    )
    found = drive_platoon(start, lead, dt=dt, hardest=hardest_braking(b_max))
    return _platoon_frame(found, leader["t"].to_numpy(np.float64), length)


def _refuse_platoon(drivers: int, *, speed: float, b_max: float, **positive: float) -> None:
    """Raises UsageError if there is no driver, or a number is not finite or not positive."""
    bad = [f"{name} = {value}" for name, value in positive.items() if not 0.0 < value < np.inf]
    other = {"b_max": b_max, "speed": speed}
    bad += [f"{name} = {value}" for name, value in other.items() if not 0.0 <= value < np.inf]
    if bad or not drivers:
        raise UsageError(
            f"{', '.join(bad) or 'drivers: none'}: a platoon needs a driver and finite positive numbers"
        )


def _platoon_frame(found: Platoon, t: NDArray[np.float64], length: float) -> pd.DataFrame:
    p, samples = found.front.shape
    return pd.DataFrame(
        {
            "vehicle": np.repeat(np.arange(1, p + 1), samples),
            "t": np.tile(t, p),
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
