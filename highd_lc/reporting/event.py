"""What a page or a figure of an event is made from: plain arrays and rows, nothing read from files.

Time grid of all motions: t_k = k dt, k = 0 .. N, t = 0 at t_start. Coordinates are relative to the ego's box
centre at t_start: x forward, y left [m]. NaN stands for "not in view".
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.reporting import html
from highd_lc.vocab import names
from highd_lc.vocab.driver import LOWER_BOUNDS, PARAMETERS, UPPER_BOUNDS
from highd_lc.vocab.policy import PAIRS
from highd_lc.vocab.tables.fits import NOT_IDENTIFIABLE

FloatArray = NDArray[np.float64]
Row = Mapping[str, Any]


@dataclass(frozen=True)
class Path:
    """A vehicle's motion: x, y of its box centre [m], speed v [m/s], acceleration a [m/s^2]; shape (N + 1,)."""

    x: FloatArray
    y: FloatArray
    v: FloatArray
    a: FloatArray


@dataclass(frozen=True)
class Play:
    """One way in which the event runs: a policy under the accountings that led to the same plan.

    T: end of the manoeuvre [s], NaN where there is none; delay_s: its start [s]. ego,
    followers (nearest first): their motions; jerk: the |jx| + |jy| charged to the ego [m/s^3], shape (N + 1,).
    measured: whether these are recorded data. plans: of who plans anew on the way, when each was made [s], and the
    planned x and y from there on [m].
    """

    policy: str
    accountings: tuple[str, ...]
    T: float
    ego: Path
    jerk: FloatArray
    followers: tuple[Path, ...]
    measured: bool = False
    delay_s: float = 0.0
    plans: tuple[tuple[float, FloatArray, FloatArray], ...] = ()


@dataclass(frozen=True)
class Box:
    """A vehicle's box: length and width [m]."""

    length: float
    width: float


@dataclass(frozen=True)
class Surface:
    """The planner's losses over (T, x_final), fixed form.

    T [s], shape (m,); x_final relative to v0 T [m], shape (n,); loss_av, loss_hv: per accounting, shape
    (m, n); feasible: per accounting, boolean of shape (m, n). blocked: per accounting, place in ``blockers`` of
    what a candidate breaks first, 0 = nothing, shape (m, n); empty: not known.
    """

    T: FloatArray
    x_offset: FloatArray
    loss_av: Mapping[str, FloatArray]
    loss_hv: Mapping[str, FloatArray]
    feasible: Mapping[str, NDArray[np.bool_]]
    blocked: Mapping[str, NDArray[np.uint8]] = field(default_factory=dict)
    blockers: tuple[str, ...] = ()


@dataclass(frozen=True)
class FitTrace:
    """A follower's calibration window: recorded against simulated, t [s] relative to t_start (negative).

    All of shape (n,): spacing [m] front to front, speed [m/s].
    """

    t: FloatArray
    spacing_recorded: FloatArray
    spacing_simulated: FloatArray
    speed_recorded: FloatArray
    speed_simulated: FloatArray


@dataclass(frozen=True)
class TrackTrace:
    """Tracking of a policy's plan: errors e_lateral, e_longitudinal [m], inputs v [m/s], delta [rad], each empty
    where they were not kept; path: the motion of the box centre as driven.
    """

    policy: str
    plant: str
    t: FloatArray
    lateral: FloatArray
    longitudinal: FloatArray
    v: FloatArray
    delta: FloatArray
    path: Path


@dataclass(frozen=True)
class PredictionTrace:
    """HV 1 behind the recorded lane changer: its speed as recorded and as each follower model has it [m/s].

    t [s] on a regular grid from t_start on; all of shape (n,), NaN only at the ends. default: the one that plans.
    """

    t: FloatArray
    recorded: FloatArray
    models: Mapping[str, FloatArray]
    default: str = ""


@dataclass(frozen=True)
class Ground:
    """The road from above as JPEG, and where its ends are in the event's frame [m]: left, right; lower, upper."""

    jpeg: bytes
    x: tuple[float, float]
    y: tuple[float, float]


