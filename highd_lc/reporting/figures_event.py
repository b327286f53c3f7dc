"""The figure of an event: fresh and vectorised for a paper, or painted fast for thousands of events.

What the figure of an event shows: the scene at the start, motions over time, losses by policy.

Limits are rounded outwards to coarse steps: they read better, and events share the painter's backgrounds.
"""

import io
import math
from collections import OrderedDict
from collections.abc import Callable, Iterable
from dataclasses import replace
from itertools import zip_longest
from typing import Any, Final

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.transforms import Bbox
from PIL import Image

from highd_lc.reporting import labels
from highd_lc.reporting.drawing import (
    FONT_SIZE,
    INK,
    QUIET,
    ROAD,
    Block,
    Curve,
    FloatArray,
    Note,
    Panel,
    dress,
    fill,
    span,
)
from highd_lc.reporting.event import EventReport, Path, Play
from highd_lc.reporting.html import percent
from highd_lc.vocab import names

SHOWN: Final = (
    names.HUMAN,
    names.BENCHMARK_FREE,
    names.LOCAL_OPTIMUM_FREE,
    names.BENCHMARK,
    names.LOCAL_OPTIMUM,
)
"""Policies whose motions are drawn, the most important on top."""
_TIME: Final = "time since start [s]"


def event_panels(report: EventReport) -> dict[str, Panel]:
    """The panels of an event's figure by name, as ``figures_event`` places them."""
    return {
        "scene": _scene(report),
        "lateral": _over_time(report, "AV lateral position", "y [m]", lambda p: [p.ego.y], step=1.0),
        "speed": _over_time(report, "AV speed", "v [m/s]", lambda p: [p.ego.v], step=5.0),
        "acceleration": _over_time(report, "AV acceleration", "a [m/s²]", lambda p: [p.ego.a], step=1.0),
        "hv_speed": _followers(report, "Followers' speed", "v [m/s]", lambda f: f.v, step=5.0),
        "hv_acceleration": _followers(report, "Followers' acceleration", "a [m/s²]", lambda f: f.a, step=1.0),
        "loss": _losses(report),
    }


def _drawn(report: EventReport) -> list[Play]:
    """What is drawn: planners of others below, then our policies."""
    shown = (*reversed(report.planners), *SHOWN)
    return [play for policy in shown if (play := report.play(policy)) is not None]


def _over_time(
    report: EventReport, title: str, label: str, pick: Callable[[Play], list[FloatArray]], *, step: float
) -> Panel:
    curves = [_curve(report, play, values) for play in _drawn(report) for values in pick(play)]
    return Panel(title, _TIME, label, _limits(report, curves, step), tuple(curves))


def _followers(
    report: EventReport, title: str, label: str, pick: Callable[[Path], FloatArray], *, step: float
) -> Panel:
    plays = [p for q in (names.BENCHMARK, names.LOCAL_OPTIMUM) if (p := report.play(q)) is not None]
    if not plays and (human := report.play(names.HUMAN)) is not None:
        plays = [human]
    curves, notes = [], []
    for play in plays:
        for rank, path in enumerate(play.followers, start=1):
            curves.append(_curve(report, play, pick(path), thin=rank - 1))
    limits = _limits(report, curves, step)
    if plays:
        notes = _end_notes(report, [pick(path) for path in plays[-1].followers], limits)
    return Panel(title, _TIME, label, limits, tuple(curves), notes=tuple(notes))


def _curve(report: EventReport, play: Play, values: FloatArray, *, thin: int = 0) -> Curve:
    look = labels.look(play.policy)
    t = report.dt * np.arange(values.size, dtype=np.float64)
    return Curve(t, values, look.light, max(1.4 - 0.25 * thin, 0.5), (4, 2) if look.dashed else None)


def _end_notes(report: EventReport, ends: list[FloatArray], limits: tuple[float, ...]) -> list[Note]:
    # The rank of each follower at the end of its curve, pushed apart where curves end close together.
    apart = 0.075 * (limits[3] - limits[2])
    notes: list[Note] = []
    last = -math.inf
    ranked = sorted((float(v[-1]), rank) for rank, v in enumerate(ends, start=1) if np.isfinite(v[-1]))
    for value, rank in ranked:
        last = max(value, last + apart)
        notes.append(Note(report.dt * (ends[0].size - 1) + 0.15, last, str(rank), colour=QUIET))
    over = max(0.0, last - limits[3] + apart / 2)
    return [replace(note, y=note.y - over) for note in notes]


