"""The data of an event page, packed small: what is drawn, no finer than it is drawn.

A channel (one quantity of one vehicle over the time grid) is rounded to a step, differenced, and stored as
signed bytes; the step is the resolution asked for, or coarser where the channel moves too fast for a byte.
Pages that may be shared carry recorded quantities at 0.1 m, 0.1 m/s and 0.1 m/s^2, at most 10 samples a second.
"""

import base64
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.kinematics import known_spans, level_differences
from highd_lc.reporting import labels
from highd_lc.reporting.event import (
    EventReport,
    FitTrace,
    Ground,
    Path,
    Play,
    PredictionTrace,
    Surface,
    TrackTrace,
)
from highd_lc.vocab import names
from highd_lc.vocab.policy import PAIRS

FloatArray = NDArray[np.float64]

SAFE_STEP: Final = 0.1
"""Resolution of recorded quantities on a page that may be shared [m, m/s, m/s^2]."""
FINE_STEP: Final = 0.01
_SAFE_PERIOD: Final = 0.1
_LARGEST_BYTE: Final = 126
_FEW_MODELS: Final = 6
"""Lines that can be told apart in one chart beside the recorded one."""
_LEVELS: Final = 65534
_UNKNOWN: Final = 65535


@dataclass(frozen=True)
class Packed:
    """Channels as bytes: for each its step, first value, first sample and number of samples."""

    channels: list[list[float]]
    data: bytes


def pack(channels: Sequence[FloatArray], step: float) -> Packed:
    """Channels (each of shape (n,), NaN only at its ends, which are left out) as heads and one run of bytes."""
    values = np.array(channels)
    spans, fastest = known_spans(values)
    steps = [_step(speed / _LARGEST_BYTE, step) for speed in fastest.tolist()]
    bases, differences = level_differences(values, spans, np.array(steps))
    heads = zip(steps, bases.tolist(), spans.tolist(), strict=True)
    return Packed([[own, base, *span] for own, base, span in heads], differences.tobytes())


def _step(least: float, step: float) -> float:
    """The step asked for, or a coarser one where a channel's largest difference needs it."""
    return step if least <= step else max(step, float(f"{least:.3g}"))


def event_payload(report: EventReport, *, raw: bool = False) -> dict[str, Any]:
    """What the script of an event page draws, ready for JSON. raw: recorded quantities at full resolution."""
    step = FINE_STEP if raw else SAFE_STEP
    drive = _steady_drive(report)
    return {
        "id": report.event_id,
        "dt": report.dt,
        "v0": _frame_speed(report),
        "divider": _rounded(report.divider, step),
        "markings": [_rounded(y, step) for y in report.markings],
        "shift": _rounded(float(report.event["lateral_shift_m"]), step),
        "duration": _rounded(float(report.event["duration_s"]), 0.01 if raw else 0.1),
        "boxes": {r: [round(b.length, 1), round(b.width, 1)] for r, b in report.boxes.items()},
        "looks": {policy: _look(policy) for policy in (*labels.POLICIES, *report.planners)},
        "others": [_other(role, path, report, step=step, drive=drive) for role, path in report.others.items()],
        "leads": [list(lead) for lead in report.leads],
        "plays": list(_plays(report.plays, step, drive)),
        "surface": None if report.surface is None else _surface(report.surface, report),
        "fits": {str(rank): _fit(trace, step) for rank, trace in report.fit_traces.items()},
        "tracks": [_track(trace, drive) for trace in report.track_traces],
        "ground": _ground(report.ground) if raw and report.ground else None,
        "prediction": None if report.prediction is None else _prediction(report.prediction, step),
    }


def _look(policy: str) -> dict[str, Any]:
    look = labels.look(policy)
    return {"label": look.label, "dashed": look.dashed, "colour": labels.css_colour(policy)}


