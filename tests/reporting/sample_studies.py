"""Made-up tables of the studies for the tests of the robustness page."""

from dataclasses import replace
from itertools import product

import numpy as np
import pandas as pd

from highd_lc.reporting.pages_studies import StudyTables
from highd_lc.vocab import names
from highd_lc.vocab.policy import CHOOSING_START
from highd_lc.vocab.tables import TABLES
from highd_lc.vocab.tables.robust import EXPECTED, WORST
from highd_lc.vocab.tables.studies import FRONT, SECOND_OPINIONS, SWEEP


def gains(k: int) -> dict[str, float]:
    """The columns that all tables of gains share; every k differs."""
    gain = 0.004 * (k + 1) * (-1) ** (k % 3 == 2)
    return {
        "n_events": 40 + k, "n_recordings": 6, "infeasible": k % 4, "contacts": 0, "total_benchmark": 900.0,
        "total_local": 900.0 * (1 - gain), "gain": gain, "gain_low": gain - 0.003, "gain_high": gain + 0.003,
        "gain_av": -gain, "gain_hv": 2 * gain, "share_better": 0.75, "share_worse": 0.125, **seen(k),
    }  # fmt: skip


def seen(k: int) -> dict[str, float]:
    """Error over effect: every third row may be quoted, every third has an unknown error."""
    ratio = (0.5, 2.5, np.nan)[k % 3]
    return {"effect": 0.4, "error": 0.4 * ratio, "error_over_effect": ratio}


def gain_map() -> pd.DataFrame:
    """Tiles with open ends, one of them empty."""
    spacings, closings = (0.0, 20.0, 60.0, np.nan), (np.nan, 0.0, 4.0, np.nan)
    cells = [
        {"form": f, "accounting": a, "spacing_low_m": spacings[i], "spacing_high_m": spacings[i + 1],
         "closing_low_mps": closings[j], "closing_high_mps": closings[j + 1], "share_events": 1 / 9,
         **gains(3 * i + j)}
        for f in names.FORMS for a in names.ACCOUNTINGS for i in range(3) for j in range(3)
    ]  # fmt: skip
    frame = pd.DataFrame(cells)
    frame.loc[frame["n_events"] == 44, "gain"] = np.nan
    return frame


