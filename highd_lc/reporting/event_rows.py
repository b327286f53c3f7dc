"""Rows of the tables on an event's page: rows of artefacts in, cells and words out.

Bodies of these tables: lines of HTML, each body one string. A page has a hundred such lines: written by a
template, value by value, they take three times as long.
"""

from collections.abc import Callable, Iterable, Mapping
from functools import cache
from typing import Any, Final

import numpy as np
from markupsafe import Markup, escape

from highd_lc.reporting import html, labels
from highd_lc.reporting.event import EventReport, Row, driver_says
from highd_lc.reporting.html import bars, cells, number, policy_head
from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS
from highd_lc.vocab.policy import CHOOSING_START, PAIRS

LOSS_COLUMNS: Final = (
    "av_comfort",
    "av_efficiency",
    "loss_av",
    "hv_comfort",
    "hv_efficiency",
    "loss_hv",
    "loss_total",
)
_BARS: Final = (
    ("av-comfort", "av_comfort"),
    ("av-efficiency", "av_efficiency"),
    ("hv-comfort", "hv_comfort"),
    ("hv-efficiency", "hv_efficiency"),
)
_PLACES: Final = {policy: place for place, policy in enumerate(names.POLICIES)}
_UNKNOWNS: Final = frozenset(("T", "x_final", "v_end", "delay_s"))
_PLAN_CELLS: Final = (("T", 1), ("x_final", 1), ("v_end", 2), ("min_clearance_m", 2))
_SAFETY_CELLS: Final = (
    ("min_gap_m", 2),
    ("min_time_headway_s", 2),
    ("min_ttc_s", 2),
    ("max_drac", 2),
    ("peak_follower_decel", 2),
)
_ERROR_CELLS: Final = (
    ("rmse_lateral_m", 4),
    ("max_lateral_m", 4),
    ("rmse_longitudinal_m", 4),
    ("rmse_heading_rad", 5),
    ("max_slack", 4),
    ("qp_failures", 0),
)
_JUDGED_CELLS: Final = (
    ("loss_av_planned", 3),
    ("loss_av_tracked", 3),
    ("loss_hv_planned", 3),
    ("loss_hv_tracked", 3),
    ("min_clearance_planned_m", 2),
    ("min_clearance_tracked_m", 2),
)


def per_accounting(rows: Iterable[Row], make: Callable[[list[Row]], Any]) -> dict[str, Any]:
    """What ``make`` makes of the rows of each accounting, ordered by policy."""
    groups: dict[str, list[Row]] = {}
    for row in ordered(rows):
        groups.setdefault(row["accounting"], []).append(row)
    return {accounting: make(groups[accounting]) for accounting in names.ACCOUNTINGS if accounting in groups}


def loss_rows(report: EventReport, rows: list[Row]) -> list[dict[str, Any]]:
    """The table of losses under an accounting: cells, bars, and each follower's loss."""
    halves = [None if html.is_missing(row["loss_total"]) else _halves(row) for row in rows]
    longest = max((sum(known) for known in halves if known is not None), default=0.0)
    return [_loss_row(report, row, known, longest) for row, known in zip(rows, halves, strict=True)]


def _halves(row: Row) -> list[float]:
    return [0.0 if html.is_missing(row[name]) else 0.5 * float(row[name]) for _, name in _BARS]


def _loss_row(report: EventReport, row: Row, halves: list[float] | None, longest: float) -> dict[str, Any]:
    plan = report.plan(row["policy"], row["accounting"])
    each = [] if row["loss_hv_each"] is None else list(row["loss_hv_each"])
    padded = each + [None] * (report.n_followers - len(each))
    bars = (
        []
        if halves is None or not longest
        else [(kind, round(100 * half / longest, 2)) for (kind, _), half in zip(_BARS, halves, strict=True)]
    )
    return {
        "policy": row["policy"],
        "label": labels.look(row["policy"]).label,
        "status": _why_none(row, plan),
        "cells": [row[name] for name in LOSS_COLUMNS],
        "each": padded,
        "bars": bars,
    }


