"""Who waits, where and for what: over spacing and speed difference of the first follower at t_start."""

from typing import Any

import pandas as pd

from highd_lc.io.population_tables import tiles
from highd_lc.io.statistics import PolicyLosses
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


def start_map(events: pd.DataFrame, plans: pd.DataFrame, losses: PolicyLosses) -> pd.DataFrame:
    """Waiting and its price in every tile that holds an event whose start was chosen, and in all of them together.

    events: see ``statistics.situations``; plans: the artefact. Events count where the policy has a plan
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
            for edges, inside in tiles(events.loc[pair.index]):
                share = {"share_events": len(inside) / len(pair)}
                rows.append(about | edges | _tile(pair.iloc[inside]) | share)
    return pd.DataFrame(rows, columns=list(TABLES["start_map"].column_names))


def _pair(plans: pd.DataFrame, losses: PolicyLosses, policy: str, contained: str, accounting: str) -> pd.DataFrame:
    of_accounting = plans[plans["accounting"] == accounting]
    start, without = (of_accounting[of_accounting["policy"] == name] for name in (policy, contained))
    pair = start.set_index("event_id")[["delay_s", "gap", "objective"]]
    pair = pair.join(without.set_index("event_id")[["objective"]].add_suffix("_0"), how="inner")
    for suffix, name in (("", policy), ("_0", contained)):
        pair = pair.join(losses.of(accounting, name)[list(_LOSSES)].add_suffix(suffix), how="inner")
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
