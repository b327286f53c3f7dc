"""Figures of how followers are predicted: tables in, Figure out. The model that plans stands out everywhere."""

import re
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, MaxNLocator
from numpy.typing import NDArray

from highd_lc.reporting import labels
from highd_lc.reporting.drawing import INK, LEGEND, LINE, QUIET, SIZE, label, panels
from highd_lc.reporting.figures_population import CELL_COLOURS
from highd_lc.vocab import names
from highd_lc.vocab.tables.prediction import CONTROL, OBSERVED, RECORDED

FloatArray = NDArray[np.float64]

_BLUE: Final = labels.POLICIES[names.LOCAL_OPTIMUM].light
_LEAST_SKILL: Final = -1.0
"""Skills below are drawn as an arrow at the edge: one bad model would press the others into a corner."""
_APART: Final = 0.17


def skill_figure(summary: pd.DataFrame, models: Sequence[str], default: str) -> Figure:
    """Skill of each model, a panel a horizon: dot against constant speed, diamond against the best naive model.

    summary: rows of ``prediction_summary`` of one stratum; lines: intervals.
    """
    horizons = sorted(summary["horizon_s"].unique())
    figure, grid = panels(9.4, 1.2 + 0.34 * max(len(models), 1), columns=max(len(horizons), 1), sharey=True)
    for axes, horizon in zip(grid[0], horizons, strict=False):
        rows = summary[summary["horizon_s"] == horizon].set_index("model").reindex(models)
        _skills(axes, rows, [_ink(model, default) for model in models])
        label(axes, title=f"{horizon:g} s", x="skill", grid="x")
    _name_rows(grid[0, 0], [labels.follower_model(model) for model in models], _place(models, default))
    _legend(figure, grid[0, 0], clipped=_any_below(summary))
    return figure


def strata_figure(rows: pd.DataFrame) -> Figure:
    """Skill of one model at one horizon in each stratum. rows: of ``prediction_summary``."""
    figure, grid = panels(7.6, 1.1 + 0.3 * max(len(rows), 1))
    axes = grid[0, 0]
    _skills(axes, rows, [_BLUE] * len(rows))
    label(axes, x="skill", grid="x")
    texts = [f"{labels.stratum(s)}  (n = {n})" for s, n in zip(rows["stratum"], rows["n_events"], strict=True)]
    _name_rows(axes, texts)
    _legend(figure, axes, clipped=_any_below(rows))
    return figure


def _skills(axes: Axes, rows: pd.DataFrame, colours: Sequence[str]) -> None:
    """Both skills of each row, the first one on top."""
    axes.axvline(0, color=INK, lw=0.8)
    for name, marker, shift in (("skill_constant", "o", -_APART), ("skill_naive", "D", _APART)):
        values = zip(*(rows[f"{name}{end}"] for end in ("", "_low", "_high")), strict=True)
        for y, ((value, low, high), colour) in enumerate(zip(values, colours, strict=True)):
            _skill(axes, (value, low, high), y + shift, marker=marker, colour=colour)
    shown = rows[[f"skill_{of}{end}" for of in ("constant", "naive") for end in ("", "_low", "_high")]].to_numpy(
        float
    )
    known = np.clip(shown[np.isfinite(shown)], _LEAST_SKILL, 1.0)
    low, high = (known.min(initial=-0.2), known.max(initial=0.6))
    axes.set_xlim(low - 0.08 * (high - low), high + 0.08 * (high - low))
    axes.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))


def _skill(axes: Axes, skill: tuple[float, float, float], y: float, *, marker: str, colour: str) -> None:
    value, low, high = skill
    axes.plot(np.maximum([low, high], _LEAST_SKILL), [y, y], color=colour, lw=1.4, solid_capstyle="butt")
    if value < _LEAST_SKILL:
        axes.plot(_LEAST_SKILL, y, "<", color=colour, ms=5)
    else:
        axes.plot(
            value, y, marker, color=colour, ms=5 if marker == "o" else 4, mfc=colour if marker == "o" else "none"
        )


