"""Columns of what the population is judged by beside the matrix: cross scores, maps and studies on a sample."""

from typing import Final

from highd_lc.vocab import names
from highd_lc.vocab.policy import CHOOSING_START, OPTIMAL_POLICIES, PAIRS, ROBUST_PAIRS
from highd_lc.vocab.tables.columns import ACCOUNTING, EVENT, RECORDING, Column, Table, count, number, word
from highd_lc.vocab.tables.summaries import TRACKING_CONTACTS, TRACKING_SUMMARY

IDM_MOTORWAY: Final = "idm_motorway"
DRAWN: Final = "drawn"
SECOND_OPINIONS: Final = (IDM_MOTORWAY, DRAWN)
"""Who the followers are when a plan is scored, beside the follower models: IDM drivers on a motorway, all alike;
parameters drawn within the spread of those that planned.
"""

_PEAKLESS: Final = " and ".join(SECOND_OPINIONS)

FRONT: Final = "front"
SWEEP: Final = "sweep"

TOGETHER: Final = "together"
"""In ``worse_for_somebody``: AV and followers together, not one follower."""

_FORM = word("form", "fixed or free end speed", tuple(PAIRS | ROBUST_PAIRS))
_FOLLOWER_MODEL = word("followers", "follower model that planned and scored; the default one first")
_OMEGA = number("omega_av", "weight of the AV in the joint objective", minimum=0, maximum=1)

GAIN = (
    count("n_events", "events, infeasible ones included"),
    count("n_recordings", "recordings with such an event"),
    count("infeasible", "events without a feasible plan of either policy; not in the totals"),
    count("contacts", "events in which somebody drives through another under either policy; not in the totals"),
    number("total_benchmark", "sum of loss_total under the benchmark"),
    number("total_local", "sum of loss_total under the local optimum"),
    number("gain", "1 - total_local / total_benchmark"),
    number("gain_low", "lower end of the interval over recordings; null below five"),
    number("gain_high", "upper end of the interval over recordings; null below five"),
    number("gain_av", "1 - ratio of the sums of the AV's loss"),
    number("gain_hv", "1 - ratio of the sums of the followers' loss"),
    number("share_better", "share of events with a lower total under the local optimum"),
    number("share_worse", "share of events with a higher total under the local optimum"),
)

TILE = (
    number("spacing_low_m", "lower edge: spacing of the first follower to the AV, front to front", "m"),
    number("spacing_high_m", "upper edge; null = open", "m"),
    number("closing_low_mps", "lower edge: speed of the first follower minus the AV's; null = open", "m/s"),
    number("closing_high_mps", "upper edge; null = open", "m/s"),
)

SEEN = (
    number("effect", "mean absolute change of loss_hv_in_view by the policy; null out of view", minimum=0),
    number("error", "mean absolute error of the model in loss_hv_in_view, over the same events", minimum=0),
    number("error_over_effect", "error / effect: above 1 the gain cannot be seen; null: not known, or no effect"),
)

_PLANNED_WITH = word("planned_with", "follower model that made the plans")
_SCORED_WITH = word(
    "scored_with",
    f"who the followers are when the plans are scored: a follower model, {IDM_MOTORWAY} (all of them IDM drivers "
    f"on a motorway), {DRAWN} (parameters drawn within the spread of those that planned; means over the draws), "
    f"or {names.SUMO} (driven by SUMO, on a sample)",
)

CROSS_LOSSES = Table(
    "cross_losses",
    "event, optimal policy, accounting that it minimised, and follower models that planned and that score",
    ("recording_id", "event_id", "policy", "accounting", "planned_with", "scored_with"),
    (
        EVENT,
        RECORDING,
        word("policy", "whose plan is scored", OPTIMAL_POLICIES),
        word("accounting", "accounting under which the plan was optimised", names.ACCOUNTINGS),
        _PLANNED_WITH,
        _SCORED_WITH,
        *(number(f"av_to_{end}", f"AV's loss charged to {end}", minimum=0) for end in ("T", "H")),
        *(
            number(f"hv_to_{end}", f"followers' loss charged to {end}; null after a contact", minimum=0)
            for end in ("T", "H")
        ),
        *(
            count(
                f"contacts_to_{end}",
                f"1 = somebody drives through another up to {end}; drawn: draws in which somebody does, under "
                "this policy or its counterpart; left out of the loss",
            )
            for end in ("T", "H")
        ),
        *(
            number(
                f"peak_to_{end}",
                f"strongest braking of any follower up to {end}; null of {_PEAKLESS}",
                "m/s²",
                minimum=0,
            )
            for end in ("T", "H")
        ),
        Column("contact_after_T", "bool", "whether ellipses overlap between T and H, as planned", "", True),
    ),
)

