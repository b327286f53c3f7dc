"""Where, for whom and under what else the local optimum pays: tables of the population (equations.md 12).

The calibration's population tables: Table 3 with ours beside it, what is identifiable, what pooling brings.

Who waits, where and for what: over spacing and speed difference of the first follower at t_start.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any, Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from highd_lc.drivers.identifiability import Identifiability, PoolingStudy, verdict
from highd_lc.scoring.population import bootstrap_of, gain, ratio_interval, seen, shares
from highd_lc.stages.statistics import PolicyLosses, clusters_of
from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS, TABLE3_MEANS, TABLE3_QUANTILES
from highd_lc.vocab.policy import CHOOSING_START, PAIRS, POLICIES, ROBUST_PAIRS
from highd_lc.vocab.sections import StatisticsSettings
from highd_lc.vocab.tables import TABLES
from highd_lc.vocab.tables.studies import SECOND_OPINIONS, TOGETHER

ALL = "all"
_QUALITY = (
    "objective",
    "objective_ga",
    "rmse_spacing_m",
    "rmse_speed_mps",
    "rmse_acceleration",
    "nrmse_spacing",
    "theil_u",
    "paper_j",
)
_QUANTILES = {"q25": 0.25, "q50": 0.50, "q75": 0.75}


def summarise_fits(fitted: pd.DataFrame) -> pd.DataFrame:
    """Quantiles, mean and share on a bound of each parameter and error of fit, for all and for each class.

    fitted: rows of ``followers`` with status "fitted". Without any, every value is NaN and n is 0.
    """
    groups = {ALL: fitted} | {str(key): rows for key, rows in fitted.groupby("class")}
    rows = [row for group, members in groups.items() for row in _rows(group, members)]
    return pd.DataFrame(rows, columns=list(TABLES["summary_lcm"].column_names))


def _rows(group: str, members: pd.DataFrame) -> Iterator[dict[str, Any]]:
    for quantity in (*PARAMETERS, *_QUALITY):
        values = members[quantity].to_numpy(np.float64)
        values = values[np.isfinite(values)]
        row = {"group": group, "quantity": quantity, "n": len(values), "share_at_bound": np.nan}
        row |= {name: _quantile(values, q) for name, q in _QUANTILES.items()}
        row["mean"] = float(values.mean()) if len(values) else np.nan
        if quantity in PARAMETERS:
            hits = [quantity in names for names in members["at_bound"]]
            row["share_at_bound"] = float(np.mean(hits)) if hits else np.nan
            row |= {f"paper_{name}": getattr(TABLE3_QUANTILES[q], quantity) for name, q in _QUANTILES.items()}
            row["paper_mean"] = getattr(TABLE3_MEANS, quantity)
        yield row


def _quantile(values: np.ndarray, q: float) -> float:
    return float(np.quantile(values, q)) if len(values) else np.nan


def identifiability_rows(study: Identifiability | None, fitted: pd.DataFrame) -> pd.DataFrame:
    """Rows of ``identifiability``; none without a study. fitted: all fitted rows of ``followers``."""
    columns = list(TABLES["identifiability"].column_names)
    if study is None:
        return pd.DataFrame(columns=columns)
    rows = []
    for j, parameter in enumerate(PARAMETERS):
        at_bound = float(np.mean([parameter in names for names in fitted["at_bound"]]))
        partner = int(study.partner[j])
        rows.append(
            {
                "parameter": parameter,
                "n": study.n,
                "width": study.width[j],
                "share_open": study.share_open[j],
                "share_at_bound": at_bound,
                "spread": study.spread[j],
                "partner": PARAMETERS[partner] if partner >= 0 else "",
                "correlation": study.correlation[j],
                "verdict": verdict(study.width[j], at_bound),
            }
        )
    return pd.DataFrame(rows, columns=columns)


def pooling_rows(study: PoolingStudy | None) -> pd.DataFrame:
    """Rows of ``pooling``; none without a study."""
    columns = list(TABLES["pooling"].column_names)
    if study is None:
        return pd.DataFrame(columns=columns)
    own = study.errors[:, 0]
    rows = [
        {
            "strength": strength,
            "n": len(errors),
            "held_out_mean": float(errors.mean()),
            "held_out_median": float(np.median(errors)),
            "share_better": float(np.mean(errors < own)),
            "folds": sum(chosen == strength for chosen in study.chosen),
        }
        for strength, errors in zip(study.strengths, study.errors.T, strict=True)
    ]
    return pd.DataFrame(rows, columns=columns)


IntArray = NDArray[np.int64]
Row = dict[str, Any]

SPACING_EDGES = (0.0, 10.0, 20.0, 30.0, 40.0, 60.0, 80.0, 120.0, np.inf)
CLOSING_EDGES = (-np.inf, -6.0, -4.0, -2.0, 0.0, 2.0, 4.0, 6.0, np.inf)
_SIDES = ("av", "hv")


def gain_columns(pair: pd.DataFrame, statistics: StatisticsSettings, *, seed: int) -> Row:
    """The columns that every table of gains shares.

    pair: one row an event, with recording_id and av_1, hv_1 (local optimum), av_0, hv_0 (benchmark); NaN where
    there is no plan; contact: whether somebody drives through another under either, cluster: what stands and falls
    together, as far as it has those columns.
    """
    recordings = pair["recording_id"].to_numpy()
    sides = {name: pair[name].to_numpy(float) for name in ("av_1", "hv_1", "av_0", "hv_0")}
    # A loss that stands beside a contact is that of the drivers who come to none (draws).
    solved = ~np.isnan(sum(sides.values()))
    contact = pair["contact"].to_numpy(bool) if "contact" in pair else np.zeros(len(pair), bool)
    av_1, hv_1, av_0, hv_0 = (values[solved] for values in sides.values())
    local, benchmark = av_1 + hv_1, av_0 + hv_0
    clusters = pair["cluster"].to_numpy() if "cluster" in pair else recordings
    ratio = ratio_interval(clusters[solved], local, benchmark, bootstrap_of(statistics, seed=seed))
    better, worse, _ = shares(local / benchmark - 1.0, statistics.tie_band)
    return {
        "n_events": len(pair),
        "n_recordings": len(np.unique(recordings)),
        "infeasible": int((~solved & ~contact).sum()),
        "contacts": int(contact.sum()),
        "total_benchmark": float(benchmark.sum()),
        "total_local": float(local.sum()),
        "gain": gain(local.sum(), benchmark.sum()),
        "gain_low": 1.0 - ratio.high,
        "gain_high": 1.0 - ratio.low,
        "gain_av": gain(av_1.sum(), av_0.sum()),
        "gain_hv": gain(hv_1.sum(), hv_0.sum()),
        "share_better": better,
        "share_worse": worse,
    }


def _frame(name: str, rows: list[Row]) -> pd.DataFrame:
    return pd.DataFrame(rows, columns=list(TABLES[name].column_names))


def _pairs(losses: PolicyLosses, clusters: pd.Series | None = None) -> Iterator[tuple[Row, pd.DataFrame]]:
    """Each form and accounting with the losses of its two policies, error and effect, one row an event.

    clusters: by event, see ``clusters_of``.
    """
    for form, (benchmark, local) in PAIRS.items():
        for accounting in names.ACCOUNTINGS:
            pair = losses.pair(accounting, local, benchmark)
            if not pair.empty:
                columns = {f"{side}_{k}": pair[f"loss_{side}_{k}"] for side in _SIDES for k in (1, 0)}
                each = {f"each_{k}": pair[f"loss_hv_each_{k}"] for k in (1, 0)}
                about = {"recording_id": pair["recording_id_1"], "contact": pair["contact"]}
                if clusters is not None:
                    about["cluster"] = clusters.reindex(pair.index)
                table = pd.DataFrame(about | columns | each).join(losses.in_view(accounting, local, benchmark))
                yield {"form": form, "accounting": accounting}, table


def cross_scores(
    cross: pd.DataFrame, models: Sequence[str], statistics: StatisticsSettings, *, seed: int
) -> pd.DataFrame:
    """Gain of the plans made under one accounting when scored under each, with each model of the followers.

    cross: ``cross_losses``; models: the follower models that planned, the default one first.
    """
    both, of_plan = ["planned_with", "scored_with"], ["accounting", "policy"]
    split: dict[Any, dict[Any, pd.DataFrame]] = {
        key: dict(iter(rows.drop(columns=both).set_index("event_id").groupby(of_plan)))
        for key, rows in cross.groupby(both)
    }
    rows = []
    for planned_with in models:
        own = sorted(scored_with for one, scored_with in split if one == planned_with)
        for scored_with in dict.fromkeys((planned_with, *models, *SECOND_OPINIONS, names.SUMO, *own)):
            about = {"planned_with": planned_with, "scored_with": scored_with}
            cells = _cross_cells(split.get((planned_with, scored_with), {}), statistics, seed)
            rows += [about | row for row in cells]
    return _frame("cross_scores", rows)


def _cross_cells(cross: Mapping[Any, pd.DataFrame], statistics: StatisticsSettings, seed: int) -> Iterator[Row]:
    """Every form, accounting optimised and accounting scored.

    cross: rows of one pair of follower models by accounting and policy, indexed by event_id.
    """
    for form, (benchmark, local) in (PAIRS | ROBUST_PAIRS).items():
        for optimised in names.ACCOUNTINGS:
            if not {(optimised, local), (optimised, benchmark)} <= cross.keys():
                continue
            one, other = cross[optimised, local], cross[optimised, benchmark]
            touching = one["contact_after_T"].eq(True) | other["contact_after_T"].eq(True)
            for scored in names.ACCOUNTINGS:
                row: Row = {"form": form, "optimised": optimised, "scored": scored}
                row["touching"] = 0 if scored == names.PAPER else int(touching.sum())
                pair = _scored_pair(one, other, scored)
                peaks = pair.loc[pair["peak_1"].notna() & pair["peak_0"].notna(), ["peak_0", "peak_1"]].mean()
                row |= {"peak_benchmark": peaks["peak_0"], "peak_local": peaks["peak_1"]}
                yield row | gain_columns(pair, statistics, seed=seed)


def _scored_pair(one: pd.DataFrame, other: pd.DataFrame, scored: str) -> pd.DataFrame:
    end = "T" if scored == names.PAPER else "H"
    ends = {"av": "H" if scored == names.EQUAL else "T", "hv": end}
    columns = {
        f"{side}_{k}": frame[f"{side}_to_{ends[side]}"] for k, frame in ((1, one), (0, other)) for side in _SIDES
    }
    columns |= {f"peak_{k}": frame[f"peak_to_{end}"] for k, frame in ((1, one), (0, other))}
    met = [frame[f"contacts_to_{end}"].reindex(one.index) > 0 for frame in (one, other)]
    return pd.DataFrame({"recording_id": one["recording_id"], "contact": met[0] | met[1]} | columns)


def gain_map(
    events: pd.DataFrame, losses: PolicyLosses, statistics: StatisticsSettings, *, seed: int
) -> pd.DataFrame:
    """Gain in every tile of spacing and speed difference at t_start that holds an event.

    events: see ``statistics.situations``. Tiles are closed below and open above.
    """
    rows = []
    for about, pair in _pairs(losses, clusters_of(events, statistics)):
        for edges, inside in tiles(events.loc[pair.index]):
            row = about | edges | {"share_events": len(inside) / len(pair)}
            of_tile = pair.iloc[inside]
            row |= seen(of_tile["error"], of_tile["effect"])
            rows.append(row | gain_columns(of_tile, statistics, seed=seed))
    return _frame("gain_map", rows)


def tiles(events: pd.DataFrame) -> Iterator[tuple[Row, IntArray]]:
    """The tiles of spacing and speed difference that hold an event: the columns of ``edges_of``, and which events.

    events: see ``statistics.situations``; one whose spacing or speed difference is unknown is in no tile.
    """
    at = [
        np.searchsorted(edges, events[name].to_numpy(float), side="right") - 1
        for name, edges in (("spacing_m", SPACING_EDGES), ("closing_mps", CLOSING_EDGES))
    ]
    for i, spacing in enumerate(pairwise(SPACING_EDGES)):
        for j, closing in enumerate(pairwise(CLOSING_EDGES)):
            inside = np.flatnonzero((at[0] == i) & (at[1] == j))
            if len(inside):
                yield edges_of(spacing, closing), inside


def edges_of(spacing: tuple[float, float], closing: tuple[float, float]) -> Row:
    """The columns that name a tile of spacing [m] and speed difference [m/s]; open edges are null."""
    edges = {"spacing_low_m": spacing[0], "spacing_high_m": spacing[1]}
    edges |= {"closing_low_mps": closing[0], "closing_high_mps": closing[1]}
    return {name: edge if np.isfinite(edge) else np.nan for name, edge in edges.items()}


def leave_one_out(
    events: pd.DataFrame, losses: PolicyLosses, statistics: StatisticsSettings, *, seed: int
) -> pd.DataFrame:
    """Gain over all locations but one, for each: whether a single site carries the result.

    events: see ``statistics.situations``. A location without which nothing is left has no gain.
    """
    rows = []
    for about, pair in _pairs(losses, clusters_of(events, statistics)):
        location = events.loc[pair.index, "location_id"]
        for site in sorted(location.unique()):
            left = {"location_id": int(site), "n_left_out": int((location == site).sum())}
            rows.append(about | left | gain_columns(pair[location != site], statistics, seed=seed))
    return _frame("leave_one_out", rows)


def worse_for_somebody(losses: PolicyLosses, statistics: StatisticsSettings) -> pd.DataFrame:
    """Everybody whose loss the local optimum raises by more than the tie band over the benchmark.

    Followers one by one, and AV and followers together; the AV alone always pays, by construction.
    """
    rows = []
    for about, pair in _pairs(losses):
        events: Iterable[Any] = pair.dropna(subset=["av_1", "av_0"]).itertuples()
        for event in events:
            for who, benchmark, local in _parties(event):
                if local > benchmark * (1.0 + statistics.tie_band):
                    of_event = {"event_id": event.Index, "recording_id": event.recording_id, "who": who}
                    of_party = {
                        "loss_benchmark": benchmark,
                        "loss_local": local,
                        "increase": local / benchmark - 1.0,
                    }
                    found = seen([event.error], [event.effect])
                    of_party |= {name: found[name] for name in ("error", "error_over_effect")}
                    rows.append(about | of_event | of_party)
    return _frame("worse_for_somebody", rows)


def _parties(event: Any) -> Iterator[tuple[str, float, float]]:
    yield TOGETHER, event.av_0 + event.hv_0, event.av_1 + event.hv_1
    for rank, (benchmark, local) in enumerate(zip(event.each_0, event.each_1, strict=True), start=1):
        yield names.target_follower(rank), benchmark, local


def horizon_sensitivity(horizons: pd.DataFrame, statistics: StatisticsSettings, *, seed: int) -> pd.DataFrame:
    """Gain over the sample for every accounted time H. horizons: ``horizon_losses``."""
    rows = []
    for (horizon, form, accounting), chosen in horizons.groupby(["horizon_s", "form", "accounting"]):
        pair = chosen.rename(
            columns={
                f"loss_{side}_{p}": f"{side}_{k}" for side in _SIDES for k, p in ((1, "local"), (0, "benchmark"))
            }
        )
        row = {"horizon_s": horizon, "form": form, "accounting": accounting}
        rows.append(row | gain_columns(pair, statistics, seed=seed))
    return _frame("horizon_sensitivity", rows)


def solver_summary(comparison: pd.DataFrame) -> pd.DataFrame:
    """Shares of cases in which SLSQP ends worse or better than the global search. comparison: the artefact."""
    rows = []
    for (form, omega), cases in comparison.groupby(["form", "omega_av"]):
        row = {"form": form, "omega_av": omega, "n": len(cases)}
        for solver in ("sqp", "single"):
            excess = cases[f"excess_{solver}"].fillna(np.inf)
            row[f"share_{solver}_failed"] = float(np.isinf(excess).mean())
            row[f"share_{solver}_worse_1"] = float((excess > 0.01).mean())
            row[f"share_{solver}_worse_01"] = float((excess > 0.001).mean())
            row[f"share_{solver}_better_01"] = float((excess < -0.001).mean())
        row["excess_sqp_max"], row["excess_sqp_min"] = cases["excess_sqp"].max(), cases["excess_sqp"].min()
        rows.append(row)
    return _frame("solver_summary", rows)


_LOSSES = ("loss_av", "loss_hv", "loss_total")
STARTED: Final = ("event_id", "policy", "accounting", "delay_s", "gap", "objective")
"""Columns of ``plans`` that tell who starts when, and into which gap."""


def start_map(events: pd.DataFrame, plans: pd.DataFrame, losses: PolicyLosses) -> pd.DataFrame:
    """Waiting and its price in every tile that holds an event whose start was chosen, and in all of them together.

    events: see ``statistics.situations``; plans: the artefact, its columns ``STARTED``. Events count where
    the policy has a plan with and without the choice.
    """
    rows = []
    for policy in CHOOSING_START:
        contained = POLICIES[policy].without_choice
        for accounting in names.ACCOUNTINGS:
            pair = _pair(plans, losses, policy, contained, accounting)
            if pair.empty:
                continue
            about = {"policy": policy, "accounting": accounting}
            rows.append(about | _tile(pair))
            for edges, inside in tiles(events.loc[pair.index]):
                share = {"share_events": len(inside) / len(pair)}
                rows.append(about | edges | _tile(pair.iloc[inside]) | share)
    return pd.DataFrame(rows, columns=list(TABLES["start_map"].column_names))


def _pair(plans: pd.DataFrame, losses: PolicyLosses, policy: str, contained: str, accounting: str) -> pd.DataFrame:
    of_accounting = plans[plans["accounting"] == accounting]
    start, without = (of_accounting[of_accounting["policy"] == name] for name in (policy, contained))
    pair = start.set_index("event_id")[["delay_s", "gap", "objective"]]
    pair = pair.join(without.set_index("event_id")[["objective"]].add_suffix("_0"), how="inner")
    for suffix, name in (("", policy), ("_0", contained)):
        pair = pair.join(losses.of(accounting, name)[list(_LOSSES)].add_suffix(suffix), how="inner")
    pair = pair.join(losses.in_view(accounting, policy, contained))
    return pair.dropna(subset=["objective", "objective_0"])


def _tile(pair: pd.DataFrame) -> dict[str, Any]:
    waiting = pair["delay_s"] > 0.0
    row = {
        "share_events": 1.0,
        "n_events": len(pair),
        "share_waiting": float(waiting.mean()),
        "share_other_gap": float((pair["gap"] != names.RECORDED_GAP).mean()),
        "mean_delay_s": float(pair["delay_s"].mean()),
    }
    for name in ("objective", *_LOSSES):
        ratio = pair[name].sum() / pair[f"{name}_0"].sum()
        row[f"saved_{name.removeprefix('loss_')}"] = float(1.0 - ratio)
    return row | seen(pair["error"], pair["effect"])