def studies(**changes: object) -> StudyTables:
    """What the robustness page shows."""
    cells = [(f, a) for f in names.FORMS for a in names.ACCOUNTINGS]
    levels = ("failed", "worse_1", "worse_01", "better_01")
    frames = {
        "cross_scores": [
            {"form": f, "planned_with": "own_fit", "scored_with": m, "optimised": a, "scored": b, "touching": 1,
             "peak_benchmark": 2.5, "peak_local": 2.0, **gains(i)}
            for i, ((f, a), b, m) in enumerate(
                product(cells, names.ACCOUNTINGS, ("own_fit", "table3", *SECOND_OPINIONS))
            )
        ],
        "horizon_sensitivity": [
            {"horizon_s": h, "form": f, "accounting": a, **gains(i)}
            for i, (h, (f, a)) in enumerate(product((5.0, 8.0, 10.0, 15.0), cells))
        ],
        "leave_one_out": [
            {"form": f, "accounting": a, "location_id": s, "n_left_out": 9, **gains(i)}
            for i, ((f, a), s) in enumerate(product(cells, (1, 2)))
        ],
        "uncertainty": [
            {"event_id": e, "recording_id": 1, "form": f, "accounting": a, "n_replanned": 20, "infeasible": 0,
             "gain": 0.01, "gain_mean": 0.008 + 0.001 * i, "gain_low": -0.01, "gain_high": 0.03,
             "share_better": 0.8, "share_worse": 0.1, "n_kept": 20, "gain_kept_mean": 0.007,
             "share_kept_better": 0.7, "share_kept_worse": 0.2, "T_deviation": 0.3, "spread_known": 0.5}
            for i, (e, (f, a)) in enumerate(product(("01-0001-00107", "02-0002-00114"), cells))
        ],
        "solver_summary": [
            {"form": f, "omega_av": w, "n": 36, "excess_sqp_max": 0.02, "excess_sqp_min": -0.0001}
            | {f"share_{s}_{k}": 0.25 for s in ("sqp", "single") for k in levels}
            for f in names.FORMS for w in (0.5, 1.0)
        ],
        "tracking_summary": [
            {"policy": p, "plant": c, "n_driven": 39, "not_driven": 1, "lost": 0, "softened": 0, "qp_failures": 0,
             "rmse_lateral_median_m": 0.002, "rmse_lateral_largest_m": 0.004, "max_lateral_m": 0.01,
             "loss_av_planned": 12.0, "loss_av_tracked": 12.125, "loss_hv_planned": 9.0, "loss_hv_tracked": 9.25,
             "share_violating": 0.25, "share_touching": 0.125, "share_touching_planned": 0.0}
            for c in ("kinematic", "multi_body") for p in (names.HUMAN, *names.FIXED_POLICIES)
        ],
        "tracking_contacts": [
            {"followers": "own_fit", "plant": "kinematic", "contact": "target_follower_1_through_ego",
             "cause": names.BY_TRACKING, "n_events": 1, "n_plans": 8, "n_references": 2},
        ],
        "worse_for_somebody": [
            {"event_id": f"01-{k:04d}-00100", "recording_id": 1, "form": names.FIXED, "accounting": names.EQUAL,
             "who": names.target_follower(1 + k % 3), "loss_benchmark": 10.0, "loss_local": 10.0 + 0.1 * k,
             "increase": 0.01 * k, "error": 0.3, "error_over_effect": 3.0 / k}
            for k in range(1, 61)
        ],
        "robust_summary": [
            {"form": f, "accounting": a, "policy": p, "scored_with": m, "skilful": m != "table3", "n_events": 40,
             "n_compared": 38, "gain": 0.004 * (1 + i % 3), "gain_low": 0.001, "gain_high": 0.01,
             "beyond_plain": 0.0 if p in names.FIXED_POLICIES + names.FREE_POLICIES else 0.002,
             "beyond_low": -0.001, "beyond_high": 0.004}
            for i, ((f, pair), a, m) in enumerate(product(
                ((names.FIXED, (names.LOCAL_OPTIMUM, names.LOCAL_OPTIMUM_ROBUST)),
                 (names.FREE, (names.LOCAL_OPTIMUM_FREE, names.LOCAL_OPTIMUM_ROBUST_FREE))),
                names.ACCOUNTINGS, ("population", "table3", EXPECTED, WORST)))
            for p in pair
        ],
        "situation_ranking": [
            {"form": f, "policy": p, "spacing_low_m": 20.0 * k, "spacing_high_m": 20.0 * k + 20.0,
             "closing_low_mps": np.nan, "closing_high_mps": 0.0, "n_events": 5 + k,
             "gain_expected": 0.01 - 0.002 * k, "gain_worst": 0.004 - 0.003 * k, "share_positive": 0.5,
             "rank_expected": k + 1, "rank_worst": k + 1,
             **seen(k)}
            for f, p in ((names.FIXED, names.LOCAL_OPTIMUM), (names.FREE, names.LOCAL_OPTIMUM_FREE))
            for k in range(4)
        ],
        "event_gains": [
            {"event_id": f"01-{k:04d}-00100", "recording_id": 1, "form": f, "accounting": names.EQUAL, "policy": p,
             "n_models": 3, "gain": 0.001 * k, "gain_expected": 0.0008 * k, "gain_worst": 0.0005 * k - 0.002,
             "worst_model": "own_fit"}
            for f, p in ((names.FIXED, names.LOCAL_OPTIMUM), (names.FREE, names.LOCAL_OPTIMUM_FREE))
            for k in range(1, 9)
        ],
        "sumo_summary": [
            {"policy": p, "driven_by": m, "follower": k, "n_events": 9, "contacts": 1, "n_compared": 8,
             "loss": 20.0 + k, "peak_decel": 1.5, "speed_drop_mps": 3.0 - k}
            for p in (names.HUMAN, *names.FIXED_POLICIES, names.CONSTANT) for m in ("own_fit", names.SUMO)
            for k in (1, 2)
        ],
    }  # fmt: skip
    tables = {name: pd.DataFrame(rows) for name, rows in frames.items()}
    tables["leaderboard"] = pd.DataFrame(columns=list(TABLES["leaderboard"].column_names))
    return replace(StudyTables(**tables, pareto=pareto(), pareto_summary=pareto_summary()), **changes)


