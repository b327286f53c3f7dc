"""The ledger: each published number beside ours, under every accounting and in the cell nearest to it.

Scenario 3: the printed initial state of one HighD event; the AV's speed, not printed, is a free axis.
"""

import itertools
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from highd_lc.planning import planner
from highd_lc.planning.planner import PlanningProblem
from highd_lc.planning.pool import Goal, Pool
from highd_lc.planning.replay import Replay, plan_motion, replay
from highd_lc.planning.scene import Followers, Motion, Scene
from highd_lc.planning.search import search
from highd_lc.scenarios.platoon import simulated_scene, steady_motion
from highd_lc.scenarios.run import DEFAULT, PAPER_LITERAL, judged, plan_columns
from highd_lc.scoring import charges
from highd_lc.vocab import names
from highd_lc.vocab.driver import TABLE3_MEANS
from highd_lc.vocab.published import CHANGE, COMPARISONS, LEAST, PUBLISHED, TABLE_3, Published
from highd_lc.vocab.scenarios import ScenarioOptions, ScenarioSettings
from highd_lc.vocab.sections import LossSettings
from highd_lc.vocab.settings import ValidateSettings
from highd_lc.vocab.tables.scenarios import (
    NEAR,
    NEAR_WITHIN,
    NO_FITS,
    NO_PLAN,
    NOT_REPRODUCED,
    NOT_VALID,
    REPRODUCED,
    REPRODUCED_WITHIN,
)

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
            "v_max": state.v_max,
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
    return planning.model_copy(update={"loss": LossSettings.model_validate(loss)})


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
        return {"status": names.INFEASIBLE_AT_START if start else names.INFEASIBLE, "not_valid": ""}
    plan = problem.task.quintic(int(pool.n[best]), float(pool.delta[best]), float(pool.change[best]))
    played = replay(plan_motion(plan, problem.packed), problem.packed)
    dt, n = problem.scene.dt, played.av.n
    losses = charges.cumulative_losses(played, problem.terms, dt)
    charged = charges.losses_at(losses, goal.accounting, problem.terms, n=n, dt=dt)
    row = plan_columns(plan, played.av) | {
        **{key: value for key, value in charged.items() if isinstance(value, float)},
        "hv1_v_min": float(played.v[0].min()),
        "hv_v_min": played.v.min(axis=1).tolist(),
        "min_gap_m": _smallest_gap(played, problem.scene),
    }
    return judged(row, problem.settings)


def _smallest_gap(played: Replay, scene: Scene) -> float:
    """Of HV_1 behind the AV and of the followers behind each other, bumper to bumper [m]."""
    centres = np.vstack([played.av.x, played.x])
    lengths = np.concatenate([[scene.length], scene.followers.length])
    between = centres[:-1] - centres[1:] - 0.5 * (lengths[:-1] + lengths[1:])[:, None]
    return float(between.min())


CellKey = tuple[str, str, str, str, float]
CellName = tuple[str, str, str]
"""Variant, form and accounting of a cell: both policies' plans."""


@dataclass(frozen=True)
class Book:
    """All cells, found by scenario, variant, form, accounting and weight of the AV."""

    cells: dict[CellKey, Row]
    settings: ScenarioSettings
    fits: float = np.nan

    @classmethod
    def of(cls, rows: Iterable[Row], settings: ScenarioSettings, *, fits: float = np.nan) -> "Book":
        """A book of rows of ``scenario_cells``. fits: objective of the fitted drivers, NaN without any."""
        found = {(r["scenario"], r["variant"], r["form"], r["accounting"], r["omega_av"]): r for r in rows}
        return cls(found, settings, fits)

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
        if number.scenario == TABLE_3:
            return self.fits
        rows = self.rows_behind(number, variant=variant, form=form, accounting=accounting)
        how, _, quantity = number.quantity.partition(" ")
        return compare(how, quantity, *rows) if how in COMPARISONS else value_of(rows[0], number.quantity)

    def rows_behind(
        self,
        number: Published,
        *,
        variant: str | None = None,
        form: str | None = None,
        accounting: str | None = None,
    ) -> list[Row]:
        """The cells that a number is made of: its own, or for a comparison those of both policies."""
        compared = number.quantity.partition(" ")[0] in COMPARISONS
        omegas = self.settings.weights.values() if compared else (number.omega_av,)
        cell = (
            variant or self.default_variant(number.scenario),
            form or self.settings.form,
            accounting or self.settings.accounting,
        )
        return [self.cells.get((number.scenario, *cell, omega), {}) for omega in omegas]

    @cached_property
    def cell_names(self) -> dict[str, list[CellName]]:
        """Every cell of each scenario, in its order."""
        found: dict[str, dict[CellName, None]] = {}
        for scenario, *cell, _ in self.cells:
            variant, form, accounting = (str(part) for part in cell)
            found.setdefault(scenario, {})[variant, form, accounting] = None
        return {scenario: list(cells) for scenario, cells in found.items()}


