"""Followers' responses between tables and arrays: scenes to rows of ``responses``, these to arrays.

The population that is fitted to them as a TOML file: exported by a run, to be cited and used on other data.
"""

import tomllib
from collections.abc import Iterable, Iterator, Sequence
from itertools import accumulate
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from highd_lc.core.edie import edie
from highd_lc.core.losses import LossTerms
from highd_lc.drivers.identifiability import EVERYBODY, pool_idm
from highd_lc.drivers.population import CONSTANTS, NAMES, OPTIONAL, SPREAD, Population
from highd_lc.drivers.prediction import Scales, motion_loss
from highd_lc.drivers.responses import HORIZON, NO_LEADER, SAMPLES, SERIES, Responses
from highd_lc.io import artefacts, atomic
from highd_lc.planning.scene import Motion, Scene, pack
from highd_lc.stages.scenes import SceneTables, of_own_fits, scene_makers, track_of
from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS
from highd_lc.vocab.errors import SettingsError, told
from highd_lc.vocab.sections import LossSettings
from highd_lc.vocab.settings import ValidateSettings

FloatArray = NDArray[np.float64]
Row = dict[str, Any]

CHANGES_LANE: Final = 1.9
"""A follower that has moved this far sideways changes lane himself and is judged until then [m]."""
AROUND_S: Final = 5.0
"""Time before and after t_start over which the traffic around an event is measured [s]."""
FOLLOWED: Final = (70.0, 3.0)
"""A leader nearer than this [m] and no more than this faster or slower [m/s] is followed: his time gap counts."""
_BEFORE, _LONG_BEFORE = 0.5, 2.0
_OTHERS = ("target_leader_id", "origin_leader_id", "origin_follower_id")


def response_rows(
    tables: SceneTables, settings: ValidateSettings, traffic: "Traffic", *, location: int, failed: list[str]
) -> Iterator[Row]:
    """The rows of ``responses`` of a recording: every follower of every event while he and his leader are seen.

    failed: gets a line for each event that cannot be made a scene of.
    """
    own = of_own_fits(settings)
    recorded = own.model_copy(
        update={
            "planner": own.planner.model_copy(update={"leaders": "recorded"}),
            "loss": settings.loss.model_copy(update={"horizon_s": HORIZON}),
        }
    )
    events: dict[str, Any] = {row["event_id"]: row for row in tables.events.to_dict("records")}
    classes = dict(zip(tables.vehicles["vehicle_id"], tables.vehicles["class"], strict=True))
    for event_id, make in scene_makers(tables, recorded):
        try:
            found = list(_event_rows(make(), events[event_id], tables, recorded, traffic))
        except Exception as error:
            # One bad event never stops the others: it is told, and validate leaves it out.
            failed.append(told(event_id, error))
            continue
        for row in found:
            yield {**row, "class": classes[row["vehicle_id"]], "location_id": location}


def _event_rows(
    scene: Scene, event: Row, tables: SceneTables, settings: ValidateSettings, traffic: "Traffic"
) -> Iterator[Row]:
    vehicles = [int(event["ego_id"]), *map(int, event["follower_ids"])]
    involved = [*vehicles, *_known(event[role] for role in _OTHERS)]
    drift, seen = traffic.drift_without(vehicles[0], involved), samples_in_view(scene)
    density = traffic.density(vehicles[0], int(event["start_frame"]), rate=float(event["frame_rate"]))
    for rank in range(1, len(vehicles)):
        track = tables.tracks[scene.event_id, names.target_follower(rank)]
        yield {
            "event_id": scene.event_id,
            "recording_id": int(event["recording_id"]),
            "follower": rank,
            "vehicle_id": vehicles[rank],
            "time": float(event["start_frame"] - 1) / float(event["frame_rate"]),
            "a_0": _acceleration_before(track["t"], track["ax"], _BEFORE),
            "a_lasting": _acceleration_before(track["t"], track["ax"], _LONG_BEFORE),
            "drift": drift,
            "density": density,
            **_row(scene, rank, settings),
            "n": seen[rank - 1],
        }


def samples_in_view(scene: Scene) -> list[int]:
    """Samples over which each follower is judged behind the recorded ego: filmed, in their lanes, at most 8 s.

    Behind somebody who is out of view nobody is judged.
    """
    ego = len(scene.driver.x)
    return list(accumulate(map(_keeps_lane, scene.followers.recorded), min, initial=min(ego, SAMPLES)))[1:]


def loss_in_view(v: Sequence[FloatArray], scene: Scene, terms: LossTerms, loss: LossSettings) -> float:
    """Weighted loss of the followers' speeds v over ``samples_in_view``, comfort of the speeds smoothed over 1 s.

    The recorded followers, those of every policy and those behind the recorded ego are so charged alike. Who is in
    view for too short a time for a comfort is left out; NaN if all are.
    """
    total = np.nan
    for i, seen in enumerate(samples_in_view(scene)):
        scales = Scales(float(terms.hv_ref[i]), loss.comfort_scale, loss.efficiency_scale)
        one = float(motion_loss(v[i][:seen, None], scales)[0])
        if one == one:
            total = float(terms.weights[i]) * one + (total if total == total else 0.0)
    return total


