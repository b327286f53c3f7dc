"""Columns of the fitted drivers beside the true ones of made recordings."""

from typing import Final

from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS, UNITS
from highd_lc.vocab.tables.columns import Column, Table, number, word

TRUE: Final = "_true"
"""What stands after the name of a column of the true driver."""
HORIZONS: Final = (3.0, 5.0, 8.0)
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
        word("event_id", "RR-VVVV-FFFFF: recording, ego, crossing frame"),
        Column("recording_id", "int64", "number in the recording's file name", minimum=0),
        Column("follower", "int64", "rank, 1 = nearest to the ego", minimum=1),
        Column("vehicle_id", "int64", "the vehicle's id in its recording", minimum=0),
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
            for horizon in HORIZONS
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
