"""The motion of an event as an animated GIF: the road at equal scale, seen by a camera that follows the AV."""

import io
import math
from collections.abc import Iterator
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from highd_lc.reporting import labels
from highd_lc.reporting.drawing import INK, QUIET, ROAD, Block, Curve, FloatArray, Note, Panel, dress, fill
from highd_lc.reporting.event import EventReport, Path, Play
from highd_lc.reporting.figures_event import title
from highd_lc.vocab import names

ANIMATION: Final = "gif"
FRAMES_PER_S: Final = 5
_BEHIND, _AHEAD = 90.0, 70.0
"""How much of the road is in view, from the AV [m]."""
_SIZE: Final = (8.0, 2.9)
_DPI: Final = 110
_ROAD: Final = (0.06, 0.56, 0.92, 0.3)
_SPEED: Final = (0.06, 0.14, 0.92, 0.27)
_SHOWN: Final = (names.LOCAL_OPTIMUM, names.BENCHMARK, names.HUMAN, labels.RECORDED)


def event_gif(report: EventReport) -> bytes:
    """The motion under the local optimum, with that under the benchmark as outlines; real time, the same bytes.

    Where there is no such plan the human's, or the recorded, motion is shown alone.
    """
    frames = [image.quantize(64) for image in _frames(report)]
    sink = io.BytesIO()
    frames[0].save(
        sink, format="gif", save_all=True, append_images=frames[1:], duration=1000 // FRAMES_PER_S, loop=0
    )
    return sink.getvalue()


def plays_shown(report: EventReport) -> list[Play]:
    """The motions of the animation, at most two, the main one first."""
    found = [play for policy in _SHOWN[:2] if (play := report.play(policy)) is not None]
    alone = (play for policy in _SHOWN[2:] if (play := report.play(policy)) is not None)
    return found or [next(alone)]


def _frames(report: EventReport) -> Iterator[Image.Image]:
    plays = plays_shown(report)
    known = np.flatnonzero(np.isfinite(plays[0].ego.x))
    every = round(1.0 / (FRAMES_PER_S * report.dt))
    figure = Figure(figsize=_SIZE, dpi=_DPI, facecolor="white")
    canvas = FigureCanvasAgg(figure)
    figure.text(0.012, 0.93, title(report), fontsize=9, color=INK, va="center", parse_math=False)
    road, speed = figure.add_axes(_ROAD), figure.add_axes(_SPEED)
    _draw_speeds(speed, report, plays)
    cursor = speed.axvline(0.0, color=INK, linewidth=0.8)
    for k in range(int(known[0]), int(known[-1]) + 1, every):
        road.clear()
        panel = road_panel(report, plays, k)
        dress(road, panel)
        fill(road, panel)
        cursor.set_xdata([k * report.dt] * 2)
        canvas.draw()
        size = canvas.get_width_height()
        yield Image.frombuffer("RGBA", size, canvas.buffer_rgba(), "raw", "RGBA", 0, 1).convert("RGB")


def road_panel(report: EventReport, plays: list[Play], k: int) -> Panel:
    """The road at sample k of the motions, a metre across as long as a metre along."""
    camera = float(plays[0].ego.x[k])
    low, high = camera - _BEHIND, camera + _AHEAD
    lower = max(y for y in report.markings if y < report.divider - 1.0)
    upper = min(y for y in report.markings if y > report.divider + 1.0)
    half = 0.5 * (high - low) * (_ROAD[3] * _SIZE[1]) / (_ROAD[2] * _SIZE[0])
    middle = (lower + upper) / 2.0
    blocks = [Block(low, lower, high - low, upper - lower, ROAD), *_boxes(report, plays, k)]
    marking = Curve(np.array([low, high]), np.full(2, report.divider), QUIET, 0.6, (6, 6))
    trails = [_trail(play, k) for play in plays]
    return Panel(
        f"{' (filled), '.join(labels.look(p.policy).label for p in plays)}{' (outlines)' * (len(plays) > 1)}, "
        f"t = {k * report.dt:.1f} s",
        "x [m]",
        "",
        (low, high, middle - half, middle + half),
        (marking, *trails),
        tuple(b for b in blocks if low < b.x + b.width and b.x < high),
        tuple(_notes(report, plays[0], k, low=low, high=high)),
    )


def _vehicles(report: EventReport, play: Play) -> dict[str, Path]:
    ranked = {names.target_follower(rank): path for rank, path in enumerate(play.followers, start=1)}
    return {names.EGO: play.ego, **ranked}


def _boxes(report: EventReport, plays: list[Play], k: int) -> Iterator[Block]:
    for role, path in report.others.items():
        yield from _box(report, role, path, k, ("#b4babf", INK))
    for play in reversed(plays):
        colour = labels.look(play.policy).light
        for role, path in _vehicles(report, play).items():
            inside = "none" if play is not plays[0] else colour if role == names.EGO else "#ffffff"
            yield from _box(report, role, path, k, (inside, INK if play is plays[0] else colour))


def _box(report: EventReport, role: str, path: Path, k: int, colours: tuple[str, str]) -> Iterator[Block]:
    if role in report.boxes and k < path.x.size and math.isfinite(path.x[k]):
        box = report.boxes[role]
        x, y = float(path.x[k]) - box.length / 2.0, float(path.y[k]) - box.width / 2.0
        yield Block(x, y, box.length, box.width, *colours)


def _notes(report: EventReport, play: Play, k: int, *, low: float, high: float) -> Iterator[Note]:
    for role, path in {**report.others, **_vehicles(report, play)}.items():
        if role in report.boxes and k < path.x.size and low + 5.0 < path.x[k] < high - 5.0:
            outside = 1.0 if path.y[k] > report.divider else -1.0
            name = labels.role(role).replace("target ", "").replace("origin ", "")
            yield Note(float(path.x[k]), float(path.y[k]) + 3.0 * outside, name, "center", QUIET)


def _trail(play: Play, k: int) -> Curve:
    look = labels.look(play.policy)
    return Curve(play.ego.x[: k + 1], play.ego.y[: k + 1], look.light, 1.0)


def _draw_speeds(axes: Axes, report: EventReport, plays: list[Play]) -> None:
    """The speed of the AV and of the first follower over time."""
    curves = [
        Curve(report.dt * np.arange(path.v.size, dtype=np.float64), path.v, labels.look(play.policy).light, width)
        for play in plays
        for path, width in ((play.ego, 1.4), *((path, 0.8) for path in play.followers[:1]))
    ]
    low, high = _range([curve.y for curve in curves])
    panel = Panel(
        "Speed of the AV (thick) and of HV 1", "time since start [s]", "v [m/s]",
        (0.0, max(float(curve.x[-1]) for curve in curves), low, high), tuple(curves),
    )  # fmt: skip
    dress(axes, panel)
    fill(axes, panel)


def _range(values: list[FloatArray]) -> tuple[float, float]:
    known = np.concatenate([v[np.isfinite(v)] for v in values])
    return math.floor(float(known.min()) - 0.5), math.ceil(float(known.max()) + 0.5)
