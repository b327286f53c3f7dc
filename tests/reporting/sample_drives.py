"""Rows of ``closed_loop`` for tests of pages: who touches whom, who turns back, who never begins."""

from typing import Any

import pandas as pd

from highd_lc.vocab import names
from highd_lc.vocab.tables import TABLES

COLUMNS = list(TABLES["closed_loop"].column_names)


def row(event: str, policy: str, causes: tuple[str, ...] = (), **changes: Any) -> dict[str, Any]:
    """A drive of an event, with causes of its contacts."""
    base: dict[str, Any] = dict.fromkeys(COLUMNS, 1.0) | {
        "event_id": event,
        "recording_id": 1,
        "policy": policy,
        "reason": "",
    }
    base |= {"followers": "population", "world": "population", "leaders": "constant_speed", "aborted": False}
    base |= {"status": names.CHANGED, "contacts": len(causes), "contact_cause": list(causes), "regret": 0.25}
    base["contact_reason"] = [names.BY_RECORDING if policy == names.HUMAN else names.BY_LEADERS] * len(causes)
    return base | changes


DRIVES = pd.DataFrame(
    [
        row("01-0001-00001", names.BENCHMARK_REPLANNED),
        row("01-0001-00001", names.LOCAL_OPTIMUM_REPLANNED, ("clearance_target_leader",), regret=float("nan")),
        row("01-0001-00001", names.HUMAN, ("target_follower_1_through_ego",), status="recorded", regret=None),
        row(
            "01-0002-00002",
            names.BENCHMARK_REPLANNED,
            status=names.ABORTED,
            aborted=True,
            reason="time_gap_behind",
        ),
        row("01-0002-00002", names.LOCAL_OPTIMUM_REPLANNED, status=names.NEVER_BEGUN, reason="insertion_gap"),
        row("01-0002-00002", names.HUMAN, status="recorded"),
    ],
    columns=COLUMNS,
)