@dataclass(frozen=True)
class EventReport:
    """Everything that a page or a figure shows of one event.

    event: its row of ``events``; plans, losses, fits, tracking: its rows of those tables. v0: ego's speed at
    t_start [m/s]. dt: step of the motions [s]. divider: y of the marking that is crossed [m]; markings: y of all
    markings of the carriageway, ascending [m]. boxes: of each role. others: motions of the roles that no policy
    moves; observed: how many of their samples were recorded, the rest is predicted. leads: from which sample on
    which of them leads the target lane ("" = nobody). provenance: labels, values. identified: of the run, rows of
    ``identifiability`` by parameter. ground: a picture of the road, on pages that are not shared.
    """

    event: Row
    v0: float
    dt: float
    divider: float
    markings: tuple[float, ...]
    boxes: Mapping[str, Box]
    others: Mapping[str, Path]
    observed: Mapping[str, int]
    plays: tuple[Play, ...]
    plans: tuple[Row, ...]
    losses: tuple[Row, ...]
    fits: tuple[Row, ...] = ()
    fit_traces: Mapping[int, FitTrace] = field(default_factory=dict)
    tracking: tuple[Row, ...] = ()
    track_traces: tuple[TrackTrace, ...] = ()
    surface: Surface | None = None
    prediction: PredictionTrace | None = None
    provenance: tuple[tuple[str, str], ...] = ()
    leads: tuple[tuple[int, str], ...] = ()
    identified: Mapping[str, Row] = field(default_factory=dict)
    ground: Ground | None = None

    @property
    def event_id(self) -> str:
        """The event's id."""
        return str(self.event["event_id"])

    @property
    def n_followers(self) -> int:
        """p, the number of followers on the target lane."""
        return len(self.plays[0].followers) if self.plays else len(self.event["follower_ids"])

    @property
    def planners(self) -> tuple[str, ...]:
        """Planners of others that were asked, in the order of their rows."""
        return tuple(dict.fromkeys(row["policy"] for row in self.plans if row["policy"] not in names.POLICIES))

    def play(self, policy: str, accounting: str = names.PRIMARY_ACCOUNTING) -> Play | None:
        """The play of a policy under an accounting; None if the policy has no plan there."""
        return next((p for p in self.plays if p.policy == policy and accounting in p.accountings), None)

    def plan(self, policy: str, accounting: str = names.PRIMARY_ACCOUNTING) -> Row | None:
        """The row of ``plans`` of a policy under an accounting."""
        return self._plan_of.get((policy, accounting))

    def loss(self, policy: str, accounting: str = names.PRIMARY_ACCOUNTING) -> Row | None:
        """The row of ``losses`` of a policy under an accounting."""
        return self._loss_of.get((policy, accounting))

    @cached_property
    def _plan_of(self) -> dict[tuple[str, str], Row]:
        return _by_cell(self.plans)

    @cached_property
    def _loss_of(self) -> dict[tuple[str, str], Row]:
        return _by_cell(self.losses)

    def gain(self, form: str = names.FIXED, accounting: str = names.PRIMARY_ACCOUNTING) -> float:
        """1 - total loss of the local optimum over that of the benchmark; NaN if either is infeasible."""
        benchmark, local = (self.loss(p, accounting) for p in PAIRS[form])
        if local is None or benchmark is None:
            return float("nan")
        return gain(local["loss_total"], benchmark["loss_total"])


def gain(total_local: float, total_benchmark: float) -> float:
    """Relative gain 1 - local / benchmark; NaN where a total is missing or the benchmark's is 0."""
    if not np.isfinite(total_local) or not np.isfinite(total_benchmark) or total_benchmark == 0:
        return float("nan")
    return 1.0 - float(total_local) / float(total_benchmark)


def _by_cell(rows: tuple[Row, ...]) -> dict[tuple[str, str], Row]:
    """Rows by policy and accounting, of which there is one each."""
    return {(row["policy"], row["accounting"]): row for row in rows}


_WIDE: Final = 0.10
"""A spread of more than this share of a parameter's range leaves it open."""
_TIED: Final = 0.90
"""From this correlation on two parameters are known together alone."""
_RANGES: Final = UPPER_BOUNDS.as_array() - LOWER_BOUNDS.as_array()


def driver_says(fit: Mapping[str, Any], identified: Mapping[str, Mapping[str, Any]]) -> str:
    """Which parameters of a follower may be believed, and why not the others, in a sentence.

    fit: a row of ``followers``; identified: rows of the run's ``identifiability`` by parameter, if it has any.
    """
    if fit["status"] != names.FITTED:
        return (
            "None of the parameters is this driver's: nothing was fitted to him, they are "
            f"{'Table 3 means' if fit['status'] == names.TABLE3 else 'those of a driver of the pool'}."
        )
    why = {name: _doubt(fit, name, identified.get(name, {})) for name in PARAMETERS}
    sure = [name for name, doubt in why.items() if not doubt]
    doubts = [f"{name} ({doubt})" for name, doubt in why.items() if doubt]
    believed = f"To be believed: {', '.join(sure)}." if sure else "No parameter is to be believed by itself."
    return f"{believed} Not: {', '.join(doubts)}." if doubts else believed


def _doubt(fit: Mapping[str, Any], name: str, known: Mapping[str, Any]) -> str:
    """Why a parameter is not believed; empty where it is."""
    if name in (() if fit["at_bound"] is None else fit["at_bound"]):
        return "on a bound"
    spread = dict(fit["spread"] or {}).get(name)
    if spread is None:
        return "spread not known"
    if spread > _WIDE * _RANGES[PARAMETERS.index(name)]:
        return f"± {html.number(spread, 2)} over equally good fits"
    if known.get("verdict") == NOT_IDENTIFIABLE:
        width = html.percent(known["width"], 0)
        return f"not identifiable in this run: profiles are {width} of the range wide"
    if known.get("correlation", 0.0) >= _TIED:
        return f"tied to {known['partner']}, |r| {html.number(known['correlation'], 2)}"
    return ""
