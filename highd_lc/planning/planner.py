"""Plans of every policy for one event: self-optimum, local optimum and the references beside them."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.losses import LossTerms
from highd_lc.core.quintic import Quintic
from highd_lc.planning import limits
from highd_lc.planning.candidates import loss_terms
from highd_lc.planning.contacts import contact_words
from highd_lc.planning.later import own_lane
from highd_lc.planning.limits import first_contact
from highd_lc.planning.pool import Goal, Pool, Task
from highd_lc.planning.replay import (
    AvMotion,
    PlannedMotion,
    Replay,
    clearances,
    constant_samples,
    drive_on,
    follow,
    free_motion,
    human_motion,
    plan_motion,
    replay,
)
from highd_lc.planning.safety import Kept, binding, kept, motion_margins
from highd_lc.planning.scene import PackedScene, Scene, obstacle_roles, pack
from highd_lc.planning.search import nominal_rejections, search
from highd_lc.vocab import names
from highd_lc.vocab.policy import ACCOUNTINGS, PAIRS, POLICIES
from highd_lc.vocab.settings import ValidateSettings

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Made = TypeVar("Made")

FORM_OF = {q: p.form for q, p in POLICIES.items() if p.searched and not p.chooses_start and not p.robust}
"""Form of each searched policy that starts at t_start and takes its followers as known."""


@dataclass(frozen=True)
class Plan:
    """What a policy does under an accounting, and why nothing better or nothing at all was possible.

    quintic: the plan, None for policies that follow no quintic and for infeasible ones. n: samples of T. replay:
    what happens, None if infeasible. rejected_by: rejected candidates by constraint; margins: in the
    constraint's unit, of the plan or, when infeasible, the closest of any candidate. delay_s: from t_start to the
    start of the quintic [s]; gap: where the AV goes. contact: who drives through whom (``names.through``), or "".
    motion: of a plan that somebody else made.
    moments: when the margin of a safety profile's constraint is smallest [s from t_start]. fallback: what the AV
    does where it may not do what the policy asks for: ``names.WAIT``, ``names.NO_LANE_CHANGE``, or ""; binding:
    the constraint that forbids it.
    """

    policy: str
    accounting: str
    status: str
    quintic: Quintic | None = None
    replay: Replay | None = None
    objective: float = np.nan
    candidates: int = 0
    rejected_by: dict[str, int] = field(default_factory=dict)
    margins: dict[str, float] = field(default_factory=dict)
    delay_s: float = 0.0
    gap: str = names.RECORDED_GAP
    contact: str = ""
    motion: PlannedMotion | None = None
    moments: dict[str, float] = field(default_factory=dict)
    fallback: str = ""
    binding: str = ""

    @property
    def at_bound(self) -> list[str]:
        """Margins that are used up: nearly 0 beside the limits of speed, acceleration and jerk."""
        return [name for name, margin in self.margins.items() if abs(margin) < 1e-3]


def made_once(plans: Sequence[Plan], make: Callable[[Plan], Made]) -> list[Made]:
    """What ``make`` makes of each plan, made once for those that share a replay.

    Policies often choose the same plan. Returns one value a plan, in their order.
    """
    made: list[tuple[Plan, Made]] = []
    for plan in plans:
        known = [value for other, value in made if other.replay is plan.replay]
        made.append((plan, known[0] if known else make(plan)))
    return [value for _, value in made]


@dataclass(frozen=True)
class PlanningProblem:
    """An event ready to be planned: its scene, the packed arrays, loss terms, limits, settings."""

    scene: Scene
    packed: PackedScene
    terms: LossTerms
    limit: limits.Limits
    settings: ValidateSettings
    roles: tuple[str, ...]

    @property
    def task(self) -> Task:
        """The search that this problem poses."""
        return Task(self.packed, self.terms, self.limit, self.settings.search)

    @cached_property
    def _searched(self) -> dict[str, Pool]:
        return {}

    def pool(self, form: str) -> Pool:
        """The candidates of a form, searched once; those of the fixed form are part of the free one."""
        if form not in self._searched:
            known = self.pool(names.FIXED) if form == names.FREE else None
            self._searched[form] = search(self.task, goals(self), known=known)
        return self._searched[form]

    @cached_property
    def _kept(self) -> dict[tuple[Replay, int], Kept]:
        return {}

    def kept(self, played: Replay, start: int) -> Kept:
        """What a replay keeps of the safety profile, known once. start: sample at which its manoeuvre begins."""
        if (played, start) not in self._kept:
            self._kept[played, start] = kept(played, self.packed, self.packed.safety, start=start)
        return self._kept[played, start]

    @property
    def pools(self) -> dict[str, Pool]:
        """The candidates of each form that is planned under the settings."""
        forms = names.FORMS if self.settings.planner.free_form else (names.FIXED,)
        return {form: self.pool(form) for form in forms}


def pose(scene: Scene, settings: ValidateSettings) -> PlanningProblem:
    """Pose the planning problem of an event."""
    packed = pack(scene, settings)
    return PlanningProblem(
        scene,
        packed,
        loss_terms(scene, packed.weights, settings.loss),
        limits.limits_of(scene.v0, settings, scene.wheelbase),
        settings,
        obstacle_roles(scene),
    )


def policies(settings: ValidateSettings) -> tuple[str, ...]:
    """The policies that are planned under the settings, references first."""
    forms = names.FORMS if settings.planner.free_form else (names.FIXED,)
    return names.REFERENCE_POLICIES + tuple(policy for form in forms for policy in PAIRS[form])


def plan_all(problem: PlanningProblem) -> list[Plan]:
    """The plans of every policy under every accounting.

    An event whose ellipses overlap at t_start already, or without a feasible plan, gives plans with that status.
    """
    recorded = [q for q in names.REFERENCE_POLICIES if q != names.HUMAN or problem.scene.human is not None]
    plans = [plan for policy in recorded for plan in reference_plans(problem, policy)]
    if overlap_at_start(problem):
        return plans + infeasible_at_start(problem, [q for q in policies(problem.settings) if q in FORM_OF])
    return plans + list(_optimal(problem, problem.pools))


def plan_one(problem: PlanningProblem, policy: str, accounting: str) -> Plan:
    """The plan of one policy that starts at t_start, as ``plan_all`` has it; only its form is searched."""
    asked = POLICIES[policy]
    if not asked.searched:
        return next(plan for plan in reference_plans(problem, policy) if plan.accounting == accounting)
    if overlap_at_start(problem):
        return next(p for p in infeasible_at_start(problem, [policy]) if p.accounting == accounting)
    nominal = nominal_rejections(problem.task, free=asked.form == names.FREE)
    goal = Goal(accounting, asked.omega_av(problem.settings.loss.omega_av))
    return best_plan(problem, problem.pool(asked.form), goal, policy, nominal, {})


def goals(problem: PlanningProblem) -> list[Goal]:
    """What the optimal policies minimise: both weights of the AV under every accounting."""
    return [Goal(a, o) for a in names.ACCOUNTINGS for o in (1.0, problem.settings.loss.omega_av)]


def _optimal(problem: PlanningProblem, pools: dict[str, Pool]) -> Iterator[Plan]:
    # The same plan is often best under several accountings: replay it once.
    replays: dict[Quintic, Replay] = {}
    nominal = {form: nominal_rejections(problem.task, free=form == names.FREE) for form in pools}
    for policy, form in FORM_OF.items():
        if form not in pools:
            continue
        omega = POLICIES[policy].omega_av(problem.settings.loss.omega_av)
        for accounting in names.ACCOUNTINGS:
            goal = Goal(accounting, omega)
            yield best_plan(problem, pools[form], goal, policy, nominal[form], replays)


def best_plan(
    problem: PlanningProblem,
    pool: Pool,
    goal: Goal,
    policy: str,
    nominal: dict[str, int],
    replays: dict[Quintic, Replay],
) -> Plan:
    """The best plan of a pool for a goal, with its margins. replays: those known, and filled."""
    count, rejected = rejections(problem, pool, goal.accounting, nominal)
    best = pool.best(goal)
    if best is None:
        margin = closest_margins(problem, pool, goal.accounting, replays)
        return replace(
            Plan(policy, goal.accounting, names.INFEASIBLE, None, None, np.nan, count, rejected, margin),
            fallback=names.NO_LANE_CHANGE,
            binding=binding(problem.packed, rejected),
        )
    quintic = problem.task.quintic(int(pool.n[best]), float(pool.delta[best]), float(pool.change[best]))
    played = _replayed(problem, quintic, replays)
    value = float(pool.objective(goal)[best])
    margin = plan_margins(problem, quintic, played, goal.accounting)
    plan = Plan(policy, goal.accounting, names.SOLVED, quintic, played, value, count, rejected, margin)
    return keeping(plan, problem)


def _replayed(problem: PlanningProblem, quintic: Quintic, replays: dict[Quintic, Replay]) -> Replay:
    if quintic not in replays:
        replays[quintic] = replay(plan_motion(quintic, problem.packed), problem.packed)
    return replays[quintic]


def keeping(plan: Plan, problem: PlanningProblem) -> Plan:
    """The plan with its margins under the safety profile, if that asks anything of who changes lane."""
    scene = problem.packed
    if not scene.safety.asked or plan.replay is None or plan.policy == names.NO_LANE_CHANGE:
        return plan
    found = problem.kept(plan.replay, round(plan.delay_s / scene.dt))
    return replace(plan, margins=plan.margins | found.margins, moments=found.moments)


def reference_plans(problem: PlanningProblem, policy: str) -> list[Plan]:
    """A reference policy under every accounting: never rejected, its violations show as negative margins."""
    quintic, motion = None, {}
    if policy == names.CONSTANT:
        v0 = problem.scene.v0
        T = constant_samples(problem.packed) * problem.packed.dt
        quintic = Quintic(v0=v0, D=problem.scene.lateral_shift, T=round(T, 10), x_final=v0 * T, v_end=v0)
        played = replay(plan_motion(quintic, problem.packed), problem.packed)
    elif policy == names.HUMAN:
        # The recorded path is that of the box centre: nothing to move for the clearances.
        centred = problem.packed._replace(rear_to_centre=0.0)
        played = replay(human_motion(problem.scene.driver, centred), centred)
        motion = motion_margins(problem.scene.driver, problem.limit, problem.scene.driver.end)
    else:
        played = stay(problem)
    found = []
    for accounting in names.ACCOUNTINGS:
        met = contact_of(problem, policy, played, accounting)
        margins = motion | plan_margins(problem, quintic, played, accounting)
        status = names.CONTACT if met else names.REFERENCE
        plan = Plan(policy, accounting, status, quintic, played, margins=margins, contact=met)
        found.append(keeping(plan, problem))
    return found


def contact_of(problem: PlanningProblem, policy: str, played: Replay, accounting: str) -> str:
    """Who drives through whom in a policy's replay over the accounted time (``first_contact``), or ""."""
    _, last = ACCOUNTINGS[accounting].charged(played.av.n, len(played.av.x) - 1)
    joins = policy != names.NO_LANE_CHANGE
    origin = problem.scene.origin_leader
    return first_contact(played, problem.packed, joins=joins, last=last, origin_leader=origin)


