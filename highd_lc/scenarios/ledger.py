"""The ledger: each published number beside ours, under every accounting and in the cell nearest to it.

Scenario 3: the printed initial state of one HighD event; the AV's speed, not printed, is a free axis.
"""

import itertools
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.planning import planner
from highd_lc.planning.planner import PlanningProblem
from highd_lc.planning.pool import Goal, Pool
from highd_lc.planning.replay import plan_motion, replay
from highd_lc.planning.scene import Followers, Motion, Scene
from highd_lc.planning.search import search
from highd_lc.scenarios.platoon import simulated_scene, steady_motion
from highd_lc.scenarios.run import DEFAULT, PAPER_LITERAL
from highd_lc.scoring import charges
from highd_lc.vocab import names
from highd_lc.vocab.driver import TABLE3_MEANS
from highd_lc.vocab.published import PUBLISHED, Published
from highd_lc.vocab.scenarios import ScenarioOptions, ScenarioSettings
from highd_lc.vocab.sections import LossSettings
from highd_lc.vocab.settings import ValidateSettings
from highd_lc.vocab.tables.scenarios import NEAR, NO_PLAN, NOT_REPRODUCED, REPRODUCED

FloatArray = NDArray[np.float64]
Row = dict[str, Any]

KEY = "3"


def variant_of(v_av: float) -> str:
    """Name of the cell with this speed of the AV [m/s]."""
    return f"v_av={v_av:g}"


def options_of(settings: ScenarioSettings) -> ScenarioOptions:
    """Conventions of scenario 3: weighted, Table 3 means, its own references; the platoon's do not matter."""
    state = settings.scenario_3
    return settings.with_options(
        {
            "aggregation": "weighted",
            "v_ref_av": state.v_ref,
            "v_desire": TABLE3_MEANS.v_desire,
            "spacing_m": state.spacings_m[1] - state.spacings_m[0],
            "planned_followers": len(state.spacings_m),
        }
    )


def printed_scene(settings: ScenarioSettings, v_av: float) -> Scene:
    """The printed state with the AV at v_av [m/s]; followers with Table 3 means.

    Spacings count from front to front; the followers are faster than the AV, its leader slower. The target
    leader, whose speed is not printed either, drives as fast as HV_1.
    """
    state, vehicle = settings.scenario_3, settings.vehicle
    samples, p = round(settings.options.horizon_s / vehicle.dt_s) + 1, len(state.spacings_m)
    v = v_av + np.array(state.speed_differences)
    followers = Followers(
        x=-np.array(state.spacings_m),
        y=np.full(p, vehicle.lateral_shift_m),
        v=v,
        length=np.full(p, vehicle.length_m),
        width=np.full(p, vehicle.width_m),
        parameters=np.tile(TABLE3_MEANS.as_array(), (p, 1)),
        L_no_change=TABLE3_MEANS.L,
        recorded=(),
    )
    ahead = state.target_gap_m + vehicle.length_m - state.spacings_m[0]
    slower = v_av - state.origin_leader_difference

    def steady(x: float, y: float, speed: float) -> Motion:
        return steady_motion(x, y, v=speed, samples=samples, vehicle=vehicle)

    return simulated_scene(
        KEY,
        v_av,
        followers=followers,
        vehicle=vehicle,
        horizon=settings.options.horizon_s,
        target_leader=steady(ahead, vehicle.lateral_shift_m, float(v[0])),
        origin_leader=steady(state.origin_leader_ahead_m, 0.0, slower),
    )


def _planning(settings: ScenarioSettings) -> ValidateSettings:
    """HighD's conventions of losses and limits, the scenario's drive after T."""
    planning, state = settings.planning(options_of(settings)), settings.scenario_3
    loss = planning.loss.model_dump() | {"v_ref_hv": state.v_ref, "efficiency_scale": state.v_ref}
    constraints = planning.constraints.model_copy(update={"v_max": state.v_max})
    return planning.model_copy(update={"loss": LossSettings.model_validate(loss), "constraints": constraints})


