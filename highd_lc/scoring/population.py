"""Statistics over a population of events: paired differences, and intervals over clusters of them.

A cluster is a recording, or a location: its events stand and fall together (equations.md 12.2).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from highd_lc.core.kernels import kernel
from highd_lc.vocab.sections import StatisticsSettings

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


BOOTSTRAP_T: Final = "bootstrap_t"
STUDENT: Final = "t"
PERCENTILE: Final = "percentile"
"""How an interval is made (equations.md 12.2); the first one covers what it says also where effects are skewed."""


@dataclass(frozen=True)
class Bootstrap:
    """How intervals are made: samples drawn, coverage, the seed of the draws, and by which method."""

    samples: int
    confidence: float
    seed: int
    method: str = BOOTSTRAP_T


def bootstrap_of(settings: StatisticsSettings, *, seed: int) -> Bootstrap:
    """How the settings ask for intervals."""
    return Bootstrap(settings.bootstrap, settings.confidence, seed, settings.interval)


@dataclass(frozen=True)
class Interval:
    """Lower and upper end; NaN where too few clusters say nothing about their spread."""

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


@kernel()
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


@kernel()
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


@kernel()
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


@cache
def student(degrees: int, share: float) -> float:
    """The value below which a share of Student's distribution lies."""
    from scipy.special import stdtrit  # an eighth of a second that only intervals are worth

    return float(stdtrit(degrees, share))


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
    reach = student(count - 1, 0.5 + confidence / 2.0) * error
    return ratio - reach, ratio + reach


def mean_interval_of(values: FloatArray, recordings: IntArray, bootstrap: Bootstrap) -> tuple[float, float, str]:
    """Interval of a mean, and its units: recordings where there are five of them, else events.

    NaN and no units below five events.
    """
    over = "recordings" if len(np.unique(recordings)) >= LEAST_CLUSTERS else "events"
    units = recordings if over == "recordings" else np.arange(len(values))
    if len(units) < LEAST_CLUSTERS:
        return np.nan, np.nan, ""
    found = mean_interval(units, values, bootstrap)
    return found.low, found.high, over if found.low == found.low else ""


def recording_sums(recordings: IntArray, *columns: FloatArray) -> FloatArray:
    """Sum of each column over the events of each recording, shape (columns, recordings)."""
    _, place = np.unique(recordings, return_inverse=True)
    return np.stack([np.bincount(place, weights=column) for column in columns])


@lru_cache(maxsize=64)
def _draws(count: int, bootstrap: Bootstrap) -> FloatArray:
    """How often each of ``count`` clusters is drawn, shape (samples, count)."""
    generator = np.random.default_rng([bootstrap.seed, count])
    return generator.multinomial(count, np.full(count, 1.0 / count), size=bootstrap.samples).astype(np.float64)


def ratio_interval(
    clusters: IntArray, numerator: FloatArray, denominator: FloatArray, bootstrap: Bootstrap
) -> Interval:
    """Interval of sum(numerator) / sum(denominator) over clusters, by the method asked for.

    NaN below five clusters (percentile: below two), and where the sum below the line may be nothing.

    Args:
        clusters: of each event, shape (events,).
        numerator: what is added up above the line, shape (events,).
        denominator: what is added up below it, shape (events,).
        bootstrap: method, coverage and draws.
    """
    if bootstrap.method == STUDENT:
        return Interval(*cluster_interval(numerator, denominator, clusters, confidence=bootstrap.confidence))
    above, below = recording_sums(clusters, numerator, denominator)
    if len(above) < (2 if bootstrap.method == PERCENTILE else LEAST_CLUSTERS):
        return Interval(np.nan, np.nan)
    if bootstrap.method == PERCENTILE:
        drawn = _draws(len(above), bootstrap) @ np.stack([above, below]).T
        return _quantiles(drawn[:, 0] / drawn[:, 1], bootstrap)
    return _bootstrap_t(above, below, bootstrap)


def mean_interval(clusters: IntArray, values: FloatArray, bootstrap: Bootstrap) -> Interval:
    """Interval of the mean over events, see ``ratio_interval``."""
    return ratio_interval(clusters, values, np.ones_like(values), bootstrap)


def _bootstrap_t(above: FloatArray, below: FloatArray, bootstrap: Bootstrap) -> Interval:
    """The jackknife's error times the larger one, on either side, of Student's t and the bootstrap's.

    NaN where a cluster or two carry everything. above, below: sums of each cluster. Student's t alone is too short
    on the side of a skewed effect's tail.
    """
    # One pass over the draws for all their sums: with many clusters they take longer to read than to add up.
    powers = np.stack([below, above, above**2, above * below, below**2], axis=1)
    drawn, rest = _draws(len(above), bootstrap) @ powers, below.sum() - below
    nothing, tail = drawn[:, 0] <= 0.0, (1.0 - bootstrap.confidence) / 2.0
    if rest.min() <= 0.0 or np.mean(nothing) > tail / 2.0:
        return Interval(np.nan, np.nan)
    ratio = float(above.sum() / below.sum())
    error = _jackknife_error((above.sum() - above) / rest)
    deviations = _studentised(drawn[~nothing], ratio, len(above))
    low, high = np.quantile(deviations, [tail, 1.0 - tail])
    least = student(len(above) - 1, 1.0 - tail)
    if max(abs(low), abs(high)) > _WILDEST * least:
        return Interval(np.nan, np.nan)
    return Interval(ratio - max(high, least) * error, ratio + max(-low, least) * error)


