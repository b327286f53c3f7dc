"""The robustness page: the same question asked under what was not optimised, and on samples of events."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import pandas as pd

from highd_lc.reporting import figures_studies as figures
from highd_lc.reporting import html, labels
from highd_lc.reporting.figures_population import visible
from highd_lc.reporting.pages_data import Column, Section, overview_page, percentage, table_view
from highd_lc.reporting.pages_robust import quoted, robust_sections, sumo_sections
from highd_lc.vocab import names

_WORST_SHOWN: Final = 50


@dataclass(frozen=True)
class StudyTables:
    """Artefacts of the studies: each a table of ``vocab.tables.studies``."""

    cross_scores: pd.DataFrame
    horizon_sensitivity: pd.DataFrame
    leave_one_out: pd.DataFrame
    uncertainty: pd.DataFrame
    pareto: pd.DataFrame
    pareto_summary: pd.DataFrame
    solver_summary: pd.DataFrame
    worse_for_somebody: pd.DataFrame
    tracking_summary: pd.DataFrame
    tracking_contacts: pd.DataFrame
    robust_summary: pd.DataFrame
    situation_ranking: pd.DataFrame
    event_gains: pd.DataFrame
    leaderboard: pd.DataFrame
    sumo_summary: pd.DataFrame


def studies_page(tables: StudyTables, first: Sequence[Section] = ()) -> str:
    """What the gain becomes under other followers, accountings, horizons, parameters, sites and solvers.

    first: what stands in front.
    """
    lead = (
        "A sign proves nothing where the optimum guarantees it. Here the plans are judged by what they were not "
        "made for, and the search by other searches.",
    )
    return overview_page("studies.html", "Robustness", [*first, *_sections(tables)], lead)


def _sections(tables: StudyTables) -> Iterator[Section]:
    if len(tables.leaderboard):
        yield _leaderboard_section(tables.leaderboard)
    yield from _cross_sections(tables.cross_scores)
    yield from sumo_sections(tables.sumo_summary)
    yield from robust_sections(tables.robust_summary, tables.situation_ranking, tables.event_gains)
    yield _horizon_section(tables.horizon_sensitivity)
    yield _location_section(tables.leave_one_out)
    yield _uncertainty_section(tables.uncertainty)
    yield pareto_section(tables.pareto, tables.pareto_summary)
    yield _solver_section(tables.solver_summary)
    yield _tracking_section(tables.tracking_summary)
    yield _contacts_section(tables.tracking_contacts)
    yield _worse_section(tables.worse_for_somebody)


_GAINS: Final = (
    Column("n_events", "Events", digits=0),
    Column("infeasible", "Infeasible", digits=0),
    Column("contacts", "Contacts", digits=0),
    percentage("gain", "Gain"),
    percentage("gain_low", "from"),
    percentage("gain_high", "to"),
    percentage("gain_hv", "Gain of followers"),
    percentage("gain_av", "Gain of AV"),
    percentage("share_better", "Better", 1),
    percentage("share_worse", "Worse", 1),
)


def _labelled(frame: pd.DataFrame) -> pd.DataFrame:
    known = {"form": labels.FORMS, "accounting": labels.ACCOUNTING_NAMES}
    return frame.assign(**{f"{c}_label": frame[c].map(names_) for c, names_ in known.items() if c in frame})


_FORM: Final = Column("form_label", "Form")
_ACCOUNTING: Final = Column("accounting_label", "Accounting")


def _cross_sections(scores: pd.DataFrame) -> Iterator[Section]:
    text = (
        "Gain in %: plans made under one accounting (rows) scored under each (columns), with the followers as "
        "planned, driven by another model or by SUMO, or with parameters drawn within their spread. Events in "
        "which somebody drives through another then are counted as contacts, and are in no sum.",
    )
    present = [f for f in (*names.FORMS, *names.START_FORMS, *names.ROBUST_FORMS) if (scores["form"] == f).any()]
    for form in present:
        rows, first = scores[scores["form"] == form], form == present[0]
        table = rows.assign(
            optimised_label=rows["optimised"].map(labels.ACCOUNTING_NAMES),
            scored_label=rows["scored"].map(labels.ACCOUNTING_NAMES),
            planned_label=rows["planned_with"].map(labels.follower_model),
            followers_label=rows["scored_with"].map(labels.scored_with),
        )
        columns = (
            Column("optimised_label", "Optimised under"),
            Column("scored_label", "Scored under"),
            *([Column("planned_label", "Planned with")] if len(set(rows["planned_with"])) > 1 else []),
            Column("followers_label", "Followers"),
            *_GAINS,
            Column("touching", "Touching after T", digits=0),
            Column("peak_benchmark", "Braking behind benchmark", "m/s²", 2),
            Column("peak_local", "behind local optimum", "m/s²", 2),
        )
        title = f"Scored under what was not optimised: {labels.FORMS[form].lower()}"
        default = rows[rows["planned_with"] == rows["planned_with"].iloc[0]]
        figure = html.inline_svg(figures.cross_figure(default), f"{title}. The table holds the numbers.")
        yield Section(
            title,
            text if first else (),
            figure,
            folded=(table_view(table, columns, "All numbers"),),
            anchor=f"cross-{form}",
        )


def _horizon_section(sensitivity: pd.DataFrame) -> Section:
    columns = (Column("horizon_s", "H", "s", 1), _FORM, _ACCOUNTING, *_GAINS)
    figure = html.inline_svg(
        figures.horizon_figure(sensitivity),
        "Gain over the accounted time H by form and accounting, with intervals.",
    )
    text = ("Over a sample of events. Bands: intervals over recordings, none below five.",)
    folded = (table_view(_labelled(sensitivity), columns, "All numbers"),)
    return Section("Sensitivity to the accounted time", text, figure, folded=folded, anchor="horizon")


def _location_section(rows: pd.DataFrame) -> Section:
    columns = (
        Column("location_id", "Location left out", digits=0),
        _FORM,
        _ACCOUNTING,
        Column("n_left_out", "Events left out", digits=0),
        *_GAINS,
    )
    if len(set(rows["location_id"])) == 1:
        text = ("All events are of one location: nothing would be left without it.",)
        return Section("Leave one location out", text, anchor="locations")
    primary = rows[rows["accounting"] == names.PRIMARY_ACCOUNTING]
    others = rows[rows["accounting"] != names.PRIMARY_ACCOUNTING]
    return Section(
        "Leave one location out",
        ("Accounting “equal” first; the other accountings below.",),
        tables=(table_view(_labelled(primary), columns),),
        folded=(table_view(_labelled(others), columns, "Other accountings"),),
        anchor="locations",
    )


_UNCERTAINTY: Final = (
    Column("event_id", "Event", link="events/{}.html"),
    Column("n_replanned", "Draws", digits=0),
    percentage("gain", "Gain as fitted"),
    percentage("gain_mean", "Mean gain"),
    percentage("gain_low", "lowest"),
    percentage("gain_high", "highest"),
    percentage("share_better", "Better", 1),
    percentage("share_worse", "Worse", 1),
    Column("n_kept", "Draws, plan kept", digits=0),
    percentage("gain_kept_mean", "Mean gain, plan kept"),
    percentage("share_kept_better", "Better, plan kept", 1),
    Column("T_deviation", "Change of T", "s", 2),
    percentage("spread_known", "Followers with known spread", 0),
)


def _uncertainty_section(uncertainty: pd.DataFrame) -> Section:
    rows = uncertainty[uncertainty["accounting"] == names.PRIMARY_ACCOUNTING]
    fixed = rows[rows["form"] == names.FIXED]
    better = fixed["share_better"].mean() if len(fixed) else float("nan")
    text = (
        "Each sampled event is planned and scored again with parameters of its followers drawn within the spread "
        f"of their fits. In {html.percent(better, 1)} of the draws the local optimum's total is lower (fixed end "
        "speed, accounting “equal”).",
    )
    figure = html.inline_svg(
        figures.uncertainty_figure(fixed), "Gain of each sampled event over draws: mean, range and as fitted."
    )
    tables = tuple(
        table_view(rows[rows["form"] == form], _UNCERTAINTY, f"{labels.FORMS[form]}, accounting “equal”")
        for form in (*names.FORMS, *names.START_FORMS)
        if (rows["form"] == form).any()
    )
    return Section("Uncertain followers", text, figure, folded=tables, anchor="uncertainty")


_PARETO: Final = (
    Column("event_id", "Event", link="events/{}.html"),
    _FORM,
    Column("n_front", "Plans on the front", digits=0),
    Column("hypervolume", "Hypervolume, NSGA-II", digits=4),
    Column("hypervolume_sweep", "Hypervolume, sweep", digits=4),
    percentage("front_behind", "Front behind the sweep by at most", 3),
    percentage("front_ahead", "Front ahead by at most", 3),
    Column("knee_loss_av", "Knee: AV loss", digits=2),
    Column("knee_loss_hv", "Knee: followers' loss", digits=2),
    Column("knee_omega_low", "Knee optimal from weight", digits=2),
    Column("knee_omega_high", "to weight", digits=2),
)


def pareto_section(pareto: pd.DataFrame, summary: pd.DataFrame) -> Section:
    """Fronts of AV against followers for some sampled events, and the summary of all of them."""
    figure = html.inline_svg(
        figures.pareto_figure(pareto),
        "Pareto fronts of the loss of the AV and that of the followers, with the sweeps.",
    )
    text = (
        "What the AV would have to give for what the followers gain: non-dominated plans over (T, x_final, v_end) "
        "found by NSGA-II, and the global optima as the AV's weight goes from 0.1 to 1. Accounting “equal”. With "
        "a chosen start the delay and the gap are unknowns as well: the lower of the two fronts of an event.",
    )
    count = summary["event_id"].nunique()
    folded = (table_view(_labelled(summary), _PARETO, f"All {count} sampled events"),)
    return Section("Pareto front", text, figure, folded=folded, anchor="pareto")


def _solver_section(summary: pd.DataFrame) -> Section:
    levels = (
        ("failed", "infeasible"),
        ("worse_1", "> 1 % worse"),
        ("worse_01", "> 0.1 % worse"),
        ("better_01", "> 0.1 % better"),
    )
    columns = (
        _FORM,
        Column("omega_av", "AV's weight", digits=2),
        Column("n", "Cases", digits=0),
        *(percentage(f"share_sqp_{key}", f"all starts: {title}", 1) for key, title in levels),
        *(percentage(f"share_single_{key}", f"one start: {title}", 1) for key, title in levels),
        percentage("excess_sqp_max", "largest excess", 3),
        percentage("excess_sqp_min", "smallest excess", 3),
    )
    text = (
        "SLSQP, the method the paper names, against the global search on sampled events: from all of its starts, "
        "and from a single one. Excess: how much higher the objective is from all starts.",
    )
    return Section("Solvers compared", text, tables=(table_view(_labelled(summary), columns),), anchor="solvers")


_BOARD: Final = (
    Column("label", "Planner"),
    Column("whose", "Whose"),
    Column("n_planned", "Plans", digits=0),
    Column("n_contacts", "Contacts", digits=0),
    Column("n_violating", "Break a limit", digits=0),
    Column("n_faulty", "Faults", digits=0),
    Column("loss_av", "AV loss", digits=3),
    Column("loss_hv", "Followers' loss", digits=3),
    Column("loss_total", "Both", digits=3),
    Column("min_gap_m", "Smallest gap", "m", 1),
    Column("max_drac", "Largest DRAC", "m/s²", 2),
    Column("peak_follower_decel", "Braking of followers", "m/s²", 2),
    Column("rmse_lateral_m", "Lateral RMSE", "m", 3),
)


def _leaderboard_section(board: pd.DataFrame) -> Section:
    """Our policies and other people's planners on the same events."""
    events, common = int(board["n_events"].max()), int(board["n_common"].max())
    text = (
        f"Other people's planners beside our policies on the same {events} events, accounting “equal”, the lowest "
        f"loss first. Losses, gaps, DRAC, braking and tracking errors are means over the {common} events in which "
        "all of them have a plan without a contact. Everybody is scored with the follower model that our policies "
        "plan with, which favours them: read it beside the cross scores below.",
    )
    rows = board.assign(
        label=[labels.look(policy).label for policy in board["policy"]],
        whose=["ours" if ours else "other" for ours in board["ours"]],
    )
    return Section("Planners side by side", text, tables=(table_view(rows, _BOARD),), anchor="leaderboard")


