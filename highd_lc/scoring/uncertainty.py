"""How the comparison of the policies depends on followers' parameters that nobody knows exactly.

Seeds and samples that depend on the events alone: not on their order, nor on batches or workers.

The same event posed with one thing changed, and what the planner finds then.

What the choice of the start is worth to an AV that does not know what the leaders will do.

Three kinds of knowledge: the leaders' recorded motion, as everywhere else; one plan at t_start with leaders
predicted at constant speed; and a new plan every 0.5 s while the AV waits, each with the leaders predicted from
their states at that moment. Every plan is then driven among the recorded leaders and charged there. The followers'
models are known in all three, so the difference is the value of perfect information about the leaders alone.
"""

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.losses import joint_objective
from highd_lc.core.quintic import Quintic
from highd_lc.planning import starts
from highd_lc.planning.contacts import NO_CONTACT
from highd_lc.planning.crowd import event_generator, parameter_draws, seeded_hash
from highd_lc.planning.planner import Plan, PlanningProblem, contact_of, goals, pose
from highd_lc.planning.pool import Goal, Pool
from highd_lc.planning.replay import Replay
from highd_lc.planning.scene import Motion, Scene
from highd_lc.planning.search import search
from highd_lc.planning.start_planner import FORM_OF_START, key_of, replay_start, start_pools
from highd_lc.planning.start_search import search_starts
from highd_lc.planning.starts import CONTAINED, Key, StartProblem, best_of, pose_starts
from highd_lc.scoring import charges, cross_scores
from highd_lc.scoring.cross_scores import DrawnLosses
from highd_lc.vocab import names
from highd_lc.vocab.policy import ACCOUNTINGS, PAIRS, POLICIES

FloatArray = NDArray[np.float64]


def stratified_sample(strata: Mapping[str, Hashable], size: int, *, seed: int) -> frozenset[str]:
    """``size`` events (all, if there are fewer), every stratum with its share of them.

    strata: the stratum of each event id. Within a stratum the events with the smallest seeded hash are taken;
    the seats left by rounding go to the largest remainders, the same way.
    """
    if size >= len(strata):
        return frozenset(strata)
    members: dict[Hashable, list[str]] = {}
    for event in sorted(strata, key=lambda event: (seeded_hash(f"{seed}/{event}/sample"), event)):
        members.setdefault(strata[event], []).append(event)
    quotas = {stratum: size * len(events) / len(strata) for stratum, events in members.items()}
    seats = {stratum: int(quota) for stratum, quota in quotas.items()}
    by_remainder = sorted(quotas, key=lambda stratum: (seats[stratum] - quotas[stratum], repr(stratum)))
    for stratum in by_remainder[: size - sum(seats.values())]:
        seats[stratum] += 1
    return frozenset(event for stratum, events in members.items() for event in events[: seats[stratum]])


Losses = tuple[float, float]
"""Loss of the AV and of the followers; NaN if no plan is feasible."""
_NOTHING: Final = ((np.nan, np.nan), np.nan)


def with_horizon(problem: PlanningProblem, horizon_s: float) -> PlanningProblem:
    """The event accounted over H = horizon_s only, at most the scene's own; plans are at most as long."""
    samples = round(horizon_s / problem.packed.dt) + 1
    packed = problem.packed._replace(
        target_front=problem.packed.target_front[:samples].copy(),
        target_v=problem.packed.target_v[:samples].copy(),
        leader_x=np.ascontiguousarray(problem.packed.leader_x[:, :samples]),
        leader_y=np.ascontiguousarray(problem.packed.leader_y[:, :samples]),
    )
    return replace(problem, packed=packed)


def with_parameters(problem: PlanningProblem, parameters: FloatArray) -> PlanningProblem:
    """The event with other LCM parameters of its followers, shape (p, 6).

    L of the first follower behind the target leader moves with its L behind the AV.
    """
    packed = problem.packed
    first_L = packed.first_L + float(parameters[0, 5] - packed.parameters[0, 5])
    return replace(problem, packed=packed._replace(parameters=np.ascontiguousarray(parameters), first_L=first_L))


def weight_of(problem: PlanningProblem, policy: str) -> float:
    """omega_AV of an optimal policy."""
    return POLICIES[policy].omega_av(problem.settings.loss.omega_av)


def best_losses(problem: PlanningProblem) -> dict[tuple[str, str], tuple[Losses, float]]:
    """Losses and T [s] of every optimal policy under every accounting, searched anew; NaN where infeasible."""
    found = {}
    pools = problem.pools
    for form, pool in pools.items():
        for policy in PAIRS[form]:
            for accounting in names.ACCOUNTINGS:
                losses, n = _optimum(pool, Goal(accounting, weight_of(problem, policy)))
                found[policy, accounting] = losses, n * problem.packed.dt
    return found


