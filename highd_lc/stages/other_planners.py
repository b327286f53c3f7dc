"""Other people's planners in a run: found by name, asked in every event, and set beside our policies."""

import importlib
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd

from highd_lc.io import artefacts
from highd_lc.io.workspace import append_log
from highd_lc.planning import planner
from highd_lc.planning.other_planners import Planner, ask, plans_of
from highd_lc.planning.planner import Plan
from highd_lc.stages.tracking_tables import Planned, driven_row
from highd_lc.tracking.plan_tracking import DrivenPlan
from highd_lc.vocab import names
from highd_lc.vocab.errors import SettingsError
from highd_lc.vocab.job import Job
from highd_lc.vocab.policy import POLICIES
from highd_lc.vocab.tables import TABLES
from highd_lc.vocab.tracking import KINEMATIC

GROUP: Final = "highd_lc.planners"
"""Entry points in which packages offer planners."""
_OF_TRACKING: Final = ("rmse_lateral_m", "max_lateral_m", "loss_av_tracked")
_MEANS: Final = (
    "loss_av", "loss_hv", "loss_total", "min_gap_m", "max_drac", "peak_follower_decel", "rmse_lateral_m",
)  # fmt: skip

Row = dict[str, Any]


def load(name: str) -> Planner:
    """The planner of a name: ``module:function``, looked for in the working folder too, or an entry point's.

    Raises SettingsError if there is none, or importing it fails.
    """
    if name in POLICIES:
        raise SettingsError(f"planner {name!r}: the name of a policy of this package")
    if ":" not in name:
        return _offered(name)
    module, _, attribute = name.partition(":")
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)
    try:
        found = getattr(importlib.import_module(module), attribute)
    except Exception as error:  # whatever the module does when it is imported
        raise SettingsError(f"planner {name!r}: {type(error).__name__}: {error}") from error
    if not callable(found):
        raise SettingsError(f"planner {name!r}: a {type(found).__name__}, not a function")
    function: Planner = found
    return function


def _offered(name: str) -> Planner:
    offered = {point.name: point for point in entry_points(group=GROUP)}
    if name not in offered:
        known = f"entry points of {GROUP}: {', '.join(sorted(offered)) or 'none'}"
        raise SettingsError(f"planner {name!r}: give module:function, or one of the {known}")
    try:
        found: Planner = offered[name].load()
    except Exception as error:
        raise SettingsError(f"planner {name!r}: {type(error).__name__}: {error}") from error
    return found


def sources(planners: Sequence[str]) -> list[Path]:
    """The files in which planners stand, as far as they have one. Raises SettingsError as ``load``."""
    modules = [sys.modules.get(getattr(load(name), "__module__", ""), None) for name in planners]
    return [Path(module.__file__) for module in modules if module is not None and module.__file__]


@dataclass(frozen=True)
class OtherPlanners:
    """The planners of a run by name, the function's where it is one's alone, and each's times per event [s]."""

    functions: dict[str, Planner]
    seconds: dict[str, list[float]] = field(default_factory=dict)

    @classmethod
    def of(cls, wanted: Sequence[str]) -> "OtherPlanners":
        """Those of the setting ``validate.planners``. Raises SettingsError as ``load``."""
        functions = [name.partition(":")[2] or name for name in wanted]
        own = [
            f if functions.count(f) == 1 and f not in POLICIES else w
            for f, w in zip(functions, wanted, strict=True)
        ]
        return cls({name: load(where) for name, where in zip(own, wanted, strict=True)})

    def plans(self, planned: Planned) -> list["OtherPlan"]:
        """What each makes of an event under every accounting; it is asked once."""
        problem = planned.tracker.problem
        found: list[OtherPlan] = []
        for name, function in self.functions.items():
            given = self.timed(name, partial(ask, function, problem.scene))
            for plan in plans_of(problem, name, given):
                asked = plan.accounting == names.PRIMARY_ACCOUNTING
                found.append(
                    OtherPlan(plan, given.reason, planned.tracker.drive(plan, KINEMATIC) if asked else None)
                )
        if self.functions:  # beside them the time of the policy that this package is about
            fresh = planner.pose(problem.scene, problem.settings)
            self.timed(names.LOCAL_OPTIMUM, partial(planner.plan_one, fresh, names.LOCAL_OPTIMUM, names.EQUAL))
        return found

    def timed(self, name: str, call: Callable[[], Any]) -> Any:
        """The result of a call, whose time is kept under a name."""
        started = time.perf_counter()
        result = call()
        self.seconds.setdefault(name, []).append(time.perf_counter() - started)
        return result

    def log_times(self, job: Job) -> None:
        """Write the times to the run's log: they differ from run to run, as no artefact may."""
        for name, seconds in self.seconds.items():
            about = {"planner": name, "recording": job.recording, "events": len(seconds)}
            times = {
                "ms_median": round(1e3 * float(np.median(seconds)), 3),
                "ms_largest": round(1e3 * max(seconds), 3),
            }
            append_log(job.work, about | times)