_WILDEST: Final = 10.0
"""Draws that deviate by so many of Student's t tell that a cluster or two carry everything: no interval then."""


def _jackknife_error(left_out: FloatArray) -> float:
    """Standard error from the values without each cluster in turn."""
    count = len(left_out)
    return float(np.sqrt((count - 1.0) / count * ((left_out - left_out.mean()) ** 2).sum()))


def _studentised(sums: FloatArray, ratio: float, count: int) -> FloatArray:
    """Deviation of each draw's ratio over its own linearised error; 0 where a draw has no spread.

    sums: of the powers that ``_bootstrap_t`` adds up, a row a draw; count: of the clusters.
    """
    total, above, above_2, product, total_2 = sums.T
    drawn = above / total
    squares = above_2 - 2.0 * drawn * product + drawn**2 * total_2
    error = np.sqrt(count / (count - 1.0) * np.maximum(squares, 0.0)) / total
    deviations: FloatArray = np.divide(drawn - ratio, error, out=np.zeros_like(error), where=error > 0.0)
    return deviations


def _quantiles(values: FloatArray, bootstrap: Bootstrap) -> Interval:
    tail = (1.0 - bootstrap.confidence) / 2.0
    low, high = np.quantile(values, [tail, 1.0 - tail])
    return Interval(float(low), float(high))


def share_carried(savings: FloatArray, *, part: float = 0.05) -> float:
    """Share of the sum that the part of the values with the largest ones carries; NaN of no positive sum.

    At least one value is counted. Above 1 where the others add up to less than nothing.
    """
    total = float(savings.sum())
    if not total > 0.0:
        return np.nan
    return float(np.sort(savings)[-max(1, round(part * len(savings))) :].sum()) / total


_NOTHING: Final = 1e-9


def ratio_of_sums(one: FloatArray, other: FloatArray) -> float:
    """Ratio of two sums; NaN where the lower one is nothing beside what was added, but for rounding."""
    total, added = other.sum(), np.abs(one).sum() + np.abs(other).sum()
    return float(one.sum() / total) if abs(total) > _NOTHING * added else np.nan


def known_mean(values: FloatArray) -> float:
    """Mean of what is known, NaN of nothing."""
    known = values[~np.isnan(values)]
    return float(known.mean()) if len(known) else np.nan


def gain(local: float, benchmark: float) -> float:
    """Share of a benchmark's loss that a local optimum saves; NaN where the benchmark has none."""
    return float(1.0 - local / benchmark) if benchmark > 0.0 else np.nan


NO_EFFECT: Final = 1e-6
"""A mean effect on the loss up to this is none."""


def seen(error: ArrayLike, effect: ArrayLike) -> dict[str, float]:
    """What tells whether a gain may be quoted: mean absolute effect and error of the events, and their ratio.

    error, effect: of each event (``PolicyLosses.in_view``); both means are over the events that have both. Unknown
    is NaN; so is the ratio to no effect.
    """
    both = np.stack([np.asarray(error, np.float64), np.asarray(effect, np.float64)])
    known = both[:, ~np.isnan(both).any(axis=0)]
    e, d = np.abs(known).mean(axis=1).tolist() if known.size else (np.nan, np.nan)
    return {"effect": d, "error": e, "error_over_effect": e / d if d > NO_EFFECT else np.nan}


def padded(lists: Sequence[Sequence[float]]) -> FloatArray:
    """Lists of numbers as rows of one array, NaN after their ends; at least one column."""
    lengths = np.array([len(each) for each in lists], dtype=np.int64)
    rows = np.full((len(lists), max(1, lengths.max(initial=0))), np.nan)
    rows[np.arange(rows.shape[1]) < lengths[:, None]] = np.concatenate([*lists, []])
    return rows


_REMAINDER: Final = 0.1
"""Of sums with both signs, what has to be left over as a share of their sizes: a ratio to less says nothing."""


def gain_of_added(
    benchmark: FloatArray, local: FloatArray, clusters: IntArray, bootstrap: Bootstrap
) -> tuple[float, float, float]:
    """1 - sum(local) / sum(benchmark) of losses above a reference, with interval.

    NaN where nothing is added, or what some events add is taken away by others but for ``_REMAINDER`` of it.
    """
    total = float(benchmark.sum())
    if not total > _REMAINDER * float(np.abs(benchmark).sum()):
        return np.nan, np.nan, np.nan
    ratio = ratio_interval(clusters, local, benchmark, bootstrap)
    return 1.0 - float(local.sum()) / total, 1.0 - ratio.high, 1.0 - ratio.low
