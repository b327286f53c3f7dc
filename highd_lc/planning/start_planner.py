"""Plans of the policies that choose when to start and into which gap, and what happens under them."""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.quintic import Quintic
from highd_lc.planning import limits
from highd_lc.planning.planner import (
    Plan,
    PlanningProblem,
    apart,
    closest_margins,
    contacts_met,
    goals,
    infeasible_at_start,
    keeping,
    overlap_at_start,
    rejections,
)
from highd_lc.planning.pool import OVERTAKES, Goal, Pool
from highd_lc.planning.replay import AvMotion, Entry, Replay, clearances, drive_on, follow, joins, plan_motion
from highd_lc.planning.safety import binding
from highd_lc.planning.scene import MOMENT
from highd_lc.planning.search import nominal_rejections
from highd_lc.planning.start_search import search_starts
from highd_lc.planning.starts import CONTAINED, Key, StartProblem, best_of, pose_starts
from highd_lc.vocab import names
from highd_lc.vocab.policy import CHOOSING_START, POLICIES

FloatArray = NDArray[np.float64]

FORM_OF_START = {policy: POLICIES[policy].comparison for policy in CHOOSING_START}
OVERTAKES_LEADER = "overtakes_leader"
"""The constraint to end behind the gap's leader, beside those of ``planner``."""
_LOOKED_AT = 100

StartPools = Mapping[Key, Pool]


def plan_starts(problem: PlanningProblem) -> list[Plan]:
    """The plans of every policy that chooses its start, under every accounting.

    An event whose ellipses overlap at t_start already gives plans with that status.
    """
    policies = [q for q in FORM_OF_START if _planned(problem, FORM_OF_START[q])]
    if overlap_at_start(problem):
        return infeasible_at_start(problem, policies)
    posed = pose_starts(problem)
    pools = start_pools(posed, goals(problem))
    nominal = {form: nominal_rejections(problem.task, free=form == names.FREE_START) for form in pools}
    forms = [(policy, FORM_OF_START[policy]) for policy in policies]
    return [plan for policy, form in forms for plan in _plans(posed, policy, pools[form], nominal[form])]


def plan_start(posed: StartProblem, policy: str, accounting: str, searched: dict[str, dict[Key, Pool]]) -> Plan:
    """The plan of one policy that chooses its start, as ``plan_starts`` has it.

    searched: candidates by form, of the searches so far. What the policy needs beside them is searched and added.
    """
    problem, form = posed.problem, FORM_OF_START[policy]
    if overlap_at_start(problem):
        return next(p for p in infeasible_at_start(problem, [policy]) if p.accounting == accounting)
    for needed in (names.START, names.FREE_START)[: 1 + (form == names.FREE_START)]:
        if needed not in searched:
            searched[needed] = _start_pool(posed, goals(problem), needed, searched)
    nominal = nominal_rejections(problem.task, free=form == names.FREE_START)
    omega = POLICIES[policy].omega_av(problem.settings.loss.omega_av)
    return _best_plan(posed, searched[form], Goal(accounting, omega), policy, nominal)


def _planned(problem: PlanningProblem, form: str) -> bool:
    return form == names.START or problem.settings.planner.free_form


def start_pools(posed: StartProblem, wanted: list[Goal]) -> dict[str, dict[Key, Pool]]:
    """The candidates of each form; those of the fixed form are part of the free one."""
    found: dict[str, dict[Key, Pool]] = {}
    for form in names.START_FORMS:
        if _planned(posed.problem, form):
            found[form] = _start_pool(posed, wanted, form, found)
    return found


def _start_pool(
    posed: StartProblem, wanted: list[Goal], form: str, found: Mapping[str, dict[Key, Pool]]
) -> dict[Key, Pool]:
    """The candidates of a form; found: those of the fixed form, for the free one."""
    if form == names.START:
        return search_starts(posed, wanted, {CONTAINED: posed.problem.pool(names.FIXED)}, free=False)
    fixed = found[names.START]
    known = fixed | {CONTAINED: fixed[CONTAINED].joined(posed.problem.pool(names.FREE))}
    return search_starts(posed, wanted, known, free=True)


