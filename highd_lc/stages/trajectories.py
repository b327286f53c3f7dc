"""The artefact ``trajectories``: what was recorded, planned, simulated and tracked, on the grid of 0.1 s."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import pandas as pd
import pyarrow as pa
from numpy.typing import NDArray

from highd_lc.io import artefacts
from highd_lc.planning.planner import Plan, PlanningProblem
from highd_lc.planning.replay import AvMotion, box_centre, following
from highd_lc.planning.scene import Motion, driven_by
from highd_lc.reporting import labels
from highd_lc.reporting.event import PredictionTrace
from highd_lc.stages.other_planners import OtherPlan
from highd_lc.stages.scene_drivers import Columns, behind_recorded
from highd_lc.stages.scenes import TIME_STEP
from highd_lc.stages.tracking_tables import Planned
from highd_lc.tracking.plan_tracking import DrivenPlan
from highd_lc.vocab import names
from highd_lc.vocab.job import Job
from highd_lc.vocab.tables import PARTITIONED, TABLES
from highd_lc.vocab.tables.prediction import RECORDED
from highd_lc.vocab.tracking import KINEMATIC

SingleArray = NDArray[np.float32]
FloatArray = NDArray[np.float64]

JudgedDrivers = dict[str, dict[tuple[str, ...], Columns]]
"""Of each follower model, of each event what of its followers a scene needs."""
SIMULATED: Final = "simulated"
TRACKED: Final = "tracked"
_STAGE: Final = "validate"
_NAME: Final = PARTITIONED[_STAGE]
_KEY: Final = TABLES[_NAME].order[:-1]
_VALUES: Final = ("t", "x", "y", "vx", "ax")
_TRACES_A_GROUP: Final = 4096
"""Traces of a row group: about half a million rows, so that the words beside them never fill the memory."""


@dataclass(frozen=True)
class Trace:
    """A vehicle's motion. key: the columns that name it, in the table's order; values: t, x, y, vx, ax, (5, n)."""

    key: tuple[str, ...]
    values: SingleArray


def recorded_traces(event_id: str, motions: Iterable[tuple[str, int, Motion]]) -> Iterator[Trace]:
    """Everybody's recorded motion while in view. motions: role, first sample in view, motion."""
    for role, first, motion in motions:
        key = (event_id, names.PRIMARY_ACCOUNTING, RECORDED, "", RECORDED, role)
        yield _trace(key, (motion.x, motion.y, motion.v, motion.a), first, motion.observed)


def planned_traces(planned: Planned) -> Iterator[Trace]:
    """What a follower model makes of an event: each policy's motions, behind the recorded ego, and as tracked."""
    problem = planned.tracker.problem
    for plan in planned.plans:
        yield from _simulated(problem, plan, planned.model)
        if plan.policy == names.HUMAN and plan.accounting == names.PRIMARY_ACCOUNTING and plan.replay is not None:
            key = (problem.scene.event_id, plan.accounting, RECORDED, planned.model, SIMULATED)
            motion = plan.replay.x, plan.replay.v, plan.replay.a
            yield from _followers(problem, motion, key, seen=plan.replay.av.recorded + 1)
    for plan, plant, driven in planned.drives:
        if plant == KINEMATIC:
            yield from _tracked(problem, plan, planned.model, driven)


def other_traces(planned: Planned, others: Iterable[OtherPlan]) -> Iterator[Trace]:
    """What somebody else's planners make of an event, as of ours. planned: with the model that drives all."""
    problem = planned.tracker.problem
    for one in others:
        yield from _simulated(problem, one.plan, planned.model)
        yield from _tracked(problem, one.plan, planned.model, one.driven)


def _simulated(problem: PlanningProblem, plan: Plan, model: str) -> Iterator[Trace]:
    """The AV and its followers under a plan of the primary accounting."""
    if plan.accounting == names.PRIMARY_ACCOUNTING and plan.replay is not None:
        key = (problem.scene.event_id, plan.accounting, plan.policy, model, SIMULATED)
        yield _trace((*key, names.EGO), _ego(problem, plan, plan.replay.av))
        yield from _followers(problem, (plan.replay.x, plan.replay.v, plan.replay.a), key, seen=None)


def _tracked(problem: PlanningProblem, plan: Plan, model: str, driven: DrivenPlan | None) -> Iterator[Trace]:
    """The AV up to T as the kinematic car drove it."""
    if driven is not None and driven.replay is not None:
        key = (problem.scene.event_id, plan.accounting, plan.policy, model, TRACKED)
        av = driven.replay.av
        yield _trace((*key, names.EGO), _ego(problem, plan, av), last=av.n + 1)