def _why_none(row: Row, plan: Row | None) -> str:
    """Why a policy has no loss: who drives through whom, or the status of its plan."""
    if row.get("contact"):
        return labels.through(row["contact"])
    return labels.STATUSES[plan["status"]] if plan else ""


def weights(report: EventReport) -> list[float] | list[None]:
    """Weights of the followers (equation 17), nearest first; None where no loss has them."""
    weights = next((row["follower_weights"] for row in report.losses if _length(row["follower_weights"])), None)
    return [None] * report.n_followers if weights is None else list(weights)


def _length(value: Any) -> int:
    return 0 if value is None else len(value)


def plan_rows(report: EventReport, rows: list[Row]) -> list[dict[str, Any]]:
    """The tables of plans and of safety under an accounting."""
    return [_plan_row(row, report.loss(row["policy"], row["accounting"]) or {}) for row in rows]


def _plan_row(row: Row, loss: Row) -> dict[str, Any]:
    return {
        "policy": row["policy"],
        "status": labels.STATUSES[row["status"]],
        "infeasible": is_infeasible(row),
        "cells": [(row[name], digits) for name, digits in _PLAN_CELLS],
        "safety": [(loss.get(name), digits) for name, digits in _SAFETY_CELLS],
        "remarks": "; ".join(_remarks(row)),
    }


def _remarks(row: Row) -> list[str]:
    remarks = [row["reason"]] if row.get("reason") else []
    if row["policy"] in CHOOSING_START and not is_infeasible(row):
        remarks.append(_start(row))
    if row.get("contact"):
        remarks.append(labels.through(row["contact"]))
    if _length(row["violations"]):
        remarks.append("violates " + ", ".join(constraint(name) for name in row["violations"]))
    if _length(row["at_bound"]):
        remarks += _at_bound(row["at_bound"])
    if row["contact_after_T"] is True:
        remarks.append("contact after T")
    return remarks + _fallback(row) + nearest(row)


def _fallback(row: Row) -> list[str]:
    """What the AV does in the place of a lane change that is not allowed, and why."""
    if not row.get("fallback"):
        return []
    what = "waits" if row["fallback"] == names.WAIT else "stays in its lane"
    return [f"{what}: {constraint(row['binding'])} forbids the change" if row.get("binding") else what]


def nearest(row: Row) -> list[str]:
    """The constraints of the safety profile that a plan comes near to, the nearest first, with the moment.

    For example "time gap ahead 0.02 s inside its limit at 5.3 s".
    """
    moments, margin = dict(row.get("moments") or {}), dict(row["margins"] or {})
    near = [n for n, most in _SAFETY_NEAR.items() if n in moments and margin.get(n, np.inf) <= most]
    return [
        f"{constraint(name)} {html.number(abs(margin[name]), 2)} {_unit(name)} "
        f"{'inside' if margin[name] > -_ROUNDING else 'beyond'} its limit at {html.number(moments[name], 1)} s"
        for name in sorted(near, key=lambda one: margin[one] / _SAFETY_NEAR[one])
    ]


def _start(row: Row) -> str:
    when = f"starts after {html.number(row['delay_s'], 1)} s" if row["delay_s"] > 0.0 else "starts at once"
    return f"{when}, into {'the gap ' * (row['gap'] != names.RECORDED_GAP)}{labels.gap(row['gap'])}"


def _at_bound(found: Iterable[str]) -> list[str]:
    """What stops a plan: the search's range of an unknown, or a constraint without margin."""
    searched: list[str] = []
    limiting: list[str] = []
    for name in found:
        (searched if name in _UNKNOWNS else limiting).append(name)
    remarks = [f"on a bound of the search: {', '.join(searched)}"] if searched else []
    return remarks + ([f"no margin left: {', '.join(map(constraint, limiting))}"] if limiting else [])


