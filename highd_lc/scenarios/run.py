"""Every cell that is looked at: situations under named variants of the options, forms, accountings, weights.

A scenario planned and driven: plans of every weight of the AV, the platoon behind them, what it comes to.
"""

import itertools
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.drive import hardest_braking
from highd_lc.core.edie import clip_to_rectangle, edie, trajectories_of
from highd_lc.core.losses import charge, command_jerk
from highd_lc.core.quintic import PEAK_AY, Quintic, sample, z_rate
from highd_lc.planning import planner
from highd_lc.planning.planner import PlanningProblem
from highd_lc.planning.pool import Goal, Pool
from highd_lc.planning.replay import AvMotion, Replay, plan_motion, replay
from highd_lc.planning.search import search
from highd_lc.scenarios.platoon import (
    Lead,
    Platoon,
    Situation,
    drive_platoon,
    gaps,
    scene_of,
    situations,
    steady_lead,
    time_headways,
    travel_time,
)
from highd_lc.scoring import charges
from highd_lc.vocab import names
from highd_lc.vocab.policy import ACCOUNTINGS
from highd_lc.vocab.scenarios import Changes, RectangleSettings, ScenarioOptions, ScenarioSettings, SectionSettings
from highd_lc.vocab.settings import ValidateSettings
from highd_lc.vocab.tables.scenarios import CELL_KEYS, COLLISION, T_BOUND, V_BOUND

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Cell:
    """Which plan of a situation: its form, accounting and weight of the AV."""

    form: str
    accounting: str
    omega_av: float


@dataclass(frozen=True)
class Planned:
    """A situation with the candidates of its search."""

    situation: Situation
    problem: PlanningProblem
    pools: dict[str, Pool]

    def plan(self, cell: Cell) -> Quintic | None:
        """The best plan of a cell, None if there is none."""
        pool = self.pools[cell.form]
        best = pool.best(Goal(cell.accounting, cell.omega_av))
        if best is None:
            return None
        return self.problem.task.quintic(int(pool.n[best]), float(pool.delta[best]), float(pool.change[best]))

    @property
    def status(self) -> str:
        """Why there is no plan where there is none."""
        return names.INFEASIBLE_AT_START if planner.overlap_at_start(self.problem) else names.INFEASIBLE


@dataclass(frozen=True)
class Outcome:
    """A plan driven: its losses (columns of ``losses_at``), the AV and the platoon behind it."""

    plan: Quintic
    replay: Replay
    platoon: Platoon
    losses: dict[str, float] = field(default_factory=dict)


def plan_situation(posed: Situation, settings: ScenarioSettings, *, omegas: tuple[float, ...]) -> Planned:
    """Search the plans of a situation for these weights of the AV, under every accounting and in both forms."""
    problem = planner.pose(scene_of(posed), settings.planning(posed.options))
    goals = [Goal(a, o) for a in names.ACCOUNTINGS for o in omegas]
    fixed = search(problem.task, goals)
    return Planned(posed, problem, {names.FIXED: fixed, names.FREE: search(problem.task, goals, known=fixed)})


def drive_plan(planned: Planned, plan: Quintic, *, accounting: str, followers: int | None = None) -> Outcome:
    """Drive a plan: the planner's replay over H for the losses, the platoon over the whole run.

    followers: how many of the platoon to drive, None = all.
    """
    problem, posed = planned.problem, planned.situation
    played = replay(plan_motion(plan, problem.packed), problem.packed)
    dt = posed.vehicle.dt_s
    losses = charges.cumulative_losses(played, problem.terms, dt)
    charged = charges.losses_at(losses, accounting, problem.terms, n=played.av.n, dt=dt)
    kept = {key: float(value) for key, value in charged.items() if isinstance(value, float)}
    return Outcome(plan, played, drive_behind(posed, av_lead(posed, plan), followers=followers), kept)


def av_lead(posed: Situation, plan: Quintic) -> Lead:
    """The AV from t_start on as the platoon's lead: its plan, then its end speed."""
    n = round(plan.T / posed.vehicle.dt_s)
    s = sample(plan, np.arange(n + 1, dtype=np.float64) * posed.vehicle.dt_s)
    return lead_of_motion(posed, s.x, v=s.vx)


