"""NGSIM trajectories in road coordinates. Only the modules ngsim* know NGSIM's conventions.

In them Local_Y is the way of the front's centre along the road and Local_X its distance from the left edge, in
feet, at 10 Hz; lane 1 is the leftmost, the lanes after the main ones are auxiliary (US-101: 6) and ramps (7 on, 8
off); v_Class 1 is a motorcycle, 2 a car, 3 a truck or bus; Space_Headway is front to front; id 0 means none. Here:
x forward and y left from the right edge, box centres, metres, lane 1 = rightmost, 0 = on no main lane.

What NGSIM does not say is worked out (equations.md 16.13): markings, lateral speeds and accelerations, and forward
ones where the recorded are too noisy to use. Motorcycles count as cars, of which they have the manners and not the
size. Vehicles that are never on a main lane are left out.
"""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from highd_lc.extraction.track_index import TrackIndex, breaks
from highd_lc.io.highd import Recording
from highd_lc.io.highd_csv import fault
from highd_lc.io.highd_tables import RecordingMeta, Road, Samples, Tracks, VehicleMetas
from highd_lc.io.ngsim_files import FIELDS, FRAME_MS, Block, Period, blocks, first_fault
from highd_lc.io.plain_numbers import EVERY
from highd_lc.vocab import names

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

FOOT: Final = 0.3048
RATE: Final = 10.0
_MAIN_LANES: Final = {"i-80": 6}
_MAIN_LANES_ELSEWHERE: Final = 5
_TRUCK: Final = 3
_LOCATIONS: Final = {"us-101": 101, "i-80": 80}
_NOISY_MPS2: Final = 3.0
"""Root mean square of the second difference of the position beyond which it is noise [m/s^2]."""
_WIDTHS_S: Final = (0.5, 1.0, 4.0)
"""Widths for positions, speeds and forward accelerations [s] (Thiemann, Treiber and Kesting 2008)."""
_BIN_M, _BENT_M, _MANY = 30.0, 0.5, 60
_LANE_M: Final = 3.7


@dataclass(frozen=True)
class _Rows:
    """Rows by vehicle and frame, in NGSIM's units. index: of the vehicles; ids: theirs, (vehicles,)."""

    columns: Block
    index: TrackIndex
    ids: IntArray
    duplicates: IntArray
    notes: tuple[str, ...]


def read_recording(period: Period, number: int, smoothing: str) -> Recording:
    """Read one period as a recording of a single carriageway, direction 2.

    Args:
        period: of ``ngsim_files.periods``.
        number: of the recording.
        smoothing: ``auto``, ``always`` or ``never``.

    Returns:
        The recording; its ``notes`` say what was left out, split or smoothed.

    Raises:
        InputError: a file, column, row or cell is not what it should be.
    """
    rows = _rows(period)
    lanes = _lanes(rows, period)
    rows, lanes, dropped = _on_main_lanes(rows, lanes)
    if not len(rows.ids):
        raise fault(period.path, f"recording {number}: nobody drives on a main lane", column="Lane_ID")
    x_left, edges, bent = _straight(rows, lanes)
    length = FOOT * _first(rows, "v_Length")
    centre = FOOT * rows.columns["Local_Y"] - np.repeat(length, rows.index.counts) / 2.0
    tracks, smoothed = _tracks(rows, centre, edges[-1] - x_left, lanes, smoothing)
    notes = (*rows.notes, *dropped, *bent, *smoothed)
    return _recording(period, number, rows, tracks, edges, notes)


# --- rows ---


