"""A platoon of LCM drivers behind a given motion, compiled: 10 to 10,000 followers (equations.md 13).

Position and spacing are those of front bumpers. Semi-implicit Euler, all vehicles on the states of the same
instant, as in ``replay.follow``; because of that the followers are independent within a step and the vehicle is
the innermost, vectorised loop.

The paper's scenarios posed: a platoon at the moment of the lane change, and the scene that the planner sees.

Along the road 0 is the AV's front at t_start; t = 0 is t_start.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.drive import UNBOUNDED, advance, bounded, hardest_braking
from highd_lc.core.kernels import kernel
from highd_lc.core.lcm import lcm_of_inverses
from highd_lc.planning.scene import Followers, Motion, Scene
from highd_lc.vocab.driver import SIMULATION
from highd_lc.vocab.errors import ShapeError
from highd_lc.vocab.scenarios import PlatoonSettings, ScenarioOptions, ScenarioSettings, VehicleSettings

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

NO_LEADER = np.inf
"""Front of a leader that is not there."""


@dataclass(frozen=True)
class PlatoonStart:
    """p followers at the first instant, nearest to the lead first.

    front: front bumpers [m], descending; v [m/s], length [m], each of shape (p,); parameters: LCM, shape (p, 6).
    Raises ShapeError when the shapes differ.
    """

    front: FloatArray
    v: FloatArray
    length: FloatArray
    parameters: FloatArray

    def __post_init__(self) -> None:
        p = len(self.front)
        for name, shape in (("v", (p,)), ("length", (p,)), ("parameters", (p, 6))):
            if np.shape(getattr(self, name)) != shape:
                raise ShapeError(f"PlatoonStart.{name}: {np.shape(getattr(self, name))}, expected {shape}")


@dataclass(frozen=True)
class Lead:
    """What the first follower drives behind: front [m] and speed [m/s] at each instant, shape (N + 1,); length.

    An infinite front (``NO_LEADER``) is a free road. length [m]: of the vehicle in front, for gaps.
    """

    front: FloatArray
    v: FloatArray
    length: float


@dataclass(frozen=True)
class Platoon:
    """Motion of p followers at the instants t [s], shape (n,): front [m], v [m/s], commanded a [m/s^2].

    front, v, a: shape (p, n); length [m]: shape (p,); lead: what they drove behind at the same instants.
    """

    t: FloatArray
    front: FloatArray
    v: FloatArray
    a: FloatArray
    length: FloatArray
    lead: Lead


def equal_drivers(
    count: int, *, speed: float, spacing: float, parameters: FloatArray, length: float
) -> PlatoonStart:
    """A platoon of equal drivers, the first one's front at 0.

    speed [m/s], spacing [m] front to front, length [m] of everybody, parameters: shape (6,).
    """
    return PlatoonStart(
        front=-spacing * np.arange(count, dtype=np.float64),
        v=np.full(count, speed),
        length=np.full(count, length),
        parameters=np.tile(parameters, (count, 1)),
    )


def drive_platoon(
    start: PlatoonStart, lead: Lead, *, dt: float, held: int = 0, hardest: float = UNBOUNDED
) -> Platoon:
    """Drive the platoon behind the lead over all of its instants.

    dt [s]; held: first instant at which they drive by LCM, before it everybody keeps the speed; hardest: bound of
    commanded braking [m/s^2, positive]. Raises ShapeError when the lead's shapes differ.
    """
    if lead.front.shape != lead.v.shape:
        raise ShapeError(f"Lead.v has shape {lead.v.shape}, front has {lead.front.shape}")
    n, p = len(lead.front), len(start.front)
    front, v, a = (np.empty((n, p)) for _ in range(3))
    parameters = np.ascontiguousarray(start.parameters.T)
    state = start.front.copy(), start.v.copy()
    _drive(*state, parameters, lead.front, lead.v, dt, hardest, held, front, v, a)
    return Platoon(np.arange(n, dtype=np.float64) * dt, front.T, v.T, a.T, start.length, lead)


@kernel(error_model="numpy")
def _drive(
    x: FloatArray,
    v: FloatArray,
    parameters: FloatArray,
    lead_front: FloatArray,
    lead_v: FloatArray,
    dt: float,
    hardest: float,
    held: int,
    out_x: FloatArray,
    out_v: FloatArray,
    out_a: FloatArray,
) -> None:
    p = len(x)
    inverse_v, half_b, half_B = 1.0 / parameters[0], 0.5 / parameters[2], 0.5 / parameters[3]
    A, tau, L = parameters[1], parameters[4], parameters[5]
    spacing, ahead_v, a = np.empty(p), np.empty(p), np.zeros(p)
    for k in range(len(lead_front)):
        if k >= held:
            spacing[0], ahead_v[0] = lead_front[k] - x[0], lead_v[k]
            for i in range(1, p):
                spacing[i], ahead_v[i] = x[i - 1] - x[i], v[i - 1]
            for i in range(p):
                wanted = lcm_of_inverses(
                    v[i], spacing[i], ahead_v[i], inverse_v[i], A[i], half_b[i], half_B[i], tau[i], L[i]
                )
                a[i] = bounded(wanted, hardest)
        for i in range(p):
            out_x[k, i], out_v[k, i], out_a[k, i] = x[i], v[i], a[i]
            x[i], v[i] = advance(x[i], v[i], a[i], dt)


def spacings(platoon: Platoon) -> FloatArray:
    """Spacing of each follower to the one in front, front to front [m], shape (p, n); infinite on a free road."""
    ahead = np.vstack([platoon.lead.front, platoon.front[:-1]])
    return np.asarray(ahead - platoon.front, dtype=np.float64)


def gaps(platoon: Platoon) -> FloatArray:
    """Gap of each follower, bumper to bumper [m], shape (p, n): negative = driven into the one in front."""
    ahead_length = np.concatenate([[platoon.lead.length], platoon.length[:-1]])
    bumpers: FloatArray = spacings(platoon) - ahead_length[:, None]
    return bumpers


def time_headways(platoon: Platoon) -> FloatArray:
    """Time headway = spacing / speed [s], shape (p, n); NaN below 0.1 m/s or on a free road."""
    spacing = spacings(platoon)
    known = np.isfinite(spacing) & (platoon.v > 0.1)
    return np.where(known, spacing / np.where(known, platoon.v, 1.0), np.nan)


def passing_times(platoon: Platoon, x: float) -> FloatArray:
    """When each front passes x [m], by straight lines between the instants [s], shape (p,).

    NaN where it does not pass within the run, or starts beyond x.
    """
    front = platoon.front
    after = np.argmax(front >= x, axis=1)
    rows = np.arange(len(front))
    passed = (front[:, -1] >= x) & (after > 0)
    before = np.maximum(after - 1, 0)
    step = front[rows, after] - front[rows, before]
    share = (x - front[rows, before]) / np.where(step > 0.0, step, 1.0)
    at = platoon.t[before] + share * (platoon.t[after] - platoon.t[before])
    return np.where(passed, at, np.nan)


def travel_time(platoon: Platoon, section: tuple[float, float]) -> float:
    """Total travel time of the followers over a section [s]; section: from x to x [m].

    NaN unless everybody drives through all of it: a part of the travel time says nothing.
    """
    entered, left = passing_times(platoon, section[0]), passing_times(platoon, section[1])
    return float(np.sum(left - entered))


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
        recorded=(),
    )
    return simulated_scene(
        posed.key,
        posed.v_av,
        followers=followers,
        vehicle=vehicle,
        horizon=posed.options.horizon_s,
        target_leader=_leader_motion(posed, samples),
    )


def simulated_scene(
    key: str,
    v_av: float,
    *,
    followers: Followers,
    vehicle: VehicleSettings,
    horizon: float,
    target_leader: Motion | None = None,
    origin_leader: Motion | None = None,
) -> Scene:
    """A scene that nobody recorded: there is no human. v_av [m/s]; horizon: H [s]."""
    return Scene(
        event_id=f"scenario {key}",
        v0=v_av,
        a0=0.0,
        lateral_shift=vehicle.lateral_shift_m,
        length=vehicle.length_m,
        width=vehicle.width_m,
        wheelbase=vehicle.wheelbase_m,
        dt=vehicle.dt_s,
        horizon=horizon,
        target_leader=target_leader,
        origin_leader=origin_leader,
        origin_follower=None,
        followers=followers,
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
