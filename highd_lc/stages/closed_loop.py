"""The closed loop of a sample of events: every drive, and every decision on the way (equations.md 7.5)."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.quintic import Quintic, StartState, sample
from highd_lc.driving.causes import causes
from highd_lc.driving.loop import Case, ClosedLoop, Replan, drive_closed_loop
from highd_lc.driving.recorded import recorded_contacts, recorded_drive
from highd_lc.driving.tracker import ExactTracker, MpcTracker, Tracker
from highd_lc.io.workspace import append_log
from highd_lc.planning.crowd import Crowd
from highd_lc.planning.limits import pairs, target_leader_lengths
from highd_lc.planning.planner import PlanningProblem, pose
from highd_lc.planning.replay import Replay, box_centre
from highd_lc.reporting.event import Path, Play
from highd_lc.scoring import charges
from highd_lc.stages.scene_drivers import read_drivers
from highd_lc.stages.scenes import SceneTables, driven_by
from highd_lc.stages.tracking_tables import Planned
from highd_lc.stages.validate_robust import Judges, crowd_for, trackers_of
from highd_lc.tracking.closed_loop import controller
from highd_lc.vocab import names
from highd_lc.vocab.job import Job
from highd_lc.vocab.policy import REPLANNED
from highd_lc.vocab.tables.closed_loop import RECORDED_DRIVE

FloatArray = NDArray[np.float64]
Row = dict[str, Any]

DRIVES: Final = "closed_loop"
REPLANS: Final = "closed_loop_replans"
MOTIONS: Final = "closed_loop_motions"
_SAFETY: Final = ("min_gap_m", "min_ttc_s", "max_drac")


@dataclass(frozen=True)
class Drives:
    """The drives of a recording's sampled events.

    tables: with the drivers of the follower models that the settings name; sample: ids of the events; judges: of
    the crowd of the robust policy; times: of each drive, its event, policy and decisions [s].
    """

    job: Job
    tables: SceneTables
    sample: frozenset[str]
    judges: Judges
    times: list[tuple[str, str, list[float]]] = field(default_factory=list)

    @classmethod
    def of(cls, job: Job, tables: SceneTables, sample: frozenset[str], judges: Judges) -> "Drives":
        """The drives of the run's settings. Raises ArtefactError without a follower model that they name."""
        mine, drivers = sample & frozenset(tables.events["event_id"]), dict(tables.drivers)
        asked = job.settings.validation.closed_loop
        for model in {asked.followers, asked.world} - {"", *drivers} if mine else ():
            drivers[model] = read_drivers(job.work, job.recording, tables.followers, model)
        return cls(job, replace(tables, drivers=drivers), mine, judges)

    def rows(self, planned: Planned) -> Iterator[tuple[str, Row]]:
        """Rows of an event, each with its table. planned: with the default follower model."""
        scene = planned.tracker.problem.scene
        if scene.event_id not in self.sample:
            return
        problem, believed = self._as_believed(planned.tracker.problem, planned.model)
        world, real = self._as_driven(problem, believed)
        about = {"followers": believed, "world": real, "leaders": self._asked.leaders}
        crowd = self._crowd(planned, problem)
        for policy in REPLANNED:
            case = Case(problem, world.packed, policy, self._asked, crowd)
            loop, known = (drive_closed_loop(one, self._tracker(problem)) for one in (case, case.foreseen()))
            self.times.append((scene.event_id, policy, [decision.seconds for decision in loop.replans]))
            why = list(causes(case, loop, known, partial(self._tracker, problem)))
            yield DRIVES, {"policy": policy, "contact_reason": why} | about | drive_row(world, loop, known)
            for decision in loop.replans:
                yield REPLANS, {"policy": policy} | replan_row(decision, scene.dt)
            for row in motion_rows(world, loop.replay):
                yield MOTIONS, {"policy": policy} | row
        if scene.human is not None and scene.followers.recorded:
            yield DRIVES, human_row(problem) | {"leaders": RECORDED_DRIVE}

    @property
    def _asked(self) -> Any:
        return self.job.settings.validation.closed_loop

    def _as_believed(self, problem: PlanningProblem, model: str) -> tuple[PlanningProblem, str]:
        """The event with the followers that the AV believes in, and their model's name."""
        asked = self._asked.followers
        if asked in ("", model):
            return problem, model
        return pose(driven_by(problem.scene, asked, self.tables), problem.settings), asked

    def _as_driven(self, problem: PlanningProblem, believed: str) -> tuple[PlanningProblem, str]:
        """The event with the followers that there are, and their model's name."""
        asked = self._asked.world
        if asked in ("", believed):
            return problem, believed
        return pose(driven_by(problem.scene, asked, self.tables), problem.settings), asked

    def _crowd(self, planned: Planned, problem: PlanningProblem) -> Crowd:
        known = planned.judges if problem is planned.tracker.problem else {}
        judging = known or trackers_of(problem, self.judges, self.tables)
        return crowd_for(problem, dict(judging), self.judges, seed=self.job.settings.seed)

    def _tracker(self, problem: PlanningProblem) -> Tracker:
        scene, settings = problem.scene, problem.settings.tracking
        if self._asked.tracker == "none":
            return ExactTracker(scene.dt)
        shared = controller(settings, scene.dt)
        return MpcTracker(scene.wheelbase, scene.dt, settings.horizon, scene.samples, shared)

    def log_times(self) -> None:
        """Write the times to the run's log: they differ from run to run, as no artefact may."""
        for event_id, policy, seconds in self.times:
            low, high = np.percentile(seconds, [50, 99]).tolist()
            times = {"solve_ms_median": round(1e3 * low, 3), "solve_ms_p99": round(1e3 * high, 3)}
            about = {"event_id": event_id, "policy": policy, "replans": len(seconds)}
            append_log(self.job.work, about | times)