def best_starts(problem: PlanningProblem) -> dict[tuple[str, str], tuple[Losses, float]]:
    """The same of every policy that chooses its start."""
    found = {}
    pools = start_pools(starts.pose_starts(problem), goals(problem))
    for policy, form in FORM_OF_START.items():
        for accounting in names.ACCOUNTINGS if form in pools else ():
            goal = Goal(accounting, weight_of(problem, policy))
            best = starts.best_of(pools[form], goal)
            one = pools[form][best.key].chosen(np.array([best.index])) if best else None
            losses, n = _optimum(one, goal) if one else _NOTHING
            found[policy, accounting] = losses, n * problem.packed.dt
    return found


def optima(problem: PlanningProblem) -> dict[tuple[str, str], Losses]:
    """The losses alone of ``best_of``."""
    return {cell: losses for cell, (losses, _) in best_losses(problem).items()}


def _optimum(pool: Pool, goal: Goal) -> tuple[Losses, float]:
    best = pool.best(goal) if len(pool) else None
    if best is None:
        return _NOTHING
    av, hv = pool.losses(goal.accounting)
    return (float(av[best]), float(hv[best])), float(pool.n[best])


Cell = tuple[str, str]
"""A policy and an accounting."""


@dataclass(frozen=True)
class Replanned:
    """What each draw leads to when it is planned and scored with: by policy and accounting.

    av, hv: losses; T [s]; each of shape (K,), NaN where no plan is feasible.
    """

    av: dict[Cell, FloatArray]
    hv: dict[Cell, FloatArray]
    T: dict[Cell, FloatArray]

    def total(self, cell: Cell) -> FloatArray:
        """Loss of the AV and of the followers together, shape (K,)."""
        return self.av[cell] + self.hv[cell]


def draws_of(problem: PlanningProblem, count: int, *, seed: int) -> FloatArray:
    """The event's drawn LCM parameters, shape (count, p, 6): the first ones stay the same with more draws."""
    followers = problem.scene.followers
    spread = np.zeros_like(followers.parameters) if followers.spread is None else followers.spread
    rng = event_generator(seed, problem.scene.event_id, purpose="draws")
    return parameter_draws(problem.packed.parameters, spread, count, rng)


def replan(problem: PlanningProblem, draws: FloatArray, *, chooses_start: bool = False) -> Replanned:
    """Plan every optimal policy with each draw, shape (K, p, 6); those that choose their start only if wanted."""
    posed = [with_parameters(problem, drawn) for drawn in draws]
    found = [best_losses(one) | (best_starts(one) if chooses_start else {}) for one in posed]
    cells = list(found[0]) if found else []
    return Replanned(
        {cell: np.array([one[cell][0][0] for one in found]) for cell in cells},
        {cell: np.array([one[cell][0][1] for one in found]) for cell in cells},
        {cell: np.array([one[cell][1] for one in found]) for cell in cells},
    )


def rescore(problem: PlanningProblem, plan: Plan, draws: FloatArray) -> DrawnLosses:
    """Followers' loss under each draw while the AV keeps to a plan made without knowing it; shape (K,)."""
    if plan.replay is None:
        nothing = np.full(len(draws), np.nan)
        return DrawnLosses(nothing, nothing, np.full(len(draws), NO_CONTACT), 0)
    return cross_scores.drawn_followers(plan.replay.av, problem.packed, problem.terms, draws, plan.replay.entry)


def av_loss(problem: PlanningProblem, plan: Plan) -> tuple[float, float]:
    """The AV's loss of a plan charged to T and to H; NaN without a plan."""
    if plan.replay is None:
        return np.nan, np.nan
    return cross_scores.av_charged(plan.replay.av, problem.terms)


def charged_by(accounting: str, av: tuple[float, float], hv: DrawnLosses) -> tuple[float, FloatArray]:
    """Loss of the AV and of the followers, shape (K,), under an accounting."""
    return (av[1] if accounting == names.EQUAL else av[0]), (hv.to_T if accounting == names.PAPER else hv.to_H)


def relative_gain(local: FloatArray, benchmark: FloatArray) -> FloatArray:
    """1 - local / benchmark of each pair of totals; NaN where one is missing or the benchmark's is 0."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(benchmark > 0.0, 1.0 - local / benchmark, np.nan)


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
    losses = charges.cumulative_losses(played, problem.terms, problem.packed.dt)
    av_last, hv_last = ACCOUNTINGS[goal.accounting].charged(played.av.n, len(played.av.x) - 1)
    av, hv = losses.av.upto(av_last).loss, losses.of_hv(problem.terms, hv_last).loss
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
