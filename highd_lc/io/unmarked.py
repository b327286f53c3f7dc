"""What recordings without markings do not say, worked out from their rows: markings, a straight road, motions.

Formats that name a lane in each row, and neither markings nor lateral speeds, share it (equations.md 16.13).
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.kernels import kernel
from highd_lc.extraction.track_index import TrackIndex, breaks
from highd_lc.io.highd import Recording
from highd_lc.io.highd_tables import RecordingMeta, Road, Samples, Tracks, VehicleMetas

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

RATE: Final = 10.0
"""Frames a second of these formats [Hz]."""
BIN_M: Final = 30.0
_BENT_M, _MANY = 0.5, 60
_LANE_M: Final = 3.7


Block = dict[str, NDArray[Any]]
"""Columns of some rows of a file, by their names."""


@dataclass(frozen=True)
class Rows:
    """Rows by vehicle and frame, in the format's units.

    index: of the vehicles; ids, duplicates: theirs, (vehicles,); notes: what was left out, in words.
    """

    columns: Block
    index: TrackIndex
    ids: IntArray
    duplicates: IntArray
    notes: tuple[str, ...]

    def only(self, kept: BoolArray) -> "Rows":
        """The rows of some vehicles, (vehicles,)."""
        chosen = np.repeat(kept, self.index.counts)
        columns = {name: values[chosen] for name, values in self.columns.items()}
        index = TrackIndex.of(np.repeat(self.ids, self.index.counts)[chosen], self.index.frame[chosen])
        return Rows(columns, index, self.ids[kept], self.duplicates[kept], self.notes)

    def first(self, name: str) -> NDArray[Any]:
        """A column's value in the first row of each vehicle, (vehicles,)."""
        return self.columns[name][self.index.starts[:-1]]


def rows_of(columns: Block, ids: IntArray, frame: IntArray) -> Rows:
    """Rows in order: identical ones dropped and counted, vehicles whose rows contradict each other left out.

    columns, ids, frame: of shape (rows,).
    """
    if not _is_ordered(ids, frame):
        order = np.lexsort((frame, ids))
        columns, ids, frame = {name: values[order] for name, values in columns.items()}, ids[order], frame[order]
    again = 1 + np.flatnonzero((np.diff(ids) == 0) & (np.diff(frame) == 0))
    lost = _contradicting(columns, ids, again)
    kept = ~np.isin(ids, lost)
    doubled = ids[again][~np.isin(ids[again], lost)]
    kept[again] = False
    if not kept.all():
        columns, ids, frame = {name: values[kept] for name, values in columns.items()}, ids[kept], frame[kept]
    index = TrackIndex.of(ids, frame)
    known = ids[index.starts[:-1]]
    duplicates = np.bincount(np.searchsorted(known, doubled), minlength=len(known)).astype(np.int64)
    text = f"{len(lost)} vehicles have rows that contradict each other and are left out"
    return Rows(columns, index, known, duplicates, (text,) if len(lost) else ())


def _is_ordered(ids: IntArray, frame: IntArray) -> bool:
    step = np.diff(ids)
    return bool(np.all((step > 0) | ((step == 0) & (np.diff(frame) > 0))))


def _contradicting(columns: Block, ids: IntArray, again: IntArray) -> IntArray:
    """Vehicles of which two rows of one frame differ. again: rows that repeat the frame of the row before."""
    different = np.zeros(len(again), dtype=np.bool_)
    for values in columns.values():
        different |= values[again] != values[again - 1]
    return np.unique(ids[again[different]])


def straightened(
    x: FloatArray, along: FloatArray, lanes: IntArray, *, index: TrackIndex
) -> tuple[FloatArray, FloatArray, list[str]]:
    """Distance from the left edge [m], (rows,), the markings in it, and what is told if the road had to be bent.

    x: distance from something on the left, along: place along the road [m]; lanes: counted from the left, 0 on
    none; each of shape (rows,). Where the lanes wander sideways along the section, their common offset from their
    own middle is taken off.
    """
    present = np.unique(lanes[lanes > 0])
    middle = np.full(int(present[-1]) + 1, np.nan)
    middle[present] = [np.median(x[lanes == lane]) for lane in present]
    vehicle = np.repeat(np.arange(len(index.counts)), index.counts)
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
    places = np.floor(along[on] / BIN_M)
    found = np.unique(places)
    many = [place for place in found if len(np.unique(vehicle[on][places == place])) >= _MANY]
    medians = [float(np.median(residual[on][places == place])) for place in many]
    return (np.array(many) + 0.5) * BIN_M, np.array(medians)


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


def unbroken_runs(index: TrackIndex, x: FloatArray, y: FloatArray) -> IntArray:
    """First rows of the runs without a hole or a jump, and the number of rows, (runs + 1,)."""
    return np.union1d(index.starts, breaks(index, x, y, rate=RATE))


@kernel()
def slope(parts: IntArray, values: FloatArray) -> FloatArray:
    """Change of values a second [unit/s], by central differences within each run, one-sided at its ends."""
    out = np.zeros(len(values))
    for part in range(len(parts) - 1):
        first, last = parts[part], parts[part + 1] - 1
        for row in range(first, last + 1):
            low, high = max(first, row - 1), min(last, row + 1)
            if high > low:
                out[row] = (values[high] - values[low]) * RATE / (high - low)
    return out


@kernel()
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


def recording_of(
    number: int,
    rows: Rows,
    tracks: Tracks,
    *,
    path: Path,
    edges: FloatArray,
    boxes: tuple[FloatArray, FloatArray, NDArray[np.str_]],
    notes: tuple[str, ...],
) -> Recording:
    """A recording of a single carriageway, direction 2, without location or samples for cross-checks.

    edges: markings from the left edge on [m]; boxes: length and width [m] and class of each vehicle; notes: what
    reading left out or changed, told with path and number.
    """
    length, width, vehicle_class = boxes
    index, unknown = rows.index, np.full(len(rows.ids), np.nan)
    metas = VehicleMetas(
        id=rows.ids,
        length=length,
        width=width,
        first_frame=index.frame[index.starts[:-1]],
        last_frame=index.frame[index.starts[1:] - 1],
        n_frames=index.counts,
        vehicle_class=vehicle_class,
        direction=np.full(len(rows.ids), 2),
        travelled=unknown,
        min_gap=unknown,
        min_time_gap=unknown,
        n_lane_changes=_lane_changes(index, tracks.lane),
    )
    half = np.repeat(length, index.counts) / 2.0
    extent = np.array([float((tracks.x - half).min()), float((tracks.x + half).max())])
    road = Road(tracks, np.stack([extent, extent]), _mismatches(index, tracks, edges))
    told = tuple(f"{path.name}: recording {number:02d}: {note}" for note in notes)
    meta = RecordingMeta(RATE, 0, upper=np.empty(0), lower=edges)
    nothing, whole = np.empty(0), np.empty(0, dtype=np.int64)
    return Recording(number, meta, metas, road, rows.duplicates, Samples(whole, whole, *(nothing,) * 3), told)


def _lane_changes(index: TrackIndex, lane: IntArray) -> IntArray:
    """Changes of lane of each vehicle: the file does not count them, so that nothing is held against it."""
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
