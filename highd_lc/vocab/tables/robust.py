"""Columns of what plans gain under several follower models or choices, in SUMO, and for unknown followers."""

from typing import Final

from highd_lc.vocab import names
from highd_lc.vocab.policy import OPTIMAL_POLICIES
from highd_lc.vocab.tables.columns import ACCOUNTING, EVENT, RECORDING, Column, Table, count, number, word
from highd_lc.vocab.tables.studies import GAIN, SEEN, TILE

EXPECTED: Final = "expected"
WORST: Final = "worst"
"""In ``robust_summary``: the mean over the models of positive skill, and the least gain over them."""

_ROBUST_KEY = (
    word("form", "fixed or free end speed", names.FORMS),
    ACCOUNTING,
    word("policy", "local optimum, plain or robust, beside the benchmark", OPTIMAL_POLICIES),
)

EVENT_GAINS = Table(
    "event_gains",
    "event of the robust sample, form, accounting and policy: gain under the models of positive skill",
    ("recording_id", "event_id", "form", "accounting", "policy"),
    (
        EVENT,
        RECORDING,
        *_ROBUST_KEY,
        count("n_models", "follower models under which nobody drives through another"),
        number("gain", "gain under the default model"),
        number("gain_expected", "mean gain over the models of positive skill, the default one among them"),
        number("gain_worst", "least gain over them"),
        word("worst_model", "the model of the least gain"),
    ),
)

ROBUST_SUMMARY = Table(
    "robust_summary",
    "form, accounting, policy and who the followers are: plain and robust local optimum on the same events",
    ("form", "accounting", "scored_with", "policy"),
    (
        *_ROBUST_KEY,
        word(
            "scored_with",
            f"a follower model or second opinion; {EXPECTED}: an event's mean gain over the models of positive "
            f"skill, {WORST}: its least one, both as means over the events",
        ),
        Column("skilful", "bool", "whether the model predicts better than the best naive one, or is the default"),
        count("n_events", "events planned with both"),
        count("n_compared", "of these, events in which nobody drives through another under any of the plans"),
        number("gain", "1 - ratio of the sums to the benchmark's; of expected and worst: mean over events"),
        number("gain_low", "lower end of the interval over recordings; null below five"),
        number("gain_high", "upper end of the interval over recordings; null below five"),
        number("beyond_plain", "mean over events of the gain beyond the plain local optimum's; negative: a cost"),
        number("beyond_low", "lower end of its interval over recordings; null below five"),
        number("beyond_high", "upper end of its interval over recordings; null below five"),
    ),
)

SITUATION_RANKING = Table(
    "situation_ranking",
    "form, policy and tile of spacing and speed difference at t_start, accounting equal: the best first by rank",
    ("form", "policy", "rank_worst"),
    (
        *(column for column in _ROBUST_KEY if column.name != "accounting"),
        *TILE,
        count("n_events", "events of the robust sample in the tile"),
        number("gain_expected", "mean over the events of the mean gain over the models of positive skill"),
        number("gain_worst", "mean over the events of the least gain over them"),
        number("share_positive", "share of the events whose least gain is above 0", minimum=0, maximum=1),
        count("rank_expected", "place by gain_expected, 1 = best"),
        count("rank_worst", "place by gain_worst, 1 = best"),
        *SEEN,
    ),
)

MULTIVERSE_LOSSES = Table(
    "multiverse_losses",
    "event of the multiverse's sample, variant and policy: fixed end speed",
    ("recording_id", "event_id", "variant", "policy"),
    (
        EVENT,
        RECORDING,
        word("variant", "name of the choice or combination; run = as in the run"),
        word("policy", "benchmark or local optimum", names.FIXED_POLICIES),
        ACCOUNTING,
        word("status", "outcome of the planner", names.PLAN_STATUSES),
        word("contact", "who drives through whom: there are no losses then; empty = nobody"),
        number("loss_av", "loss of the AV", minimum=0),
        number("loss_hv", "followers' loss", minimum=0),
        number("loss_unchanged", "loss_total of no lane change; null after a contact", minimum=0),
    ),
)

MULTIVERSE = Table(
    "multiverse",
    "variant: the same question under another defensible choice, on one sample of events, fixed end speed",
    ("variant",),
    (
        word("variant", "name of the choice or combination; run = as in the run"),
        word("kind", "run, one choice, or several at once", ("run", "choice", "combination")),
        Column("changes", "list<string>", "settings that differ from the run's, key = value"),
        word("followers", "follower model that planned and scored"),
        word("leader_from", "from when HV_1 follows the AV, where its model does not say"),
        ACCOUNTING,
        number("horizon_s", "H", "s", minimum=0),
        number("v_ref_av", "reference speed of the AV", "m/s", minimum=0),
        number("v_ref_hv", "reference speed of the followers", "m/s", minimum=0),
        word("reference", "what the reference speed means"),
        word("aggregation", "whether followers' losses are weighted"),
        number("comfort_scale", "N_c", "m/s³", minimum=0),
        number("T_max", "longest manoeuvre", "s", minimum=0),
        word("leaders", "the leaders' motion"),
        word("after", "the AV's drive after T"),
        word("handover", "whether the step onto that drive counts"),
        word("safety", "safety profile"),
        *(column for column in GAIN if column.name not in ("share_better", "share_worse")),
        number(
            "gain_incremental",
            "1 - ratio of the sums of the losses above those of no lane change; accounting equal alone",
        ),
    ),
)

ROBUST_TABLES: Final = (EVENT_GAINS, ROBUST_SUMMARY, SITUATION_RANKING, MULTIVERSE_LOSSES, MULTIVERSE)

_FOLLOWED = word("policy", "whose motion they follow, accounting equal", names.POLICIES)
_DRIVEN_BY = word("driven_by", f"who drives them: {names.SUMO}, or the follower model that planned")
_NEAREST = Column("follower", "int64", "1 = nearest to the AV at t_start", minimum=1)

SUMO_FOLLOWERS = Table(
    "sumo_followers",
    "event of the sample that is replayed in SUMO, policy that starts at t_start, who drives, and follower",
    ("recording_id", "event_id", "policy", "driven_by", "follower"),
    (
        EVENT,
        RECORDING,
        _FOLLOWED,
        _DRIVEN_BY,
        _NEAREST,
        word("contact", "who drives through whom over 0..H; empty = nobody"),
        number("loss", "the follower's loss over 0..H, without its weight", nullable=False, minimum=0),
        number("peak_decel", "its strongest braking", "m/s²", nullable=False, minimum=0),
        number(
            "speed_drop_mps",
            "the wave: most by which it falls behind its own speed without a lane change, same driver",
            "m/s",
            nullable=False,
            minimum=0,
        ),
        number("lowest_speed_mps", "its lowest speed", "m/s", nullable=False, minimum=0),
    ),
)

SUMO_SUMMARY = Table(
    "sumo_summary",
    "policy, who drives, and follower; over the events in which nobody comes to a contact, whoever drives",
    ("policy", "driven_by", "follower"),
    (
        _FOLLOWED,
        _DRIVEN_BY,
        _NEAREST,
        count("n_events", "events with that follower and a plan"),
        count("contacts", "of these, events with a contact, these followers driving: in no mean"),
        count("n_compared", "of these, events without a contact, whoever drives"),
        number("loss", "mean loss over 0..H, without weight", minimum=0),
        number("peak_decel", "mean of the strongest braking", "m/s²", minimum=0),
        number("speed_drop_mps", "mean of the speed drop behind the lane change", "m/s", minimum=0),
    ),
)

SUMO_TABLES: Final = (SUMO_FOLLOWERS, SUMO_SUMMARY)