_TRACKING: Final = (
    Column("plant_label", "Car"),
    Column("policy_label", "Policy"),
    Column("n_driven", "Plans", digits=0),
    Column("not_driven", "Not driven", digits=0),
    Column("lost", "Lost", digits=0),
    Column("softened", "Bounds softened", digits=0),
    Column("qp_failures", "Steps unsolved", digits=0),
    Column("rmse_lateral_median_m", "Lateral RMSE, median", "m", 3),
    Column("rmse_lateral_largest_m", "largest", "m", 3),
    Column("max_lateral_m", "Largest lateral error", "m", 3),
    Column("loss_av_planned", "AV loss planned", digits=3),
    Column("loss_av_tracked", "tracked", digits=3),
    Column("loss_hv_planned", "Followers' loss planned", digits=3),
    Column("loss_hv_tracked", "tracked", digits=3),
    percentage("share_violating", "Violating", 1),
    percentage("share_touching_planned", "Touching, planned", 1),
    percentage("share_touching", "tracked", 1),
)


def _tracking_section(summary: pd.DataFrame) -> Section:
    """Planned against tracked, by plant and policy."""
    text = (
        "The plans of accounting “equal” as the MPC (model predictive controller) drives them: on the kinematic "
        "bicycle all of them, on the "
        "multi-body car those of a sample. Limits and clearances are checked again on the tracked motion, and the "
        "followers react to that one. Means of the AV's loss over 0..T, by finite differences on both sides, and "
        "of the followers' over 0..H. The human's path and “constant” may violate a constraint as planned. The "
        "multi-body car weaves slightly by itself, even without a controller: its AV loss holds that.",
    )
    rows = summary.assign(
        plant_label=summary["plant"].map(labels.PLANTS),
        policy_label=summary["policy"].map(lambda policy: labels.POLICIES[policy].label),
    )
    return Section("Planned and tracked", text, tables=(table_view(rows, _TRACKING),), anchor="tracking")


