"""The page of the closed loop: what comes of plans that are made anew while the AV drives."""

from collections.abc import Iterator, Sequence
from typing import Any, Final

import pandas as pd

from highd_lc.reporting import labels
from highd_lc.reporting.pages_data import Column, Section, TableView, overview_page, percentage, table_view
from highd_lc.vocab import names

PAGE: Final = "closed_loop.html"
NOTHING: Final = (
    "No event of this run was driven with plans made anew on the way (setting validate.closed_loop.events), "
    "or none could be planned."
)
_LEADERS: Final = {
    "braking": "at constant speed, after 1 s more of the braking of the last second",
    "constant_speed": "at constant speed",
    "constant_acceleration": "with the acceleration measured, for 2 s",
    "lcm": "by the LCM on a free road",
    "recorded": "as they will be: perfect foresight",
}

_CLEARANCE: Final = "clearance_"

_SUMMARY: Final = (
    Column("label", "Who drives"),
    Column("n", "Events", digits=0),
    Column("changed", "Changed lane", digits=0),
    Column("aborted", "Turned back", digits=0),
    Column("never", "Never begun", digits=0),
    Column("touching", "Events with a contact", digits=0),
    percentage("share_touching", "of all", 1),
    Column("seen_s", "Seen", "s", 1),
    Column("loss_av", "AV loss", digits=2),
    Column("loss_hv", "Followers' loss", digits=2),
    Column("regret_mean", "Regret, mean", digits=3),
    Column("regret_median", "median", digits=3),
    Column("regret_max", "largest", digits=3),
    Column("n_regret", "Events with one", digits=0),
)
_SUMMARY_CAPTION: Final = (
    "Turned back: to its lane, before the crossing. Never begun: no change was permitted in all that time. Seen: "
    "how long contacts could be seen, of the human as long as all are in view. Losses and regret are means over "
    "the events that have them."
)
_DECISIONS: Final = (
    Column("label", "Who drives"),
    Column("replans", "Decisions", digits=0),
    Column("new_plans", "New plans", digits=0),
    Column("freed", "Other end speed", digits=0),
    Column("relaxed", "Ellipses alone", digits=0),
    Column("pressed", "Latest contact", digits=0),
    Column("held", "Last plan held", digits=0),
    Column("delay_s", "Waited, mean", "s", 1),
    Column("T", "Manoeuvre, mean", "s", 1),
    Column("max_lateral_m", "Largest tracking error", "m", 3),
)
_DECISIONS_CAPTION: Final = (
    "New plans: another than the one driven. Where nothing else was permitted: another end speed than the form's; "
    "ellipses alone, without the profile's distances; the latest contact of plans that all have one. Last plan "
    "held: none is better. Waited: from t_start to the start of the change."
)
_DRIVES: Final = (
    Column("event_id", "Event", link="events/{}.html"),
    Column("label", "Who drives"),
    Column("outcome", "Outcome"),
    Column("reason_label", "Because of"),
    Column("causes", "Contacts"),
    Column("replans", "Decisions", digits=0),
    Column("new_plans", "New plans", digits=0),
    Column("delay_s", "Waited", "s", 1),
    Column("T", "Manoeuvre", "s", 1),
    Column("loss_av", "AV loss", digits=2),
    Column("loss_hv", "Followers' loss", digits=2),
    Column("regret", "Regret", digits=3),
    Column("min_clearance_m", "Smallest clearance", "m", 2),
    Column("max_drac", "Largest DRAC", "m/s²", 2),
)
_OUTCOMES: Final = {
    names.CHANGED: "changed lane",
    names.ABORTED: "turned back",
    names.NEVER_BEGUN: "never begun",
    labels.RECORDED: "recorded",
}


def closed_loop_page(drives: pd.DataFrame, first: Sequence[Section] = ()) -> str:
    """Outcomes, contacts and regret of every policy that plans anew. drives: ``closed_loop``; first: in front."""
    sections: list[Section] = [*first, *_sections(drives)]
    return overview_page(PAGE, "Closed loop", sections, (said(drives),))


def said(drives: pd.DataFrame) -> str:
    """How often who touches somebody, in a sentence; why there is nothing to say."""
    if drives.empty:
        return NOTHING
    touching = {policy: int((rows["contacts"] > 0).sum()) for policy, rows in drives.groupby("policy")}
    count = drives["event_id"].nunique()
    policies = [policy for policy in names.REPLANNED_POLICIES if policy in touching]
    planned = "; ".join(f"{labels.POLICIES[policy].label} {touching[policy]}" for policy in policies)
    humans = "" if names.HUMAN not in touching else f"; recorded humans {touching[names.HUMAN]}"
    return f"Events with a contact, of {count} driven: {planned}{humans}."


def _sections(drives: pd.DataFrame) -> Iterator[Section]:
    if drives.empty:
        return
    known = drives.assign(label=drives["policy"].map(lambda policy: labels.POLICIES[policy].label))
    planned = known[known["policy"] != names.HUMAN]
    yield Section(
        "Outcomes",
        tuple(_explained(planned)),
        tables=(table_view(_summary(known), _SUMMARY, _SUMMARY_CAPTION),),
        anchor="outcomes",
    )
    causes = _causes(known)
    yield Section("Contacts by cause", _CONTACTS if causes else _NO_CONTACTS, tables=causes, anchor="contacts")
    decisions = (table_view(_decisions(planned), _DECISIONS, _DECISIONS_CAPTION),)
    yield Section("Decisions on the way", _ON_THE_WAY, tables=decisions, anchor="decisions")
    every = (table_view(_drives(known), _DRIVES, "Every drive"),)
    yield Section("The drives", _PLAYED, folded=every, anchor="drives")


