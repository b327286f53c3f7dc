"""Figures of ingest and extraction: the funnel, the data's quality, the lane changes' distributions.

Tables in, Figure out. Published numbers (all 60 recordings of HighD, equations.md 11.5) are drawn beside ours.
"""

from collections.abc import Iterable, Mapping
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from highd_lc.reporting.drawing import INK, LEGEND, LINE, QUIET, SIZE, panels
from highd_lc.reporting.drawing import label as label_axes
from highd_lc.reporting.html import percent
from highd_lc.vocab import names

_COLOURS: Final = {names.CAR: "#0072B2", names.TRUCK: "#D55E00"}
_SIDES: Final = (names.LEFT, names.RIGHT, "")
_SHADES: Final = {names.LEFT: 1.0, names.RIGHT: 0.6, "": 0.3}
PUBLISHED_MEAN_S: Final = {names.CAR: 5.70, names.TRUCK: 6.22}
PUBLISHED_MEDIAN_S: Final = {names.CAR: 5.55, names.TRUCK: 6.08}
PUBLISHED_COMPLETE: Final = (7674 + 746) / 13949
"""Complete lane changes over lane-id changes, cars and trucks."""
_INCOMPLETE: Final = frozenset(names.REASONS) - {names.FOLLOWER_AHEAD, names.NO_TARGET_FOLLOWER}


def funnel_figure(crossings: pd.DataFrame, further: Mapping[str, frozenset[str]] | None = None) -> Figure:
    """What becomes of the lane-id changes: each reason takes its share off, what is left are the events.

    crossings: rows of ``crossings``. A bar is split by class (colour) and side (shade). further: ids of the events
    that got so far, by a word for it.
    """
    reasons = [reason for reason in names.REASONS if (crossings["reason"] == reason).any()]
    rows = [("all lane-id changes", crossings, 0)]
    left = len(crossings)
    for reason in reasons:
        taken = crossings[crossings["reason"] == reason]
        left -= len(taken)
        rows.append((reason.replace("_", " "), taken, left))
    usable = crossings[crossings["usable"]]
    rows.append(("usable events", usable, 0))
    rows += [(word, usable[usable["event_id"].isin(ids)], 0) for word, ids in (further or {}).items()]
    figure, grid = panels(7.6, 0.9 + 0.3 * len(rows))
    axes = grid[0, 0]
    for place, (_, part, start) in enumerate(rows):
        _split_bar(axes, place, part, start)
    axes.set_yticks(range(len(rows)), [label for label, _, _ in rows])
    axes.invert_yaxis()
    axes.set_xlim(0, max(len(crossings), 1) * 1.12)
    label_axes(axes, x="lane-id changes", grid="none")
    _add_split_legend(axes, crossings)
    return figure


def _split_bar(axes: Axes, place: int, part: pd.DataFrame, start: int) -> None:
    for kind in names.CLASSES:
        for side in _SIDES:
            n = int(((part["ego_class"] == kind) & (part["direction"] == side)).sum())
            if n:
                axes.barh(place, n, left=start, height=0.7, color=_COLOURS[kind], alpha=_SHADES[side])
            start += n
    axes.annotate(
        str(len(part)), (start, place), xytext=(4, 0), textcoords="offset points",
        va="center", fontsize=SIZE, color=INK,
    )  # fmt: skip


def _add_split_legend(axes: Axes, crossings: pd.DataFrame) -> None:
    for kind in names.CLASSES:
        for side in _SIDES:
            if ((crossings["ego_class"] == kind) & (crossings["direction"] == side)).any():
                label = f"{kind.lower()}s, to the {side}" if side else f"{kind.lower()}s, off the markings"
                axes.barh(0, 0, color=_COLOURS[kind], alpha=_SHADES[side], label=label)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="lower right", **LEGEND)


def quality_figure(recordings: pd.DataFrame) -> Figure:
    """Bias of the forward acceleration, and positions against speeds along the section.

    recordings: rows of ``recordings``, a recording and carriageway each.
    """
    figure, grid = panels(7.6, 5.4, rows=2)
    _draw_bias(grid[0, 0], recordings)
    _draw_profiles(grid[1, 0], recordings)
    return figure


_WAYS: Final = {1: ("#0072B2", "o", "upper carriageway"), 2: ("#D55E00", "s", "lower carriageway")}


def _draw_bias(axes: Axes, recordings: pd.DataFrame) -> None:
    axes.axhline(0, color=LINE, linewidth=1)
    for direction, (colour, marker, label) in _WAYS.items():
        rows = recordings[recordings["driving_direction"] == direction]
        if len(rows):
            axes.plot(rows["recording_id"], rows["mean_acceleration"], marker, color=colour, ms=4, label=label)
            axes.plot(rows["recording_id"], rows["mean_speed_change"], marker, color=colour, ms=6, mfc="none")
    axes.plot([], [], "o", color=QUIET, mfc="none", ms=6, label="hollow: from first and last speed")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    label_axes(axes, x="recording", y="mean forward\nacceleration [m/s²]", grid="none")
    axes.legend(ncols=3, loc="lower left", bbox_to_anchor=(0, 1), **LEGEND)


