"""Words, units and colours of pages and figures: one place, so that every chart speaks alike.

Colours are Okabe and Ito's palette, told apart by people with any common colour blindness; forms with a free
end speed are dashed as well, so that no distinction rests on colour alone.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final
from zlib import crc32

from highd_lc.vocab import names
from highd_lc.vocab.published import TABLE_3
from highd_lc.vocab.tables.studies import DRAWN, IDM_MOTORWAY
from highd_lc.vocab.tracking import KINEMATIC, MULTI_BODY

RECORDED: Final = "recorded"
"""Everything as recorded: not a policy, but a way in which an event can be played."""


@dataclass(frozen=True)
class Look:
    """How a policy is drawn: its label, its colour on a light and on a dark ground, and whether dashed."""

    label: str
    light: str
    dark: str
    dashed: bool = False


POLICIES: Final = {
    RECORDED: Look("Recorded", "#555555", "#b8b8b8"),
    names.NO_LANE_CHANGE: Look("No lane change", "#009E73", "#2fc49a"),
    names.CONSTANT: Look("Constant speed, 5.5 s", "#B0578D", "#e39ac6"),
    names.HUMAN: Look("Human", "#222222", "#f0f0f0"),
    names.BENCHMARK: Look("Benchmark", "#D55E00", "#f08a3c"),
    names.LOCAL_OPTIMUM: Look("Local optimum", "#0072B2", "#5ab4ec"),
    names.BENCHMARK_FREE: Look("Benchmark, free end speed", "#A87400", "#f0b93a", dashed=True),
    names.LOCAL_OPTIMUM_FREE: Look("Local optimum, free end speed", "#2A8FC9", "#8fd0f7", dashed=True),
    names.BENCHMARK_START: Look("Benchmark, chosen start", "#8C3A00", "#ff9f66"),
    names.LOCAL_OPTIMUM_START: Look("Local optimum, chosen start", "#004C78", "#4aa6e8"),
    names.BENCHMARK_FREE_START: Look("Benchmark, chosen start, free end speed", "#7A5A00", "#d9a52a", dashed=True),
    names.LOCAL_OPTIMUM_FREE_START: Look(
        "Local optimum, chosen start, free end speed", "#1F6F9E", "#74c6f2", dashed=True
    ),
    names.LOCAL_OPTIMUM_ROBUST: Look("Robust local optimum", "#00695C", "#4fc3b5"),
    names.LOCAL_OPTIMUM_ROBUST_FREE: Look(
        "Robust local optimum, free end speed", "#2E7D6E", "#86d9cd", dashed=True
    ),
    names.BENCHMARK_REPLANNED: Look("Benchmark, replanned", "#B34700", "#ff8f4d"),
    names.LOCAL_OPTIMUM_REPLANNED: Look("Local optimum, replanned", "#005A8C", "#3fa0e0"),
    names.LOCAL_OPTIMUM_ROBUST_REPLANNED: Look("Robust local optimum, replanned", "#00574C", "#35b0a1"),
}

ACCOUNTINGS: Final = {
    names.PAPER: "Paper: both sides over 0..T",
    names.FOLLOWER_HORIZON: "Follower horizon: AV over 0..T, followers over 0..H",
    names.EQUAL: "Equal: both sides over 0..H",
}

ACCOUNTING_NAMES: Final = {
    names.PAPER: "Paper",
    names.FOLLOWER_HORIZON: "Follower horizon",
    names.EQUAL: "Equal",
}

FORMS: Final = {
    names.FIXED: "Fixed end speed",
    names.FREE: "Free end speed",
    names.START: "Chosen start, fixed end speed",
    names.FREE_START: "Chosen start, free end speed",
    names.ROBUST: "Robust, fixed end speed",
    names.ROBUST_FREE: "Robust, free end speed",
}

STATUSES: Final = {
    names.SOLVED: "solved",
    names.REFERENCE: "reference",
    names.CONTACT: "contact",
    names.INFEASIBLE: "infeasible",
    names.INFEASIBLE_AT_START: "infeasible at start",
    names.FAULTY: "faulty",
}

REASONS: Final = {
    names.OUTSIDE_MARKINGS: "a box centre lies outside the lane markings",
    names.NOT_ADJACENT: "the two lanes are not adjacent",
    names.TRACK_HOLE: "the track has a hole in the window",
    names.FLICKER: "the lane id flickers at a marking, no lane is left",
    names.RETURNED: "the vehicle returns to its lane",
    names.CUT_BEFORE_START: "the start is not in view",
    names.CUT_AFTER_END: "the end is not in view",
    names.SECOND_CHANGE: "a second lane change falls into the window",
    names.SMALL_SHIFT: "the lateral shift is too small",
    names.FOLLOWER_AHEAD: "the follower's front is not behind the ego's at the start",
    names.NO_TARGET_FOLLOWER: "there is no follower on the target lane",
}

FIT_STATUSES: Final = {
    names.FITTED: "fitted",
    names.CLASS_POOL: "class pool",
    names.POOL: "pool of all",
    names.TABLE3: "Table 3 means",
}

PARAMETERS: Final = {
    "v_desire": "desired speed v_desire",
    "A": "maximum acceleration A",
    "b": "own deceleration b",
    "B": "expected deceleration B",
    "tau": "reaction time tau",
    "L": "standstill spacing L",
}


LOSS_PARTS: Final = (
    ("av_comfort", "AV comfort", "#0072B1"),
    ("av_efficiency", "AV efficiency", "#56B4E8"),
    ("hv_comfort", "followers' comfort", "#D55E01"),
    ("hv_efficiency", "followers' efficiency", "#E69F01"),
)
"""Parts of a loss: column, label, colour; a shade off the policies', so that pages tell them apart when dark."""

