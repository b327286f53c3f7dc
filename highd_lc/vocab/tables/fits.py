"""Columns of what calibration leaves beside the fits: windows, what can be determined of them, summary."""

from typing import Final

from highd_lc.vocab.driver import PARAMETERS
from highd_lc.vocab.tables.columns import Column, Table, count, number, word

BELIEVED: Final = "believed"
WEAK: Final = "weak"
NOT_IDENTIFIABLE: Final = "not identifiable"
VERDICTS: Final = (BELIEVED, WEAK, NOT_IDENTIFIABLE)

FOLLOWER_TRACKS = Table(
    "follower_tracks",
    "follower that was fitted: its calibration window on the 0.1 s grid",
    ("recording_id", "event_id", "follower"),
    (
        word("event_id", "RR-VVVV-FFFFF: recording, ego, crossing frame"),
        Column("recording_id", "int64", "number in the recording's file name", minimum=0),
        Column("follower", "int64", "rank, 1 = nearest to the ego", minimum=1),
        Column("leader_x", "list<float64>", "leader's front bumper, ahead of the ego's centre at t_start [m]"),
        Column("leader_v", "list<float64>", "leader's speed [m/s]"),
        Column("x", "list<float64>", "follower's front bumper, likewise [m]"),
        Column("v", "list<float64>", "follower's speed [m/s]"),
        Column("a", "list<float64>", "follower's recorded acceleration [m/s^2]"),
    ),
)

IDENTIFIABILITY = Table(
    "identifiability",
    "LCM parameter: what a sample of fitted followers determines of it",
    ("parameter",),
    (
        word("parameter", "LCM parameter", PARAMETERS),
        count("n", "followers in the sample"),
        number(
            "width", "median width of the interval with objectives within 5 % of the best, as a share of the range"
        ),
        number("share_open", "share of followers whose interval reaches a bound", minimum=0, maximum=1),
        number("share_at_bound", "share of all fits on a bound", minimum=0, maximum=1),
        number(
            "spread",
            "median standard deviation over seeds of the GA, not polished, in the parameter's unit",
            minimum=0,
        ),
        word("partner", "parameter with which it is most correlated; empty if unknown"),
        number("correlation", "median |r| with it", minimum=0, maximum=1),
        word("verdict", "whether its values may be believed", VERDICTS),
    ),
)

POOLING = Table(
    "pooling",
    "strength of the penalty towards the other followers' median",
    ("strength",),
    (
        number("strength", "0 = own fit, infinite = everybody drives as the median"),
        count("n", "followers in the sample"),
        number(
            "held_out_mean", "mean objective on the last third of the tracks, fitted to the first two", minimum=0
        ),
        number("held_out_median", "median of the same", minimum=0),
        number(
            "share_better", "share of followers that it predicts better than their own fit", minimum=0, maximum=1
        ),
        count("folds", "folds of the cross-validation that chose it"),
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

FIT_TABLES: Final = (FOLLOWER_TRACKS, IDENTIFIABILITY, POOLING, SUMMARY_LCM)
