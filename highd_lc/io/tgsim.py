"""TGSIM trajectories in road coordinates. Only the modules tgsim* know TGSIM's conventions.

In them xloc_kf and yloc_kf are a vehicle's middle in metres on a reference image, x to the right and y down, at
10 Hz, and the road lies in it as it happens to; lane_kf numbers the lanes; speeds and accelerations are along the
way. Here: x forward and y left from the right edge, box centres, lane 1 = rightmost, 0 = on no lane.

What TGSIM does not say is worked out (equations.md 16.14): the way of the road, markings, neighbours, lateral
speeds and accelerations. A road that bends is refused: its coordinates would need the centre lines.
"""

from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.io.highd import Recording
from highd_lc.io.highd_csv import fault
from highd_lc.io.highd_tables import Tracks
from highd_lc.io.tgsim_files import FIELDS, RUN, TYPE, Run, blocks, first_fault
from highd_lc.io.unmarked import (
    BIN_M,
    RATE,
    Block,
    Rows,
    recording_of,
    rows_of,
    slope,
    straightened,
    unbroken_runs,
)
from highd_lc.vocab import names

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_OFF_S: Final = 0.02
_BEND_DEG: Final = 8.0
"""How much the way of the road may change along the section."""
_WHOLE: Final = 0.6
"""Share of the section that a lane has to reach along; a shorter one is a ramp or an auxiliary lane."""
_FEW: Final = 5
"""Vehicles that pass a place, from which on it counts."""
_CLASSES: Final = {
    "1": names.CAR, "2": names.TRUCK, "3": names.TRUCK, "4": names.CAR, "small-vehicle": names.CAR,
    "large-vehicle": names.TRUCK, "automated-vehicle": names.CAR, "motorcycle": names.CAR,
}  # fmt: skip
"""Types as the files write them; a vehicle that drives by itself is a car."""


def read_recording(run: Run, number: int) -> Recording:
    """Read one run as a recording of a single carriageway, direction 2.

    Args:
        run: of ``tgsim_files.runs``.
        number: of the recording.

    Returns:
        The recording; its ``notes`` say what was left out or straightened.

    Raises:
        InputError: a file, column, row or cell is not what it should be, or the road bends.
    """
    rows, shifted = _rows(run)
    rows, along, left, turned = _along_the_road(rows, run, number)
    numbers = rows.columns["lane_kf"]
    lanes, partial = _lanes(numbers, along, -left)
    if not lanes.any():
        raise fault(run.path, f"recording {number}: nobody drives on a lane along the section", column="lane_kf")
    x_left, edges, bent = straightened(-left, along, lanes, index=rows.index)
    tracks = _tracks(rows, along, edges[-1] - x_left, lanes)
    notes = (*shifted, *rows.notes, *turned, *partial, *_order_told(numbers, lanes), *bent)
    boxes = _median(rows, "length_smoothed"), _median(rows, "width_smoothed"), rows.first("class")
    return recording_of(number, rows, tracks, path=run.path, edges=edges, boxes=boxes, notes=notes)


# --- rows ---


def _rows(run: Run) -> tuple[Rows, list[str]]:
    """The rows of a run, ordered, and what is told of its ids."""
    columns = _checked(run)
    ids, frame = columns["id"].astype(np.int64), _frames(run, columns["time"])
    columns["class"] = _classes(run, columns.pop(TYPE))
    shifted = ["ids are by one higher than in the file, which has an id 0"] if not ids.all() else []
    return rows_of(columns, ids + len(shifted), frame), shifted


def _checked(run: Run) -> Block:
    """The columns of the run's rows. Raises InputError if a value is out of its range."""
    numbers = [field.name for field in FIELDS] + ([RUN] if run.number is not None else [])
    parts = []
    for block in blocks(run.path, run.layout, numbers, (TYPE,)):
        own = block.pop(RUN) == run.number if run.number is not None else np.ones(len(block["id"]), dtype=np.bool_)
        parts.append({name: values[own] for name, values in block.items()})
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]} if parts else {}
    if not parts or not len(columns["id"]):
        raise fault(run.path, "no rows")
    for field in FIELDS:
        values = columns[field.name]
        empty = np.isnan(values) & (field.name == "lane_kf")
        sound = empty | (np.isfinite(values) & (values >= field.low) & (values <= field.high))
        whole = field.kind is not int or not (values[~empty] != np.floor(values[~empty])).any()
        if not sound.all() or not whole:
            text = f"column {field.name!r} holds values out of range"
            first_fault(run.path, run.layout, [one.name for one in FIELDS], text)
    columns["lane_kf"] = np.nan_to_num(columns["lane_kf"])
    return columns