def _legend(figure: Figure, axes: Axes, *, clipped: bool) -> None:
    for marker, text in (("o", "against constant speed"), ("D", "against the best naive model")):
        fill = QUIET if marker == "o" else "none"
        axes.plot([], [], marker, color=QUIET, mfc=fill, ms=5, label=text)
    if clipped:
        axes.plot([], [], "<", color=QUIET, ms=5, label=f"below {_LEAST_SKILL:g}".replace("-", "−"))
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3, **LEGEND)


def _any_below(rows: pd.DataFrame) -> bool:
    return bool((rows[["skill_constant", "skill_naive"]] < _LEAST_SKILL).any(axis=None))


def _name_rows(axes: Axes, texts: Sequence[str], highlighted: int | None = None) -> None:
    """Names at the rows, the first one on top; one of them bold."""
    axes.set_yticks(range(len(texts)), texts)
    axes.set_ylim(len(texts) - 0.5 if texts else 0.5, -0.5)
    if highlighted is not None:
        axes.get_yticklabels()[highlighted].set(fontweight="bold", color=INK)


def _place(models: Sequence[str], default: str) -> int | None:
    return list(models).index(default) if default in models else None


def _ink(model: str, default: str) -> str:
    return _BLUE if model == default else QUIET


_MEASURES: Final = (
    ("bias", "bias of speed [m/s]"),
    ("peak_decel", "peak braking [m/s²]"),
    ("comfort", "comfort sum"),
    ("loss", "loss"),
)


def likeness_figure(rows: pd.DataFrame, default: str) -> Figure:
    """Bias, peak braking, comfort and loss of each model at one horizon; line: recorded, or no bias.

    rows: of ``prediction_summary``, one a model, with loss_simulated and loss_recorded beside its columns.
    """
    figure, grid = panels(9.4, 0.95 + 0.25 * max(len(rows), 1), columns=len(_MEASURES), sharey=True)
    models = rows["model"].tolist()
    for axes, (name, title) in zip(grid[0], _MEASURES, strict=True):
        column = name if name == "bias" else f"{name}_simulated"
        for y, (row, model) in enumerate(zip(rows.to_dict("records"), models, strict=True)):
            if name == "bias":
                axes.plot([row["bias_low"], row["bias_high"]], [y, y], color=_ink(model, default), lw=1.4)
            axes.plot(row[column], y, "o", color=_ink(model, default), ms=5)
        recorded = 0.0 if name == "bias" else rows[f"{name}_recorded"].mean() if len(rows) else np.nan
        axes.axvline(recorded, color=INK, lw=0.9)
        label(axes, title=title, grid="x")
        axes.xaxis.set_major_locator(MaxNLocator(4))
    _name_rows(grid[0, 0], [labels.follower_model(model) for model in models], _place(models, default))
    return figure


def class_order(name: str) -> float:
    """Where a class as "< 20", "20 - 35" or "> 60" stands among its like."""
    numbers = re.findall(r"-?\d+(?:\.\d+)?", name.replace("−", "-"))
    if not numbers:
        return np.inf
    return -np.inf if name.lstrip().startswith("<") else float(numbers[0])


def class_label(name: str) -> str:
    """A class with true minus signs, and a dash between its ends."""
    return re.sub(r"-(?=\d)", "−", name.replace(" - ", " – "))


def classes_in_order(values: pd.Series) -> list[str]:
    """The classes that occur, from the lowest to the highest."""
    return sorted(values.unique(), key=class_order)


def dose_figure(rows: pd.DataFrame, models: Sequence[str], default: str) -> Figure:
    """Change of HV 1's speed over its closing speed, a panel a class of spacing.

    rows: of ``dose_response`` at one horizon; band: sd / sqrt(n) of the recorded. models: what else is drawn.
    """
    spacings, closings = (classes_in_order(rows[name]) for name in ("spacing", "closing"))
    figure, grid = panels(9.4, 3.2, columns=max(len(spacings), 1), sharey=True)
    colours = labels.borrowed_colours(models, default)
    for axes, spacing in zip(grid[0], spacings, strict=False):
        of_spacing = rows[rows["spacing"] == spacing]
        axes.axhline(0, color=INK, lw=0.8)
        _recorded(axes, _by_closing(of_spacing, RECORDED, closings))
        for model in models:
            changes = _by_closing(of_spacing, model, closings)["change"]
            colour = labels.POLICIES[colours[model]].light
            width, style = (2.0, "o-") if model == default else (1.2, "s--")
            axes.plot(
                range(len(closings)),
                changes,
                style,
                ms=3,
                lw=width,
                color=colour,
                label=labels.follower_model(model),
            )
        axes.set_xticks(range(len(closings)), list(map(class_label, closings)), rotation=40, ha="right")
        label(axes, title=f"spacing {class_label(spacing)} m", x="closing speed [m/s]", grid="y")
    grid[0, 0].set_ylabel("change of speed [m/s]", fontsize=SIZE, color=QUIET)
    if spacings:
        figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4, **LEGEND)
    return figure


