"""Scenes as CSV, and by the formats' own libraries (extra ``export``): OMEGA-PRIME, CommonRoad, OpenSCENARIO.

Each writer takes a scene and a folder, and gives the files. x and y are those of the scene; the road is straight,
with the recording's markings, from 100 m behind everybody to 100 m ahead of all.
"""

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from highd_lc.io.atomic import whole_file
from highd_lc.vocab import names
from highd_lc.vocab.errors import MissingExtraError
from highd_lc.vocab.tables.prediction import RECORDED

FloatArray = NDArray[np.float64]

STEP_S: Final = 0.1
COLUMNS: Final = (
    "role",
    "vehicle_id",
    "class",
    "length",
    "width",
    "t",
    "x",
    "y",
    "vx",
    "vy",
    "ax",
    "ay",
    "heading",
)

_MARGIN_M: Final = 100.0
_HEIGHT_M: Final = {names.CAR: 1.5, names.TRUCK: 3.5}
_NANOS: Final = round(1e9 * STEP_S)


@dataclass(frozen=True)
class ExportScene:
    """One event to be written.

    rows: ``COLUMNS``, a row a vehicle and 0.1 s; policy: who plans the ego, or ``recorded``; markings: y of the
    lane markings from the right [m]; T: end of the lane change [s].
    """

    event_id: str
    policy: str
    rows: pd.DataFrame
    markings: FloatArray
    T: float

    @property
    def planned(self) -> bool:
        """Whether a policy moves the ego."""
        return self.policy != RECORDED

    @property
    def ego(self) -> pd.DataFrame:
        """The ego's rows."""
        return self.rows[self.rows["role"] == names.EGO]

    @property
    def name(self) -> str:
        """A name for its files."""
        return f"{self.event_id}_{self.policy.replace(':', '.')}"


def write_csv(scene: ExportScene, out: Path) -> list[Path]:
    """The scene's rows."""
    path = out / f"{scene.name}.csv"
    out.mkdir(parents=True, exist_ok=True)
    with whole_file(path) as file:
        file.write(scene.rows.to_csv(index=False, float_format="%.6g").encode())
    return [path]


@contextmanager
def _extra(library: str) -> Iterator[None]:
    """Say which extra brings a library that is not installed."""
    try:
        yield
    except ImportError as error:
        raise MissingExtraError(f"{library} is not installed: install highd-lc[export] ({error})") from error


def _steps(rows: pd.DataFrame, first: float) -> Any:
    """Whole steps of 0.1 s since ``first`` [s]."""
    return np.rint((rows["t"].to_numpy() - first) / STEP_S).astype(int)


def _extent(scene: ExportScene) -> tuple[float, float]:
    return float(scene.rows["x"].min()) - _MARGIN_M, float(scene.rows["x"].max()) + _MARGIN_M


# --- OMEGA-PRIME ---


def write_omega_prime(scene: ExportScene, out: Path) -> list[Path]:
    """An MCAP file of OSI ground truth, checked by omega_prime's own schema. Its road is no part of it."""
    with _extra("omega-prime"):
        import betterosi
        import omega_prime
    kinds = betterosi.MovingObjectVehicleClassificationType
    subtype = {names.CAR: kinds.TYPE_CAR, names.TRUCK: kinds.TYPE_HEAVY_TRUCK}
    rows, ids = scene.rows, {role: k for k, role in enumerate(dict.fromkeys(scene.rows["role"]))}
    table = pd.DataFrame(
        {
            "total_nanos": _steps(rows, float(rows["t"].min())).astype(np.int64) * _NANOS,
            "idx": rows["role"].map(ids).astype(np.int64),
            **{name: rows[name] for name in ("x", "y", "length", "width")},
            "z": rows["class"].map(_HEIGHT_M) / 2.0,
            "height": rows["class"].map(_HEIGHT_M),
            "vel_x": rows["vx"], "vel_y": rows["vy"], "vel_z": 0.0,
            "acc_x": rows["ax"], "acc_y": rows["ay"], "acc_z": 0.0,
            "roll": 0.0, "pitch": 0.0, "yaw": rows["heading"],
            "type": np.int64(betterosi.MovingObjectType.TYPE_VEHICLE),
            "subtype": rows["class"].map(lambda kind: int(subtype[kind])).astype(np.int64),
            "role": np.int64(betterosi.MovingObjectVehicleClassificationRole.ROLE_CIVIL),
        }
    )  # fmt: skip
    out.mkdir(parents=True, exist_ok=True)
    path = out / f"{scene.name}.mcap"
    recording = omega_prime.Recording(df=table, host_vehicle_idx=ids[names.EGO], validate=True)
    with warnings.catch_warnings():  # its own two libraries name neighbouring versions of OSI
        warnings.filterwarnings("ignore", message="GroundTruth.version")
        recording.to_mcap(str(path))
    return [path]


