"""Where lane changes begin and end, from lane ids and lateral positions (SPEC section 11).

The authors' rule: outward from the crossing, the nearest moments at which lateral speed and acceleration are
both near zero, read together with the lateral position. Near zero means here, on the derivatives of a local
quadratic through the positions: speed towards the target below a threshold and staying so for a while,
acceleration below a threshold at the moment itself, and the vehicle off the marking that it crosses.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.core.kinematics import local_polynomial
from highd_lc.vocab import names

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

OUTSIDE = 0
ABSENT = -1


@dataclass(frozen=True)
class Rule:
    """Numbers of the rule. smoothing_s: width of the local quadratic [s]; speed [m/s] and acceleration
    [m/s^2]: what counts as near zero; persistence_s: how long the speed stays so [s]; clearance_m: distance
    from the marking that start and end need [m]; flicker_s: lane ids that change back within this time are one
    crossing [s]; min_shift_m: smallest lateral shift [m].
    """

    smoothing_s: float
    speed: float
    acceleration: float
    persistence_s: float
    clearance_m: float
    flicker_s: float
    min_shift_m: float


@dataclass(frozen=True)
class LaneChange:
    """One lane-id change. crossing: its first sample in the target lane; start, end: samples, -1 = not found;
    origin, target: lanes, 0 = outside; reason: why it is no complete lane change, empty if it is; peak_speed:
    largest lateral speed towards the target between start and end [m/s], NaN if it is not complete.
    """

    crossing: int
    origin: int
    target: int
    reason: str = ""
    start: int = ABSENT
    end: int = ABSENT
    peak_speed: float = float("nan")


@dataclass(frozen=True)
class Path:
    """One vehicle's samples: frame, lane (0 = outside), y [m, left positive], each of shape (n,); rate [Hz]."""

    frame: IntArray
    lane: IntArray
    y: FloatArray
    rate: float


def find_lane_changes(path: Path, rule: Rule) -> list[LaneChange]:
    """Every lane-id change of a vehicle, in order, classified by the vehicle's own motion alone."""
    crossings = 1 + np.flatnonzero(np.diff(path.lane))
    if len(crossings) == 0:
        return []
    smooth = local_polynomial(path.y, path.rate, window_s=rule.smoothing_s)
    changes = [LaneChange(int(c), int(path.lane[c - 1]), int(path.lane[c])) for c in crossings]
    groups = _group_flicker(changes, path, rule)
    found: list[LaneChange] = []
    for place, group in enumerate(groups):
        before = groups[place - 1][-1] if place else None
        after = groups[place + 1][0] if place + 1 < len(groups) else None
        found += _judge_group(group, path, smooth, rule=rule, before=before, after=after)
    return found


def _group_flicker(changes: Sequence[LaneChange], path: Path, rule: Rule) -> list[list[LaneChange]]:
    """Runs of changes between the same two lanes, each within ``flicker_s`` of the one before."""
    groups: list[list[LaneChange]] = []
    for change in changes:
        last = groups[-1][-1] if groups else None
        if last and last.origin == change.target and _seconds(path, last, change) <= rule.flicker_s:
            groups[-1].append(change)
        else:
            groups.append([change])
    return groups


def _seconds(path: Path, first: LaneChange, second: LaneChange) -> float:
    return float(path.frame[second.crossing] - path.frame[first.crossing]) / path.rate


def _judge_group(
    group: Sequence[LaneChange],
    path: Path,
    smooth: FloatArray,
    *,
    rule: Rule,
    before: LaneChange | None,
    after: LaneChange | None,
) -> list[LaneChange]:
    """The group's change nearest to the smoothed crossing stands for it; the others are flicker."""
    if len(group) % 2 == 0:
        return [replace(change, reason=names.RETURNED) for change in group]
    marking = float(np.mean([(path.y[c.crossing - 1] + path.y[c.crossing]) / 2 for c in group]))
    main = min(group[::2], key=lambda change: abs(float(smooth[0, change.crossing]) - marking))
    judged = _judge(main, path, smooth - [[marking], [0.0], [0.0]], rule=rule, before=before, after=after)
    return [judged if change is main else replace(change, reason=names.FLICKER) for change in group]