def _row(scene: Scene, rank: int, settings: ValidateSettings) -> Row:
    """What a scene tells of a follower."""
    followers, own = scene.followers, scene.followers.recorded[rank - 1]
    front = own.x + own.length / 2.0
    if rank == 1:
        ahead_x, ahead_v = scene.driver.x + scene.length / 2.0, scene.driver.vx
        packed = pack(scene, settings)
        before_x, before_v = (
            np.where(np.isinf(packed.target_front), NO_LEADER, packed.target_front),
            packed.target_v,
        )
        lengths = (packed.target_length, scene.length)
        progress = np.maximum.accumulate(np.clip(scene.driver.y / scene.lateral_shift, 0.0, 1.0))
    else:
        leader = followers.recorded[rank - 2]
        ahead_x, ahead_v = leader.x + leader.length / 2.0, leader.v
        before_x, before_v, lengths = ahead_x, ahead_v, (leader.length, leader.length)
        progress = np.ones(SAMPLES)
    series = (front, own.v, before_x, before_v, ahead_x, ahead_v, progress)
    gap = before_x[0] - lengths[0] - front[0]
    close = before_x[0] - front[0] < FOLLOWED[0] and abs(before_v[0] - own.v[0]) < FOLLOWED[1] and own.v[0] > 1.0
    return {
        **{name: _filled(values).tolist() for name, values in zip(SERIES, series, strict=True)},
        "before_length": lengths[0],
        "ahead_length": lengths[1],
        "time_gap": float(gap / own.v[0]) if close else np.nan,
    }


def _known(ids: Iterable[Any]) -> list[int]:
    return [int(one) for one in ids if pd.notna(one)]


def _filled(values: FloatArray) -> FloatArray:
    """The first samples; the last value where there are fewer: nothing of that is judged."""
    return np.concatenate([values[:SAMPLES], np.full(max(SAMPLES - len(values), 0), values[-1])])


def _keeps_lane(motion: Motion) -> int:
    """Samples until a vehicle is out of view or changes lane itself."""
    away = np.abs(motion.y[: motion.observed] - motion.y[0]) > CHANGES_LANE
    return int(np.argmax(away)) if away.any() else motion.observed


def _acceleration_before(t: FloatArray, a: FloatArray, seconds: float) -> float:
    """Mean recorded acceleration of the last seconds before t_start, as far as in view, else at t_start."""
    before = (t < -1e-9) & (t > -seconds - 1e-9)
    return float(a[before].mean()) if before.any() else float(a[0])


class Traffic:
    """The traffic of each carriageway: its drift and its density.

    Drift: the median over its vehicles of their mean acceleration in view [m/s^2]. road: of each carriageway the
    kilometres of lane that are in view; a carriageway that it does not name has no density.
    """

    def __init__(self, vehicles: pd.DataFrame, road: dict[int, float]) -> None:
        groups = vehicles.set_index("vehicle_id").groupby("driving_direction")
        self._of = {int(str(direction)): part for direction, part in groups}
        self._direction = dict(zip(vehicles["vehicle_id"], vehicles["driving_direction"], strict=True))
        self._road = road
        frames = vehicles[["first_frame", "last_frame"]].to_numpy(np.int64)
        self._film = (int(frames.min()), int(frames.max())) if len(frames) else (0, 0)

    def drift_without(self, vehicle: int, event: list[int]) -> float:
        """The drift of the carriageway of a vehicle, from all that take no part in an event; 0 if none."""
        own = self._of[int(self._direction[vehicle])]["mean_acceleration"]
        others = own.dropna().drop(event, errors="ignore")
        return float(others.median()) if len(others) else 0.0

    def density(self, vehicle: int, frame: int, *, rate: float) -> float:
        """Edie's density of the carriageway of a vehicle around a frame [veh/km and lane]; NaN if not known.

        The region is the road in view over ``AROUND_S`` before and after the frame, as far as there is film.
        rate: frames a second.
        """
        direction, reach = int(self._direction[vehicle]), round(AROUND_S * rate)
        own, kilometres = self._of[direction], self._road.get(direction, 0.0)
        first, last = max(frame - reach, self._film[0]), min(frame + reach, self._film[1])
        seen = own["last_frame"].clip(upper=last) - own["first_frame"].clip(lower=first) + 1
        time, area = float(seen.clip(lower=0).sum()) / rate, 1000.0 * kilometres * (last - first + 1) / rate
        return edie(0.0, time, area)[2] if area > 0.0 else np.nan


def lane_kilometres(recordings: pd.DataFrame) -> dict[int, float]:
    """Of each carriageway the kilometres of lane in view. recordings: rows of that table of one recording."""
    lanes = recordings["markings"].map(len) - 1
    kilometres = lanes * (recordings["exit_m"] - recordings["entry_m"]) / 1000.0
    return dict(zip(recordings["driving_direction"].astype(int), kilometres.astype(float), strict=True))


