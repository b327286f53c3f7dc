"""One vehicle an unbroken track: ids that have holes or jumps are split, so that nothing is filled in across them.

A tracker that loses a vehicle, mixes up two, or gives an id again later leaves rows that belong to several
vehicles or to one that nobody saw in between. From each break on the rows are a vehicle of their own, with an id
above all ids of the recording; neighbour ids follow.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from highd_lc.algorithms.track_index import TrackIndex
from highd_lc.algorithms.track_parts import breaks
from highd_lc.io.highd import Recording
from highd_lc.io.highd_metas import VehicleMetas
from highd_lc.io.highd_road import Tracks

IntArray = NDArray[np.int64]

_LISTED = 5


@dataclass(frozen=True)
class Break:
    """A place at which an id was split. frame: the first of the later part; missing: frames before it that are
    missing, 0 = it jumps; part_id: the later part's id.
    """

    vehicle_id: int
    direction: int
    frame: int
    missing: int
    part_id: int

    def in_words(self) -> str:
        """What happened to the vehicle, for a reader."""
        what = f"misses {self.missing} frame{'s' * (self.missing > 1)} before" if self.missing else "jumps at"
        return f"vehicle {self.vehicle_id} {what} frame {self.frame} (vehicle {self.part_id} from there on)"


@dataclass(frozen=True)
class Parts:
    """A recording of unbroken tracks. recorded_id: id in the file of each vehicle, shape (vehicles,)."""

    recording: Recording
    recorded_id: IntArray
    breaks: tuple[Break, ...]

    def jumps(self, direction: int) -> int:
        """How many of the breaks of a carriageway are jumps."""
        return sum(one.direction == direction and not one.missing for one in self.breaks)

    def in_words(self) -> str:
        """All breaks in a sentence, the first few one by one; empty without any."""
        if not self.breaks:
            return ""
        listed = "; ".join(one.in_words() for one in self.breaks[:_LISTED])
        more = f"; and {len(self.breaks) - _LISTED} more" if len(self.breaks) > _LISTED else ""
        why = "tracks are split where frames are missing or a position jumps"
        return f"recording {self.recording.number:02d}: {why}: {listed}{more}"


def split_tracks(recording: Recording) -> Parts:
    """Split the ids of a recording at every hole and jump; the same recording where there is none.

    What is known of a vehicle by its file alone (metas, dropped rows, rows in another lane) stays with the first
    of its parts.
    """
    tracks, metas = recording.road.tracks, recording.vehicles
    places = breaks(tracks.index, tracks.x, tracks.y, rate=recording.meta.frame_rate)
    if not len(places):
        return Parts(recording, metas.id, ())
    owner = np.searchsorted(tracks.index.starts, places, side="right") - 1
    new_ids = metas.id[-1] + 1 + np.arange(len(places))
    found = tuple(_break(recording, *place) for place in zip(places, owner, new_ids, strict=True))
    vehicles = _with_parts(metas, owner, new_ids)
    nothing = np.zeros(len(places), dtype=np.int64)
    road = replace(
        recording.road,
        tracks=_moved(tracks, metas, places, new_ids),
        lane_mismatches=np.concatenate([recording.road.lane_mismatches, nothing]),
    )
    duplicates = np.concatenate([recording.duplicates, nothing])
    whole = replace(recording, vehicles=vehicles, road=road, duplicates=duplicates)
    return Parts(whole, np.concatenate([metas.id, metas.id[owner]]), found)


def _break(recording: Recording, place: int, owner: int, new_id: int) -> Break:
    frame, metas = recording.road.tracks.index.frame, recording.vehicles
    missing = int(frame[place] - frame[place - 1] - 1)
    return Break(int(metas.id[owner]), int(metas.direction[owner]), int(frame[place]), missing, int(new_id))


def _with_parts(metas: VehicleMetas, owner: IntArray, new_ids: IntArray) -> VehicleMetas:
    """The metas with a line for every later part, that of its owner under the new id."""
    columns = {name: getattr(metas, name) for name in VehicleMetas.__dataclass_fields__}
    longer = {name: np.concatenate([values, values[owner]]) for name, values in columns.items()}
    return VehicleMetas(**{**longer, "id": np.concatenate([metas.id, new_ids])})


def _moved(tracks: Tracks, metas: VehicleMetas, places: IntArray, new_ids: IntArray) -> Tracks:
    """The tracks with the later parts after all others, in the order of their ids; neighbours with new ids."""
    index, rows = tracks.index, len(tracks.index.frame)
    part = np.searchsorted(places, np.arange(rows), side="right") - 1
    vehicle = np.repeat(np.arange(len(metas.id)), index.counts)
    is_later = (part >= 0) & (places[np.maximum(part, 0)] >= index.starts[vehicle])
    ids = np.where(is_later, new_ids[np.maximum(part, 0)], metas.id[vehicle])
    order = np.argsort(is_later, kind="stable")
    leader, follower = (
        _renamed(values, index, metas, places, new_ids) for values in (tracks.leader_id, tracks.follower_id)
    )
    columns = {name: getattr(tracks, name)[order] for name in ("x", "y", "vx", "vy", "ax", "ay", "lane")}
    return Tracks(
        TrackIndex.of(ids[order], index.frame[order]),
        **columns,
        leader_id=leader[order],
        follower_id=follower[order],
    )


def _renamed(
    neighbour: IntArray, index: TrackIndex, metas: VehicleMetas, places: IntArray, new_ids: IntArray
) -> IntArray:
    """Neighbour ids of each row, those of split vehicles as of the part that is there in the row's frame."""
    owner = np.searchsorted(index.starts, places, side="right") - 1
    renamed = neighbour.copy()
    for vehicle in np.unique(owner):
        rows = np.flatnonzero(neighbour == metas.id[vehicle])
        own = owner == vehicle
        names = np.concatenate([metas.id[vehicle : vehicle + 1], new_ids[own]])
        renamed[rows] = names[np.searchsorted(index.frame[places[own]], index.frame[rows], side="right")]
    return renamed