_CONTACTS: Final = (
    Column("followers_label", "Followers"),
    Column("plant_label", "Plant"),
    Column("contact_label", "Contact"),
    Column("cause_label", "Cause"),
    Column("n_events", "Events", digits=0),
    Column("n_plans", "Plans", digits=0),
    Column("n_references", "References", digits=0),
)


def _contacts_section(contacts: pd.DataFrame) -> Section:
    """Contacts of tracked drives by cause, with every follower model that plans."""
    plans, references = int(contacts["n_plans"].sum()), int(contacts["n_references"].sum())
    text = (
        f"Drives in which somebody drives through another, over 0..H: {plans} of plans that a search chose, "
        f"{references} of references (human, constant), whose contacts nothing rejects.",
    )
    if contacts.empty:
        return Section("Contacts of tracked drives", text, anchor="tracked-contacts")
    rows = contacts.assign(
        followers_label=contacts["followers"].map(labels.follower_model),
        plant_label=contacts["plant"].map(labels.PLANTS),
        contact_label=contacts["contact"].map(labels.through),
        cause_label=contacts["cause"].map(labels.CONTACT_CAUSES),
    )
    return Section(
        "Contacts of tracked drives", text, tables=(table_view(rows, _CONTACTS),), anchor="tracked-contacts"
    )