def responses_of(rows: pd.DataFrame) -> Responses:
    """The arrays of rows of ``responses``."""
    series = {
        name: np.ascontiguousarray(np.stack(rows[name].tolist()).T) if len(rows) else np.empty((SAMPLES, 0))
        for name in SERIES
    }
    numbers = {
        name: rows[name].to_numpy(np.float64)
        for name in ("before_length", "ahead_length", "a_0", "a_lasting", "drift", "time_gap", "time")
    }
    return Responses(
        **series,
        **numbers,
        n=rows["n"].to_numpy(np.int64),
        truck=(rows["class"] == names.TRUCK).to_numpy(),
        rank=rows["follower"].to_numpy(np.int64),
        event=pd.factorize(rows["event_id"])[0].astype(np.int64),
        recording=rows["recording_id"].to_numpy(np.int64),
        location=rows["location_id"].to_numpy(np.int64),
    )


def idm_fits(rows: pd.DataFrame, leader_lengths: FloatArray, work: Path) -> FloatArray:
    """The IDM of each response's follower, shape (R, 5): a driver of the pool for who has none."""
    found = np.array([one if len(one) else [np.nan] * 5 for one in rows["idm"]], dtype=np.float64).reshape(-1, 5)
    known = np.isfinite(found[:, 0])
    if not known.any() or known.all():
        return found
    classes, keys = rows["class"].to_numpy(object), zip(rows["event_id"], rows["follower"], strict=True)
    tracks = {(row["event_id"], row["follower"]): row for row in _tracks(work)}
    fitted = [track_of(tracks[key]) for key, fits in zip(keys, known, strict=True) if fits]
    pools = pool_idm(fitted, leader_lengths[known], found[known], classes[known])
    for place in np.flatnonzero(~known):
        found[place] = pools.get(classes[place], pools[EVERYBODY])
    return found


def _tracks(work: Path) -> list[dict[str, Any]]:
    return [
        {str(k): v for k, v in row.items()} for row in artefacts.read(work, "follower_tracks").to_dict("records")
    ]


def save_population(path: Path, population: Population) -> None:
    """Write a population: its constants with unit and meaning, moment, number of responses, and source."""
    lines = [
        "# A population of followers: constants of its command, with memory and relaxation (equations.md 3).",
        f'source = "{population.source}"  # what its responses come from',
        f"n_responses = {population.n_responses}",
        f'family = "{population.family}"  # of the command; idm: tau time gap, L_0 gap at standstill',
        f"moment = {population.moment!r}  # share of the lateral way from which the lane changer is the leader",
        "[constants]",
    ]
    for constant, value in zip(CONSTANTS, population.constants.tolist(), strict=True):
        unit = f" [{constant.unit}]" if constant.unit else ""
        lines.append(f"{constant.name} = {value!r}  # {constant.meaning}{unit}")
    lines.append("[spread]  # standard deviation over drivers")
    lines += [f"{name} = {value!r}" for name, value in zip(PARAMETERS, population.spread.tolist(), strict=True)]
    atomic.write_text(path, "\n".join(lines) + "\n")


_LATER = {"lasting": 0.0} | {name: 1.0 if name.startswith("truck") else 0.0 for name in OPTIONAL}
"""Constants that earlier files do not hold, as they counted there."""


def load_population(path: Path) -> Population:
    """Read a population. Raises SettingsError naming the file and the key that is missing or out of range."""
    try:
        found = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise SettingsError(f"followers.population = {path}: {error}") from error
    constants = found.get("constants", {})
    for constant in CONSTANTS:
        value = constants.setdefault(constant.name, _LATER.get(constant.name))
        if not isinstance(value, int | float) or not constant.low <= value <= constant.high:
            allowed = f"a number from {constant.low:g} to {constant.high:g}"
            raise SettingsError(f"{path}: key constants.{constant.name} = {value!r}: {allowed} is needed")
    moment = found.get("moment", 0.5)
    values = np.array([float(constants[name]) for name in NAMES])
    spread = np.array(
        [_spread_of(path, found, name, prior) for name, prior in zip(PARAMETERS, SPREAD, strict=True)]
    )
    count, source = int(found.get("n_responses", 0)), str(found.get("source", path.name))
    family = found.get("family", names.LCM)
    if family not in (names.LCM, names.IDM):
        raise SettingsError(f"{path}: key family = {family!r}: {names.LCM} or {names.IDM} is needed")
    return Population(values, float(moment), count, source, spread, family)


def _spread_of(path: Path, found: dict[str, Any], name: str, prior: float) -> float:
    """The spread of a parameter, the prior's in earlier files. Raises SettingsError for what is no such number."""
    value = found.get("spread", {}).get(name, float(prior))
    if not isinstance(value, int | float) or not 0.0 <= value < np.inf:
        raise SettingsError(f"{path}: key spread.{name} = {value!r}: a number from 0 on is needed")
    return float(value)