def _by_closing(rows: pd.DataFrame, model: str, closings: list[str]) -> pd.DataFrame:
    return rows[rows["model"] == model].set_index("closing").reindex(closings)


def _recorded(axes: Axes, rows: pd.DataFrame) -> None:
    x, change = np.arange(len(rows)), rows["change"].to_numpy(float)
    error = rows["sd"].to_numpy(float) / np.sqrt(rows["n_events"].to_numpy(float))
    axes.fill_between(x, change - error, change + error, color=QUIET, alpha=0.22, linewidth=0)
    # A class between two empty ones has no area: its band is a bar.
    axes.vlines(x, change - error, change + error, color=QUIET, alpha=0.5, lw=3)
    axes.plot(x, change, "o-", color=INK, ms=3.5, lw=1.6, label="recorded, with sd / √n")


def externality_figure(rows: pd.DataFrame, default: str) -> Figure:
    """Mean change of HV 1's loss by source, a panel a horizon; line: interval.

    rows: source, horizon_s, mean, low and high of each.
    """
    horizons = sorted(rows["horizon_s"].unique())
    sources = list(dict.fromkeys(rows["source"]))
    figure, grid = panels(7.6, 1.0 + 0.27 * max(len(sources), 1), columns=max(len(horizons), 1), sharey=True)
    for axes, horizon in zip(grid[0], horizons, strict=False):
        at = rows[rows["horizon_s"] == horizon].set_index("source").reindex(sources)
        for y, (source, row) in enumerate(zip(sources, at.to_dict("records"), strict=True)):
            colour = INK if source in _SOURCES else _ink(source, default)
            axes.plot([row["low"], row["high"]], [y, y], color=colour, lw=1.4)
            axes.plot(row["mean"], y, "o", color=colour, ms=5)
        axes.axvline(0, color=LINE, lw=0.8)
        label(axes, title=f"{horizon:g} s", x="change of loss", grid="x")
    _name_rows(grid[0, 0], [source_label(s) for s in sources], _place(sources, default))
    return figure


_SOURCES: Final = {OBSERVED: "observed", CONTROL: "controls, not cut in on"}


def source_label(source: str) -> str:
    """Who the change of loss is of, as a reader says it."""
    return _SOURCES.get(source) or labels.follower_model(source)


def error_figure(errors: FloatArray, effects: Mapping[str, FloatArray]) -> Figure:
    """Shares of events with at most a given error, and with at most a given effect of each form; log scale."""
    figure, grid = panels(6.4, 3.1)
    axes = grid[0, 0]
    _shares(axes, errors, "model's error in the followers' loss", color=INK, lw=2.0)
    for form, values in effects.items():
        style: dict[str, Any] = {"color": CELL_COLOURS[form], "ls": "-" if form == names.FIXED else "--"}
        _shares(axes, values, f"effect, {labels.FORMS[form].lower()}", **style)
    axes.set_xscale("symlog", linthresh=_LINEAR)
    axes.set_ylim(0, 100)
    label(axes, x="absolute change of loss (no unit)", y="share of events, up to [%]")
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2, **LEGEND)
    return figure


_LINEAR: Final = 1e-3


def _shares(axes: Axes, values: FloatArray, text: str, **style: Any) -> None:
    known = np.sort(np.abs(values[np.isfinite(values)]))
    if known.size:
        share = 100.0 * np.arange(1, known.size + 1) / known.size
        axes.step(known, share, where="post", label=text, **{"lw": 1.4, **style})
