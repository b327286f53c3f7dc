"""The page of one event: rows and arrays in, HTML out.

When a policy that chooses its start goes, where, and why: in words, beside that policy without the choice.
"""

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from markupsafe import Markup

from highd_lc.reporting import event_rows, html, labels
from highd_lc.reporting.event import EventReport, FloatArray, PredictionTrace, Row
from highd_lc.reporting.follower_words import LOSS_COLUMNS
from highd_lc.reporting.payload import event_payload
from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS, UNITS
from highd_lc.vocab.policy import CHOOSING_START, PAIRS, POLICIES


def start_sentences(report: EventReport) -> list[str]:
    """A sentence or two for each policy that waits or takes another gap; one for all others, if there are some.

    Accounting: the primary one. Empty if no start was chosen in this event.
    """
    planned = [q for q in CHOOSING_START if _known(report, q)]
    moved = [q for q in planned if _differs(report.plan(q) or {})]
    found = [_sentence(report, policy) for policy in moved]
    if len(moved) < len(planned):
        rest = "; ".join(labels.POLICIES[q].label for q in planned if q not in moved)
        found.append(f"{rest}: no other start and no other gap is better than the recorded ones.")
    return found


def _known(report: EventReport, policy: str) -> bool:
    losses = [report.loss(q) for q in (policy, POLICIES[policy].without_choice)]
    return all(loss is not None and not html.is_missing(loss["loss_total"]) for loss in losses)


def _differs(plan: Row) -> bool:
    return bool(plan["delay_s"] > 0.0 or plan["gap"] != names.RECORDED_GAP)


def _sentence(report: EventReport, policy: str) -> str:
    plan, now = report.plan(policy) or {}, report.loss(policy) or {}
    before = report.loss(POLICIES[policy].without_choice) or {}
    wait = f"waits {html.number(plan['delay_s'], 1)} s" if plan["delay_s"] > 0.0 else "starts at once"
    return (
        f"{labels.POLICIES[policy].label}: the AV {wait} and goes into {_gap(plan['gap'])}. "
        f"{_change('The AV', now['loss_av'], before['loss_av'])}; "
        f"{_change('the followers together', now['loss_hv'], before['loss_hv'])} "
        f"({_each(now['loss_hv_each'], before['loss_hv_each'])}). "
        f"Strongest braking of a follower: {_both(now, before, 'peak_follower_decel', 1)} m/s²; smallest gap: "
        f"{_both(now, before, 'min_gap_m', 1)} m{_alongside(now)}; "
        f"total loss: {_both(now, before, 'loss_total', 2)}."
    )


def _gap(name: str) -> str:
    if name == names.RECORDED_GAP:
        return labels.gap(name)
    return f"the gap {labels.gap(name)}"


def _change(who: str, now: float, before: float) -> str:
    """Who pays or saves how much loss; ties to the digits shown are said as such."""
    difference = round(now - before, 2)
    if difference == 0.0:
        return f"{who}: no change"
    verb = ("pays", "saves") if who.endswith("AV") else ("pay", "save")
    return f"{who} {verb[difference < 0.0]} {html.number(abs(difference), 2)} of loss"


def _alongside(now: Row) -> str:
    return " (negative: alongside at the crossing, apart only sideways)" if now["min_gap_m"] < 0.0 else ""


def _each(now: Any, before: Any) -> str:
    changes = (
        f"HV {i} {one - other:+.2f}" for i, (one, other) in enumerate(zip(now, before, strict=True), start=1)
    )
    return ", ".join(changes).replace("-", "−")


def _both(now: Row, before: Row, name: str, digits: int) -> str:
    return f"{html.number(now[name], digits)} instead of {html.number(before[name], digits)}"


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


def failed_page(event_id: str, why: str, links: Links) -> str:
    """The page of an event that cannot be shown. why: what went wrong."""
    context = {"id": event_id, "root": "../", "here": "", "why": why}
    return html.render("failed.html", context | {"previous": links.previous, "next": links.next})


def _context(report: EventReport, *, raw: bool) -> dict[str, Any]:
    return {
        "id": report.event_id,
        "root": "../",
        "here": "",
        "primary": names.PRIMARY_ACCOUNTING,
        "lead": _lead(report),
        "notices": _notices(report),
        "facts": _facts(report),
        "starts": start_sentences(report),
        "predicted": prediction_rows(report.prediction),
        "losses": event_rows.per_accounting(report.losses, partial(_losses, report)),
        "weights": event_rows.weights(report),
        "recorded": model_error(report),
        "surface": report.surface is not None,
        "plans": event_rows.per_accounting(report.plans, partial(_plans, report)),
        "margins": event_rows.per_accounting(report.plans, partial(_margins, report)),
        "parameters": [(name, UNITS[name]) for name in PARAMETERS],
        "fits": [event_rows.fit_row(row, report) for row in report.fits],
        "tracking": event_rows.tracking_bodies(map(event_rows.tracking_row, event_rows.ordered(report.tracking))),
        "tracks_drawn": any(trace.lateral.size for trace in report.track_traces),
        "provenance": report.provenance,
        "payload": event_payload(report, raw=raw),
    }


def _losses(report: EventReport, rows: list[Row]) -> Markup:
    return event_rows.loss_body(event_rows.loss_rows(report, rows))


def _plans(report: EventReport, rows: list[Row]) -> dict[str, Markup]:
    shown = event_rows.plan_rows(report, rows)
    return {"plan": event_rows.plan_body(shown), "safety": event_rows.safety_body(shown)}