def _limits(report: EventReport, curves: Iterable[Curve], step: float) -> tuple[float, float, float, float]:
    values = [curve.y[np.isfinite(curve.y)] for curve in curves]
    known = np.concatenate(values) if values else np.zeros(1)
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    low, high = step * math.floor(low / step - 0.05), step * math.ceil(high / step + 0.05)
    duration = max((play.ego.x.size - 1) * report.dt for play in report.plays) if report.plays else 15.0
    return (0.0, math.ceil(duration) + 0.6, low, max(high, low + 2 * step))


def _losses(report: EventReport) -> Panel:
    shown = reversed((*names.POLICIES, *report.planners))
    plans = {policy: plan for policy in shown if (plan := report.plan(policy)) is not None}
    blocks, notes, longest = [], [], 1.0
    for row, (policy, plan) in enumerate(plans.items()):
        loss = report.loss(policy)
        if loss is None or not math.isfinite(loss["loss_total"]):
            status = labels.STATUSES[plan["status"]]
            notes.append(Note(0.3, row, status, colour=QUIET))
            continue
        left = 0.0
        for name, _, colour in labels.LOSS_PARTS:
            half = 0.5 * float(loss[name]) if math.isfinite(loss[name]) else 0.0
            blocks.append(Block(left, row - 0.34, half, 0.68, colour))
            left += half
        notes.append(Note(left, row, f" {loss['loss_total']:.2f}"))
        longest = max(longest, left)
    limits = (0.0, 10.0 * math.ceil(1.3 * longest / 10.0), -0.6, len(plans) - 0.4)
    title = f"Losses ({labels.ACCOUNTING_NAMES[names.PRIMARY_ACCOUNTING].lower()} accounting)"
    short = tuple(_shortest(q) for q in plans)
    return Panel(title, "loss (normalised, no unit)", "", limits, (), tuple(blocks), tuple(notes), short)


def _shortest(policy: str) -> str:
    short = labels.short_policy(policy).replace("Robust local optimum", "Robust")
    return short.replace("Local optimum,", "Local,").replace("Benchmark,", "Bench.,")


def _scene(report: EventReport) -> Panel:
    boxes = [(role, path) for role, path in _at_start(report).items() if role in report.boxes]
    centres = [float(path.x[0]) for _, path in boxes if abs(path.x[0]) < 200]
    ends = [play.ego.x[_last(play, report)] for play in _drawn(report)]
    low = 20.0 * math.floor(min([0.0, *centres]) / 20.0 - 0.4)
    high = 20.0 * math.ceil(max([60.0, *centres, *(float(x) for x in ends if np.isfinite(x))]) / 20.0 + 0.2)
    lower = max(y for y in report.markings if y < report.divider - 1.0)
    upper = min(y for y in report.markings if y > report.divider + 1.0)
    missing = max(0.0, _LEAST_STRETCH - (high - low)) / 2.0
    low, high = low - missing, high + missing
    road = Block(low, lower, high - low, upper - lower, ROAD)
    marking = Curve(np.array([low, high]), np.full(2, report.divider), QUIET, 0.6, (6, 6))
    paths = tuple(_path(play, report) for play in _drawn(report))
    blocks, notes = [road], []
    for role, path in boxes:
        if low < path.x[0] < high:
            blocks.append(_box(report, role, path))
            notes.append(_box_note(report, role, path, off=0.011 * (high - low)))
    sides = [(float(path.y[0]), report.boxes[role].width / 2) for role, path in boxes]
    bottom, top = min([lower, *(y - half for y, half in sides)]), max([upper, *(y + half for y, half in sides)])
    limits = _equal_scale(low, high, (bottom + top) / 2.0)
    return Panel(
        "Scene at the start, and the paths of the lane change",
        "x [m]",
        "y [m]",
        limits,
        (marking, *paths),
        tuple(blocks),
        tuple(notes),
    )


