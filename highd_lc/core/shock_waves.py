"""Speed of a shock wave from the cross-correlation of successive vehicles' speeds, with a bootstrap interval.

A disturbance passes from a vehicle to its follower with a lag. In that time it moves from where the leader was to
where the follower is then: displacement over lag is its speed along the road. Over a platoon both add up
(equations.md 13.9).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.kernels import kernel
from highd_lc.vocab.errors import ShapeError

FloatArray = NDArray[np.float64]

ESTIMATED: Final = "estimated"
NO_DISTURBANCE: Final = "no disturbance that passes on"

_LEAST_CORRELATION: Final = 0.5
_LEAST_DEVIATION: Final = 0.05
_SHORTEST: Final = 3.0


@dataclass(frozen=True)
class WaveSpeed:
    """Speed of a shock wave along the road [m/s], negative = upstream, with its interval.

    pairs: of vehicles behind it; correlation: their mean at the best lag; status: ``ESTIMATED``, or why there is
    nothing but NaN.
    """

    speed: float
    low: float
    high: float
    pairs: int
    correlation: float
    status: str


@dataclass(frozen=True)
class Passage:
    """How a disturbance passes from a vehicle to its follower: lag [s], displacement [m], correlation."""

    lag: float
    displacement: float
    correlation: float


def wave_speed(
    x: FloatArray,
    deviation: FloatArray,
    *,
    dt: float,
    rng: np.random.Generator,
    longest_lag: float = 6.0,
    confidence: float = 0.95,
) -> WaveSpeed:
    """Speed of the wave that runs through successive vehicles.

    x: positions [m], deviation: speeds [m/s] minus what they would be undisturbed, each of shape (p, n), the
    foremost vehicle first, NaN before and after it is seen; dt [s]; longest_lag [s] from vehicle to vehicle. The
    interval is a bootstrap over the pairs. Raises ShapeError when the shapes differ.
    """
    if x.shape != deviation.shape or x.ndim != 2:
        raise ShapeError(f"positions have shape {x.shape}, speeds {deviation.shape}")
    found = [
        passage(x[i : i + 2], deviation[i : i + 2], dt=dt, longest_lag=longest_lag) for i in range(len(x) - 1)
    ]
    return combine([one for one in found if one is not None], rng=rng, confidence=confidence)


def combine(passages: Sequence[Passage], *, rng: np.random.Generator, confidence: float = 0.95) -> WaveSpeed:
    """The wave's speed from the passages of several pairs: sum of displacements over sum of lags."""
    if len(passages) < 2:
        return WaveSpeed(np.nan, np.nan, np.nan, len(passages), np.nan, NO_DISTURBANCE)
    lag = np.array([p.lag for p in passages])
    displacement = np.array([p.displacement for p in passages])
    drawn = rng.integers(0, len(lag), (2000, len(lag)))
    speeds = displacement[drawn].sum(axis=1) / lag[drawn].sum(axis=1)
    low, high = np.quantile(speeds, [0.5 - confidence / 2.0, 0.5 + confidence / 2.0])
    correlation = float(np.mean([p.correlation for p in passages]))
    speed = float(displacement.sum() / lag.sum())
    return WaveSpeed(speed, float(low), float(high), len(passages), correlation, ESTIMATED)


def passage(x: FloatArray, deviation: FloatArray, *, dt: float, longest_lag: float) -> Passage | None:
    """How the disturbance passes from the first of two vehicles to the second; shapes (2, n).

    None if the first is not disturbed, or no lag between 0 and the longest one correlates by 0.5 at least.
    """
    seen = np.isfinite(x).all(axis=0) & np.isfinite(deviation).all(axis=0)
    x, deviation = x[:, seen], deviation[:, seen]
    longest = min(round(longest_lag / dt), x.shape[1] - round(_SHORTEST / dt))
    if longest < 2 or np.std(deviation[0]) < _LEAST_DEVIATION:
        return None
    correlation = _correlations(np.ascontiguousarray(deviation[0]), np.ascontiguousarray(deviation[1]), longest)
    best = int(np.argmax(correlation))
    if best in (0, longest) or correlation[best] < _LEAST_CORRELATION:
        return None
    lag = best + _vertex(correlation[best - 1 : best + 2])
    moved = float(np.mean(x[1, best:] - x[0, : x.shape[1] - best]))
    # The mean displacement belongs to the whole lag ``best``; the fraction beyond it moves with the follower.
    moved += float(np.mean(np.diff(x[1]))) * (lag - best)
    return Passage(lag * dt, moved, float(correlation[best]))


@kernel(error_model="numpy")
def _correlations(ahead: FloatArray, behind: FloatArray, longest: int) -> FloatArray:
    """Pearson correlation of the leader's deviation with the follower's k samples later, k = 0 .. longest."""
    found = np.zeros(longest + 1)
    for k in range(longest + 1):
        n = len(ahead) - k
        mean_ahead, mean_behind = ahead[:n].mean(), behind[k:].mean()
        both = own = other = 0.0
        for i in range(n):
            one, two = ahead[i] - mean_ahead, behind[i + k] - mean_behind
            both, own, other = both + one * two, own + one * one, other + two * two
        if own > 0.0 and other > 0.0:
            found[k] = both / np.sqrt(own * other)
    return found


def _vertex(values: FloatArray) -> float:
    """Offset of the vertex of the parabola through three values at -1, 0, 1."""
    bend = values[0] - 2.0 * values[1] + values[2]
    return float(0.5 * (values[0] - values[2]) / bend) if bend < 0.0 else 0.0
