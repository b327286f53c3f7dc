"""The figure of an event: fresh and vectorised for a paper, or painted fast for thousands of events."""

import io
from collections import OrderedDict
from itertools import zip_longest
from typing import Any, Final

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.transforms import Bbox
from PIL import Image

from highd_lc.reporting import labels
from highd_lc.reporting.drawing import FONT_SIZE, INK, QUIET, Panel, dress, fill, span
from highd_lc.reporting.event import EventReport
from highd_lc.reporting.html import percent
from highd_lc.reporting.panels_event import SHOWN, event_panels

_SIZE: Final = (7.2, 5.6)
_DPI: Final = 150
_COLUMNS: Final = (0.0, 0.325, 0.635, 1.0)
_ROWS: Final = (0.075, 0.385, 0.695, 0.95)
# Margins inside a cell, as shares of the figure: left, right, bottom, top.
_MARGINS: Final = (0.045, 0.018, 0.06, 0.032)
_CELLS: Final = {
    "scene": (0, 3, 2),
    "lateral": (0, 1, 1),
    "speed": (1, 2, 1),
    "acceleration": (2, 3, 1),
    "hv_speed": (0, 1, 0),
    "hv_acceleration": (1, 2, 0),
    "loss": (2, 3, 0),
}
"""Of each panel: first and last column line, and row from below."""
_KEPT_GROUNDS: Final = 96


def event_figure(report: EventReport) -> Figure:
    """A fresh figure of an event, to be saved as PDF, SVG or PNG."""
    figure = Figure(figsize=_SIZE, dpi=_DPI, facecolor="white")
    for name, panel in event_panels(report).items():
        axes = figure.add_axes(_inner(name))
        dress(axes, panel)
        fill(axes, panel)
    _add_legend(figure)
    figure.text(0.012, 0.975, title(report), fontsize=FONT_SIZE + 2, color=INK, va="center", parse_math=False)
    return figure


def event_vector(report: EventReport, kind: str) -> bytes:
    """The figure of an event as PDF or SVG, the same bytes for the same event."""
    sink = io.BytesIO()
    date = {"pdf": "CreationDate", "svg": "Date"}[kind]
    with rc_context({"svg.hashsalt": "highd_lc"}):
        event_figure(report).savefig(sink, format=kind, metadata={date: None})
    return sink.getvalue()


def title(report: EventReport) -> str:
    """The figure's title: event, class, direction and gain."""
    event = report.event
    value = report.gain()
    gain = "no gain defined" if value != value else f"gain of the local optimum {percent(value)}"
    kind = f"{str(event['ego_class']).lower()}, to the {event['direction']}"
    return f"Lane change {report.event_id} ({kind}): {gain}"


class EventPainter:
    """Paints events one after another on one canvas.

    Titles, axes and ticks are painted once for each set of limits and kept.
    """

    def __init__(self) -> None:
        self._figure = Figure(figsize=_SIZE, dpi=_DPI, facecolor="white")
        self._canvas = FigureCanvasAgg(self._figure)
        self._axes: dict[str, Axes] = {name: self._figure.add_axes(_inner(name)) for name in _CELLS}
        self._grounds: OrderedDict[tuple[object, ...], Any] = OrderedDict()
        _add_legend(self._figure)
        self._frame = self._paint_frame()

    def png(self, report: EventReport) -> bytes:
        """The event's figure as a PNG."""
        panels = event_panels(report)
        grounds = [self._ground(name, panel) for name, panel in panels.items()]
        self._canvas.restore_region(self._frame)
        for ground in grounds:
            self._canvas.restore_region(ground)
        for name, panel in panels.items():
            self._paint(name, panel)
        self._paint_title(report)
        return _encode(self._canvas)

    def _paint_frame(self) -> Any:
        for axes in self._axes.values():
            axes.set_visible(False)
        self._canvas.draw()
        for axes in self._axes.values():
            axes.set_visible(True)
        return self._canvas.copy_from_bbox(self._figure.bbox)

    def _ground(self, name: str, panel: Panel) -> Any:
        key = (name, *panel.ground)
        axes = self._axes[name]
        span(axes, panel)
        if key not in self._grounds:
            dress(axes, panel)
            self._canvas.restore_region(self._frame)
            axes.draw(self._canvas.get_renderer())
            self._grounds[key] = self._canvas.copy_from_bbox(self._cell(name))
        self._grounds.move_to_end(key)
        if len(self._grounds) > _KEPT_GROUNDS:
            self._grounds.popitem(last=False)
        return self._grounds[key]

    def _cell(self, name: str) -> Bbox:
        left, right, row = _CELLS[name]
        corners = [[_COLUMNS[left], _ROWS[row]], [_COLUMNS[right], _ROWS[row + 1]]]
        return Bbox(self._figure.transFigure.transform(corners))

    def _paint(self, name: str, panel: Panel) -> None:
        axes = self._axes[name]
        renderer = self._canvas.get_renderer()
        for artist in fill(axes, panel):
            artist.draw(renderer)
            artist.remove()

    def _paint_title(self, report: EventReport) -> None:
        text = self._figure.text(
            0.012, 0.975, title(report), fontsize=FONT_SIZE + 2, color=INK, va="center", parse_math=False
        )
        text.draw(self._canvas.get_renderer())
        text.remove()


def _encode(canvas: FigureCanvasAgg) -> bytes:
    image = Image.frombuffer("RGBA", canvas.get_width_height(), canvas.buffer_rgba(), "raw", "RGBA", 0, 1)
    sink = io.BytesIO()
    image.convert("RGB").save(sink, format="png", compress_level=3, dpi=(_DPI, _DPI))
    return sink.getvalue()


def _inner(name: str) -> tuple[float, float, float, float]:
    left, right, row = _CELLS[name]
    before, after, below, above = _MARGINS
    before += 0.1 if name == "loss" else 0.0
    x, y = _COLUMNS[left] + before, _ROWS[row] + below
    return x, y, _COLUMNS[right] - after - x, _ROWS[row + 1] - above - y


def _add_legend(figure: Figure) -> None:
    entries = list(zip_longest(reversed(SHOWN), labels.LOSS_PARTS))
    handles: list[Any] = []
    texts: list[str] = []
    # A legend is filled column by column: a policy above, a part of the loss below.
    for policy, part in entries:
        look = labels.POLICIES[policy]
        handles.append(Line2D([], [], color=look.light, lw=1.4, ls=(0, (4, 2)) if look.dashed else "-"))
        texts.append(look.label)
        if part is not None:
            handles.append(Rectangle((0, 0), 1, 1, color=part[2]))
            texts.append(part[1])
    figure.legend(
        handles,
        texts,
        loc="lower center",
        bbox_to_anchor=(0.5, 0.0),
        ncols=len(SHOWN),
        frameon=False,
        fontsize=FONT_SIZE - 0.5,
        handlelength=1.6,
        columnspacing=1.0,
        handletextpad=0.4,
        labelcolor=QUIET,
    )


VECTOR_FORMATS: Final = ("pdf", "svg")