def _worse_section(worse: pd.DataFrame) -> Section:
    columns = (
        Column("event_id", "Event", link="events/{}.html"),
        _FORM,
        _ACCOUNTING,
        Column("who_label", "Who loses"),
        Column("loss_benchmark", "Loss, benchmark", digits=3),
        Column("loss_local", "Loss, local optimum", digits=3),
        percentage("increase", "Increase, where it can be seen"),
        Column("error_over_effect", "Error over effect", digits=1),
    )
    if worse.empty:
        text = ("No event has anybody who loses by the local optimum, under no form and no accounting.",)
        return Section("Worse for somebody", text, anchor="worse")
    ranked = worse.sort_values(["increase", "event_id"], ascending=[False, True]).head(_WORST_SHOWN)
    rows = _labelled(quoted(ranked, "increase")).assign(who_label=ranked["who"].map(labels.role))
    clear = int(visible(worse).sum())
    text = (
        f"{worse['event_id'].nunique()} events have somebody who loses by the local optimum under some form and "
        f"accounting ({len(worse)} cases). In {clear} of the cases the policy changes the "
        f"followers' loss by no less than the error in it. The {len(rows)} largest increases:",
    )
    return Section("Worse for somebody", text, tables=(table_view(rows, columns),), anchor="worse")
