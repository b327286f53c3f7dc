"""Population tables from the losses of all events: the validation matrix and the paired summary."""

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from highd_lc.core.edie import TRAFFIC_STATES, traffic_states
from highd_lc.io import artefacts
from highd_lc.reporting.follower_words import error_and_effect
from highd_lc.scoring.population import (
    Bootstrap,
    bootstrap_of,
    gain,
    gain_of_added,
    hodges_lehmann,
    known_mean,
    mean_interval,
    padded,
    ratio_interval,
    ratio_of_sums,
    share_carried,
    shares,
)
from highd_lc.vocab import names
from highd_lc.vocab.policy import PAIRS, ROBUST_PAIRS
from highd_lc.vocab.sections import StatisticsSettings
from highd_lc.vocab.tables import TABLES
from highd_lc.vocab.tables.summaries import ADDED, ADDS_NOTHING, NO_REFERENCE, OTHER_TIME, SPEED_CLASSES

FloatArray = NDArray[np.float64]
Arrays = dict[str, NDArray[Any]]
"""Columns of some rows of a table."""

_COMPARED = (
    *((local, benchmark) for benchmark, local in PAIRS.values()),
    (names.BENCHMARK_START, names.BENCHMARK),
    (names.LOCAL_OPTIMUM_START, names.LOCAL_OPTIMUM),
    (names.LOCAL_OPTIMUM_ROBUST, names.LOCAL_OPTIMUM),
    (names.LOCAL_OPTIMUM_ROBUST_FREE, names.LOCAL_OPTIMUM_FREE),
    (names.LOCAL_OPTIMUM, names.HUMAN),
    (names.BENCHMARK, names.HUMAN),
    (names.LOCAL_OPTIMUM, names.NO_LANE_CHANGE),
    (names.LOCAL_OPTIMUM, names.CONSTANT),
    (names.BENCHMARK_FREE, names.BENCHMARK),
    (names.LOCAL_OPTIMUM_FREE, names.LOCAL_OPTIMUM),
)
_QUANTITIES = (
    "loss_total",
    "loss_av",
    "loss_hv",
    "av_comfort",
    "av_efficiency",
    "hv_comfort",
    "hv_efficiency",
    "worst_follower",
    "loss_hv_increment",
    "min_gap_m",
    "min_time_headway_s",
    "min_ttc_s",
    "max_drac",
    "peak_follower_decel",
)
_CELL_COLUMNS = (
    "recording_id_1",
    "cluster",
    "unchanged",
    "hv_unchanged",
    "weight",
    "leader_seen_s",
    "contact",
    *(f"loss_{side}_{k}" for side in ("total", "hv", "av") for k in (1, 0)),
)
_SAMPLES = ("follower_n_samples", "recorded_n_samples")
_SPACINGS = ((0, 15), (15, 30), (30, 60), (60, np.inf))
_CLOSING = ((-np.inf, -2), (-2, 2), (2, np.inf))
_SPEEDS = tuple(pairwise((0.0, *SPEED_CLASSES, np.inf)))
_AT_START = (("t", ">", -1e-9), ("t", "<", 1e-9))
_OF_LEADER = (("role", "==", names.TARGET_LEADER),)


