"""The page on the choice of the start: who waits, what it saves, and what one must know for it."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import pandas as pd

from highd_lc.reporting import html, labels
from highd_lc.reporting.figures_start import start_figure
from highd_lc.reporting.overview import Column, Section, overview_page, table_view

_KNOWLEDGE: Final = {
    "recorded": "recorded motion",
    "predicted": "constant speed, one plan",
    "replanned": "constant speed, a plan every 0.5 s",
}


@dataclass(frozen=True)
class StartTables:
    """Artefacts behind the page, each a table of ``vocab.study_tables``."""

    start_map: pd.DataFrame
    foresight_summary: pd.DataFrame


def start_page(tables: StartTables) -> str:
    """Who waits, over spacing and speed difference, and the value of knowing the leaders."""
    lead = (
        "The AV may keep its lane for a while before it changes, and go into another gap than the recorded one. "
        "Every policy is charged from the recorded start on: waiting is not free. A delayed change has to end by "
        "the same time as any other, so that what comes after it is charged as well.",
    )
    return overview_page("start.html", "Choice of the start", _sections(tables), lead)


def _sections(tables: StartTables) -> Iterator[Section]:
    if tables.start_map.empty:
        yield Section(text=("No start was chosen in this run (setting start in the section validate.planner).",))
        return
    yield _map_section(tables.start_map)
    yield _foresight_section(tables.foresight_summary)


def _map_section(tiles: pd.DataFrame) -> Section:
    columns = (
        Column("policy_label", "Policy"),
        Column("accounting_label", "Accounting"),
        Column("n_events", "Events", digits=0),
        _percent("share_waiting", "Wait", 1),
        _percent("share_other_gap", "Other gap", 1),
        Column("mean_delay_s", "Mean wait", "s", 2),
        _percent("saved_objective", "Saved of what it minimises"),
        _percent("saved_av", "of AV's loss"),
        _percent("saved_hv", "of followers' loss"),
        _percent("saved_total", "of total"),
    )
    whole = tiles[tiles["spacing_low_m"].isna()]
    whole = whole.assign(
        policy_label=whole["policy"].map(lambda policy: labels.POLICIES[policy].label),
        accounting_label=whole["accounting"].map(labels.ACCOUNTING_NAMES),
    )
    what = (
        "Events that wait (left) and what the choice saves (right), by spacing and speed difference of the first "
        "follower, HV 1, at the start; accounting “equal”."
    )
    text = (
        "Against the same policy without the choice. The benchmark minimises the AV's loss, the local optimum the "
        "mean of the AV's and the followers'. Numbers in the tiles: events. Negative: it costs.",
    )
    figure = html.inline_svg(start_figure(tiles), f"{what} The table holds the totals.")
    return Section("Who waits, and for what", text, figure, what, (table_view(whole, columns),), anchor="map")


def _foresight_section(summary: pd.DataFrame) -> Section:
    columns = (
        Column("policy_label", "Policy"),
        Column("knowledge_label", "Leaders as known to the AV"),
        Column("n_events", "Events", digits=0),
        Column("no_plan", "No plan", digits=0),
        Column("touching", "Touching somebody", digits=0),
        Column("mean_delay_s", "Mean wait", "s", 2),
        _percent("share_waiting", "Wait", 1),
        _percent("value_of_information", "Knowing saves"),
        _percent("value_low", "from"),
        _percent("value_high", "to"),
    )
    rows = summary.assign(
        policy_label=summary["policy"].map(lambda policy: labels.POLICIES[policy].label),
        knowledge_label=summary["knowledge"].map(_KNOWLEDGE),
    )
    text = (
        "Elsewhere the planner knows how the leaders will drive. Here it predicts them at constant speed, and its "
        "plan is driven among the recorded leaders; plans that touch somebody then are counted, not charged. "
        "Knowing saves: how much lower what the policy minimises is with the recorded motion, with its interval.",
    )
    title = "What knowing the leaders is worth"
    return Section(title, text, tables=(table_view(rows, columns),), anchor="foresight")


def _percent(name: str, title: str, digits: int = 2) -> Column:
    return Column(name, title, "%", digits, 100.0)
