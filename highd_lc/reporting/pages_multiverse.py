"""The multiverse page: the same question under every defensible choice, as a specification curve."""

from collections.abc import Iterator, Sequence
from typing import Any, Final

import pandas as pd

from highd_lc.reporting import html
from highd_lc.reporting.certainty_words import counted
from highd_lc.reporting.figures_studies import multiverse_figure
from highd_lc.reporting.pages_data import Column, Section, overview_page, percentage, table_view

PAGE: Final = "multiverse.html"
_RUN: Final = "run"
NOTHING: Final = "No event of this run was planned under other choices (setting validate.multiverse.sample)."

COLUMNS: Final = (
    Column("variant", "Choice"),
    percentage("gain", "Gain"),
    percentage("gain_low", "from"),
    percentage("gain_high", "to"),
    percentage("gain_incremental", "Gain of what the change adds"),
    Column("n_events", "Events", digits=0),
    Column("infeasible", "Infeasible", digits=0),
    Column("contacts", "Contacts", digits=0),
)
_SETTINGS: Final = (
    Column("variant", "Choice"),
    Column("followers", "Followers"),
    Column("leader_from", "Leader from"),
    Column("accounting", "Accounting"),
    Column("horizon_s", "H", "s", 1),
    Column("v_ref_av", "v_ref, AV", "m/s", 2),
    Column("v_ref_hv", "v_ref, followers", "m/s", 2),
    Column("reference", "Reference"),
    Column("aggregation", "Aggregation"),
    Column("comfort_scale", "N_c", "m/s³", 1),
    Column("T_max", "T_max", "s", 1),
    Column("leaders", "Leaders"),
    Column("after", "After T"),
    Column("handover", "Handover"),
    Column("safety", "Safety"),
)


def by_gain(table: pd.DataFrame) -> pd.DataFrame:
    """The variants from the smallest gain to the largest; those without one last. table: ``multiverse``."""
    return table.sort_values(["gain", "variant"], kind="stable", na_position="last", ignore_index=True)


def range_words(table: pd.DataFrame) -> str:
    """Between which gains the choices lead, in a sentence; why there is none. table: ``multiverse``."""
    if table.empty:
        return NOTHING
    known = by_gain(table).dropna(subset="gain")
    if known.empty:
        return "No choice leaves an event with a feasible plan of both policies: there is no range to quote."
    low, high = known.iloc[0], known.iloc[-1]
    own = table.loc[table["variant"] == _RUN]
    events = int(own["n_events"].iloc[0]) if len(own) else int(table["n_events"].max())
    text = (
        f"Over {len(known)} defensible ways to ask the question of the same sample of {counted(events, 'event')} "
        f"(fixed end speed), the gain goes from {_percent(low)} ({low['variant']}) to {_percent(high)} "
        f"({high['variant']}), "
        f"median {html.percent(known['gain'].median())}"
    )
    return f"{text}; as in the run: {_percent(own.iloc[0])}." if len(own) else f"{text}."


def _percent(row: pd.Series) -> str:
    return html.percent(row["gain"])


def multiverse_page(table: pd.DataFrame, first: Sequence[Section] = ()) -> str:
    """The specification curve and its table. table: ``multiverse``; first: what stands in front."""
    sections: list[Section] = [*first, *_sections(table)]
    return overview_page(PAGE, "Multiverse", sections, (range_words(table),))


def _sections(table: pd.DataFrame) -> Iterator[Section]:
    if table.empty:
        return
    rows = by_gain(table)
    figure = html.inline_svg(
        multiverse_figure(rows),
        "Specification curve: the gain of every variant in ascending order, and below it the choices it makes.",
    )
    yield Section(
        "Specification curve",
        tuple(_explained(table)),
        figure,
        "Above: gain of the local optimum over the benchmark, with its interval over recordings where there is "
        "one. Below: a dot where the variant makes the choice.",
        tables=(table_view(rows, COLUMNS, "Every variant, by its gain"),),
        folded=(table_view(rows, _SETTINGS, "What each variant chooses"),),
        anchor="curve",
    )


def _explained(table: pd.DataFrame) -> Iterator[str]:
    yield (
        "Each choice is changed alone, all else as in the run, then some are changed together. Benchmark and "
        "local optimum are planned anew and scored by what planned them, on the events that are feasible for "
        "both. A contact is counted and is in no sum. Gain of what the change adds: of the losses above those "
        "without a lane change, where both sides are charged over the same time."
    )
    lost: list[Any] = table.loc[table["n_events"] == 0, "variant"].tolist()
    if lost:
        yield f"Without any event, because calibrate knows no such followers: {', '.join(lost)}."