def situations(work: Path) -> pd.DataFrame:
    """What strata are made of: one row an event, indexed by event_id (see ``strata``)."""
    events = artefacts.read(work, "events").set_index("event_id")
    vehicles = artefacts.read(work, "vehicles").set_index(["recording_id", "vehicle_id"])["length"]
    start = artefacts.read(
        work, "event_tracks", columns=["event_id", "role", "t", "x", "vx"], where=_AT_START
    ).set_index("event_id")
    ego, first = (start[start["role"] == role] for role in (names.EGO, names.target_follower(1)))
    follower = events["follower_ids"].map(lambda ids: int(ids[0]))
    lengths = [
        vehicles.reindex(pd.MultiIndex.from_arrays([events["recording_id"], ids])).to_numpy()
        for ids in (events["ego_id"], follower)
    ]
    sites = artefacts.read(work, "recordings", columns=["recording_id", "location_id"]).drop_duplicates()
    events["location_id"] = events["recording_id"].map(sites.set_index("recording_id")["location_id"])
    events["n_followers"] = events["follower_ids"].map(len)
    events["spacing_m"] = (ego["x"] - first["x"]).reindex(events.index) + (lengths[0] - lengths[1]) / 2.0
    events["closing_mps"] = (first["vx"] - ego["vx"]).reindex(events.index)
    events["speed_mps"] = ego["vx"].reindex(events.index)
    events["weight"] = selection_weights(artefacts.read(work, "crossings")).reindex(events.index)
    leader = artefacts.read(work, "event_tracks", columns=["event_id", "role", "t"], where=_OF_LEADER)
    events["leader_seen_s"] = leader.groupby("event_id")["t"].max().clip(lower=0.0).reindex(events.index)
    around = artefacts.read(work, "responses", columns=["event_id", "density"]).drop_duplicates("event_id")
    events["density_vehpkm"] = around.set_index("event_id")["density"].astype(float).reindex(events.index)
    return events


def selection_weights(crossings: pd.DataFrame) -> pd.Series:
    """How many lane-id changes between two lanes each usable one stands for, by event_id (equations.md 12.6).

    Those of its class, direction and speed at the crossing, usable or not, over the usable ones among them.
    """
    known = crossings[crossings["direction"].ne("") & crossings["speed_mps"].notna()]
    speeds = np.searchsorted(SPEED_CLASSES, known["speed_mps"].astype(float), side="right")
    usable = known["usable"].astype(bool)
    share = usable.groupby([known["ego_class"], known["direction"], speeds]).transform("mean")
    return pd.Series(1.0 / share[usable].to_numpy(), known.loc[usable, "event_id"])


def clusters_of(events: pd.DataFrame, settings: StatisticsSettings) -> pd.Series:
    """What each event stands and falls with: its recording, or its location. events: see ``situations``."""
    return events["location_id" if settings.clusters == "location" else "recording_id"]


def strata(events: pd.DataFrame, *, traffic: bool = True) -> dict[str, pd.Series]:
    """Which events belong to each stratum: all, and the classes of each stratification (equations.md 12.3).

    events: one row an event, with ego_class, direction, n_followers, target_leader_id, leader_leaves_s, spacing_m
    (ego to first follower, front to front), closing_mps (first follower minus ego), speed_mps (ego) at t_start,
    density_vehpkm. traffic: whether the traffic state is a stratification beside the speed.
    """
    found = {"all": pd.Series(True, index=events.index)}
    for column, label in (("ego_class", "class"), ("direction", "direction"), ("n_followers", "followers")):
        for value in sorted(events[column].unique()):
            found[f"{label}={value}"] = events[column] == value
    leaves = events["leader_leaves_s"].notna()
    for label, members in (
        ("leader=none", events["target_leader_id"].isna()),
        ("leader=stays", events["target_leader_id"].notna() & ~leaves),
        ("leader=leaves its lane", leaves),
    ):
        if members.any():
            found[label] = members
    for column, label, bins in (
        ("spacing_m", "spacing", _SPACINGS),
        ("closing_mps", "closing", _CLOSING),
        ("speed_mps", "speed", _SPEEDS),
    ):
        for low, high in bins:
            inside = (events[column] >= low) & (events[column] < high)
            if inside.any():
                found[f"{label}={_range(low, high)}"] = inside
    if traffic:
        state = traffic_states(events["density_vehpkm"].to_numpy(np.float64))
        present = [word for word in TRAFFIC_STATES if (state == word).any()]
        found |= {f"traffic={word}": pd.Series(state == word, events.index) for word in present}
    return found


