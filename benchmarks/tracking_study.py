"""Record the tracking study: runs every table and writes docs/tracking.md (about a minute on two cores).

python benchmarks/tracking_study.py [OUT]
"""

import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from tracking_cases import (
    ASKED_LATERAL_M,
    ASKED_LONGITUDINAL_M,
    SWEEP_NOISE_M,
    WHEELBASE,
    Figures,
    StudyRow,
    SweepRow,
    baseline_table,
    copes_until,
    disturbance_table,
    lane_change,
    nominal_plans,
    plant_run,
    recovery_plans,
    sensitivity_table,
    weight_sweep,
)

from highd_lc.core.losses import LossTerms
from highd_lc.tracking.multibody import SERVO, SUBSTEPS, MultiBodyPlant, track_multibody
from highd_lc.tracking.plan_tracking import SampledMotion, loss_av, planned_motion, tracked_motion
from highd_lc.vocab.tracking import KINEMATIC, MULTI_BODY, PLANTS, Reference, TrackingSettings

SEED = 1
LOSS = LossTerms(33.54, np.empty(0), False, comfort=0.5 / 8.0, efficiency=0.5 / 33.54, weights=np.empty(0))
FIGURES = (
    "lateral RMSE [m]",
    "lateral max [m]",
    "longitudinal max [m]",
    "lateral, last second [m]",
    "max slack",
    "jerk, tracked / planned",
    "softened",
    "lost",
    "unsolved QPs",
    "copes",
)

INTRODUCTION = """# Tracking: what was chosen, and how far it carries

Written by `python benchmarks/tracking_study.py`; every number below comes from that run.

The MPC follows equations 20 to 24 with the paper's N_p = 6, N_c = 4; R, Q and rho are not printed there. The
heading error is weighed as the lateral speed v_r (phi - phi_r) that it stands for: a constant weight that keeps
the multi-body car calm at 35 m/s leaves an offset at 10 m/s standing for seconds.

*Nominal* plans: at 10, 25 and 35 m/s a usual lane change (5.5 s), a brisk one (4 s), one at the jerk limit (3 s)
and one that slows down by 3 m/s (5.5 s); 3.5 m to either side. Disturbances are judged on six usual plans of 6 s.
The bicycle has the multi-body car's wheelbase, {wheelbase} m. A controller *copes* when no plan ends lost (more
than half a lane off) or with an unsolved QP, and the lateral error of the last second stays below 0.2 m. Jerk is
the summed |jerk| of both axes by finite differences, of the tracked motion over that of the plan.

The multi-body car is parameter set 2 of commonroad-vehicle-models (BMW 320i, 29 states). Its low-level map from
[v, delta]: acceleration = {servo_v:g} (v - speed), steering rate = {servo_delta:g} (delta - steering), both cut to
the car's limits. Runge-Kutta of order 4, {substeps} steps in 0.1 s.
"""

IN_PIPELINE = """The bicycle drives the plans of all events (accounting `equal`), with the event's wheelbase; the
multi-body car those of a stratified, seeded sample (`validate.studies.multibody_sample`), with
its own, whatever the ego's class. Both carry the event's box along the tracked rear axle.
Around the tracked motion everybody is simulated again: the followers behind it, the drive after
T from where it ends. Limits and clearances are checked on that, without a tolerance for
contact: a plan that lies on its clearance may lose it by as much as the car is off. That is why
the profile `practice` asks for a margin, between ellipses and between followers. `tracking`
has planned and tracked losses and clearance side by side, `tracking_summary` the figures by
policy and plant, `tracking_contacts` the contacts by pair and cause. What has no plan, or one
that is not finite, is a row with its status and no numbers.

The multi-body car weaves by itself: at {speed:g} m/s, speed and steering held straight for 10 s
and no controller at all, its rear axle accelerates sideways by up to {acceleration:.2f} m/s^2,
a comfort loss of {comfort:.1f}. The AV's tracked loss on this plant holds that, most visibly
for long and calm plans; nothing is filtered.
"""

INTEGRATION = """Largest difference of a pose [m, rad] between the step used and one of an eighth, over a lane
change of 8 s. At low speed the wheels' spin is stiff; at high speed the tyre model jumps with the sign of the
camber, so that the difference does not fall with the order of the method.
"""

SWEEP = """The default is the first line: of the weights with which the bicycle stays within {kinematic} m sideways
on every nominal plan, the multi-body car within {multi_body} m at 25 m/s and both within {along} m lengthwise, the
one that drives the multi-body car with the least jerk when positions are measured with {noise} m of noise. Largest
errors in m.
"""


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows]) + "\n"


def cells(f: Figures) -> list[str]:
    """The figures as table cells."""
    numbers = (f.rmse_lateral_m, f.max_lateral_m, f.max_longitudinal_m, f.settled_m)
    slack = "-" if np.isnan(f.max_slack) else f"{f.max_slack:.1e}"
    counts = (f.n_softened, f.n_lost, f.qp_failures)
    answer = "yes" if f.copes else "**no**"
    return [f"{n:.4f}" for n in numbers] + [slack, f"{f.comfort_ratio:.2f}"] + [str(c) for c in counts] + [answer]


def study(rows: Sequence[StudyRow]) -> str:
    """A table of study rows, one level a line."""
    header = ("controller", "plant", "quantity", "level", *FIGURES)
    return table(
        header, ([r.controller, r.plant, r.quantity, f"{r.level:.3g} {r.unit}", *cells(r.figures)] for r in rows)
    )