def _rows(period: Period) -> _Rows:
    """The rows of a period, ordered, each vehicle one of its own."""
    columns = _checked(period)
    ids, split = _own_ids(columns)
    if not _is_ordered(ids, columns["Frame_ID"]):
        order = np.lexsort((columns["Frame_ID"], ids))
        columns, ids = {name: values[order] for name, values in columns.items()}, ids[order]
    again = 1 + np.flatnonzero((np.diff(ids) == 0) & (np.diff(columns["Frame_ID"]) == 0))
    lost = _contradicting(columns, ids, again)
    kept = ~np.isin(ids, lost)
    doubled = ids[again][~np.isin(ids[again], lost)]
    kept[again] = False
    if not kept.all():
        columns, ids = {name: values[kept] for name, values in columns.items()}, ids[kept]
    index = TrackIndex.of(ids, columns["Frame_ID"].astype(np.int64))
    known = ids[index.starts[:-1]]
    duplicates = np.bincount(np.searchsorted(known, doubled), minlength=len(known)).astype(np.int64)
    notes = [f"{split} ids stand for several vehicles and are split by Total_Frames"] * (split > 0)
    notes += [f"{len(lost)} vehicles have rows that contradict each other and are left out"] * (len(lost) > 0)
    return _Rows(columns, index, known, duplicates, tuple(notes))


def _is_ordered(ids: IntArray, frame: FloatArray) -> bool:
    step = np.diff(ids)
    return bool(np.all((step > 0) | ((step == 0) & (np.diff(frame) > 0))))


def _checked(period: Period) -> Block:
    """The columns of the period's rows. Raises InputError if a value is out of its range."""
    wanted = [field.name for field in FIELDS]
    parts: list[Block] = []
    for block, location in blocks(period.path, period.layout, wanted):
        begun = block["Global_Time"] - FRAME_MS * block["Frame_ID"]
        own = (begun >= period.first) & (begun <= period.last)
        # A number that is none belongs to no period: it is a fault of the file, not of one recording.
        own |= ~np.isfinite(begun)
        if location is not None:
            own &= location == period.location
        parts.append(block if own.all() else {name: values[own] for name, values in block.items()})
    columns = {name: _joined([part[name] for part in parts]) for name in wanted} if parts else {}
    if not parts or not len(columns["Frame_ID"]):
        raise fault(period.path, "no rows")
    for field in FIELDS:
        values = columns[field.name]
        sound = np.isfinite(values) & (values >= field.low) & (values <= field.high)
        if not sound.all() or (field.kind is int and (values != np.floor(values)).any()):
            first_fault(period.path, period.layout, wanted, f"column {field.name!r} holds values out of range")
    return columns


def _joined(parts: list[NDArray[Any]]) -> NDArray[Any]:
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def _own_ids(columns: Block) -> tuple[IntArray, int]:
    """An id for each vehicle, (rows,), and how many ids were split: one id with two totals of frames is two."""
    ids, totals = columns["Vehicle_ID"].astype(np.int64), columns["Total_Frames"].astype(np.int64)
    # Rows stand in runs of one vehicle: only one row of each has to be looked at.
    runs = np.flatnonzero((np.diff(ids, prepend=-1) != 0) | (np.diff(totals, prepend=-1) != 0))
    heads = np.stack([ids[runs], totals[runs]])
    pairs, of_runs = np.unique(heads, axis=1, return_inverse=True)
    inverse = np.repeat(of_runs.ravel(), np.diff(np.append(runs, len(ids))))
    again = np.flatnonzero(np.diff(pairs[0], prepend=-1) == 0)
    own = pairs[0].copy()
    own[again] = pairs[0].max() + 1 + np.arange(len(again))
    for name in ("Preceding", "Following"):
        columns[name] = _renamed(columns, name, pairs[0], own, inverse)
    return own[inverse], len(np.unique(pairs[0][again]))


def _renamed(columns: Block, name: str, ids: IntArray, own: IntArray, inverse: IntArray) -> FloatArray:
    """Neighbour ids, those that stand for several vehicles as of the one that is in view in the row's frame."""
    found: FloatArray = columns[name].copy()
    frame, owner = columns["Frame_ID"], inverse
    for one in np.unique(ids[own != ids]):
        rows = np.flatnonzero(columns[name] == one)
        for vehicle in np.flatnonzero(ids == one):
            seen = frame[owner == vehicle]
            inside = (frame[rows] >= seen.min()) & (frame[rows] <= seen.max())
            found[rows[inside]] = own[vehicle]
    return found


