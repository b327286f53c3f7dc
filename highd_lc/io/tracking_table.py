"""What tracking makes of the plans: planned against tracked by policy and plant."""

from collections.abc import Iterable
from typing import Any

import pandas as pd

from highd_lc.vocab import names
from highd_lc.vocab.tables import TABLES
from highd_lc.vocab.tracking import LOST, PLANTS, SOFTENED

_LOSSES = ("loss_av_planned", "loss_av_tracked", "loss_hv_planned", "loss_hv_tracked")


def tracking_summary(tracking: pd.DataFrame) -> pd.DataFrame:
    """One row a policy and plant. tracking: the artefact."""
    rows = []
    for plant in PLANTS:
        for policy in names.POLICIES:
            found = tracking[(tracking["plant"] == plant) & (tracking["policy"] == policy)]
            if len(found):
                rows.append({"policy": policy, "plant": plant, **_figures(found)})
    return pd.DataFrame(rows, columns=list(TABLES["tracking_summary"].column_names))


def _figures(found: pd.DataFrame) -> dict[str, Any]:
    driven = found[found["rmse_lateral_m"].notna()]
    lists = driven["violations"]
    return {
        "n_driven": len(driven),
        "not_driven": len(found) - len(driven),
        "lost": int((driven["status"] == LOST).sum()),
        "softened": int((driven["status"] == SOFTENED).sum()),
        "qp_failures": int(driven["qp_failures"].sum()),
        "rmse_lateral_median_m": float(driven["rmse_lateral_m"].median()),
        "rmse_lateral_largest_m": float(driven["rmse_lateral_m"].max()),
        "max_lateral_m": float(driven["max_lateral_m"].max()),
        **{name: float(driven[name].mean()) for name in _LOSSES},
        "share_violating": _share(len(broken) > 0 for broken in lists),
        "contacts": int(driven["contact"].ne("").sum()),
        "share_touching": _share(any(name.startswith("clearance_") for name in broken) for broken in lists),
        "share_touching_planned": _share(driven["min_clearance_planned_m"] < 0.0),
    }


def _share(cases: Iterable[bool]) -> float:
    """Share of the cases that hold; NaN of none."""
    known = list(cases)
    return sum(known) / len(known) if known else float("nan")
