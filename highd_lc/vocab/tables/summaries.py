"""Columns of the summaries of a run: validation matrix, losses, safety, planners, tracking."""

from typing import Final

from highd_lc.vocab import names
from highd_lc.vocab.policy import PAIRS, ROBUST_PAIRS
from highd_lc.vocab.safety import PROFILES
from highd_lc.vocab.tables.columns import ACCOUNTING, EVENT, POLICY, RECORDING, Column, Table, count, number, word
from highd_lc.vocab.tracking import PLANTS

_FOLLOWER_MODEL = word("followers", "follower model that planned and scored; the default one first")

SPEED_CLASSES: Final = (15.0, 25.0, 33.0)
"""Edges of the ego's speed classes [m/s]."""
ADDS_NOTHING: Final = "adds_nothing"
OTHER_TIME: Final = "other_time"
NO_REFERENCE: Final = "no_reference"
INCREMENTAL_REASONS: Final = ("", ADDS_NOTHING, OTHER_TIME, NO_REFERENCE)
"""Why there is no incremental gain: the benchmark adds no loss to that of no lane change; the accounting charges
that over another time; it, or a plan, is not known."""

ADDED: Final = (
    "gain_incremental",
    "gain_incremental_low",
    "gain_incremental_high",
    "added_benchmark",
    "added_local",
    "added_hv_benchmark",
    "added_hv_local",
)
"""Columns of what the lane change adds to the losses."""

VALIDATION_MATRIX = Table(
    "validation_matrix",
    "follower model, form, accounting and stratum",
    ("followers", "form", "accounting", "stratum"),
    (
        _FOLLOWER_MODEL,
        word(
            "form",
            "fixed or free end speed; start, free_start: with a chosen start; robust, robust_free: by who knows "
            "not the followers",
            tuple(PAIRS | ROBUST_PAIRS),
        ),
        ACCOUNTING,
        word("stratum", "all, or a class of one stratification"),
        word("safety", "safety profile under which was planned (equations.md 5.8)", PROFILES),
        count("n_events", "events in the stratum, infeasible ones included"),
        count("n_recordings", "recordings in the stratum"),
        number("total_benchmark", "sum of loss_total under the benchmark"),
        number("total_local", "sum of loss_total under the local optimum"),
        number("gain", "1 - total_local / total_benchmark"),
        count("n_clusters", "recordings, or locations, with an event in the totals, over which intervals vary"),
        number("gain_low", "lower end of its interval; null below five clusters"),
        number("gain_high", "upper end of its interval; null below five clusters"),
        number(
            "gain_incremental",
            "1 - added_local / added_benchmark: what of the loss that the lane change adds is saved; null: see "
            "incremental_reason",
        ),
        number("gain_incremental_low", "lower end of its interval; null also where the benchmark may add nothing"),
        number("gain_incremental_high", "upper end of its interval"),
        word("incremental_reason", "why gain_incremental is null; empty where it is not", INCREMENTAL_REASONS),
        number("added_benchmark", "sum of loss_total above that of no_lane_change, benchmark, accounting equal"),
        number("added_local", "the same, local optimum"),
        number("added_hv_benchmark", "the followers' part of added_benchmark"),
        number("added_hv_local", "the followers' part of added_local"),
        number("share_top", "share of the sum of savings that the 5 % of events with the largest ones carry"),
        number("gain_reweighted", "gain, each event counted as often as its kind was found (equations.md 12.6)"),
        number("leader_seen_s", "mean time after t_start for which the target leader is filmed", "s", minimum=0),
        number("gain_hv", "1 - ratio of the sums of loss_hv"),
        number("gain_av", "1 - ratio of the sums of loss_av"),
        number("median_difference", "median of the paired relative difference of loss_total"),
        number("hodges_lehmann", "Hodges-Lehmann estimate of the paired relative difference"),
        number("share_differ", "share of events whose two plans differ"),
        number("share_better", "share of events with a lower total under the local optimum"),
        number("share_worse", "share of events with a higher total under the local optimum"),
        number("share_worst_follower_worse", "share of events in which some follower loses"),
        number(
            "share_observed",
            "share of the follower seconds charged to the human's motion that were recorded, not extrapolated",
            minimum=0,
            maximum=1,
        ),
        count("infeasible", "events without a feasible plan"),
        count(
            "contacts", "events in which somebody drives through another under either policy; not in the totals"
        ),
    ),
)

