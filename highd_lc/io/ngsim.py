"""NGSIM trajectories in road coordinates. Only the modules ngsim* know NGSIM's conventions.

In them Local_Y is the way of the front's centre along the road and Local_X its distance from the left edge, in
feet, at 10 Hz; lane 1 is the leftmost, the lanes after the main ones are auxiliary (US-101: 6) and ramps (7 on, 8
off); v_Class 1 is a motorcycle, 2 a car, 3 a truck or bus; Space_Headway is front to front; id 0 means none. Here:
x forward and y left from the right edge, box centres, metres, lane 1 = rightmost, 0 = on no main lane.

What NGSIM does not say is worked out (equations.md 16.13): markings, lateral speeds and accelerations, and forward
ones where the recorded are too noisy to use. Motorcycles count as cars, of which they have the manners and not the
size. Vehicles that are never on a main lane are left out.
"""

from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.io.highd import Recording
from highd_lc.io.highd_csv import fault
from highd_lc.io.highd_tables import Samples, Tracks, VehicleMetas
from highd_lc.io.ngsim_files import FIELDS, FRAME_MS, Block, Period, blocks, first_fault
from highd_lc.io.plain_numbers import EVERY
from highd_lc.io.unmarked import (
    RATE,
    Rows,
    recording_of,
    rows_of,
    slope,
    smooth,
    straightened,
    unbroken_runs,
)
from highd_lc.vocab import names

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

FOOT: Final = 0.3048
_MAIN_LANES: Final = {"i-80": 6}
_MAIN_LANES_ELSEWHERE: Final = 5
_MOTORCYCLE, _TRUCK = 1, 3
_LOCATIONS: Final = {"us-101": 101, "i-80": 80}
_NOISY_MPS2: Final = 3.0
"""Root mean square of the second difference of the position beyond which it is noise [m/s^2]."""
_WIDTHS_S: Final = (0.5, 1.0, 4.0)
"""Widths for positions, speeds and forward accelerations [s] (Thiemann, Treiber and Kesting 2008)."""


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
    along = FOOT * rows.columns["Local_Y"]
    x_left, edges, bent = straightened(FOOT * rows.columns["Local_X"], along, lanes, index=rows.index)
    length = FOOT * rows.first("v_Length")
    centre = along - np.repeat(length, rows.index.counts) / 2.0
    tracks, smoothed = _tracks(rows, centre, edges[-1] - x_left, lanes, smoothing)
    riders = int((rows.first("v_Class") == _MOTORCYCLE).sum())
    counted = [f"{riders} motorcycles count as cars"] * (riders > 0)
    notes = (*rows.notes, *dropped, *counted, *bent, *smoothed)
    classes = np.where(rows.first("v_Class") == _TRUCK, names.TRUCK, names.CAR)
    boxes = length, FOOT * rows.first("v_Width"), classes
    found = recording_of(number, rows, tracks, path=period.path, edges=edges, boxes=boxes, notes=notes)
    meta = replace(found.meta, location=_LOCATIONS.get(period.location, 0))
    return replace(found, meta=meta, samples=_samples(rows, found.vehicles))


# --- rows ---


def _rows(period: Period) -> Rows:
    """The rows of a period, ordered, each vehicle one of its own."""
    columns = _checked(period)
    ids, split = _own_ids(columns)
    rows = rows_of(columns, ids, columns["Frame_ID"].astype(np.int64))
    text = f"{split} ids stand for several vehicles and are split by Total_Frames"
    return replace(rows, notes=(text, *rows.notes)) if split else rows


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


# --- lanes ---


def _lanes(rows: Rows, period: Period) -> IntArray:
    """Main lanes counted from the left as the file has them, 0 on any other, (rows,)."""
    lanes = rows.columns["Lane_ID"].astype(np.int64)
    most = _MAIN_LANES.get(period.location, _MAIN_LANES_ELSEWHERE)
    return np.where((lanes >= 1) & (lanes <= most), lanes, 0)


def _on_main_lanes(rows: Rows, lanes: IntArray) -> tuple[Rows, IntArray, list[str]]:
    """The vehicles that are on a main lane some time, and what is told of the others."""
    if not len(rows.ids):
        return rows, lanes, []
    on = np.maximum.reduceat(lanes, rows.index.starts[:-1]) > 0
    if on.all():
        return rows, lanes, []
    found = rows.only(on)
    for name in ("Preceding", "Following"):
        found.columns[name] = np.where(np.isin(found.columns[name], found.ids), found.columns[name], 0.0)
    text = f"{int((~on).sum())} vehicles are on auxiliary lanes and ramps alone and are left out"
    return found, lanes[np.repeat(on, rows.index.counts)], [text]


# --- motion ---


def _tracks(rows: Rows, x: FloatArray, y: FloatArray, lanes: IntArray, smoothing: str) -> tuple[Tracks, list[str]]:
    """Tracks with lanes from the right; speeds and accelerations recorded, or worked out of smoothed positions."""
    parts = unbroken_runs(rows.index, x, y)
    vy = slope(parts, y)
    ay = slope(parts, vy)
    v_x = slope(parts, x)
    noise = float(np.sqrt(np.mean(slope(parts, v_x) ** 2)))
    vx, ax = FOOT * rows.columns["v_Vel"], FOOT * rows.columns["v_Acc"]
    notes = []
    if smoothing == "always" or (smoothing == "auto" and noise > _NOISY_MPS2):
        positions, speeds, accelerations = (width * RATE for width in _WIDTHS_S)
        ax = smooth(parts, slope(parts, v_x), accelerations)
        vx, vy, ay = (smooth(parts, values, speeds) for values in (v_x, vy, ay))
        x, y = smooth(parts, x, positions), smooth(parts, y, positions)
        notes = [f"positions have {noise:.1f} m/s^2 of noise: smoothed over {_WIDTHS_S} s (equations.md 16.13)"]
    most = int(lanes.max())
    neighbours = (rows.columns[name].astype(np.int64) for name in ("Preceding", "Following"))
    leader, follower = (np.where(np.isin(ids, rows.ids), ids, 0) for ids in neighbours)
    from_right = np.where(lanes > 0, most + 1 - lanes, 0)
    return Tracks(rows.index, x, y, vx, vy, ax, ay, from_right, leader, follower), notes


def _samples(rows: Rows, metas: VehicleMetas) -> Samples:
    """Gaps of some rows from Space_Headway: front to front less the leader's length [m]."""
    chosen = np.arange(0, len(rows.index.frame), EVERY)
    vehicle = np.searchsorted(rows.index.starts, chosen, side="right") - 1
    leader: Any = rows.columns["Preceding"][chosen].astype(np.int64)
    place = np.clip(np.searchsorted(metas.id, leader), 0, len(metas.id) - 1)
    known = metas.id[place] == leader
    gap = np.where(known, FOOT * rows.columns["Space_Headway"][chosen] - metas.length[place], np.nan)
    unknown = np.full(len(chosen), np.nan)
    return Samples(vehicle, chosen, unknown, unknown, gap)