def _margins(report: EventReport, rows: list[Row]) -> dict[str, Any]:
    margins = event_rows.margins(rows)
    return {**margins, "rows": event_rows.margin_body(margins["rows"])}


def _lead(report: EventReport) -> str:
    event = report.event
    count = report.n_followers
    followers = "one follower" if count == 1 else f"{count} followers"
    kind, duration = str(event["ego_class"]).lower(), html.number(event["duration_s"], 1)
    lead = (
        f"A {kind} changes to the {event['direction']} in {duration} s in front of {followers} on the target "
        f"lane. {'An automated vehicle (AV) is planned in its place; ' if report.plans else ''}{_numbered(count)}."
    )
    if html.is_missing(event["leader_leaves_s"]):
        return lead
    after = html.number(event["leader_leaves_s"], 1)
    count = len(event["later_leader_ids"])
    next_one = "the next vehicle ahead leads from then on" if count else "nobody in view leads from then on"
    return f"{lead} The leader on that lane leaves it {after} s after the start; {next_one}."


def _numbered(count: int) -> str:
    if count == 1:
        return "HV 1 is the follower"
    return f"HV 1 {'and' if count == 2 else 'to'} HV {count} are the followers, nearest first"


def _notices(report: EventReport) -> list[str]:
    if not report.plans:
        return ["This event could not be planned; the run lists why. The recorded motion alone is shown."]
    infeasible = [row for row in report.plans if event_rows.is_infeasible(row)]
    alike: dict[str, list[str]] = {}
    for policy, rows in event_rows.by_policy(infeasible).items():
        alike.setdefault(_why_infeasible(policy, rows), []).append(labels.look(policy).label)
    return [f"{'; '.join(policies)}: {why}" for why, policies in alike.items()]


def _why_infeasible(policy: str, rows: list[Row]) -> str:
    where = ", ".join(labels.ACCOUNTING_NAMES[row["accounting"]].lower() for row in rows)
    if policy not in POLICIES:
        return f"no plan ({rows[0]['reason']})."
    if all(row["status"] == names.INFEASIBLE_AT_START for row in rows):
        return f"vehicles overlap already at the start, so there is no plan (accounting: {where})."
    rejected = event_rows.sorted_counts(rows[0]["rejected_by"])
    why = ", ".join(f"{event_rows.constraint(name)} {count}" for name, count in rejected)
    return (
        f"none of {rows[0]['candidates']} candidates meets all constraints (accounting: {where})"
        f"{'. Rejected by: ' + why if why else ''}. The table of margins below tells how close they came."
    )


def _facts(report: EventReport) -> list[tuple[str, str]]:
    event = report.event
    facts = [
        ("Class, direction", f"{event['ego_class']}, {event['direction']}"),
        ("Duration", f"{html.number(event['duration_s'], 1)} s"),
        ("Lateral shift D", f"{html.number(event['lateral_shift_m'], 1)} m"),
        ("Speed at start", f"{html.number(report.v0, 1)} m/s"),
        ("Leader on target lane", _leader(event)),
        ("Followers on target lane", str(report.n_followers)),
    ]
    gains = [(form, report.gain(form)) for form, (_, local) in PAIRS.items() if report.plan(local) is not None]
    return facts + [(f"Gain, {labels.FORMS[form].lower()}", html.percent(value)) for form, value in gains]


def _leader(event: Row) -> str:
    """Where the target leader is at the start, and whether it leaves; one decimal, as all recorded motion here."""
    gap, leaves = event["gap_ahead_m"], event["leader_leaves_s"]
    if html.is_missing(gap):
        return "none"
    ahead = f"{html.number(gap, 1)} m ahead"
    return ahead if html.is_missing(leaves) else f"{ahead}, leaves it after {html.number(leaves, 1)} s"


def model_error(report: EventReport) -> dict[str, Any] | None:
    """Recorded against simulated followers of the human, beside the local optimum's effect over the same samples.

    None where no follower is filmed behind the recorded ego. effect: None where either plan is missing.
    """
    human = report.loss(names.HUMAN)
    if human is None or any(html.is_missing(human[column]) for column in LOSS_COLUMNS):
        return None
    simulated, recorded = (human[column] for column in LOSS_COLUMNS)
    local, benchmark = (_seen(report, policy) for policy in (names.LOCAL_OPTIMUM, names.BENCHMARK))
    effect = local - benchmark
    return {
        "recorded": recorded,
        "simulated": simulated,
        "difference": simulated - recorded,
        "effect": None if html.is_missing(effect) else effect,
    }


def _seen(report: EventReport, policy: str) -> float:
    """Loss of a policy's followers over the samples in which they are filmed; NaN without a plan."""
    row = report.loss(policy)
    return float("nan") if row is None else float(row[LOSS_COLUMNS[0]])


def prediction_rows(trace: PredictionTrace | None) -> list[tuple[str, float, float, float]]:
    """Of each follower model: its label, how long it can be compared [s], its last error and RMSE [m/s]."""
    return [] if trace is None else [_prediction_row(trace, m, v) for m, v in trace.models.items()]


def _prediction_row(trace: PredictionTrace, model: str, speed: FloatArray) -> tuple[str, float, float, float]:
    known = np.isfinite(speed) & np.isfinite(trace.recorded)
    plans = " (plans)" if model == trace.default else ""
    label = labels.follower_model(model) + plans
    if not known.any():
        return label, np.nan, np.nan, np.nan
    error = (speed - trace.recorded)[known]
    return label, float(trace.t[known][-1]), float(error[-1]), float(np.sqrt(np.mean(error**2)))