def _ground(ground: Ground) -> dict[str, Any]:
    picture = base64.b64encode(ground.jpeg).decode("ascii")
    return {"href": f"data:image/jpeg;base64,{picture}", "x": list(ground.x), "y": list(ground.y)}


def _rounded(value: float, step: float) -> float | None:
    return round(round(value / step) * step, 3) if np.isfinite(value) else None


def _packed(channels: Sequence[FloatArray], step: float) -> dict[str, Any]:
    packed = pack(channels, step)
    return {"channels": packed.channels, "data": base64.b64encode(packed.data).decode("ascii")}


def _frame_speed(report: EventReport) -> float:
    return round(report.v0, 1)


def _steady_drive(report: EventReport) -> FloatArray:
    """x of a point that drives at v0. Relative to it numbers and differences are small: few bytes."""
    samples = max((path.x.size for path in (*report.others.values(), *_all_paths(report))), default=0)
    return _frame_speed(report) * report.dt * np.arange(samples, dtype=np.float64)


def _all_paths(report: EventReport) -> Iterator[Path]:
    for play in report.plays:
        yield play.ego
        yield from play.followers


def _co_moving(path: Path, drive: FloatArray) -> FloatArray:
    return path.x - drive[: path.x.size]


def _other(role: str, path: Path, report: EventReport, *, step: float, drive: FloatArray) -> dict[str, Any]:
    observed = report.observed.get(role, path.x.size)
    return {
        "role": role,
        "observed": observed,
        **_packed([_co_moving(path, drive), path.y, path.v, path.a], step),
    }


def _plays(plays: Iterable[Play], step: float, drive: FloatArray) -> Iterator[dict[str, Any]]:
    # Policies that found the same plan share its motion, which is packed once.
    packed: list[tuple[Play, dict[str, Any]]] = []
    for play in plays:
        same = [m for other, m in packed if other.ego is play.ego and other.followers is play.followers]
        motion = same[0] if same else _packed(_channels(play, drive), step if play.measured else FINE_STEP)
        packed.append((play, motion))
        yield {
            "policy": play.policy,
            "accountings": list(play.accountings),
            "T": round(play.T, 2) if np.isfinite(play.T) else None,
            "start": round(play.delay_s, 2),
            **({"plans": [_plan(*plan) for plan in play.plans]} if play.plans else {}),
            **motion,
        }


def _plan(t: float, x: FloatArray, y: FloatArray) -> list[Any]:
    """When a plan was made, and its x and y."""
    return [round(t, 2), np.round(x, 1).tolist(), np.round(y, 2).tolist()]


def _channels(play: Play, drive: FloatArray) -> list[FloatArray]:
    ego = play.ego
    channels = [_co_moving(ego, drive), ego.y, ego.v, ego.a, play.jerk]
    for path in play.followers:
        channels += [_co_moving(path, drive), path.y, path.v, path.a]
    return channels


def _fit(trace: FitTrace, step: float) -> dict[str, Any]:
    recorded = [trace.spacing_recorded, trace.speed_recorded]
    return {
        "t0": round(float(trace.t[0]), 2),
        "dt": _period(trace.t),
        "recorded": _packed(recorded, step),
        "simulated": _packed([trace.spacing_simulated, trace.speed_simulated], step),
    }


def _prediction(trace: PredictionTrace, step: float) -> dict[str, Any]:
    """Speeds with their looks: recorded first."""
    # Simulated speeds begin at the recorded one, so that they are as coarse.
    return {
        "dt": _period(trace.t),
        "looks": [[labels.follower_model(labels.RECORDED), labels.RECORDED, 0, True, True], *_model_looks(trace)],
        **_packed([trace.recorded, *trace.models.values()], step),
    }


