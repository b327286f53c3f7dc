"""The tables of the tracking study: disturbances and limits, weights and horizons, baselines."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product

from highd_lc.algorithms.baselines import LqrController, PurePursuit
from highd_lc.algorithms.closed_loop import Disturbance
from highd_lc.algorithms.controllers import Controller
from highd_lc.algorithms.multibody import dynamics
from highd_lc.algorithms.tracking_study import (
    WHEELBASE,
    Disturb,
    Figures,
    constant,
    judge,
    measurement_noise,
    plant_run,
)
from highd_lc.vocab.tracking import KINEMATIC, MULTI_BODY, Reference, TrackingSettings

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
        wheelbase = WHEELBASE if plant == KINEMATIC else dynamics().WHEELBASE
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