def not_valid(row: Row) -> str:
    """Why a cell says nothing; empty where it does, or has no plan."""
    return str(row.get("not_valid") or "")


def compare(how: str, quantity: str, benchmark: Row, local: Row) -> float:
    """Local optimum against benchmark: relative change [%], difference, its least and most over the followers."""
    one, other = (np.atleast_1d(values_of(row, quantity)) for row in (benchmark, local))
    if one.shape != other.shape:
        return np.nan
    if how == CHANGE:
        return float(100.0 * (other / one - 1.0).item())
    difference = other - one
    return float(difference.min() if how == LEAST else difference.max())


def values_of(row: Row, quantity: str) -> FloatArray:
    """A column's number or list of numbers; NaN where there is none."""
    value = row.get(quantity)
    return np.array(np.nan if value is None else value, dtype=np.float64)


def value_of(row: Row, quantity: str) -> float:
    """A quantity of a cell; "column rank" is the entry of that rank, 1 = first. NaN where there is none."""
    column, _, rank = quantity.partition(" ")
    value = row.get(column)
    if rank and value is not None:
        value = value[int(rank) - 1] if int(rank) <= len(value) else None
    return np.nan if value is None else float(value)


def ledger_rows(book: Book, *, swept: Iterable[Row] = ()) -> list[Row]:
    """One row a published number (rows of ``ledger``). swept: further cells in which the nearest is looked for."""
    every = Book.of([*swept, *book.cells.values()], book.settings, fits=book.fits)
    return [{"place": i} | _ledger_row(number, book, every) for i, number in enumerate(PUBLISHED)]


def _ledger_row(number: Published, book: Book, every: Book) -> Row:
    ours = book.value(number)
    nearest, cell = _nearest(number, every)
    reasons = "; ".join(dict.fromkeys(filter(None, map(not_valid, book.rows_behind(number)))))
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
        "verdict": _verdict(number, ours, reasons),
        "not_valid": reasons,
        "nearest_verdict": _verdict(number, nearest, ""),
        "note": number.note,
    }


_LAST_DIGITS = 1e-9
"""What a value must be nearer by, relative to the printed one: cells that compute alike differ in last digits."""


def _nearest(number: Published, every: Book) -> tuple[float, str]:
    """Of all valid cells the value nearest to the printed one, and where it stands; of equals the first."""
    if number.scenario == TABLE_3:
        return every.fits, ""
    best, where = np.nan, ""
    for cell in every.cell_names.get(number.scenario, ()):
        variant, form, accounting = cell
        if any(map(not_valid, every.rows_behind(number, variant=variant, form=form, accounting=accounting))):
            continue
        value = every.value(number, variant=variant, form=form, accounting=accounting)
        nearer = abs(best - number.value) - abs(value - number.value)
        if not np.isnan(value) and not nearer <= _LAST_DIGITS * abs(number.value):
            best, where = value, ", ".join(cell)
    return best, where


def _verdict(number: Published, ours: float, reasons: str) -> str:
    if reasons:
        return NOT_VALID
    if number.scenario == TABLE_3 and np.isnan(ours):
        return NO_FITS
    return verdict(ours, number.value)


def closest_rows(every: Iterable[Row]) -> list[Row]:
    """Of each scenario the one valid cell in which most printed numbers come out together (rows of ``closest``).

    Table 1, vehicle by vehicle, is left out: it would outvote the rest; so are comparisons of printed numbers.
    Of equals the one with the smallest median of |ln(ours / published)|.
    """
    cells: dict[tuple[str, str], dict[float, Row]] = {}
    for row in every:
        name = ", ".join((row["variant"], row["form"], row["accounting"]))
        # What is not valid is there, but gives no number.
        cells.setdefault((row["scenario"], name), {})[row["omega_av"]] = {} if not_valid(row) else row
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
        "reproduced": int((off <= REPRODUCED_WITHIN).sum()),
        "near": int((off <= NEAR_WITHIN).sum()),
        "median_log": float(np.median(np.abs(np.log(known)))) if known.size == len(numbers) else np.inf,
    }


def verdict(ours: float, published: float) -> str:
    """How near a number is to the published one: within 1 %, within 10 %, farther off, or not there."""
    if np.isnan(ours):
        return NO_PLAN
    off = abs(ours / published - 1.0)
    return REPRODUCED if off <= REPRODUCED_WITHIN else NEAR if off <= NEAR_WITHIN else NOT_REPRODUCED