CROSS_SCORES = Table(
    "cross_scores",
    "form, follower models that planned and that score, accounting optimised and accounting scored",
    ("planned_with", "form", "optimised", "scored", "scored_with"),
    (
        _FORM,
        _PLANNED_WITH,
        _SCORED_WITH,
        word("optimised", "accounting under which the plans were optimised", names.ACCOUNTINGS),
        word("scored", "accounting under which they are scored", names.ACCOUNTINGS),
        *GAIN,
        count("touching", "events in which a plan's ellipse overlaps another after T, within the scored time"),
        *(
            number(
                f"peak_{name}",
                f"mean over events without a contact of the followers' strongest braking under the {words}",
                "m/s²",
                minimum=0,
            )
            for name, words in (("benchmark", "benchmark"), ("local", "local optimum"))
        ),
    ),
)

GAIN_MAP = Table(
    "gain_map",
    "follower model, form, accounting and tile of spacing and speed difference at t_start",
    ("followers", "form", "accounting", "spacing_low_m", "closing_low_mps"),
    (
        _FOLLOWER_MODEL,
        _FORM,
        ACCOUNTING,
        *TILE,
        number("share_events", "share of all events: the density of real lane changes", minimum=0, maximum=1),
        *GAIN,
        *SEEN,
    ),
)

LEAVE_ONE_OUT = Table(
    "leave_one_out",
    "follower model, form, accounting and location left out",
    ("followers", "form", "accounting", "location_id"),
    (
        _FOLLOWER_MODEL,
        _FORM,
        ACCOUNTING,
        Column("location_id", "int64", "site whose recordings are left out"),
        count("n_left_out", "events of that site"),
        *GAIN,
    ),
)

WORSE_FOR_SOMEBODY = Table(
    "worse_for_somebody",
    "event, follower model, form, accounting and who loses by the local optimum",
    ("followers", "recording_id", "event_id", "form", "accounting", "who"),
    (
        EVENT,
        RECORDING,
        _FOLLOWER_MODEL,
        _FORM,
        ACCOUNTING,
        word("who", "the follower's role, or together: AV and followers"),
        number("loss_benchmark", "their loss under the benchmark, unweighted for one follower", minimum=0),
        number("loss_local", "their loss under the local optimum", minimum=0),
        number("increase", "loss_local / loss_benchmark - 1", minimum=0),
        number("error", "absolute error of the model in loss_hv_in_view; null out of view", minimum=0),
        number("error_over_effect", "error over the change of loss_hv_in_view: above 1 unseen", minimum=0),
    ),
)

HORIZON_LOSSES = Table(
    "horizon_losses",
    "event of the sample, accounted time H, form and accounting",
    ("recording_id", "event_id", "horizon_s", "form", "accounting"),
    (
        EVENT,
        RECORDING,
        number("horizon_s", "H; plans are at most as long", "s", nullable=False, minimum=0),
        _FORM,
        ACCOUNTING,
        *(
            number(f"loss_{side}_{policy}", f"{label}'s loss under the {words}; null if infeasible", minimum=0)
            for policy, words in (("benchmark", "benchmark"), ("local", "local optimum"))
            for side, label in (("av", "AV"), ("hv", "followers"))
        ),
    ),
)

HORIZON_SENSITIVITY = Table(
    "horizon_sensitivity",
    "accounted time H, form and accounting, over the events of the sample",
    ("horizon_s", "form", "accounting"),
    (number("horizon_s", "H", "s", nullable=False, minimum=0), _FORM, ACCOUNTING, *GAIN),
)

_FREE_FORM = word("form", "free end speed, at t_start or with a chosen start", (names.FREE, names.FREE_START))

