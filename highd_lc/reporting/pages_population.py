"""Pages of the whole run: validation matrix, calibration, data dictionary.

The page on the choice of the start: who waits, what it saves, and what one must know for it.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import pandas as pd
from markupsafe import Markup
from numpy.typing import NDArray

from highd_lc.reporting import figures_population as figures
from highd_lc.reporting import html, labels
from highd_lc.reporting.certainty_words import multiplicity, no_interval
from highd_lc.reporting.figures_population import ALL, start_figure
from highd_lc.reporting.pages_data import Column, Section, TableView, overview_page, percentage, table_view
from highd_lc.vocab import names
from highd_lc.vocab.policy import PAIRS
from highd_lc.vocab.tables import TABLES
from highd_lc.vocab.tables import columns as schema

FloatArray = NDArray[np.float64]

_MATRIX_COLUMNS: Final = (
    Column("form_label", "Form"),
    Column("accounting_label", "Accounting"),
    Column("n_events", "Events", digits=0),
    Column("infeasible", "Infeasible", digits=0),
    Column("contacts", "Contacts", digits=0),
    Column("total_benchmark", "Loss, benchmark", digits=1),
    Column("total_local", "Loss, local", digits=1),
    percentage("gain", "Gain"),
    percentage("gain_low", "from"),
    percentage("gain_high", "to"),
    percentage("gain_incremental", "Gain of what the change adds"),
    percentage("gain_incremental_low", "from"),
    percentage("gain_incremental_high", "to"),
    percentage("gain_hv", "Gain of followers"),
    percentage("gain_av", "Gain of AV"),
    percentage("share_top", "Carried by 5 % of events", 0),
    percentage("gain_reweighted", "Gain, as found on the road"),
    percentage("median_difference", "Median change of loss"),
    percentage("hodges_lehmann", "the same, Hodges-Lehmann"),
    percentage("share_differ", "Plans differ", 1),
    percentage("share_better", "Better", 1),
    percentage("share_worse", "Worse", 1),
    percentage("share_worst_follower_worse", "Some follower loses", 1),
)
_FOLLOWERS: Final = Column("followers_label", "Followers")
_SEVERAL: Final = " First the follower model that plans every event, then others on a sample of the events."
_MATRIX_LEAD: Final = (
    "How much lower the total loss of AV and followers is under the local optimum than under the benchmark, "
    "which minimises the AV's loss alone. Gain = 1 − ratio of the sums over all events; intervals vary over "
    "recordings. What the change adds is the loss above that of no lane change, where both are charged over the "
    "same time (“equal”). As found on the road: each event counted as often as lane-id changes of its class, "
    "direction and speed were found.",
    "Form (whether the end speed is free, and the start chosen) and accounting decide the answer, so every "
    "combination is shown. Under “paper” both sides are charged until the manoeuvre ends, at T, which rewards a "
    "short T; under “follower horizon” the followers are charged over a longer time H, and the AV may end fast at "
    "no cost; “equal” charges both sides over the same H and is the primary one.",
)


@dataclass(frozen=True)
class PriceTables:
    """The artefacts that say what the safety profile costs."""

    safety_price: pd.DataFrame
    safety_violations: pd.DataFrame


def matrix_page(
    matrix: pd.DataFrame,
    first: Sequence[Section] = (),
    *,
    price: PriceTables | None = None,
    confidence: float = 0.95,
) -> str:
    """The validation matrix: form x accounting, then by stratum for the default follower model.

    matrix: ``validation_matrix``; first: what stands in front; price: of the safety profile, if it is known;
    confidence: coverage of the intervals.
    """
    whole, *strata = _matrix_sections(with_labels(matrix))
    priced = [] if price is None or price.safety_price.empty else [price_section(price)]
    sections = [*first, whole, *priced, *strata]
    lead = (*_MATRIX_LEAD, multiplicity(matrix, confidence=confidence))
    return overview_page("matrix.html", "Validation matrix", sections, lead)


def with_labels(matrix: pd.DataFrame) -> pd.DataFrame:
    """The matrix in the order of follower models, forms and accountings, with columns form_label, accounting_label
    and followers_label.
    """
    order = {a: k for k, a in enumerate((names.EQUAL, names.FOLLOWER_HORIZON, names.PAPER))}
    form = matrix["form"].map({f: k for k, f in enumerate(labels.FORMS)})
    models = matrix["followers"].map({m: k for k, m in enumerate(dict.fromkeys(matrix["followers"]))})
    labelled = matrix.assign(
        form_label=matrix["form"].map(labels.FORMS),
        accounting_label=matrix["accounting"].map(labels.ACCOUNTING_NAMES),
        followers_label=matrix["followers"].map(labels.follower_model),
        _models=models,
        _form=form,
        _accounting=matrix["accounting"].map(order),
    )
    return labelled.sort_values(["_models", "_form", "_accounting"], kind="stable")


def matrix_section(matrix: pd.DataFrame) -> Section:
    """Form x accounting over all events, for each follower model: figure and table.

    matrix: as ``with_labels`` gives it.
    """
    whole = matrix[matrix["stratum"] == ALL]
    several = len(set(whole["followers"])) > 1
    figure = html.inline_svg(figures.matrix_figure(matrix), _matrix_words(whole))
    return Section(
        "All events",
        figure=figure,
        caption="Dot: gain of the total, with its interval; bar: of the AV alone; cross: of the followers alone."
        + _SEVERAL * several
        + _without_interval(whole),
        tables=(table_view(whole, (*((_FOLLOWERS,) if several else ()), *_MATRIX_COLUMNS)),),
    )


def _without_interval(whole: pd.DataFrame) -> str:
    """Why rows have no interval, each reason once."""
    missing = whole[whole["gain_low"].isna() & whole["gain"].notna()]
    reasons = dict.fromkeys(no_interval(n) for n in missing["n_clusters"])
    return "".join(f" {reason.capitalize()}." for reason in reasons)


_PRICE_COLUMNS: Final = (
    Column("form_label", "Form"),
    Column("accounting_label", "Accounting"),
    Column("safety", "Profile"),
    Column("n_events", "Events", digits=0),
    Column("infeasible", "Infeasible", digits=0),
    Column("n_both", "Feasible under both", digits=0),
    percentage("gain", "Gain"),
    percentage("gain_low", "from"),
    percentage("gain_high", "to"),
    percentage("gain_incremental", "Gain of what the change adds"),
)
_PRICE_TEXT: Final = (
    "The same events planned under both safety profiles. “paper” asks that ellipses do not overlap, “practice” "
    "for time gaps, moderate braking of others and a margin around the ellipses as well. Gains are of the events "
    "that are feasible under both; what the change adds is the loss above that of no lane change.",
)


def price_section(price: PriceTables) -> Section:
    """Gains under both safety profiles, and who breaks what the profile practice asks."""
    gains = price.safety_price.assign(
        form_label=price.safety_price["form"].map(labels.FORMS),
        accounting_label=price.safety_price["accounting"].map(labels.ACCOUNTING_NAMES),
    )
    shares = price.safety_violations
    wide = shares.pivot_table(index=["safety", "constraint"], columns="policy", values="share", sort=False)
    known = wide[(wide > 0.0).any(axis=1)].reset_index()
    known = known.assign(constraint=known["constraint"].map(labels.blocker))
    columns = [Column("safety", "Planned under"), Column("constraint", "What is broken")]
    columns += [percentage(p, labels.POLICIES[p].label, 1) for p in labels.POLICIES if p in wide.columns]
    broken = table_view(known, columns, "Share of plans, and of humans, that break what “practice” asks (equal)")
    tables = (table_view(gains, _PRICE_COLUMNS), broken)
    return Section("The price of safety", text=_PRICE_TEXT, tables=tables, anchor="safety")


def _matrix_words(whole: pd.DataFrame) -> str:
    several = len(set(whole["followers"])) > 1
    cells = [
        f"{f'{row.followers_label}, ' * several}{row.form_label}, {row.accounting_label}: {html.percent(row.gain)}"
        for row in whole.itertuples(index=False)
    ]
    return "Gain of the local optimum by form and accounting. " + "; ".join(cells)


def _matrix_sections(matrix: pd.DataFrame) -> Iterator[Section]:
    yield matrix_section(matrix)
    default = matrix["followers"] == next(iter(matrix["followers"]), "")
    strata = matrix[(matrix["stratum"] != ALL) & default]
    strata = strata.assign(stratum_label=strata["stratum"].map(labels.stratum))
    columns = (Column("stratum_label", "Stratum"), *_MATRIX_COLUMNS[2:])
    for key, rows in strata.groupby(["form", "accounting"], sort=False):
        form, accounting = map(str, key)
        figure = figures.strata_figure(strata, form=form, accounting=accounting)
        title = f"{labels.FORMS[form]}, accounting “{labels.ACCOUNTING_NAMES[accounting].lower()}”, by stratum"
        alternative = f"Gain: {title}. The table below holds the numbers."
        yield Section(
            title,
            figure=html.inline_svg(figure, alternative),
            folded=(table_view(rows, columns, "All numbers"),),
            anchor=f"{form}-{accounting}",
        )


def dictionary_page() -> str:
    """The data dictionary: every artefact's columns, from the schemas."""
    lead = (
        "Every table is a parquet file below the work folder; its schema is checked when it is written and read. "
        "Unavailable values are null, never 0.",
        Markup(", ").join(Markup('<a href="#{0}">{0}</a>').format(name) for name in TABLES),
    )
    return overview_page("dictionary.html", "Data dictionary", map(_dictionary_section, TABLES.values()), lead)


