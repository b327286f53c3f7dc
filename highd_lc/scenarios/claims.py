"""The paper's claims: directions of change, and the options under which each of them holds or fails."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.scenarios.ledger import Book, not_valid, value_of
from highd_lc.scenarios.run import DEFAULT
from highd_lc.vocab import names
from highd_lc.vocab.policy import PAIRS
from highd_lc.vocab.published import BEST_OMEGA, LOWEST_OMEGA, MOST_HELPED, printed
from highd_lc.vocab.tables.scenarios import VERDICTS

FloatArray = NDArray[np.float64]
Row = dict[str, Any]

HOLDS: Final = "holds"
FAILS: Final = "fails"
UNCHANGED: Final = "unchanged"
MISSING: Final = "no_plan"
NOT_VALID: Final = "not_valid"
_TIE: Final = 1e-3


@dataclass(frozen=True)
class Claim:
    """A direction of change that the paper states.

    change: from the cells of benchmark and local optimum, positive where the claim holds; relative changes within
    0.1 % count as none.
    """

    name: str
    statement: str
    printed: dict[str, str]
    change: Callable[[Row, Row], float]


def _falls(quantity: str) -> Callable[[Row, Row], float]:
    return lambda benchmark, local: 1.0 - float(local[quantity]) / float(benchmark[quantity])


def _rises(quantity: str) -> Callable[[Row, Row], float]:
    return lambda benchmark, local: float(local[quantity]) / float(benchmark[quantity]) - 1.0


def _accelerates(benchmark: Row, local: Row) -> float:
    return float(local["av_v_max"] / benchmark["av_v_max"] - 1.0)


def _returns(benchmark: Row, local: Row) -> float:
    """Positive if the AV first drives faster than at t_start and ends at that speed again."""
    v_start = float(local["v_start"])
    faster = float(local["av_v_max"]) / v_start - 1.0
    if faster <= 0.01:
        return 0.0
    return faster if abs(local["v_end"] / v_start - 1.0) < 0.01 else -faster


def _most_helped(benchmark: Row, local: Row) -> float:
    """Positive if no follower's lowest speed falls and one of those that are said to gain most does."""
    gained = np.asarray(local["hv_v_min"]) - np.asarray(benchmark["hv_v_min"])
    if len(gained) < MOST_HELPED[1]:
        return np.nan
    share = float(np.abs(gained).max() / local["v_start"])
    most = MOST_HELPED[0] <= int(np.argmax(gained)) + 1 <= MOST_HELPED[1]
    return share if most and gained.min() > -_TIE * local["v_start"] else -share


def _printed(quantity: str, *scenarios: str, digits: int = 2) -> dict[str, str]:
    """The printed pair of a quantity in words, by scenario."""
    return {scenario: _pair(scenario, quantity, digits=digits) for scenario in scenarios}


def _pair(scenario: str, quantity: str, *, digits: int = 2) -> str:
    return " -> ".join(f"{printed(scenario, policy, quantity):.{digits}f}" for policy in PAIRS[names.FIXED])


def _trade_printed(quantity: str) -> str:
    """From the benchmark to the local optimum of the lowest weight, scenario 1."""
    lowest = printed("1", names.LOCAL_OPTIMUM, quantity, omega=LOWEST_OMEGA)
    return f"{printed('1', names.BENCHMARK, quantity):.2f} -> {lowest:.2f}"


_PEAK: Final = printed("1", names.LOCAL_OPTIMUM, "av_v_max")

CLAIMS: Final = (
    Claim(
        "hv_loss_falls",
        "the local optimum lowers the followers' loss",
        _printed("loss_hv", "1", "3") | {"2_15": "", "2_20": ""},
        _falls("loss_hv"),
    ),
    Claim(
        "total_loss_falls",
        "the local optimum lowers the total loss",
        _printed("loss_total", "1", "2_15", "2_20", "3"),
        _falls("loss_total"),
    ),
    Claim(
        "av_loss_rises",
        "the local optimum costs the AV something",
        _printed("loss_av", "1", "3"),
        _rises("loss_av"),
    ),
    Claim(
        "travel_time_falls",
        "the local optimum lowers the added total travel time",
        {"1": f"{_pair('1', 'ttt_difference_s')} s"},
        _falls("ttt_difference_s"),
    ),
    Claim(
        "av_faster",
        "under the local optimum the AV drives faster than under the benchmark",
        {"1": f"peak {_PEAK:.2f} m/s"},
        _accelerates,
    ),
    Claim(
        "av_returns",
        "under the local optimum the AV accelerates, then returns to its speed",
        {"1": f"25 -> {_PEAK:.2f} -> 25 m/s"},
        _returns,
    ),
    Claim(
        "flow_rises",
        "flow rises",
        _printed("flow_veh_h", "2_15", "2_20", digits=3),
        _rises("flow_veh_h"),
    ),
    Claim(
        "speed_rises",
        "speed rises",
        _printed("speed_km_h", "2_15", "2_20", digits=3),
        _rises("speed_km_h"),
    ),
    Claim(
        "density_falls",
        "density falls",
        _printed("density_veh_km", "2_15", "2_20", digits=3),
        _falls("density_veh_km"),
    ),
    Claim(
        "lateral_acceleration_falls",
        "under the local optimum the lateral acceleration is smaller",
        {"1": "lateral speeds differ by 0.2 m/s"},
        _falls("av_ay_max"),
    ),
    Claim(
        "far_followers_gain",
        "followers drive faster under the local optimum, HV 5 to 10 by most (ours: their lowest speeds)",
        dict.fromkeys(("1", "2_15", "2_20"), "+1 to 5 m/s, scenario not said"),
        _most_helped,
    ),
)
"""The paper's claims on its scenarios."""


