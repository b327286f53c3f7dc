"""Motions that somebody else's planner gives: what is asked of them, and the plan that they come to.

A planner is a function of a scene. It sees what ours see and returns a motion, or a text: why it has none.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from highd_lc.planning import planner
from highd_lc.planning.planner import Plan, PlanningProblem
from highd_lc.planning.replay import AvMotion, PlannedMotion, replay
from highd_lc.planning.safety import motion_margins
from highd_lc.planning.scene import Scene
from highd_lc.vocab import names

FloatArray = NDArray[np.float64]

_PLACE_M, _SPEED_MPS, _LANE_M = 0.1, 1.0, 0.5
_DERIVED: Final = (("vx", "x"), ("vy", "y"), ("ax", "vx"), ("ay", "vy"), ("jx", "ax"), ("jy", "ay"))


Planner: TypeAlias = Callable[[Scene], PlannedMotion | str]


@dataclass(frozen=True)
class Given:
    """What a planner gave in a scene: its whole motion, or None and the reason. faulty: the reason is a fault."""

    motion: PlannedMotion | None = None
    reason: str = ""
    faulty: bool = False
    columns: dict[str, FloatArray] = field(default_factory=dict)


def ask(function: Planner, scene: Scene) -> Given:
    """A planner's answer in a scene, checked. An error that it raises is a reason, whatever it is."""
    try:
        answer = function(scene)
    except Exception as error:
        return Given(reason=" ".join(f"{type(error).__name__}: {error}".split())[:300], faulty=True)
    if isinstance(answer, str):
        return Given(reason=answer or "no reason given")
    if not isinstance(answer, PlannedMotion):
        return Given(reason=f"it returned {type(answer).__name__}, neither a motion nor a text", faulty=True)
    try:
        columns = _columns(answer, scene.dt)
    except (TypeError, ValueError) as error:
        return Given(reason=f"its motion cannot be read: {error}", faulty=True)
    if reason := _fault(columns, scene):
        return Given(reason=reason, faulty=True)
    return Given(PlannedMotion(**columns), columns=columns)


def _columns(motion: PlannedMotion, dt: float) -> dict[str, FloatArray]:
    """Every column of a motion. Raises TypeError or ValueError if one cannot be one."""
    columns = {name: np.asarray(getattr(motion, name), dtype=np.float64) for name in ("x", "y")}
    for name, source in _DERIVED:
        values = getattr(motion, name)
        if values is None and columns[source].ndim == 1 and len(columns[source]) >= 3:
            values = np.gradient(columns[source], dt, edge_order=2)
        columns[name] = np.asarray(values, dtype=np.float64)
    return columns


def _fault(columns: dict[str, FloatArray], scene: Scene) -> str:
    """Why a motion cannot be a plan of the scene, or ""."""
    shapes = {name: values.shape for name, values in columns.items()}
    if len(set(shapes.values())) > 1 or columns["x"].ndim != 1:
        return f"its columns have the shapes {', '.join(f'{n} {s}' for n, s in shapes.items())}: one is needed"
    n = len(columns["x"]) - 1
    if not 3 <= n < scene.samples:
        return f"it has {n + 1} samples of {scene.dt:g} s: 4 to {scene.samples} are needed"
    bad = [name for name, values in columns.items() if not np.isfinite(values).all()]
    if bad:
        return f"{bad[0]} is not finite"
    if max(abs(columns["x"][0]), abs(columns["y"][0])) > _PLACE_M:
        return f"it starts at ({columns['x'][0]:.2f}, {columns['y'][0]:.2f}) m, not at the ego"
    if abs(columns["vx"][0] - scene.v0) > _SPEED_MPS:
        return f"it starts at {columns['vx'][0]:.2f} m/s, the ego at {scene.v0:.2f} m/s"
    if abs(columns["y"][-1] - scene.lateral_shift) > _LANE_M:
        return f"it ends {columns['y'][-1]:.2f} m to the left: the target lane is at {scene.lateral_shift:.2f} m"
    return ""


def plans_of(problem: PlanningProblem, name: str, given: Given) -> list[Plan]:
    """What a planner's answer comes to under every accounting, scored as ours: followers react, contacts count.

    Nothing is rejected: limits that the motion breaks are negative margins.
    """
    if given.motion is None:
        status = names.FAULTY if given.faulty else names.INFEASIBLE
        if planner.overlap_at_start(problem) and not given.faulty:
            status = names.INFEASIBLE_AT_START
        return [Plan(name, accounting, status) for accounting in names.ACCOUNTINGS]
    played = replay(_av(given.columns, problem), problem.packed)
    limits = motion_margins(given.motion, problem.limit)
    found = []
    for accounting in names.ACCOUNTINGS:
        plan = Plan(name, accounting, names.SOLVED, replay=played, motion=given.motion)
        met = planner.contact_of(problem, name, played, accounting)
        margins = limits | planner.apart(problem, played, accounting)
        found.append(replace(plan, status=names.CONTACT if met else names.SOLVED, contact=met, margins=margins))
    return found


def _av(columns: dict[str, FloatArray], problem: PlanningProblem) -> AvMotion:
    """The motion on the scene's grid; what follows it is filled by ``replay``."""
    samples, n = problem.scene.samples, len(columns["x"]) - 1
    jerk = np.abs(columns["jx"]) + np.abs(columns["jy"])
    x, y, vx, vy, ax, j = (np.pad(values, (0, samples - n - 1)) for values in (
        *(columns[name] for name in ("x", "y", "vx", "vy", "ax")), jerk
    ))  # fmt: skip
    across = np.flatnonzero(columns["y"] / problem.scene.lateral_shift >= 0.5)
    crossing = int(across[0]) if len(across) else samples
    return AvMotion(x, y, vx, vy, ax, j, n=n, crossing=crossing)