SAFETY_COLUMNS: Final = (
    number("tet_s", "time for which some target-lane pair has a TTC below safety.ttc_s", "s", minimum=0),
    number("tit_s2", "integral of safety.ttc_s minus TTC over that time, of all pairs", "s²", minimum=0),
    number("min_time_gap_ahead_s", "AV to its new leader, from the crossing to H; null without one", "s"),
    number("min_time_gap_behind_s", "first follower to the AV, from the crossing to H", "s"),
    number("time_gap_shortfall_s", "by how much the smaller one lacks safety.time_gap_target_s", "s", minimum=0),
    number("max_drac_ahead", "DRAC of the AV to its new leader, from the crossing to H", "m/s²", minimum=0),
    number("max_drac_behind", "DRAC of the first follower to the AV, from the crossing to H", "m/s²", minimum=0),
    number("pet_s", "post-encroachment time at the crossing, of leader and AV or AV and follower", "s"),
    number("r79_gap_m", "critical gap of UN R79 (ACSF C) at the manoeuvre's start; 0: nobody approaches", "m"),
    number("r79_margin_m", "gap from the first follower to the AV at the start beyond it", "m"),
    number("braking_asked", "braking asked of the first follower by R79 then; null: no braking would do", "m/s²"),
    number("rss_margin_ahead_m", "smallest gap of the AV beyond the RSS distance, from the crossing to H", "m"),
    number("rss_margin_behind_m", "the same of the first follower behind the AV", "m"),
)
"""Columns of ``losses`` beside the classical measures: exposure, and the lane change's own two pairs."""

SAFETY_LOSSES = Table(
    "safety_losses",
    "event of the sample, safety profile, policy and accounting",
    ("recording_id", "event_id", "safety", "policy", "accounting"),
    (
        EVENT,
        RECORDING,
        word("safety", "safety profile under which was planned", PROFILES),
        POLICY,
        ACCOUNTING,
        word("status", "outcome of the planner", names.PLAN_STATUSES),
        word("contact", "who drives through whom: there are no losses then; empty = nobody"),
        word("binding", "the constraint that forbids a lane change; empty with a plan"),
        number("loss_av", "loss of the AV", minimum=0),
        number("loss_hv", "followers' loss", minimum=0),
        number(
            "loss_unchanged", "loss_total of no lane change under that profile; null without a plan", minimum=0
        ),
        Column("violated", "list<string>", "constraints of the profile practice that the plan breaks"),
    ),
)

SAFETY_PRICE = Table(
    "safety_price",
    "form, accounting and safety profile: what the profile costs, on a sample of events",
    ("form", "accounting", "safety"),
    (
        word("form", "fixed or free end speed", names.FORMS),
        ACCOUNTING,
        word("safety", "safety profile under which was planned", PROFILES),
        count("n_events", "events in the sample"),
        count("infeasible", "of them, those without a plan under this profile"),
        count("n_both", "of them, those with plans under both profiles: what follows is of these"),
        number("total_benchmark", "sum of loss_total under the benchmark"),
        number("total_local", "sum of loss_total under the local optimum"),
        number("gain", "1 - total_local / total_benchmark"),
        number("gain_low", "lower end of the interval over recordings"),
        number("gain_high", "upper end of the interval over recordings"),
        number("gain_incremental", "1 - ratio of the sums of the losses above those of no lane change"),
    ),
)

SAFETY_VIOLATIONS = Table(
    "safety_violations",
    "safety profile, policy and constraint of the profile practice",
    ("safety", "policy", "constraint"),
    (
        word("safety", "safety profile under which was planned", PROFILES),
        POLICY,
        word("constraint", "what the profile practice asks; any = at least one of them"),
        count("n", "plans of the sample, primary accounting, without contact"),
        number("share", "share of them that break it", minimum=0, maximum=1),
    ),
)

SAFETY_TABLES: Final = (SAFETY_LOSSES, SAFETY_PRICE, SAFETY_VIOLATIONS)

SUMMARY_LOSSES = Table(
    "summary_losses",
    "follower model, policy, reference policy, accounting and quantity",
    ("followers", "policy", "against", "accounting", "quantity"),
    (
        _FOLLOWER_MODEL,
        POLICY,
        word("against", "policy it is compared with", names.POLICIES),
        ACCOUNTING,
        word("quantity", "column of losses that is compared"),
        count("n", "events with both policies feasible"),
        count("contacts", "events in which somebody drives through another under either policy: left out"),
        number("mean", "mean of the policy"),
        number("mean_against", "mean of the other policy"),
        number("ratio_of_sums", "sum of the policy over sum of the other"),
        number("median_difference", "median of the paired difference"),
        number("hodges_lehmann", "Hodges-Lehmann estimate of the paired difference"),
        number("difference_low", "lower end of the interval of the mean difference; null below five recordings"),
        number("difference_high", "upper end of the interval of the mean difference"),
        number("share_better", "share of events below the other policy"),
        number("share_worse", "share of events above the other policy"),
        number("share_tied", "share of events within the tie band"),
    ),
)

