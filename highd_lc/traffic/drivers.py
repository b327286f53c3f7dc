"""Drawing the drivers of a carriageway: each vehicle takes one row of uniform numbers, whatever others do.

A longer recording of the same seed therefore begins like a shorter one. How a driver follows comes from a stream
of its own, so that the vehicles and their arrivals do not depend on the kind of drivers.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from highd_lc.traffic.lanes import (
    IDM,
    LCM,
    LCM_AT_ONCE,
    MAX_CHANGES,
    SINES,
    VEHICLE,
    BoolArray,
    Drivers,
    FloatArray,
    Records,
)
from highd_lc.vocab.sections import RecorderSettings

# Numbers that a vehicle takes: 15 of one kind each, and those of its lane changes and sines.
_COLUMNS = 15 + 3 * MAX_CHANGES + (MAX_CHANGES + 1) + 6 * SINES
_FOLLOWING_COLUMNS = 24 + 2 * SINES

# Spread around the published Table 3: (median, spread of its logarithm), the LCM's parameters but v_desire.
_CAR_LCM = {"A": (4.6, 0.15), "b": (6.8, 0.08), "tau": (0.90, 0.22), "L": (4.85, 0.03)}
_TRUCK_LCM = {"A": (3.2, 0.12), "b": (6.5, 0.08), "tau": (1.15, 0.20), "L": (5.0, 0.03)}
# A driver uses and expects similar decelerations: B = b - 0.4 +- 0.3 keeps s* from collapsing at speed.
_B_BELOW_b = (0.4, 0.3)
_CAR_V_DESIRE = (34.8, 2.2)
# Cars' desired speed on the right, middle and left lane beside the mean [m/s]: at once by the LCM, and else.
_LANE_SHIFTS_AT_ONCE, _LANE_SHIFTS = (-2.0, 0.0, 2.0), (-6.5, 0.0, 4.0)
_TRUCK_V_DESIRE = (25.5, 0.9)
_SHORTEST_TIME_HEADWAY = 1.0

# Bounds of the LCM that was fitted to the responses of followers in HighD: with memory.
_GENTLE_LCM = {"A": (0.7, 1.0), "b": (1.8, 2.2), "B": (1.3, 1.5), "tau": (3.1, 3.7), "L": (8.3, 8.9)}
_GENTLE_MEMORY = (6.0, 7.0)
# The IDM in the fields of the LCM, around typical values for motorways: (median car, truck, spread of the log).
_IDM = {"A": (0.6, 0.35, 0.25), "b": (1.5, 1.5, 0.20), "tau": (1.1, 1.5, 0.25), "L": (2.0, 2.5, 0.15)}
_KEEP_RIGHT_AT_ONCE = 0.1
_KEEP_RIGHT = (0.0, 0.3)  # bonus of the right lane, least and most [m/s^2]
_GAIN = (0.1, 0.35)  # what a change to the left must bring, least and most [m/s^2]
_GAIN_GENTLE = (0.0, 0.1)  # the same where all are gentle: their model hardly wishes for more
_PRESSES = (0.3, 0.9)  # braking that a change may demand of the follower, least and most [m/s^2]
_PACE = (0.1, 0.7)  # of the restless acceleration [rad/s]


@dataclass(frozen=True)
class Inflow:
    """Traffic that enters a carriageway: flow a lane [veh/h], the time from start to end in which vehicles arrive
    [s], and what they and their drivers are like."""

    flow: float
    start: float
    end: float
    settings: RecorderSettings


class _Uniforms:
    """Hands out the columns of a matrix of uniform numbers in (0, 1), each once."""

    def __init__(self, rng: np.random.Generator, rows: int, columns: int) -> None:
        # random() can give 0, whose normal quantile is -inf.
        self._numbers = np.maximum(rng.random((rows, columns)), 1e-12)
        self._next = 0

    def take(self, n: int = 1) -> FloatArray:
        """The next n columns, shape (rows, n); one column has shape (rows,)."""
        columns = self._numbers[:, self._next : self._next + n]
        if columns.shape[1] < n:
            raise IndexError(f"only {self._numbers.shape[1]} numbers are drawn for a vehicle")
        self._next += n
        return columns[:, 0] if n == 1 else columns

    def between(self, low: float, high: float) -> FloatArray:
        """The next column as uniform numbers between two."""
        numbers: FloatArray = low + (high - low) * self.take()
        return numbers

    def normal(self, n: int = 1) -> FloatArray:
        """The next n columns as standard normal numbers within +-2.5."""
        normal: FloatArray = np.clip(ndtri(self.take(n)), -2.5, 2.5)
        return normal


def draw_drivers(generators: Sequence[np.random.Generator], inflow: Inflow) -> Drivers:
    """The drivers of a carriageway, one generator a lane from the right."""
    lanes = [_draw_lane(rng, inflow, lane, lanes=len(generators)) for lane, rng in enumerate(generators)]
    drawn = {name: np.concatenate([lane[name] for lane in lanes]) for name in lanes[0]}
    vehicles = np.zeros(len(drawn["arrival"]), VEHICLE)
    for name in set(drawn) & set(VEHICLE.names or ()):
        vehicles[name] = drawn[name]
    first = np.cumsum([0] + [len(lane["arrival"]) for lane in lanes])
    return Drivers(vehicles, first.astype(np.int64), drawn["sway"], drawn["error"])


def _draw_lane(rng: np.random.Generator, inflow: Inflow, lane: int, *, lanes: int) -> dict[str, Records]:
    """What is drawn for the vehicles of a lane, by the names of ``VEHICLE`` and ``Drivers``."""
    flow = inflow.flow * _flow_weight(lane, lanes)
    seconds = inflow.end - inflow.start
    settings, rows = inflow.settings, int(1.3 * flow * seconds / 3600) + 20
    draws = _Uniforms(rng, rows, _COLUMNS)
    headway = _SHORTEST_TIME_HEADWAY - (3600 / flow - _SHORTEST_TIME_HEADWAY) * np.log(draws.take())
    truck = draws.take() < _lane_truck_share(settings.truck_share, lane, lanes)
    look_every = (0.6 + 0.8 * draws.take()) / max(settings.lane_change_rate, 1e-9)
    arrival = inflow.start + np.cumsum(headway)
    drawn = {
        "arrival": arrival,
        "truck": truck,
        "look_every": look_every,
        "look": arrival + look_every * draws.take(),
        "highest_lane": np.where(truck, 1, lanes - 1),
        **_sizes(draws, truck),
        **_lcm(draws, truck, shift=_lane_shift(lane / (lanes - 1), settings)),
        **_manners(draws, truck, settings.return_share),
        "sway": _sines(draws, 0.3, 1.2),
        "error": np.stack([_sines(draws, 1.0, 4.0), _sines(draws, 1.0, 4.0)], axis=1),
        "depth": 0.2 + 0.4 * draws.take(),
    }
    return drawn | _following(_Uniforms(rng.spawn(1)[0], rows, _FOLLOWING_COLUMNS), drawn, settings)


def _lane_shift(place: float, settings: RecorderSettings) -> float:
    """What the cars of a lane desire above the mean [m/s]; place: 0 = right, 1 = left."""
    shifts = _LANE_SHIFTS_AT_ONCE if settings.drivers == "lcm" else _LANE_SHIFTS
    return float(np.interp(place, (0.0, 0.5, 1.0), shifts))


def _flow_weight(lane: int, lanes: int) -> float:
    """The right lane carries the trucks and fewer vehicles; the weights' mean is 1."""
    return 0.85 if lane == 0 else 1 + 0.15 / (lanes - 1)