def _range(low: float, high: float) -> str:
    if np.isinf(low):
        return f"below {high:g}"
    return f"from {low:g}" if np.isinf(high) else f"{low:g} to {high:g}"


class PolicyLosses:
    """The losses of a population, split by accounting and policy once.

    losses: the artefact, of one follower model.
    """

    def __init__(self, losses: pd.DataFrame) -> None:
        key = ["accounting", "policy"]
        self._nobody = losses.iloc[:0].drop(columns=key).set_index("event_id")
        self._of = {
            (str(accounting), str(policy)): rows.drop(columns=key).set_index("event_id")
            for (accounting, policy), rows in losses.groupby(key, sort=False)
        }
        self._pairs: dict[tuple[str, str, str], pd.DataFrame] = {}

    def of(self, accounting: str, policy: str) -> pd.DataFrame:
        """One row an event, indexed by event_id; none where the policy was not planned."""
        return self._of.get((accounting, policy), self._nobody)

    def pair(self, accounting: str, policy: str, against: str) -> pd.DataFrame:
        """The losses of both policies side by side, suffixes _1 (policy) and _0 (against).

        contact: whether somebody drives through another under either of them.
        """
        key = accounting, policy, against
        if key not in self._pairs:
            one, other = self.of(accounting, policy), self.of(accounting, against)
            pair = pd.DataFrame()
            if not (one.empty or other.empty):
                pair = one.add_suffix("_1").join(other.add_suffix("_0"), how="inner")
                pair = pair.assign(contact=pair["contact_1"].ne("") | pair["contact_0"].ne(""))
            self._pairs[key] = pair
        return self._pairs[key].copy(deep=False)

    def in_view(self, accounting: str, policy: str, against: str) -> pd.DataFrame:
        """By event the model's error and the policies' effect in the same loss (``error_and_effect``)."""
        human, one, other = (self.of(accounting, name) for name in (names.HUMAN, policy, against))
        return error_and_effect(human, one, other)


def validation_matrix(
    events: pd.DataFrame, losses: PolicyLosses, settings: StatisticsSettings, *, seed: int, divided: bool = True
) -> pd.DataFrame:
    """Gain of the local optimum over the benchmark in every cell: form x accounting x stratum.

    divided: whether there are cells of strata beside those of all events.
    events: see ``strata``, indexed by event_id. Events without a feasible plan of either policy count in n_events
    and infeasible, not in the totals; events that could not be planned at all (listed as problems of the run), or
    whose start was not chosen, count nowhere.
    """
    bootstrap = bootstrap_of(settings, seed=seed)
    members = (
        strata(events, traffic=settings.traffic_states) if divided else {"all": pd.Series(True, events.index)}
    )
    rows = []
    for form, (benchmark, local) in (PAIRS | ROBUST_PAIRS).items():
        for accounting in names.ACCOUNTINGS:
            pair = losses.pair(accounting, local, benchmark)
            if pair.empty:
                continue
            one, other = _followers(pair)
            pair = _with_reference(pair, losses.of(accounting, names.NO_LANE_CHANGE), events, settings)
            human = losses.of(accounting, names.HUMAN).reindex(pair.index)
            columns: Arrays = {name: pair[name].to_numpy() for name in _CELL_COLUMNS}
            columns |= {name: human[name].to_numpy(float) for name in _SAMPLES}
            columns["somebody_worse"] = np.asarray((one > other * (1.0 + settings.tie_band)).any(axis=1))
            for stratum, inside in members.items():
                chosen = inside.reindex(pair.index).to_numpy(bool)
                if chosen.any():
                    row = {"form": form, "accounting": accounting, "stratum": stratum}
                    rows.append(row | _cell(_of(columns, chosen), accounting, bootstrap, settings.tie_band))
    return pd.DataFrame(rows, columns=list(TABLES["validation_matrix"].column_names))


