"""Columns of what stands beside the fits: windows, what can be determined of them, summary, the true drivers."""

from typing import Final

from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS, UNITS
from highd_lc.vocab.tables.columns import EVENT, RANK, RECORDING, VEHICLE, Column, Table, count, number, word

BELIEVED: Final = "believed"
WEAK: Final = "weak"
NOT_IDENTIFIABLE: Final = "not identifiable"
VERDICTS: Final = (BELIEVED, WEAK, NOT_IDENTIFIABLE)

FOLLOWER_TRACKS = Table(
    "follower_tracks",
    "follower that was fitted: its calibration window on the 0.1 s grid",
    ("recording_id", "event_id", "follower"),
    (
        EVENT,
        RECORDING,
        RANK,
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

TRUE: Final = "_true"
"""What stands after the name of a column of the true driver."""
TRUTH_HORIZONS: Final = (3.0, 5.0, 8.0)
"""Times after t_start at which the drivers are compared [s]."""

_CONSTANTS: Final = (
    *((name, f"parameter {name}; of an IDM its own", UNITS[name]) for name in PARAMETERS),
    ("memory_s", "time constant with which the acceleration at t_start fades", "s"),
    ("relaxation_s", "time in which the jump at a change of leader fades", "s"),
    ("moment", "share of the lateral way from which the lane changer is the leader", ""),
)

TRUTH = Table(
    "truth",
    "event, follower and model: the fitted driver beside the true one",
    ("recording_id", "event_id", "follower", "model"),
    (
        EVENT,
        RECORDING,
        RANK,
        VEHICLE,
        word("class", "Car or Truck", names.CLASSES),
        word("model", "fitted follower model (equations.md 3.11)"),
        word("true_model", "model of the true driver: lcm at once, lcm, idm"),
        Column("same_family", "bool", "whether both are of one family, so that constants can be compared"),
        word("reason", "why the true constants are null; empty where they are not"),
        word("spacing", "class of the spacing to the leader that it gets at t_start [m]"),
        word("closing", "class of its speed over that leader's at t_start [m/s]"),
        *(
            number(f"{name}{end}", f"{meaning}, {who}", unit)
            for name, meaning, unit in _CONSTANTS
            for end, who in (("", "fitted"), (TRUE, "true; the strength of the reaction is in A"))
        ),
        *(
            number(f"{name}_{horizon:g}s", f"{meaning} after {horizon:g} s; null out of view", "m/s")
            for horizon in TRUTH_HORIZONS
            for name, meaning in (
                ("change", "change of speed since t_start, fitted driver, true drift taken out"),
                (f"change{TRUE}", "the same of the true driver, simulated"),
                ("change_recorded", "the same as recorded"),
                ("error", "simulated minus recorded speed, fitted driver"),
                (f"error{TRUE}", "the same of the true driver"),
            )
        ),
    ),
)
