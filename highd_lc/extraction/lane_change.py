"""Lane changes of a recording: start and end, vehicles around them, reasons, rows of each (equations.md 11).

Start and end by the authors' rule: outward from the crossing, the nearest moments at which lateral speed and
acceleration are both near zero, read together with the lateral position (``lateral_motion`` says when they are).
Two changes without a rest in their lane between them are one manoeuvre and no single lane change.

``find_crossings`` gives every lane-id change of a recording with the one reason why it is not usable, if there is
one. ``role_rows`` gives the recorded rows of each role, and of the followers' calibration windows.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.kernels import kernel
from highd_lc.extraction.lateral_motion import Path, Rule, first_rest, leaves_moving, smoothed
from highd_lc.extraction.roles import NOBODY, Maneuver, Roles, Successor, find_roles, successors
from highd_lc.extraction.track_index import ABSENT, TIE, Traffic, find_row, unbroken
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
        judged[place] if change is mains[place] else replace(change, reason=_minor_reason(change, group, path))
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
    """The change that represents its group: of those to the group's last lane the nearest to the smoothed
    crossing. A group that ends in the lane where it began has the reason ``returned``.
    """
    if len(group) % 2 == 0:
        return replace(group[0], reason=names.RETURNED)
    marking = path.marking(group[0].origin, group[0].target)
    return min(group[::2], key=lambda change: round(abs(float(smooth[0, change.crossing]) - marking), 6))


def _minor_reason(change: LaneChange, group: Sequence[LaneChange], path: Path) -> str:
    """Of a change that does not stand for its group: the first reason of ``names.REASONS`` that applies."""
    return names.FLICKER if len(group) % 2 else _refusal(change, path) or names.RETURNED


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


@dataclass(frozen=True)
class Crossing:
    """A lane-id change. ego: vehicle index; crossing_frame, start_frame, end_frame: -1 = not found; reason:
    why it is not usable, empty if it is; roles: of a complete lane change; successors: of its target leader.
    """

    ego: int
    change: LaneChange
    crossing_frame: int
    start_frame: int
    end_frame: int
    reason: str
    roles: Roles | None
    successors: tuple[Successor, ...] = ()

    @property
    def known_roles(self) -> Roles:
        """The roles of a usable lane change: it always has them."""
        assert self.roles is not None
        return self.roles


def with_known_lanes(traffic: Traffic, longest_s: float) -> Traffic:
    """The traffic with the lane of a vehicle filled in where its lane is 0 though it is between the markings.

    Rows are filled in if they last no longer than ``longest_s`` [s] between rows with lanes; the
    lateral position decides between the two lanes around them. Any other 0 stays.
    """
    off = np.flatnonzero(traffic.lane == 0)
    runs = np.split(off, 1 + np.flatnonzero(np.diff(off) > 1)) if len(off) else []
    lane = traffic.lane.copy()
    for rows in runs:
        lane[rows] = _lanes_of(traffic, rows, longest_s)
    return replace(traffic, lane=lane)


def _lanes_of(traffic: Traffic, rows: IntArray, longest_s: float) -> IntArray:
    """Lanes of consecutive rows without one, 0 where they are not known."""
    before, after = int(rows[0]) - 1, int(rows[-1]) + 1
    vehicle = int(np.searchsorted(traffic.index.starts, rows[0], side="right")) - 1
    span, frame = traffic.index.span(vehicle), traffic.index.frame
    if before < span.start or after >= span.stop or frame[after] - frame[before] != len(rows) + 1:
        return np.zeros(len(rows), dtype=np.int64)
    by_position = np.searchsorted(traffic.markings[int(traffic.direction[vehicle])], traffic.y[rows])
    sides = traffic.lane[before], traffic.lane[after]
    known = len(rows) <= longest_s * traffic.rate + TIE and bool(np.isin(by_position, sides).all())
    return by_position if known else np.zeros(len(rows), dtype=np.int64)


def find_crossings(traffic: Traffic, rule: Rule, *, max_link_m: float, max_followers: int) -> list[Crossing]:
    """Every lane-id change of a recording, by vehicle and frame, each usable or with one reason."""
    changed = 1 + np.flatnonzero(np.diff(traffic.lane))
    vehicle = np.searchsorted(traffic.index.starts, changed, side="right") - 1
    egos = np.unique(vehicle[traffic.index.starts[vehicle] != changed])
    found = []
    for ego in egos:
        for change in find_lane_changes(_path(traffic, int(ego)), rule):
            crossing = _crossing(traffic, int(ego), change)
            if not change.reason:
                crossing = _with_roles(traffic, crossing, max_link_m=max_link_m, max_followers=max_followers)
            if not crossing.reason:
                crossing = _with_successors(traffic, crossing, rule.flicker_s)
            found.append(crossing)
    return found


def _with_successors(traffic: Traffic, crossing: Crossing, flicker_s: float) -> Crossing:
    if crossing.roles is None:
        return crossing
    found = successors(
        traffic,
        crossing.roles.target_leader,
        ego=crossing.ego,
        lane=crossing.change.target,
        frame=crossing.start_frame,
        flicker_s=flicker_s,
    )
    return replace(crossing, successors=found)


def _path(traffic: Traffic, vehicle: int) -> Path:
    span = traffic.index.span(vehicle)
    markings = traffic.markings[int(traffic.direction[vehicle])]
    vy = traffic.vy[span].astype(np.float64)
    return Path(traffic.index.frame[span], traffic.lane[span], traffic.y[span], markings, traffic.rate, vy)


def _crossing(traffic: Traffic, ego: int, change: LaneChange) -> Crossing:
    frames = traffic.index.frame[traffic.index.span(ego)]
    start, end = (ABSENT if sample == ABSENT else int(frames[sample]) for sample in (change.start, change.end))
    return Crossing(ego, change, int(frames[change.crossing]), start, end, change.reason, None)


def _with_roles(traffic: Traffic, crossing: Crossing, *, max_link_m: float, max_followers: int) -> Crossing:
    change = crossing.change
    maneuver = Maneuver(crossing.ego, crossing.start_frame, crossing.crossing_frame, change.origin, change.target)
    roles = find_roles(traffic, maneuver, max_link_m=max_link_m, max_followers=max_followers)
    reason = ""
    if not roles.followers:
        reason = names.NO_TARGET_FOLLOWER
    elif roles.follower_ahead:
        reason = names.FOLLOWER_AHEAD
    return replace(crossing, reason=reason, roles=roles)


# Recorded motion of the ego before its start, so that smoothing it has no edge at the start.
_CONTEXT_S = 1.0


@dataclass(frozen=True)
class RoleRows:
    """A role of an event: its vehicle (index), its rows, and those of them that calibrate it."""

    role: str
    vehicle: int
    rows: slice
    calibration: slice


def role_rows(traffic: Traffic, event: Crossing, roles: Roles, *, horizon_s: float) -> list[RoleRows]:
    """Rows of every role of a usable lane change, until ``horizon_s`` after its end or the end of the track.

    Followers and their leaders come from the first row of the calibration window that needs them, the ego from
    the earliest of these and at least a second before its start, the others from the start. The rows of a role are
    consecutive frames: they end where its track is broken.
    """
    windows = _windows(traffic, event, roles)
    begin = event.start_frame
    firsts = [_first_frame(traffic, window, begin) for window in windows] + [begin]
    early = min(*firsts, begin - round(_CONTEXT_S * traffic.rate))
    last = event.end_frame + int(horizon_s * traffic.rate)
    nothing = slice(0, 0)
    parts = [
        (names.EGO, event.ego, early, begin, nothing),
        (names.ORIGIN_LEADER, roles.origin_leader, begin, begin, nothing),
        (names.ORIGIN_FOLLOWER, roles.origin_follower, begin, begin, nothing),
        (names.TARGET_LEADER, roles.target_leader, firsts[0], begin, nothing),
    ]
    for place, later in enumerate(event.successors):
        if later.frame <= last:
            parts.append((names.target_leader(place + 2), later.vehicle, begin, later.frame, nothing))
    for place, follower in enumerate(roles.followers):
        first = min(firsts[place], firsts[place + 1])
        parts.append((names.target_follower(place + 1), follower, first, begin, windows[place]))
    return [
        RoleRows(role, vehicle, _between(traffic, vehicle, (first, last), around), window)
        for role, vehicle, first, around, window in parts
        if vehicle != NOBODY
    ]


def _windows(traffic: Traffic, event: Crossing, roles: Roles) -> list[slice]:
    chain = (roles.target_leader, *roles.followers)
    return [
        calibration_rows(traffic, follower, leader, lane=event.change.target, before_frame=event.start_frame)
        for leader, follower in pairwise(chain)
    ]


def _first_frame(traffic: Traffic, window: slice, otherwise: int) -> int:
    return int(traffic.index.frame[window.start]) if window.stop > window.start else otherwise


def _between(traffic: Traffic, vehicle: int, frames: tuple[int, int], around: int) -> slice:
    """Rows of a vehicle from the first to the last of two frames without a break around a frame."""
    run = traffic.index.run(vehicle, around)
    places = np.searchsorted(traffic.index.frame[run], [frames[0], frames[1] + 1])
    return slice(run.start + int(places[0]), run.start + int(places[1]))


def calibration_rows(traffic: Traffic, follower: int, leader: int, *, lane: int, before_frame: int) -> slice:
    """Rows of the follower's calibration window: the longest run of consecutive frames before t_start in which
    it is on ``lane`` behind ``leader``, both inside the usable part of the section and seen without a break from
    then until ``before_frame``. Empty without a leader.
    """
    if leader == NOBODY:
        return slice(0, 0)
    direction = traffic.direction[follower]
    runs = [traffic.index.frame[traffic.index.run(who, before_frame)] for who in (follower, leader)]
    unbroken_from = max((int(run[0]) for run in runs if len(run)), default=0)
    span = traffic.index.span(follower)
    follows = (traffic.lane[span] == lane) & (traffic.leader_id[span] == traffic.ids[leader])
    follows &= traffic.index.frame[span] >= unbroken_from
    first, stop = _longest_run(
        traffic.index.starts,
        traffic.index.frame,
        traffic.x,
        follows,
        (follower, leader),
        before_frame,
        (traffic.entry[direction] - TIE, traffic.stop[direction] + TIE),
    )
    return slice(int(first), int(stop))


@kernel()
def _longest_run(
    starts: IntArray,
    frame: IntArray,
    x: FloatArray,
    follows: NDArray[np.bool_],
    pair: tuple[int, int],
    before_frame: int,
    section: tuple[float, float],
) -> tuple[int, int]:
    """First row and end of the longest run; follows: whether each of the follower's rows may belong to it."""
    follower, leader = pair
    best_first = best_stop = run_first = starts[follower]
    for row in range(starts[follower], starts[follower + 1]):
        if frame[row] >= before_frame:
            break
        ahead = find_row(starts, frame, leader, frame[row]) if follows[row - starts[follower]] else -1
        good = ahead >= 0 and x[row] >= section[0] and x[ahead] <= section[1]
        if not good:
            run_first = row + 1
            continue
        if row > run_first and frame[row] != frame[row - 1] + 1:
            run_first = row
        if row + 1 - run_first >= best_stop - best_first:
            best_first, best_stop = run_first, row + 1
    return best_first, best_stop