def _frames(run: Run, time: FloatArray) -> IntArray:
    """Frames from 1 on. Raises InputError if times are no multiples of a tenth of a second."""
    frame = np.rint(time * RATE)
    off = np.abs(time - frame / RATE)
    if off.max() > _OFF_S:
        text = f"{float(time[int(off.argmax())]):g} s is no multiple of {1.0 / RATE:g} s: rows are 10 a second"
        raise fault(run.path, text, column="time")
    return np.asarray(frame - frame.min() + 1, dtype=np.int64)


def _classes(run: Run, words: NDArray[Any]) -> NDArray[np.str_]:
    """Car or Truck of each row. Raises InputError for a type that is not known."""
    known, place = np.unique(words, return_inverse=True)
    plain = [str(word).strip().lower().replace("_", "-").replace(" ", "-").removesuffix(".0") for word in known]
    strange = [word for word, text in zip(known, plain, strict=True) if text not in _CLASSES]
    if strange:
        raise fault(run.path, f"{str(strange[0])[:40]!r} is none of {', '.join(_CLASSES)}", column=TYPE)
    return np.array([_CLASSES[text] for text in plain])[place]


# --- the road ---


def _along_the_road(rows: Rows, run: Run, number: int) -> tuple[Rows, FloatArray, FloatArray, list[str]]:
    """The rows of who drives along the road, places along it and to the left of it [m], and what is told.

    The road's way is that of the vehicles' displacements together; who drives against it is left out.
    """
    way = _way(rows)
    x, y = rows.columns["xloc_kf"], rows.columns["yloc_kf"]
    first, last = rows.index.starts[:-1], rows.index.starts[1:] - 1
    against = (x[last] - x[first]) * way[0] + (y[last] - y[first]) * way[1] < 0.0
    told = []
    if against.any():
        rows = rows.only(~against)
        told = [f"{int(against.sum())} vehicles drive against the others and are left out"]
        way = _way(rows)
        x, y = rows.columns["xloc_kf"], rows.columns["yloc_kf"]
    along = x * way[0] + y * way[1]
    left = x * way[1] - y * way[0]  # y grows down
    _refuse_bend(run, number, rows, along=along, left=left)
    return rows, along - along.min(), left, told


def _way(rows: Rows) -> FloatArray:
    """The way of the road on the image, (2,): as most vehicles move that keep their lane; of length 1."""
    first, last = rows.index.starts[:-1], rows.index.starts[1:] - 1
    lane = rows.columns["lane_kf"]
    keeps = np.minimum.reduceat(lane, first) == np.maximum.reduceat(lane, first)
    if keeps.any():
        first, last = first[keeps], last[keeps]
    moved = np.stack([rows.columns[name][last] - rows.columns[name][first] for name in ("xloc_kf", "yloc_kf")])
    main = np.linalg.svd(moved @ moved.T)[0][:, 0]
    main = main * (1.0 if (main @ moved > 0.0).mean() >= 0.5 else -1.0)
    way = moved[:, main @ moved > 0.0].sum(axis=1)
    length = float(np.hypot(*way))
    return np.asarray(way / length if length > 0.0 else main)


def _refuse_bend(run: Run, number: int, rows: Rows, *, along: FloatArray, left: FloatArray) -> None:
    """Raise InputError if the way of the road changes too much along the section."""
    parts = unbroken_runs(rows.index, along, left)
    forward, sideways = slope(parts, along), slope(parts, left)
    moving = forward > 2.0
    place = np.floor((along[moving] - along.min()) / BIN_M).astype(np.int64)
    vehicle = np.repeat(np.arange(len(rows.ids)), rows.index.counts)[moving]
    angle = np.degrees(np.arctan2(sideways[moving], forward[moving]))
    found = [float(np.median(angle[place == one])) for one in _passed(place, vehicle)]
    bend = max(found) - min(found) if found else 0.0
    if bend > _BEND_DEG:
        raise fault(
            run.path,
            f"recording {number}: the road turns by {bend:.0f} degrees along the section, at most {_BEND_DEG:g} "
            "can be read: places along a bend need the centre lines, which are not read",
            column="xloc_kf",
        )