def drive_row(world: PlanningProblem, loop: ClosedLoop, known: ClosedLoop) -> Row:
    """The columns of ``closed_loop`` of a drive. world: with the followers that there are; known: the drive of who
    knows all that comes.
    """
    own, foreseen = losses_of(world, loop), losses_of(world, known)
    both = [loop.status, known.status] == [names.CHANGED] * 2
    verdicts, dt = [decision.verdict for decision in loop.replans], world.scene.dt
    begun = loop.status != names.NEVER_BEGUN
    return {
        "status": loop.status,
        "reason": loop.reason,
        "contacts": len(loop.met),
        "contact_cause": list(loop.met),
        "aborted": loop.status == names.ABORTED,
        "replans": len(verdicts),
        "new_plans": verdicts.count(names.REPLANNED),
        "freed": verdicts.count(names.FREED),
        "relaxed": verdicts.count(names.RELAXED),
        "pressed": verdicts.count(names.LATEST),
        "held": verdicts.count(names.HELD),
        "delay_s": round(loop.began * dt, 10) if begun else np.nan,
        "T": round((loop.ended - loop.began) * dt, 10) if begun else np.nan,
        "seen_s": round((len(loop.replay.av.x) - 1) * dt, 10),
        "loss_av": own[0],
        "loss_hv": own[1],
        "loss_foresight": sum(foreseen),
        "regret": sum(own) - sum(foreseen) if both else np.nan,
        "max_lateral_m": loop.max_lateral_m,
        **_nearness(world, loop.replay, joins=loop.status == names.CHANGED, last=len(loop.replay.av.x) - 1),
    }


def losses_of(world: PlanningProblem, loop: ClosedLoop) -> tuple[float, float]:
    """Loss of the AV and of the followers under the accounting ``equal``; NaN after a contact."""
    if loop.met:
        return np.nan, np.nan
    dt, terms, replay = world.scene.dt, world.terms, loop.replay
    losses = charges.cumulative_losses(replay, terms, dt)
    found: Any = charges.losses_at(losses, names.PRIMARY_ACCOUNTING, terms, n=replay.av.n, dt=dt)
    return float(found["loss_av"]), float(found["loss_hv"])


def _nearness(problem: PlanningProblem, replay: Replay, *, joins: bool, last: int) -> Row:
    """How near vehicles come to one another."""
    lane = pairs(replay, problem.packed, joins=joins, lengths=target_leader_lengths(problem.scene))
    found = charges.safety(lane, last)
    nearest = np.minimum(replay.clearance_to_T, replay.clearance_after_T).min(initial=np.inf)
    clearance = {"min_clearance_m": float(nearest) if np.isfinite(nearest) else np.nan}
    return clearance | {name: found[name] for name in _SAFETY}