def claim_rows(book: Book) -> list[Row]:
    """One row a claim, scenario, form and accounting (rows of ``claims``)."""
    rows = [
        _claim_row(claim, scenario, form=form, accounting=accounting, book=book)
        for claim in CLAIMS
        for scenario in claim.printed
        if book.variants(scenario)
        for form in names.FORMS
        for accounting in names.ACCOUNTINGS
    ]
    # A sweep knows benchmark and local optimum only.
    weighed = {key[4] for key in book.cells if key[:2] == ("1", DEFAULT)} >= set(book.settings.omegas)
    return rows + (list(weight_rows(book)) if weighed else [])


def _claim_row(claim: Claim, scenario: str, *, form: str, accounting: str, book: Book) -> Row:
    found = {
        v: judge(claim, scenario, variant=v, form=form, accounting=accounting, book=book)
        for v in book.variants(scenario)
    }
    holds, fails, unchanged, missing, invalid = (
        [v for v, what in found.items() if what == word] for word in (HOLDS, FAILS, UNCHANGED, MISSING, NOT_VALID)
    )
    return {
        "claim": claim.name,
        "scenario": scenario,
        "form": form,
        "accounting": accounting,
        "statement": claim.statement,
        "printed": claim.printed[scenario],
        "default_verdict": found.get(book.default_variant(scenario), MISSING),
        "cells": len(holds) + len(fails) + len(unchanged),
        "holds": len(holds),
        "fails": len(fails),
        "unchanged": len(unchanged),
        "holds_under": holds,
        "fails_under": fails + unchanged,
        "no_plan_under": missing,
        "not_valid_under": invalid,
    }


def judge(claim: Claim, scenario: str, *, variant: str, form: str, accounting: str, book: Book) -> str:
    """Whether a claim holds, fails or nothing changes in a cell; no_plan where one of the plans is missing.

    not_valid where one of them collides or sits on a bound: it counts for no claim.
    """
    pair: Sequence[Row] = [
        book.cells[scenario, variant, form, accounting, omega] for omega in book.settings.weights.values()
    ]
    if any(row["status"] != names.SOLVED for row in pair):
        return MISSING
    if any(not_valid(row) for row in pair):
        return NOT_VALID
    change = claim.change(*pair)
    if np.isnan(change):
        return MISSING
    return UNCHANGED if abs(change) <= _TIE else HOLDS if change > 0.0 else FAILS


def weight_rows(book: Book) -> Iterator[Row]:
    """The claims on omega_AV in scenario 1, by form and accounting: where the total is lowest, who gains."""
    for form in names.FORMS:
        for accounting in names.ACCOUNTINGS:
            av, hv = (_over_weights(book, q, form=form, accounting=accounting) for q in ("loss_av", "loss_hv"))
            total = av + hv
            invalid = any(not_valid(row) for row in _cells_over_weights(book, form=form, accounting=accounting))
            cell = {"scenario": "1", "form": form, "accounting": accounting}
            yield cell | _verdict_row(
                "total_lowest_at_half",
                "the total loss is lowest at omega_AV = 0.5 to 0.6 (by construction: half of it is the objective)",
                printed=f"at {BEST_OMEGA[0]} to {BEST_OMEGA[1]}",
                verdict=NOT_VALID if invalid else _lowest_at_half(total, book),
            )
            yield cell | _verdict_row(
                "weights_trade",
                "with falling omega_AV the AV's loss rises and the followers' falls",
                printed=", ".join(_trade_printed(quantity) for quantity in ("loss_av", "loss_hv")),
                verdict=NOT_VALID if invalid else _trade(av, hv),
            )


def _cells_over_weights(book: Book, *, form: str, accounting: str) -> list[Row]:
    return [book.cells.get(("1", DEFAULT, form, accounting, omega), {}) for omega in book.settings.omegas]


def _over_weights(book: Book, quantity: str, *, form: str, accounting: str) -> FloatArray:
    cells = _cells_over_weights(book, form=form, accounting=accounting)
    return np.array([value_of(cell, quantity) for cell in cells])


def _lowest_at_half(total: FloatArray, book: Book) -> str:
    """Holds if the claimed weights reach the lowest total and the two ends do not."""
    if not np.isfinite(total).all():
        return MISSING
    omegas = np.array(book.settings.omegas)
    best = total <= total.min() * (1.0 + _TIE)
    if best.all():
        return UNCHANGED
    claimed = (omegas >= BEST_OMEGA[0] - 1e-9) & (omegas <= BEST_OMEGA[1] + 1e-9)
    return HOLDS if best[claimed].any() else FAILS


def _trade(av: FloatArray, hv: FloatArray) -> str:
    """From the lowest weight to the highest the AV's loss may only fall, the followers' only rise."""
    if not (np.isfinite(av).all() and np.isfinite(hv).all()):
        return MISSING
    if np.ptp(av) <= _TIE * av.max():
        return UNCHANGED
    monotone = (np.diff(av) <= _TIE * av.max()).all() and (np.diff(hv) >= -_TIE * hv.max()).all()
    return HOLDS if monotone else FAILS


def _verdict_row(claim: str, statement: str, *, printed: str, verdict: str) -> Row:
    """A claim that one cell decides, the default one."""
    listed = {word: [DEFAULT] if verdict == word else [] for word in VERDICTS}
    return {
        "claim": claim,
        "statement": statement,
        "printed": printed,
        "default_verdict": verdict,
        "cells": int(verdict not in (MISSING, NOT_VALID)),
        **{word: len(listed[word]) for word in (HOLDS, FAILS, UNCHANGED)},
        "holds_under": listed[HOLDS],
        "fails_under": listed[FAILS] + listed[UNCHANGED],
        "no_plan_under": listed[MISSING],
        "not_valid_under": listed[NOT_VALID],
    }
