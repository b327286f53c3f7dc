"""Figures of the population: tables in, Figure out. Shares and gains are drawn in percent.

Figure of the choice of the start: who waits, over spacing and speed difference, and what it saves.
"""

from collections.abc import Hashable, Mapping, Sequence
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import Normalize, TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from highd_lc.reporting import labels
from highd_lc.reporting.drawing import DARK, INK, LEGEND, LINE, QUIET, SIZE, colour_bar, panels
from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS, UNITS
from highd_lc.vocab.policy import PAIRS

FloatArray = NDArray[np.float64]

ALL: Final = "all"
"""The stratum of ``validation_matrix`` that holds every event."""
_LOCAL: Final = labels.POLICIES[names.LOCAL_OPTIMUM].light
_BENCHMARK: Final = labels.POLICIES[names.BENCHMARK].light
CELL_COLOURS: Final = {
    names.FIXED: "#0072B2",
    names.FREE: "#D55E00",
    names.START: "#009E73",
    names.FREE_START: "#B0578D",
    names.ROBUST: "#00695C",
    names.ROBUST_FREE: "#8C6D1F",
}
"""Of each form."""


def matrix_figure(matrix: pd.DataFrame) -> Figure:
    """Gain of the local optimum by form and accounting, all events: point, interval, and its two sides.

    matrix: rows of ``validation_matrix``.
    """
    rows = matrix[matrix["stratum"] == ALL].iloc[::-1]
    figure, axes = _single(7.6, 0.9 + 0.42 * max(len(rows), 1))
    y = np.arange(len(rows))
    _interval(axes, y, rows, [CELL_COLOURS[form] for form in rows["form"]])
    axes.plot(100 * rows["gain_av"], y, "|", color=QUIET, ms=9, mew=1.6, label="AV alone")
    axes.plot(100 * rows["gain_hv"], y, "x", color=QUIET, ms=6, mew=1.4, label="followers alone")
    several = len(set(rows["followers"])) > 1
    axes.set_yticks(y, [_cell_label(row, several) for row in rows.itertuples(index=False)])
    _gain_axis(axes, len(rows))
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2, **LEGEND)
    return figure


def strata_figure(matrix: pd.DataFrame, *, form: str, accounting: str) -> Figure:
    """Gain in each stratum of one form and accounting, with its interval and number of events."""
    rows = matrix[(matrix["form"] == form) & (matrix["accounting"] == accounting)].iloc[::-1]
    figure, axes = _single(7.6, 0.9 + 0.27 * max(len(rows), 1))
    y = np.arange(len(rows))
    _interval(axes, y, rows, [CELL_COLOURS[form]] * len(rows))
    texts = [f"{labels.stratum(s)}  (n = {n})" for s, n in zip(rows["stratum"], rows["n_events"], strict=True)]
    axes.set_yticks(y, texts)
    _gain_axis(axes, len(rows))
    return figure


def _cell_label(row: Any, several: bool) -> str:
    model = f"{labels.follower_model(row.followers)}: " * several
    return f"{model}{labels.FORMS[row.form]}, {labels.ACCOUNTING_NAMES[row.accounting].lower()}"


def _interval(axes: Axes, y: NDArray[np.signedinteger[Any]], rows: pd.DataFrame, colours: Sequence[str]) -> None:
    for at, (_, row), colour in zip(y, rows.iterrows(), colours, strict=True):
        axes.plot(
            [100 * row["gain_low"], 100 * row["gain_high"]], [at, at], color=colour, lw=2, solid_capstyle="butt"
        )
        axes.plot(100 * row["gain"], at, "o", color=colour, ms=6)


def _gain_axis(axes: Axes, n_rows: int) -> None:
    axes.axvline(0, color=INK, lw=0.8)
    axes.set_xlabel("gain of the local optimum over the benchmark [%]", color=QUIET, fontsize=SIZE)
    axes.grid(axis="x", color=LINE, lw=0.5)
    axes.set_ylim(-0.8, max(n_rows, 1) - 0.2)


def gain_distribution(gains: Mapping[str, FloatArray]) -> Figure:
    """Share of events with at most a given gain, one curve a form. gains: by form, NaN where undefined."""
    figure, axes = _single(5.2, 3.1)
    for form, values in gains.items():
        known = np.sort(100 * values[np.isfinite(values)])
        if known.size:
            share = 100 * np.arange(1, known.size + 1) / known.size
            style = "-" if form in (names.FIXED, names.START) else "--"
            axes.step(
                known, share, style, where="post", color=CELL_COLOURS[form], lw=1.6, label=labels.FORMS[form]
            )
    axes.axvline(0, color=INK, lw=0.8)
    axes.set_xlabel("gain of an event [%]", color=QUIET, fontsize=SIZE)
    axes.set_ylabel("share of events with at most that gain [%]", color=QUIET, fontsize=SIZE)
    axes.set_ylim(0, 100)
    axes.grid(color=LINE, lw=0.5)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(**LEGEND)
    return figure


def table3_figure(summary: pd.DataFrame) -> Figure:
    """Quantiles and mean of each LCM parameter, ours beside the published ones. summary: ``summary_lcm``, all."""
    figure, grid = panels(9.4, 1.9, columns=len(PARAMETERS))
    rows = summary.set_index("quantity").to_dict("index")
    for axes, name in zip(grid[0], PARAMETERS, strict=True):
        axes.set_title(f"{name} [{UNITS[name]}]", fontsize=SIZE, color=INK, loc="left")
        if name in rows:
            _quartiles(axes, 1, rows[name], "", _LOCAL)
            _quartiles(axes, 0, rows[name], "paper_", QUIET)
        axes.set_yticks([0, 1], ["paper", "ours"])
        axes.set_ylim(-0.6, 1.6)
        axes.xaxis.set_major_locator(MaxNLocator(3))
        axes.grid(axis="x", color=LINE, lw=0.5)
    return figure


