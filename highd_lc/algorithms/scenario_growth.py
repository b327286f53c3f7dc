"""How a lane change grows or dies along a platoon of given drivers, under benchmark and local optimum."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.algorithms.platoon import Platoon, PlatoonStart
from highd_lc.algorithms.scenario import Situation, situation
from highd_lc.algorithms.scenario_run import (
    Cell,
    av_lead,
    drive_behind,
    no_lane_change,
    plan_situation,
)
from highd_lc.algorithms.string_stability import response
from highd_lc.core.lcm import equilibrium_spacing
from highd_lc.vocab import names
from highd_lc.vocab.lcm_parameters import SIMULATION, TABLE3_MEANS, TABLE3_QUANTILES
from highd_lc.vocab.scenarios import ScenarioSettings

FloatArray = NDArray[np.float64]
Row = dict[str, Any]

SPEEDS: Final = np.arange(5.0, 35.01, 0.5)
"""Speeds at which string stability is told [m/s]."""


def published_drivers() -> dict[str, FloatArray]:
    """Driver sets that the paper prints, each of shape (1, 6): its simulation, and Table 3."""
    sets = {"simulation": SIMULATION, "Table 3 mean": TABLE3_MEANS}
    sets |= {f"Table 3 {100 * q:g} %": values for q, values in TABLE3_QUANTILES.items()}
    return {name: values.as_array()[None, :] for name, values in sets.items()}


def stability_rows(drivers: Mapping[str, FloatArray]) -> list[Row]:
    """Amplification over speed (rows of ``string_stability``); of many drivers their median."""
    return [row for name, parameters in drivers.items() for row in _stability(name, parameters)]


def _stability(name: str, parameters: FloatArray) -> Iterator[Row]:
    for v in SPEEDS:
        found = [r for r in (response(float(v), one) for one in parameters) if r is not None]
        # Below half of the drivers in equilibrium the median would tell of a few fast ones.
        if 2 * len(found) < len(parameters):
            continue
        gain, frequency, spacing = (
            float(np.median([getattr(r, f) for r in found])) for f in ("gain", "frequency", "spacing")
        )
        yield {
            "drivers": name,
            "speed_mps": float(v),
            "spacing_m": spacing,
            "gain": gain,
            "frequency_hz": frequency,
            "stable": gain <= 1.0,
        }


def with_drivers(posed: Situation, parameters: FloatArray) -> Situation:
    """The situation with other drivers in equilibrium at the platoon's speed. parameters: shape (p, 6).

    The leader's place is HV_1's equilibrium spacing ahead. Drivers must have one: v_desire above the speed.
    """
    spacing = np.array([equilibrium_spacing(posed.platoon_speed, one) for one in parameters])
    front = posed.start.front[0] - np.concatenate([[0.0], np.cumsum(spacing[1:])])
    p = len(parameters)
    length = np.full(p, posed.vehicle.length_m)
    start = PlatoonStart(front, np.full(p, posed.platoon_speed), length, parameters)
    return replace(posed, start=start, leader_front=float(front[0] + spacing[0]))


def growth_rows(settings: ScenarioSettings, drivers: Mapping[str, FloatArray]) -> list[Row]:
    """Largest drop of speed of each follower (rows of ``growth``), for every driver set with an equilibrium.

    The platoon is that of scenario 2 and the AV as fast as in scenario 1 or 2.

    One driver of a set stands for the whole platoon, several take turns in their order.
    """
    rows = []
    options = settings.with_options({"platoon_leader": "present"})
    speeds = {"1": settings.scenario_1.av_speeds[0]}
    speeds |= {f"2_{v_av:g}": v_av for v_av in settings.scenario_2.av_speeds}
    for key, v_av in speeds.items():
        posed = situation(key, settings.scenario_2, v_av=v_av, options=options, vehicle=settings.vehicle)
        for name, parameters in drivers.items():
            usable = parameters[parameters[:, 0] > 1.02 * posed.platoon_speed]
            if len(usable):
                turns = np.resize(usable, (len(posed.start.front), usable.shape[1]))
                rows += list(_growth(name, with_drivers(posed, turns), settings))
    return rows


def _growth(name: str, posed: Situation, settings: ScenarioSettings) -> Iterator[Row]:
    planned = plan_situation(posed, settings, omegas=(1.0, settings.loss.omega_av))
    unchanged = no_lane_change(posed)
    for policy, omega in ((names.BENCHMARK, 1.0), (names.LOCAL_OPTIMUM, settings.loss.omega_av)):
        plan = planned.plan(Cell(settings.form, settings.accounting, omega))
        if plan is None:
            continue
        driven = drive_behind(posed, av_lead(posed, plan))
        for rank, values in enumerate(zip(*drops(driven, unchanged), strict=True), start=1):
            dip, below, delay = (float(value) for value in values)
            yield {
                "drivers": name,
                "scenario": posed.key,
                "policy": policy,
                "follower": rank,
                "dip_mps": dip,
                "undershoot_mps": below,
                "delay_s": delay,
            }


def drops(driven: Platoon, unchanged: Platoon) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Of each follower three numbers, each of shape (p,).

    The largest drop below its speed without a lane change [m/s]; the largest drop below the speed that lasts, the
    lead's at the end [m/s]: what grows or dies along the platoon; its delay at the end [s]: the distance by which
    it is behind over its own speed.
    """
    dip = np.maximum(np.max(unchanged.v - driven.v, axis=1), 0.0)
    below = np.maximum(driven.lead.v[-1] - np.min(driven.v, axis=1), 0.0)
    behind = unchanged.front[:, -1] - driven.front[:, -1]
    return dip, below, behind / np.maximum(driven.v[:, -1], 0.1)