_DICTIONARY_COLUMNS: Final = (
    Column("name", "Column"),
    Column("kind", "Type"),
    Column("unit", "Unit"),
    Column("meaning", "Meaning"),
    Column("values", "Values"),
)


def _dictionary_section(table: schema.Table) -> Section:
    rows = tuple((c.name, c.kind, c.unit, c.meaning, ", ".join(_values(c))) for c in table.columns)
    text = f"One row a {table.row}; ordered by {', '.join(table.order)}."
    return Section(table.name, (text,), tables=(TableView(_DICTIONARY_COLUMNS, rows),), anchor=table.name)


def _values(column: schema.Column) -> Iterator[str]:
    if column.allowed:
        yield " | ".join(word or "(empty)" for word in column.allowed)
    if column.minimum is not None:
        yield f"≥ {column.minimum:g}"
    if column.maximum is not None:
        yield f"≤ {column.maximum:g}"
    if column.nullable:
        yield "may be null"


_KNOWLEDGE: Final = {
    "recorded": "recorded motion",
    "predicted": "constant speed, one plan",
    "replanned": "constant speed, a plan every 0.5 s",
}


@dataclass(frozen=True)
class StartTables:
    """Artefacts behind the page, each a table of ``vocab.tables.studies``."""

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
        percentage("share_waiting", "Wait", 1),
        percentage("share_other_gap", "Other gap", 1),
        Column("mean_delay_s", "Mean wait", "s", 2),
        percentage("saved_objective", "Saved of what it minimises"),
        percentage("saved_av", "of AV's loss"),
        percentage("saved_hv", "of followers' loss"),
        percentage("saved_total", "of total"),
        Column("error_over_effect", "Error over effect", digits=1),
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
        "Hatched: the error in the followers' loss is larger than the choice's effect on it, or "
        "not known: what is saved there cannot be seen.",
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
        percentage("share_waiting", "Wait", 1),
        percentage("value_of_information", "Knowing saves"),
        percentage("value_low", "from"),
        percentage("value_high", "to"),
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