def _model_looks(trace: PredictionTrace) -> Iterator[list[Any]]:
    """Of each follower model: name, colour, number of its dashes, whether it is heavy and shown at first."""
    colours, drawn = labels.borrowed_colours(trace.models, trace.default), Counter[str]()
    few = len(trace.models) <= _FEW_MODELS
    for model in trace.models:
        naive = model in names.NAIVE_MODELS
        dashes = 1 if naive else (0, 2, 3)[drawn[colours[model]] % 3]
        drawn[colours[model]] += not naive
        shown = few or model in (trace.default, names.CONSTANT_SPEED, names.OWN_FIT)
        yield [labels.follower_model(model), colours[model], dashes, model == trace.default, shown]


def _period(t: FloatArray) -> float:
    """The median step of a grid, to the millisecond."""
    if t.size < 2:
        return _SAFE_PERIOD
    steps: list[float] = sorted((t[1:] - t[:-1]).tolist())
    return round((steps[len(steps) // 2] + steps[~(len(steps) // 2)]) / 2, 3)


def _track(trace: TrackTrace, drive: FloatArray) -> dict[str, Any]:
    path = trace.path
    packed = {
        "path": _packed([_co_moving(path, drive), path.y, path.v, path.a], FINE_STEP),
        "policy": trace.policy,
        "plant": trace.plant,
        "dt": _period(trace.t),
    }
    if not trace.lateral.size:
        return packed
    errors, inputs = [trace.lateral, trace.longitudinal], [trace.v, trace.delta]
    return packed | {"errors": _packed(errors, 1e-4), "inputs": _packed(inputs, 1e-4)}


def _surface(surface: Surface, report: EventReport) -> dict[str, Any]:
    # Accountings share arrays, so each array is written once and named by its place.
    sides = {"av": surface.loss_av, "hv": surface.loss_hv}
    arrays: list[FloatArray] = []
    place = {(side, one): _place(array, arrays) for side, of in sides.items() for one, array in of.items()}
    return {
        "T": [round(T, 2) for T in surface.T.tolist()],
        "x": [round(x, 2) for x in surface.x_offset.tolist()],
        "points": _points(report),
        "blockers": [labels.blocker(name) for name in surface.blockers],
        "arrays": [_levels(a) for a in arrays],
        "losses": {
            accounting: {
                **{side: place[side, accounting] for side in sides},
                "feasible": _bits(surface.feasible[accounting]),
                "blocked": _codes(surface.blocked.get(accounting)),
            }
            for accounting in surface.loss_av
        },
    }


def _place(array: FloatArray, arrays: list[FloatArray]) -> int:
    """Where an array is among others, at their end if it is not yet there."""
    known = [k for k, other in enumerate(arrays) if other is array]
    if not known:
        arrays.append(array)
    return known[0] if known else len(arrays) - 1


_POINTS: Final = (names.CONSTANT, names.HUMAN, *PAIRS[names.FIXED])


def _points(report: EventReport) -> list[list[Any]]:
    rows = [row for row in report.plans if row["policy"] in _POINTS and np.isfinite(row["T"])]
    return [
        [row["policy"], row["accounting"], round(row["T"], 2), round(row["x_final"] - report.v0 * row["T"], 2)]
        for row in rows
    ]


def _levels(values: FloatArray) -> dict[str, Any]:
    """A surface as 16-bit levels between its smallest and largest value; the last level is "unknown"."""
    finite = np.isfinite(values)
    known = values[finite]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    scale = (high - low) / _LEVELS or 1.0
    levels = np.where(finite, np.rint((values - low) / scale), _UNKNOWN)
    data = base64.b64encode(levels.astype("<u2").tobytes()).decode("ascii")
    return {"low": round(low, 4), "scale": float(f"{scale:.6g}"), "data": data}


def _codes(values: NDArray[np.uint8] | None) -> str | None:
    return None if values is None else base64.b64encode(values.tobytes()).decode("ascii")


def _bits(values: NDArray[np.bool_]) -> str:
    return base64.b64encode(np.packbits(values.ravel(), bitorder="little").tobytes()).decode("ascii")
