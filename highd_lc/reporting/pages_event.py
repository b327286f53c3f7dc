"""The page of one event: rows and arrays in, HTML out."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

from highd_lc.reporting import html, labels
from highd_lc.reporting.event import PAIRS, EventReport, Row
from highd_lc.reporting.payload import event_payload
from highd_lc.vocab import names
from highd_lc.vocab.lcm_parameters import PARAMETERS, UNITS

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
_PLAN_CELLS: Final = (("T", 1), ("x_final", 1), ("v_end", 2), ("min_clearance_m", 2))
_SAFETY_CELLS: Final = (
    ("min_gap_m", 2),
    ("min_time_headway_s", 2),
    ("min_ttc_s", 2),
    ("max_drac", 2),
    ("peak_follower_decel", 2),
)
_TRACKING_CELLS: Final = (
    ("rmse_lateral_m", 4),
    ("max_lateral_m", 4),
    ("rmse_longitudinal_m", 4),
    ("rmse_heading_rad", 5),
    ("max_slack", 4),
    ("qp_failures", 0),
    ("loss_av_planned", 3),
    ("loss_av_tracked", 3),
)


@dataclass(frozen=True)
class Links:
    """What an event's page links to: its neighbours' ids, and the pictures beside it."""

    previous: str | None = None
    next: str | None = None
    png: bool = False
    vector: tuple[str, ...] = ()


def event_page(report: EventReport, links: Links, *, raw: bool = False) -> str:
    """The self-contained page of an event. raw: recorded motion at full resolution, not to be shared."""
    return html.render("event.html", {**_context(report, raw=raw), **vars(links), "raw": raw})


def _context(report: EventReport, *, raw: bool) -> dict[str, Any]:
    return {
        "id": report.event_id,
        "root": "../",
        "here": "",
        "primary": names.PRIMARY_ACCOUNTING,
        "lead": _lead(report),
        "notices": _notices(report),
        "facts": _facts(report),
        "losses": _per_accounting(report.losses, lambda a: _loss_rows(report, a)),
        "weights": _weights(report),
        "recorded": _model_error(report),
        "surface": report.surface is not None,
        "plans": _per_accounting(report.plans, lambda a: _plan_rows(report, a)),
        "margins": _per_accounting(report.plans, lambda a: _margins(report, a)),
        "parameters": [(name, UNITS[name]) for name in PARAMETERS],
        "fits": [_fit(row, report) for row in report.fits],
        "tracking": [_tracking(row) for row in report.tracking],
        "tracks_drawn": bool(report.track_traces),
        "provenance": report.provenance,
        "payload": event_payload(report, raw=raw),
    }


def _lead(report: EventReport) -> str:
    event = report.event
    count = report.n_followers
    followers = "one follower" if count == 1 else f"{count} followers"
    kind, duration = str(event["ego_class"]).lower(), html.number(event["duration_s"], 1)
    return (
        f"A {kind} changes to the {event['direction']} in {duration} s in front of {followers} on the target lane."
    )


def _notices(report: EventReport) -> list[str]:
    infeasible = [row for row in report.plans if _is_infeasible(row)]
    return [_infeasible_notice(policy, rows) for policy, rows in _by_policy(infeasible).items()]


def _infeasible_notice(policy: str, rows: list[Row]) -> str:
    where = ", ".join(labels.ACCOUNTING_NAMES[row["accounting"]].lower() for row in rows)
    label = labels.POLICIES[policy].label
    if all(row["status"] == names.INFEASIBLE_AT_START for row in rows):
        return f"{label}: vehicles overlap already at the start, so there is no plan (accounting: {where})."
    rejected = _sorted_counts(rows[0]["rejected_by"])
    why = ", ".join(f"{constraint(name)} rejects {count}" for name, count in rejected)
    return (
        f"{label}: none of {rows[0]['candidates']} candidates meets all constraints (accounting: {where})"
        f"{'. ' + why if why else ''}. The table of margins below tells how close they came."
    )


def _facts(report: EventReport) -> list[tuple[str, str]]:
    event = report.event
    facts = [
        ("Class, direction", f"{event['ego_class']}, {event['direction']}"),
        ("Duration", f"{html.number(event['duration_s'], 1)} s"),
        ("Lateral shift D", f"{html.number(event['lateral_shift_m'], 1)} m"),
        ("Speed at start", f"{html.number(report.v0, 1)} m/s"),
        ("Followers on target lane", str(report.n_followers)),
    ]
    gains = [(form, report.gain(form)) for form, (local, _) in PAIRS.items() if report.plan(local) is not None]
    facts += [(f"Gain, {labels.FORMS[form].lower()}", html.percent(value)) for form, value in gains]
    return facts + [(labels.POLICIES[q].label, text) for q in names.START_POLICIES if (text := _start(report, q))]


def _start(report: EventReport, policy: str) -> str:
    """When a policy starts, where it goes and what that changes; empty without a plan."""
    plan, loss = report.plan(policy), report.loss(policy)
    contained = report.loss(policy.removesuffix("_start"))
    if plan is None or loss is None or contained is None or html.is_missing(loss["loss_total"]):
        return ""
    totals = " instead of ".join(html.number(row["loss_total"], 2) for row in (loss, contained))
    return f"waits {html.number(plan['delay_s'], 1)} s, {labels.gap(plan['gap'])}; total loss {totals}"


def _per_accounting(rows: Iterable[Row], make: Any) -> dict[str, Any]:
    present = {row["accounting"] for row in rows}
    return {accounting: make(accounting) for accounting in names.ACCOUNTINGS if accounting in present}


def _loss_rows(report: EventReport, accounting: str) -> list[dict[str, Any]]:
    rows = [row for row in _ordered(report.losses) if row["accounting"] == accounting]
    known = [_halves(row) for row in rows if not html.is_missing(row["loss_total"])]
    longest = max((sum(halves) for halves in known), default=0.0)
    return [_loss_row(report, row, longest) for row in rows]


def _halves(row: Row) -> list[float]:
    return [0.0 if html.is_missing(row[name]) else 0.5 * float(row[name]) for _, name in _BARS]


def _loss_row(report: EventReport, row: Row, longest: float) -> dict[str, Any]:
    missing = html.is_missing(row["loss_total"])
    plan = report.plan(row["policy"], row["accounting"])
    each = [] if row["loss_hv_each"] is None else list(row["loss_hv_each"])
    padded = each + [None] * (report.n_followers - len(each))
    bars = (
        []
        if missing or not longest
        else [(kind, round(100 * half / longest, 2)) for (kind, _), half in zip(_BARS, _halves(row), strict=True)]
    )
    return {
        "policy": row["policy"],
        "label": labels.POLICIES[row["policy"]].label,
        "status": labels.STATUSES[plan["status"]] if plan else "",
        "cells": [row[name] for name in LOSS_COLUMNS],
        "each": padded,
        "bars": bars,
    }


def _weights(report: EventReport) -> list[float]:
    weights = next((row["follower_weights"] for row in report.losses if _length(row["follower_weights"])), None)
    return [None] * report.n_followers if weights is None else list(weights)


def _length(value: Any) -> int:
    return 0 if value is None else len(value)


def _model_error(report: EventReport) -> dict[str, Any] | None:
    human = report.loss(names.HUMAN)
    if human is None or html.is_missing(human["loss_hv_recorded"]) or not human["recorded_n_samples"]:
        return None
    local, benchmark = report.loss(names.LOCAL_OPTIMUM), report.loss(names.BENCHMARK)
    effect = None if local is None or benchmark is None else local["loss_hv"] - benchmark["loss_hv"]
    return {
        "n": human["recorded_n_samples"],
        "recorded": human["loss_hv_recorded"],
        "simulated": human["loss_hv_simulated"],
        "difference": human["loss_hv_simulated"] - human["loss_hv_recorded"],
        "effect": effect,
    }


def _plan_rows(report: EventReport, accounting: str) -> list[dict[str, Any]]:
    rows = [row for row in _ordered(report.plans) if row["accounting"] == accounting]
    return [_plan_row(row, report.loss(row["policy"], accounting) or {}) for row in rows]


def _plan_row(row: Row, loss: Row) -> dict[str, Any]:
    return {
        "policy": row["policy"],
        "label": labels.POLICIES[row["policy"]].label,
        "status": labels.STATUSES[row["status"]],
        "infeasible": _is_infeasible(row),
        "cells": [(row[name], digits) for name, digits in _PLAN_CELLS],
        "safety": [(loss.get(name), digits) for name, digits in _SAFETY_CELLS],
        "remarks": "; ".join(_remarks(row)),
    }


def _remarks(row: Row) -> list[str]:
    remarks = []
    if _length(row["violations"]):
        remarks.append("violates " + ", ".join(constraint(name) for name in row["violations"]))
    if _length(row["at_bound"]):
        remarks.append("on a bound of the search: " + ", ".join(row["at_bound"]))
    if row["contact_after_T"] is True:
        remarks.append("contact after T")
    return remarks


def _margins(report: EventReport, accounting: str) -> dict[str, Any]:
    rows = [row for row in _ordered(report.plans) if row["accounting"] == accounting]
    with_margins = [row for row in rows if _length(row["margins"])]
    counted = {form: row for form, (local, _) in PAIRS.items() for row in rows if row["policy"] == local}
    rejected = [dict(row["rejected_by"] or {}) for row in counted.values()]
    found = sorted({name for row in with_margins for name in row["margins"]} | {n for r in rejected for n in r})
    return {
        "policies": [labels.short_policy(row["policy"]) for row in with_margins],
        "forms": [labels.FORMS[form].lower() for form in counted],
        "rows": [
            {
                "name": constraint(name),
                "unit": _unit(name),
                "margins": [row["margins"].get(name) for row in with_margins],
                "rejected": [counts.get(name) for counts in rejected],
            }
            for name in found
        ],
    }


_CONSTRAINT_UNITS: Final = {"speed": "m/s", "acceleration": "m/s²", "jerk": "m/s³", "clearance": "m"}


def _unit(name: str) -> str:
    return _CONSTRAINT_UNITS.get(name.split("_")[0], "")


def constraint(name: str) -> str:
    """A constraint's name as a reader says it."""
    return name.replace("_", " ")


def _sorted_counts(counts: Row | None) -> list[tuple[str, int]]:
    return sorted(((name, count) for name, count in (counts or {}).items() if count), key=lambda item: -item[1])


def _fit(row: Row, report: EventReport) -> dict[str, Any]:
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
    }


def _tracking(row: Row) -> dict[str, Any]:
    return {
        "policy": row["policy"],
        "label": labels.POLICIES[row["policy"]].label,
        "plant": row["plant"].replace("_", " "),
        "status": row["status"],
        "cells": [(row[name], digits) for name, digits in _TRACKING_CELLS],
    }


def _is_infeasible(row: Row) -> bool:
    return row["status"] in (names.INFEASIBLE, names.INFEASIBLE_AT_START)


def _ordered(rows: Iterable[Row]) -> list[Row]:
    return sorted(rows, key=lambda row: names.POLICIES.index(row["policy"]))


def _by_policy(rows: Iterable[Row]) -> dict[str, list[Row]]:
    groups: dict[str, list[Row]] = {}
    for row in _ordered(rows):
        groups.setdefault(row["policy"], []).append(row)
    return groups
