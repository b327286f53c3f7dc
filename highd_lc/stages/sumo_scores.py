"""Events of a sample replayed in SUMO: plans scored among followers that none of our models drives.

The AV and the leaders are moved along their ways; what its followers then do is charged as everywhere.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from highd_lc.io import sumo_replay
from highd_lc.io.sumo_replay import Driven, Moved
from highd_lc.planning.crowd import seeded_hash
from highd_lc.planning.planner import Plan, PlanningProblem, contact_of, made_once
from highd_lc.planning.replay import AvMotion, Replay, clearances
from highd_lc.planning.scene import Motion
from highd_lc.scoring import charges
from highd_lc.stages.tracking_tables import Planned
from highd_lc.tracking.plan_tracking import PlanTracker
from highd_lc.vocab import names
from highd_lc.vocab.policy import POLICIES
from highd_lc.vocab.tables import TABLES

FloatArray = NDArray[np.float64]
Row = dict[str, Any]

_KEY: Final = ["policy", "driven_by", "follower"]
_MEANS: Final = ("loss", "peak_decel", "speed_drop_mps")


@dataclass(frozen=True)
class SumoTracker(PlanTracker):
    """An event whose followers SUMO drives. seed: of the run."""

    seed: int = 0

    def around(self, plan: Plan, av: AvMotion) -> Replay:
        """Everybody around a motion of the AV for a plan that starts at t_start; ``av`` is completed in place."""
        return self.among(super().around(plan, av), plan.policy)

    def among(self, played: Replay, policy: str) -> Replay:
        """A policy's replay with SUMO's followers instead of its own."""
        packed, av = self.problem.packed, played.av
        if policy in (names.HUMAN, names.NO_LANE_CHANGE):  # motions of the box centre
            packed = packed._replace(rear_to_centre=0.0)
        x, v, a = self._followers(av)
        to_T, after_T = clearances(av.x, av.y, av.vx, av.vy, av.n, av.crossing, packed, x)
        return replace(played, x=x, v=v, a=a, clearance_to_T=to_T, clearance_after_T=after_T)

    def _followers(self, av: AvMotion) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Box centre, speed and acceleration of SUMO's followers, each (p, N + 1)."""
        scene, followers = self.problem.scene, self.problem.scene.followers
        ego = Moved(av.x + scene.length / 2.0, av.y, av.vx, scene.length, scene.width)
        half = followers.length / 2.0
        front, v, a = sumo_replay.drive(
            [ego, *leaders(self.problem)],
            Driven(followers.x + half, followers.v, followers.length, followers.width),
            lateral_shift=scene.lateral_shift,
            dt=scene.dt,
            model=self.problem.settings.sumo.model,
            seed=seeded_hash(f"{self.seed}/{scene.event_id}/sumo"),
        )
        return front - half[:, None], v, a


def leaders(problem: PlanningProblem) -> list[Moved]:
    """The leaders of both lanes along their tracks: on their lane while they lead it, a lane beyond else."""
    scene, found = problem.scene, []
    if scene.origin_leader is not None:
        found.append(_along(scene.origin_leader, np.zeros(scene.samples)))
    every = [(0, scene.target_leader), *((one.since, one.motion) for one in scene.next_leaders)]
    ends = [since for since, _ in every[1:]] + [scene.samples]
    for (since, motion), end in zip(every, ends, strict=True):
        if motion is not None:
            y = np.full(scene.samples, 2.0 * scene.lateral_shift)
            y[since:end] = scene.lateral_shift
            found.append(_along(motion, y))
    return found


def _along(motion: Motion, y: FloatArray) -> Moved:
    return Moved(motion.x + motion.length / 2.0, y, motion.v, motion.length, motion.width)


def sumo_rows(planned: Planned, sumo: SumoTracker) -> Iterator[Row]:
    """Rows of ``sumo_followers``: each follower behind every plan, as SUMO drives it and as the planning model."""
    plans = [p for p in planned.plans if p.accounting == names.PRIMARY_ACCOUNTING and p.replay is not None]
    at_start = [plan for plan in plans if not POLICIES[plan.policy].chooses_start]
    for model, replays in (
        (names.SUMO, made_once(at_start, lambda plan: _replayed(sumo, plan))),
        (planned.model, [_own(plan) for plan in at_start]),
    ):
        unchanged = next(r for p, r in zip(at_start, replays, strict=True) if p.policy == names.NO_LANE_CHANGE)
        for plan, played in zip(at_start, replays, strict=True):
            met = contact_of(planned.tracker.problem, plan.policy, played, plan.accounting)
            for row in _follower_rows(played, unchanged, planned.tracker.problem):
                yield {"policy": plan.policy, "driven_by": model, "contact": met} | row


def _own(plan: Plan) -> Replay:
    assert plan.replay is not None, "asked for plans alone"
    return plan.replay


def _replayed(sumo: SumoTracker, plan: Plan) -> Replay:
    return sumo.among(_own(plan), plan.policy)


def _follower_rows(played: Replay, unchanged: Replay, problem: PlanningProblem) -> Iterator[Row]:
    """What each follower is charged over 0 .. H, brakes, and falls behind its speed without a lane change."""
    losses = charges.cumulative_losses(played, problem.terms, problem.scene.dt).hv.upto(-1).loss
    behind = unchanged.v - played.v
    for i, loss in enumerate(losses):
        yield {
            "follower": i + 1,
            "loss": float(loss),
            "peak_decel": float(max(0.0, -played.a[i].min())),
            "speed_drop_mps": float(max(0.0, behind[i].max())),
            "lowest_speed_mps": float(played.v[i].min()),
        }


def sumo_summary(found: pd.DataFrame) -> pd.DataFrame:
    """One row a policy, driver and follower. found: the artefact ``sumo_followers``."""
    touching = found[found["contact"].ne("")]
    met = set(zip(touching["event_id"], touching["policy"], strict=True))
    clear = [pair not in met for pair in zip(found["event_id"], found["policy"], strict=True)]
    rows = []
    for (policy, driven_by, follower), own in found.assign(clear=clear).groupby(_KEY, sort=False):
        kept = own[own["clear"]]
        about = {"policy": policy, "driven_by": driven_by, "follower": follower, "n_events": len(own)}
        about |= {"contacts": int(own["contact"].ne("").sum()), "n_compared": len(kept)}
        rows.append(about | {name: float(kept[name].mean()) for name in _MEANS})
    return pd.DataFrame(rows, columns=list(TABLES["sumo_summary"].column_names))