def _equal_scale(low: float, high: float, middle: float) -> tuple[float, float, float, float]:
    """Limits of the scene in which a metre across is as long as a metre along. middle: of the road, y [m]."""
    _, _, width, height = _inner("scene")
    half = 0.5 * (high - low) * (height * _SIZE[1]) / (width * _SIZE[0])
    return low, high, middle - half, middle + half


def _at_start(report: EventReport) -> dict[str, Path]:
    play = report.plays[0] if report.plays else None
    followers = (
        {}
        if play is None
        else {names.target_follower(rank): path for rank, path in enumerate(play.followers, start=1)}
    )
    return {**({} if play is None else {names.EGO: play.ego}), **report.others, **followers}


def _last(play: Play, report: EventReport) -> int:
    duration = play.T if math.isfinite(play.T) else float(report.event["duration_s"])
    return min(round(duration / report.dt), play.ego.x.size - 1)


def _path(play: Play, report: EventReport) -> Curve:
    look = labels.look(play.policy)
    stop = _last(play, report) + 1
    return Curve(play.ego.x[:stop], play.ego.y[:stop], look.light, 1.2, (4, 2) if look.dashed else None)


def _box(report: EventReport, role: str, path: Path) -> Block:
    box = report.boxes[role]
    fill = "#0072B2" if role == names.EGO else "#ffffff" if role.startswith(names.TARGET_FOLLOWER) else "#b4babf"
    return Block(
        float(path.x[0]) - box.length / 2, float(path.y[0]) - box.width / 2, box.length, box.width, fill, INK
    )


def _box_note(report: EventReport, role: str, path: Path, *, off: float) -> Note:
    """The name of a vehicle beside its box. off: how far its middle is from the box [m]."""
    # Beside the road where the lane is the outer one, so that no label crosses the marking.
    outside = 1.0 if path.y[0] > report.divider else -1.0
    y = float(path.y[0]) + outside * (report.boxes[role].width / 2 + off)
    name = labels.role(role).replace("target ", "").replace("origin ", "")
    return Note(float(path.x[0]), y, name, "center", QUIET)


_SIZE: Final = (7.2, 5.6)
_DPI: Final = 150
_LEAST_STRETCH: Final = 200.0
"""Length of road that a scene shows at least [m]: in less there would be no room for the lanes beside."""
_COLUMNS: Final = (0.0, 0.325, 0.635, 1.0)
_ROWS: Final = (0.075, 0.415, 0.755, 0.95)
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
    _add_legend(figure, report.planners)
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
        self._planners: tuple[str, ...] = ()
        self._frame = self._paint_frame()

    def png(self, report: EventReport) -> bytes:
        """The event's figure as a PNG."""
        if report.planners != self._planners:
            self._planners = report.planners
            self._grounds.clear()
            self._frame = self._paint_frame()
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
        """Paint what all events share with these planners of others: the legend."""
        for legend in list(self._figure.legends):
            legend.remove()
        _add_legend(self._figure, self._planners)
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


_NAMED: Final = 3
"""Planners of others in the legend."""


def _add_legend(figure: Figure, planners: tuple[str, ...]) -> None:
    named = [_key(policy, short=bool(planners)) for policy in (*reversed(SHOWN), *planners[:_NAMED])]
    parts = [(Rectangle((0, 0), 1, 1, color=colour), label) for _, label, colour in labels.LOSS_PARTS]
    # A legend is filled column by column: a policy above, a part of the loss below.
    above, below = named[: len(SHOWN)], [*parts, *named[len(SHOWN) :]]
    entries: list[tuple[Any, str]] = [one for pair in zip_longest(above, below) for one in pair if one is not None]
    handles, texts = zip(*entries, strict=True)
    figure.legend(
        handles, texts, loc="lower center", bbox_to_anchor=(0.5, 0.0), ncols=math.ceil(len(entries) / 2),
        frameon=False, fontsize=FONT_SIZE - 0.5, handlelength=1.6, columnspacing=1.0, handletextpad=0.4,
        labelcolor=QUIET,
    )  # fmt: skip


def _key(policy: str, *, short: bool) -> tuple[Line2D, str]:
    look = labels.look(policy)
    line = Line2D([], [], color=look.light, lw=1.4, ls=(0, (4, 2)) if look.dashed else "-")
    return line, labels.short_policy(policy) if short else look.label


VECTOR_FORMATS: Final = ("pdf", "svg")