def stay(problem: PlanningProblem) -> Replay:
    """No lane change (see ``unchanged_motion``) with its clearances."""
    packed = problem.packed
    av, x, v, a = unchanged_motion(problem)
    to_T, after_T = clearances(av.x, av.y, av.vx, av.vy, av.n, len(av.x) - 1, packed, x)
    return Replay(av, x, v, a, to_T, after_T)


def unchanged_contacts(problem: PlanningProblem) -> frozenset[str]:
    """Who of the others drives through whom where nobody changes lane (``names.through``)."""
    found = limits.contacts(stay(problem), problem.packed, joins=False, last=len(problem.packed.target_v) - 1)
    return frozenset(name for _, name in found if names.EGO not in name.split("_through_"))


def unchanged_motion(problem: PlanningProblem) -> tuple[AvMotion, FloatArray, FloatArray, FloatArray]:
    """The AV behind the origin leader, the followers behind the target leader: its motion, and their x, v, a.

    Both by LCM; the AV's drive follows the setting ``after`` from t_start on. T counts as ``CONSTANT_T``.
    """
    packed, samples = problem.packed, len(problem.packed.target_v)
    lane = own_lane(packed, problem.scene.origin_leader)
    free = free_motion(packed)
    drive_on(free.x, free.y, free.vx, free.ax, free.jerk, free.n, lane)
    x, v, a = (np.empty((len(packed.follower_x), samples)) for _ in range(3))
    follow(free.x, free.vx, samples, packed, x, v, a)
    return replace(free, n=constant_samples(packed)), x, v, a