FIT_QUALITY: Final = {
    "objective": ("objective of the fit", ""),
    "objective_ga": ("objective before the polish", ""),
    "rmse_spacing_m": ("RMSE of spacing", "m"),
    "rmse_speed_mps": ("RMSE of speed", "m/s"),
    "rmse_acceleration": ("RMSE of acceleration", "m/s²"),
    "nrmse_spacing": ("RMSE of spacing over its root mean square", ""),
    "theil_u": ("Theil's U of spacing", ""),
    "paper_j": ("the paper's one-step objective J", ""),
}
"""How well a follower is fitted: label and unit."""

QUANTITIES: Final = {
    "loss_total": "total loss",
    "loss_av": "AV loss",
    "loss_hv": "followers' loss",
    "av_comfort": "AV comfort",
    "av_efficiency": "AV efficiency",
    "hv_comfort": "followers' comfort",
    "hv_efficiency": "followers' efficiency",
    "worst_follower": "loss of the follower worst off",
    "loss_hv_increment": "followers' loss due to the lane change",
    "min_gap_m": "smallest gap [m]",
    "min_time_headway_s": "smallest time headway [s]",
    "min_ttc_s": "smallest time to collision [s]",
    "max_drac": "largest deceleration to avoid a crash (DRAC) [m/s²]",
    "peak_follower_decel": "followers' peak braking [m/s²]",
}
"""Quantities of ``summary_losses``."""


_PREDICTORS: Final = {
    RECORDED: "recorded",
    names.CONSTANT_SPEED: "constant speed",
    names.DECAYING_ACCELERATION: "decaying acceleration",
    names.DRIFT: "drift and decaying acceleration",
    names.OWN_FIT: "own fit",
    names.MEAN: "mean of the fits",
    names.TABLE3: "Table 3 means",
    names.IDM: "IDM",
    names.POPULATION: "population",
}
_SECOND_OPINIONS: Final = {IDM_MOTORWAY: "IDM, motorway", DRAWN: "drawn parameters", names.SUMO: "SUMO"}
_SUFFIX: Final = {"+": "with", "-": "without"}
_MOMENTS: Final = {"start": "the start", "crossing": "the crossing"}
_BORROWED: Final = (
    names.LOCAL_OPTIMUM,
    names.BENCHMARK,
    names.NO_LANE_CHANGE,
    names.CONSTANT,
    names.BENCHMARK_FREE,
    names.LOCAL_OPTIMUM_FREE,
)


def follower_model(name: str) -> str:
    """A follower model as a reader says it: ``own_fit+relaxation`` is "own fit with relaxation".

    A name that is not known, as of a model that a user adds, stays as it is.
    """
    whole, *parts = re.split(r"([+-])", name)
    base, _, moment = whole.partition("@")
    if base not in _PREDICTORS:
        return name
    suffixes = (
        f" {_SUFFIX[sign]} {part.replace('_', ' ')}" for sign, part in zip(parts[::2], parts[1::2], strict=True)
    )
    since = f" from {_MOMENTS.get(moment, f'{moment} of the way')}" if moment else ""
    return _PREDICTORS[base] + since + "".join(suffixes)


def scored_with(name: str) -> str:
    """Who the followers are when plans are scored: a follower model, or a second opinion."""
    return _SECOND_OPINIONS.get(name) or follower_model(name)


def in_order(models: Iterable[str]) -> list[str]:
    """Follower models once each: the naive ones first, then as they come."""
    present = list(dict.fromkeys(models))
    naive = [model for model in names.NAIVE_MODELS if model in present]
    return naive + [model for model in present if model not in naive]


def borrowed_colours(models: Iterable[str], default: str) -> dict[str, str]:
    """The policy whose colour each follower model is drawn in: the one that plans has the local optimum's."""
    others = [model for model in models if model != default]
    places = {model: 1 + k % (len(_BORROWED) - 1) for k, model in enumerate(others)}
    return {model: _BORROWED[place] for model, place in (places | {default: 0}).items()}