def _plans(posed: StartProblem, policy: str, pools: StartPools, nominal: dict[str, int]) -> Iterator[Plan]:
    omega = POLICIES[policy].omega_av(posed.problem.settings.loss.omega_av)
    for accounting in names.ACCOUNTINGS:
        yield _best_plan(posed, pools, Goal(accounting, omega), policy, nominal)


def _best_plan(posed: StartProblem, pools: StartPools, goal: Goal, policy: str, nominal: dict[str, int]) -> Plan:
    count, rejected = _rejections(posed, pools, goal.accounting, nominal)
    best = best_of(pools, goal)
    plan = partial(Plan, policy, goal.accounting, candidates=count, rejected_by=rejected)
    if best is None:
        return plan(
            status=names.INFEASIBLE,
            margins=_closest(posed, pools, goal.accounting),
            fallback=names.NO_LANE_CHANGE,
            binding=binding(posed.problem.packed, rejected),
        )
    quintic = _quintic(posed, pools, best.key, best.index)
    played = replay_start(posed, best.key, quintic)
    solved = plan(
        status=names.SOLVED,
        quintic=quintic,
        replay=played,
        objective=best.objective,
        margins=_margins(posed, best.key, quintic, played, goal.accounting),
        delay_s=round(best.key[1] * posed.problem.packed.dt, 10),
        gap=posed.gaps[best.key[0]].name,
    )
    return keeping(_waiting(posed, pools[CONTAINED], solved, nominal), posed.problem)


def _waiting(posed: StartProblem, at_once: Pool, plan: Plan, nominal: dict[str, int]) -> Plan:
    """The plan, which is a fallback where none into the recorded gap at t_start is allowed: told with the reason.

    at_once: the candidates of that start.
    """
    if at_once.feasible(plan.accounting).any():
        return plan
    _, rejected = rejections(posed.problem, at_once, plan.accounting, nominal)
    return replace(plan, fallback=names.WAIT, binding=binding(posed.problem.packed, rejected))


def _margins(posed: StartProblem, key: Key, quintic: Quintic, played: Replay, accounting: str) -> dict[str, float]:
    """Margin of every constraint; of ending behind the gap's leader in m, infinite without one."""
    task, n = posed.task(key), round(quintic.T / posed.problem.packed.dt)
    behind = float(task.scene.target_front[n]) - task.scene.length / 2.0 - quintic.x_final
    found = limits.margins(quintic, task.limit) | {OVERTAKES_LEADER: behind}
    return found | apart(posed.problem, played, accounting)


def _closest(posed: StartProblem, pools: StartPools, accounting: str) -> dict[str, float]:
    """Without a feasible plan at any start: the largest margin of each constraint over some candidates of all."""
    kept = [(key, int(i)) for key, pool in pools.items() for i in np.flatnonzero(pool.within_limits)]
    if not kept:
        return closest_margins(posed.problem, pools[CONTAINED], accounting, {})
    closest: dict[str, float] = {}
    for place in np.unique(np.linspace(0, len(kept) - 1, _LOOKED_AT).astype(int)):
        key, i = kept[place]
        quintic = _quintic(posed, pools, key, i)
        played = replay_start(posed, key, quintic)
        margins = _margins(posed, key, quintic, played, accounting)
        delay = key[1] * posed.problem.packed.dt
        plan = Plan("", accounting, "", quintic, played, margins=margins, delay_s=delay)
        for name, margin in keeping(plan, posed.problem).margins.items():
            closest[name] = max(float(margin), closest.get(name, -np.inf))
    return closest


def _quintic(posed: StartProblem, pools: StartPools, key: Key, index: int) -> Quintic:
    pool = pools[key]
    return posed.task(key).quintic(int(pool.n[index]), float(pool.delta[index]), float(pool.change[index]))