def _explained(planned: pd.DataFrame) -> Iterator[str]:
    one = planned.iloc[0]
    yield (
        "From t_start on the AV plans, drives half a second or what the setting says, looks where everybody "
        f"is, and plans again, during the manoeuvre too. It predicts leaders {_LEADERS[one['leaders']]} and "
        f"followers by the model {labels.follower_model(one['followers'])}; leaders move as recorded, "
        f"followers by the model {labels.follower_model(one['world'])}. The bicycle under the MPC drives it, "
        "unless set otherwise."
    )
    yield (
        "Losses: accounting “equal”, of what was driven. Regret: how much more both sides lose than under "
        "the plan of the same policy that knows all that comes and is driven alike. It is below 0 where "
        "planning anew, in more than one quintic, gains more than foresight. Events in which either does not "
        "change lane, or touches somebody, have no regret."
    )


_CONTACTS: Final = (
    "Who drives through whom on a lane, and whose ellipse, wider than the box, the AV's ellipse touches. The "
    "human's row: the same among what was recorded, as long as all of them are in view, which is shorter "
    "than H.",
)
_NO_CONTACTS: Final = ("No AV touches anybody, nor does a recorded driver as long as all are in view.",)
_ON_THE_WAY: Final = (
    "Every decision keeps the safety profile where some plan does. Where none does, the AV turns back to its "
    "lane before the crossing if it can; else it gives up the end speed, then all but the ellipses, then "
    "looks for the plan that touches somebody latest. How long a decision takes is in run.log of the work "
    "folder (solve_ms_median, solve_ms_p99).",
)
_PLAYED: Final = (
    "The events' pages play these drives, with the plan of each moment: choose a replanned policy there.",
)


def _summary(known: pd.DataFrame) -> pd.DataFrame:
    rows = []
    for _, own in _by_policy(known):
        regret = own["regret"].dropna().astype(float)
        rows.append(
            {
                "label": own["label"].iloc[0],
                "n": len(own),
                **_outcomes(own),
                "touching": int((own["contacts"] > 0).sum()),
                "share_touching": float((own["contacts"] > 0).mean()),
                "seen_s": float(own["seen_s"].mean()),
                "loss_av": float(own["loss_av"].astype(float).mean()),
                "loss_hv": float(own["loss_hv"].astype(float).mean()),
                "regret_mean": float(regret.mean()),
                "regret_median": float(regret.median()),
                "regret_max": float(regret.max()),
                "n_regret": len(regret),
            }
        )
    return pd.DataFrame(rows)


def _outcomes(own: pd.DataFrame) -> dict[str, int]:
    """How often each outcome came; nothing of what was recorded."""
    counted = {"changed": names.CHANGED, "aborted": names.ABORTED, "never": names.NEVER_BEGUN}
    drives = own["policy"].iloc[0] != names.HUMAN
    return {column: int((own["status"] == status).sum()) for column, status in counted.items() if drives}


def _by_policy(known: pd.DataFrame) -> Iterator[tuple[str, pd.DataFrame]]:
    for policy in (*names.REPLANNED_POLICIES, names.HUMAN):
        own = known[known["policy"] == policy]
        if len(own):
            yield policy, own


def _causes(known: pd.DataFrame) -> tuple[TableView, ...]:
    """Events with each contact and cause, one column a driver; none where nobody touches anybody."""
    each = known.explode(["contact_cause", "contact_reason"]).dropna(subset="contact_cause")
    if each.empty:
        return ()
    counts = pd.crosstab([each["contact_cause"], each["contact_reason"]], each["policy"])
    drivers = [policy for policy, _ in _by_policy(known)]
    counts = counts.reindex(columns=drivers, fill_value=0).reset_index()
    counts = counts.assign(
        cause=counts["contact_cause"].map(_cause), why=counts["contact_reason"].map(labels.CONTACT_CAUSES)
    )
    columns = [Column(policy, labels.POLICIES[policy].label, digits=0) for policy in drivers]
    return (table_view(counts, [Column("cause", "Contact"), Column("why", "Cause"), *columns]),)


def _cause(name: str) -> str:
    if name.startswith(_CLEARANCE):
        return f"the AV's ellipse touches that of {labels.role(name.removeprefix(_CLEARANCE))}"
    return labels.through(name)


def _decisions(planned: pd.DataFrame) -> pd.DataFrame:
    sums, means = ("replans", "new_plans", "freed", "relaxed", "pressed", "held"), ("delay_s", "T")
    rows: list[dict[str, Any]] = []
    for _, own in _by_policy(planned):
        row: dict[str, Any] = {"label": own["label"].iloc[0]}
        row |= {name: int(own[name].sum()) for name in sums}
        row |= {name: float(own[name].astype(float).mean()) for name in means}
        rows.append(row | {"max_lateral_m": float(own["max_lateral_m"].astype(float).max())})
    return pd.DataFrame(rows)


def _drives(known: pd.DataFrame) -> pd.DataFrame:
    return known.assign(
        outcome=known["status"].map(_OUTCOMES),
        reason_label=[labels.blocker(reason) if reason else "" for reason in known["reason"]],
        causes=[
            "; ".join(f"{_cause(name)} ({labels.CONTACT_CAUSES[why]})" for name, why in zip(*both, strict=True))
            for both in zip(known["contact_cause"], known["contact_reason"], strict=True)
        ],
    )
