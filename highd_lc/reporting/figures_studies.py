"""Figures of what the population is judged by beside the matrix: tables in, Figure out; gains in percent."""

from collections.abc import Sequence
from textwrap import fill
from typing import Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from highd_lc.reporting import labels
from highd_lc.reporting.drawing import DARK, GROUND, INK, LEGEND, LINE, QUIET, SIZE, colour_bar, panels
from highd_lc.reporting.figures_population import CELL_COLOURS, visible
from highd_lc.reporting.html import number
from highd_lc.vocab import names
from highd_lc.vocab.tables.studies import FRONT, SWEEP

FloatArray = NDArray[np.float64]

_ACCOUNTING_STYLES: Final = {names.EQUAL: "-", names.FOLLOWER_HORIZON: "--", names.PAPER: ":"}
_COLOUR_MAP: Final = "PuOr"
_FRONTS: Final = 6
_TITLE_LETTERS: Final = 26
"""How many letters fit above a panel of the cross scores."""
_MODELS: Final = 6
"""Follower models drawn side by side: who planned, who plans too, the second opinions; tables hold all."""


def cross_figure(scores: pd.DataFrame) -> Figure:
    """Gain when plans are scored under what was not optimised: rows optimised, columns scored, a panel a model.

    scores: rows of ``cross_scores`` of one form and of the follower model that planned.
    """
    models = list(dict.fromkeys(scores["scored_with"]))[:_MODELS]
    figure, grid = panels(2.35 + 2.35 * len(models), 2.7, columns=len(models))
    largest = _largest(scores["gain"])
    for axes, model in zip(grid[0], models, strict=True):
        table = scores[scores["scored_with"] == model].pivot_table(
            index="optimised", columns="scored", values="gain"
        )
        table = table.reindex(index=list(names.ACCOUNTINGS), columns=list(names.ACCOUNTINGS))
        _heat(axes, 100.0 * table.to_numpy(float), largest)
        title = fill(f"followers: {labels.scored_with(model)}", _TITLE_LETTERS)
        axes.set_title(title, fontsize=SIZE, color=INK, loc="left")
        short = [labels.ACCOUNTING_NAMES[a].lower().replace(" ", "\n") for a in names.ACCOUNTINGS]
        axes.set_xticks(range(3), short)
        axes.set_yticks(range(3), short)
        axes.set_xlabel("scored under", fontsize=SIZE, color=QUIET)
        axes.set_ylabel("optimised under", fontsize=SIZE, color=QUIET)
    return figure


def _largest(gains: pd.Series) -> float:
    known = 100.0 * gains.abs().dropna()
    return max(float(known.max()), 0.1) if len(known) else 0.1


def _heat(axes: Axes, values: FloatArray, largest: float) -> None:
    axes.imshow(values, cmap=_COLOUR_MAP, norm=TwoSlopeNorm(0.0, -largest, largest), aspect="auto")
    for i, j in np.ndindex(*values.shape):
        if np.isfinite(values[i, j]):
            ink = "#ffffff" if abs(values[i, j]) > 0.6 * largest else DARK
            axes.text(j, i, number(values[i, j]), ha="center", va="center", fontsize=SIZE, color=ink)


def horizon_figure(sensitivity: pd.DataFrame) -> Figure:
    """Gain over the accounted time H with its interval. sensitivity: rows of ``horizon_sensitivity``."""
    figure, grid = panels(8.4, 3.0, columns=len(names.FORMS))
    for axes, form in zip(grid[0], names.FORMS, strict=True):
        for accounting, style in _ACCOUNTING_STYLES.items():
            rows = sensitivity[(sensitivity["form"] == form) & (sensitivity["accounting"] == accounting)]
            _band(axes, rows, style, CELL_COLOURS[form], labels.ACCOUNTING_NAMES[accounting])
        axes.axhline(0, color=INK, lw=0.8)
        axes.set_title(labels.FORMS[form], fontsize=SIZE, color=INK, loc="left")
        axes.set_xlabel("accounted time H [s]", fontsize=SIZE, color=QUIET)
        axes.set_ylabel("gain [%]", fontsize=SIZE, color=QUIET)
        axes.grid(axis="y", color=LINE, lw=0.5)
    if len(sensitivity):
        grid[0, 0].legend(**LEGEND)
    return figure


