"""The value of perfect information about the leaders over the sampled events."""

from typing import Any

import pandas as pd

from highd_lc.algorithms.population import Bootstrap, ratio_interval
from highd_lc.vocab import names
from highd_lc.vocab.settings import StatisticsSettings
from highd_lc.vocab.study_tables import KNOWLEDGE, RECORDED
from highd_lc.vocab.tables import TABLES


def foresight_summary(foresight: pd.DataFrame, statistics: StatisticsSettings, *, seed: int) -> pd.DataFrame:
    """One row a policy and kind of knowledge. foresight: the artefact."""
    bootstrap = Bootstrap(statistics.bootstrap, statistics.confidence, seed)
    rows = []
    for policy in names.START_POLICIES:
        of_policy = foresight[foresight["policy"] == policy]
        known = of_policy[of_policy["knowledge"] == RECORDED].set_index("event_id")
        known = known[known["objective"].notna()]
        for knowledge in KNOWLEDGE if len(known) else ():
            chosen = of_policy[of_policy["knowledge"] == knowledge].set_index("event_id").reindex(known.index)
            rows.append({"policy": policy, "knowledge": knowledge, **_compared(chosen, known, bootstrap)})
    return pd.DataFrame(rows, columns=list(TABLES["foresight_summary"].column_names))


def _compared(chosen: pd.DataFrame, known: pd.DataFrame, bootstrap: Bootstrap) -> dict[str, Any]:
    found = chosen["objective"].notna()
    touching = found & chosen["touches"].eq(True)
    kept = chosen[found & ~touching]
    perfect = known.loc[kept.index]
    own, best = kept["objective"].to_numpy(), perfect["objective"].to_numpy()
    worth = ratio_interval(perfect["recording_id"].to_numpy(), best, own, bootstrap)
    return {
        "n_events": len(chosen),
        "no_plan": int((~found).sum()),
        "touching": int(touching.sum()),
        "n_compared": len(kept),
        "mean_delay_s": float(kept["delay_s"].mean()),
        "share_waiting": float((kept["delay_s"] > 0.0).mean()),
        "objective": float(own.sum()),
        "objective_recorded": float(best.sum()),
        "value_of_information": float(1.0 - best.sum() / own.sum()) if own.sum() > 0.0 else float("nan"),
        "value_low": 1.0 - worth.high,
        "value_high": 1.0 - worth.low,
    }