def lead_of_motion(posed: Situation, x: FloatArray, *, v: FloatArray) -> Lead:
    """A motion x [m], v [m/s] from t_start on as the platoon's lead, at its last speed after its end.

    x is 0 at t_start. Under ``leader_from = "crossing"`` HV_1 sees the platoon's leader until half of the motion.
    """
    dt, instants, length = posed.vehicle.dt_s, posed.instants, posed.vehicle.length_m
    n = min(len(x), instants) - 1
    beyond = np.arange(1, instants - n)
    front = np.concatenate([x[: n + 1], x[n] + v[n] * dt * beyond])
    speed = np.concatenate([v[: n + 1], np.full(len(beyond), v[n])])
    if posed.options.leader_from == "crossing":
        before = leader_lead(posed)
        front[: n // 2], speed[: n // 2] = before.front[: n // 2], before.v[: n // 2]
    return Lead(front, speed, length)


def leader_lead(posed: Situation) -> Lead:
    """The platoon's leader from t_start on, or a free road: the lead without a lane change."""
    return steady_lead(
        posed.leader_front,
        posed.platoon_speed,
        instants=posed.instants,
        dt=posed.vehicle.dt_s,
        length=posed.vehicle.length_m,
    )


def drive_behind(posed: Situation, lead: Lead, *, followers: int | None = None) -> Platoon:
    """The platoon from t_start on behind a lead."""
    start = posed.start
    if followers is not None:
        start = type(start)(*(getattr(start, f)[:followers] for f in ("front", "v", "length", "parameters")))
    return drive_platoon(start, lead, dt=posed.vehicle.dt_s, hardest=hardest_braking(posed.options.b_max))


def no_lane_change(posed: Situation, *, followers: int | None = None) -> Platoon:
    """The platoon without the AV."""
    return drive_behind(posed, leader_lead(posed), followers=followers)


def platoon_loss(problem: PlanningProblem, platoon: Platoon, *, accounting: str, n: int) -> float:
    """Loss of the planned followers in a run of the platoon over the accounted time. n: sample of T."""
    terms, dt = problem.terms, problem.scene.dt
    samples = len(problem.packed.target_v)
    _, last = ACCOUNTINGS[accounting].charged(n, samples - 1)
    p = len(terms.weights)
    v, a = platoon.v[:p, :samples], platoon.a[:p, :samples]
    return charge(v, command_jerk(a, dt), terms.hv_ref[:, None], terms).upto(last).weighted(terms.weights).loss


def traffic_columns(outcome: Outcome, unchanged: Platoon, *, settings: ScenarioSettings) -> dict[str, Any]:
    """What the platoon makes of a plan: speeds, headways, travel time, Edie's measures (``scenario_cells``).

    unchanged: the same platoon without a lane change.
    """
    platoon = outcome.platoon
    section = section_of(settings.section)
    return {
        "hv1_v_min": float(platoon.v[0].min()),
        "hv_v_min": platoon.v.min(axis=1).tolist(),
        "min_gap_m": float(gaps(platoon).min()),
        "min_time_headway_s": smallest_headway(platoon),
        "ttt_difference_s": travel_time(platoon, section) - travel_time(unchanged, section),
        **rectangle_measures(platoon, settings.rectangle),
    }


def plan_columns(plan: Quintic, av: AvMotion) -> dict[str, Any]:
    """A plan and what the AV reaches by it (``scenario_cells``)."""
    return {
        "status": names.SOLVED,
        "T": plan.T,
        "x_final": plan.x_final,
        "v_end": plan.v_end,
        "av_v_max": float(np.hypot(av.vx, av.vy)[: av.n + 1].max()),
        "av_v_end": plan.v_end,
        "av_vy_max": z_rate(0.5) * plan.D / plan.T,
        "av_ay_max": PEAK_AY * plan.D / plan.T**2,
    }


def why_not_valid(row: Mapping[str, Any], planning: ValidateSettings) -> str:
    """Why a cell's numbers say nothing: its plan drives into somebody, or sits on a bound of T or of the speed.

    Args:
        row: with T [s], av_v_max [m/s] and min_gap_m of ``scenario_cells``.
        planning: the bounds.

    Returns:
        The reasons, empty if there are none (equations.md 13.8).
    """
    at_T = any(abs(row["T"] - bound) < 1e-9 for bound in (planning.planner.T_min, planning.planner.T_max))
    reasons = (
        (COLLISION, row["min_gap_m"] < 0.0),
        (T_BOUND, at_T),
        (V_BOUND, row["av_v_max"] > planning.constraints.v_max - _AT_BOUND),
    )
    return ", ".join(reason for reason, given in reasons if given)


def smallest_headway(platoon: Platoon) -> float:
    """Smallest time headway of HV_1 [s], NaN if it never follows anybody."""
    headway = time_headways(platoon)[0]
    return float(np.nanmin(headway)) if np.isfinite(headway).any() else np.nan


def section_of(settings: SectionSettings) -> tuple[float, float]:
    """The section of the travel time, from x to x [m]."""
    return settings.from_m, settings.from_m + settings.length_m


def rectangle_totals(platoon: Platoon, settings: RectangleSettings) -> tuple[FloatArray, FloatArray]:
    """Distance [m] and time [s] of each follower in the rectangle (Table 1)."""
    until = np.searchsorted(platoon.t, settings.duration_s, side="right") + 1
    top = platoon.front[0, 0] + settings.top_m
    return clip_to_rectangle(
        trajectories_of(platoon.t[:until], platoon.front[:, :until]),
        x_range=(float(top - settings.height_m), float(top)),
        t_range=(0.0, settings.duration_s),
    )


def rectangle_measures(platoon: Platoon, settings: RectangleSettings) -> dict[str, Any]:
    """Edie's flow, speed and density in the rectangle (Table 2) and each follower's share (Table 1)."""
    distance, time = rectangle_totals(platoon, settings)
    measures = edie(float(distance.sum()), float(time.sum()), settings.height_m * settings.duration_s)
    columns = dict(zip(("flow_veh_h", "speed_km_h", "density_veh_km"), measures, strict=True))
    return {**columns, "rectangle_time_s": time.tolist(), "rectangle_distance_m": distance.tolist()}


Row = dict[str, Any]

_BESIDE_CONTACTS: Final = frozenset(
    {*(column.name for column in CELL_KEYS), "status", "T", "x_final", "v_end", "min_gap_m"}
)
"""What remains of a cell whose plan drives into somebody."""
_AT_BOUND: Final = 0.05
"""A speed counts as on its bound from this much below it on [m/s]."""

DEFAULT: Final = "default"
PAPER_LITERAL: Final = "paper_literal"


def variants(settings: ScenarioSettings) -> dict[str, ScenarioOptions]:
    """Options by name: the default, the paper's printed ones, and each named variant."""
    changes: dict[str, Changes] = {DEFAULT: {}, PAPER_LITERAL: settings.paper_literal, **settings.variants}
    return {name: settings.with_options(change) for name, change in changes.items()}


def combinations(settings: ScenarioSettings) -> Iterator[tuple[str, ScenarioOptions]]:
    """Every combination of the sweep's values, named by what it changes; none is the default."""
    for values in itertools.product(*settings.sweep.values()):
        options = settings.with_options(dict(zip(settings.sweep, values, strict=True)))
        yield name_of(options, settings.options), options


def name_of(options: ScenarioOptions, default: ScenarioOptions) -> str:
    """The options that differ from the default, as one word each."""
    given, usual = options.model_dump(), default.model_dump()
    return " ".join(f"{key}={value}" for key, value in given.items() if value != usual[key]) or DEFAULT


def rows_of_variants(settings: ScenarioSettings, *, threads: int = 1) -> list[Row]:
    """The cells of every named variant; of the default one for every weight of the AV."""
    named = variants(settings)
    pair = tuple(settings.weights.values())
    weights = {name: settings.omegas if name == DEFAULT else pair for name in named}

    def one(name: str) -> list[Row]:
        return rows_of_options(name, named[name], settings=settings, omegas=weights[name])

    with ThreadPoolExecutor(threads) as pool:
        return [row for rows in pool.map(one, named) for row in rows]


def rows_of_sweep(settings: ScenarioSettings, *, threads: int = 1) -> Iterator[list[Row]]:
    """The cells of every combination of the sweep, one combination after the other."""
    weights = tuple(settings.weights.values())

    def one(named: tuple[str, ScenarioOptions]) -> list[Row]:
        return rows_of_options(named[0], named[1], settings=settings, omegas=weights)

    with ThreadPoolExecutor(threads) as pool:
        yield from pool.map(one, combinations(settings))


def rows_of_options(
    variant: str, options: ScenarioOptions, *, settings: ScenarioSettings, omegas: tuple[float, ...]
) -> list[Row]:
    """The cells of every scenario with a platoon under one set of options (rows of ``scenario_cells``)."""
    rows = []
    for posed in situations(settings, options):
        planned = plan_situation(posed, settings, omegas=omegas)
        rows += rows_of_plans(planned, variant, settings=settings, omegas=omegas)
    return rows


def rows_of_plans(
    planned: Planned, variant: str, *, settings: ScenarioSettings, omegas: tuple[float, ...]
) -> list[Row]:
    """One row a form, accounting and weight of the AV."""
    count = len(planned.problem.packed.follower_x)
    posed = planned.situation
    unchanged = no_lane_change(posed, followers=count)
    cells = itertools.product(names.FORMS, names.ACCOUNTINGS, omegas)
    return [
        {"scenario": posed.key, "variant": variant, "v_start": posed.v_av, **posed.options.model_dump()}
        | _cell_columns(planned, Cell(*cell), settings=settings, unchanged=unchanged)
        for cell in cells
    ]


def _cell_columns(planned: Planned, cell: Cell, *, settings: ScenarioSettings, unchanged: Platoon) -> Row:
    row: Row = {"form": cell.form, "accounting": cell.accounting, "omega_av": cell.omega_av}
    plan = planned.plan(cell)
    if plan is None:
        return row | {"status": planned.status, "not_valid": ""}
    outcome = drive_plan(
        planned, plan, accounting=cell.accounting, followers=len(planned.problem.packed.follower_x)
    )
    traffic = traffic_columns(outcome, unchanged, settings=settings)
    traffic["loss_hv_unchanged"] = platoon_loss(
        planned.problem, unchanged, accounting=cell.accounting, n=outcome.replay.av.n
    )
    row |= plan_columns(plan, outcome.replay.av) | outcome.losses | traffic
    return judged(row, planned.problem.settings)


def judged(row: Row, planning: ValidateSettings) -> Row:
    """A cell with the reason why it is not valid; what a contact made is left out of it."""
    reason = why_not_valid(row, planning)
    kept = row if COLLISION not in reason else {key: v for key, v in row.items() if key in _BESIDE_CONTACTS}
    return kept | {"not_valid": reason}