def totals(
    losses: pd.DataFrame, events: pd.DataFrame, form: str, accounting: str
) -> tuple[FloatArray, FloatArray]:
    """Total losses of the local optimum and of the benchmark in the order of the events, NaN where undefined."""
    rows = losses[losses["accounting"] == accounting]
    benchmark, local = (
        rows[rows["policy"] == policy].set_index("event_id")["loss_total"].reindex(events["event_id"])
        for policy in PAIRS[form]
    )
    return local.to_numpy(float), benchmark.to_numpy(float)


def distribution_section(losses: pd.DataFrame, events: pd.DataFrame) -> Section:
    """How the gain is spread over the events in each form, accounting “equal”."""
    gains = {}
    for form in PAIRS:
        local, benchmark = totals(losses, events, form, names.PRIMARY_ACCOUNTING)
        if np.isfinite(local).any():
            gains[form] = 1.0 - local / benchmark
    words = "; ".join(f"{labels.FORMS[f]}: median {html.percent(np.nanmedian(g))}" for f, g in gains.items())
    figure = html.inline_svg(figures.gain_distribution(gains), f"Distribution of the gain over events. {words}")
    return Section("Distribution of the gain", (f"Accounting “equal”. {words}.",), figure)


def extremes_section(losses: pd.DataFrame, events: pd.DataFrame, most: int = 10) -> Section:
    """The events with the largest and the smallest gain. most: how many of each."""
    local, benchmark = totals(losses, events, names.FIXED, names.PRIMARY_ACCOUNTING)
    frame = events[["event_id", "ego_class", "direction"]].assign(
        benchmark=benchmark, local=local, gain=100.0 * (1.0 - local / benchmark)
    )
    ranked = frame.dropna(subset="gain").sort_values(["gain", "event_id"], ascending=[False, True])
    columns = (
        Column("event_id", "Event", link="events/{}.html"),
        Column("ego_class", "Class"),
        Column("direction", "Direction"),
        Column("benchmark", "Benchmark", digits=2),
        Column("local", "Local optimum", digits=2),
        Column("gain", "Gain", "%", 2),
    )
    best = table_view(ranked.head(most), columns, "Largest gains")
    worst = table_view(ranked.iloc[::-1].head(most), columns, "Smallest gains")
    return Section("Best and worst events", ("Fixed end speed, accounting “equal”.",), tables=(best, worst))