def _judge(
    change: LaneChange,
    path: Path,
    smooth: FloatArray,
    *,
    rule: Rule,
    before: LaneChange | None,
    after: LaneChange | None,
) -> LaneChange:
    """Find start and end of a change. smooth: distance left of the marking, its speed and acceleration."""
    if reason := _refusal(change, path):
        return replace(change, reason=reason)
    first, last = _unbroken(path.frame, change.crossing)
    towards = smooth * (change.target - change.origin)
    begin = max(first, before.crossing) if before else first
    stop = min(last, after.crossing - 1) if after else last
    needed = 1 + round(rule.persistence_s * path.rate)
    limits = np.array([rule.clearance_m, rule.speed, rule.acceleration])
    crossing = change.crossing
    found = replace(
        change,
        start=_first_rest(towards, crossing - 1, crossing - begin, -1, begin == first, needed, limits),
        end=_first_rest(towards, crossing, stop - crossing + 1, 1, stop == last, needed, limits),
    )
    reasons = [
        _why_no_rest(found, before, cut=names.CUT_BEFORE_START, broken=first > 0) if found.start == ABSENT else "",
        _why_no_rest(found, after, cut=names.CUT_AFTER_END, broken=last < len(path.y) - 1)
        if found.end == ABSENT
        else "",
    ]
    return _with_verdict(found, [reason for reason in reasons if reason], path, towards[1], rule=rule)


def _refusal(change: LaneChange, path: Path) -> str:
    if OUTSIDE in (change.origin, change.target):
        return names.OUTSIDE_MARKINGS
    if abs(change.target - change.origin) != 1:
        return names.NOT_ADJACENT
    hole = path.frame[change.crossing] - path.frame[change.crossing - 1] != 1
    return names.TRACK_HOLE if hole else ""


def _unbroken(frame: IntArray, sample: int) -> tuple[int, int]:
    """First and last sample of the run of consecutive frames around a sample."""
    holes = 1 + np.flatnonzero(np.diff(frame) != 1)
    place = int(np.searchsorted(holes, sample, side="right"))
    first = int(holes[place - 1]) if place else 0
    last = int(holes[place]) - 1 if place < len(holes) else len(frame) - 1
    return first, last


@njit(cache=True, nogil=True)
def _first_rest(
    towards: FloatArray, first: int, count: int, step: int, open_ended: bool, needed: int, limits: FloatArray
) -> int:
    """First sample, outward from the crossing, at which the vehicle keeps its lane, or ABSENT.

    towards: distance past the marking, speed and acceleration towards the target, shape (3, n); first, count,
    step: the samples outward; needed: how many samples in a row must be slow; limits: of distance, speed and
    acceleration. At the end of a track (open_ended) the slow samples still in view are enough; before another
    lane change they are not.
    """
    for place in range(count):
        sample = first + step * place
        at_rest = abs(towards[2, sample]) < limits[2] and abs(towards[0, sample]) >= limits[0]
        if not at_rest or towards[1, sample] >= limits[1]:
            continue
        slow = place + 1
        while slow < min(count, place + needed) and towards[1, first + step * slow] < limits[1]:
            slow += 1
        if slow == place + needed or (slow == count and open_ended):
            return sample
    return ABSENT


def _why_no_rest(change: LaneChange, other: LaneChange | None, *, cut: str, broken: bool) -> str:
    """Why a start or end was not found: another change (other) came first, the track broke off or ended."""
    if other is not None:
        back = other.origin == change.target and other.target == change.origin
        return names.RETURNED if back else names.SECOND_CHANGE
    return names.TRACK_HOLE if broken else cut


def _with_verdict(
    change: LaneChange, reasons: list[str], path: Path, speed: FloatArray, *, rule: Rule
) -> LaneChange:
    if reasons:
        return replace(change, reason=min(reasons, key=names.REASONS.index))
    shift = (path.y[change.end] - path.y[change.start]) * (change.target - change.origin)
    peak = float(speed[change.start : change.end + 1].max())
    return replace(change, reason="" if shift >= rule.min_shift_m else names.SMALL_SHIFT, peak_speed=peak)