def _band(axes: Axes, rows: pd.DataFrame, style: str, colour: str, label: str) -> None:
    rows = rows.sort_values("horizon_s")
    low, high = 100.0 * rows["gain_low"], 100.0 * rows["gain_high"]
    axes.fill_between(rows["horizon_s"], low, high, color=colour, alpha=0.12, linewidth=0)
    if len(rows):
        axes.plot(
            rows["horizon_s"], 100.0 * rows["gain"], style, color=colour, lw=1.6, marker="o", ms=4, label=label
        )


def uncertainty_figure(uncertainty: pd.DataFrame) -> Figure:
    """Gain of each sampled event over draws of the followers' parameters: mean, range, and as fitted.

    uncertainty: rows of ``uncertainty`` of one form and accounting.
    """
    figure, grid = panels(8.4, 3.0)
    axes = grid[0, 0]
    rows = uncertainty.dropna(subset=["gain_mean"]).sort_values("gain_mean")
    place = np.arange(len(rows))
    axes.vlines(place, 100 * rows["gain_low"], 100 * rows["gain_high"], color=QUIET, lw=1.2)
    axes.plot(place, 100 * rows["gain_mean"], "o", color="#0072B2", ms=4, label="mean over draws")
    axes.plot(place, 100 * rows["gain"], "x", color="#D55E00", ms=5, label="parameters as fitted")
    axes.axhline(0, color=INK, lw=0.8)
    axes.set_xticks([])
    axes.set_xlabel("sampled events, by mean gain", fontsize=SIZE, color=QUIET)
    axes.set_ylabel("gain [%]", fontsize=SIZE, color=QUIET)
    axes.grid(axis="y", color=LINE, lw=0.5)
    axes.legend(loc="upper left", **LEGEND)  # the largest gain is on the right
    return figure


_FORM_LOOKS: Final = {
    names.FREE: ("#0072B2", ".", ""),
    names.FREE_START: ("#D55E00", "+", ", chosen start"),
}
"""Forms of the Pareto study: colour of the sweep, marker of the front, words in the legend."""


