"""A plan in one figure: the way across and everybody's speed."""

from typing import Final

import pandas as pd
from matplotlib.figure import Figure

from highd_lc.reporting import labels
from highd_lc.reporting.drawing import INK, LEGEND, QUIET, label, panels
from highd_lc.vocab import names

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
    label(across, title=labels.POLICIES[policy].label, y="y, left positive [m]")
    label(speeds, x="time after t_start [s]; dashed: end of the lane change", y="speed [m/s]")
    speeds.legend(**LEGEND, loc="upper left", bbox_to_anchor=(1.0, 1.05))
    return figure


def _look(role: str, policy: str) -> tuple[str, float]:
    """Colour and width of a role's line."""
    if role == names.EGO:
        return labels.POLICIES[policy].light, 2.0
    if role.startswith(names.TARGET_FOLLOWER):
        return _FOLLOWERS[(int(role.rsplit("_", 1)[1]) - 1) % len(_FOLLOWERS)], 1.4
    return (INK if role == names.TARGET_LEADER else QUIET), 1.0
