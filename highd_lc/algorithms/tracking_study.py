"""Judging a tracking controller: the plans it is judged on, how they are driven, the figures that come out.

A controller *copes* when every plan ends in a status other than lost or failed and the lateral error of its last
second is below ``SETTLED_M``.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from highd_lc.algorithms.closed_loop import Disturbance
from highd_lc.algorithms.controllers import Controller, track_kinematic
from highd_lc.algorithms.multibody import track_multibody
from highd_lc.algorithms.tracked_motion import planned_motion, tracked_motion
from highd_lc.algorithms.tracker import track
from highd_lc.core.quintic import Quintic, sample
from highd_lc.vocab.tracking import (
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
"""Wheelbase of the kinematic car [m]: the multi-body car's (SPEC section 8)."""
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
