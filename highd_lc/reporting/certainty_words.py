"""How sure a gain is, in words: intervals and why there are none, what carries it, who was selected.

Every number is looked up in a row of ``validation_matrix``, or counted in ``crossings``.
"""

from collections.abc import Iterator
from itertools import pairwise
from typing import Any, Final

import numpy as np
import pandas as pd

from highd_lc.reporting import html
from highd_lc.scoring.population import LEAST_CLUSTERS
from highd_lc.vocab.tables.summaries import ADDS_NOTHING, NO_REFERENCE, OTHER_TIME, SPEED_CLASSES

_WHY: Final = {
    ADDS_NOTHING: "the benchmark's plans add no loss to that of no lane change, or hardly more than they save",
    OTHER_TIME: "no lane change is charged over another time than a plan under this accounting",
    NO_REFERENCE: "the losses without a lane change are not known",
}


def counted(n: int, word: str) -> str:
    """A number with its noun: "1 recording", "3 recordings"."""
    return f"{n} {word}{'s' * (n != 1)}"


def change(gain: float, less: str = "less", more: str = "more") -> str:
    """A gain in words: "0.50 % less"."""
    if gain == 0.0:
        return f"no {less} and no {more}"
    return f"{amount(gain)} % {less if gain > 0.0 else more}"


def amount(share: float, digits: int = 2) -> str:
    """Its size in percent; what rounds to nothing without being nothing is said to be small, not 0."""
    size, least = 100.0 * abs(share), 0.1**digits
    return f"under {html.number(least, digits)}" if 0.0 < size < least / 2.0 else html.number(size, digits)


def between(low: float, high: float) -> str:
    """From one gain to another: "0.31 to 0.72 % less", or from more to less where zero lies between them."""
    if low < 0.0 < high:
        return f"{change(low)} to {change(high)}"
    first, last = sorted((low, high), key=abs)
    return f"{amount(first)} to {change(last)}"


def interval(low: float, high: float, n: int, unit: str, *, confidence: float) -> str:
    """An interval of a gain, or why there is none. n: clusters; unit: what a cluster is, "recording"."""
    if html.is_missing(low) or html.is_missing(high):
        return no_interval(n, unit)
    return f"{100.0 * confidence:g} % interval {between(low, high)}, from {counted(n, unit)}"


def no_interval(n: int, unit: str = "recording") -> str:
    """Why there is no interval over n clusters."""
    if n < LEAST_CLUSTERS:
        return f"no interval: {counted(n, unit)}, at least {LEAST_CLUSTERS} are needed"
    return f"no interval: a {unit} or two carry it, or what it is a share of may be nothing"


def beside(row: Any, name: str = "gain", unit: str = "recording") -> str:
    """A gain of a row of ``validation_matrix`` with its interval in brackets, or why it has none."""
    value, low, high = (getattr(row, f"{name}{end}") for end in ("", "_low", "_high"))
    if html.is_missing(value):
        return html.percent(value)
    if html.is_missing(low) or html.is_missing(high):
        return f"{html.percent(value)} ({no_interval(int(row.n_clusters), unit)})"
    return f"{html.percent(value)} ({html.number(100.0 * low)} to {html.number(100.0 * high)})"


def incremental(cell: Any, *, unit: str, confidence: float) -> str:
    """What of the loss that the lane change adds is saved, the followers' apart; why not where that is unknown."""
    if cell.incremental_reason:
        return (
            f"What of the loss that the lane change adds is saved cannot be said: {_WHY[cell.incremental_reason]}."
        )
    ends = cell.gain_incremental_low, cell.gain_incremental_high
    sure = interval(*ends, int(cell.n_clusters), unit, confidence=confidence)
    return (
        f"Of the loss that the lane change adds to that of no lane change the local optimum has "
        f"{change(cell.gain_incremental)} ({sure}). To the followers' loss it adds "
        f"{html.number(cell.added_hv_local, 1)} in all, the benchmark {html.number(cell.added_hv_benchmark, 1)}."
        f"{_small(cell)}"
    )


_LITTLE: Final = 0.05


def _small(cell: Any) -> str:
    """A warning where what the lane change adds is little beside the loss that is there without it."""
    share = cell.added_benchmark / cell.total_benchmark if cell.total_benchmark > 0.0 else np.nan
    if not share < _LITTLE:
        return ""
    return (
        f" All that it adds is {amount(share, 1)} % of the benchmark's loss, AV and followers together: the share "
        "saved of it hangs on small differences."
    )


def concentration(cell: Any) -> str:
    """The median event, and what the few events with the largest savings carry."""
    median = f"In the median event the local optimum has {change(-cell.median_difference)} total loss"
    if html.is_missing(cell.share_top):
        return f"{median}."
    return f"{median}; the 5 % of events that save most carry {amount(cell.share_top, 0)} % of the sum."


def selection(crossings: pd.DataFrame, cell: Any) -> Iterator[str]:
    """Which lane-id changes can be used, and what the gain is if each kind counts as often as it was found."""
    known = crossings[crossings["direction"].ne("")]
    kinds = [_usable(known, "ego_class"), _usable(known, "direction")]
    if "speed_mps" in known and known["speed_mps"].notna().any():
        kinds.insert(0, _usable(known.assign(speed=_speeds(known["speed_mps"])), "speed"))
    if len(known):
        yield f"Of the changes between two lanes can be used: {'; '.join(kinds)}."
    if not html.is_missing(cell.gain_reweighted):
        yield (
            "Each event counted as often as changes of its class, direction and speed were found, the local "
            f"optimum has {change(cell.gain_reweighted)} total loss than the benchmark."
        )


def _usable(crossings: pd.DataFrame, column: str) -> str:
    shares = crossings["usable"].astype(float).groupby(crossings[column], sort=True).agg(["mean", "size"])
    return ", ".join(
        f"{str(kind).lower()} {amount(row['mean'], 0)} % of {row['size']:g}" for kind, row in shares.iterrows()
    )


def _speeds(values: pd.Series) -> Any:
    names = [f"below {SPEED_CLASSES[0]:g} m/s"]
    names += [f"{a:g} to {b:g} m/s" for a, b in pairwise(SPEED_CLASSES)]
    names.append(f"from {SPEED_CLASSES[-1]:g} m/s")
    places = np.searchsorted(SPEED_CLASSES, values.astype(float), side="right")
    return pd.Categorical.from_codes(
        np.where(values.notna(), places, -1), pd.Index(names, dtype=object), ordered=True
    )


def multiplicity(matrix: pd.DataFrame, *, confidence: float) -> str:
    """How many cells have an interval, and what that means for the most striking one of them."""
    n = int(matrix["gain_low"].notna().sum())
    if n == 0:
        return "No cell has an interval."
    missed, level = (1.0 - confidence) * n, 100.0 * (1.0 - (1.0 - confidence) / n)
    return (
        f"{counted(n, 'cell')} of the matrix {'has' if n == 1 else 'have'} an interval. Of so many "
        f"{100.0 * confidence:g} % intervals about {html.number(missed, 1)} miss what they are of by chance "
        "alone, most likely the most striking one. To hold for all cells at once each would need a coverage of "
        f"{level:.2f} % (Bonferroni)."
    )
