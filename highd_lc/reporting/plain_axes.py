"""Axes in the reports' look for figures of several panels. Never pyplot: no state is shared."""

from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from highd_lc.reporting.drawing import INK, LINE, QUIET

SIZE: Final = 8.5
"""Font size of labels [points]."""
LEGEND: Final = {"frameon": False, "fontsize": SIZE, "labelcolor": QUIET}


def panels(width: float, height: float, *, rows: int = 1, columns: int = 1, **sharing: Any) -> tuple[Figure, Any]:
    """A figure of that size [inches] and its axes, shape (rows, columns); sharing: ``sharex``, ``sharey``."""
    figure = Figure(figsize=(width, height), facecolor="white", layout="constrained")
    axes = np.atleast_1d(figure.subplots(rows, columns, squeeze=False, **sharing))
    for one in axes.flat:
        dress(one)
    return figure, axes


def dress(axes: Axes) -> None:
    """Quiet ticks and two spines."""
    axes.tick_params(labelsize=SIZE, color=LINE, labelcolor=QUIET, length=3)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color(LINE)


def label(axes: Axes, *, title: str = "", x: str = "", y: str = "", grid: str = "both") -> None:
    """Title and axis labels with units; grid: both, x, y or none."""
    if title:
        axes.set_title(title, fontsize=SIZE + 0.5, color=INK, loc="left")
    axes.set_xlabel(x, fontsize=SIZE, color=QUIET)
    axes.set_ylabel(y, fontsize=SIZE, color=QUIET)
    if grid != "none":
        axes.grid(axis=grid, color=LINE, lw=0.5)


def colour_bar(figure: Figure, image: Any, axes: Any, text: str) -> None:
    """A colour bar in the same look."""
    bar = figure.colorbar(image, ax=axes, pad=0.02, aspect=30)
    bar.set_label(text, color=QUIET, fontsize=SIZE)
    bar.ax.tick_params(labelsize=SIZE, colors=QUIET, length=3)
    bar.outline.set_visible(False)