_PLANNER = word("policy", "name of the planner, as it was given")
_STATUSES = (names.SOLVED, names.CONTACT, names.INFEASIBLE, names.INFEASIBLE_AT_START, names.FAULTY)
_OF_LOSSES = ("loss_av", "av_comfort", "av_efficiency", "loss_hv", "hv_comfort", "hv_efficiency", "loss_total")

OTHER_PLANS = Table(
    "other_plans",
    "event, planner of somebody else and accounting",
    ("recording_id", "event_id", "policy", "accounting"),
    (
        EVENT,
        RECORDING,
        _PLANNER,
        ACCOUNTING,
        word("status", "solved, contact, infeasible (it says so) or faulty", _STATUSES),
        word("reason", "why there is no plan: its own words, or the fault; empty with a plan"),
        number("T", "duration of its motion; null without one", "s"),
        number("x_final", "way forward in it", "m"),
        number("v_end", "speed at its end", "m/s"),
        number("min_clearance_m", "smallest distance between ellipses over the accounted time", "m"),
        Column("violations", "list<string>", "limits and clearances that its motion breaks; nothing is rejected"),
        word("contact", "who drives through whom, over the accounted time; empty = nobody"),
        *(number(name, f"{name} as in losses", minimum=0) for name in _OF_LOSSES),
        Column(
            "loss_hv_each",
            "list<float64>",
            "loss of each follower, nearest first, without its weight; empty without one",
        ),
        number("loss_hv_increment", "loss_hv minus that of no lane change over the same time"),
        number("min_gap_m", "smallest gap of a target-lane pair", "m"),
        number("min_time_headway_s", "smallest time headway of a target-lane pair", "s"),
        number("min_ttc_s", "smallest time to collision of a target-lane pair", "s"),
        number("max_drac", "largest deceleration rate to avoid a crash", "m/s²"),
        number("peak_follower_decel", "strongest braking of a follower, positive", "m/s²"),
        word("tracking_status", "tracked on the kinematic car, or why not; empty = not driven"),
        number("rmse_lateral_m", "lateral tracking error", "m", minimum=0),
        number("max_lateral_m", "largest lateral tracking error", "m", minimum=0),
        number("loss_av_tracked", "AV's loss of the tracked motion over 0..T", minimum=0),
        Column("tracked_violations", "list<string>", "constraints that the tracked motion breaks", nullable=True),
    ),
)

LEADERBOARD = Table(
    "leaderboard",
    "policy, ours or somebody else's, accounting equal; empty without planners of others",
    ("policy",),
    (
        word("policy", "policy or planner"),
        Column("ours", "bool", "whether it is one of this package"),
        count("n_events", "events it was asked for"),
        count("n_planned", "events with a plan, be it one with a contact"),
        count("n_contacts", "of them, those in which somebody drives through another"),
        count("n_violating", "of them, those that break a limit or touch an ellipse"),
        count("n_faulty", "events in which the planner failed"),
        count("n_common", "events that every policy of the table plans without contact: the means are over these"),
        number("loss_av", "mean loss of the AV", minimum=0),
        number("loss_hv", "mean loss of the followers", minimum=0),
        number("loss_total", "mean of both together", minimum=0),
        number("min_gap_m", "mean of the smallest gap", "m"),
        number("max_drac", "mean of the largest deceleration rate to avoid a crash, where there is one", "m/s²"),
        number("peak_follower_decel", "mean of the strongest braking of a follower", "m/s²"),
        number("rmse_lateral_m", "mean lateral tracking error", "m", minimum=0),
    ),
)


