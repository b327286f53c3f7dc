"""Figures over space and time: speed maps, trajectories in a rectangle, growth along a platoon, a plan."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from highd_lc.reporting import labels
from highd_lc.reporting.drawing import INK, LEGEND, QUIET, SIZE, colour_bar, label, panels
from highd_lc.reporting.figures_scenarios import PAIR, Story
from highd_lc.vocab import names

FloatArray = NDArray[np.float64]

_COLOUR: Final = {policy: labels.POLICIES[policy].light for policy in PAIR}
_LABEL: Final = {policy: labels.POLICIES[policy].label for policy in PAIR}
_DRIVER_COLOURS: Final = ("#222222", "#0072B2", "#56B4E9", "#009E73", "#E69F00", "#B0578D", "#D55E00")


@dataclass(frozen=True)
class SpeedMap:
    """Speed [m/s] in the cells of a grid, NaN where nobody was; shape (space cells, time cells)."""

    x_edges: FloatArray
    t_edges: FloatArray
    speed: FloatArray


def speed_maps_figure(maps: Mapping[str, Mapping[str, SpeedMap]]) -> Figure:
    """Speed over space and time: benchmark, local optimum and their difference (figures 12 and 13).

    maps: by title of the row, then by policy. Empty cells stay white.
    """
    figure, axes = panels(9.4, 3.1 * len(maps), rows=len(maps), columns=3, sharex=True, sharey=True)
    pairs = [[by_policy[policy].speed for policy in PAIR] for by_policy in maps.values()]
    every = np.concatenate([speed.ravel() for pair in pairs for speed in pair])
    low, high = np.nanmin(every), np.nanmax(every)
    largest = max(float(np.nanmax(np.abs(pair[1] - pair[0]))) for pair in pairs)
    norm = TwoSlopeNorm(0.0, -max(largest, 0.1), max(largest, 0.1))
    for row, (title, by_policy) in enumerate(maps.items()):
        for column, policy in enumerate(PAIR):
            image = _map(axes[row, column], by_policy[policy], cmap="viridis", vmin=low, vmax=high)
            label(axes[row, column], title=f"{title}: {_LABEL[policy].lower()}", grid="none")
        difference = SpeedMap(
            by_policy[PAIR[0]].x_edges, by_policy[PAIR[0]].t_edges, pairs[row][1] - pairs[row][0]
        )
        change = _map(axes[row, 2], difference, cmap="PuOr", norm=norm)
        label(axes[row, 2], title="local − benchmark", grid="none")
        axes[row, 0].set_ylabel("x from the AV at t_start [m]", fontsize=SIZE, color=QUIET)
    for one in axes[-1]:
        one.set_xlabel("time after t_start [s]", fontsize=SIZE, color=QUIET)
    colour_bar(figure, image, axes[:, :2], "speed [m/s]")
    colour_bar(figure, change, axes[:, 2], "difference [m/s]")
    return figure


def _map(axes: Axes, shown: SpeedMap, **how: Any) -> Any:
    extent = (shown.t_edges[0], shown.t_edges[-1], shown.x_edges[0], shown.x_edges[-1])
    return axes.imshow(shown.speed, origin="lower", extent=extent, aspect="auto", interpolation="nearest", **how)


@dataclass(frozen=True)
class Window:
    """A rectangle in space and time: from x to x [m], from t to t [s]."""

    x: tuple[float, float]
    t: tuple[float, float]


def rectangle_figure(stories: Mapping[str, Story], windows: Mapping[str, Window], *, followers: int) -> Figure:
    """Trajectories of the first followers in the rectangle of Table 1, one column a situation (figure 14)."""
    figure, axes = panels(9.4, 4.6, columns=len(stories))
    for one, (key, story) in zip(axes[0], stories.items(), strict=True):
        window = windows[key]
        for policy in story.policies:
            platoon = story.platoons[policy]
            shown = platoon.t <= window.t[1] + 2.0
            style = {"color": _COLOUR[policy], "lw": 1.1, "ls": "--" if policy == names.BENCHMARK else "-"}
            one.plot(platoon.t[shown], platoon.front[:followers, shown].T, **style)
            one.plot(platoon.t[shown], platoon.lead.front[shown], **{**style, "lw": 2.2})
            one.plot([], [], label=_LABEL[policy], **style)
        one.add_patch(
            Rectangle(
                (window.t[0], window.x[0]),
                window.t[1] - window.t[0],
                window.x[1] - window.x[0],
                facecolor="#56B4E9",
                alpha=0.16,
                edgecolor="none",
            )
        )
        one.set_xlim(-0.5, window.t[1] + 2.0)
        one.set_ylim(window.x[0] - 120.0, window.x[1] + 60.0)
        label(one, title=f"AV at {story.v_av:g} m/s", x="time after t_start [s]")
    axes[0, 0].set_ylabel("front, from the AV's at t_start [m]", fontsize=SIZE, color=QUIET)
    axes[0, 0].legend(loc="lower right", **LEGEND)
    return figure


@dataclass(frozen=True)
class LaneState:
    """Edie's measures on a lane: flow [veh/h], speed [km/h], density [veh/km], shape (space cells, time cells).

    ego: t [s] and x [m] of the vehicle that changes lane; t = 0 is its crossing.
    """

    x_edges: FloatArray
    t_edges: FloatArray
    flow: FloatArray
    speed: FloatArray
    density: FloatArray
    ego: tuple[FloatArray, FloatArray]


def lane_state_figure(state: LaneState) -> Figure:
    """Flow, speed and density of the target lane around a recorded lane change."""
    figure, axes = panels(9.4, 3.4, columns=3, sharey=True)
    shown = (("flow [veh/h]", state.flow), ("speed [km/h]", state.speed), ("density [veh/km]", state.density))
    for one, (text, values) in zip(axes[0], shown, strict=True):
        image = _map(one, SpeedMap(state.x_edges, state.t_edges, values), cmap="viridis")
        one.plot(*state.ego, color="white", lw=3.2)
        one.plot(*state.ego, color=INK, lw=1.6)
        one.axvline(0.0, color=INK, lw=0.8, ls=":")
        one.set_xlim(state.t_edges[0], state.t_edges[-1])
        label(one, title=text, x="time after the crossing [s]", grid="none")
        colour_bar(figure, image, one, "")
    axes[0, 0].set_ylabel("x along the section [m]", fontsize=SIZE, color=QUIET)
    return figure


def wave_field_figure(observed: SpeedMap, simulated: SpeedMap) -> Figure:
    """Speed behind lane changes laid over each other: observed, simulated, and simulated minus observed."""
    figure, axes = panels(9.4, 3.4, columns=3, sharey=True)
    difference = simulated.speed - observed.speed
    every = np.concatenate([observed.speed.ravel(), simulated.speed.ravel()])
    # The outermost cells hold a vehicle or two: they must not set the scale.
    low, high = np.nanquantile(every, [0.02, 0.98])
    largest = max(float(np.nanquantile(np.abs(difference), 0.98)), 0.1) if np.isfinite(difference).any() else 0.1
    for one, shown, title in zip(axes[0], (observed, simulated), ("observed", "simulated"), strict=False):
        image = _map(one, shown, cmap="viridis", vmin=low, vmax=high)
        label(one, title=title, x="time after t_start [s]", grid="none")
    norm = TwoSlopeNorm(0.0, -largest, largest)
    change = _map(axes[0, 2], SpeedMap(observed.x_edges, observed.t_edges, difference), cmap="PuOr", norm=norm)
    label(axes[0, 2], title="simulated − observed", x="time after t_start [s]", grid="none")
    axes[0, 0].set_ylabel("x from the ego, moving [m]", fontsize=SIZE, color=QUIET)
    colour_bar(figure, image, axes[:, :2], "speed − ego's at t_start [m/s]")
    colour_bar(figure, change, axes[:, 2], "difference [m/s]")
    return figure


def growth_figure(stability: pd.DataFrame, growth: pd.DataFrame) -> Figure:
    """String stability over speed, and how far up the platoon each policy's disturbance reaches.

    stability: rows of ``string_stability``; growth: rows of ``growth``. Left: amplification from vehicle to
    vehicle, above 1 it grows. Right: largest drop below the speed that lasts, one panel a speed of the AV.
    """
    scenarios = list(dict.fromkeys(growth["scenario"]))
    figure, axes = panels(9.4, 6.4, rows=2, columns=2)
    colours = dict(zip(dict.fromkeys(stability["drivers"]), _DRIVER_COLOURS, strict=False))
    first = axes[0, 0]
    for drivers, rows in stability.groupby("drivers", sort=False):
        first.plot(rows["speed_mps"], rows["gain"], color=colours[drivers], lw=1.6, label=drivers)
    first.axhline(1.0, color=INK, lw=0.8)
    label(first, title="String stability", x="equilibrium speed [m/s]", y="largest amplification")
    for one, scenario in zip(axes.flat[1:], scenarios, strict=False):
        rows = growth[growth["scenario"] == scenario]
        for (drivers, policy), part in rows.groupby(["drivers", "policy"], sort=False):
            style = "--" if policy == names.BENCHMARK else "-"
            one.plot(part["follower"], part["undershoot_mps"], style, color=colours[drivers], lw=1.4)
        one.set_xscale("log")
        one.set_xticks([1, 2, 5, 10, 20, 50, 100], ["1", "2", "5", "10", "20", "50", "100"])
        one.set_xticks([], minor=True)
        label(one, title=_growth_title(scenario), x="follower HV", y="drop below the lasting speed [m/s]")
    handles, texts = first.get_legend_handles_labels()
    lines = [Line2D([], [], color=QUIET, ls=style) for style in ("--", "-")]
    figure.legend(
        [*handles, *lines], [*texts, "benchmark", "local optimum"], loc="outside lower center", ncols=4, **LEGEND
    )
    return figure


def _growth_title(scenario: str) -> str:
    speed = "25" if scenario == "1" else scenario.removeprefix("2_")
    return f"AV at {speed} m/s before a platoon at 25 m/s"


_FOLLOWERS: Final = ("#009E73", "#8E6BBF", "#B0578D", "#7F9F3F", "#4FB3A5")


def plan_figure(motion: pd.DataFrame, *, policy: str, T: float) -> Figure:
    """The ego's lateral position and the speeds of all vehicles over time.

    motion: role, t [s], y [m], v [m/s], a row a role and sample; T: end of the lane change [s].
    """
    figure, axes = panels(7.2, 4.6, rows=2, sharex=True)
    across, speeds = axes[:, 0]
    for role, rows in motion.groupby("role", sort=False):
        colour, width = _look(str(role), policy)
        style = ":" if role == names.ORIGIN_FOLLOWER else "-"
        speeds.plot(rows["t"], rows["v"], style, color=colour, lw=width, label=labels.role(str(role)))
        if role == names.EGO:
            across.plot(rows["t"], rows["y"], color=colour, lw=width)
    for one in (across, speeds):
        one.axvline(T, color=QUIET, lw=0.8, ls="--", zorder=0)
    label(across, title=labels.look(policy).label, y="y, left positive [m]")
    label(speeds, x="time after t_start [s]; dashed: end of the lane change", y="speed [m/s]")
    speeds.legend(**LEGEND, loc="upper left", bbox_to_anchor=(1.0, 1.05))
    return figure


def _look(role: str, policy: str) -> tuple[str, float]:
    """Colour and width of a role's line."""
    if role == names.EGO:
        return labels.look(policy).light, 2.0
    if role.startswith(names.TARGET_FOLLOWER):
        return _FOLLOWERS[(int(role.rsplit("_", 1)[1]) - 1) % len(_FOLLOWERS)], 1.4
    return (INK if role == names.TARGET_LEADER else QUIET), 1.0
