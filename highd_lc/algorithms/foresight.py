"""What the choice of the start is worth to an AV that does not know what the leaders will do.

Three kinds of knowledge: the leaders' recorded motion, as everywhere else; one plan at t_start with leaders
predicted at constant speed; and a new plan every 0.5 s while the AV waits, each with the leaders predicted from
their states at that moment. Every plan is then driven among the recorded leaders and charged there. The followers'
models are known in all three, so the difference is the value of perfect information about the leaders alone.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from highd_lc.algorithms import scoring
from highd_lc.algorithms.planner import PlanningProblem, contact_of, pose
from highd_lc.algorithms.pool import Goal, Pool
from highd_lc.algorithms.replay import Replay
from highd_lc.algorithms.search import search
from highd_lc.algorithms.start_planner import key_of, replay_start
from highd_lc.algorithms.start_search import search_starts
from highd_lc.algorithms.starts import CONTAINED, Key, StartProblem, best_of, pose_starts
from highd_lc.core.losses import joint_objective
from highd_lc.core.quintic import Quintic
from highd_lc.vocab import names
from highd_lc.vocab.scene import Motion, Scene

REPLANNING_S: Final = 0.5
"""Time between two plans of a waiting AV [s]."""


@dataclass(frozen=True)
class Choice:
    """A start and plan: gap, delay and duration T [s], delta = x_final - v0 T [m], v_end - v0 = change [m/s]."""

    gap: str
    delay_s: float
    T: float
    delta: float
    change: float


@dataclass(frozen=True)
class Driven:
    """A choice driven among the recorded leaders: losses of the AV and the followers, the joint objective that the
    policy minimises, whether somebody touches another, how many times it was planned. choice: None = no plan was
    found; losses are NaN then.
    """

    choice: Choice | None
    loss_av: float
    loss_hv: float
    objective: float
    touches: bool
    plannings: int


def with_predicted_leaders(scene: Scene, sample: int) -> Scene:
    """The scene as it looks at a sample: leaders recorded up to it, from then on at constant speed."""
    return replace(
        scene,
        target_leader=_predicted(scene.target_leader, sample, scene.dt),
        origin_leader=_predicted(scene.origin_leader, sample, scene.dt),
        next_leaders=tuple(
            replace(later, motion=_predicted(later.motion, sample, scene.dt))
            for later in scene.next_leaders
            if later.since <= sample
        ),
    )


def _predicted(motion: Motion | None, sample: int, dt: float) -> Motion | None:
    if motion is None:
        return None
    columns = {name: getattr(motion, name).copy() for name in ("x", "y", "v", "a")}
    ahead = np.arange(len(motion.x) - sample) * dt
    columns["x"][sample:] = motion.x[sample] + motion.v[sample] * ahead
    columns["y"][sample:], columns["v"][sample:] = motion.y[sample], motion.v[sample]
    columns["a"][sample + 1 :] = 0.0
    return replace(motion, **columns, observed=min(motion.observed, sample + 1))


def choose(problem: PlanningProblem, goal: Goal, *, earliest: int = 0) -> Choice | None:
    """The best start of a goal, fixed form, at sample ``earliest`` or later; None if none is feasible."""
    posed = replace(pose_starts(problem), earliest=earliest)
    known: dict[Key, Pool] = {} if earliest else {CONTAINED: search(problem.task, [goal])}
    pools = search_starts(posed, [goal], known, free=False)
    best = best_of(pools, goal)
    if best is None:
        return None
    pool, dt = pools[best.key], problem.packed.dt
    n, delta, change = (column[best.index] for column in (pool.n, pool.delta, pool.change))
    delay, T = round(best.key[1] * dt, 10), round(int(n) * dt, 10)
    return Choice(posed.gaps[best.key[0]].name, delay, T, float(delta), float(change))


def with_recorded(problem: PlanningProblem, goal: Goal) -> Driven:
    """Perfect information: the leaders' recorded motion."""
    return _drive(problem, goal, choose(problem, goal), plannings=1)


def with_predicted(problem: PlanningProblem, goal: Goal) -> Driven:
    """One plan at t_start, leaders predicted at constant speed."""
    foreseen = pose(with_predicted_leaders(problem.scene, 0), problem.settings)
    return _drive(problem, goal, choose(foreseen, goal), plannings=1)


def with_replanning(problem: PlanningProblem, goal: Goal) -> Driven:
    """A new plan every 0.5 s of waiting; what is to start before the next one is carried out."""
    dt, step = problem.packed.dt, round(REPLANNING_S / problem.packed.dt)
    last = min(round(problem.settings.planner.max_delay_s / dt), len(problem.packed.target_v) - 1)
    plannings = 0
    for now in range(0, last + 1, step):
        foreseen = pose(with_predicted_leaders(problem.scene, now), problem.settings)
        choice = choose(foreseen, goal, earliest=now)
        plannings += 1
        if choice is not None and round(choice.delay_s / dt) < now + step:
            return _drive(problem, goal, choice, plannings=plannings)
    return _drive(problem, goal, None, plannings=plannings)


def _drive(problem: PlanningProblem, goal: Goal, choice: Choice | None, *, plannings: int) -> Driven:
    if choice is None:
        return Driven(None, np.nan, np.nan, np.nan, False, plannings)
    played = _replay(pose_starts(problem), choice)
    losses = scoring.cumulative_losses(played, problem.terms, problem.settings.loss, problem.packed.dt)
    av_last, hv_last = scoring.charged_samples(goal.accounting, played.av.n, len(played.av.x) - 1)
    av = 0.5 * (losses.av_comfort[av_last] + losses.av_efficiency[av_last])
    each = 0.5 * (losses.hv_comfort[:, hv_last] + losses.hv_efficiency[:, hv_last])
    hv = problem.terms.weights @ each
    clearance = played.clearance_to_T
    if goal.accounting != names.PAPER:
        clearance = np.minimum(clearance, played.clearance_after_T)
    through = contact_of(problem, names.LOCAL_OPTIMUM_START, played, goal.accounting)
    touches = bool((clearance < 0.0).any()) or through != ""
    return Driven(choice, float(av), float(hv), float(joint_objective(av, hv, goal.omega_av)), touches, plannings)


def _replay(posed: StartProblem, choice: Choice) -> Replay:
    """The choice's shape from the speed that the AV really has at its start."""
    key = key_of(posed, choice.gap, choice.delay_s)
    v0, D = float(posed.waiting.av.vx[key[1]]), posed.problem.scene.lateral_shift
    x_final, v_end = v0 * choice.T + choice.delta, max(0.0, v0 + choice.change)
    return replay_start(posed, key, Quintic(v0=v0, D=D, T=choice.T, x_final=x_final, v_end=v_end))
