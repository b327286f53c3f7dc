"""The ledger: each published number beside ours, under every accounting and in the cell nearest to it."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from highd_lc.algorithms.scenario_cells import DEFAULT, PAPER_LITERAL
from highd_lc.algorithms.scenario_printed import KEY as PRINTED_STATE
from highd_lc.algorithms.scenario_printed import variant_of
from highd_lc.vocab import names
from highd_lc.vocab.published import PUBLISHED, Published
from highd_lc.vocab.scenario_tables import NEAR, NO_PLAN, NOT_REPRODUCED, REPRODUCED
from highd_lc.vocab.scenarios import ScenarioSettings

Row = dict[str, Any]
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
        if scenario == PRINTED_STATE:
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
