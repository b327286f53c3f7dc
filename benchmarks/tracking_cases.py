"""The tables of the tracking study: disturbances and limits, weights and horizons, baselines.

Judging a tracking controller: the plans it is judged on, how they are driven, the figures that come out.

A controller *copes* when every plan ends in a status other than lost or failed and the lateral error of its last
second is below ``SETTLED_M``.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import product

import numpy as np
from tracking_baselines import LqrController, PurePursuit, track_kinematic

from highd_lc.core.quintic import Quintic, sample
from highd_lc.tracking import multibody
from highd_lc.tracking.closed_loop import Disturbance, track
from highd_lc.tracking.controllers import Controller
from highd_lc.tracking.multibody import track_multibody
from highd_lc.tracking.plan_tracking import planned_motion, tracked_motion
from highd_lc.vocab.tracking import (
    KINEMATIC,
    LOST,
    MULTI_BODY,
    SOFTENED,
    TRACKED,
    Reference,
    TrackingResult,
    TrackingSettings,
)

SETTLED_M = 0.2
"""Lateral error of the last second below which a car is back on its plan [m]."""
WHEELBASE = 2.58
"""Wheelbase of the kinematic car [m]: the multi-body car's (equations.md 8)."""
SPEEDS = (10.0, 25.0, 35.0)

Run = Callable[[Reference, int], TrackingResult]
"""Drives one plan; the second argument is its number."""
Disturb = Callable[[Reference, int], Disturbance]
"""The disturbance of a plan of that number."""


@dataclass(frozen=True)
class Figures:
    """Tracking of a set of plans.

    rmse_lateral_m over all samples; max_*: the worst sample of all; settled_m: the largest lateral error of a
    plan's last second; comfort_ratio: summed |jerk| of the tracked motions over that of the plans (both by
    differences); n_softened, n_lost: plans of that status; copes: see the module.
    """

    n_plans: int
    rmse_lateral_m: float
    max_lateral_m: float
    max_longitudinal_m: float
    settled_m: float
    max_slack: float
    comfort_ratio: float
    n_softened: int
    n_lost: int
    qp_failures: int
    copes: bool


def lane_change(v0: float, shift: float, T: float, *, speed_change: float = 0.0, dt: float = 0.1) -> Reference:
    """A quintic lane change from v0 [m/s], lateral shift [m], duration T [s], driven at the mean of its speeds."""
    plan = Quintic(v0, shift, T, (v0 + 0.5 * speed_change) * T, v0 + speed_change)
    s = sample(plan, np.linspace(0.0, T, round(T / dt) + 1))
    return Reference(dt, s.x, s.y, s.vx, s.vy, s.ax, s.ay)


def nominal_plans(speeds: Sequence[float] = SPEEDS) -> list[Reference]:
    """Four plans a speed [m/s]: a usual one, a brisk one, one at the jerk limit, one that slows down."""
    return [
        lane_change(v0, shift, T, speed_change=change)
        for v0 in speeds
        for T, shift, change in ((5.5, 3.5, 0.0), (4.0, -3.5, 0.0), (3.0, 3.5, 0.0), (5.5, -3.5, -3.0))
    ]


def recovery_plans() -> list[Reference]:
    """Six usual plans that leave time to recover from a disturbance."""
    return [lane_change(v0, shift, 6.0) for v0 in SPEEDS for shift in (3.5, -3.5)]


def judge(run: Run, references: Sequence[Reference]) -> Figures:
    """Drive all plans and draw the figures."""
    results = [run(reference, number) for number, reference in enumerate(references)]
    errors = np.concatenate([result.errors for result in results])
    settled = max(float(np.max(np.abs(r.errors[-round(1.0 / r.dt) :, 1]))) for r in results)
    jerk = sum(float(np.sum(np.abs(tracked_motion(r).jerk))) for r in results)
    planned = sum(float(np.sum(np.abs(planned_motion(r).jerk))) for r in references)
    return Figures(
        n_plans=len(results),
        rmse_lateral_m=float(np.sqrt(np.mean(errors[:, 1] ** 2))),
        max_lateral_m=float(np.max(np.abs(errors[:, 1]))),
        max_longitudinal_m=float(np.max(np.abs(errors[:, 0]))),
        settled_m=settled,
        max_slack=max(result.max_slack for result in results),
        comfort_ratio=jerk / planned,
        n_softened=sum(result.status == SOFTENED for result in results),
        n_lost=sum(result.status == LOST for result in results),
        qp_failures=sum(result.qp_failures for result in results),
        copes=settled < SETTLED_M and all(r.status in (TRACKED, SOFTENED) for r in results),
    )