def margins(rows: list[Row]) -> dict[str, Any]:
    """The table of margins under an accounting: policies, forms, and a row a constraint."""
    with_margins = [row for row in rows if _length(row["margins"])]
    counted = {form: row for form, (_, local) in PAIRS.items() for row in rows if row["policy"] == local}
    rejected = [dict(row["rejected_by"] or {}) for row in counted.values()]
    bound = [binding(row) for row in with_margins]
    found = sorted({name for row in with_margins for name in row["margins"]} | {n for r in rejected for n in r})
    return {
        "policies": [labels.short_policy(row["policy"]) for row in with_margins],
        "forms": [labels.FORMS[form].lower() for form in counted],
        "rows": [
            {
                "name": constraint(name),
                "unit": _unit(name),
                "margins": [row["margins"].get(name) for row in with_margins],
                "binds": [place for place, names_ in enumerate(bound) if name in names_],
                "rejected": [counts.get(name) for counts in rejected],
            }
            for name in found
        ],
    }


def binding(row: Row) -> set[str]:
    """The constraints that shape a plan: those without margin left, or the one that forbids any. row: of plans."""
    forbids = {row["binding"]} if row.get("binding") else set()
    return forbids | {name for name in _listed(row["at_bound"]) if name not in _UNKNOWNS}


def _listed(found: Iterable[str] | None) -> list[str]:
    return [] if found is None else list(found)


_AXES: Final = {"x": "longitudinal", "y": "lateral"}
_CONSTRAINT_UNITS: Final = {
    "speed": "m/s",
    "acceleration": "m/s²",
    "jerk": "m/s³",
    "clearance": "m",
    "overtakes": "m",
    "curvature": "1/m",
    "yaw": "rad/s",
    "insertion": "m",
    "follower": "m",
    "time": "s",
    "drac": "m/s²",
}
_ROUNDING: Final = 1e-9
_SAFETY_NEAR: Final = {
    "insertion_gap": 1.0,
    "time_gap_ahead": 0.1,
    "time_gap_behind": 0.1,
    "drac_ahead": 0.5,
    "drac_behind": 0.5,
    "speed_after_T": 0.5,
    "follower_gap": 0.1,
}
"""Margins up to which a constraint of the safety profile is told beside a plan."""


def _unit(name: str) -> str:
    return _CONSTRAINT_UNITS.get(name.split("_")[0], "")


def constraint(name: str) -> str:
    """A constraint's name as a reader says it: ``clearance_target_follower_1`` is "clearance to HV 1"."""
    kind, _, rest = name.partition("_")
    if kind == "clearance":
        return f"clearance to {labels.role(rest)}"
    if kind == "contact":
        return labels.through(rest)
    if rest in _AXES:
        return f"{_AXES[rest]} {kind}"
    return labels.blocker(name)


def sorted_counts(counts: Row | None) -> list[tuple[str, int]]:
    """Constraints that rejected candidates, the strictest first."""
    return sorted(((name, count) for name, count in (counts or {}).items() if count), key=lambda item: -item[1])


def fit_row(row: Row, report: EventReport) -> dict[str, Any]:
    """A follower's row in the table of fits."""
    spread = dict(row["spread"] or {})
    bounds = set(row["at_bound"]) if _length(row["at_bound"]) else set()
    status = labels.FIT_STATUSES[row["status"]]
    return {
        "rank": row["follower"],
        "status": f"{status} ({row['reason'].replace('_', ' ')})" if row["reason"] else status,
        "samples": row["n_samples"],
        "parameters": [(row[name], spread.get(name), name in bounds) for name in PARAMETERS],
        "L_replay": row["L_replay"],
        "objective": row["objective"],
        "rmse_spacing": row["rmse_spacing_m"],
        "rmse_speed": row["rmse_speed_mps"],
        "drawn": row["follower"] in report.fit_traces,
        "says": driver_says(row, report.identified),
    }


def tracking_row(row: Row) -> dict[str, Any]:
    """A row of the table of tracking."""
    return {
        "policy": row["policy"],
        "plant": labels.PLANTS[row["plant"]],
        "status": row["status"],
        "errors": [(row[name], digits) for name, digits in _ERROR_CELLS],
        "judged": [(row[name], digits) for name, digits in _JUDGED_CELLS],
        "violations": _violations(row["violations"]),
    }


def _violations(found: Iterable[str] | None) -> str:
    """Constraints in words; a dash where nothing was driven."""
    return "–" if found is None else ", ".join(map(constraint, found)) or "none"


