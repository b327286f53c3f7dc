"""Figures of the paper's scenario 1 and 3: what follows behind the AV, plans, losses, the weight of the AV."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from highd_lc.core.quintic import Quintic, Samples, sample
from highd_lc.reporting import labels
from highd_lc.reporting.drawing import INK, LEGEND, QUIET, SIZE, label, panels
from highd_lc.scenarios.platoon import Platoon, time_headways
from highd_lc.vocab import names
from highd_lc.vocab.published import WEIGHTS

FloatArray = NDArray[np.float64]

PAIR: Final = tuple(WEIGHTS)
_COLOUR: Final = {policy: labels.POLICIES[policy].light for policy in PAIR}
_LABEL: Final = {policy: labels.POLICIES[policy].label for policy in PAIR}


@dataclass(frozen=True)
class Story:
    """A situation as it went on: its key and, of each policy, the plan and the platoon behind it.

    v_av [m/s]: speed of the AV at t_start; unchanged: the platoon without the AV; approach: before t_start.
    """

    key: str
    v_av: float
    plans: dict[str, Quintic]
    platoons: dict[str, Platoon]
    unchanged: Platoon
    approach: Platoon

    @property
    def policies(self) -> tuple[str, ...]:
        """Policies with a plan."""
        return tuple(policy for policy in PAIR if policy in self.plans)


def follower_figure(story: Story, *, seconds: float) -> Figure:
    """Trajectories, speed, acceleration and time headway of the followers, one column a policy (figure 8)."""
    figure, axes = panels(9.4, 9.2, rows=4, columns=2, sharex=True, sharey="row")
    for column, policy in enumerate(story.policies):
        platoon = story.platoons[policy]
        shown = platoon.t <= seconds
        headway = time_headways(platoon)
        # A moving frame: 25 m/s of common motion would hide the differences.
        lanes = (
            platoon.front[:, shown] - 25.0 * platoon.t[shown],
            platoon.v[:, shown],
            platoon.a[:, shown],
            headway[:, shown],
        )
        for row, values in enumerate(lanes):
            _followers(axes[row, column], platoon.t[shown], values)
        lead = platoon.lead
        axes[0, column].plot(platoon.t[shown], lead.front[shown] - 25.0 * platoon.t[shown], color=INK, lw=1.6)
        axes[1, column].plot(platoon.t[shown], lead.v[shown], color=INK, lw=1.6, label="AV")
        label(axes[0, column], title=_LABEL[policy], y="x − 25 t [m]" if column == 0 else "")
        for row, text in ((1, "speed [m/s]"), (2, "acceleration [m/s²]"), (3, "time headway [s]")):
            label(axes[row, column], y=text if column == 0 else "", x="time after t_start [s]" if row == 3 else "")
    axes[1, 0].legend(loc="lower right", **LEGEND)
    _rank_key(figure, axes, len(story.unchanged.front))
    return figure


def _followers(axes: Axes, t: FloatArray, values: FloatArray) -> None:
    for i, row in enumerate(values):
        axes.plot(t, row, color=_rank_colour(i, len(values)), lw=1.1)


def _rank_colour(i: int, count: int) -> Any:
    return matplotlib.colormaps["viridis"](0.22 + 0.66 * i / max(count - 1, 1))


def _rank_key(figure: Figure, axes: Any, count: int) -> None:
    colours = ListedColormap([_rank_colour(i, count) for i in range(count)])
    norm = BoundaryNorm(np.arange(0.5, count + 1), count)
    bar = figure.colorbar(ScalarMappable(norm, colours), ax=axes, pad=0.01, aspect=60, ticks=range(1, count + 1))
    bar.set_label("follower HV", color=QUIET, fontsize=SIZE)
    bar.ax.tick_params(labelsize=SIZE, colors=QUIET, length=0)
    bar.outline.set_visible(False)


def plan_figure(stories: Mapping[str, Story]) -> Figure:
    """The plans of both policies, one column a situation: forward offset, lateral position, speed, forward

    acceleration, lateral speed and acceleration (figure 9). The offset is x - v0 t.
    """
    rows = ("x − v₀ t [m]", "y [m]", "speed [m/s]", "a_x [m/s²]", "v_y [m/s]", "a_y [m/s²]")
    figure, axes = panels(9.4, 9.4, rows=len(rows), columns=len(stories), sharex="col", sharey="row")
    for column, story in enumerate(stories.values()):
        for policy in story.policies:
            plan = story.plans[policy]
            _plan_curves(axes[:, column], sample(plan, np.linspace(0.0, plan.T, 201)), plan, policy)
        for one, text in zip(axes[:, column], rows, strict=True):
            label(one, y=text if column == 0 else "")
        axes[0, column].set_title(f"AV at {story.v_av:g} m/s", fontsize=SIZE + 0.5, color=INK, loc="left")
        axes[-1, column].set_xlabel("time after t_start [s]", fontsize=SIZE, color=QUIET)
    axes[0, 0].legend(loc="upper left", **LEGEND)
    return figure


def _plan_curves(axes: Any, s: Samples, plan: Quintic, policy: str) -> None:
    style = {"color": _COLOUR[policy], "lw": 1.8, "ls": "--" if policy == names.BENCHMARK else "-"}
    curves = (s.x - plan.v0 * s.t, s.y, np.hypot(s.vx, s.vy), s.ax, s.vy, s.ay)
    for one, values in zip(axes, curves, strict=True):
        one.plot(s.t, values, label=f"{_LABEL[policy]}", **style)
        one.plot(plan.T, values[-1], "o", color=_COLOUR[policy], ms=4)


@dataclass(frozen=True)
class PrintedLosses:
    """Printed losses of AV and followers under a policy."""

    av: float
    hv: float


def loss_figure(cells: pd.DataFrame, *, printed: Mapping[str, PrintedLosses]) -> Figure:
    """Losses of scenario 1 by part, benchmark beside local optimum, one panel an accounting (figure 10).

    cells: rows of ``scenario_cells`` of scenario 1, default variant. A bar is half of comfort and efficiency each;
    the paper's two bars stand in a panel of their own.
    """
    figure, axes = panels(9.4, 3.4, columns=4, sharey=True)
    _printed_bars(axes[0, 0], printed)
    for one, accounting in zip(axes[0, 1:], names.ACCOUNTINGS, strict=True):
        rows = cells[cells["accounting"] == accounting]
        for x, (form, omega) in enumerate((f, o) for f in names.FORMS for o in WEIGHTS.values()):
            _stack(one, x, rows[(rows["form"] == form) & (rows["omega_av"] == omega)])
        one.set_xticks(range(4), ["bench.", "local", "bench.\nfree", "local\nfree"])
        label(one, title=_accounting(accounting), grid="y")
    axes[0, 0].margins(y=0.08)
    axes[0, 0].set_ylabel("loss (normalised)", fontsize=SIZE, color=QUIET)
    handles = [Patch(color=colour, label=text) for _, text, colour in labels.LOSS_PARTS]
    figure.legend(handles=handles, loc="outside lower center", ncols=4, **LEGEND)
    return figure


def _stack(axes: Axes, x: int, row: pd.DataFrame) -> None:
    doubt = "" if row.empty else row["not_valid"].iloc[0]
    if row.empty or not np.isfinite(row["loss_total"].iloc[0]):
        axes.text(x, 0, doubt or "no plan", rotation=90, fontsize=SIZE, color=QUIET, ha="center", va="bottom")
        return
    base = 0.0
    for column, _, colour in labels.LOSS_PARTS:
        height = 0.5 * float(row[column].iloc[0])
        axes.bar(x, height, bottom=base, color=colour, width=0.68)
        base += height
    star = "*" if doubt else ""
    axes.text(x, base, f"{base:.1f}{star}", ha="center", va="bottom", fontsize=SIZE - 0.5, color=INK)


def _printed_bars(axes: Axes, printed: Mapping[str, PrintedLosses]) -> None:
    for x, policy in enumerate(PAIR):
        losses = printed[policy]
        axes.bar(x, losses.av, color="#3F94CF", width=0.68)
        axes.bar(x, losses.hv, bottom=losses.av, color="#DB8A2E", width=0.68)
        axes.text(x, losses.av / 2, "AV", ha="center", va="center", fontsize=SIZE, color="white")
        axes.text(x, losses.av + losses.hv / 2, "HV", ha="center", va="center", fontsize=SIZE, color="white")
        total = losses.av + losses.hv
        axes.text(x, total, f"{total:.1f}", ha="center", va="bottom", fontsize=SIZE - 0.5, color=INK)
    axes.set_xticks(range(2), ["bench.", "local"])
    label(axes, title="Paper, as printed", grid="y")


def weight_figure(cells: pd.DataFrame, *, printed: Mapping[float, PrintedLosses]) -> Figure:
    """Losses over the weight of the AV, one panel an accounting (figure 11); dashed: free end speed.

    cells: rows of ``scenario_cells`` of scenario 1, default variant; printed: the paper's points by weight.
    """
    figure, axes = panels(9.4, 3.6, columns=3, sharey=True)
    quantities = (("loss_av", "AV", "#0072B2"), ("loss_hv", "followers", "#D55E00"), ("loss_total", "total", INK))
    for one, accounting in zip(axes[0], names.ACCOUNTINGS, strict=True):
        for form, style in ((names.FIXED, "-"), (names.FREE, "--")):
            rows = cells[(cells["accounting"] == accounting) & (cells["form"] == form)].sort_values("omega_av")
            for column, text, colour in quantities:
                mark = text if form == names.FIXED else None
                one.plot(
                    rows["omega_av"], rows[column], style, color=colour, lw=1.6, marker="o", ms=2.5, label=mark
                )
        for omega, losses in printed.items():
            for value, (_, _, colour) in zip(
                (losses.av, losses.hv, losses.av + losses.hv), quantities, strict=True
            ):
                one.plot(omega, value, "D", ms=5.5, mfc="none", mec=colour, mew=1.3, clip_on=False)
        label(one, title=_accounting(accounting), x="weight of the AV, omega_AV")
    axes[0, 0].set_ylim(bottom=0)
    axes[0, 0].set_ylabel("loss (normalised)", fontsize=SIZE, color=QUIET)
    handles, texts = axes[0, 0].get_legend_handles_labels()
    free = Line2D([], [], color=QUIET, ls="--")
    paper = Line2D([], [], color=QUIET, marker="D", mfc="none", ls="none")
    figure.legend(
        [*handles, free, paper],
        [*texts, "free end speed", "paper"],
        loc="outside lower center",
        ncols=5,
        **LEGEND,
    )
    return figure


def printed_state_figure(cells: pd.DataFrame, *, printed: Mapping[str, PrintedLosses]) -> Figure:
    """Losses of scenario 3 over the speed of the AV, which is not printed: a row a form, a column an accounting.

    cells: rows of ``scenario_cells`` of scenario 3. Horizontal lines: the printed totals.
    """
    figure, axes = panels(9.4, 5.2, rows=2, columns=3, sharex=True, sharey=True)
    for row, form in enumerate(names.FORMS):
        for one, accounting in zip(axes[row], names.ACCOUNTINGS, strict=True):
            chosen = cells[(cells["form"] == form) & (cells["accounting"] == accounting)]
            _totals_over_speed(one, chosen, printed)
            label(one, title=f"{labels.FORMS[form]}, {_accounting(accounting).lower()}")
        label(axes[row, 0], title=axes[row, 0].get_title(loc="left"), y="total loss (normalised)")
    for one in axes[-1]:
        one.set_xlabel("speed of the AV at t_start [m/s]", fontsize=SIZE, color=QUIET)
    axes[0, 0].set_ylim(bottom=0)
    handles, texts = axes[0, 0].get_legend_handles_labels()
    dotted = Line2D([], [], color=QUIET, ls=":")
    figure.legend([*handles, dotted], [*texts, "printed"], loc="outside lower center", ncols=3, **LEGEND)
    return figure


def _totals_over_speed(axes: Axes, cells: pd.DataFrame, printed: Mapping[str, PrintedLosses]) -> None:
    for policy, omega in WEIGHTS.items():
        rows = cells[cells["omega_av"] == omega].sort_values("v_start")
        style = "--" if policy == names.BENCHMARK else "-"
        axes.plot(rows["v_start"], rows["loss_total"], style, color=_COLOUR[policy], lw=1.8, label=_LABEL[policy])
        axes.axhline(printed[policy].av + printed[policy].hv, color=_COLOUR[policy], lw=0.9, ls=":")


def _accounting(name: str) -> str:
    return f"Accounting {labels.ACCOUNTING_NAMES[name].lower()}"