def _rejections(
    posed: StartProblem, pools: StartPools, accounting: str, nominal: dict[str, int]
) -> tuple[int, dict[str, int]]:
    """Candidates looked at, and how many each constraint rejected; every one counts for its first violation.

    As in ``planner.rejections``: limits of motion on the plain grid of a start at t_start (nominal), the rest in
    the candidates that were simulated, at all starts together.
    """
    kept = sum(int(pool.within_limits.sum()) for pool in pools.values())
    behind = {
        key: pool.within_limits & (pool.violation != OVERTAKES) & pool.touches(accounting)
        for key, pool in pools.items()
    }
    touched = np.concatenate([pool.role[behind[key]] for key, pool in pools.items()])
    overtaking = sum(int((pool.violation == OVERTAKES).sum()) for pool in pools.values())
    met: Counter[str] = Counter(contacts_met(posed.problem, touched))
    for key, pool in pools.items():
        met.update(pool.unsafe(~behind[key], posed.problem.packed))
    return sum(nominal.values()) + kept, nominal | {OVERTAKES_LEADER: overtaking} | dict(met)


def key_of(posed: StartProblem, gap: str, delay_s: float) -> Key:
    """The start with that gap and delay, as they stand in ``plans``."""
    numbers = {one.name: i for i, one in enumerate(posed.gaps)}
    return numbers[gap], round(delay_s / posed.problem.packed.dt)


def replay_start(posed: StartProblem, key: Key, quintic: Quintic) -> Replay:
    """Everybody over 0 .. H: the wait, the manoeuvre into the gap, the drive after it.

    Followers are those of the event, nearest first, whatever the gap.
    """
    return replay_behind(posed, key, _av_motion(posed, key, quintic))


def replay_behind(posed: StartProblem, key: Key, av: AvMotion) -> Replay:
    """Everybody over 0 .. H around an AV that starts at ``key`` and moves as prescribed up to sample ``av.n``."""
    gap, d = posed.gaps[key[0]], key[1]
    drive_on(av.x, av.y, av.vx, av.ax, av.jerk, av.n, gap.scene)
    scene = gap.delayed(d, posed.waiting)
    x0 = float(posed.waiting.av.x[d])
    later = [np.empty((len(gap.x), len(av.x) - d)) for _ in range(3)]
    insertion = max(joins(av, scene) - d, 0)
    follow(av.x[d:] - x0 + scene.length / 2.0, av.vx[d:], insertion, scene, *later)
    later[0] += x0
    behind = [np.hstack([b[:, :d], m]) for b, m in zip((gap.x, gap.v, gap.a), later, strict=True)]
    to_T, after_T = clearances(av.x, av.y, av.vx, av.vy, av.n, av.crossing, gap.scene, behind[0])
    ahead = (posed.waiting.x, posed.waiting.v, posed.waiting.a)
    x, v, a = (np.vstack([w[: gap.passed], m[gap.rows]]) for w, m in zip(ahead, behind, strict=True))
    return Replay(av, x, v, a, to_T, after_T, _entry(posed, key, behind))


def _entry(posed: StartProblem, key: Key, behind: list[FloatArray]) -> Entry:
    """behind: x, v, a of the gap's own followers."""
    packed, gap, d = posed.problem.packed, posed.gaps[key[0]], key[1]
    if gap.name == names.GAP_AHEAD:
        front = behind[0][0] + gap.scene.follower_length[0] / 2.0
        return Entry(0, None, front, behind[1][0])
    handed = d if d > 0 and not packed.reactions[gap.passed, MOMENT] else None
    return Entry(gap.passed + 1, handed, packed.target_front, packed.target_v)


def _av_motion(posed: StartProblem, key: Key, quintic: Quintic) -> AvMotion:
    """The AV over 0 .. T, padded to H; x from its place at t_start."""
    gap, d, waited = posed.gaps[key[0]], key[1], posed.waiting.av
    planned = plan_motion(quintic, gap.delayed(d, posed.waiting))
    columns = {
        name: np.concatenate([getattr(waited, name)[:d], getattr(planned, name)])
        for name in ("x", "y", "vx", "vy", "ax", "jerk")
    }
    columns["x"][d:] += waited.x[d]
    return AvMotion(**columns, n=d + planned.n, crossing=d + planned.crossing, recorded=0)