def _with_worst_follower(pair: pd.DataFrame) -> pd.DataFrame:
    """A pair with the loss of the one follower to whom the policy does most harm, or least good."""
    if pair.empty:
        return pair
    one, other = _followers(pair)
    growth = np.where(np.isnan(one), -np.inf, one - other)
    worst = np.arange(len(pair)), growth.argmax(axis=1)
    return pair.assign(worst_follower_1=one[worst], worst_follower_0=other[worst])


def _followers(pair: pd.DataFrame) -> tuple[FloatArray, FloatArray]:
    """Each follower's loss under both policies of a pair, shape (events, most followers); NaN where there is none.

    An event with a plan of only one of the policies has none.
    """
    one, other = (padded(pair[f"loss_hv_each_{k}"].to_list()) for k in (1, 0))
    width = min(one.shape[1], other.shape[1])
    unpaired = (np.isnan(one).sum(axis=1) != np.isnan(other).sum(axis=1))[:, None]
    one, other = (np.where(unpaired, np.nan, each[:, :width]) for each in (one, other))
    return one, other


def _with_reference(
    pair: pd.DataFrame, unchanged: pd.DataFrame, events: pd.DataFrame, settings: StatisticsSettings
) -> pd.DataFrame:
    """A pair with each event's cluster, weight and filmed leader, and the losses without a lane change.

    NaN where they are not known, or somebody drives through another then.
    """
    found = unchanged.reindex(pair.index)
    apart = found["contact"].eq("") if "contact" in found else pd.Series(False, pair.index)
    totals = {f"{p}unchanged": found[f"loss_{q}"].astype(float) for p, q in (("", "total"), ("hv_", "hv"))}
    known = {name: values.where(apart) for name, values in totals.items()}
    about = {name: events[name].reindex(pair.index) for name in ("weight", "leader_seen_s")}
    return pair.assign(cluster=clusters_of(events, settings).reindex(pair.index), **known, **about)


def _of(columns: Arrays, chosen: NDArray[np.bool_]) -> Arrays:
    return {name: values[chosen] for name, values in columns.items()}


def _cell(pair: Arrays, accounting: str, bootstrap: Bootstrap, band: float) -> dict[str, Any]:
    """The numbers of a cell. pair: its events as ``validation_matrix`` has them."""
    both, contact = ~(np.isnan(pair["loss_total_1"]) | np.isnan(pair["loss_total_0"])), pair["contact"]
    solved = _of(pair, both & ~contact)
    local, benchmark, clusters = solved["loss_total_1"], solved["loss_total_0"], solved["cluster"]
    relative = local / benchmark - 1.0
    better, worse, tied = shares(relative, band)
    ratio = ratio_interval(clusters, local, benchmark, bootstrap)
    return {
        "n_events": len(contact),
        "n_recordings": len(np.unique(pair["recording_id_1"])),
        "n_clusters": len(np.unique(clusters)),
        "total_benchmark": float(benchmark.sum()),
        "total_local": float(local.sum()),
        "gain": _gain(solved, "loss_total"),
        "gain_low": 1.0 - ratio.high,
        "gain_high": 1.0 - ratio.low,
        "gain_hv": _gain(solved, "loss_hv"),
        "gain_av": _gain(solved, "loss_av"),
        "median_difference": float(np.median(relative)) if len(relative) else np.nan,
        "hodges_lehmann": hodges_lehmann(relative),
        "share_differ": 1.0 - tied,
        "share_better": better,
        "share_worse": worse,
        "share_worst_follower_worse": float(solved["somebody_worse"].mean()) if len(local) else np.nan,
        "infeasible": int((~both & ~contact).sum()),
        "contacts": int(contact.sum()),
        "share_top": share_carried(benchmark - local),
        "gain_reweighted": _reweighted(solved),
        "leader_seen_s": known_mean(pair["leader_seen_s"]),
        "share_observed": _share_observed(pair),
    } | _incremental(solved, accounting, bootstrap)


