"""Shock waves behind real lane changes: observed, and of the followers that models simulate (equations.md 3.15).

A pair is a follower and whom it follows, in view for ``VIEW_S`` from t_start on: HV_1 behind the recorded lane
changer, HV_2 behind HV_1 and so on. Under a model both are as simulated; the lane changer stays as recorded. A
pair that comes to a contact under a model says nothing about waves; it is counted and left out there.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from highd_lc.core.edie import Trajectories, clip_to_grid, traffic_states
from highd_lc.core.shock_waves import passage
from highd_lc.drivers.prediction import contacts
from highd_lc.drivers.responses import TIME_STEP, Responses, Simulated
from highd_lc.scoring.population import LEAST_CLUSTERS, Bootstrap, mean_interval, ratio_interval
from highd_lc.vocab.tables import TABLES
from highd_lc.vocab.tables.prediction import FEW_RECORDINGS, OBSERVED, UNRELATED

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]
Row = dict[str, Any]

VIEW_S: Final = 7.0
"""A pair counts if it is in view for this long, so that all are searched for the same lags [s]."""
LONGEST_LAG_S: Final = 4.0
_SAMPLES: Final = round(VIEW_S / TIME_STEP) + 1
_X_EDGES: Final = np.arange(-150.0, 50.1, 10.0)
_T_EDGES: Final = np.arange(0.0, 8.01, 0.5)
_OF_UNRELATED: Final = ("n_pairs", "n_recordings", "contacts", "passed", "share_passed", "correlation", "reason")
_NOTHING: Final = (np.nan, np.nan, np.nan)


@dataclass(frozen=True)
class Pairs:
    """R followers and whom they follow: positions [m] and speeds [m/s] over ``VIEW_S``, each of shape (K, R).

    left_out: which of them come to a contact, shape (R,).
    """

    x: FloatArray
    v: FloatArray
    x_ahead: FloatArray
    v_ahead: FloatArray
    left_out: BoolArray

    def passages(self) -> FloatArray:
        """Lag [s], displacement [m], correlation of each pair's wave, shape (R, 3); NaN where none passes on."""
        found = [_NOTHING if out else self._passage(i) for i, out in enumerate(self.left_out)]
        return np.array(found, np.float64).reshape(-1, 3)

    def _passage(self, i: int) -> tuple[float, float, float]:
        x = np.stack([self.x_ahead[:, i], self.x[:, i]])
        v = np.stack([self.v_ahead[:, i], self.v[:, i]])
        found = passage(x, v - v.mean(axis=1, keepdims=True), dt=TIME_STEP, longest_lag=LONGEST_LAG_S)
        return _NOTHING if found is None else (found.lag, found.displacement, found.correlation)


def shock_waves(
    rows: pd.DataFrame, responses: Responses, simulated: Mapping[str, Simulated], bootstrap: Bootstrap
) -> pd.DataFrame:
    """The table ``shock_waves``: the wave from vehicle to vehicle, observed, of unrelated pairs, and simulated.

    Args:
        rows: of ``responses``, with density.
        responses: the arrays of these.
        simulated: the followers under each model.
        bootstrap: how intervals are made.
    """
    columns = list(TABLES["shock_waves"].column_names)
    looked = np.flatnonzero(responses.n >= _SAMPLES)
    if not len(looked):
        return pd.DataFrame(columns=columns, dtype=object)
    passages, left_out = {}, {}
    for source, one in _pairs(responses, simulated, looked):
        passages[source], left_out[source] = one.passages(), one.left_out
    units, strata = responses.recording[looked], _strata(rows.iloc[looked])
    made = []
    for source in passages:
        for stratum, inside in strata.items():
            of_both = passages[source][inside], passages[OBSERVED][inside]
            found = _wave(*of_both, units[inside], bootstrap) | {"contacts": int(left_out[source][inside].sum())}
            if source == UNRELATED:  # on different roads, so to say: nothing moves from one to the other
                found = {name: value for name, value in found.items() if name in _OF_UNRELATED}
            made.append({"source": source, "stratum": stratum, "n_both": 0} | found)
    return pd.DataFrame(made, columns=columns).sort_values(["source", "stratum"], ignore_index=True)


def _pairs(
    responses: Responses, simulated: Mapping[str, Simulated], looked: IntArray
) -> Iterator[tuple[str, Pairs]]:
    yield OBSERVED, _observed(responses, looked)
    yield UNRELATED, _unrelated(responses, looked)
    yield from ((name, _driven(responses, one, looked)) for name, one in simulated.items())


def _strata(rows: pd.DataFrame) -> dict[str, BoolArray]:
    states = traffic_states(rows["density"].to_numpy(np.float64))
    return {"all": np.ones(len(rows), bool)} | {f"traffic={s}": states == s for s in sorted(set(states)) if s}


def _observed(responses: Responses, looked: IntArray) -> Pairs:
    x, v, x_ahead, v_ahead = (
        each[:_SAMPLES, looked] for each in (responses.x, responses.v, responses.x_ahead, responses.v_ahead)
    )
    return Pairs(x, v, x_ahead, v_ahead, np.zeros(len(looked), bool))