def pareto_figure(pareto: pd.DataFrame) -> Figure:
    """Fronts of (loss of the AV, loss of the followers) of some sampled events, with the sweep over omega_AV.

    pareto: rows of ``pareto``.
    """
    chosen = sorted(pareto["event_id"].unique())[:_FRONTS]
    rows = max(-(-len(chosen) // 3), 1)
    figure, grid = panels(9.4, 2.6 * rows, rows=rows, columns=3)
    for axes, event in zip(grid.flat, chosen, strict=False):
        _front(axes, pareto[pareto["event_id"] == event])
        axes.set_title(event, fontsize=SIZE, color=INK, loc="left")
    for axes in grid.flat[len(chosen) :]:
        axes.set_visible(False)
    if chosen:
        handles = grid[0, 0].get_legend_handles_labels()
        figure.legend(*handles, loc="outside lower center", ncols=3, **LEGEND)
    return figure


def _front(axes: Axes, rows: pd.DataFrame) -> None:
    for form, (colour, marker, words) in _FORM_LOOKS.items():
        of_form = rows[rows["form"] == form]
        if of_form.empty:
            continue
        front, sweep = (of_form[of_form["kind"] == kind].sort_values("loss_av") for kind in (FRONT, SWEEP))
        axes.plot(front["loss_av"], front["loss_hv"], marker, color=QUIET, ms=4, label=f"NSGA-II{words}")
        axes.plot(
            sweep["loss_av"],
            sweep["loss_hv"],
            "o-",
            color=colour,
            ms=4,
            lw=1,
            label=f"sweep over the weight{words}",
        )
        knee = front[front["knee"]]
        axes.plot(knee["loss_av"], knee["loss_hv"], "D", color=colour, mec=INK, ms=6, label=f"knee{words}")
    axes.set_xlabel("loss of the AV", fontsize=SIZE, color=QUIET)
    axes.set_ylabel("loss of the followers", fontsize=SIZE, color=QUIET)
    axes.grid(color=LINE, lw=0.5)


def gain_map_figure(tiles: pd.DataFrame, spacing: FloatArray, difference: FloatArray) -> Figure:
    """Gain over spacing and speed difference of HV 1 at the start: tiles with gain and count, every event a dot.

    tiles: rows of ``gain_map`` of one form and accounting, hatched where the error hides the effect; spacing [m],
    difference [m/s]: of each event.
    """
    figure, grid = panels(8.0, 4.2)
    axes = grid[0, 0]
    known = np.isfinite(spacing) & np.isfinite(difference)
    x, y = _open_edges(tiles, "spacing", spacing[known]), _open_edges(tiles, "closing", difference[known])
    largest = _largest(tiles["gain"][visible(tiles)])
    values, hidden = _on_grid(tiles, x, y), _on_grid(tiles.assign(gain=~visible(tiles)), x, y) > 0.0
    values[hidden] = np.nan
    mesh = axes.pcolormesh(x, y, values.T, cmap=_COLOUR_MAP, norm=TwoSlopeNorm(0.0, -largest, largest))
    for k, m in zip(*np.nonzero(hidden), strict=True):
        size = x[k + 1] - x[k], y[m + 1] - y[m]
        axes.add_patch(Rectangle((x[k], y[m]), *size, fill=False, hatch="////", lw=0.0, ec=QUIET))
    axes.plot(spacing[known], difference[known], "o", color=INK, mec=GROUND, mew=0.7, ms=3.8)
    colour_bar(figure, mesh, axes, "gain [%]")
    axes.set_xlabel("spacing of HV 1 behind the AV at the start [m]", color=QUIET, fontsize=SIZE)
    axes.set_ylabel("speed of HV 1 minus that of the AV [m/s]", color=QUIET, fontsize=SIZE)
    return figure


def _open_edges(tiles: pd.DataFrame, axis: str, values: FloatArray) -> FloatArray:
    """Edges of the tiles along an axis; an open end reaches as far as the events do."""
    unit = "m" if axis == "spacing" else "mps"
    columns = (tiles[f"{axis}_{end}_{unit}"] for end in ("low", "high"))
    inner = np.unique(np.concatenate([column.dropna().to_numpy(float) for column in columns]))
    outer = [values.min() - 1.0, values.max() + 1.0] if values.size else []
    is_open = [tiles[f"{axis}_{end}_{unit}"].isna().any() for end in ("low", "high")]
    low = [min(outer[0], inner[0] - 1.0)] if outer and is_open[0] else []
    high = [max(outer[1], inner[-1] + 1.0)] if outer and is_open[1] else []
    edges = np.concatenate([low, inner, high])
    return edges if edges.size > 1 else np.array([0.0, 1.0])


def _on_grid(tiles: pd.DataFrame, x: FloatArray, y: FloatArray) -> FloatArray:
    values = np.full((x.size - 1, y.size - 1), np.nan)
    columns = ("spacing_low_m", "closing_low_mps", "gain")
    for spacing, closing, gain in zip(*(tiles[name].to_numpy(float) for name in columns), strict=True):
        i, j = (_cell(edges, low) for edges, low in ((x, spacing), (y, closing)))
        values[i, j] = 100.0 * gain
    return values


def _cell(edges: FloatArray, low: float) -> int:
    return 0 if np.isnan(low) else int(np.searchsorted(edges, low))


def fits_figure(traces: Sequence[tuple[str, FloatArray, FloatArray, FloatArray, FloatArray]]) -> Figure:
    """Some fits as trajectories: title, recorded and simulated spacing [m], recorded and simulated speed [m/s]."""
    figure, grid = panels(9.4, 4.2, rows=2, columns=max(len(traces), 1))
    for column, (title, *motions) in enumerate(traces):
        for row, unit in enumerate(("spacing [m]", "speed [m/s]")):
            axes = grid[row, column]
            recorded, simulated = motions[2 * row : 2 * row + 2]
            t = 0.1 * np.arange(recorded.size)
            axes.plot(t, recorded, color=QUIET, lw=2.2, label="recorded")
            axes.plot(t, simulated, color="#0072B2", lw=1.3, label="LCM")
            axes.set_ylabel(unit, fontsize=SIZE, color=QUIET)
            axes.grid(axis="y", color=LINE, lw=0.5)
        grid[0, column].set_title(title, fontsize=SIZE, color=INK, loc="left")
        grid[1, column].set_xlabel("time in the window [s]", fontsize=SIZE, color=QUIET)
    if traces:
        grid[0, 0].legend(**LEGEND)
    return figure


_CHOICES: Final = {
    "followers": "followers", "leader_from": "leader from", "accounting": "accounting", "horizon_s": "H [s]",
    "v_ref_av": "v_ref, AV [m/s]", "v_ref_hv": "v_ref, followers [m/s]", "reference": "reference",
    "aggregation": "aggregation", "comfort_scale": "N_c [m/s³]", "T_max": "T_max [s]", "leaders": "leaders",
    "after": "after T", "handover": "handover", "safety": "safety",
}  # fmt: skip


def chosen_dots(table: pd.DataFrame) -> dict[str, list[int]]:
    """For every choice that not all variants make alike, the places of the rows that make it.

    table: rows of ``multiverse``. Settings without a column of their own come last, as the variants change them.
    """
    dots: dict[str, list[int]] = {}
    for column, label in _CHOICES.items():
        values = table[column].tolist()
        for value in sorted(set(values)) if len(set(values)) > 1 else ():
            text = f"{value:g}" if isinstance(value, float) else value
            dots[f"{label}: {text}"] = [k for k, other in enumerate(values) if other == value]
    for k, changes in enumerate(table["changes"]):
        for change in changes:
            if change.partition(" = ")[0] not in _KNOWN_KEYS:
                dots.setdefault(change, []).append(k)
    return dots


_KNOWN_KEYS: Final = frozenset(
    ("accounting", "followers.model", "safety.profile", *(f"loss.{name}" for name in _CHOICES),
     *(f"planner.{name}" for name in _CHOICES))
)  # fmt: skip


def multiverse_figure(table: pd.DataFrame) -> Figure:
    """Specification curve: gains with their intervals, and the choices of each variant below. table: by gain."""
    dots = chosen_dots(table)
    low = 0.4 + 0.15 * max(len(dots), 1)
    figure, grid = panels(9.4, 2.6 + low, rows=2, sharex=True, gridspec_kw={"height_ratios": [2.2, low]})
    curve, below = grid[0, 0], grid[1, 0]
    _curve(curve, table)
    for row, places in enumerate(dots.values()):
        below.plot(places, [row] * len(places), "o", color=INK, ms=3)
    below.set_yticks(range(len(dots)), list(dots))
    below.set_ylim(len(dots) - 0.5, -0.5)
    below.set_xticks([])
    below.set_xlabel("variants, by gain", fontsize=SIZE, color=QUIET)
    below.grid(axis="y", color=LINE, lw=0.5)
    return figure


def _curve(axes: Axes, table: pd.DataFrame) -> None:
    place = np.arange(len(table))
    axes.vlines(place, 100 * table["gain_low"], 100 * table["gain_high"], color=QUIET, lw=1.2)
    for own, colour, label in ((False, "#0072B2", "one variant"), (True, "#D55E00", "as in the run")):
        mine = (table["kind"] == "run").to_numpy() == own
        axes.plot(place[mine], 100 * table["gain"].to_numpy(float)[mine], "o", color=colour, ms=4, label=label)
    axes.axhline(0, color=INK, lw=0.8)
    axes.set_ylabel("gain [%]", fontsize=SIZE, color=QUIET)
    axes.grid(axis="y", color=LINE, lw=0.5)
    axes.legend(**LEGEND)
