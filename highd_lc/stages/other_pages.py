"""Planners of others on the pages of events: their rows as those of ours, their motions as written.

Their motions are not worked out again: a planner is asked once, and what it answered stands in ``trajectories``.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from highd_lc.io import artefacts
from highd_lc.reporting.event import Path, Play, Row, TrackTrace
from highd_lc.stages.scenes import TIME_STEP
from highd_lc.stages.trajectories import SIMULATED, TRACKED
from highd_lc.vocab import names
from highd_lc.vocab.job import Job
from highd_lc.vocab.tracking import KINEMATIC

FloatArray = NDArray[np.float64]

_PLANNED: Final = (names.SOLVED, names.CONTACT)
_NOT_OF_OTHERS: Final = {
    "at_bound": None, "margins": None, "moments": None, "rejected_by": None, "candidates": 0,
    "contact_after_T": None, "delay_s": 0.0, "gap": names.RECORDED_GAP, "fallback": "", "binding": "",
}  # fmt: skip
"""What is told of the search for our plans."""
_TRACKED: Final = (
    "rmse_longitudinal_m", "rmse_heading_rad", "max_slack", "qp_failures", "loss_av_planned", "loss_hv_planned",
    "loss_hv_tracked", "min_clearance_planned_m", "min_clearance_tracked_m",
)  # fmt: skip
"""What is not kept of the tracking of others' plans."""


@dataclass(frozen=True)
class OtherRows:
    """A recording's rows of ``other_plans`` by event, and of ``trajectories`` by event, planner and kind."""

    plans: Mapping[str, tuple[Row, ...]] = field(default_factory=dict)
    motions: Mapping[tuple[str, str, str], pd.DataFrame] = field(default_factory=dict)

    @classmethod
    def read(cls, job: Job) -> "OtherRows":
        """Those of a job's recording; nothing where no planner was asked."""
        frame = artefacts.read(job.work, "other_plans", recording=job.recording)
        if frame.empty:
            return cls()
        wanted = [("policy", "in", sorted(frame["policy"].unique()))]
        moved = artefacts.read_partition(job.work, "trajectories", job.recording, where=wanted)
        rows: list[Any] = frame.to_dict("records")
        plans: dict[str, list[Row]] = {}
        for row in rows:
            plans.setdefault(row["event_id"], []).append(row)
        motions = {(str(e), str(p), str(k)): of for (e, p, k), of in moved.groupby(["event_id", "policy", "kind"])}
        return cls({event: tuple(of) for event, of in plans.items()}, motions)

    def plan_rows(self, event_id: str) -> tuple[Row, ...]:
        """As rows of ``plans``."""
        return tuple({**_NOT_OF_OTHERS, **row} for row in self.plans.get(event_id, ()))

    def loss_rows(self, event_id: str) -> tuple[Row, ...]:
        """As rows of ``losses``."""
        beside = {"follower_weights": None, "recorded_n_samples": 0}
        return tuple({**beside, **row} for row in self.plans.get(event_id, ()))

    def tracking_rows(self, event_id: str) -> tuple[Row, ...]:
        """As rows of ``tracking``."""
        driven = (row for row in self.plans.get(event_id, ()) if row["tracking_status"])
        return tuple(
            {**dict.fromkeys(_TRACKED), **row, "plant": KINEMATIC, "status": row["tracking_status"],
             "violations": row["tracked_violations"]}
            for row in driven
        )  # fmt: skip

    def plays(self, event_id: str, *, followers: int) -> Iterator[Play]:
        """The written motions of an event, one a planner. followers: how many there are."""
        roles = [names.target_follower(rank + 1) for rank in range(followers)]
        for policy, rows in self._planned(event_id).items():
            motion = self.motions.get((event_id, policy, SIMULATED))
            if motion is not None:
                of_role = {str(role): of for role, of in motion.groupby("role")}
                ego = _path(of_role[names.EGO])
                yield Play(
                    policy=policy,
                    accountings=tuple(row["accounting"] for row in rows),
                    T=float(rows[0]["T"]),
                    ego=ego,
                    jerk=np.full(ego.x.size, np.nan),
                    followers=tuple(_path(of_role[role]) for role in roles),
                )

    def traces(self, event_id: str) -> Iterator[TrackTrace]:
        """The paths that the kinematic car drove; errors and inputs are not kept."""
        nothing = np.empty(0)
        for policy in self._planned(event_id):
            motion = self.motions.get((event_id, policy, TRACKED))
            if motion is not None:
                path = _path(motion)
                t = TIME_STEP * np.arange(path.x.size, dtype=np.float64)
                yield TrackTrace(policy, KINEMATIC, t, nothing, nothing, nothing, nothing, path)

    def _planned(self, event_id: str) -> dict[str, list[Row]]:
        """The rows of each planner that has a plan."""
        found: dict[str, list[Row]] = {}
        for row in self.plans.get(event_id, ()):
            if row["status"] in _PLANNED:
                found.setdefault(row["policy"], []).append(row)
        return found


def _path(rows: pd.DataFrame) -> Path:
    """A vehicle's motion from its rows of ``trajectories``, in the order of time."""
    x, y, vx, ax = (rows[name].to_numpy(float) for name in ("x", "y", "vx", "ax"))
    vy = np.gradient(y, TIME_STEP) if len(y) > 1 else np.zeros(len(y))
    return Path(x, y, np.hypot(vx, vy), ax)