def _unrelated(responses: Responses, looked: IntArray) -> Pairs:
    """Each follower behind whom another event's follower of the same rank followed: what chance makes of it."""
    others, ranks = looked.copy(), responses.rank[looked]
    for rank in np.unique(ranks):
        same = np.flatnonzero(ranks == rank)
        others[same] = looked[np.roll(same, 1)]
    x_ahead, v_ahead = (each[:_SAMPLES, others] for each in (responses.x_ahead, responses.v_ahead))
    x, v = (each[:_SAMPLES, looked] for each in (responses.x, responses.v))
    return Pairs(x, v, x_ahead, v_ahead, others == looked)


def _driven(responses: Responses, simulated: Simulated, looked: IntArray) -> Pairs:
    """The same pairs under a model: who has a simulated follower ahead follows that one."""
    ahead = _ahead(responses, simulated)
    met = contacts(simulated.x[:_SAMPLES], ahead[0], responses)
    x, v, x_ahead, v_ahead = (each[:_SAMPLES, looked] for each in (simulated.x, simulated.v, *ahead))
    return Pairs(x, v, x_ahead, v_ahead, met[looked])


def _ahead(responses: Responses, simulated: Simulated) -> tuple[FloatArray, FloatArray]:
    """Front and speed of whom each follower has as leader under a model, (K, R)."""
    keys = list(zip(responses.event.tolist(), responses.rank.tolist(), strict=True))
    places = {key: i for i, key in enumerate(keys)}
    ahead = np.array([places.get((event, rank - 1), -1) for event, rank in keys], np.int64)
    own = ahead >= 0
    return (
        np.where(own, simulated.x[:, ahead], responses.x_ahead),
        np.where(own, simulated.v[:, ahead], responses.v_ahead),
    )


def _wave(mine: FloatArray, observed: FloatArray, units: IntArray, bootstrap: Bootstrap) -> Row:
    """The wave of some pairs: lags and ways added up, its lag beside the observed one of the same pairs."""
    passed = np.isfinite(mine[:, 0])
    both = passed & np.isfinite(observed[:, 0])
    lag, moved, correlation = mine[passed].T
    later = mine[both, 0] - observed[both, 0]
    known = len(np.unique(units[passed])) >= LEAST_CLUSTERS
    row: Row = {
        "n_pairs": len(mine),
        "n_recordings": len(np.unique(units)),
        "passed": int(passed.sum()),
        "share_passed": _mean(passed),
        "lag_s": _mean(lag),
        "displacement_m": _mean(moved),
        "speed_mps": float(moved.sum() / lag.sum()) if len(lag) else np.nan,
        "correlation": _mean(correlation),
        "n_both": int(both.sum()),
        "lag_difference_s": _mean(later),
        "reason": "" if known else FEW_RECORDINGS,
    }
    if known:
        speed = ratio_interval(units[passed], moved, lag, bootstrap)
        row |= {"speed_low": speed.low, "speed_high": speed.high}
    if len(np.unique(units[both])) >= LEAST_CLUSTERS:
        ends = mean_interval(units[both], later, bootstrap)
        row |= {"lag_difference_low": ends.low, "lag_difference_high": ends.high}
    return row


def _mean(values: NDArray[Any]) -> float:
    return float(values.mean()) if len(values) else np.nan


def wave_field(responses: Responses, simulated: Mapping[str, Simulated]) -> pd.DataFrame:
    """The table ``wave_field``: Edie's measures behind all lane changes laid over each other.

    In a frame that moves with each ego's speed at t_start, from its centre then; observed, and under each model.
    Followers that come to a contact under one of the models are in none of the fields.
    """
    left_out = np.zeros(len(responses), bool)
    for one in simulated.values():
        left_out |= contacts(np.where(responses.seen, one.x, -np.inf), _ahead(responses, one)[0], responses)
    sources = {OBSERVED: responses.x} | {name: one.x for name, one in simulated.items()}
    rows = [row for name, x in sources.items() for row in _field(name, _moving(x, responses, ~left_out))]
    columns = list(TABLES["wave_field"].column_names)
    return pd.DataFrame(rows, columns=columns, dtype=None if rows else object)


def _field(source: str, tracks: Trajectories) -> Iterator[Row]:
    cells = clip_to_grid(tracks, x_edges=_X_EDGES, t_edges=_T_EDGES)
    speed = cells.speed
    for i, j in zip(*np.nonzero(cells.time > 0.0), strict=True):
        yield {
            "source": source,
            "x_from_m": _X_EDGES[i],
            "x_to_m": _X_EDGES[i + 1],
            "t_from_s": _T_EDGES[j],
            "t_to_s": _T_EDGES[j + 1],
            "time_s": cells.time[i, j],
            "speed_mps": speed[i, j],
        }


def _moving(x: FloatArray, responses: Responses, kept: BoolArray) -> Trajectories:
    """The kept followers as long as they are in view, in the frame of their lane changer's speed at t_start."""
    first = responses.rank == 1
    speed = dict(zip(responses.event[first].tolist(), responses.v_ahead[0, first].tolist(), strict=True))
    chosen = [i for i, event in enumerate(responses.event.tolist()) if kept[i] and event in speed]
    counts = responses.n[chosen]
    t = [np.arange(n) * TIME_STEP for n in counts.tolist()]
    moved = [x[: len(t_i), i] - speed[int(responses.event[i])] * t_i for t_i, i in zip(t, chosen, strict=True)]
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    return Trajectories(np.concatenate([*t, np.zeros(0)]), np.concatenate([*moved, np.zeros(0)]), starts)
