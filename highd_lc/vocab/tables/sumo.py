"""Columns of the replays in SUMO: what its followers do behind each plan, beside the planning model's."""

from typing import Final

from highd_lc.vocab import names
from highd_lc.vocab.tables.columns import Column, Table, count, number, word

_POLICY = word("policy", "whose motion they follow, accounting equal", names.POLICIES)
_DRIVEN_BY = word("driven_by", f"who drives them: {names.SUMO}, or the follower model that planned")
_RANK = Column("follower", "int64", "1 = nearest to the AV at t_start", minimum=1)

SUMO_FOLLOWERS = Table(
    "sumo_followers",
    "event of the sample that is replayed in SUMO, policy that starts at t_start, who drives, and follower",
    ("recording_id", "event_id", "policy", "driven_by", "follower"),
    (
        word("event_id", "RR-VVVV-FFFFF: recording, ego, crossing frame"),
        Column("recording_id", "int64", "number in the recording's file name", minimum=0),
        _POLICY,
        _DRIVEN_BY,
        _RANK,
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
        _POLICY,
        _DRIVEN_BY,
        _RANK,
        count("n_events", "events with that follower and a plan"),
        count("contacts", "of these, events with a contact, these followers driving: in no mean"),
        count("n_compared", "of these, events without a contact, whoever drives"),
        number("loss", "mean loss over 0..H, without weight", minimum=0),
        number("peak_decel", "mean of the strongest braking", "m/s²", minimum=0),
        number("speed_drop_mps", "mean of the speed drop behind the lane change", "m/s", minimum=0),
    ),
)

SUMO_TABLES: Final = (SUMO_FOLLOWERS, SUMO_SUMMARY)
