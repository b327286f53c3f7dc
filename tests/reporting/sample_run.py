"""A made-up run of many events for the tests of overview pages: tables with the columns of the artefacts."""

import numpy as np
import pandas as pd

from highd_lc.reporting.pages_index import IndexTables
from highd_lc.vocab import names


def sample_run(n: int = 60, *, seed: int = 4) -> IndexTables:
    """n events, every ninth infeasible, and n // 2 excluded lane-id changes."""
    rng = np.random.default_rng(seed)
    ids = [f"{1 + k % 6:02d}-{k:04d}-{100 + 7 * k:05d}" for k in range(n)]
    return IndexTables(
        events=_events(ids, rng),
        crossings=_crossings(ids, n // 2),
        plans=_plans(ids),
        losses=_losses(ids, rng),
        pages=_pages(ids, rng),
    )


def _events(ids: list[str], rng: np.random.Generator) -> pd.DataFrame:
    n = len(ids)
    return pd.DataFrame({
        "event_id": ids, "recording_id": [int(i[:2]) for i in ids],
        "ego_class": np.where(np.arange(n) % 4 == 0, names.TRUCK, names.CAR),
        "direction": np.where(np.arange(n) % 3 == 0, names.RIGHT, names.LEFT),
        "duration_s": rng.uniform(3, 9, n), "follower_ids": [[1, 2, 3][: 1 + k % 3] for k in range(n)],
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
    frame["target_lane"] = pd.array([None if d == "" else 2 for d in frame["direction"]], dtype="Int64")
    return frame


def _cells(ids: list[str]) -> pd.DataFrame:
    rows = [(i, q, a) for i in ids for q in names.POLICIES for a in names.ACCOUNTINGS]
    return pd.DataFrame(rows, columns=["event_id", "policy", "accounting"])


def _infeasible(table: pd.DataFrame) -> pd.Series:
    planned = table["policy"].isin(names.FIXED_POLICIES + names.FREE_POLICIES)
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
    local = table["policy"].isin([names.LOCAL_OPTIMUM, names.LOCAL_OPTIMUM_FREE])
    table.loc[local, "loss_total"] = table["loss_total"].shift(3) * rng.uniform(0.9, 1.02, len(table))
    table.loc[_infeasible(table), "loss_total"] = np.nan
    return table


def _pages(ids: list[str], rng: np.random.Generator) -> pd.DataFrame:
    speed = [np.round(28 + rng.normal(0, 1, 16).cumsum(), 2).tolist() for _ in ids]
    local = [np.round(np.array(v) + 0.5, 2).tolist() for v in speed]
    return pd.DataFrame({
        "event_id": ids, "recording_id": [int(i[:2]) for i in ids], "png": True,
        "hv1_speed_benchmark": speed, "hv1_speed_local": local,
    })  # fmt: skip