def start_margins(problem: PlanningProblem) -> dict[str, float]:
    """Clearance to each role at t_start beyond the one that the safety profile asks for [m]."""
    packed = problem.packed
    still = np.zeros(1)
    at_start, _ = clearances(
        still, still, still + packed.v0, still, 0, 0, packed, np.ascontiguousarray(packed.follower_x[:, None])
    )
    nearest = packed.safety.clearance
    return {role: clearance - nearest for role, clearance in zip(problem.roles, at_start.tolist(), strict=True)}


def overlap_at_start(problem: PlanningProblem) -> list[str]:
    """Roles whose ellipse overlaps the AV's at t_start already, or is nearer than the safety profile allows."""
    return [role for role, margin in start_margins(problem).items() if margin < 0.0]


def infeasible_at_start(problem: PlanningProblem, planned: list[str]) -> list[Plan]:
    """The plans of policies for an event whose ellipses overlap at t_start already, with the margins there."""
    margin = {f"clearance_{role}": value for role, value in start_margins(problem).items()}
    binds = min(margin, key=lambda name: margin[name])
    cells = [(policy, accounting) for policy in planned for accounting in names.ACCOUNTINGS]
    return [
        Plan(*cell, names.INFEASIBLE_AT_START, margins=margin, fallback=names.NO_LANE_CHANGE, binding=binds)
        for cell in cells
    ]


