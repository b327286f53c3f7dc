"""When a policy that chooses its start goes, where, and why: in words, beside that policy without the choice."""

from typing import Any

from highd_lc.reporting import html, labels
from highd_lc.reporting.event import EventReport, Row
from highd_lc.vocab import names


def start_sentences(report: EventReport) -> list[str]:
    """A sentence or two for each policy that waits or takes another gap; one for all others, if there are some.

    Accounting: the primary one. Empty if no start was chosen in this event.
    """
    planned = [q for q in names.START_POLICIES + names.FREE_START_POLICIES if _known(report, q)]
    moved = [q for q in planned if _differs(report.plan(q) or {})]
    found = [_sentence(report, policy) for policy in moved]
    if len(moved) < len(planned):
        rest = "; ".join(labels.POLICIES[q].label for q in planned if q not in moved)
        found.append(f"{rest}: no other start and no other gap is better than the recorded ones.")
    return found


def contained(policy: str) -> str:
    """The policy without the choice of the start."""
    return policy.removesuffix("_start")


def _known(report: EventReport, policy: str) -> bool:
    losses = [report.loss(q) for q in (policy, contained(policy))]
    return all(loss is not None and not html.is_missing(loss["loss_total"]) for loss in losses)


def _differs(plan: Row) -> bool:
    return bool(plan["delay_s"] > 0.0 or plan["gap"] != names.RECORDED_GAP)


def _sentence(report: EventReport, policy: str) -> str:
    plan, now = report.plan(policy) or {}, report.loss(policy) or {}
    before = report.loss(contained(policy)) or {}
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
