"""A made-up run of many events for the tests of overview pages: tables with the columns of the artefacts."""

from dataclasses import replace

import numpy as np
import pandas as pd
from sample_studies import gain_map, pareto, pareto_summary

from highd_lc.reporting.event import FitTrace
from highd_lc.reporting.pages_followers import CalibrationTables
from highd_lc.reporting.pages_index import IndexTables, SummaryTables
from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS, TABLE3_MEANS, TABLE3_QUANTILES
from highd_lc.vocab.tables.fits import BELIEVED, NOT_IDENTIFIABLE


def sample_run(n: int = 60, *, seed: int = 4) -> IndexTables:
    """n events, every ninth infeasible, and n // 2 excluded lane-id changes."""
    rng = np.random.default_rng(seed)
    ids = [f"{1 + k % 6:02d}-{k:04d}-{100 + 7 * k:05d}" for k in range(n)]
    return IndexTables(
        events=_events(ids, rng),
        crossings=_crossings(ids, n // 2),
        plans=_plans(ids),
        losses=_losses(ids, rng),
        matrix=matrix(),
        pages=_pages(ids, rng),
    )


def _events(ids: list[str], rng: np.random.Generator) -> pd.DataFrame:
    n = len(ids)
    return pd.DataFrame({
        "event_id": ids, "recording_id": [int(i[:2]) for i in ids],
        "ego_class": np.where(np.arange(n) % 4 == 0, names.TRUCK, names.CAR),
        "direction": np.where(np.arange(n) % 3 == 0, names.RIGHT, names.LEFT),
        "duration_s": rng.uniform(3, 9, n), "follower_ids": [[1, 2, 3][: 1 + k % 3] for k in range(n)],
        "lateral_shift_m": rng.normal(3.6, 0.2, n), "peak_lateral_speed_mps": rng.uniform(0.6, 1.6, n),
        "gap_ahead_m": rng.uniform(5, 90, n), "gap_behind_m": rng.uniform(5, 90, n), "location_id": 1,
        "roles_confirmed": True,
    })  # fmt: skip


def _crossings(ids: list[str], excluded: int) -> pd.DataFrame:
    usable = [(i, True, "") for i in ids]
    reasons = [names.CUT_BEFORE_START, names.RETURNED, names.OUTSIDE_MARKINGS]
    others = [(f"09-{k:04d}-{k:05d}", False, reasons[k % 3]) for k in range(excluded)]
    frame = pd.DataFrame(usable + others, columns=["event_id", "usable", "reason"])
    frame["recording_id"] = [int(i[:2]) for i in frame["event_id"]]
    frame["ego_class"] = np.where(np.arange(len(frame)) % 4 == 0, names.TRUCK, names.CAR)
    frame["direction"] = np.where(frame["reason"] == names.OUTSIDE_MARKINGS, "", names.LEFT)
    frame["origin_lane"] = pd.array([1] * len(frame), dtype="Int64")
    frame["ego_id"] = [int(i[3:7]) for i in frame["event_id"]]
    frame["crossing_frame"] = [int(i[8:]) for i in frame["event_id"]]
    frame["speed_mps"] = 25.0
    for column in ("start_frame", "end_frame"):
        frame[column] = pd.array([k if k % 3 else None for k in range(len(frame))], dtype="Int64")
    frame["target_lane"] = pd.array([None if d == "" else 2 for d in frame["direction"]], dtype="Int64")
    return frame


def _cells(ids: list[str]) -> pd.DataFrame:
    rows = [(i, q, a) for i in ids for q in names.POLICIES for a in names.ACCOUNTINGS]
    return pd.DataFrame(rows, columns=["event_id", "policy", "accounting"])


def _infeasible(table: pd.DataFrame) -> pd.Series:
    planned = ~table["policy"].isin(names.REFERENCE_POLICIES)
    return planned & (table["event_id"].str[3:7].astype(int) % 9 == 8)


def _plans(ids: list[str]) -> pd.DataFrame:
    table = _cells(ids)
    reference = table["policy"].isin(names.REFERENCE_POLICIES)
    table["status"] = np.where(reference, names.REFERENCE, names.SOLVED)
    table.loc[_infeasible(table), "status"] = names.INFEASIBLE
    return table


def _losses(ids: list[str], rng: np.random.Generator) -> pd.DataFrame:
    table = _cells(ids)
    table["loss_total"] = rng.uniform(20, 40, len(table))
    local = table["policy"].str.startswith(names.LOCAL_OPTIMUM)
    table.loc[local, "loss_total"] = table["loss_total"].shift(3) * rng.uniform(0.9, 1.02, len(table))
    table.loc[_infeasible(table), "loss_total"] = np.nan
    return table


def _pages(ids: list[str], rng: np.random.Generator) -> pd.DataFrame:
    speed = [np.round(28 + rng.normal(0, 1, 16).cumsum(), 2).tolist() for _ in ids]
    local = [np.round(np.array(v) + 0.5, 2).tolist() for v in speed]
    return pd.DataFrame({
        "event_id": ids, "recording_id": [int(i[:2]) for i in ids], "png": True,
        "hv1_speed_benchmark": speed, "hv1_speed_local": local,
        "hv1_spacing_m": rng.uniform(8, 90, len(ids)), "hv1_speed_difference_mps": rng.normal(2, 3, len(ids)),
    })  # fmt: skip


def sample_summary(n: int = 60) -> SummaryTables:
    """The tables of the summary page for ``sample_run``."""
    run = sample_run(n)
    losses = run.losses.assign(loss_av=0.45 * run.losses["loss_total"], loss_hv=0.55 * run.losses["loss_total"])
    return SummaryTables(
        events=run.events, crossings=run.crossings, losses=losses, matrix=matrix(), recordings=recordings(),
        summary_losses=summary_losses(), summary_lcm=summary_lcm(), pages=run.pages, gain_map=gain_map(),
        pareto=pareto(), pareto_summary=pareto_summary(),
    )  # fmt: skip


def matrix() -> pd.DataFrame:
    """Two strata beside all events; every number differs from every other."""
    cells = [(f, a, s) for f in names.FORMS for a in names.ACCOUNTINGS for s in ("all", "Car", "Truck")]
    rows = []
    for k, (form, accounting, stratum) in enumerate(cells):
        gain = 0.0111 * (k + 1)
        rows.append({
            "followers": "own_fit", "form": form, "accounting": accounting, "stratum": stratum,
            "n_events": 60 + k, "n_recordings": 6,
            "total_benchmark": 1000.0 + k, "total_local": (1000.0 + k) * (1 - gain), "gain": gain,
            "gain_low": gain - 0.004, "gain_high": gain + 0.005, "gain_hv": 2 * gain, "gain_av": -gain,
            "median_difference": -gain / 2, "hodges_lehmann": -gain / 3, "share_differ": 0.8, "share_better": 0.7,
            "share_worse": 0.1, "share_worst_follower_worse": 0.2, "infeasible": k, "contacts": 0, "n_clusters": 6,
            "gain_incremental": 3 * gain, "gain_incremental_low": 2 * gain, "gain_incremental_high": 4 * gain,
            "incremental_reason": "", "added_benchmark": 80.0, "added_local": 80.0 * (1 - 3 * gain),
            "added_hv_benchmark": 60.25, "added_hv_local": 51.5, "share_top": 0.46, "gain_reweighted": gain / 4,
            "leader_seen_s": 6.9,
        })  # fmt: skip
    return pd.DataFrame(rows)


def summary_losses() -> pd.DataFrame:
    """Two pairs of policies under two accountings."""
    pairs = ((names.LOCAL_OPTIMUM, names.BENCHMARK), (names.BENCHMARK, names.HUMAN))
    return pd.DataFrame([
        {
            "policy": policy, "against": against, "accounting": accounting, "quantity": quantity, "n": 54,
            "mean": 20.125, "mean_against": 21.5, "ratio_of_sums": 0.936, "median_difference": -1.25,
            "hodges_lehmann": -1.3, "difference_low": -2.0, "difference_high": -0.75, "share_better": 0.8,
            "share_worse": 0.15, "share_tied": 0.05,
        }
        for policy, against in pairs
        for accounting in (names.EQUAL, names.PAPER)
        for quantity in ("loss_total", "loss_hv", "min_gap_m", "some_new_quantity")
    ])  # fmt: skip


def summary_lcm() -> pd.DataFrame:
    """Table 3 of two groups."""
    published = {q: v.as_array() for q, v in TABLE3_QUANTILES.items()} | {"mean": TABLE3_MEANS.as_array()}
    rows = []
    for group in ("all", names.CAR):
        for k, name in enumerate(PARAMETERS):
            paper = {f"paper_{q}": published[p][k] for q, p in (("q25", 0.25), ("q50", 0.5), ("q75", 0.75))}
            ours = {q: 1.1 * paper[f"paper_{q}"] for q in ("q25", "q50", "q75")}
            mean = {"mean": 1.2 * published["mean"][k], "paper_mean": published["mean"][k]}
            row = {"group": group, "quantity": name, "n": 90, "share_at_bound": 0.125}
            rows.append(row | paper | ours | mean)
        rows.append({"group": group, "quantity": "objective", "n": 90, "mean": 0.05, "q50": 0.04})
    return pd.DataFrame(rows)


def followers() -> pd.DataFrame:
    """Fits of every status."""
    rng = np.random.default_rng(2)
    frame = pd.DataFrame(TABLE3_MEANS.as_array() * rng.uniform(0.5, 1.5, (40, 6)), columns=list(PARAMETERS))
    frame["status"] = np.resize([names.FITTED, names.FITTED, names.CLASS_POOL, names.TABLE3], 40)
    return frame


def recordings() -> pd.DataFrame:
    """Two carriageways of three recordings, one with a failed cross-check."""
    rows = [
        {
            "recording_id": r, "driving_direction": d, "n_vehicles": 100, "n_trucks": 20, "frame_rate": 25.0,
            "n_holes": 0, "n_jumps": 0,
            "share_outside": 0.001, "mean_acceleration": 0.02, "disagreement_inner": 0.1,
            "share_lane_changes": 1.0, "share_leader_ids": 0.98, "share_acceleration": 1.0,
            "failed_checks": ["travelled"] if (r, d) == (2, 1) else [],
            "entry_m": 0.0, "exit_m": 420.0, "disagreement_profile": [0.1 * d, 0.0, -0.05], "location_id": 1,
            "mean_speed_change": 0.01, "disagreement_entry": 0.3, "disagreement_exit": 0.4,
        }
        for r in (1, 2, 3)
        for d in (1, 2)
    ]  # fmt: skip
    return pd.DataFrame(rows)


def calibration(**changes: object) -> CalibrationTables:
    """What the calibration page shows."""
    t = np.arange(40) * 0.1
    trace = FitTrace(t, 30 + np.sin(t), 30.2 + np.sin(t), 28 + np.cos(t), 28.1 + np.cos(t))
    tables = CalibrationTables(
        summary=summary_lcm(), followers=followers(), identifiability=identifiability(), pooling=pooling(),
        examples=(("best: 01-0001-00100, HV 1", trace), ("worst: 02-0002-00200, HV 3", trace)),
    )  # fmt: skip
    return replace(tables, **changes)


def identifiability() -> pd.DataFrame:
    """One believed parameter, the others not."""
    rows = [
        {
            "parameter": name, "n": 24, "width": 0.5 + 0.05 * k, "share_open": 0.25, "share_at_bound": 0.125,
            "spread": 0.75, "partner": "tau" if name != "tau" else "L", "correlation": 0.875,
            "verdict": BELIEVED if name == "L" else NOT_IDENTIFIABLE,
        }
        for k, name in enumerate(PARAMETERS)
    ]  # fmt: skip
    return pd.DataFrame(rows)


def pooling() -> pd.DataFrame:
    """Own fits, a penalty, and the median alone."""
    return pd.DataFrame({
        "strength": [0.0, 0.1, np.inf], "n": 24, "held_out_mean": [0.2, 0.125, 0.175],
        "held_out_median": [0.1, 0.0875, 0.11], "share_better": [np.nan, 0.75, 0.5], "folds": [0, 4, 1],
    })  # fmt: skip