def _contradicting(columns: Block, ids: IntArray, again: IntArray) -> IntArray:
    """Vehicles of which two rows of one frame differ. again: rows that repeat the frame of the row before."""
    different = np.zeros(len(again), dtype=np.bool_)
    for values in columns.values():
        different |= values[again] != values[again - 1]
    return np.unique(ids[again[different]])


def _first(rows: _Rows, name: str) -> FloatArray:
    """A column's value in the first row of each vehicle, (vehicles,)."""
    values: FloatArray = rows.columns[name][rows.index.starts[:-1]]
    return values


# --- lanes ---


def _lanes(rows: _Rows, period: Period) -> IntArray:
    """Main lanes counted from the left as the file has them, 0 on any other, (rows,)."""
    lanes = rows.columns["Lane_ID"].astype(np.int64)
    most = _MAIN_LANES.get(period.location, _MAIN_LANES_ELSEWHERE)
    return np.where((lanes >= 1) & (lanes <= most), lanes, 0)


def _on_main_lanes(rows: _Rows, lanes: IntArray) -> tuple[_Rows, IntArray, list[str]]:
    """The vehicles that are on a main lane some time, and what is told of the others."""
    if not len(rows.ids):
        return rows, lanes, []
    on = np.maximum.reduceat(lanes, rows.index.starts[:-1]) > 0
    if on.all():
        return rows, lanes, []
    kept = np.repeat(on, rows.index.counts)
    columns = {name: values[kept] for name, values in rows.columns.items()}
    for name in ("Preceding", "Following"):
        columns[name] = np.where(np.isin(columns[name], rows.ids[on]), columns[name], 0.0)
    index = TrackIndex.of(np.repeat(rows.ids, rows.index.counts)[kept], rows.index.frame[kept])
    text = f"{int((~on).sum())} vehicles are on auxiliary lanes and ramps alone and are left out"
    return _Rows(columns, index, rows.ids[on], rows.duplicates[on], rows.notes), lanes[kept], [text]


def _straight(rows: _Rows, lanes: IntArray) -> tuple[FloatArray, FloatArray, list[str]]:
    """Distance from the left edge [m], (rows,), the markings in it, and what is told if the road had to be bent.

    Where the lanes wander sideways along the section, their common offset from their own middle is taken off.
    """
    x, along = FOOT * rows.columns["Local_X"], FOOT * rows.columns["Local_Y"]
    present = np.unique(lanes[lanes > 0])
    middle = np.full(int(present[-1]) + 1, np.nan)
    middle[present] = [np.median(x[lanes == lane]) for lane in present]
    vehicle = np.repeat(np.arange(len(rows.ids)), rows.index.counts)
    offset = _offsets(x - middle[lanes], along, lanes > 0, vehicle=vehicle)
    bent = float(np.ptp(offset[1])) if len(offset[1]) else 0.0
    notes = []
    if bent > _BENT_M:
        x = x - np.interp(along, *offset)
        notes = [f"the lanes wander {bent:.1f} m sideways along the section: straightened"]
        middle[present] = [np.median(x[lanes == lane]) for lane in present]
    edges = _markings(x, lanes, middle)
    return x - edges[0], edges - edges[0], notes


