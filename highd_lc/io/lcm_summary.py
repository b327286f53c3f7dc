"""The calibration's population tables: Table 3 with ours beside it, what is identifiable, what pooling brings."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from highd_lc.algorithms.identifiability import Identifiability, verdict
from highd_lc.algorithms.pooling import PoolingStudy
from highd_lc.vocab.lcm_parameters import PARAMETERS, TABLE3_MEANS, TABLE3_QUANTILES
from highd_lc.vocab.tables import TABLES

ALL = "all"
_QUALITY = (
    "objective",
    "objective_ga",
    "rmse_spacing_m",
    "rmse_speed_mps",
    "rmse_acceleration",
    "nrmse_spacing",
    "theil_u",
    "paper_j",
)
_QUANTILES = {"q25": 0.25, "q50": 0.50, "q75": 0.75}


def summarise_fits(fitted: pd.DataFrame) -> pd.DataFrame:
    """Quantiles, mean and share on a bound of each parameter and error of fit, for all and for each class.

    fitted: rows of ``followers`` with status "fitted". Without any, every value is NaN and n is 0.
    """
    groups = {ALL: fitted} | {key: rows for key, rows in fitted.groupby("class")}
    rows = [row for group, members in groups.items() for row in _rows(group, members)]
    return pd.DataFrame(rows, columns=list(TABLES["summary_lcm"].column_names))


def _rows(group: str, members: pd.DataFrame) -> Iterator[dict[str, Any]]:
    for quantity in (*PARAMETERS, *_QUALITY):
        values = members[quantity].to_numpy(np.float64)
        values = values[np.isfinite(values)]
        row = {"group": group, "quantity": quantity, "n": len(values), "share_at_bound": np.nan}
        row |= {name: _quantile(values, q) for name, q in _QUANTILES.items()}
        row["mean"] = float(values.mean()) if len(values) else np.nan
        if quantity in PARAMETERS:
            hits = [quantity in names for names in members["at_bound"]]
            row["share_at_bound"] = float(np.mean(hits)) if hits else np.nan
            row |= {f"paper_{name}": getattr(TABLE3_QUANTILES[q], quantity) for name, q in _QUANTILES.items()}
            row["paper_mean"] = getattr(TABLE3_MEANS, quantity)
        yield row


def _quantile(values: np.ndarray, q: float) -> float:
    return float(np.quantile(values, q)) if len(values) else np.nan


def identifiability_rows(study: Identifiability | None, fitted: pd.DataFrame) -> pd.DataFrame:
    """Rows of ``identifiability``; none without a study. fitted: all fitted rows of ``followers``."""
    columns = list(TABLES["identifiability"].column_names)
    if study is None:
        return pd.DataFrame(columns=columns)
    rows = []
    for j, parameter in enumerate(PARAMETERS):
        at_bound = float(np.mean([parameter in names for names in fitted["at_bound"]]))
        partner = int(study.partner[j])
        rows.append(
            {
                "parameter": parameter,
                "n": study.n,
                "width": study.width[j],
                "share_open": study.share_open[j],
                "share_at_bound": at_bound,
                "spread": study.spread[j],
                "partner": PARAMETERS[partner] if partner >= 0 else "",
                "correlation": study.correlation[j],
                "verdict": verdict(study.width[j], at_bound),
            }
        )
    return pd.DataFrame(rows, columns=columns)


def pooling_rows(study: PoolingStudy | None) -> pd.DataFrame:
    """Rows of ``pooling``; none without a study."""
    columns = list(TABLES["pooling"].column_names)
    if study is None:
        return pd.DataFrame(columns=columns)
    own = study.errors[:, 0]
    rows = [
        {
            "strength": strength,
            "n": len(errors),
            "held_out_mean": float(errors.mean()),
            "held_out_median": float(np.median(errors)),
            "share_better": float(np.mean(errors < own)),
            "folds": sum(chosen == strength for chosen in study.chosen),
        }
        for strength, errors in zip(study.strengths, study.errors.T, strict=True)
    ]
    return pd.DataFrame(rows, columns=columns)
