"""What one would do who does not know the followers, where a local optimum pays, and what SUMO's followers do."""

from collections.abc import Iterator
from typing import Final

import numpy as np
import pandas as pd

from highd_lc.reporting import html, labels
from highd_lc.reporting.figures_population import visible
from highd_lc.reporting.pages_data import Column, Section, TableView, percentage, table_view
from highd_lc.vocab import names
from highd_lc.vocab.tables.robust import EXPECTED, WORST

_CONVINCING: Final = 5
_MEASURES: Final = {EXPECTED: "mean over the models of positive skill", WORST: "worst of these models"}
_TILE_COLUMNS: Final = (
    Column("spacing_low_m", "Spacing from", "m", 0),
    Column("spacing_high_m", "to", "m", 0),
    Column("closing_low_mps", "Speed difference from", "m/s", 0),
    Column("closing_high_mps", "to", "m/s", 0),
)


def quoted(rows: pd.DataFrame, *columns: str) -> pd.DataFrame:
    """Rows without those values that the error in the followers' loss hides."""
    return rows.assign(**{name: rows[name].where(visible(rows)) for name in columns})


def hidden_words(tiles: pd.DataFrame) -> str:
    """In how many tiles the gain can be seen at all. tiles: of one form and accounting."""
    return (
        f"In {int(visible(tiles).sum())} of {len(tiles)} tiles the error in the followers' loss is no "
        "larger than the policy's effect on it. Elsewhere it is larger, or not known: those tiles are "
        "hatched, and no gain is quoted for them."
    )


def robust_sections(summary: pd.DataFrame, ranking: pd.DataFrame, gains: pd.DataFrame) -> Iterator[Section]:
    """Robust plans beside plain ones, and where they pay.

    summary: ``robust_summary``; ranking: ``situation_ranking``; gains: ``event_gains``.
    """
    if summary.empty:
        return
    yield _robust_section(summary)
    yield _ranking_section(ranking, gains)


def _robust_section(summary: pd.DataFrame) -> Section:
    primary = summary[summary["accounting"] == names.PRIMARY_ACCOUNTING]
    rows = _labelled(primary)
    over = rows["scored_with"].isin(tuple(_MEASURES))
    columns = (
        Column("form_label", "Form"),
        Column("policy_label", "Policy"),
        Column("scored_label", "Followers"),
        Column("n_compared", "Events", digits=0),
        percentage("gain", "Gain"),
        percentage("gain_low", "from"),
        percentage("gain_high", "to"),
        percentage("beyond_plain", "Beyond the plain plan"),
        percentage("beyond_low", "from"),
        percentage("beyond_high", "to"),
    )
    text = (
        "The robust local optimum does not know the followers: it minimises the mean over drivers that they may "
        "be (the model's own, those of other models that predict better than the best naive one, and draws within "
        "the population's spread). Gains are those over the benchmark, on the events planned with both; beyond "
        "the plain plan: what the robust plan gains more, negative what it costs.",
        *_cost_words(primary),
    )
    return Section(
        "What would one do who does not know the followers, and what does that cost?",
        text,
        tables=(table_view(rows[over], columns, "Over the models, accounting “equal”"),),
        folded=(table_view(rows[~over], columns, "Under every follower model"),),
        anchor="robust",
    )


def _labelled(rows: pd.DataFrame) -> pd.DataFrame:
    skilful = rows["scored_with"].map(labels.scored_with) + np.where(rows["skilful"], " (positive skill)", "")
    return rows.assign(
        form_label=rows["form"].map(labels.FORMS),
        policy_label=rows["policy"].map(lambda policy: labels.POLICIES[policy].label),
        scored_label=rows["scored_with"].map(_MEASURES).fillna(skilful),
    )


def _cost_words(primary: pd.DataFrame) -> Iterator[str]:
    """One sentence a form: what the robust plan costs on average, and what it wins in the worst case."""
    robust = primary[primary["policy"].isin(names.ROBUST_POLICIES)].set_index(["form", "scored_with"])
    for form in dict.fromkeys(primary["form"]):
        if (form, EXPECTED) in robust.index and (form, WORST) in robust.index:
            mean, worst = robust.loc[(form, EXPECTED)], robust.loc[(form, WORST)]
            yield (
                f"{labels.FORMS[form]}: beside the plain plan the robust one changes the expected gain by "
                f"{_points(mean)} and the worst model's gain by {_points(worst)} percentage points."
            )


