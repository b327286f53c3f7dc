"""Tables for the terminal: what a run ends with."""

import numpy as np
import pandas as pd
from rich.table import Table


def matrix_table(matrix: pd.DataFrame) -> Table:
    """The validation matrix over all events: gain of the local optimum over the benchmark, with its interval."""
    table = Table(
        title="Validation matrix: gain of the local optimum over the benchmark, all events",
        caption="gain = 1 - ratio of the summed total losses; intervals by bootstrap over recordings",
    )
    for heading in ("form", "accounting"):
        table.add_column(heading)
    for heading in ("events", "infeasible", "gain", "95 % interval", "gain HV", "gain AV", "better", "worse"):
        table.add_column(heading, justify="right")
    for row in matrix[matrix["stratum"] == "all"].itertuples():
        known = not np.isnan(row.gain_low)
        interval = f"{_percent(row.gain_low)} .. {_percent(row.gain_high)}" if known else "-"
        table.add_row(
            row.form,
            row.accounting,
            str(row.n_events),
            str(row.infeasible),
            _percent(row.gain),
            interval,
            _percent(row.gain_hv),
            _percent(row.gain_av),
            _percent(row.share_better),
            _percent(row.share_worse),
        )
    return table


def lcm_table(summary: pd.DataFrame) -> Table:
    """Our fitted LCM parameters beside the paper's Table 3: quantiles and mean of all fitted followers."""
    table = Table(title="LCM parameters: ours / paper (Table 3)")
    table.add_column("parameter")
    for heading in ("fits", "25 %", "50 %", "75 %", "mean", "on a bound"):
        table.add_column(heading, justify="right")
    for row in summary[summary["group"] == "all"].itertuples():
        pairs = (
            (row.q25, row.paper_q25),
            (row.q50, row.paper_q50),
            (row.q75, row.paper_q75),
            (row.mean, row.paper_mean),
        )
        cells = [_beside(ours, paper) for ours, paper in pairs]
        table.add_row(row.quantity, str(row.n), *cells, _percent(row.share_at_bound))
    return table


def _beside(ours: float, paper: float) -> str:
    return f"{_number(ours)} / {_number(paper)}" if not np.isnan(paper) else _number(ours)


def _number(value: float) -> str:
    return "-" if np.isnan(value) else f"{value:.3g}"


def _percent(share: float) -> str:
    return "-" if np.isnan(share) else f"{100.0 * share:.2f} %"
