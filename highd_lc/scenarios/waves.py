"""How a lane change grows or dies along a platoon of given drivers, under benchmark and local optimum.

String stability of the LCM: how a speed oscillation grows from leader to follower, linearised at equilibrium.

With a = f(s, v, v_l) at equilibrium the transfer from leader's to follower's speed is
Gamma(i w) = (f_s + i w f_l) / (f_s - w^2 - i w f_v). No frequency grows if f_v^2 - f_l^2 - 2 f_s >= 0.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.lcm import desired_spacing, equilibrium_spacing
from highd_lc.scenarios.platoon import Platoon, PlatoonStart, Situation, gaps, situation
from highd_lc.scenarios.run import Cell, av_lead, drive_behind, no_lane_change, plan_situation
from highd_lc.vocab.driver import SIMULATION, TABLE3_MEANS, TABLE3_QUANTILES
from highd_lc.vocab.scenarios import ScenarioSettings

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Response:
    """Linear response of a driver at an equilibrium.

    f_s [1/s^2], f_v, f_l [1/s]: derivatives of the acceleration by spacing, own speed and leader's speed. gain:
    largest |Gamma|, 1 at least (frequency 0); frequency [Hz] at which it is reached.
    """

    speed: float
    spacing: float
    f_s: float
    f_v: float
    f_l: float
    gain: float
    frequency: float


def response(v: float, parameters: FloatArray) -> Response | None:
    """Response of a driver who follows at v [m/s] in equilibrium; None from v_desire on. parameters: (6,)."""
    spacing = equilibrium_spacing(v, parameters)
    if not math.isfinite(spacing):
        return None
    v_desire, A, b, B, tau, L = (float(value) for value in parameters)
    s_star = float(desired_spacing(v, v, b, B, tau, L))
    closeness = A * math.exp(1.0 - spacing / s_star)
    floor = s_star <= L
    by_s_star = -closeness * spacing / s_star**2
    f_s = closeness / s_star
    f_v = -A / v_desire + (0.0 if floor else by_s_star * (v / b + tau))
    f_l = 0.0 if floor else -by_s_star * v / B
    gain, omega = _largest_gain(f_s, f_v, f_l)
    return Response(v, spacing, f_s, f_v, f_l, gain, omega / (2.0 * math.pi))


def _largest_gain(f_s: float, f_v: float, f_l: float) -> tuple[float, float]:
    """Largest |Gamma| and its angular frequency [rad/s].

    With u = w^2, |Gamma|^2 = (f_s^2 + f_l^2 u) / (u^2 + (f_v^2 - 2 f_s) u + f_s^2): one stationary point u > 0 if
    f_l^2 > f_v^2 - 2 f_s, else it falls from 1.
    """
    a, b, c = f_s**2, f_l**2, f_v**2 - 2.0 * f_s
    if b <= c:
        return 1.0, 0.0
    u = a * (b - c) / (a + math.sqrt(a * a + a * b * (b - c)))
    return math.sqrt((a + b * u) / (u * u + c * u + a)), math.sqrt(u)


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
    planned = plan_situation(posed, settings, omegas=tuple(settings.weights.values()))
    unchanged = no_lane_change(posed)
    for policy, omega in settings.weights.items():
        plan = planned.plan(Cell(settings.form, settings.accounting, omega))
        if plan is None:
            continue
        driven = drive_behind(posed, av_lead(posed, plan))
        met = bool(gaps(driven).min() < 0.0)
        for rank, values in enumerate(zip(*drops(driven, unchanged), strict=True), start=1):
            dip, below, delay = (np.nan if met else float(value) for value in values)
            yield {
                "drivers": name,
                "scenario": posed.key,
                "policy": policy,
                "follower": rank,
                "dip_mps": dip,
                "undershoot_mps": below,
                "delay_s": delay,
                "collision": met,
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