def judged_traces(planned: Sequence[Planned], judged: JudgedDrivers) -> Iterator[Trace]:
    """The followers behind the recorded ego under the judged models that do not plan the event."""
    problem = planned[0].tracker.problem
    scene, done = problem.scene, {one.model for one in planned}
    plan = next(p for p in planned[0].plans if p.policy == names.HUMAN)
    assert plan.replay is not None, "recorded"
    av = plan.replay.av
    for model, drivers in judged.items():
        if model in done or (scene.event_id,) not in drivers:
            continue
        followers = behind_recorded(scene.followers, drivers[scene.event_id,], model)
        packed = driven_by(problem.packed, followers, problem.settings)
        key = (scene.event_id, names.PRIMARY_ACCOUNTING, RECORDED, model, SIMULATED)
        yield from _followers(problem, following(av, packed), key, seen=av.recorded + 1)


def _ego(problem: PlanningProblem, plan: Plan, av: AvMotion) -> tuple[FloatArray, ...]:
    """The AV's box centre: of a quintic's motion the planned point is the rear axle."""
    at_rear_axle = plan.policy not in (names.HUMAN, names.NO_LANE_CHANGE)
    x, y = box_centre(av, problem.packed.rear_to_centre if at_rear_axle else 0.0)
    return x, y, av.vx, av.ax


def _followers(
    problem: PlanningProblem, motion: tuple[FloatArray, ...], key: tuple[str, ...], *, seen: int | None
) -> Iterator[Trace]:
    """The followers' x, v, a, each (p, N + 1). seen: samples of the ego in view, to end with the recorded ones;
    None: all.
    """
    followers, (x, v, a) = problem.scene.followers, motion
    for i, recorded in enumerate(followers.recorded):
        level = np.full(x.shape[1], followers.y[i])
        last = None if seen is None else min(seen, recorded.observed)
        yield _trace((*key, names.target_follower(i + 1)), (x[i], level, v[i], a[i]), last=last)


def _trace(key: tuple[str, ...], motion: Sequence[FloatArray], first: int = 0, last: int | None = None) -> Trace:
    """x, y, vx, ax at the samples first .. last - 1."""
    columns = [column[first:last] for column in motion]
    times = np.arange(first, first + len(columns[0])) * TIME_STEP
    return Trace(key, np.stack([times, *columns]).astype(np.float32))


def write_traces(job: Job, traces: list[Trace]) -> int:
    """Write a recording's file of ``trajectories``, be it without rows. Returns the number of rows."""
    ordered = sorted((trace for trace in traces if trace.values.size), key=lambda trace: trace.key)
    groups = (ordered[k : k + _TRACES_A_GROUP] for k in range(0, len(ordered), _TRACES_A_GROUP))
    path = artefacts.partition(job.work, _NAME, job.recording)
    return artefacts.write_file(path, _NAME, map(_table, groups), job.provenance)


def _table(traces: Sequence[Trace]) -> pa.Table:
    lengths = [trace.values.shape[1] for trace in traces]
    columns = {}
    for place, name in enumerate(_KEY):
        words, codes = np.unique([trace.key[place] for trace in traces], return_inverse=True)
        every = pa.array(np.repeat(codes, lengths).astype(np.int32))
        columns[name] = pa.DictionaryArray.from_arrays(every, pa.array(words.tolist())).cast(pa.string())
    values = np.concatenate([trace.values for trace in traces], axis=1)
    columns |= {name: pa.array(row) for name, row in zip(_VALUES, values, strict=True)}
    table = TABLES[_NAME]
    return pa.table([columns[name] for name in table.column_names], names=list(table.column_names))


def prediction_trace(trajectories: pd.DataFrame | None, default: str) -> PredictionTrace | None:
    """HV 1 behind the recorded lane changer, recorded and by each follower model, for an event's page.

    trajectories: an event's rows of that table; default: the model that plans. None if it holds no such rows.
    """
    if trajectories is None:
        return None
    rows = trajectories[trajectories["role"] == names.target_follower(1)]
    rows = rows[rows["policy"] == RECORDED]
    # The motion is one, whatever the accounting under which a row stands.
    rows = rows.assign(k=np.rint(rows["t"].to_numpy(float) / TIME_STEP).astype(int)).query("k >= 0")
    rows = rows.drop_duplicates(["kind", "followers", "k"])
    simulated = rows[rows["kind"] == "simulated"]
    recorded = rows[rows["kind"] == "recorded"].set_index("k")["vx"]
    if simulated.empty or recorded.empty:
        return None
    grid = np.arange(max(simulated["k"].max(), recorded.index.max()) + 1)
    models = {m: simulated[simulated["followers"] == m] for m in labels.in_order(simulated["followers"])}
    speeds = {m: found.set_index("k")["vx"].reindex(grid).to_numpy(float) for m, found in models.items()}
    return PredictionTrace(TIME_STEP * grid, recorded.reindex(grid).to_numpy(float), speeds, default)