def _lane_truck_share(share: float, lane: int, lanes: int) -> float:
    """Most trucks enter on the right lane, the rest on the second; together they are the share of all."""
    trucks = share * lanes
    on_right = min(0.8 * trucks, 0.75 * _flow_weight(0, lanes))
    if lane == 0:
        return on_right / _flow_weight(0, lanes)
    return (trucks - on_right) / _flow_weight(1, lanes) if lane == 1 else 0.0


def _sizes(draws: _Uniforms, truck: BoolArray) -> dict[str, FloatArray]:
    length = np.where(truck, 14.0 + 2.2 * draws.normal(), 4.6 + 0.4 * draws.normal())
    width = np.where(truck, 2.5, 1.95 + 0.1 * draws.normal())
    return {"length": length.round(2), "width": width.round(2)}


def _lcm(draws: _Uniforms, truck: BoolArray, *, shift: float) -> dict[str, FloatArray]:
    """Individual parameters of the LCM; shift is added to the cars' desired speed [m/s]."""
    z = draws.normal()
    fast, slow = _CAR_V_DESIRE, _TRUCK_V_DESIRE
    drawn = {"v_desire": np.where(truck, slow[0] + slow[1] * z, fast[0] + shift + fast[1] * z)}
    for name, car in _CAR_LCM.items():
        z, heavy = draws.normal(), _TRUCK_LCM[name]
        drawn[name] = np.where(truck, heavy[0] * np.exp(heavy[1] * z), car[0] * np.exp(car[1] * z))
    drawn["B"] = drawn["b"] - _B_BELOW_b[0] + _B_BELOW_b[1] * draws.normal()
    return drawn