def _incremental(solved: Arrays, accounting: str, bootstrap: Bootstrap) -> dict[str, Any]:
    """What the lane change adds to the losses, and what of that the local optimum saves (equations.md 12.1).

    Where both sides are charged over the same time whatever the plan; elsewhere nothing is added up, for a shorter
    plan would add less than no lane change at all.
    """
    known = _of(solved, ~np.isnan(solved["unchanged"]))
    if accounting != names.EQUAL or not len(known["unchanged"]):
        reason = NO_REFERENCE if accounting == names.EQUAL else OTHER_TIME
        return dict.fromkeys(ADDED, np.nan) | {"incremental_reason": reason}
    benchmark, local = (known[f"loss_total_{k}"] - known["unchanged"] for k in (0, 1))
    hv = [float(np.nansum(known[f"loss_hv_{k}"] - known["hv_unchanged"])) for k in (0, 1)]
    saved, low, high = gain_of_added(benchmark, local, known["cluster"], bootstrap)
    found = (saved, low, high, float(benchmark.sum()), float(local.sum()), *hv)
    return dict(zip(ADDED, found, strict=True)) | {"incremental_reason": "" if saved == saved else ADDS_NOTHING}


def _reweighted(solved: Arrays) -> float:
    """Gain with each event counted as often as lane-id changes like it were found; NaN where that is not known."""
    known = _of(solved, ~np.isnan(solved["weight"]))
    local, benchmark = (float((known["weight"] * known[f"loss_total_{k}"]).sum()) for k in (1, 0))
    return gain(local, benchmark)


def _share_observed(pair: Arrays) -> float:
    """Share of the follower samples charged to the human's motion in which the follower was in view."""
    charged, seen = (np.nansum(pair[name]) for name in _SAMPLES)
    return float(seen / charged) if charged else np.nan


def _gain(pair: Arrays, column: str) -> float:
    return gain(np.nansum(pair[f"{column}_1"]), np.nansum(pair[f"{column}_0"]))


def summarise_losses(losses: PolicyLosses, settings: StatisticsSettings, *, seed: int) -> pd.DataFrame:
    """Paired differences of policies in every loss and safety column, under every accounting."""
    bootstrap = bootstrap_of(settings, seed=seed)
    rows = [
        {"policy": policy, "against": against, "accounting": accounting, **row}
        for accounting in sorted(names.ACCOUNTINGS)
        for policy, against in _COMPARED
        for row in _differences(
            _with_worst_follower(losses.pair(accounting, policy, against)), bootstrap, settings.tie_band
        )
    ]
    return pd.DataFrame(rows, columns=list(TABLES["summary_losses"].column_names))


def _differences(pair: pd.DataFrame, bootstrap: Bootstrap, band: float) -> Iterator[dict[str, Any]]:
    if pair.empty:
        return
    contacts = int(pair["contact"].sum())
    pair = pair[~pair["contact"].to_numpy(bool)]
    for quantity in _QUANTITIES:
        one, other = (pair[f"{quantity}_{k}"].to_numpy(float) for k in (1, 0))
        both = ~(np.isnan(one) | np.isnan(other))
        if not both.any():
            continue
        one, other, recordings = one[both], other[both], pair["recording_id_1"].to_numpy()[both]
        difference = one - other
        scale = np.where(np.abs(other) > 0.0, np.abs(other), 1.0)
        better, worse, tied = shares(difference / scale, band)
        interval = mean_interval(recordings, difference, bootstrap)
        yield {
            "quantity": quantity,
            "n": len(difference),
            "contacts": contacts,
            "mean": float(one.mean()),
            "mean_against": float(other.mean()),
            "ratio_of_sums": ratio_of_sums(one, other),
            "median_difference": float(np.median(difference)),
            "hodges_lehmann": hodges_lehmann(difference),
            "difference_low": interval.low,
            "difference_high": interval.high,
            "share_better": better,
            "share_worse": worse,
            "share_tied": tied,
        }
