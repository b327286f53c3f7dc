"""The reactive planner of CommonRoad (commonroad-reactive-planner 2025.1), asked in our scenes: extra ``peers``.

It gets the leaders' motions as our planner does, and everybody behind at constant speed, for it does not simulate
reactions. Its reference path is the middle of the target lane, its desired speed the ego's at the start; one plan
of 6 s is made, with the planner's own sampling, cost function and vehicle (BMW 320i).

    highd-lc validate --planner examples.commonroad_reactive:commonroad_reactive
"""

import logging
from typing import Any

import numpy as np
from commonroad.common.util import Interval
from commonroad.geometry.shape import Rectangle
from commonroad.planning.goal import GoalRegion
from commonroad.planning.planning_problem import PlanningProblem
from commonroad.prediction.prediction import TrajectoryPrediction
from commonroad.scenario.obstacle import DynamicObstacle, ObstacleType
from commonroad.scenario.scenario import Scenario, ScenarioID
from commonroad.scenario.state import CustomState, InitialState
from commonroad.scenario.trajectory import Trajectory
from commonroad_clcs.config import CLCSParams
from commonroad_rp.reactive_planner import ReactivePlanner
from commonroad_rp.utility.config import ReactivePlannerConfiguration
from commonroad_rp.utility.utils_coordinate_system import CoordinateSystem

from highd_lc import PlannedMotion
from highd_lc.planning.scene import Motion, Scene, leaders_of

STEPS = 60


def commonroad_reactive(scene: Scene) -> PlannedMotion | str:
    """One plan of the reactive planner towards the middle of the target lane."""
    logging.disable(logging.INFO)
    try:
        planner = ReactivePlanner(configured(scene))
        middle = np.arange(-100.0, 40.0 * STEPS, 2.0)
        path = np.column_stack([middle, np.full(len(middle), scene.lateral_shift)])
        planner.set_reference_path(coordinate_system=CoordinateSystem(path, clcs_params=CLCSParams()))
        planner.reset(planner.config)
        planner.set_desired_velocity(desired_velocity=scene.v0, current_speed=scene.v0)
        found = planner.plan()
    finally:
        logging.disable(logging.NOTSET)
    if found is None:
        return "the reactive planner finds no trajectory"
    states = found[0].state_list
    x, y = np.array([state.position for state in states]).T
    speed, angle = (np.array([getattr(state, name) for state in states]) for name in ("velocity", "orientation"))
    return PlannedMotion(x - x[0], y - y[0], speed * np.cos(angle), speed * np.sin(angle))


def configured(scene: Scene) -> ReactivePlannerConfiguration:
    """The planner's own settings, on our scene."""
    config = ReactivePlannerConfiguration()
    config.debug.multiproc = False
    config.planning.time_steps_computation = STEPS
    config.planning.planning_horizon = STEPS * scene.dt
    config.vehicle.length, config.vehicle.width = scene.length, scene.width
    config.update(scenario=scenario_of(scene), planning_problem=problem_of(scene))
    return config


def scenario_of(scene: Scene) -> Scenario:
    """Everybody but the ego: leaders as they move, the others at constant speed."""
    found = Scenario(scene.dt, ScenarioID(country_id="ZAM", map_name="Motorway", map_id=1))
    t = np.arange(STEPS + 1) * scene.dt
    others = [obstacle(m, m.x[: STEPS + 1], m.v[: STEPS + 1]) for m in leaders_of(scene).values()]
    f = scene.followers
    for k in range(len(f.x)):
        v = np.full(len(t), f.v[k])
        still = Motion(f.x[k] + v * t, np.full(len(t), f.y[k]), v, 0 * t, float(f.length[k]), float(f.width[k]), 1)
        others.append(obstacle(still, still.x, v))
    for number, (shape, states) in enumerate(others, start=1):
        motion = TrajectoryPrediction(Trajectory(1, states[1:]), shape)
        found.add_objects(DynamicObstacle(100 + number, ObstacleType.CAR, shape, states[0], motion))
    return found


def obstacle(motion: Motion, x: Any, v: Any) -> tuple[Rectangle, list[Any]]:
    """A vehicle's box and its states, step by step."""
    places = [np.array([x[k], motion.y[k]]) for k in range(len(x))]
    first = InitialState(
        time_step=0, position=places[0], orientation=0.0, velocity=float(v[0]), acceleration=0.0, yaw_rate=0.0,
        slip_angle=0.0,
    )  # fmt: skip
    rest = [
        CustomState(time_step=k, position=places[k], orientation=0.0, velocity=float(v[k]))
        for k in range(1, len(x))
    ]
    return Rectangle(motion.length, motion.width), [first, *rest]


def problem_of(scene: Scene) -> PlanningProblem:
    """From the ego's state to the target lane."""
    start = InitialState(
        time_step=0, position=np.zeros(2), orientation=0.0, velocity=scene.v0, acceleration=0.0, yaw_rate=0.0,
        slip_angle=0.0,
    )  # fmt: skip
    lane = Rectangle(1000.0, 3.0, center=np.array([500.0, scene.lateral_shift]))
    goal = CustomState(time_step=Interval(1, STEPS), position=lane)
    return PlanningProblem(1000, start, GoalRegion([goal]))