def rejections(
    problem: PlanningProblem, pool: Pool, accounting: str, nominal: dict[str, int]
) -> tuple[int, dict[str, int]]:
    """Candidates looked at, and how many each constraint rejected; every one counts for its first violation.

    Limits of motion are counted on a plain grid over all of T, x_final and v_end (nominal: the result of
    ``nominal_rejections``), contacts among the candidates that were simulated: together they are all candidates.
    """
    moving = pool.within_limits
    touching = moving & pool.touches(accounting)
    met = contacts_met(problem, pool.role[touching]) | pool.unsafe(moving & ~touching, problem.packed)
    return sum(nominal.values()) + int(moving.sum()), nominal | met


def contacts_met(problem: PlanningProblem, met: IntArray) -> dict[str, int]:
    """How often each contact stands among the candidates' (see ``contacts.contact_words``), ellipses first.

    Who drives through whom is named only where somebody does.
    """
    words = contact_words(problem.roles)
    counts = np.bincount(met, minlength=len(words)).tolist()
    return {word: c for i, (word, c) in enumerate(zip(words, counts, strict=True)) if c or i < len(problem.roles)}


def clearance_margins(problem: PlanningProblem, played: Replay, accounting: str) -> dict[str, float]:
    """Smallest clearance to each role over the accounted time [m]; infinite where a role does not count."""
    smallest = played.clearance_to_T
    if accounting != names.PAPER:
        smallest = np.minimum(smallest, played.clearance_after_T)
    return {f"clearance_{role}": float(c) for role, c in zip(problem.roles, smallest, strict=True)}


def apart(problem: PlanningProblem, played: Replay, accounting: str) -> dict[str, float]:
    """By how much each clearance exceeds the one that the safety profile asks for [m]."""
    nearest = problem.packed.safety.clearance
    return {name: value - nearest for name, value in clearance_margins(problem, played, accounting).items()}


def plan_margins(
    problem: PlanningProblem, quintic: Quintic | None, played: Replay, accounting: str
) -> dict[str, float]:
    """Margin of every constraint; of the clearances alone where there is no quintic."""
    moving = {} if quintic is None else limits.margins(quintic, problem.limit)
    return moving | apart(problem, played, accounting)


def closest_margins(
    problem: PlanningProblem, pool: Pool, accounting: str, replays: dict[Quintic, Replay]
) -> dict[str, float]:
    """For an infeasible event: the largest margin of each constraint that any candidate of a sample reaches.

    replays: those known, and filled.
    """
    moving = np.flatnonzero(pool.within_limits)
    if not len(moving):
        scene, longest = problem.scene, problem.settings.search.T_max
        return limits.unchanged_margins(scene.v0, scene.lateral_shift, T=longest, limit=problem.limit)
    sample = moving[np.unique(np.linspace(0, len(moving) - 1, 100).astype(int))]
    closest: dict[str, float] = {}
    for i in sample:
        quintic = problem.task.quintic(int(pool.n[i]), float(pool.delta[i]), float(pool.change[i]))
        played = _replayed(problem, quintic, replays)
        plan = Plan(
            "", accounting, "", quintic, played, margins=plan_margins(problem, quintic, played, accounting)
        )
        for name, margin in keeping(plan, problem).margins.items():
            closest[name] = max(margin, closest.get(name, -np.inf))
    return closest