def _quartiles(axes: Axes, y: float, row: Mapping[Hashable, Any], prefix: str, colour: str) -> None:
    axes.plot(
        [row[f"{prefix}q25"], row[f"{prefix}q75"]], [y, y], color=colour, lw=5, alpha=0.45, solid_capstyle="butt"
    )
    axes.plot(row[f"{prefix}q50"], y, "|", color=colour, ms=11, mew=2)
    axes.plot(row[f"{prefix}mean"], y, "D", color=colour, ms=4.5)


def parameters_figure(followers: pd.DataFrame) -> Figure:
    """Distribution of each fitted LCM parameter. followers: rows of ``followers`` with status "fitted"."""
    figure, grid = panels(9.4, 1.9, columns=len(PARAMETERS))
    for axes, name in zip(grid[0], PARAMETERS, strict=True):
        axes.set_title(f"{name} [{UNITS[name]}]", fontsize=SIZE, color=INK, loc="left")
        if len(followers):
            axes.hist(followers[name], bins=24, color=_LOCAL, alpha=0.8)
        axes.yaxis.set_major_locator(MaxNLocator(3, integer=True))
        axes.xaxis.set_major_locator(MaxNLocator(4))
    figure.supylabel("followers", fontsize=SIZE, color=QUIET)
    return figure


def visible(tiles: pd.DataFrame) -> pd.Series:
    """Which rows may be quoted: the error in the followers' loss is known, and no larger than the effect."""
    return tiles["error_over_effect"].astype(float).le(1.0)


def loss_bars(losses: pd.DataFrame) -> Figure:
    """Mean loss of each policy, AV and followers, one panel an accounting. losses: rows of ``losses``."""
    present = set(losses["policy"].unique())
    policies = [p for p in reversed(names.POLICIES) if p in present]
    figure, grid = panels(9.4, 1.2 + 0.3 * len(policies), columns=3, sharey=True)
    means = losses.groupby(["accounting", "policy"])[["loss_av", "loss_hv"]].mean()
    for axes, accounting in zip(grid[0], names.ACCOUNTINGS, strict=True):
        values = means.reindex(pd.MultiIndex.from_product([[accounting], policies])).to_numpy(float)
        axes.barh(range(len(policies)), values[:, 0], color=_LOCAL, height=0.66, label="AV")
        axes.barh(
            range(len(policies)), values[:, 1], left=values[:, 0], color=_BENCHMARK, height=0.66, label="followers"
        )
        for y, (av, hv) in enumerate(values):
            axes.text(av + hv, y, f" {av + hv:.1f}", va="center", fontsize=SIZE, color=INK)
        axes.set_title(labels.ACCOUNTING_NAMES[accounting], fontsize=SIZE + 0.5, color=INK, loc="left")
        axes.set_xlim(0, 1.2 * np.nanmax(values.sum(axis=1), initial=1.0))
        axes.set_yticks(range(len(policies)), [labels.POLICIES[p].label for p in policies])
        axes.set_xlabel("mean loss (normalised, no unit)", fontsize=SIZE, color=QUIET)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=2, **LEGEND)
    return figure


def _single(width: float, height: float) -> tuple[Figure, Axes]:
    figure, axes = panels(width, height)
    return figure, axes[0, 0]


_PANELS: Final = (("share_waiting", "events that wait [%]"), ("saved_objective", "saved of what it minimises [%]"))
_COLOUR_MAPS: Final = {"share_waiting": "Blues", "saved_objective": "PuOr"}


def start_figure(tiles: pd.DataFrame, accounting: str = names.PRIMARY_ACCOUNTING) -> Figure:
    """Rows: self-optimum and local optimum; columns: share of events that wait, and what the choice saves them.

    tiles: ``start_map``. Numbers in the tiles are events: the density of real lane changes.
    """
    chosen = tiles[(tiles["accounting"] == accounting) & tiles["spacing_low_m"].notna()]
    figure, grid = panels(10.4, 6.6, rows=2, columns=2)
    for row, policy in zip(grid, PAIRS[names.START], strict=True):
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
    hidden = np.zeros(values.shape, bool)
    hidden[at] = ~visible(tiles) & (not share)
    for i, j in zip(*np.nonzero(hidden), strict=True):
        axes.add_patch(Rectangle((j - 0.5, i - 0.5), 1.0, 1.0, fill=False, hatch="////", lw=0.0, alpha=0.5))
    for i, j in zip(*np.nonzero(counts), strict=True):
        dark = abs(values[i, j]) > 0.6 * largest
        ink = "#ffffff" if dark else DARK
        axes.text(j, i, str(counts[i, j]), ha="center", va="center", fontsize=SIZE, color=ink)
    axes.set_xticks(range(x.size), [_from(low) for low in x])
    axes.set_yticks(range(y.size), [_from(low) for low in y])
    axes.set_xlabel("spacing of HV 1 behind the AV at the start, from [m]", fontsize=SIZE, color=QUIET)
    axes.set_ylabel("speed of HV 1 minus the AV's, from [m/s]", fontsize=SIZE, color=QUIET)
    colour_bar(figure, mesh, axes, label)


def _from(low: float) -> str:
    return f"{low:g}".replace("-", "−") if np.isfinite(low) else "below"