@dataclass(frozen=True)
class OtherPlan:
    """A planner's answer under an accounting. reason: why it has none; driven: as the kinematic car drove it."""

    plan: Plan
    reason: str
    driven: DrivenPlan | None


def other_rows(planned: Planned, others: Sequence[OtherPlan], score: Callable[[Plan], Row]) -> Iterator[Row]:
    """The rows of ``other_plans`` of one event. score: the columns of plans and losses of a plan."""
    problem = planned.tracker.problem
    for one in others:
        row = score(one.plan)
        broken = [limit for limit, margin in one.plan.margins.items() if margin < -_slack(limit, problem)]
        row |= {"reason": one.reason, "violations": broken} | _tracking(planned, one)
        yield {column: row[column] for column in TABLES["other_plans"].column_names if column in row}


def _slack(limit: str, problem: planner.PlanningProblem) -> float:
    """What is let pass of a limit: 1 % of acceleration and jerk, whose differences are not exact."""
    bounds = {"acceleration": problem.limit.acceleration, "jerk": problem.limit.jerk}
    return 0.01 * bounds.get(limit.split("_")[0], 0.0) + 1e-9


def _tracking(planned: Planned, other: OtherPlan) -> Row:
    """How the kinematic car drives a plan; only the primary accounting's is driven."""
    if other.driven is None:
        return {"tracking_status": ""}
    row = driven_row(planned.tracker, other.driven)
    found = {name: row.get(name, np.nan) for name in _OF_TRACKING}
    return found | {"tracking_status": row["status"], "tracked_violations": row.get("violations")}


def leaderboard(work: Path, model: str) -> pd.DataFrame:
    """All policies and planners side by side, accounting equal. model: the follower model that planned."""
    others = artefacts.read(work, "other_plans")
    others = others[others["accounting"] == names.EQUAL]
    columns = list(TABLES["leaderboard"].column_names)
    if others.empty:
        return pd.DataFrame(columns=columns)
    both = pd.concat([_ours(work, model, set(others["event_id"])), others.assign(ours=False)], ignore_index=True)
    scored = both[both["loss_total"].notna()]
    per_event = scored.groupby("event_id")["policy"].nunique()
    common = set(per_event.index[per_event == both["policy"].nunique()])
    order = both.drop_duplicates("policy")[["policy", "ours"]]
    rows = [_line(both[both["policy"] == one.policy], bool(one.ours), common) for one in order.itertuples()]
    return pd.DataFrame(rows, columns=columns).sort_values("loss_total", kind="stable", na_position="last")


def _ours(work: Path, model: str, events: set[str]) -> pd.DataFrame:
    """The rows of our policies that plan every event, with what the table of others has."""
    key = ["event_id", "followers", "policy"]
    equal = [("accounting", "==", names.EQUAL)]
    plans, losses = (artefacts.read(work, name, where=equal) for name in ("plans", "losses"))
    tracking = artefacts.read(work, "tracking")
    tracking = tracking[tracking["plant"] == KINEMATIC]
    found = plans[[*key, "status", "violations"]].merge(losses.drop(columns="accounting"), on=key)
    found = found.merge(tracking[[*key, "rmse_lateral_m"]], on=key, how="left")
    own = found["followers"].eq(model) & found["event_id"].isin(events)
    own &= ~found["policy"].isin([name for name, one in POLICIES.items() if one.chooses_start or one.robust])
    return found[own].assign(ours=True)


def _line(rows: pd.DataFrame, ours: bool, common: set[str]) -> Row:
    """A line of the board. Means are over the events that every policy plans without a contact."""
    shared = rows[rows["event_id"].isin(common)]
    broken = [len(limits) > 0 for limits in rows["violations"]]
    return {
        "policy": rows["policy"].iloc[0],
        "ours": ours,
        "n_events": len(rows),
        "n_planned": int(rows["min_gap_m"].notna().sum()),
        "n_contacts": int(rows["contact"].ne("").sum()),
        "n_violating": int(sum(broken)),
        "n_faulty": int(rows["status"].eq(names.FAULTY).sum()),
        "n_common": len(shared),
        **{name: float(shared[name].mean()) if len(shared) else np.nan for name in _MEANS},
    }