PARETO = Table(
    "pareto",
    "event of the sample, form, and plan on its front or optimum of a weight of the AV",
    ("recording_id", "event_id", "form", "kind", "point"),
    (
        EVENT,
        RECORDING,
        _FREE_FORM,
        word("kind", "front: NSGA-II's non-dominated plans; sweep: global optima over omega_AV", (FRONT, SWEEP)),
        count("point", "number of the point: by rising loss of the AV on the front, by omega_AV in the sweep"),
        _OMEGA,
        number("T", "duration of the manoeuvre", "s"),
        number("x_final", "forward distance at T", "m"),
        number("v_end", "speed at T", "m/s"),
        number("delay_s", "wait before the manoeuvre", "s", minimum=0),
        word("gap", "where the AV goes"),
        number("loss_av", "AV's loss, accounting equal", minimum=0),
        number("loss_hv", "followers' loss, accounting equal", minimum=0),
        Column("knee", "bool", "whether it is the knee of the front"),
    ),
)

PARETO_SUMMARY = Table(
    "pareto_summary",
    "event of the sample and form",
    ("recording_id", "event_id", "form"),
    (
        EVENT,
        RECORDING,
        _FREE_FORM,
        count("n_front", "plans on NSGA-II's front; 0 = no feasible plan"),
        count("evaluations", "plans simulated by NSGA-II"),
        number("hypervolume", "of NSGA-II's front, as a share of the box from the ideal to the reference point"),
        number("reference_av", "reference point: 1.1 times the worst loss of the AV on front or sweep"),
        number("reference_hv", "reference point: 1.1 times the worst loss of the followers"),
        number("hypervolume_sweep", "the same of the sweep over omega_AV"),
        number("front_behind", "most by which the front's best joint objective exceeds the sweep's, relative"),
        number("front_ahead", "most by which it falls below the sweep's, relative", minimum=0),
        number("knee_loss_av", "AV's loss at the knee; null if the front has no bend"),
        number("knee_loss_hv", "followers' loss at the knee"),
        number("knee_omega_low", "the knee is optimal from this weight of the AV on; null if for no weight"),
        number("knee_omega_high", "the knee is optimal up to this weight of the AV"),
    ),
)

UNCERTAINTY = Table(
    "uncertainty",
    "event of the sample, form and accounting",
    ("recording_id", "event_id", "form", "accounting"),
    (
        EVENT,
        RECORDING,
        _FORM,
        ACCOUNTING,
        count("n_replanned", "draws of the followers' parameters with a feasible plan of both policies"),
        count("infeasible", "draws without"),
        number("gain", "gain with the parameters as fitted"),
        number("gain_mean", "mean gain over draws, planned and scored with the drawn parameters"),
        number("gain_low", "lowest gain over these draws"),
        number("gain_high", "highest gain over these draws"),
        number("share_better", "share of these draws in which the local optimum's total is lower"),
        number("share_worse", "share of these draws in which it is higher"),
        count("n_kept", "draws under which the plans made with the fitted parameters are scored"),
        count("contacts", "further draws under which somebody drives through another then: left out"),
        number("gain_kept_mean", "mean gain over those draws"),
        number("share_kept_better", "share of those draws in which the local optimum's total is lower"),
        number("share_kept_worse", "share of those draws in which it is higher"),
        number("T_deviation", "standard deviation over draws of the local optimum's T", "s"),
        number("spread_known", "share of the event's followers whose fit has a spread", minimum=0, maximum=1),
    ),
)

RECORDED: Final = "recorded"
PREDICTED: Final = "predicted"
REPLANNED: Final = "replanned"
KNOWLEDGE: Final = (RECORDED, PREDICTED, REPLANNED)
"""What the AV knows of the leaders: recorded motion; constant speed from t_start; that, every 0.5 s anew."""

_KNOWLEDGE = word("knowledge", "the leaders' motion as the AV knows it", KNOWLEDGE)

FORESIGHT = Table(
    "foresight",
    "event of the sample, policy with a chosen start, and knowledge; accounting equal, fixed form",
    ("recording_id", "event_id", "policy", "knowledge"),
    (
        EVENT,
        RECORDING,
        word("policy", "whose start is chosen", PAIRS[names.START]),
        _KNOWLEDGE,
        number("delay_s", "wait before the manoeuvre; null if no plan was found", "s", minimum=0),
        word("gap", "where the AV goes; empty if no plan was found"),
        number("T", "duration of the manoeuvre", "s"),
        number("loss_av", "AV's loss among the recorded leaders", minimum=0),
        number("loss_hv", "followers' loss among the recorded leaders", minimum=0),
        number("objective", "the joint objective of the policy among the recorded leaders", minimum=0),
        Column("touches", "bool", "whether ellipses overlap among the recorded leaders"),
        count("plannings", "how many times a plan was made"),
    ),
)

