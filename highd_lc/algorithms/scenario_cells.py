"""Every cell that is looked at: situations under named variants of the options, forms, accountings, weights."""

import itertools
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Final

from highd_lc.algorithms.platoon import Platoon
from highd_lc.algorithms.scenario import situations
from highd_lc.algorithms.scenario_run import (
    Cell,
    Planned,
    drive_plan,
    no_lane_change,
    plan_situation,
    platoon_loss,
    traffic_columns,
)
from highd_lc.vocab import names
from highd_lc.vocab.scenarios import Changes, ScenarioOptions, ScenarioSettings

Row = dict[str, Any]

DEFAULT: Final = "default"
PAPER_LITERAL: Final = "paper_literal"
BENCHMARK_OMEGA: Final = 1.0


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


def pair_omegas(settings: ScenarioSettings) -> tuple[float, ...]:
    """Weights of the AV of benchmark and local optimum."""
    return BENCHMARK_OMEGA, settings.loss.omega_av


def rows_of_variants(settings: ScenarioSettings, *, threads: int = 1) -> list[Row]:
    """The cells of every named variant; of the default one for every weight of the AV."""
    named = variants(settings)
    weights = {name: settings.omegas if name == DEFAULT else pair_omegas(settings) for name in named}

    def one(name: str) -> list[Row]:
        return rows_of_options(name, named[name], settings=settings, omegas=weights[name])

    with ThreadPoolExecutor(threads) as pool:
        return [row for rows in pool.map(one, named) for row in rows]


def rows_of_sweep(settings: ScenarioSettings, *, threads: int = 1) -> Iterator[list[Row]]:
    """The cells of every combination of the sweep, one combination after the other."""
    weights = pair_omegas(settings)

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
        return row | {"status": planned.status}
    outcome = drive_plan(
        planned, plan, accounting=cell.accounting, followers=len(planned.problem.packed.follower_x)
    )
    traffic = traffic_columns(outcome, unchanged, settings=settings)
    traffic["loss_hv_unchanged"] = platoon_loss(
        planned.problem, unchanged, accounting=cell.accounting, n=outcome.replay.av.n
    )
    shape = {"status": names.SOLVED, "T": plan.T, "x_final": plan.x_final, "v_end": plan.v_end}
    return row | shape | outcome.losses | traffic