def _passed(place: IntArray, vehicle: IntArray) -> IntArray:
    """Bins of the road that several vehicles pass."""
    pairs = np.unique(np.stack([place, vehicle]), axis=1)
    bins, counts = np.unique(pairs[0], return_counts=True)
    few = min(_FEW, int(counts.max(initial=0)))
    return np.asarray(bins[counts >= few])


# --- lanes ---


def _lanes(numbers: FloatArray, along: FloatArray, x: FloatArray) -> tuple[IntArray, list[str]]:
    """Lanes counted from the left by where they are, 0 on none, and what is told of those that are no whole ones.

    x: from the left [m].
    """
    lanes, told, middle = np.zeros(len(numbers), dtype=np.int64), [], {}
    for lane in np.unique(numbers[numbers != 0.0]).tolist():
        own = numbers == lane
        share = _reach(along[own]) / max(_reach(along), 1e-9)
        if share >= _WHOLE:
            middle[lane] = float(np.median(x[own]))
        else:
            told.append(
                f"lane_kf {lane:g} reaches along {100.0 * share:.0f} % of the section alone: taken for a ramp or "
                "an auxiliary lane, on which nobody changes lane"
            )
    for rank, lane in enumerate(sorted(middle, key=middle.__getitem__), start=1):
        lanes[numbers == lane] = rank
    return lanes, told


def _reach(along: FloatArray) -> float:
    """How far places reach along the road [m], but for the outermost hundredth on either side."""
    low, high = np.quantile(along, [0.01, 0.99])
    return float(high - low)


def _order_told(numbers: FloatArray, lanes: IntArray) -> list[str]:
    """What is told where lane numbers do not ascend from left to right: left and right may be exchanged."""
    pairs = np.unique(np.stack([lanes[lanes > 0], np.abs(numbers[lanes > 0])]), axis=1)
    if len(pairs[0]) < 2 or (np.diff(pairs[1]) > 0).all():
        return []
    return ["lane_kf does not ascend from left to right: if y grows up in this file, left and right are exchanged"]


# --- motion ---


def _tracks(rows: Rows, x: FloatArray, y: FloatArray, lanes: IntArray) -> Tracks:
    """Tracks with lanes from the right, speeds and accelerations as recorded, neighbours by the positions."""
    parts = unbroken_runs(rows.index, x, y)
    vy = slope(parts, y)
    from_right = np.where(lanes > 0, int(lanes.max()) + 1 - lanes, 0)
    leader, follower = _neighbours(rows, x, from_right)
    columns = rows.columns
    return Tracks(
        rows.index, x, y, columns["speed_kf"], vy, columns["acceleration_kf"], slope(parts, vy), from_right,
        leader, follower,
    )  # fmt: skip


def _neighbours(rows: Rows, x: FloatArray, lane: IntArray) -> tuple[IntArray, IntArray]:
    """Ids of the next vehicle ahead and behind on the lane in every frame, 0 = nobody."""
    leader, follower = np.zeros(len(x), dtype=np.int64), np.zeros(len(x), dtype=np.int64)
    frame = rows.index.frame
    ids = np.repeat(rows.ids, rows.index.counts)
    order = np.lexsort((x, lane, frame))
    order = order[lane[order] > 0]
    same = (np.diff(frame[order]) == 0) & (np.diff(lane[order]) == 0)
    leader[order[:-1][same]] = ids[order[1:][same]]
    follower[order[1:][same]] = ids[order[:-1][same]]
    return leader, follower


def _median(rows: Rows, name: str) -> FloatArray:
    """The median of a column of each vehicle, (vehicles,)."""
    values, starts = rows.columns[name], rows.index.starts
    return np.array([float(np.median(values[a:b])) for a, b in pairwise(starts.tolist())])
