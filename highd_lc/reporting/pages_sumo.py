"""The replays in SUMO on the robustness page: what a lane change sends through SUMO's followers."""

from collections.abc import Iterator
from typing import Final

import pandas as pd

from highd_lc.reporting import labels
from highd_lc.reporting.pages_data import Column, Section, table_view
from highd_lc.vocab import names

_COLUMNS: Final = (
    Column("policy_label", "Policy"),
    Column("role_label", "Follower"),
    Column("driven_label", "Driven by"),
    Column("n_compared", "Events", digits=0),
    Column("contacts", "Contacts", digits=0),
    Column("loss", "Loss", digits=2),
    Column("peak_decel", "Strongest braking", "m/s²", 2),
    Column("speed_drop_mps", "Speed drop", "m/s", 2),
)
_SHOWN: Final = (names.HUMAN, names.BENCHMARK, names.LOCAL_OPTIMUM)


def sumo_sections(summary: pd.DataFrame) -> Iterator[Section]:
    """What each follower does behind each policy, in SUMO and by the model that planned; none without replays.

    summary: the artefact ``sumo_summary``.
    """
    if summary.empty:
        return
    rows = summary.assign(
        policy_label=summary["policy"].map(lambda policy: labels.POLICIES[policy].label),
        role_label=[labels.role(names.target_follower(rank)) for rank in summary["follower"]],
        driven_label=summary["driven_by"].map(labels.scored_with),
    ).sort_values(["policy_label", "follower", "driven_by"], kind="stable")
    text = (
        "Chosen events replayed in SUMO, which knows none of the follower models here: AV and leaders move along "
        "their ways, the followers drive by SUMO's own model and see the AV from its crossing on. Speed drop: by "
        "how much a follower falls behind its own speed without a lane change, at most; means over the events in "
        "which nobody comes to a contact. The gain under SUMO's followers stands among the cross scores above.",
    )
    shown = rows["policy"].isin(_SHOWN)
    yield Section(
        "The wave in SUMO",
        text,
        tables=(table_view(rows[shown], _COLUMNS),),
        folded=(table_view(rows[~shown], _COLUMNS, "Other policies"),),
        anchor="sumo",
    )