FORESIGHT_SUMMARY = Table(
    "foresight_summary",
    "policy with a chosen start, and knowledge",
    ("policy", "knowledge"),
    (
        word("policy", "whose start is chosen", PAIRS[names.START]),
        _KNOWLEDGE,
        count("n_events", "events of the sample with a plan under recorded leaders"),
        count("no_plan", "of these, events in which no plan was found with this knowledge"),
        count("touching", "of these, events in which the plan touches somebody among the recorded leaders"),
        count("n_compared", "of these, events with a plan that touches nobody"),
        number("mean_delay_s", "mean wait over the compared events", "s"),
        number("share_waiting", "share of the compared events with a wait", minimum=0, maximum=1),
        number("objective", "sum of the objective over the compared events"),
        number("objective_recorded", "the same events under recorded leaders"),
        number("value_of_information", "1 - objective_recorded / objective: what knowing the leaders is worth"),
        number("value_low", "lower end of its interval over recordings; null below five"),
        number("value_high", "upper end of its interval over recordings; null below five"),
    ),
)

START_MAP = Table(
    "start_map",
    "policy with a chosen start, accounting, and tile of spacing and speed difference (both null: all events)",
    ("policy", "accounting", "spacing_low_m", "closing_low_mps"),
    (
        word("policy", "whose start is chosen", CHOOSING_START),
        ACCOUNTING,
        *TILE,
        number("share_events", "share of these events: the density of real lane changes", minimum=0, maximum=1),
        count("n_events", "events with a plan, with and without the choice"),
        number("share_waiting", "share of them in which the AV waits", minimum=0, maximum=1),
        number("share_other_gap", "share of them in which it takes another gap", minimum=0, maximum=1),
        number("mean_delay_s", "mean wait", "s", minimum=0),
        number("saved_objective", "1 - objective over that of the policy without the choice, sums"),
        number("saved_av", "the same of the AV's loss: negative = the choice costs it"),
        number("saved_hv", "the same of the followers' loss"),
        number("saved_total", "the same of the total loss"),
        *SEEN,
    ),
)

SOLVER_COMPARISON = Table(
    "solver_comparison",
    "event of the sample, form, accounting and weight of the AV",
    ("recording_id", "event_id", "form", "accounting", "omega_av"),
    (
        EVENT,
        RECORDING,
        _FORM,
        ACCOUNTING,
        _OMEGA,
        number("objective", "joint objective found by the global search", minimum=0),
        number("objective_sqp", "best found by SLSQP from all starts; null if none is feasible", minimum=0),
        number("objective_single", "found by SLSQP from its first start; null if infeasible", minimum=0),
        number("excess_sqp", "objective_sqp / objective - 1; null if infeasible"),
        number("excess_single", "objective_single / objective - 1; null if infeasible"),
        number("T", "duration found by the global search", "s"),
        number("T_sqp", "duration found by SLSQP", "s"),
        count("starts", "starts of SLSQP"),
        count("feasible_starts", "starts that ended in a feasible plan"),
        count("evaluations", "points at which SLSQP asked for the objective"),
    ),
)

SOLVER_SUMMARY = Table(
    "solver_summary",
    "form and weight of the AV",
    ("form", "omega_av"),
    (
        _FORM,
        _OMEGA,
        count("n", "cases compared"),
        *(
            number(f"share_{solver}_{name}", f"share of cases in which {words} is {level}", minimum=0, maximum=1)
            for solver, words in (("sqp", "SLSQP from all starts"), ("single", "SLSQP from one start"))
            for name, level in (
                ("failed", "infeasible"),
                ("worse_1", "more than 1 % worse than the global search, or infeasible"),
                ("worse_01", "more than 0.1 % worse, or infeasible"),
                ("better_01", "more than 0.1 % better"),
            )
        ),
        number("excess_sqp_max", "largest excess of SLSQP from all starts over the global search"),
        number("excess_sqp_min", "smallest one; below 0: SLSQP found a better plan"),
    ),
)


STUDY_TABLES: Final = (
    TRACKING_SUMMARY, TRACKING_CONTACTS, CROSS_LOSSES, CROSS_SCORES, GAIN_MAP, LEAVE_ONE_OUT,
    WORSE_FOR_SOMEBODY, HORIZON_LOSSES, HORIZON_SENSITIVITY, PARETO, PARETO_SUMMARY, UNCERTAINTY, FORESIGHT,
    FORESIGHT_SUMMARY, START_MAP, SOLVER_COMPARISON, SOLVER_SUMMARY,
)  # fmt: skip