def _offsets(
    residual: FloatArray, along: FloatArray, on: BoolArray, *, vehicle: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Places along the road [m] and the median offset there of all who are on a main lane [m].

    Only where many pass: the offset of a few is how they drive, not how the road lies.
    """
    places = np.floor(along[on] / _BIN_M)
    found = np.unique(places)
    many = [place for place in found if len(np.unique(vehicle[on][places == place])) >= _MANY]
    medians = [float(np.median(residual[on][places == place])) for place in many]
    return (np.array(many) + 0.5) * _BIN_M, np.array(medians)


def _markings(x: FloatArray, lanes: IntArray, middle: FloatArray) -> FloatArray:
    """Markings from the left edge on [m], (main lanes + 1,): where lane ids change, and half a lane outside."""
    known = np.flatnonzero(np.isfinite(middle))
    all_lanes = np.arange(1, known[-1] + 1)
    centre = np.interp(all_lanes, known, middle[known])
    if known[0] > 1:
        centre[: known[0] - 1] = middle[known[0]] - _LANE_M * np.arange(known[0] - 1, 0, -1)
    inner = [_boundary(x[lanes == lane], x[lanes == lane + 1]) for lane in all_lanes[:-1]]
    between = [b if np.isfinite(b) else (centre[k] + centre[k + 1]) / 2.0 for k, b in enumerate(inner)]
    first, last = (between[0], between[-1]) if between else (centre[0] + _LANE_M / 2.0, centre[0] - _LANE_M / 2.0)
    return np.array([2.0 * centre[0] - first, *between, 2.0 * centre[-1] - last])


def _boundary(left: FloatArray, right: FloatArray) -> float:
    """The distance that separates the rows of two lanes with fewest on the wrong side; NaN without both."""
    if not len(left) or not len(right):
        return float("nan")
    values = np.concatenate([left, right])
    order = np.argsort(values, kind="stable")
    # Wrong if the marking is right after a row: right ones up to it, left ones behind it.
    side = np.where(order < len(left), -1, 1)
    wrong = len(left) + np.cumsum(side)
    best = np.flatnonzero(wrong == wrong.min())
    place = int(best[len(best) // 2])
    ordered = values[order]
    return float((ordered[place] + ordered[min(place + 1, len(ordered) - 1)]) / 2.0)


# --- motion ---


def _tracks(
    rows: _Rows, x: FloatArray, y: FloatArray, lanes: IntArray, smoothing: str
) -> tuple[Tracks, list[str]]:
    """Tracks with lanes from the right; speeds and accelerations recorded, or worked out of smoothed positions."""
    parts = _unbroken(rows.index, x, y)
    vy = _slope(parts, y)
    ay = _slope(parts, vy)
    v_x = _slope(parts, x)
    noise = float(np.sqrt(np.mean(_slope(parts, v_x) ** 2)))
    vx, ax = FOOT * rows.columns["v_Vel"], FOOT * rows.columns["v_Acc"]
    notes = []
    if smoothing == "always" or (smoothing == "auto" and noise > _NOISY_MPS2):
        positions, speeds, accelerations = (width * RATE for width in _WIDTHS_S)
        ax = smooth(parts, _slope(parts, v_x), accelerations)
        vx, vy, ay = (smooth(parts, values, speeds) for values in (v_x, vy, ay))
        x, y = smooth(parts, x, positions), smooth(parts, y, positions)
        notes = [f"positions have {noise:.1f} m/s^2 of noise: smoothed over {_WIDTHS_S} s (equations.md 16.13)"]
    most = int(lanes.max())
    neighbours = (rows.columns[name].astype(np.int64) for name in ("Preceding", "Following"))
    leader, follower = (np.where(np.isin(ids, rows.ids), ids, 0) for ids in neighbours)
    from_right = np.where(lanes > 0, most + 1 - lanes, 0)
    return Tracks(rows.index, x, y, vx, vy, ax, ay, from_right, leader, follower), notes


def _unbroken(index: TrackIndex, x: FloatArray, y: FloatArray) -> IntArray:
    """First rows of the runs without a hole or a jump, and the number of rows, (runs + 1,)."""
    return np.union1d(index.starts, breaks(index, x, y, rate=RATE))


@njit(cache=True, nogil=True)
def _slope(parts: IntArray, values: FloatArray) -> FloatArray:
    """Change of values a second [unit/s], by central differences within each run, one-sided at its ends."""
    out = np.zeros(len(values))
    for part in range(len(parts) - 1):
        first, last = parts[part], parts[part + 1] - 1
        for row in range(first, last + 1):
            low, high = max(first, row - 1), min(last, row + 1)
            if high > low:
                out[row] = (values[high] - values[low]) * RATE / (high - low)
    return out


@njit(cache=True, nogil=True)
def smooth(parts: IntArray, values: FloatArray, width: float) -> FloatArray:
    """Exponentially weighted local lines of each run (equations.md 16.13).

    parts: first rows of the runs and the number of rows, (runs + 1,); values: (rows,); width: of the exponential
    [rows]. The window reaches three widths to either side, or to the run's end. Away from the ends it is the
    symmetric exponential moving average; a straight line stays what it is everywhere.
    """
    out = np.empty(len(values))
    reach = round(3.0 * width)
    weights = np.exp(-np.arange(reach + 1) / width)
    for part in range(len(parts) - 1):
        first, last = parts[part], parts[part + 1] - 1
        for row in range(first, last + 1):
            w, wk, wkk, wz, wkz = 0.0, 0.0, 0.0, 0.0, 0.0
            for k in range(max(first - row, -reach), min(last - row, reach) + 1):
                weight, z = weights[abs(k)], values[row + k]
                w, wk, wkk = w + weight, wk + weight * k, wkk + weight * k * k
                wz, wkz = wz + weight * z, wkz + weight * k * z
            spread = w * wkk - wk * wk
            out[row] = (wkk * wz - wk * wkz) / spread if spread > 0.0 else wz / w
    return out


# --- the recording ---


def _recording(
    period: Period, number: int, rows: _Rows, tracks: Tracks, edges: FloatArray, notes: tuple[str, ...]
) -> Recording:
    index, n = rows.index, len(rows.ids)
    length, width = FOOT * _first(rows, "v_Length"), FOOT * _first(rows, "v_Width")
    unknown = np.full(n, np.nan)
    metas = VehicleMetas(
        id=rows.ids,
        length=length,
        width=width,
        first_frame=index.frame[index.starts[:-1]],
        last_frame=index.frame[index.starts[1:] - 1],
        n_frames=index.counts,
        vehicle_class=np.where(_first(rows, "v_Class") == _TRUCK, names.TRUCK, names.CAR),
        direction=np.full(n, 2),
        travelled=unknown,
        min_gap=unknown,
        min_time_gap=unknown,
        n_lane_changes=_lane_changes(index, tracks.lane),
    )
    half = np.repeat(length, index.counts) / 2.0
    extent = np.array([float((tracks.x - half).min()), float((tracks.x + half).max())])
    meta = RecordingMeta(RATE, _LOCATIONS.get(period.location, 0), upper=np.empty(0), lower=edges)
    road = Road(tracks, np.stack([extent, extent]), _mismatches(index, tracks, edges))
    told = tuple(f"{period.path.name}: recording {number:02d}: {note}" for note in notes)
    return Recording(number, meta, metas, road, rows.duplicates, _samples(rows, metas), told)


def _lane_changes(index: TrackIndex, lane: IntArray) -> IntArray:
    """Changes of lane of each vehicle: NGSIM does not count them, so that nothing is held against it."""
    changed = np.diff(lane, prepend=lane[:1]) != 0
    changed[index.starts[:-1]] = False
    counts: IntArray = np.add.reduceat(changed, index.starts[:-1]).astype(np.int64)
    return counts


def _mismatches(index: TrackIndex, tracks: Tracks, edges: FloatArray) -> IntArray:
    """Rows of each vehicle on a main lane whose box centre is between other markings."""
    markings = (edges[-1] - edges)[::-1]
    by_position = np.clip(np.searchsorted(markings, tracks.y), 1, len(markings) - 1)
    wrong = (tracks.lane > 0) & (by_position != tracks.lane)
    counts: IntArray = np.add.reduceat(wrong, index.starts[:-1]).astype(np.int64)
    return counts


def _samples(rows: _Rows, metas: VehicleMetas) -> Samples:
    """Gaps of some rows from Space_Headway: front to front less the leader's length [m]."""
    chosen = np.arange(0, len(rows.index.frame), EVERY)
    vehicle = np.searchsorted(rows.index.starts, chosen, side="right") - 1
    leader: Any = rows.columns["Preceding"][chosen].astype(np.int64)
    place = np.clip(np.searchsorted(metas.id, leader), 0, len(metas.id) - 1)
    known = metas.id[place] == leader
    gap = np.where(known, FOOT * rows.columns["Space_Headway"][chosen] - metas.length[place], np.nan)
    unknown = np.full(len(chosen), np.nan)
    return Samples(vehicle, chosen, unknown, unknown, gap)