def plant_run(
    plant: str,
    *,
    settings: TrackingSettings,
    disturb: Disturb | None = None,
    friction: float = 1.0,
    controller: Controller | None = None,
) -> Run:
    """How a plan is driven on that plant: by the MPC unless a controller is given.

    friction: see ``track_multibody``; the bicycle knows none.
    """

    def run(reference: Reference, number: int) -> TrackingResult:
        disturbance = disturb(reference, number) if disturb else None
        drive = partial(_driver(plant, friction, controller), settings=settings, disturbance=disturbance)
        return drive(reference)

    return run


def _driver(plant: str, friction: float, controller: Controller | None) -> Callable[..., TrackingResult]:
    if plant == MULTI_BODY:
        return partial(track_multibody, friction=friction, controller=controller)
    if controller is None:
        return partial(track, wheelbase=WHEELBASE)
    return partial(track_kinematic, controller=controller, wheelbase=WHEELBASE)


def constant(disturbance: Disturbance) -> Disturb:
    """The same disturbance for every plan."""
    return lambda reference, number: disturbance


def measurement_noise(sigma: float, seed: int) -> Disturb:
    """White noise: sigma [m] on either coordinate, a tenth of it in rad on the heading, seeded by plan number."""

    def disturb(reference: Reference, number: int) -> Disturbance:
        rng = np.random.default_rng([seed, number])
        noise = rng.normal(size=(reference.n_steps + 1, 3)) * sigma * np.array([1.0, 1.0, 0.1])
        return Disturbance(noise=noise)

    return disturb


WEIGHTS = (
    "weight_longitudinal",
    "weight_lateral",
    "weight_heading",
    "weight_speed_increment",
    "weight_steering_increment",
    "slack_penalty",
)
FACTORS = (0.1, 1.0 / 3.0, 1.0, 3.0, 10.0)
HORIZONS = ((2, 2), (4, 4), (6, 1), (6, 2), (6, 4), (6, 6), (8, 4), (10, 4), (15, 4), (20, 10))
"""N_p, N_c of the sensitivity table; 6, 4 is the paper's."""
HEADING_GRID = (0.1, 0.2, 0.3, 0.5, 1.0)
STEERING_GRID = (1.0, 3.0, 10.0, 30.0)
SPEED_GRID = (0.03, 0.1, 0.3, 1.0)
"""The sweep's grid: weights of heading, steering increment (unit: the lateral weight), speed increment (unit: the
longitudinal weight)."""
ASKED_LATERAL_M = {KINEMATIC: 0.05, MULTI_BODY: 0.15}
ASKED_LONGITUDINAL_M = 0.05
"""What the sweep asks of the largest errors: the bicycle on all plans, the multi-body car on those for it."""
SWEEP_NOISE_M = 0.02
"""Measurement noise under which the sweep prefers the calmest weights [m]."""


@dataclass(frozen=True)
class StudyRow:
    """One level of one quantity on one plant, with what came of it; controller as in the table's title."""

    controller: str
    plant: str
    quantity: str
    level: float
    unit: str
    figures: Figures


@dataclass(frozen=True)
class SweepRow:
    """One choice of weights: the bicycle on all plans, the multi-body car on some, and the same with noise."""

    settings: TrackingSettings
    kinematic: Figures
    multi_body: Figures
    noisy: Figures

    @property
    def meets(self) -> bool:
        """Whether both cars keep to their plans as is asked."""
        return all(
            figures.max_lateral_m < ASKED_LATERAL_M[plant] and figures.max_longitudinal_m < ASKED_LONGITUDINAL_M
            for plant, figures in ((KINEMATIC, self.kinematic), (MULTI_BODY, self.multi_body))
        )


def offset_cases() -> list[tuple[str, float, str, Disturb]]:
    """Quantity, level, unit and disturbance of the initial offsets."""
    cases = [("lateral offset", y, "m", (0.0, y, 0.0)) for y in (0.0, 0.25, 0.5, 1.0, 1.5)]
    cases += [("longitudinal offset", x, "m", (x, 0.0, 0.0)) for x in (0.5, 1.0, 2.0, 4.0)]
    cases += [("heading offset", phi, "rad", (0.0, 0.0, phi)) for phi in (0.01, 0.02, 0.05, 0.1, 0.2)]
    return [(quantity, level, unit, constant(Disturbance(at))) for quantity, level, unit, at in cases]


def noise_cases(seed: int) -> list[tuple[str, float, str, Disturb]]:
    """The same of the measurement noise."""
    return [("noise", s, "m", measurement_noise(s, seed)) for s in (0.01, 0.02, 0.05, 0.1, 0.2)]


def wheelbase_cases() -> list[tuple[str, float, str, Disturb]]:
    """The same of the bicycle's wheelbase, shorter and longer than the controller believes."""
    factors = [("shorter wheelbase", f) for f in (0.85, 0.7, 0.5, 0.4)]
    factors += [("longer wheelbase", f) for f in (1.15, 1.3, 2.0, 4.0)]
    return [(quantity, f, "x", constant(Disturbance(wheelbase_factor=f))) for quantity, f in factors]


