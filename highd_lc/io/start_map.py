"""Who waits, where and for what: over spacing and speed difference of the first follower at t_start."""

from itertools import pairwise
from typing import Any

import pandas as pd

from highd_lc.io.population_tables import CLOSING_EDGES, SPACING_EDGES, edges_of, within
from highd_lc.vocab import names
from highd_lc.vocab.tables import TABLES

CONTAINED = {
    names.BENCHMARK_START: names.BENCHMARK,
    names.LOCAL_OPTIMUM_START: names.LOCAL_OPTIMUM,
    names.BENCHMARK_FREE_START: names.BENCHMARK_FREE,
    names.LOCAL_OPTIMUM_FREE_START: names.LOCAL_OPTIMUM_FREE,
}
"""Of each policy that chooses its start, the one without that choice."""
_LOSSES = ("loss_av", "loss_hv", "loss_total")


def start_map(events: pd.DataFrame, plans: pd.DataFrame, losses: pd.DataFrame) -> pd.DataFrame:
    """Waiting and its price in every tile that holds an event whose start was chosen, and in all of them together.

    events: see ``statistics.situations``; plans, losses: the artefacts. Events count where the policy has a plan
    with and without the choice.
    """
    rows = []
    for policy, contained in CONTAINED.items():
        for accounting in names.ACCOUNTINGS:
            pair = _pair(plans, losses, policy, contained, accounting)
            if pair.empty:
                continue
            about = {"policy": policy, "accounting": accounting}
            rows.append(about | _tile(pair))
            at = events.loc[pair.index, ["spacing_m", "closing_mps"]]
            for spacing in pairwise(SPACING_EDGES):
                for closing in pairwise(CLOSING_EDGES):
                    inside = within(at["spacing_m"], spacing) & within(at["closing_mps"], closing)
                    if inside.any():
                        share = {"share_events": float(inside.mean())}
                        rows.append(about | edges_of(spacing, closing) | _tile(pair[inside]) | share)
    return pd.DataFrame(rows, columns=list(TABLES["start_map"].column_names))


def _pair(plans: pd.DataFrame, losses: pd.DataFrame, policy: str, contained: str, accounting: str) -> pd.DataFrame:
    of = [table[table["accounting"] == accounting] for table in (plans, losses)]
    start = of[0][of[0]["policy"] == policy].set_index("event_id")[["delay_s", "gap", "objective"]]
    without = of[0][of[0]["policy"] == contained].set_index("event_id")[["objective"]]
    pair = start.join(without.add_suffix("_0"), how="inner")
    for suffix, name in (("", policy), ("_0", contained)):
        own = of[1][of[1]["policy"] == name].set_index("event_id")[list(_LOSSES)]
        pair = pair.join(own.add_suffix(suffix), how="inner")
    return pair.dropna(subset=["objective", "objective_0"])


def _tile(pair: pd.DataFrame) -> dict[str, Any]:
    waiting = pair["delay_s"] > 0.0
    row = {
        "share_events": 1.0,
        "n_events": len(pair),
        "share_waiting": float(waiting.mean()),
        "share_other_gap": float((pair["gap"] != names.RECORDED_GAP).mean()),
        "mean_delay_s": float(pair["delay_s"].mean()),
    }
    for name in ("objective", *_LOSSES):
        ratio = pair[name].sum() / pair[f"{name}_0"].sum()
        row[f"saved_{name.removeprefix('loss_')}"] = float(1.0 - ratio)
    return row
