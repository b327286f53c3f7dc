"""Columns of what a run comes to: the validation matrix and the summaries of fits and losses."""

from highd_lc.vocab import names
from highd_lc.vocab.columns import Table, count, number, word

_POLICY = word("policy", "who planned the motion (SPEC section 6)", names.POLICIES)
_FORMS = (*names.FORMS, *names.START_FORMS)
_ACCOUNTING = word("accounting", "over which time each side is charged", names.ACCOUNTINGS)

VALIDATION_MATRIX = Table(
    "validation_matrix",
    "form, accounting and stratum",
    ("form", "accounting", "stratum"),
    (
        word("form", "fixed or free end speed; start, free_start: with a chosen start", _FORMS),
        _ACCOUNTING,
        word("stratum", "all, or a class of one stratification"),
        count("n_events", "events in the stratum, infeasible ones included"),
        count("n_recordings", "recordings in the stratum"),
        number("total_benchmark", "sum of loss_total under the benchmark"),
        number("total_local", "sum of loss_total under the local optimum"),
        number("gain", "1 - total_local / total_benchmark"),
        number("gain_low", "lower end of the bootstrap interval over recordings"),
        number("gain_high", "upper end of the bootstrap interval over recordings"),
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

SUMMARY_LCM = Table(
    "summary_lcm",
    "LCM parameter and group",
    ("group", "quantity"),
    (
        word("group", "all, or a vehicle class"),
        word("quantity", "LCM parameter or quality of fit"),
        count("n", "fitted followers"),
        *(number(q, f"{label} of ours") for q, label in (("q25", "25 %"), ("q50", "median"), ("q75", "75 %"))),
        number("mean", "mean of ours"),
        number("share_at_bound", "share of fits with the parameter on a bound", minimum=0, maximum=1),
        *(number(f"paper_{q}", "published value (Table 3)") for q in ("q25", "q50", "q75", "mean")),
    ),
)

SUMMARY_LOSSES = Table(
    "summary_losses",
    "policy, reference policy, accounting and quantity",
    ("policy", "against", "accounting", "quantity"),
    (
        _POLICY,
        word("against", "policy it is compared with", names.POLICIES),
        _ACCOUNTING,
        word("quantity", "column of losses that is compared"),
        count("n", "events with both policies feasible"),
        count("contacts", "events in which somebody drives through another under either policy: left out"),
        number("mean", "mean of the policy"),
        number("mean_against", "mean of the other policy"),
        number("ratio_of_sums", "sum of the policy over sum of the other"),
        number("median_difference", "median of the paired difference"),
        number("hodges_lehmann", "Hodges-Lehmann estimate of the paired difference"),
        number("difference_low", "lower end of the bootstrap interval of the mean difference"),
        number("difference_high", "upper end of the bootstrap interval of the mean difference"),
        number("share_better", "share of events below the other policy"),
        number("share_worse", "share of events above the other policy"),
        number("share_tied", "share of events within the tie band"),
    ),
)
