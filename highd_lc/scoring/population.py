"""Statistics over a population of events: paired differences, and intervals by bootstrap over recordings."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.special import stdtrit

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True)
class Bootstrap:
    """How intervals are made: samples drawn, coverage, and the seed of the draws."""

    samples: int
    confidence: float
    seed: int


@dataclass(frozen=True)
class Interval:
    """Lower and upper end; NaN where fewer than two recordings say nothing about their spread."""

    low: float
    high: float


def hodges_lehmann(values: FloatArray) -> float:
    """Median of the means of all pairs, each value paired with itself too; NaN of nothing.

    Found by bisection on the number of pairs below a level, O(n) each, so that n may be many thousands.
    """
    if len(values) == 0:
        return np.nan
    x = np.sort(values)
    pairs = len(x) * (len(x) + 1) // 2
    middle = _pair_mean(x, (pairs + 1) // 2)
    # An even number of pairs: the median is the mean of two that follow each other.
    return middle if pairs % 2 else 0.5 * (middle + _pair_mean_after(x, pairs // 2, middle))


@njit(cache=True, nogil=True)
def _pair_mean(x: FloatArray, rank: int) -> float:
    """The pair mean of that rank, counted from 1; x ascending."""
    low, high = x[0], x[-1]
    for _ in range(80):
        level = 0.5 * (low + high)
        if not low < level < high:
            break
        if _pairs_below(x, level) >= rank:
            high = level
        else:
            low = level
    return float(high)


@njit(cache=True, nogil=True)
def _pair_mean_after(x: FloatArray, rank: int, value: float) -> float:
    """The pair mean of the next rank, given that of a rank; x ascending."""
    if _pairs_below(x, value) > rank:
        return value
    after, j = np.inf, len(x) - 1
    for i in range(len(x)):
        while j >= i and x[j] > 2.0 * value - x[i]:
            j -= 1
        partner = max(j + 1, i)
        if partner < len(x):
            after = min(after, 0.5 * (x[i] + x[partner]))
    return float(after)


@njit(cache=True, nogil=True)
def _pairs_below(x: FloatArray, level: float) -> int:
    """How many pairs i <= j have x_i + x_j <= 2 level: as x_i grows, its last partner j moves down."""
    count, j = 0, len(x) - 1
    for i in range(len(x)):
        while j >= i and x[j] > 2.0 * level - x[i]:
            j -= 1
        if j < i:
            break
        count += j - i + 1
    return count


def shares(difference: FloatArray, band: float) -> tuple[float, float, float]:
    """Share of relative differences below -band (better), above +band (worse), and in between (tied)."""
    if len(difference) == 0:
        return np.nan, np.nan, np.nan
    better, worse = float(np.mean(difference < -band)), float(np.mean(difference > band))
    return better, worse, 1.0 - better - worse


LEAST_CLUSTERS: Final = 5
"""Fewer recordings than this give no interval."""


def cluster_interval(
    numerator: FloatArray, denominator: FloatArray, clusters: IntArray, *, confidence: float
) -> tuple[float, float]:
    """Interval of sum(numerator) / sum(denominator) by Student's t over clusters; NaN below five of them.

    The ratio is linearised: its residuals, summed within each cluster, vary over G clusters with G - 1 degrees of
    freedom (equations.md 12). A mean is the ratio to ones.
    """
    names, place = np.unique(clusters, return_inverse=True)
    count, total = len(names), float(denominator.sum())
    if count < LEAST_CLUSTERS or total == 0.0:
        return np.nan, np.nan
    ratio = float(numerator.sum()) / total
    residuals = np.bincount(place, weights=numerator - ratio * denominator)
    error = float(np.sqrt(count / (count - 1.0) * (residuals**2).sum())) / abs(total)
    reach = float(stdtrit(count - 1, 0.5 + confidence / 2.0)) * error
    return ratio - reach, ratio + reach


def mean_interval_of(values: FloatArray, recordings: IntArray, *, confidence: float) -> tuple[float, float, str]:
    """Interval of a mean by Student's t, and its units: recordings where there are five of them, else events.

    NaN and no units below five events.
    """
    over = "recordings" if len(np.unique(recordings)) >= LEAST_CLUSTERS else "events"
    units = recordings if over == "recordings" else np.arange(len(values))
    low, high = cluster_interval(values, np.ones(len(values)), units, confidence=confidence)
    return low, high, over if low == low else ""


def recording_sums(recordings: IntArray, *columns: FloatArray) -> FloatArray:
    """Sum of each column over the events of each recording, shape (columns, recordings)."""
    _, place = np.unique(recordings, return_inverse=True)
    return np.stack([np.bincount(place, weights=column) for column in columns])


@lru_cache(maxsize=64)
def _draws(count: int, bootstrap: Bootstrap) -> FloatArray:
    """How often each of ``count`` recordings is drawn, shape (samples, count)."""
    generator = np.random.default_rng([bootstrap.seed, count])
    return generator.multinomial(count, np.full(count, 1.0 / count), size=bootstrap.samples).astype(np.float64)


def ratio_interval(
    recordings: IntArray, numerator: FloatArray, denominator: FloatArray, bootstrap: Bootstrap
) -> Interval:
    """Interval of sum(numerator) / sum(denominator), recordings drawn with replacement."""
    sums = recording_sums(recordings, numerator, denominator)
    if sums.shape[1] < 2:
        return Interval(np.nan, np.nan)
    drawn = _draws(sums.shape[1], bootstrap) @ sums.T
    return _quantiles(drawn[:, 0] / drawn[:, 1], bootstrap)


def mean_interval(recordings: IntArray, values: FloatArray, bootstrap: Bootstrap) -> Interval:
    """Interval of the mean over events, recordings drawn with replacement."""
    return ratio_interval(recordings, values, np.ones_like(values), bootstrap)


def _quantiles(values: FloatArray, bootstrap: Bootstrap) -> Interval:
    tail = (1.0 - bootstrap.confidence) / 2.0
    low, high = np.quantile(values, [tail, 1.0 - tail])
    return Interval(float(low), float(high))