def disturbance_table(
    references: Sequence[Reference], *, settings: TrackingSettings, plants: Iterable[str], seed: int
) -> list[StudyRow]:
    """The MPC under initial offsets, noise, a wrong wheelbase (bicycle) and low friction (multi-body car)."""
    rows = []
    for plant in plants:
        cases = offset_cases() + noise_cases(seed) + (wheelbase_cases() if plant == KINEMATIC else [])
        for quantity, level, unit, disturb in cases:
            figures = judge(plant_run(plant, settings=settings, disturb=disturb), references)
            rows.append(StudyRow("MPC", plant, quantity, level, unit, figures))
        for friction in (0.8, 0.6, 0.4, 0.3, 0.2, 0.1, 0.05) if plant == MULTI_BODY else ():
            figures = judge(plant_run(plant, settings=settings, friction=friction), references)
            rows.append(StudyRow("MPC", plant, "friction", friction, "x", figures))
    return rows


def copes_until(rows: Sequence[StudyRow]) -> dict[tuple[str, str], float | None]:
    """For each plant and quantity the last level, in the table's order, until which the controller copes."""
    limits: dict[tuple[str, str], float | None] = {}
    broken: set[tuple[str, str]] = set()
    for row in rows:
        key = (row.plant, row.quantity)
        limits.setdefault(key, None)
        if not row.figures.copes:
            broken.add(key)
        elif key not in broken:
            limits[key] = row.level
    return limits


def sensitivity_table(
    references: Sequence[Reference], *, settings: TrackingSettings, plants: Iterable[str]
) -> list[StudyRow]:
    """Every weight times 0.1 to 10 and the horizons, one at a time around the given settings.

    The slack's weight acts on bounds that bind, so it is judged with the car 2 m ahead of its plan.
    """
    cases = [
        (name, factor, "x", {name: getattr(settings, name) * factor}) for name in WEIGHTS for factor in FACTORS
    ]
    for horizon, control_horizon in HORIZONS:
        update = {"horizon": horizon, "control_horizon": control_horizon}
        cases.append((f"N_p, with N_c = {control_horizon}", float(horizon), "samples", update))
    rows = []
    for plant in plants:
        for name, level, unit, update in cases:
            disturb = constant(Disturbance((2.0, 0.0, 0.0))) if name == "slack_penalty" else None
            changed = settings.model_copy(update=update)
            figures = judge(plant_run(plant, settings=changed, disturb=disturb), references)
            rows.append(StudyRow("MPC", plant, name, level, unit, figures))
    return rows


def weight_sweep(
    references: Sequence[Reference],
    multi_body_references: Sequence[Reference],
    *,
    settings: TrackingSettings,
    seed: int,
) -> list[SweepRow]:
    """The grid of weights, those first that meet what is asked, and of these the calmest under noise.

    references: plans for the bicycle; multi_body_references: plans for the multi-body car, without and with
    measurement noise.
    """
    noise = measurement_noise(SWEEP_NOISE_M, seed)
    found = []
    for heading, steering, speed in product(HEADING_GRID, STEERING_GRID, SPEED_GRID):
        update = {
            "weight_heading": heading,
            "weight_steering_increment": steering,
            "weight_speed_increment": speed,
        }
        changed = settings.model_copy(update=update)
        kinematic = judge(plant_run(KINEMATIC, settings=changed), references)
        multi_body = judge(plant_run(MULTI_BODY, settings=changed), multi_body_references)
        noisy = judge(plant_run(MULTI_BODY, settings=changed, disturb=noise), multi_body_references)
        found.append(SweepRow(changed, kinematic, multi_body, noisy))
    return sorted(found, key=sweep_rank)


def sweep_rank(row: SweepRow) -> tuple[bool, float]:
    """The order of the sweep: first what meets, then by the jerk under noise."""
    return not row.meets, row.noisy.comfort_ratio


def baseline_table(
    references: Sequence[Reference], *, settings: TrackingSettings, plants: Iterable[str], seed: int
) -> list[StudyRow]:
    """MPC, LQR with feedforward and pure pursuit: nominal, with a lateral offset, with noise."""
    dt = references[0].dt
    conditions = (
        ("nominal", 0.0, "", None),
        ("lateral offset", 0.25, "m", constant(Disturbance((0.0, 0.25, 0.0)))),
        ("noise", 0.05, "m", measurement_noise(0.05, seed)),
    )
    rows = []
    for plant in plants:
        wheelbase = WHEELBASE if plant == KINEMATIC else multibody.WHEELBASE
        controllers: dict[str, Controller | None] = {
            "MPC": None,
            "LQR": LqrController(settings, wheelbase, dt),
            "pure pursuit": PurePursuit(settings, wheelbase, dt),
        }
        for name, controller in controllers.items():
            for quantity, level, unit, disturb in conditions:
                run = plant_run(plant, settings=settings, disturb=disturb, controller=controller)
                rows.append(StudyRow(name, plant, quantity, level, unit, judge(run, references)))
    return rows
