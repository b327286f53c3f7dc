"""Where lane changes begin and end, from lane ids and lateral positions (SPEC section 11).

The authors' rule: outward from the crossing, the nearest moments at which lateral speed and acceleration are
both near zero, read together with the lateral position (``lateral_motion`` says when they are). Two changes
without a rest in their lane between them are one manoeuvre and no lane change of the kind that is looked for.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from highd_lc.algorithms.lateral_motion import Path, Rule, first_rest, leaves_moving, smoothed
from highd_lc.algorithms.track_index import ABSENT, TIE, unbroken
from highd_lc.vocab import names

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

OUTSIDE = 0


@dataclass(frozen=True)
class LaneChange:
    """One lane-id change. crossing: its first sample in the target lane; start, end: samples, -1 = not found;
    origin, target: lanes, 0 = outside; reason: why it is no complete lane change, empty if it is; peak_speed:
    largest lateral speed towards the target between start and end [m/s], NaN unless both are found.
    """

    crossing: int
    origin: int
    target: int
    reason: str = ""
    start: int = ABSENT
    end: int = ABSENT
    peak_speed: float = float("nan")


def find_lane_changes(path: Path, rule: Rule) -> list[LaneChange]:
    """Every lane-id change of a vehicle, in order, classified by the vehicle's own motion alone."""
    crossings = 1 + np.flatnonzero(path.lane[1:] != path.lane[:-1])
    if len(crossings) == 0:
        return []
    smooth = smoothed(path, rule)
    changes = [LaneChange(int(c), int(path.lane[c - 1]), int(path.lane[c])) for c in crossings]
    groups = _group_flicker(changes, path, rule)
    mains = [_main(group, path, smooth) for group in groups]
    bounds = [0, *(main.crossing for main in mains), len(path.y)]
    found = [
        _located(main, path, smooth, rule=rule, bounds=(bounds[place], bounds[place + 2]))
        for place, main in enumerate(mains)
    ]
    sought = [not (main.reason or _refusal(main, path)) for main in mains]
    judged = _without_rest_between(found, path, rule, sought=sought)
    return [
        judged[place] if change is mains[place] else replace(change, reason=_minor_reason(group))
        for place, group in enumerate(groups)
        for change in group
    ]


def _group_flicker(changes: Sequence[LaneChange], path: Path, rule: Rule) -> list[list[LaneChange]]:
    """Runs of changes between the same two lanes, each within ``flicker_s`` of the one before."""
    groups: list[list[LaneChange]] = []
    for change in changes:
        last = groups[-1][-1] if groups else None
        back = last is not None and not _refusal(change, path) and _is_reverse(last, change)
        if last and back and path.seconds(last.crossing, change.crossing) <= rule.flicker_s + TIE:
            groups[-1].append(change)
        else:
            groups.append([change])
    return groups


def _is_reverse(first: LaneChange, second: LaneChange) -> bool:
    return first.origin == second.target and first.target == second.origin


def _main(group: Sequence[LaneChange], path: Path, smooth: FloatArray) -> LaneChange:
    """The change that stands for its group: of those to the group's last lane the nearest to the smoothed
    crossing. A group that ends where it began has returned.
    """
    if len(group) % 2 == 0:
        return replace(group[0], reason=names.RETURNED)
    marking = path.marking(group[0].origin, group[0].target)
    return min(group[::2], key=lambda change: round(abs(float(smooth[0, change.crossing]) - marking), 6))


def _minor_reason(group: Sequence[LaneChange]) -> str:
    return names.FLICKER if len(group) % 2 else names.RETURNED


def _located(
    change: LaneChange, path: Path, smooth: FloatArray, *, rule: Rule, bounds: tuple[int, int]
) -> LaneChange:
    """The change with start and end, sought between the crossings before and after it (bounds)."""
    reason = change.reason or _refusal(change, path)
    if reason:
        return replace(change, reason=reason)
    first, last = unbroken(path.frame, change.crossing)
    begin, stop = max(first, bounds[0]), min(last, bounds[1] - 1)
    towards = smooth - np.array([[path.marking(change.origin, change.target)], [0.0], [0.0]])
    towards *= change.target - change.origin
    limits = np.array([rule.clearance_m, rule.speed, rule.acceleration]) - TIE
    needed, crossing = 1 + round(rule.persistence_s * path.rate), change.crossing
    start = first_rest(towards, crossing - 1, crossing - begin, -1, begin == first, needed, limits)
    end = first_rest(towards, crossing, stop - crossing + 1, 1, stop == last, needed, limits)
    start, end = (ABSENT if s != ABSENT and leaves_moving(path, rule, s) else s for s in (start, end))
    found = replace(change, start=start, end=end)
    if start == ABSENT and begin == first:
        return replace(found, reason=names.CUT_BEFORE_START if first == 0 else names.TRACK_HOLE)
    if end == ABSENT and stop == last:
        return replace(found, reason=names.CUT_AFTER_END if last == len(path.y) - 1 else names.TRACK_HOLE)
    return _sized(found, path, towards[1], rule)


def _sized(change: LaneChange, path: Path, speed: FloatArray, rule: Rule) -> LaneChange:
    """A change with its peak speed, refused if its lateral shift is small."""
    if ABSENT in (change.start, change.end):
        return change
    shift = (path.y[change.end] - path.y[change.start]) * (change.target - change.origin)
    reason = "" if shift >= rule.min_shift_m - TIE else names.SMALL_SHIFT
    return replace(change, reason=reason, peak_speed=float(speed[change.start : change.end + 1].max()))


def _refusal(change: LaneChange, path: Path) -> str:
    if OUTSIDE in (change.origin, change.target):
        return names.OUTSIDE_MARKINGS
    if abs(change.target - change.origin) != 1:
        return names.NOT_ADJACENT
    hole = path.frame[change.crossing] - path.frame[change.crossing - 1] != 1
    return names.TRACK_HOLE if hole else ""


def _without_rest_between(
    found: Sequence[LaneChange], path: Path, rule: Rule, *, sought: Sequence[bool]
) -> list[LaneChange]:
    """Changes of one manoeuvre named as such: both of each pair without enough rest between them.

    sought: whether start and end of a change were looked for.
    """
    judged = list(found)
    for place, (first, second) in enumerate(pairwise(found)):
        ends = [first.end] * sought[place] + [second.start] * sought[place + 1]
        if _is_one_manoeuvre(first, second, path, rule, ends=ends):
            reason = names.RETURNED if _is_reverse(first, second) else names.SECOND_CHANGE
            for index in (place, place + 1):
                judged[index] = replace(judged[index], reason=_earlier(judged[index].reason, reason))
    return judged


def _is_one_manoeuvre(
    first: LaneChange, second: LaneChange, path: Path, rule: Rule, *, ends: Sequence[int]
) -> bool:
    """Whether the lane is not kept between two changes. ends: those that were looked for between them."""
    if path.frame[second.crossing] - path.frame[first.crossing] != second.crossing - first.crossing:
        return False  # nobody saw what happened in between
    if ABSENT in ends:
        return True
    return len(ends) == 2 and path.seconds(ends[0], ends[1]) < rule.rest_s - TIE


def _earlier(first: str, second: str) -> str:
    """The reason that is tested first; empty is no reason."""
    return min((reason for reason in (first, second) if reason), key=names.REASONS.index)