def pareto() -> pd.DataFrame:
    """Fronts of two events."""
    rows = [
        {"event_id": e, "recording_id": 1, "form": form, "kind": kind, "point": k, "omega_av": w, "T": 5.0,
         "x_final": 140.0, "v_end": 28.0, "delay_s": 0.0, "gap": names.RECORDED_GAP,
         "loss_av": 20 + 0.5 * k, "loss_hv": 30 - 2 * np.sqrt(k), "knee": kind == FRONT and k == 3}
        for e in ("01-0001-00107", "02-0002-00114")
        for form in ((names.FREE, names.FREE_START) if e.startswith("01") else (names.FREE,))
        for kind, w in ((FRONT, np.nan), (SWEEP, 0.5))
        for k in range(8)
    ]  # fmt: skip
    return pd.DataFrame(rows)


def pareto_summary() -> pd.DataFrame:
    """One row an event of ``pareto``, the second without a knee."""
    rows = [
        {"event_id": e, "recording_id": 1, "form": names.FREE, "n_front": 8, "evaluations": 4000,
         "hypervolume": 0.75, "reference_av": 26.0, "reference_hv": 33.0,
         "hypervolume_sweep": 0.7625, "front_behind": 0.0005,
         "front_ahead": 0.0, "knee_loss_av": knee, "knee_loss_hv": knee, "knee_omega_low": 0.25,
         "knee_omega_high": 0.5}
        for e, knee in (("01-0001-00107", 21.5), ("02-0002-00114", np.nan))
    ]  # fmt: skip
    return pd.DataFrame(rows)


def variants() -> pd.DataFrame:
    """Rows of ``multiverse``: the run, every choice of H, followers that nobody calibrated."""
    run = {
        "variant": "run", "kind": "run", "changes": [], "followers": names.POPULATION, "leader_from": "start",
        "accounting": names.EQUAL, "horizon_s": 15.0, "v_ref_av": 33.54, "v_ref_hv": 33.54, "reference": "desired",
        "aggregation": "weighted", "comfort_scale": 8.0, "T_max": 10.0, "leaders": "recorded", "after": "lcm",
        "handover": "counted", "safety": "practice", "gain_incremental": 0.1, **gains(0),
    }  # fmt: skip
    rows = [run]
    for k, horizon in enumerate((5.0, 8.0, 10.0), start=1):
        name = f"H: {horizon:g}"
        changes = [f"loss.horizon_s = {horizon:g}"]
        rows.append(run | gains(k) | {"variant": name, "kind": "choice", "changes": changes, "horizon_s": horizon})
    nobody = {"variant": "followers: idm", "kind": "choice", "changes": [], "followers": "idm", "n_events": 0}
    unknown = dict.fromkeys(("gain", "gain_low", "gain_high", "gain_incremental"), np.nan)
    return pd.DataFrame([*rows, run | nobody | unknown], columns=list(TABLES["multiverse"].column_names))


def tiles() -> pd.DataFrame:
    """The map of chosen starts."""
    rows = []
    for policy in CHOOSING_START:
        for spacing, closing in ((np.nan, np.nan), (0.0, np.nan), (10.0, -2.0), (20.0, 4.0)):
            rows.append(
                {
                    "policy": policy, "accounting": names.EQUAL, "spacing_low_m": spacing,
                    "closing_low_mps": closing, "n_events": 7, "share_waiting": 0.25, "share_other_gap": 0.125,
                    "mean_delay_s": 0.75, "saved_objective": 0.0321, "saved_av": -0.011, "saved_hv": 0.054,
                    "saved_total": 0.0123, "share_events": 0.3,
                }
            )  # fmt: skip
    return pd.DataFrame(rows, columns=list(TABLES["start_map"].column_names))


def foresight() -> pd.DataFrame:
    """What knowing the future is worth."""
    rows = [
        {
            "policy": names.LOCAL_OPTIMUM_START, "knowledge": "replanned", "n_events": 25, "no_plan": 1,
            "touching": 2, "n_compared": 22, "mean_delay_s": 0.5, "share_waiting": 0.4, "objective": 100.0,
            "objective_recorded": 97.53, "value_of_information": 0.0247, "value_low": 0.01, "value_high": 0.04,
        }
    ]  # fmt: skip
    return pd.DataFrame(rows, columns=list(TABLES["foresight_summary"].column_names))