def _following(draws: _Uniforms, drawn: dict[str, Records], settings: RecorderSettings) -> dict[str, Records]:
    """How each follows: its model and manner, with other parameters where the model asks for others."""
    n = len(drawn["truck"])
    if settings.drivers == "lcm":
        neutral = {"model": LCM_AT_ONCE, "strength": 1.0, "room": -1.0, "keep_right": _KEEP_RIGHT_AT_ONCE}
        return {name: np.full(n, value) for name, value in neutral.items()}
    idm, gentle = _models(draws.take(), settings)
    found: dict[str, Records] = {"model": np.where(idm, IDM, LCM)}
    for name, bounds in _GENTLE_LCM.items():
        found[name] = np.where(gentle, draws.between(*bounds), drawn[name])
    for name, (car, truck, spread) in _IDM.items():
        own = np.where(drawn["truck"], truck, car) * np.exp(spread * draws.normal())
        found[name] = np.where(idm, own, found[name])
    return found | _manner(draws, gentle, settings) | _unrest(draws, settings)


def _models(kind: FloatArray, settings: RecorderSettings) -> tuple[BoolArray, BoolArray]:
    """Who follows by the IDM, and who by the gentle LCM of the population."""
    whole = {"idm": (1.0, 0.0), "population": (0.0, 1.0)}
    idm_share, gentle_share = whole.get(settings.drivers, (settings.idm_share, settings.gentle_share))
    idm = kind < idm_share
    return idm, ~idm & (kind < idm_share + gentle_share)


def _manner(draws: _Uniforms, gentle: BoolArray, settings: RecorderSettings) -> dict[str, Records]:
    """Memory, relaxation, moment and strength of the reaction, and what each demands of others."""
    memory = np.where(gentle, draws.between(*_GENTLE_MEMORY), settings.memory_s * np.exp(0.3 * draws.normal()))
    relaxation = settings.relaxation_s * np.exp(0.3 * draws.normal())
    kind, share = draws.take(), draws.take()
    late = kind >= settings.start_share + settings.crossing_share
    moment = np.where(kind < settings.start_share, 0.0, np.where(late, share, 1.0))
    strength = np.clip(settings.reaction_strength * np.exp(settings.reaction_spread * draws.normal()), 0.1, 1.5)
    ignores = np.where(draws.take() < settings.ignore_share, settings.ignore_s * 2 * draws.take(), 0.0)
    room = np.where(draws.take() < settings.room_share, settings.room_mps2 * 2 * draws.take(), -1.0)
    found = {"memory": memory, "relaxation": relaxation, "moment": moment, "strength": strength}
    found |= {"ignores": ignores, "room": room}
    if settings.drivers == "population":
        neutral = {"relaxation": 0.0, "moment": 1.0, "strength": 1.0, "ignores": 0.0, "room": -1.0}
        found |= {name: np.full(len(memory), value) for name, value in neutral.items()}
    gain = _GAIN_GENTLE if settings.drivers == "population" else _GAIN
    demands = {"presses": _PRESSES, "keep_right": _KEEP_RIGHT, "gain": gain}
    return found | {name: draws.between(*bounds) for name, bounds in demands.items()}


def _unrest(draws: _Uniforms, settings: RecorderSettings) -> dict[str, Records]:
    low, high = _PACE
    return {
        "unrest": settings.unrest_mps2 * np.exp(settings.unrest_spread * draws.normal()),
        "pace": low + (high - low) * draws.take(SINES),
        "phase": 2 * np.pi * draws.take(SINES),
    }


def _manners(draws: _Uniforms, truck: BoolArray, return_share: float) -> dict[str, FloatArray]:
    """How each changes lane. Durations are log-normal.

    Short changes are more often seen whole; those that are have about HighD's mean (5.70 s cars, 6.22 s trucks).
    """
    median = np.where(truck, 6.45, 5.95)[:, None]
    pause = draws.take(MAX_CHANGES)
    return {
        "gain": 0.05 + 0.25 * draws.take(),
        "duration": median * np.exp(0.23 * draws.normal(MAX_CHANGES)),
        # One change in ten is followed by the next as soon as it pays: double changes.
        "pause": np.where(pause < 0.1, 0.0, 3.0 + 6.0 * pause),
        "breaks_off": draws.take(MAX_CHANGES) < return_share,
        "offset": 0.15 * draws.normal(MAX_CHANGES + 1),
    }


def _sines(draws: _Uniforms, low: float, high: float) -> FloatArray:
    """Angular frequencies within [low, high] rad/s and phases, shape (N, K, 2)."""
    frequency = low + (high - low) * draws.take(SINES)
    return np.stack([frequency, 2 * np.pi * draws.take(SINES)], axis=2)