# --- CommonRoad ---


def write_commonroad(scene: ExportScene, out: Path) -> list[Path]:
    """An XML scenario with lanelets, everybody but the ego, the ego's planning problem; a plan as its solution."""
    with _extra("commonroad-io"):
        from commonroad.common.file_writer import CommonRoadFileWriter, OverwriteExistingFile
        from commonroad.planning.planning_problem import PlanningProblemSet
        from commonroad.scenario.scenario import Location
    scenario = commonroad_scenario(scene)
    problem = commonroad_problem(scene)
    out.mkdir(parents=True, exist_ok=True)
    path = out / f"{scene.name}.xml"
    path.unlink(missing_ok=True)  # the writer would print that it replaces it
    source, anywhere = "a recorded lane change", Location()
    problems = PlanningProblemSet([problem])
    writer = CommonRoadFileWriter(scenario, problems, "highd_lc", "highd_lc", source, set(), anywhere)
    writer.write_to_file(str(path), OverwriteExistingFile.ALWAYS)
    return [path, _write_solution(scene, scenario, problem, out)] if scene.planned else [path]


def commonroad_scenario(scene: ExportScene) -> Any:
    """The road and everybody but the ego, by steps of 0.1 s from t = 0."""
    from commonroad.geometry.shape import Rectangle
    from commonroad.prediction.prediction import TrajectoryPrediction
    from commonroad.scenario.obstacle import DynamicObstacle, ObstacleType
    from commonroad.scenario.scenario import Scenario, ScenarioID
    from commonroad.scenario.trajectory import Trajectory

    found = Scenario(STEP_S, ScenarioID(country_id="ZAM", map_name="Motorway", map_id=1))
    found.add_objects(_lanelets(scene))
    types = {names.CAR: ObstacleType.CAR, names.TRUCK: ObstacleType.TRUCK}
    for number, (role, rows) in enumerate(scene.rows.groupby("role", sort=False), start=1):
        if role == names.EGO:
            continue
        shape = Rectangle(float(rows["length"].iloc[0]), float(rows["width"].iloc[0]))
        states = _states(rows[rows["t"] >= 0.0])
        if not states:
            continue
        motion = Trajectory(states[1].time_step, states[1:]) if len(states) > 1 else None
        prediction = TrajectoryPrediction(motion, shape) if motion else None
        found.add_objects(
            DynamicObstacle(100 + number, types[rows["class"].iloc[0]], shape, states[0], prediction)
        )
    return found


def _lanelets(scene: ExportScene) -> list[Any]:
    """A lanelet a lane, the rightmost first; each knows its neighbours."""
    from commonroad.scenario.lanelet import Lanelet, LaneletType, LineMarking

    first, last = _extent(scene)
    x = np.arange(first, last + 10.0, 10.0)
    lanes = len(scene.markings) - 1
    found = []
    for k in range(lanes):
        right, left = (np.column_stack([x, np.full(len(x), scene.markings[k + side])]) for side in (0, 1))
        found.append(
            Lanelet(
                left, (left + right) / 2.0, right, 1 + k,
                adjacent_left=2 + k if k + 1 < lanes else None, adjacent_left_same_direction=k + 1 < lanes or None,
                adjacent_right=k if k else None, adjacent_right_same_direction=k > 0 or None,
                line_marking_left_vertices=LineMarking.DASHED if k + 1 < lanes else LineMarking.SOLID,
                line_marking_right_vertices=LineMarking.DASHED if k else LineMarking.SOLID,
                lanelet_type={LaneletType.HIGHWAY},
            )
        )  # fmt: skip
    return found