_STRATUM_KINDS: Final = {
    "followers": "followers on target lane",
    "leader": "target leader",
    "spacing": "spacing to HV 1",
    "closing": "closing speed of HV 1",
    "speed": "speed of the AV",
}
_STRATUM_UNITS: Final = {"spacing": "m", "closing": "m/s", "speed": "m/s"}


PLANTS: Final = {KINEMATIC: "kinematic bicycle", MULTI_BODY: "multi-body car", "planned": "as planned"}
"""Models of the car that drives a plan, and none."""


def stratum(name: str) -> str:
    """A stratum as a reader says it: ``spacing=15 to 30`` is "spacing to HV 1: 15 to 30 m"."""
    kind, _, value = name.partition("=")
    words = _STRATUM_KINDS.get(kind, kind.replace("_", " "))
    return f"{words}: {value.replace('-', '−')} {_STRATUM_UNITS.get(kind, '')}".rstrip() if value else name


OTHERS: Final = (("#7A3E9D", "#c79be0"), ("#8A5A44", "#d3a58c"), ("#C2185B", "#f48fb1"), ("#4D6B00", "#b5cf5f"))
"""Colours of planners of others, on a light and on a dark ground."""
_LONGEST: Final = 18
"""Letters of a planner's name where room is short."""


def look(policy: str) -> Look:
    """How a policy is drawn; a planner of somebody else's has its own name, and a colour that goes with it."""
    return POLICIES.get(policy) or Look(policy, *OTHERS[_place_of(policy)], dashed=True)


def css_colour(policy: str) -> str:
    """The colour of a policy in a style sheet, which knows both grounds."""
    return f"var(--policy-{policy})" if policy in POLICIES else f"var(--other-{_place_of(policy)})"


def _place_of(planner: str) -> int:
    return crc32(planner.encode()) % len(OTHERS)


def short_policy(name: str) -> str:
    """A policy's label where room is short."""
    if name not in POLICIES:
        return name if len(name) <= _LONGEST else f"…{name[1 - _LONGEST :]}"
    label = POLICIES[name].label
    return label.replace(", free end speed", ", free").replace(", chosen start", ", start").replace(", 5.5 s", "")


def gap(name: str) -> str:
    """A gap on the target lane as a reader says it: ``behind_target_follower_1`` is "behind HV 1"."""
    if name.startswith("behind_"):
        return f"behind {role(name.removeprefix('behind_'))}"
    return {names.RECORDED_GAP: "the recorded gap"}.get(name, name.replace("_", " "))


def through(pair: str) -> str:
    """A contact as a reader says it: "HV 2 drives through HV 1" (see ``names.through``)."""
    return " drives through ".join(map(role, pair.split("_through_")))


CONTACT_CAUSES: Final = {
    names.BY_TRACKING: "the car beside its plan",
    names.BY_FOLLOWER_MODEL: "the followers' model, without a lane change too",
    names.BY_PLAN: "as planned already",
    names.BY_START: "too near at the start already",
    names.BY_LEADERS: "leaders do otherwise than predicted",
    names.BY_FOLLOWERS: "followers do otherwise than predicted",
    names.BY_FORESIGHT: "who knows all that comes has it too",
    names.BY_RECORDING: "as recorded",
}
"""Why there is a contact (``names.TRACKING_CAUSES``, ``names.LOOP_CAUSES``)."""


_BLOCKERS: Final = {
    "motion": "limits of motion",
    "contact": "clearance or contact",
    "insertion_gap": "gap behind at the start (UN R79)",
    "drac_ahead": "DRAC ahead",
    "drac_behind": "DRAC behind",
    "follower_gap": "gap between followers",
}


def blocker(name: str) -> str:
    """What stands in a candidate's way, as a reader says it; constraints of the safety profile among them."""
    return _BLOCKERS.get(name, name.replace("_", " "))


def scenario(key: str) -> str:
    """A scenario's key as a reader says it: "2_15" is "2, AV 15 m/s"."""
    if key == TABLE_3:
        return "Table 3"
    number, _, speed = key.partition("_")
    return f"{number}, AV {speed} m/s" if speed else number


def role(name: str) -> str:
    """A role as a reader says it: ``target_follower_1`` is "HV 1"."""
    if name.startswith(names.TARGET_FOLLOWER):
        return f"HV {name.rsplit('_', 1)[1]}"
    return {names.EGO: "AV"}.get(name, name.replace("_", " "))


CLAIMS: Final = {
    "hv_loss_falls": "followers' loss falls",
    "total_loss_falls": "total loss falls",
    "av_loss_rises": "AV loss rises",
    "travel_time_falls": "travel time falls",
    "av_faster": "AV faster",
    "av_returns": "AV returns",
    "flow_rises": "flow rises",
    "speed_rises": "speed rises",
    "density_falls": "density falls",
    "lateral_acceleration_falls": "lateral acceleration falls",
    "far_followers_gain": "HV 5 to 10 gain most",
    "total_lowest_at_half": "total lowest at 0.5-0.6",
    "weights_trade": "weights trade losses",
}
"""Claims in the order of the paper, in few words."""
