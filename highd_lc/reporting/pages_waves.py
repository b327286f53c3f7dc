"""The section on shock waves behind real lane changes: observed beside those of the followers that plan."""

from collections.abc import Iterator
from typing import Any, Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from highd_lc.reporting import html, labels
from highd_lc.reporting.figures_space_time import SpeedMap, wave_field_figure
from highd_lc.reporting.pages_data import Column, Section, table_view
from highd_lc.vocab.tables.prediction import OBSERVED, UNRELATED

FloatArray = NDArray[np.float64]

_SOURCES: Final = {OBSERVED: "Observed", UNRELATED: "Unrelated pairs (chance)"}
_COLUMNS: Final = (
    Column("label", "Followers"),
    Column("stratum_label", "Traffic"),
    Column("n_pairs", "Pairs in view", digits=0),
    Column("contacts", "left out", digits=0),
    Column("passed", "passing a wave on", digits=0),
    Column("lag_s", "Delay", "s", 2),
    Column("displacement_m", "Way meanwhile", "m", 1),
    Column("speed_mps", "Speed along the road", "m/s", 2),
    Column("speed_low", "from", "m/s", 2),
    Column("speed_high", "to", "m/s", 2),
    Column("correlation", "Correlation", digits=2),
    Column("n_both", "Pairs with both", digits=0),
    Column("lag_difference_s", "Delay − observed", "s", 2),
    Column("lag_difference_low", "from", "s", 2),
    Column("lag_difference_high", "to", "s", 2),
)


def wave_sections(waves: pd.DataFrame, field: pd.DataFrame, default: str) -> Iterator[Section]:
    """What passes from driver to driver behind real lane changes.

    waves, field: those tables; default: the model that plans.
    """
    if waves.empty:
        return
    table = waves.assign(
        label=waves["source"].map(lambda source: _SOURCES.get(source, labels.follower_model(source))),
        stratum_label=waves["stratum"].map(labels.stratum),
        place=waves["source"].map({OBSERVED: 0, default: 1, UNRELATED: 3}).fillna(2),
    ).sort_values(["stratum", "place", "source"], kind="stable")
    observed, simulated = (_map(field, source) for source in (OBSERVED, default))
    columns = [column for column in _COLUMNS if table[column.name].notna().any()]
    figure = None
    if observed is not None and simulated is not None:
        figure = html.inline_svg(wave_field_figure(observed, simulated), _ALTERNATIVE)
    yield Section(
        "Waves behind real lane changes",
        tuple(wave_words(waves, default)),
        figure,
        _CAPTION if figure else "",
        tables=(table_view(table, columns, "From vehicle to vehicle, by cross-correlation of their speeds"),),
        anchor="waves",
    )


_CAPTION: Final = (
    "Speed of the followers of all lane changes laid over each other, in cells of space and time (Edie: the way "
    "of all in a cell over their time in it), relative to the ego's at t_start, in a frame that moves with it; "
    "0 m is the ego's centre. Right: what the simulated followers do differently."
)
_ALTERNATIVE: Final = "Speed over space and time behind the lane changer: observed, simulated, their difference."


def _map(field: pd.DataFrame, source: str) -> SpeedMap | None:
    """A source's cells on the grid that all sources share; None where there are none."""
    rows = field[field["source"] == source]
    if rows.empty:
        return None
    x_edges, t_edges = (_edges(field, column) for column in (("x_from_m", "x_to_m"), ("t_from_s", "t_to_s")))
    speed = np.full((len(x_edges) - 1, len(t_edges) - 1), np.nan)
    i, j = np.searchsorted(x_edges, rows["x_from_m"]), np.searchsorted(t_edges, rows["t_from_s"])
    speed[i, j] = rows["speed_mps"]
    return SpeedMap(x_edges, t_edges, speed)


def _edges(field: pd.DataFrame, ends: tuple[str, str]) -> FloatArray:
    return np.union1d(*(field[column].to_numpy(np.float64) for column in ends))


def wave_words(waves: pd.DataFrame, default: str) -> Iterator[str]:
    """How a disturbance travels, observed and by the model that plans, and how sure that is."""
    rows: dict[Any, Any] = {row["source"]: row for row in waves[waves["stratum"] == "all"].to_dict("records")}
    seen = rows.get(OBSERVED)
    if seen is None or not seen["passed"]:
        yield "In no pair of vehicles in view for 7 s does a disturbance pass on: of waves nothing can be said."
        return
    yield f"Observed: {_one(seen)}."
    if default in rows:
        mine = rows[default]
        yield f"Simulated by the model {labels.follower_model(default)}: {_one(mine)}. {_beside(mine)}"
    if UNRELATED in rows:
        chance = rows[UNRELATED]["share_passed"]
        yield (
            f"How sure: in pairs of unrelated vehicles something seems to pass on in "
            f"{html.percent(chance, 0)}"
            f"{_excess(seen['share_passed'], chance)}. {_intervals(seen)}"
        )


def _one(row: dict[str, Any]) -> str:
    if not row["passed"]:
        return f"in none of {row['n_pairs']} pairs does a disturbance pass on"
    low, speed, high = (html.number(row[f"speed_{end}"], 1) for end in ("low", "mps", "high"))
    ends = f" ({low} to {high})" if row["speed_low"] == row["speed_low"] else ""
    way = "downstream" if row["speed_mps"] > 0.0 else "upstream"
    if row["speed_low"] <= 0.0 <= row["speed_high"]:
        way = "upstream or downstream cannot be told"
    return (
        f"in {html.percent(row['share_passed'], 0)} of {row['n_pairs']} pairs a disturbance reaches the next "
        f"driver, {row['lag_s']:.1f} s later on average; it moves at {speed} m/s{ends} along the road, "
        f"{way}"
    )


def _beside(mine: dict[str, Any]) -> str:
    """Whether the simulated followers pass waves on sooner or later than the observed ones of the same pairs."""
    if not mine["n_both"]:
        return "In no pair does one pass on both as observed and as simulated."
    low, high, later = (float(mine[f"lag_difference_{end}"]) for end in ("low", "high", "s"))
    word = "later" if later > 0.0 else "sooner"
    said = f"Over the {mine['n_both']} pairs with both they react {abs(later):.1f} s {word} than the drivers did"
    if low != low:
        return f"{said}, without an interval."
    told = "which is no difference that could be told" if low <= 0.0 <= high else "a difference beyond chance"
    return f"{said} ({html.number(low, 1)} to {html.number(high, 1)}), {told}."


def _excess(share: float, chance: float) -> str:
    if not share > chance:
        return ", which is no less than observed: what is observed cannot be told from chance"
    waves = html.percent((share - chance) / max(1.0 - chance, 1e-9), 0)
    return f", against {html.percent(share, 0)} observed: about {waves} are waves"


def _intervals(seen: dict[str, Any]) -> str:
    if seen["speed_low"] == seen["speed_low"]:
        return f"Intervals are over {seen['n_recordings']} recordings."
    return f"With {seen['n_recordings']} recordings there is no interval."