def _states(rows: pd.DataFrame) -> list[Any]:
    from commonroad.scenario.state import CustomState, InitialState

    found: list[Any] = []
    for step, row in zip(_steps(rows, 0.0), rows.to_dict("records"), strict=True):
        about = {
            "time_step": int(step), "position": np.array([row["x"], row["y"]]), "orientation": row["heading"],
            "velocity": float(np.hypot(row["vx"], row["vy"])),
        }  # fmt: skip
        if found:
            found.append(CustomState(**about))
        else:
            found.append(InitialState(**about, acceleration=row["ax"], yaw_rate=0.0, slip_angle=0.0))
    return found


def commonroad_problem(scene: ExportScene) -> Any:
    """The ego from t = 0, to be on the target lane within the scene's time."""
    from commonroad.common.util import AngleInterval, Interval
    from commonroad.geometry.shape import Rectangle
    from commonroad.planning.goal import GoalRegion
    from commonroad.planning.planning_problem import PlanningProblem
    from commonroad.scenario.state import CustomState, InitialState

    ego = scene.ego[scene.ego["t"] >= 0.0]
    start, end = ego.iloc[0], ego.iloc[-1]
    lane = int(np.clip(np.searchsorted(scene.markings, end["y"]), 1, len(scene.markings) - 1))
    right, left = scene.markings[lane - 1], scene.markings[lane]
    _, far = _extent(scene)
    goal = Rectangle(far, left - right, center=np.array([far / 2.0, (left + right) / 2.0]))
    last = int(_steps(ego, 0.0)[-1])
    wanted = CustomState(
        time_step=Interval(1, last),
        position=goal,
        orientation=AngleInterval(-0.2, 0.2),
        velocity=Interval(0.0, 60.0),
    )
    initial = InitialState(
        time_step=0, position=np.array([start["x"], start["y"]]), orientation=start["heading"],
        velocity=float(np.hypot(start["vx"], start["vy"])), acceleration=start["ax"], yaw_rate=0.0, slip_angle=0.0,
    )  # fmt: skip
    return PlanningProblem(1000, initial, GoalRegion([wanted]))


def _write_solution(scene: ExportScene, scenario: Any, problem: Any, out: Path) -> Path:
    """The ego's plan as a solution of the planning problem: a point mass at the box centre."""
    from commonroad.common.solution import (
        CommonRoadSolutionWriter,
        CostFunction,
        PlanningProblemSolution,
        Solution,
        VehicleModel,
        VehicleType,
    )
    from commonroad.scenario.state import PMState
    from commonroad.scenario.trajectory import Trajectory

    ego = scene.ego[scene.ego["t"] >= 0.0]
    states = [
        PMState(time_step=int(step), position=np.array([r["x"], r["y"]]), velocity=r["vx"], velocity_y=r["vy"])
        for step, r in zip(_steps(ego, 0.0), ego.to_dict("records"), strict=True)
    ]
    found = PlanningProblemSolution(
        planning_problem_id=problem.planning_problem_id, vehicle_model=VehicleModel.PM,
        vehicle_type=VehicleType.BMW_320i, cost_function=CostFunction.JB1, trajectory=Trajectory(0, states),
    )  # fmt: skip
    name = f"{scene.name}_solution.xml"
    solution = Solution(scenario.scenario_id, [found])
    CommonRoadSolutionWriter(solution).write_to_file(output_path=str(out), filename=name, overwrite=True)
    return out / name


# --- OpenSCENARIO ---


def write_openscenario(scene: ExportScene, out: Path) -> list[Path]:
    """An OpenSCENARIO file whose vehicles follow trajectories, and its OpenDRIVE road."""
    with _extra("scenariogeneration"):
        from scenariogeneration import xosc
    out.mkdir(parents=True, exist_ok=True)
    road = out / f"{scene.name}.xodr"
    _road(scene).write_xml(str(road))
    entities, init, groups = xosc.Entities(), xosc.Init(), []
    for role, rows in scene.rows[scene.rows["t"] >= 0.0].groupby("role", sort=False):
        entities.add_scenario_object(str(role), _vehicle(str(role), rows))
        first = rows.iloc[0]
        place = xosc.TeleportAction(xosc.WorldPosition(first["x"], first["y"], 0.0, first["heading"]))
        init.add_init_action(str(role), place)
        speed = xosc.TransitionDynamics(xosc.DynamicsShapes.step, xosc.DynamicsDimension.time, 0)
        init.add_init_action(str(role), xosc.AbsoluteSpeedAction(float(first["vx"]), speed))
        if len(rows) > 1:
            groups.append(_follow(str(role), rows))
    board = xosc.StoryBoard(init, _stop_after(float(scene.rows["t"].max())))
    for group in groups:
        act = xosc.Act(f"act of {group.name}", _start_at_once())
        act.add_maneuver_group(group)
        board.add_act(act)
    path = out / f"{scene.name}.xosc"
    xosc.Scenario(
        f"lane change {scene.event_id}", "highd_lc", xosc.ParameterDeclarations(), entities, board,
        xosc.RoadNetwork(roadfile=road.name), xosc.Catalog(), osc_minor_version=1,
    ).write_xml(str(path))  # fmt: skip
    return [path, road]