def is_infeasible(row: Row) -> bool:
    """Whether a row of ``plans`` has no plan."""
    return row["status"] in (names.INFEASIBLE, names.INFEASIBLE_AT_START, names.FAULTY)


def ordered(rows: Iterable[Row]) -> list[Row]:
    """Rows in the order of ``names.POLICIES``, those of other people's planners after them."""
    return sorted(rows, key=lambda row: _PLACES.get(row["policy"], len(_PLACES)))


def by_policy(rows: Iterable[Row]) -> dict[str, list[Row]]:
    """Rows by policy, in the order of ``names.POLICIES``."""
    groups: dict[str, list[Row]] = {}
    for row in ordered(rows):
        groups.setdefault(row["policy"], []).append(row)
    return groups


Line = Mapping[str, Any]


def loss_body(rows: Iterable[Line]) -> Markup:
    """The lines of the table of losses (see ``lane_change.loss_rows``)."""
    return _joined(_loss_line, rows)


def plan_body(rows: Iterable[Line]) -> Markup:
    """The lines of the table of plans (see ``lane_change.plan_rows``)."""
    return _joined(_plan_line, rows)


def safety_body(rows: Iterable[Line]) -> Markup:
    """The lines of the table of safety (see ``lane_change.plan_rows``)."""
    return _joined(_safety_line, rows)


def margin_body(rows: Iterable[Line]) -> Markup:
    """The lines of the table of margins (see ``lane_change.margins``)."""
    return _joined(_margin_line, rows)


def tracking_bodies(rows: Iterable[Line]) -> dict[str, Markup]:
    """The lines of both tables of tracking, errors and judgement (see ``tracking_row``); none without rows."""
    known = list(rows)
    return {"errors": _joined(_error_line, known), "judged": _joined(_judged_line, known)} if known else {}


def _joined(line: Callable[[Line], str], rows: Iterable[Line]) -> Markup:
    return Markup("".join([line(row) for row in rows]))


@cache
def _word(text: str) -> str:
    """A text from data, escaped once for all pages: there are few different ones."""
    return str(escape(text))


def _loss_line(row: Line) -> str:
    head = f'<tr data-policy="{_word(row["policy"])}">{policy_head(row["policy"])}\n<td>{_composition(row)}</td>'
    return f"{head}\n{cells(row['cells'], 3)}{cells(row['each'], 3)}\n</tr>\n"


def _composition(row: Line) -> str:
    """The bars of a loss and what they show in words, or why there is none."""
    if not row["bars"]:
        return _word(row["status"])
    label = f"{_word(row['label'])}: total {number(row['cells'][6], 2)}"
    return f'<div class="bars" role="img" aria-label="{label}">{bars(row["bars"])}</div>'


def _plan_line(row: Line) -> str:
    bad = ' class="bad"' if row["infeasible"] else ""
    head = f"<tr>{policy_head(row['policy'])}<td{bad}>{_word(row['status'])}</td>"
    return f"{head}\n{cells(row['cells'])}<td>{escape(row['remarks'])}</td></tr>\n"


def _safety_line(row: Line) -> str:
    return f"<tr>{policy_head(row['policy'])}{cells(row['safety'])}</tr>\n"


def _margin_line(row: Line) -> str:
    head = f'<tr><th scope="row">{_word(row["name"])}</th><td class="unit">{_word(row["unit"])}</td>'
    margins = cells(row["margins"], 2)
    if row["binds"]:
        parts = enumerate(margins.split('<td class="n')[1:])
        margins = "".join([f'<td class="{"binding " * (k in row["binds"])}n{part}' for k, part in parts])
    return f"{head}{margins}{cells(row['rejected'], 0)}</tr>\n"


def _error_line(row: Line) -> str:
    head = f"<tr>{policy_head(row['policy'])}<td>{_word(row['plant'])}</td><td>{_word(row['status'])}</td>"
    return f"{head}\n{cells(row['errors'])}</tr>\n"


def _judged_line(row: Line) -> str:
    head = f"<tr>{policy_head(row['policy'])}<td>{_word(row['plant'])}</td>"
    return f"{head}\n{cells(row['judged'])}<td>{_word(row['violations'])}</td></tr>\n"