def _draw_profiles(axes: Axes, recordings: pd.DataFrame) -> None:
    """The mean disagreement in each bin of 10 m, a line a recording and carriageway."""
    axes.axhline(0, color=LINE, linewidth=1)
    rows: Iterable[Any] = recordings.itertuples(index=False)
    for row in rows:
        profile = np.asarray(row.disagreement_profile, dtype=float)
        x = row.entry_m + 10.0 * (np.arange(len(profile)) + 0.5)
        axes.plot(x, profile, color=_WAYS[row.driving_direction][0], linewidth=0.8, alpha=0.7)
    label_axes(
        axes,
        x="place along the section, from its entry [m]",
        y="change of position\nminus speed [m/s]",
        grid="none",
    )


def distributions_figure(crossings: pd.DataFrame, events: pd.DataFrame) -> Figure:
    """Duration, lateral shift, peak lateral speed, gaps and followers at the start of the events.

    crossings, events: rows of the tables of that name. Published means (solid) and medians (dashed) of the
    duration are drawn beside ours, and the share of crossings whose start and end are in view is stated.
    """
    figure, grid = panels(7.6, 5.6, rows=2, columns=3)
    axes = grid.ravel()
    figure.suptitle(_completeness(crossings), fontsize=SIZE, color=INK, x=0.01, ha="left")
    _draw_duration(axes[0], crossings, events)
    absolute = events.assign(lateral_shift_m=events["lateral_shift_m"].abs())
    _histogram(axes[1], absolute, "lateral_shift_m", "lateral shift [m]")
    _histogram(axes[2], events, "peak_lateral_speed_mps", "peak lateral speed [m/s]")
    _histogram(axes[3], events, "gap_ahead_m", "gap to the target leader [m]")
    _histogram(axes[4], events, "gap_behind_m", "gap to the target follower [m]")
    _draw_followers(axes[5], events)
    handles, _ = axes[0].get_legend_handles_labels()
    if handles:
        figure.legend(handles=handles, loc="outside lower left", ncols=len(handles), **LEGEND)
    return figure


def _completeness(crossings: pd.DataFrame) -> str:
    if not len(crossings):
        return "no lane-id changes"
    complete = 1 - float(crossings["reason"].isin(_INCOMPLETE).mean())
    cut = float(crossings["reason"].isin([names.CUT_BEFORE_START, names.CUT_AFTER_END]).mean())
    return (
        f"{len(crossings)} lane-id changes: {percent(complete, 0)} complete "
        f"(published: {percent(PUBLISHED_COMPLETE, 0)}), {percent(cut, 0)} censored by the ends of the tracks"
    )


def _draw_duration(axes: Axes, crossings: pd.DataFrame, events: pd.DataFrame) -> None:
    """Durations of the events, with the published mean (solid) and median (dashed) of each class."""
    _histogram(axes, events, "duration_s", "duration [s]")
    for kind in events["ego_class"].unique():
        axes.axvline(PUBLISHED_MEAN_S[kind], color=_COLOURS[kind], linewidth=1.2)
        axes.axvline(PUBLISHED_MEDIAN_S[kind], color=_COLOURS[kind], linewidth=1.2, linestyle="--")
    if len(events):
        axes.plot([], [], color=QUIET, linewidth=1.2, label="published mean")
        axes.plot([], [], color=QUIET, linewidth=1.2, linestyle="--", label="published median")


def _histogram(axes: Axes, events: pd.DataFrame, column: str, label: str) -> None:
    """Share of the events of each class in each bin."""
    known = events[column].dropna().to_numpy(dtype=float)
    n_bins = min(30, max(5, round(len(known) ** 0.5)))
    edges = np.histogram_bin_edges(known, bins=n_bins).tolist() if len(known) else None
    for kind in names.CLASSES:
        values = events.loc[events["ego_class"] == kind, column].dropna().to_numpy(dtype=float)
        if len(values):
            weights = np.full(len(values), 100 / len(values))
            name = f"{kind.lower()}s (n = {len(values)})"
            axes.hist(
                values, edges, weights=weights, histtype="step", color=_COLOURS[kind], linewidth=1.4, label=name
            )
    label_axes(axes, x=label, y="share [%]", grid="none")


def _draw_followers(axes: Axes, events: pd.DataFrame) -> None:
    counts = events["follower_ids"].map(len)
    for place, kind in enumerate(names.CLASSES):
        own = counts[events["ego_class"] == kind]
        if len(own):
            shares = 100 * own.value_counts(normalize=True).sort_index()
            axes.bar(shares.index + 0.4 * (place - 0.5), shares, width=0.38, color=_COLOURS[kind])
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    label_axes(axes, x="followers on the target lane", y="share [%]", grid="none")
