"""Figure of the choice of the start: who waits, over spacing and speed difference, and what it saves."""

from typing import Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import Normalize, TwoSlopeNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

from highd_lc.reporting import labels
from highd_lc.reporting.drawing import DARK, INK, QUIET
from highd_lc.reporting.plain_axes import SIZE, colour_bar, panels
from highd_lc.vocab import names

FloatArray = NDArray[np.float64]

_PANELS: Final = (("share_waiting", "events that wait [%]"), ("saved_objective", "saved of what it minimises [%]"))
_COLOUR_MAPS: Final = {"share_waiting": "Blues", "saved_objective": "PuOr"}


def start_figure(tiles: pd.DataFrame, accounting: str = names.PRIMARY_ACCOUNTING) -> Figure:
    """Rows: self-optimum and local optimum; columns: share of events that wait, and what the choice saves them.

    tiles: ``start_map``. Numbers in the tiles are events: the density of real lane changes.
    """
    chosen = tiles[(tiles["accounting"] == accounting) & tiles["spacing_low_m"].notna()]
    figure, grid = panels(10.4, 6.6, rows=2, columns=2)
    for row, policy in zip(grid, names.START_POLICIES, strict=True):
        of_policy = chosen[chosen["policy"] == policy]
        for axes, (column, label) in zip(row, _PANELS, strict=True):
            _tiles(figure, axes, of_policy, column=column, label=label)
            axes.set_title(labels.POLICIES[policy].label, fontsize=SIZE, color=INK, loc="left")
    return figure


def _tiles(figure: Figure, axes: Axes, tiles: pd.DataFrame, *, column: str, label: str) -> None:
    spacing = tiles["spacing_low_m"].to_numpy(float)
    # Open edges have no number: they are the lowest of the speed differences.
    closing = tiles["closing_low_mps"].fillna(-np.inf).to_numpy(float)
    x, y = np.unique(spacing), np.unique(closing)
    values, counts = np.full((y.size, x.size), np.nan), np.zeros((y.size, x.size), int)
    at = np.searchsorted(y, closing), np.searchsorted(x, spacing)
    values[at], counts[at] = 100.0 * tiles[column].to_numpy(float), tiles["n_events"].to_numpy(int)
    # A share has its whole scale, and a saving of less than 1 % is not drawn as if it were large.
    share = column == "share_waiting"
    largest = 100.0 if share else max(float(np.nanmax(np.abs(values))), 1.0) if values.size else 1.0
    norm = Normalize(0.0, largest) if share else TwoSlopeNorm(0.0, -largest, largest)
    mesh = axes.imshow(values, cmap=_COLOUR_MAPS[column], norm=norm, origin="lower", aspect="auto")
    for i, j in zip(*np.nonzero(counts), strict=True):
        dark = abs(values[i, j]) > 0.6 * largest
        ink = "#ffffff" if dark else DARK
        axes.text(j, i, str(counts[i, j]), ha="center", va="center", fontsize=SIZE, color=ink)
    axes.set_xticks(range(x.size), [_from(low) for low in x])
    axes.set_yticks(range(y.size), [_from(low) for low in y])
    axes.set_xlabel("spacing of HV 1 behind the AV at the start [m]", fontsize=SIZE, color=QUIET)
    axes.set_ylabel("speed of HV 1 minus the AV's [m/s]", fontsize=SIZE, color=QUIET)
    colour_bar(figure, mesh, axes, label)


def _from(low: float) -> str:
    return f"from {low:g}".replace("-", "−") if np.isfinite(low) else "below"
