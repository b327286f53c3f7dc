"""Scenario 3: the printed initial state of one HighD event; the AV's speed, not printed, is a free axis."""

import itertools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from highd_lc.algorithms import planner, scoring
from highd_lc.algorithms.packing import scene_weights
from highd_lc.algorithms.planner import PlanningProblem
from highd_lc.algorithms.pool import Goal, Pool
from highd_lc.algorithms.replay import plan_motion, replay
from highd_lc.algorithms.scenario import simulated_scene, steady_motion
from highd_lc.algorithms.search import search
from highd_lc.vocab import names
from highd_lc.vocab.lcm_parameters import TABLE3_MEANS
from highd_lc.vocab.scenarios import ScenarioOptions, ScenarioSettings
from highd_lc.vocab.scene import Followers, Motion, Scene
from highd_lc.vocab.settings import LossSettings, ValidateSettings

FloatArray = NDArray[np.float64]
Row = dict[str, Any]

KEY = "3"


def variant_of(v_av: float) -> str:
    """Name of the cell with this speed of the AV [m/s]."""
    return f"v_av={v_av:g}"


def options_of(settings: ScenarioSettings) -> ScenarioOptions:
    """Conventions of scenario 3: weighted, Table 3 means, its own references; the platoon's do not matter."""
    state = settings.scenario_3
    return settings.with_options(
        {
            "aggregation": "weighted",
            "v_ref_av": state.v_ref,
            "v_desire": TABLE3_MEANS.v_desire,
            "spacing_m": state.spacings_m[1] - state.spacings_m[0],
            "planned_followers": len(state.spacings_m),
        }
    )


def printed_scene(settings: ScenarioSettings, v_av: float) -> Scene:
    """The printed state with the AV at v_av [m/s]; followers with Table 3 means.

    Spacings count from front to front; the followers are faster than the AV, its leader slower. The target
    leader, whose speed is not printed either, drives as fast as HV_1.
    """
    state, vehicle = settings.scenario_3, settings.vehicle
    samples, p = round(settings.options.horizon_s / vehicle.dt_s) + 1, len(state.spacings_m)
    v = v_av + np.array(state.speed_differences)
    nothing = np.full(samples, np.nan)
    unseen = Motion(nothing, nothing, nothing, nothing, vehicle.length_m, vehicle.width_m, 0)
    followers = Followers(
        x=-np.array(state.spacings_m),
        y=np.full(p, vehicle.lateral_shift_m),
        v=v,
        length=np.full(p, vehicle.length_m),
        width=np.full(p, vehicle.width_m),
        parameters=np.tile(TABLE3_MEANS.as_array(), (p, 1)),
        L_no_change=TABLE3_MEANS.L,
        recorded=(unseen,) * p,
    )
    ahead = state.target_gap_m + vehicle.length_m - state.spacings_m[0]
    slower = v_av - state.origin_leader_difference

    def steady(x: float, y: float, speed: float) -> Motion:
        return steady_motion(x, y, v=speed, samples=samples, vehicle=vehicle)

    return simulated_scene(
        KEY,
        v_av,
        followers=followers,
        vehicle=vehicle,
        target_leader=steady(ahead, vehicle.lateral_shift_m, float(v[0])),
        origin_leader=steady(state.origin_leader_ahead_m, 0.0, slower),
    )


def printed_weights(settings: ScenarioSettings) -> FloatArray:
    """The followers' weights of equation 17, shape (3,): they do not depend on the AV's speed."""
    return scene_weights(printed_scene(settings, settings.scenario_3.av_speeds[0]))


def _planning(settings: ScenarioSettings) -> ValidateSettings:
    """HighD's conventions of losses and limits, the scenario's drive after T."""
    planning, state = settings.planning(options_of(settings)), settings.scenario_3
    loss = planning.loss.model_dump() | {"v_ref_hv": state.v_ref, "efficiency_scale": state.v_ref}
    constraints = planning.constraints.model_copy(update={"v_max": state.v_max})
    return planning.model_copy(update={"loss": LossSettings.model_validate(loss), "constraints": constraints})


def rows_of_printed_state(settings: ScenarioSettings) -> list[Row]:
    """Cells of scenario 3 over the speed of the AV (rows of ``scenario_cells``)."""
    rows = []
    for v_av in settings.scenario_3.av_speeds:
        problem = planner.pose(printed_scene(settings, v_av), _planning(settings))
        omegas = (1.0, settings.loss.omega_av)
        goals = [Goal(a, o) for a in names.ACCOUNTINGS for o in omegas]
        fixed = search(problem.task, goals)
        pools = {names.FIXED: fixed, names.FREE: search(problem.task, goals, known=fixed)}
        head = {"scenario": KEY, "variant": variant_of(v_av), "v_start": v_av, **options_of(settings).model_dump()}
        rows += [
            head | {"form": form, "accounting": a, "omega_av": o} | _columns(problem, pools[form], Goal(a, o))
            for form, a, o in itertools.product(names.FORMS, names.ACCOUNTINGS, omegas)
        ]
    return rows


def _columns(problem: PlanningProblem, pool: Pool, goal: Goal) -> Row:
    best = pool.best(goal)
    if best is None:
        start = planner.overlap_at_start(problem)
        return {"status": names.INFEASIBLE_AT_START if start else names.INFEASIBLE}
    plan = problem.task.quintic(int(pool.n[best]), float(pool.delta[best]), float(pool.change[best]))
    played = replay(plan_motion(plan, problem.packed), problem.packed)
    dt, n = problem.scene.dt, played.av.n
    losses = scoring.cumulative_losses(played, problem.terms, problem.settings.loss, dt)
    charged = scoring.losses_at(losses, goal.accounting, problem.terms, n=n, dt=dt)
    return {
        "status": names.SOLVED,
        "T": plan.T,
        "x_final": plan.x_final,
        "v_end": plan.v_end,
        **{key: value for key, value in charged.items() if isinstance(value, float)},
        "av_v_max": float(np.hypot(played.av.vx, played.av.vy)[: n + 1].max()),
        "av_v_end": plan.v_end,
        "hv1_v_min": float(played.v[0].min()),
    }