def _road(scene: ExportScene) -> Any:
    """A straight road: its reference line is the left edge, lanes -1 and so on to the right of it."""
    from scenariogeneration import xodr

    first, last = _extent(scene)
    widths = np.diff(scene.markings)[::-1]
    lanes = xodr.Lanes()
    section = xodr.LaneSection(0, xodr.standard_lane())
    for width in widths:
        section.add_right_lane(xodr.Lane(a=float(width), lane_type=xodr.LaneType.driving))
    lanes.add_lanesection(section)
    view = xodr.PlanView(x_start=first, y_start=float(scene.markings[-1]), h_start=0.0)
    view.add_geometry(xodr.Line(last - first))
    found = xodr.OpenDrive("motorway")
    found.add_road(xodr.Road(1, view, lanes))
    found.adjust_roads_and_lanes()
    return found


def _vehicle(role: str, rows: pd.DataFrame) -> Any:
    from scenariogeneration import xosc

    kind, length, width = rows["class"].iloc[0], float(rows["length"].iloc[0]), float(rows["width"].iloc[0])
    height = _HEIGHT_M[kind]
    axle = 0.3 * length
    return xosc.Vehicle(
        role, xosc.VehicleCategory.truck if kind == names.TRUCK else xosc.VehicleCategory.car,
        xosc.BoundingBox(width, length, height, 0.0, 0.0, height / 2.0),
        xosc.Axle(0.5, 0.8, 0.9 * width, axle, 0.4), xosc.Axle(0.5, 0.8, 0.9 * width, -axle, 0.4),
        70.0, 10.0, 10.0,
    )  # fmt: skip


def _follow(role: str, rows: pd.DataFrame) -> Any:
    """A vehicle on its trajectory, by times and places."""
    from scenariogeneration import xosc

    places = [xosc.WorldPosition(r["x"], r["y"], 0.0, r["heading"]) for r in rows.to_dict("records")]
    trajectory = xosc.Trajectory(f"trajectory of {role}", False)
    trajectory.add_shape(xosc.Polyline([float(t) for t in rows["t"]], places))
    action = xosc.FollowTrajectoryAction(
        trajectory, xosc.FollowingMode.position, xosc.ReferenceContext.absolute, 1.0, 0.0
    )
    event = xosc.Event(f"motion of {role}", xosc.Priority.overwrite)
    event.add_action(f"follow {role}", action)
    event.add_trigger(_start_at_once())
    manoeuvre = xosc.Maneuver(f"manoeuvre of {role}")
    manoeuvre.add_event(event)
    group = xosc.ManeuverGroup(role)
    group.add_actor(role)
    group.add_maneuver(manoeuvre)
    return group


def _start_at_once() -> Any:
    from scenariogeneration import xosc

    time = xosc.SimulationTimeCondition(0, xosc.Rule.greaterThan)
    return xosc.ValueTrigger("start", 0, xosc.ConditionEdge.none, time)


def _stop_after(seconds: float) -> Any:
    from scenariogeneration import xosc

    time = xosc.SimulationTimeCondition(seconds, xosc.Rule.greaterThan)
    return xosc.ValueTrigger("stop", 0, xosc.ConditionEdge.none, time, "stop")


WRITERS: Final[dict[str, Callable[[ExportScene, Path], list[Path]]]] = {
    "csv": write_csv,
    "omega-prime": write_omega_prime,
    "commonroad": write_commonroad,
    "openscenario": write_openscenario,
}