def sweep(rows: Sequence[SweepRow]) -> str:
    """The sweep's table, best first."""
    header = (
        "R heading",
        "Q steering",
        "Q speed",
        "meets",
        "jerk with noise",
        "bicycle lateral",
        "longitudinal",
        "multi-body lateral",
        "longitudinal",
        "jerk",
    )
    return table(header, (sweep_cells(row) for row in rows))


def sweep_cells(row: SweepRow) -> list[str]:
    """One choice of weights as table cells."""
    s, k, m = row.settings, row.kinematic, row.multi_body
    weights = (s.weight_heading, s.weight_steering_increment, s.weight_speed_increment)
    errors = (k.max_lateral_m, k.max_longitudinal_m, m.max_lateral_m, m.max_longitudinal_m)
    meets = "yes" if row.meets else "no"
    return [
        *(f"{w:g}" for w in weights),
        meets,
        f"{row.noisy.comfort_ratio:.2f}",
        *(f"{e:.4f}" for e in errors),
        f"{m.comfort_ratio:.2f}",
    ]


def losses(references: Sequence[Reference], settings: TrackingSettings) -> str:
    """The AV's loss over 0..T, planned against tracked on both plants."""
    rows = []
    for number, reference in enumerate(references):
        planned = loss_av(planned_motion(reference), LOSS)
        row = [f"{reference.speed[0]:.0f} m/s, {reference.n_steps * reference.dt:.1f} s", f"{planned.loss:.3f}"]
        for plant in PLANTS:
            tracked = loss_av(tracked_motion(plant_run(plant, settings=settings)(reference, number)), LOSS)
            row += [f"{tracked.loss:.3f}", f"{tracked.comfort:.2f} / {planned.comfort:.2f}"]
        rows.append(row)
    header = ("plan", "planned", "bicycle", "comfort / planned", "multi-body", "comfort / planned")
    return table(header, rows)


def integration(settings: TrackingSettings) -> str:
    """Integration error and tracking error by speed."""
    rows = []
    for v in (1.0, 2.0, 3.0, 5.0, 10.0, 25.0, 40.0):
        reference = lane_change(v, min(3.5, 0.7 * v), 8.0)
        used = track_multibody(reference, settings=settings)
        fine = track_multibody(reference, settings=settings, substeps=8 * SUBSTEPS)
        difference = np.abs(used.states - fine.states).max()
        rows.append([f"{v:g}", f"{difference:.1e}", f"{used.max_lateral_m:.1e}"])
    return table(("speed [m/s]", "integration error", "largest lateral tracking error [m]"), rows)


def weaving(speed: float = 25.0) -> str:
    """What the multi-body car does by itself, speed [m/s] and steering held, in the text on the pipeline."""
    car, velocity = MultiBodyPlant(np.zeros(3), speed), []
    for _ in range(101):
        velocity.append(car.velocity())
        car.advance(np.array([speed, 0.0]), 0.1)
    motion = SampledMotion(0.1, np.array(velocity))
    comfort = loss_av(motion, LOSS).comfort
    return IN_PIPELINE.format(speed=speed, acceleration=np.abs(motion.acceleration[:, 1]).max(), comfort=comfort)


def limits(rows: Sequence[StudyRow]) -> str:
    """Until which level the controller copes, for each kind of disturbance."""
    known = {(r.plant, r.quantity): r.unit for r in rows}
    found = copes_until(rows).items()
    return table(
        ("plant", "disturbance", "copes until"),
        (
            [plant, quantity, "not at the first level" if level is None else f"{level:g} {known[plant, quantity]}"]
            for (plant, quantity), level in found
        ),
    )


def main() -> None:
    """Run the study and write the page."""
    settings, nominal, recovery = TrackingSettings(), nominal_plans(), recovery_plans()
    ranked = weight_sweep(nominal, nominal_plans((25.0,)), settings=settings, seed=SEED)
    disturbances = disturbance_table(recovery, settings=settings, plants=PLANTS, seed=SEED)
    page = [
        INTRODUCTION.format(
            wheelbase=WHEELBASE,
            servo_v=SERVO[0],
            servo_delta=SERVO[1],
            substeps=SUBSTEPS,
        ),
        INTEGRATION,
        integration(settings),
        "## In the pipeline\n",
        weaving(),
        "## Where the controller stops coping\n",
        limits(disturbances),
        "## Disturbances\n",
        study(disturbances),
        "## Weights: the sweep\n",
        SWEEP.format(
            kinematic=ASKED_LATERAL_M[KINEMATIC],
            multi_body=ASKED_LATERAL_M[MULTI_BODY],
            along=ASKED_LONGITUDINAL_M,
            noise=SWEEP_NOISE_M,
        ),
        sweep(ranked),
        "## Sensitivity\n",
        "One setting at a time; the slack's weight with the car 2 m ahead of its plan, where bounds bind.\n",
        study(sensitivity_table(nominal, settings=settings, plants=PLANTS)),
        "## Baselines on the same plants\n",
        study(baseline_table(recovery, settings=settings, plants=PLANTS, seed=SEED)),
        "## Planned against tracked: the AV's loss over 0..T\n",
        losses(nominal, settings),
    ]
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("docs/tracking.md")
    out.write_text("\n".join(page), encoding="utf-8")
    print(f"{out}; the sweep's choice: {ranked[0].settings}")


if __name__ == "__main__":
    main()