def _points(row: pd.Series) -> str:
    value = html.number(100.0 * row["beyond_plain"], 2)
    if html.is_missing(row["beyond_low"]):
        return value
    return f"{value} ({html.number(100 * row['beyond_low'], 2)} to {html.number(100 * row['beyond_high'], 2)})"


def _ranking_section(ranking: pd.DataFrame, gains: pd.DataFrame) -> Section:
    local = (names.LOCAL_OPTIMUM, names.LOCAL_OPTIMUM_FREE)
    rows = _ranked(ranking[ranking["policy"].isin(local)])
    columns = (
        Column("form_label", "Form"),
        Column("rank_worst", "Rank by worst model", digits=0),
        Column("rank_expected", "by expectation", digits=0),
        *_TILE_COLUMNS,
        Column("n_events", "Events", digits=0),
        percentage("gain_expected", "Expected gain"),
        percentage("gain_worst", "Worst model's"),
        percentage("share_positive", "Positive under every model", 0),
        Column("error_over_effect", "Error over effect", digits=1),
    )
    shown = int(visible(ranking[ranking["policy"].isin(local)]).sum())
    text = (
        "Situations by spacing and speed difference of the first follower at the start, ranked by the gain that "
        "the local optimum has under every follower model of positive skill (worst model) and on average over "
        f"them (expected). In {shown} of {len(rows)} situations the error in the followers' loss is no larger "
        "than the effect; elsewhere the gains are left out, the ranks stand.",
    )
    best = tuple(_convincing(gains, form, policy) for form, policy in zip(names.FORMS, local, strict=True))
    folded = (table_view(rows, columns, "All situations"),)
    return Section("Where a local optimum pays", text, tables=best, folded=folded, anchor="ranking")


def _ranked(rows: pd.DataFrame) -> pd.DataFrame:
    return quoted(rows, "gain_expected", "gain_worst").assign(form_label=rows["form"].map(labels.FORMS))


def _convincing(gains: pd.DataFrame, form: str, policy: str) -> TableView:
    rows = gains[(gains["accounting"] == names.PRIMARY_ACCOUNTING) & (gains["policy"] == policy)]
    ranked = rows.sort_values(["gain_worst", "event_id"], ascending=[False, True]).head(_CONVINCING)
    columns = (
        Column("event_id", "Event", link="events/{}.html"),
        percentage("gain_worst", "Gain under the worst model"),
        Column("worst_label", "which is"),
        percentage("gain_expected", "Expected gain"),
        percentage("gain", "Gain under the model that plans"),
    )
    shown = ranked.assign(worst_label=ranked["worst_model"].map(labels.follower_model))
    return table_view(shown, columns, f"{labels.FORMS[form]}: the most convincing events")


_SUMO_COLUMNS: Final = (
    Column("policy_label", "Policy"),
    Column("role_label", "Follower"),
    Column("driven_label", "Driven by"),
    Column("n_compared", "Events", digits=0),
    Column("contacts", "Contacts", digits=0),
    Column("loss", "Loss", digits=2),
    Column("peak_decel", "Strongest braking", "m/s²", 2),
    Column("speed_drop_mps", "Speed drop", "m/s", 2),
)
_SUMO_SHOWN: Final = (names.HUMAN, names.BENCHMARK, names.LOCAL_OPTIMUM)


def sumo_sections(summary: pd.DataFrame) -> Iterator[Section]:
    """What each follower does behind each policy, in SUMO and by the model that planned; none without replays.

    summary: the artefact ``sumo_summary``.
    """
    if summary.empty:
        return
    rows = summary.assign(
        policy_label=summary["policy"].map(lambda policy: labels.POLICIES[policy].label),
        role_label=[labels.role(names.target_follower(rank)) for rank in summary["follower"]],
        driven_label=summary["driven_by"].map(labels.scored_with),
    ).sort_values(["policy_label", "follower", "driven_by"], kind="stable")
    text = (
        "Chosen events replayed in SUMO, which knows none of the follower models here: AV and leaders move along "
        "their ways, the followers drive by SUMO's own model and see the AV from its crossing on. Speed drop: by "
        "how much a follower falls behind its own speed without a lane change, at most; means over the events in "
        "which nobody comes to a contact. The gain under SUMO's followers stands among the cross scores above.",
    )
    shown = rows["policy"].isin(_SUMO_SHOWN)
    yield Section(
        "The wave in SUMO",
        text,
        tables=(table_view(rows[shown], _SUMO_COLUMNS),),
        folded=(table_view(rows[~shown], _SUMO_COLUMNS, "Other policies"),),
        anchor="sumo",
    )