def rows_of_printed_state(settings: ScenarioSettings) -> list[Row]:
    """Cells of scenario 3 over the speed of the AV (rows of ``scenario_cells``)."""
    rows = []
    for v_av in settings.scenario_3.av_speeds:
        problem = planner.pose(printed_scene(settings, v_av), _planning(settings))
        omegas = tuple(settings.weights.values())
        goals = [Goal(a, o) for a in names.ACCOUNTINGS for o in omegas]
        fixed = search(problem.task, goals)
        pools = {names.FIXED: fixed, names.FREE: search(problem.task, goals, known=fixed)}
        head = {"scenario": KEY, "variant": variant_of(v_av), "v_start": v_av, **options_of(settings).model_dump()}
        rows += [
            head | {"form": form, "accounting": a, "omega_av": o} | _columns(problem, pools[form], Goal(a, o))
            for form, a, o in itertools.product(names.FORMS, names.ACCOUNTINGS, omegas)
        ]
    return rows


def _columns(problem: PlanningProblem, pool: Pool, goal: Goal) -> Row:
    best = pool.best(goal)
    if best is None:
        start = planner.overlap_at_start(problem)
        return {"status": names.INFEASIBLE_AT_START if start else names.INFEASIBLE}
    plan = problem.task.quintic(int(pool.n[best]), float(pool.delta[best]), float(pool.change[best]))
    played = replay(plan_motion(plan, problem.packed), problem.packed)
    dt, n = problem.scene.dt, played.av.n
    losses = charges.cumulative_losses(played, problem.terms, dt)
    charged = charges.losses_at(losses, goal.accounting, problem.terms, n=n, dt=dt)
    return {
        "status": names.SOLVED,
        "T": plan.T,
        "x_final": plan.x_final,
        "v_end": plan.v_end,
        **{key: value for key, value in charged.items() if isinstance(value, float)},
        "av_v_max": float(np.hypot(played.av.vx, played.av.vy)[: n + 1].max()),
        "av_v_end": plan.v_end,
        "hv1_v_min": float(played.v[0].min()),
    }


CellKey = tuple[str, str, str, str, float]

_REPRODUCED_WITHIN: Final = 0.01
_NEAR_WITHIN: Final = 0.10


@dataclass(frozen=True)
class Book:
    """All cells, found by scenario, variant, form, accounting and weight of the AV."""

    cells: dict[CellKey, Row]
    settings: ScenarioSettings

    @classmethod
    def of(cls, rows: Iterable[Row], settings: ScenarioSettings) -> "Book":
        """A book of rows of ``scenario_cells``."""
        found = {(r["scenario"], r["variant"], r["form"], r["accounting"], r["omega_av"]): r for r in rows}
        return cls(found, settings)

    def default_variant(self, scenario: str) -> str:
        """Name of the default cell: of scenario 3 the one at its default speed of the AV."""
        if scenario == KEY:
            return variant_of(self.settings.scenario_3.default_av_speed)
        return DEFAULT

    def variants(self, scenario: str) -> list[str]:
        """Names of a scenario's variants, in their order."""
        return list(dict.fromkeys(key[1] for key in self.cells if key[0] == scenario))

    def value(
        self,
        number: Published,
        *,
        variant: str | None = None,
        form: str | None = None,
        accounting: str | None = None,
    ) -> float:
        """Our counterpart of a published number in a cell, of the default where nothing is given; NaN if none."""
        key = (
            number.scenario,
            variant or self.default_variant(number.scenario),
            form or self.settings.form,
            accounting or self.settings.accounting,
            number.omega_av,
        )
        return value_of(self.cells.get(key, {}), number.quantity)


def value_of(row: Row, quantity: str) -> float:
    """A quantity of a cell; "column rank" is the entry of that rank, 1 = first. NaN where there is none."""
    column, _, rank = quantity.partition(" ")
    value = row.get(column)
    if rank and value is not None:
        value = value[int(rank) - 1] if int(rank) <= len(value) else None
    return np.nan if value is None else float(value)


