"""The AV's car in the closed loop: plans in, the motion that is driven out, span by span."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.quintic import Quintic, sample
from highd_lc.planning.replay import AvMotion
from highd_lc.tracking.closed_loop import (
    Controller,
    Log,
    bicycle_velocity,
    drive_span,
    new_log,
    reference_rows,
    tracking_errors,
)
from highd_lc.tracking.daqp_call import check_daqp
from highd_lc.tracking.mpc import HEADING, SPEED
from highd_lc.tracking.plan_tracking import SampledMotion, plan_reference

FloatArray = NDArray[np.float64]


class Tracker(Protocol):
    """What drives plans. All samples are those of the event, ``av`` is its AV over 0 .. H."""

    def take(self, plan: Quintic, k: int, place: float, *, fresh: bool) -> None:
        """Drive another plan from sample k and x = place [m] on. fresh: the first one of a manoeuvre."""

    def drive(self, av: AvMotion, k: int, stop: int) -> None:
        """Drive from sample k to ``stop``, whose place and speed are filled in as well."""

    def finish(self, av: AvMotion, first: int, end: int) -> None:
        """Fill in what is known only when the manoeuvre of the samples first .. end is over."""

    def largest_error(self, first: int, end: int) -> float:
        """Largest lateral tracking error over a manoeuvre [m]; NaN where none was tracked."""


class ExactTracker:
    """The AV is where it planned to be: no car, no error."""

    def __init__(self, dt: float) -> None:
        self._dt = dt

    def take(self, plan: Quintic, k: int, place: float, *, fresh: bool) -> None:
        """See ``Tracker``."""
        s = sample(plan, np.arange(round(plan.T / self._dt) + 1, dtype=np.float64) * self._dt)
        self._start = k
        self._columns = {
            "x": s.x + place,
            "y": s.y,
            "vx": s.vx,
            "vy": s.vy,
            "ax": s.ax,
            "jerk": np.abs(s.jx) + np.abs(s.jy),
        }

    def drive(self, av: AvMotion, k: int, stop: int) -> None:
        """See ``Tracker``."""
        span = slice(k, stop + 1)
        for name, column in self._columns.items():
            getattr(av, name)[span] = column[k - self._start : stop + 1 - self._start]

    def finish(self, av: AvMotion, first: int, end: int) -> None:
        """See ``Tracker``."""

    def largest_error(self, first: int, end: int) -> float:
        """See ``Tracker``."""
        return float("nan")


@dataclass
class MpcTracker:
    """The kinematic bicycle under the MPC; the plan is known to it ``horizon`` samples ahead.

    wheelbase [m]; samples: of the event, N + 1; shared: a controller of the settings.
    """

    wheelbase: float
    dt: float
    horizon: int
    samples: int
    shared: Controller

    def __post_init__(self) -> None:
        check_daqp()
        self._rows = np.zeros((self.samples + 1 + self.horizon, 5))
        self._log: Log = new_log(self.samples)
        self._noise = np.zeros((self.samples + 1, 3))
        self._held = np.zeros(2)

    def take(self, plan: Quintic, k: int, place: float, *, fresh: bool) -> None:
        """See ``Tracker``."""
        rows = reference_rows(plan_reference(plan, self.dt), self.wheelbase, self.horizon)
        rows[:, 0] += place
        self._rows[k : k + len(rows)] = rows[: len(self._rows) - k]
        if fresh:
            # The car arrives with the reference's first input.
            self._rows[max(k - 1, 0)] = rows[0]
            self._held[:] = rows[0, SPEED:]
            self._log.states[k] = rows[0, : HEADING + 1]

    def drive(self, av: AvMotion, k: int, stop: int) -> None:
        """See ``Tracker``."""
        self._step(k, stop)
        self._write(av, slice(k, stop))
        av.x[stop], av.y[stop] = self._log.states[stop, :2]
        heading = self._log.states[stop, HEADING]
        av.vx[stop], av.vy[stop] = self._held[0] * np.cos(heading), self._held[0] * np.sin(heading)

    def _step(self, k: int, stop: int) -> None:
        both = (self.wheelbase, self.wheelbase)
        p, memory = self.shared
        drive_span((k, stop), self._held, self._rows, both, self._noise, p, memory, self._log)

    def _write(self, av: AvMotion, span: slice) -> None:
        av.x[span], av.y[span] = self._log.states[span, 0], self._log.states[span, 1]
        velocity = bicycle_velocity(self._log)[span]
        av.vx[span], av.vy[span] = velocity[:, 0], velocity[:, 1]

    def finish(self, av: AvMotion, first: int, end: int) -> None:
        """See ``Tracker``."""
        self._step(end, end + 1)
        span = slice(first, end + 1)
        self._write(av, span)
        before = av.ax[first - 1] if first else 0.0
        motion = SampledMotion(self.dt, np.column_stack([av.vx[span], av.vy[span]]))
        av.jerk[span] = motion.charged_jerk
        if first:
            # A car that waited has an acceleration before the first sample, not half an interval away from it.
            ax, ay = motion.acceleration[0]
            av.jerk[first] = (abs(ax - before) + abs(ay)) / self.dt
        av.ax[span] = np.append(motion.acceleration[:, 0], 0.0)

    def largest_error(self, first: int, end: int) -> float:
        """See ``Tracker``."""
        if end <= first:
            return float("nan")
        span = slice(first, end + 1)
        return float(np.abs(tracking_errors(self._log.states[span], self._rows[span])[:, 1]).max())