def replan_row(decision: Replan, dt: float) -> Row:
    """The columns of ``closed_loop_replans`` of a decision."""
    row: Row = {"t": round(decision.k * dt, 10), "verdict": decision.verdict, "binding": decision.binding}
    row["x"] = decision.x
    plan = decision.plan
    if plan is None:
        return row
    start = plan.start
    row |= {"T": plan.T, "y": start.y, "v": plan.v0, "ax": start.ax, "vy": start.vy, "ay": start.ay}
    row |= {"x_final": plan.x_final, "y_final": plan.D, "v_end": plan.v_end}
    return row | {"objective": decision.objective}


def motion_rows(world: PlanningProblem, replay: Replay) -> Iterator[Row]:
    """The columns of ``closed_loop_motions`` of everybody whom a drive moves."""
    av = replay.av
    x, y = box_centre(av, world.packed.rear_to_centre)
    speed = np.hypot(av.vx, av.vy)
    yield {"role": names.EGO} | _lists(x=x, y=y, v=speed, a=av.ax, jerk=av.jerk)
    for i, level in enumerate(world.packed.follower_y.tolist()):
        own = {"x": replay.x[i], "y": np.full(len(x), level), "v": replay.v[i], "a": replay.a[i]}
        yield {"role": names.target_follower(i + 1)} | _lists(**own, jerk=np.empty(0))


def _lists(**columns: FloatArray) -> Row:
    return {name: np.round(values, 4).tolist() for name, values in columns.items()}


def loop_plays(
    drives: Sequence[Mapping[str, Any]], replans: Sequence[Mapping[str, Any]], motions: Sequence[Mapping[str, Any]]
) -> Iterator[Play]:
    """An event's drives as its page plays them. drives, replans, motions: its rows of these tables."""
    T = {row["policy"]: row["delay_s"] + row["T"] for row in drives}
    for policy in dict.fromkeys(row["policy"] for row in motions):
        of = {row["role"]: row for row in motions if row["policy"] == policy}
        ego = of.pop(names.EGO)
        yield Play(
            policy=policy,
            accountings=(names.PRIMARY_ACCOUNTING,),
            T=float(T[policy]),
            ego=_path(ego),
            jerk=np.asarray(ego["jerk"], np.float64),
            followers=tuple(_path(of[role]) for role in sorted(of, key=lambda role: int(role.rsplit("_", 1)[1]))),
            plans=tuple(_line(row) for row in replans if row["policy"] == policy and np.isfinite(row["T"])),
        )


def _path(row: Mapping[str, Any]) -> Path:
    return Path(*(np.asarray(row[name], np.float64) for name in ("x", "y", "v", "a")))


def _line(row: Mapping[str, Any]) -> tuple[float, FloatArray, FloatArray]:
    """When a plan was made, and its way from there on: x, y [m] every half second or so."""
    start = StartState(row["ax"], row["y"], row["vy"], row["ay"])
    plan = Quintic(row["v"], row["y_final"], row["T"], row["x_final"], row["v_end"], start)
    s = sample(plan, np.linspace(0.0, plan.T, max(round(2.0 * plan.T), 4) + 1))
    return float(row["t"]), s.x + row["x"], s.y


def human_row(problem: PlanningProblem) -> Row:
    """Contacts among what was recorded, for comparison."""
    replay, last = recorded_drive(problem)
    met = recorded_contacts(problem, replay, last)
    return {
        "policy": names.HUMAN,
        "followers": RECORDED_DRIVE,
        "world": RECORDED_DRIVE,
        "status": RECORDED_DRIVE,
        "reason": "",
        "contacts": len(met),
        "contact_cause": list(met),
        "contact_reason": [names.BY_RECORDING] * len(met),
        "aborted": False,
        **dict.fromkeys(("replans", "new_plans", "freed", "relaxed", "pressed", "held"), 0),
        "T": round(problem.scene.dt * replay.av.n, 10),
        "seen_s": round(problem.scene.dt * last, 10),
        **_nearness(problem, replay, joins=True, last=last),
    }