def ledger_rows(book: Book, *, swept: Iterable[Row] = ()) -> list[Row]:
    """One row a published number (rows of ``ledger``). swept: further cells in which the nearest is looked for."""
    every = [*book.cells.values(), *swept]
    return [{"place": i} | _ledger_row(number, book, every) for i, number in enumerate(PUBLISHED)]


def _ledger_row(number: Published, book: Book, every: list[Row]) -> Row:
    ours = book.value(number)
    nearest, cell = _nearest(number, every)
    literal = book.value(number, variant=PAPER_LITERAL, form=names.FIXED, accounting=names.PAPER)
    return {
        "key": number.key,
        "scenario": number.scenario,
        "policy": number.policy,
        "quantity": number.quantity,
        "unit": number.unit,
        "published": number.value,
        "ours": ours,
        "ratio": ours / number.value,
        "paper_literal": literal,
        **{a: book.value(number, accounting=a) for a in names.ACCOUNTINGS},
        "nearest": nearest,
        "nearest_cell": cell,
        "nearest_ratio": nearest / number.value,
        "verdict": verdict(ours, number.value),
        "nearest_verdict": verdict(nearest, number.value),
        "note": number.note,
    }


def _nearest(number: Published, every: list[Row]) -> tuple[float, str]:
    """Of all cells the value nearest to the printed one, and where it stands."""
    best, where = np.nan, ""
    for row in every:
        if row["scenario"] != number.scenario or row["omega_av"] != number.omega_av:
            continue
        value = value_of(row, number.quantity)
        if not np.isnan(value) and not abs(value - number.value) >= abs(best - number.value):
            best, where = value, cell_name(row)
    return best, where


def cell_name(row: Row) -> str:
    """Variant, form and accounting of a cell."""
    return f"{row['variant']}, {row['form']}, {row['accounting']}"


def closest_rows(every: Iterable[Row]) -> list[Row]:
    """Of each scenario the one cell in which most printed numbers come out together (rows of ``closest``).

    Table 1, vehicle by vehicle, is left out: it would outvote the rest. Of equals the one with the smallest median
    of |ln(ours / published)|.
    """
    cells: dict[tuple[str, str], dict[float, Row]] = {}
    for row in every:
        cells.setdefault((row["scenario"], cell_name(row)), {})[row["omega_av"]] = row
    best: dict[str, Row] = {}
    for (scenario, name), by_weight in cells.items():
        row = _match(scenario, name, by_weight)
        known = best.get(scenario)
        if known is None or (row["near"], -row["median_log"]) > (known["near"], -known["median_log"]):
            best[scenario] = row
    return list(best.values())


def _match(scenario: str, name: str, by_weight: dict[float, Row]) -> Row:
    """How many of a scenario's numbers on benchmark and local optimum one cell gives."""
    numbers = [n for n in PUBLISHED if n.scenario == scenario and n.omega_given is None and " " not in n.quantity]
    ratios = np.array([value_of(by_weight.get(n.omega_av, {}), n.quantity) / n.value for n in numbers])
    off = np.abs(ratios - 1.0)
    known = ratios[np.isfinite(ratios) & (ratios > 0.0)]
    return {
        "scenario": scenario,
        "cell": name,
        "numbers": len(numbers),
        "reproduced": int((off <= _REPRODUCED_WITHIN).sum()),
        "near": int((off <= _NEAR_WITHIN).sum()),
        "median_log": float(np.median(np.abs(np.log(known)))) if known.size == len(numbers) else np.inf,
    }


def verdict(ours: float, published: float) -> str:
    """How near a number is to the published one: within 1 %, within 10 %, farther off, or not there."""
    if np.isnan(ours):
        return NO_PLAN
    off = abs(ours / published - 1.0)
    return REPRODUCED if off <= _REPRODUCED_WITHIN else NEAR if off <= _NEAR_WITHIN else NOT_REPRODUCED
