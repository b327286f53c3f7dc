"""Drivers: fits of the Longitudinal Control Model to recorded followers."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from highd_lc.api.recordings import Event, Follower
from highd_lc.drivers.calibration import Quality
from highd_lc.stages.calibrate import fit_row
from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS, LcmParameters


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
