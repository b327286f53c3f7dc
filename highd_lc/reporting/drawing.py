"""Panels of a figure as data, and matplotlib axes that show them. Never pyplot: no state is shared.

Axes in the reports' look for figures of several panels. Never pyplot: no state is shared.
"""

from dataclasses import dataclass, field
from typing import Any, Final, Literal

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator
from matplotlib.typing import LineStyleType
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

INK: Final = "#1a1d20"
QUIET: Final = "#596269"
LINE: Final = "#d5dade"
DARK: Final = "#010203"
"""Text on a tile that is pale in both themes: black itself is what a page replaces by its own ink."""
GROUND: Final = "#fefdfe"
"""The ground of a page, which rims what lies on tiles: white to the eye, and no other white."""
ROAD: Final = "#e9ebed"
FONT_SIZE: Final = 7.0


@dataclass(frozen=True)
class Curve:
    """A line through points; dash: (on, off) in points of the font, None = solid."""

    x: FloatArray
    y: FloatArray
    colour: str
    width: float = 1.2
    dash: tuple[float, float] | None = None


@dataclass(frozen=True)
class Block:
    """A filled rectangle, from its lower left corner."""

    x: float
    y: float
    width: float
    height: float
    fill: str
    edge: str = "none"


@dataclass(frozen=True)
class Note:
    """A short text at a point; align: left, center or right."""

    x: float
    y: float
    text: str
    align: str = "left"
    colour: str = INK


@dataclass(frozen=True)
class Panel:
    """One pair of axes: its title, axis labels with units, limits (x low, x high, y low, y high) and content.

    names: labels at the whole numbers of the y axis in place of numbers.
    """

    title: str
    x_label: str
    y_label: str
    limits: tuple[float, float, float, float]
    curves: tuple[Curve, ...] = ()
    blocks: tuple[Block, ...] = ()
    notes: tuple[Note, ...] = ()
    names: tuple[str, ...] = field(default=())

    @property
    def ground(self) -> tuple[object, ...]:
        """What the panel's background depends on."""
        return (self.title, self.x_label, self.y_label, self.limits, self.names)


def dress(axes: Axes, panel: Panel) -> None:
    """Set title, labels, limits and ticks: everything but the content."""
    # The y axis is named in the title: beside the ticks its name would need room that depends on the ticks.
    title = f"{panel.title}, {panel.y_label}" if panel.y_label else panel.title
    axes.set_title(title, loc="left", fontsize=FONT_SIZE + 0.5, color=INK, pad=3)
    axes.set_xlabel(panel.x_label, fontsize=FONT_SIZE, color=QUIET, labelpad=1)
    span(axes, panel)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=FONT_SIZE, color=LINE, labelcolor=QUIET, length=2, pad=2)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color(LINE)
    axes.xaxis.set_major_locator(
        MaxNLocator(5 if panel.names or panel.limits[1] < 100 else 10, steps=[1, 2, 5, 10])
    )
    axes.yaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
    if panel.names:
        axes.set_yticks(range(len(panel.names)), panel.names)
    else:
        axes.grid(axis="y", color=LINE, linewidth=0.5)


def span(axes: Axes, panel: Panel) -> None:
    """Set the limits alone."""
    axes.set_xlim(*panel.limits[:2])
    axes.set_ylim(*panel.limits[2:])


def fill(axes: Axes, panel: Panel) -> list[Artist]:
    """Add a panel's content to its axes; the artists, in the order in which they are to be drawn."""
    # add_artist, unlike add_patch and add_line, leaves the data limits alone: the limits are given.
    artists: list[Artist] = [axes.add_artist(_rectangle(block)) for block in panel.blocks]
    artists += [axes.add_artist(_line(curve)) for curve in panel.curves]
    artists += [_text(axes, note) for note in panel.notes]
    return artists


def _rectangle(block: Block) -> Rectangle:
    corner = (block.x, block.y)
    return Rectangle(corner, block.width, block.height, facecolor=block.fill, edgecolor=block.edge, linewidth=0.8)


def _line(curve: Curve) -> Line2D:
    style: LineStyleType = "-" if curve.dash is None else (0, curve.dash)
    return Line2D(curve.x, curve.y, color=curve.colour, linewidth=curve.width, linestyle=style)


def _text(axes: Axes, note: Note) -> Artist:
    return axes.text(
        note.x,
        note.y,
        note.text,
        ha=note.align,
        va="center",
        fontsize=FONT_SIZE - 0.5,
        color=note.colour,
        parse_math=False,
        clip_on=True,
    )


SIZE: Final = 8.5
"""Font size of labels [points]."""
LEGEND: Final[dict[str, Any]] = {"frameon": False, "fontsize": SIZE, "labelcolor": QUIET}


def panels(width: float, height: float, *, rows: int = 1, columns: int = 1, **sharing: Any) -> tuple[Figure, Any]:
    """A figure of that size [inches] and its axes, shape (rows, columns); sharing: ``sharex``, ``sharey``."""
    figure = Figure(figsize=(width, height), facecolor="white", layout="constrained")
    axes = np.atleast_1d(figure.subplots(rows, columns, squeeze=False, **sharing))
    for one in axes.flat:
        dress_plain(one)
    return figure, axes


def dress_plain(axes: Axes) -> None:
    """Quiet ticks and two spines."""
    axes.tick_params(labelsize=SIZE, color=LINE, labelcolor=QUIET, length=3)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color(LINE)


def label(
    axes: Axes, *, title: str = "", x: str = "", y: str = "", grid: Literal["both", "x", "y", "none"] = "both"
) -> None:
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
