"""The paper's scenarios posed: a platoon at the moment of the lane change, and the scene that the planner sees.

Along the road 0 is the AV's front at t_start; t = 0 is t_start.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from highd_lc.algorithms.platoon import NO_LEADER, Lead, Platoon, PlatoonStart, drive_platoon, equal_drivers
from highd_lc.core.drive import hardest_braking
from highd_lc.vocab.lcm_parameters import SIMULATION
from highd_lc.vocab.scenarios import PlatoonSettings, ScenarioOptions, ScenarioSettings, VehicleSettings
from highd_lc.vocab.scene import Followers, Human, Motion, Scene

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Situation:
    """An AV beside a platoon at t_start: what a scenario and a set of options make of each other.

    key: "1", "2_15" and so on. v_av [m/s]: speed of the AV. start: the followers at t_start. leader_front: front
    of the platoon's leader at t_start [m], infinite = none; platoon_speed: the leader's speed [m/s]. approach:
    the followers before t_start, its last instant is t_start. instants: of the run from t_start on.
    """

    key: str
    v_av: float
    start: PlatoonStart
    leader_front: float
    platoon_speed: float
    approach: Platoon
    instants: int
    options: ScenarioOptions
    vehicle: VehicleSettings


def situations(settings: ScenarioSettings, options: ScenarioOptions) -> list[Situation]:
    """Scenario 1 and scenario 2 at each speed of its AV, under these options."""
    first = [
        situation("1", settings.scenario_1, v_av=v, options=options, vehicle=settings.vehicle)
        for v in settings.scenario_1.av_speeds
    ]
    second = [
        situation(f"2_{v:g}", settings.scenario_2, v_av=v, options=options, vehicle=settings.vehicle)
        for v in settings.scenario_2.av_speeds
    ]
    return first + second


def situation(
    key: str, platoon: PlatoonSettings, *, v_av: float, options: ScenarioOptions, vehicle: VehicleSettings
) -> Situation:
    """One platoon and one speed of the AV [m/s] under these options."""
    dt, speed = vehicle.dt_s, platoon.platoon_speed
    ahead = platoon.av_ahead_m + (vehicle.length_m if options.gap_reading == "bumpers" else 0.0)
    leader = options.spacing_m if options.platoon_leader == "present" else NO_LEADER
    before = _approach(platoon, leader, options=options, vehicle=vehicle)
    # The scenario begins before t_start; its coordinates are moved so that HV_1 is where it has to be then.
    shift = -ahead - before.front[0, -1]
    approach = Platoon(
        before.t - before.t[-1],
        before.front + shift,
        before.v,
        before.a,
        before.length,
        Lead(before.lead.front + shift, before.lead.v, before.lead.length),
    )
    start = PlatoonStart(
        approach.front[:, -1].copy(), approach.v[:, -1].copy(), before.length, _drivers(platoon.followers, options)
    )
    instants = round((platoon.duration_s - platoon.change_at_s) / dt) + 1
    leader_front = float(approach.lead.front[-1])
    return Situation(key, v_av, start, leader_front, speed, approach, instants, options, vehicle)


def _drivers(count: int, options: ScenarioOptions) -> FloatArray:
    parameters = SIMULATION.as_array()
    parameters[0] = options.v_desire
    return np.tile(parameters, (count, 1))


def _approach(
    platoon: PlatoonSettings, leader: float, *, options: ScenarioOptions, vehicle: VehicleSettings
) -> Platoon:
    """The platoon from the scenario's begin to t_start, HV_1's front at 0 at the begin."""
    dt, speed = vehicle.dt_s, platoon.platoon_speed
    instants = round(platoon.change_at_s / dt) + 1
    start = equal_drivers(
        platoon.followers,
        speed=speed,
        spacing=options.spacing_m,
        parameters=_drivers(1, options)[0],
        length=vehicle.length_m,
    )
    lead = steady_lead(leader, speed, instants=instants, dt=dt, length=vehicle.length_m)
    held = instants if options.pre_phase == "hold" else 0
    return drive_platoon(start, lead, dt=dt, held=held, hardest=hardest_braking(options.b_max))


def steady_lead(front: float, v: float, *, instants: int, dt: float, length: float) -> Lead:
    """A leader at constant speed; an infinite front is none. front [m], v [m/s], dt [s], length [m]."""
    t = np.arange(instants, dtype=np.float64) * dt
    return Lead(front + v * t, np.full(instants, v if np.isfinite(front) else 0.0), length)


def scene_of(posed: Situation) -> Scene:
    """The scene that the planner sees at t_start: the nearest ``planned_followers``, all vehicles alike."""
    vehicle, p = posed.vehicle, min(posed.options.planned_followers, len(posed.start.front))
    samples = round(posed.options.horizon_s / vehicle.dt_s) + 1
    # All vehicles are equally long: differences of centres equal differences of fronts.
    followers = Followers(
        x=posed.start.front[:p].copy(),
        y=np.full(p, vehicle.lateral_shift_m),
        v=posed.start.v[:p].copy(),
        length=posed.start.length[:p],
        width=np.full(p, vehicle.width_m),
        parameters=posed.start.parameters[:p],
        L_no_change=float(posed.start.parameters[0, 5]),
        recorded=tuple(_never_recorded(samples, vehicle) for _ in range(p)),
    )
    return simulated_scene(
        posed.key, posed.v_av, followers=followers, vehicle=vehicle, target_leader=_leader_motion(posed, samples)
    )


def simulated_scene(
    key: str,
    v_av: float,
    *,
    followers: Followers,
    vehicle: VehicleSettings,
    target_leader: Motion | None = None,
    origin_leader: Motion | None = None,
) -> Scene:
    """A scene that nobody recorded: the human's motion is one standing sample, which no plan looks at."""
    still = np.zeros(1)
    return Scene(
        event_id=f"scenario {key}",
        v0=v_av,
        a0=0.0,
        lateral_shift=vehicle.lateral_shift_m,
        length=vehicle.length_m,
        width=vehicle.width_m,
        wheelbase=vehicle.wheelbase_m,
        dt=vehicle.dt_s,
        target_leader=target_leader,
        origin_leader=origin_leader,
        origin_follower=None,
        followers=followers,
        human=Human(still, still, still, still, still, still, still, still, 0, 0.0),
    )


def steady_motion(x: float, y: float, *, v: float, samples: int, vehicle: VehicleSettings) -> Motion:
    """A vehicle at constant speed v [m/s] from (x, y) [m] at t_start on."""
    t = np.arange(samples, dtype=np.float64) * vehicle.dt_s
    return Motion(
        x=x + v * t,
        y=np.full(samples, y),
        v=np.full(samples, v),
        a=np.zeros(samples),
        length=vehicle.length_m,
        width=vehicle.width_m,
        observed=0,
    )


def _leader_motion(posed: Situation, samples: int) -> Motion | None:
    if not np.isfinite(posed.leader_front):
        return None
    lateral = posed.vehicle.lateral_shift_m
    return steady_motion(
        posed.leader_front, lateral, v=posed.platoon_speed, samples=samples, vehicle=posed.vehicle
    )


def _never_recorded(samples: int, vehicle: VehicleSettings) -> Motion:
    nothing = np.full(samples, np.nan)
    return Motion(nothing, nothing, nothing, nothing, vehicle.length_m, vehicle.width_m, 0)