TRACKING = Table(
    "tracking",
    "event, follower model, policy and plant",
    ("recording_id", "event_id", "followers", "policy", "plant"),
    (
        EVENT,
        RECORDING,
        word("followers", "follower model that planned and scored the row (equations.md 3)"),
        POLICY,
        word("plant", "kinematic bicycle or multi-body car", ("kinematic", "multi_body")),
        word("status", "tracked, or why not"),
        word("contact", "who drives through whom around the tracked motion, 0..H; empty = nobody"),
        word(
            "contact_cause",
            "tracking: the plan has none; follower_model: without a lane change too; plan: of a reference, which "
            "nothing rejects; empty = no contact",
            ("", *names.TRACKING_CAUSES),
        ),
        number("rmse_lateral_m", "lateral tracking error", "m", minimum=0),
        number("max_lateral_m", "largest lateral tracking error", "m", minimum=0),
        number("rmse_longitudinal_m", "longitudinal tracking error", "m", minimum=0),
        number("rmse_heading_rad", "heading error", "rad", minimum=0),
        number("max_slack", "largest slack of the input bounds", minimum=0),
        Column("qp_failures", "int64", "control steps whose QP was not solved; null = not driven", "", True, 0),
        number("loss_av_tracked", "AV's loss of the tracked motion over 0..T", minimum=0),
        number("loss_av_planned", "AV's loss of the planned motion over the same samples", minimum=0),
        number(
            "loss_hv_tracked",
            "followers' loss behind the tracked motion over 0..H; null after a contact",
            minimum=0,
        ),
        number("loss_hv_planned", "followers' loss behind the planned motion over 0..H", minimum=0),
        number("min_clearance_tracked_m", "smallest ellipse distance around the tracked motion, 0..H", "m"),
        number("min_clearance_planned_m", "smallest ellipse distance around the planned motion, 0..H", "m"),
        Column(
            "violations",
            "list<string>",
            "constraints that the tracked motion violates; null = not driven",
            nullable=True,
        ),
    ),
)


EVENT_PAGES = Table(
    "event_pages",
    "event with a page",
    ("recording_id", "event_id"),
    (
        EVENT,
        RECORDING,
        Column("png", "bool", "whether a PNG lies beside the page"),
        Column(
            "hv1_speed_benchmark", "list<float64>", "simulated speed of HV 1, once a second [m/s]; empty = no plan"
        ),
        Column("hv1_speed_local", "list<float64>", "the same under the local optimum [m/s]"),
        number("hv1_spacing_m", "spacing of HV 1 to the ego at t_start, front to front", "m"),
        number("hv1_speed_difference_mps", "speed of HV 1 minus the ego's at t_start", "m/s"),
    ),
)


TRACKING_SUMMARY = Table(
    "tracking_summary",
    "policy and plant",
    ("plant", "policy"),
    (
        word("policy", "whose plans are driven", names.POLICIES),
        word("plant", "kinematic bicycle (all events) or multi-body car (a sample)", PLANTS),
        count("n_driven", "plans driven"),
        count("not_driven", "events without a plan, or with one that cannot be driven; not in what follows"),
        count("lost", "of the plans driven, those whose car leaves its lane or falls behind"),
        count("softened", "of them, those that softened the bounds of the input"),
        count("qp_failures", "control steps whose QP was not solved, all together"),
        number("rmse_lateral_median_m", "median over plans of the lateral RMSE", "m", minimum=0),
        number("rmse_lateral_largest_m", "largest lateral RMSE", "m", minimum=0),
        number("max_lateral_m", "largest lateral error of any plan at any moment", "m", minimum=0),
        *(
            number(f"loss_{side}_{motion}", f"mean loss of the {who}, {motion} motion over {time}", minimum=0)
            for side, who, time in (("av", "AV", "0..T"), ("hv", "followers", "0..H"))
            for motion in ("planned", "tracked")
        ),
        number("share_violating", "share of them whose tracked motion breaks a constraint", minimum=0, maximum=1),
        count(
            "contacts", "of the plans driven, those around whose tracked motion somebody drives through another"
        ),
        number("share_touching", "share of them whose tracked ellipse touches another", minimum=0, maximum=1),
        number("share_touching_planned", "the same of the planned motion, at its samples", minimum=0, maximum=1),
    ),
)

TRACKING_CONTACTS = Table(
    "tracking_contacts",
    "follower model, plant, pair and cause of the contacts of tracked drives (equations.md 5.3)",
    ("followers", "plant", "contact", "cause"),
    (
        word("followers", "follower model that planned and scored"),
        word("plant", "kinematic bicycle or multi-body car", PLANTS),
        word("contact", "who drives through whom, over 0..H"),
        word("cause", "of tracking.contact_cause", names.TRACKING_CAUSES),
        count("n_events", "events with it"),
        count("n_plans", "drives with it, of plans that a search chose"),
        count("n_references", "drives with it, of references: human, constant"),
    ),
)
