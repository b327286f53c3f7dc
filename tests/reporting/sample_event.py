"""A made-up event for the tests of pages and figures: a quintic lane change, followers driven by the LCM."""

from dataclasses import replace
from typing import Any

import numpy as np

from highd_lc.core.lcm import lcm_acceleration
from highd_lc.reporting.event import Box, EventReport, FitTrace, Path, Play, Surface, TrackTrace
from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS, TABLE3_MEANS

DT, N, V0, D = 0.1, 150, 28.4, 3.6
EVENT_ID = "07-0123-00456"


def quintic(T: float, x_final: float) -> tuple[Path, np.ndarray]:
    t = np.arange(N + 1) * DT
    u = np.minimum(t / T, 1.0)
    z = 6 * u**5 - 15 * u**4 + 10 * u**3
    x = V0 * t + (x_final - V0 * T) * z
    y = D * z
    v = np.gradient(x, DT)
    a = np.gradient(v, DT)
    return Path(x, y, v, a), np.abs(np.gradient(a, DT)) + np.abs(np.gradient(np.gradient(v, DT), DT))


def follow(ego: Path, p: int) -> tuple[Path, ...]:
    front, speed, result = ego.x + 2.3, ego.v, []
    for rank in range(1, p + 1):
        x, v, a = np.empty(N + 1), np.empty(N + 1), np.zeros(N + 1)
        x[0], v[0] = -24.0 * rank, V0 + 3.0
        for k in range(N + 1):
            a[k] = lcm_acceleration(v[k], front[k] - x[k] - 2.3, speed[k], *TABLE3_MEANS.as_array())
            if k < N:
                v[k + 1] = max(0.0, v[k] + a[k] * DT)
                x[k + 1] = x[k] + v[k + 1] * DT
        result.append(Path(x, np.full(N + 1, D), v, a))
        front, speed = x + 2.3, v
    return tuple(result)


def leader() -> Path:
    t = np.arange(N + 1) * DT
    path = Path(60 + (V0 + 1) * t, np.full(N + 1, D), np.full(N + 1, V0 + 1.0), np.zeros(N + 1))
    return Path(*(np.where(t > 8.0, np.nan, values) for values in vars(path).values()))


def play(policy: str, accountings: tuple[str, ...], T: float, extra: float, p: int) -> Play:
    ego, jerk = quintic(T, V0 * T + extra)
    return Play(policy, accountings, T, ego, jerk, follow(ego, p))


def loss_row(policy: str, accounting: str, level: float, p: int) -> dict[str, Any]:
    comfort, efficiency = 3.0 + level, 20.0 - level
    hv_comfort, hv_efficiency = 4.0 - level, 30.0 + level / 2
    loss_av, loss_hv = (comfort + efficiency) / 2, (hv_comfort + hv_efficiency) / 2
    return {
        "event_id": EVENT_ID, "recording_id": 7, "policy": policy, "accounting": accounting,
        "loss_av": loss_av, "av_comfort": comfort, "av_efficiency": efficiency,
        "loss_hv": loss_hv, "hv_comfort": hv_comfort, "hv_efficiency": hv_efficiency,
        "loss_total": loss_av + loss_hv, "loss_av_dt": loss_av * DT, "loss_hv_dt": loss_hv * DT,
        "loss_hv_increment": 1.0, "loss_hv_each": [loss_hv] * p, "follower_weights": [1 / p] * p,
        "loss_hv_recorded": 11.25 if policy == names.HUMAN else float("nan"),
        "loss_hv_simulated": 10.5 if policy == names.HUMAN else float("nan"),
        "loss_hv_in_view": 9.25 if policy == names.HUMAN else 9.0 + level / 10.0,
        "loss_hv_in_view_recorded": 9.75 if policy == names.HUMAN else float("nan"),
        "recorded_n_samples": 180 if policy == names.HUMAN else 0,
        "av_comfort_raw": float("nan"), "min_gap_m": 12.3, "min_time_headway_s": 0.81,
        "min_ttc_s": float("nan"), "max_drac": 0.7, "peak_follower_decel": 1.2,
    }  # fmt: skip


def plan_row(policy: str, accounting: str, T: float, extra: float) -> dict[str, Any]:
    status = names.REFERENCE if policy in names.REFERENCE_POLICIES else names.SOLVED
    known = policy != names.NO_LANE_CHANGE
    return {
        "event_id": EVENT_ID, "recording_id": 7, "policy": policy, "accounting": accounting,
        "T": T if known else float("nan"), "x_final": V0 * T + extra if known else float("nan"),
        "v_end": V0 if known else float("nan"), "status": status, "at_bound": [], "rejected_by": {"jerk_y": 12},
        "candidates": 3888, "min_clearance_m": 6.2, "margins": {"jerk_y": 2.1, "speed_high": 15.0},
        "violations": [], "contact_after_T": False, "start_acceleration_jump": 0.1, "objective": 20.0,
    }  # fmt: skip


def fit_row(rank: int) -> dict[str, Any]:
    row = dict(zip(PARAMETERS, TABLE3_MEANS.as_array().tolist(), strict=True))
    return row | {
        "event_id": EVENT_ID, "recording_id": 7, "follower": rank, "vehicle_id": 900 + rank, "class": "Car",
        "L_replay": 5.1, "leader_length_m": 4.4, "objective": 0.021, "objective_ga": 0.024, "rmse_spacing_m": 0.31,
        "rmse_speed_mps": 0.12, "rmse_acceleration": 0.2, "nrmse_spacing": 0.01, "theil_u": 0.01, "paper_j": 0.3,
        "n_samples": 52, "at_bound": ["tau"] if rank == 1 else [], "spread": {"tau": 0.3, "A": 1.0},
        "status": names.FITTED if rank < 3 else names.CLASS_POOL, "reason": "" if rank < 3 else "too short",
        "method": "closed-loop, ga", "seed": 12,
    }  # fmt: skip


def fit_trace() -> FitTrace:
    t = np.arange(-5.2, 0.0, 0.1)
    spacing = 30 + np.sin(t)
    return FitTrace(t, spacing, spacing + 0.2, V0 + np.cos(t), V0 + 0.98 * np.cos(t))


def tracking_row(policy: str) -> dict[str, Any]:
    return {
        "event_id": EVENT_ID, "recording_id": 7, "policy": policy, "plant": "kinematic", "status": "tracked",
        "rmse_lateral_m": 0.003, "max_lateral_m": 0.009, "rmse_longitudinal_m": 0.02, "rmse_heading_rad": 0.0004,
        "max_slack": 0.0, "qp_failures": 0, "loss_av_tracked": 12.31, "loss_av_planned": 12.25, "violations": [],
        "loss_hv_tracked": 10.52, "loss_hv_planned": 10.5, "min_clearance_tracked_m": 6.19,
        "min_clearance_planned_m": 6.2,
    }  # fmt: skip


def track_trace(policy: str) -> TrackTrace:
    t = np.arange(45) * DT
    path = Path(V0 * t, 0.9 * t, V0 + 0.0 * t, 0.0 * t)
    return TrackTrace(policy, "kinematic", t, 0.004 * np.sin(t), 0.01 * np.cos(t), V0 + t, 0.01 * np.sin(t), path)


def surface() -> Surface:
    T, x = np.arange(2.0, 10.01, 0.2), np.linspace(-40, 40, 33)
    av = 18 + 0.4 * (T[:, None] - 5) ** 2 + 0.002 * (x - 3) ** 2
    hv = 12 - 0.3 * T[:, None] + 0.004 * (x - 15) ** 2
    feasible = (T[:, None] > 3.1) & (np.abs(x) < 12 * T[:, None] / 3)
    three = dict.fromkeys(names.ACCOUNTINGS)
    return Surface(T, x, {a: av for a in three}, {a: hv for a in three}, {a: feasible for a in three})


def sample_event(p: int = 3) -> EventReport:
    """The event with p followers."""
    of = {
        names.NO_LANE_CHANGE: (5.5, 0.0), names.CONSTANT: (5.5, 0.0), names.HUMAN: (6.1, 4.0),
        names.BENCHMARK: (4.2, 0.5), names.LOCAL_OPTIMUM: (5.6, 9.0), names.BENCHMARK_FREE: (4.0, 6.0),
        names.LOCAL_OPTIMUM_FREE: (5.0, 16.0),
    }  # fmt: skip
    plays = [play(policy, names.ACCOUNTINGS, T, extra, p) for policy, (T, extra) in of.items()]
    t = np.arange(N + 1) * DT
    ego, _ = quintic(6.1, V0 * 6.1 + 4.0)
    seen = replace(ego, **{name: np.where(t > 9.0, np.nan, v) for name, v in vars(ego).items()})
    plays.append(Play("recorded", names.ACCOUNTINGS, 6.1, seen, np.zeros(N + 1), follow(ego, p), measured=True))
    roles = [names.target_follower(rank) for rank in range(1, p + 1)]
    return EventReport(
        event={
            "event_id": EVENT_ID, "recording_id": 7, "ego_id": 123, "ego_class": "Car", "direction": "left",
            "origin_lane": 1, "target_lane": 2, "start_frame": 400, "crossing_frame": 456, "end_frame": 552,
            "frame_rate": 25.0, "duration_s": 6.08, "lateral_shift_m": D, "peak_lateral_speed_mps": 1.1,
            "follower_ids": [901, 902, 903], "gap_ahead_m": 55.4, "leader_leaves_s": float("nan"),
            "leader_changes_s": [], "later_leader_ids": [],
        },
        v0=V0, dt=DT, divider=1.8, markings=(-1.9, 1.8, 5.5, 9.2),
        boxes={role: Box(4.6, 1.9) for role in (names.EGO, names.TARGET_LEADER, *roles)},
        others={names.TARGET_LEADER: leader()},
        observed={names.TARGET_LEADER: 70},
        leads=((0, names.TARGET_LEADER),),
        plays=tuple(plays),
        plans=tuple(plan_row(q, a, *of[q]) for q in of for a in names.ACCOUNTINGS),
        losses=tuple(loss_row(q, a, 0.2 * i, p) for i, q in enumerate(of) for a in names.ACCOUNTINGS),
        fits=tuple(fit_row(rank) for rank in range(1, p + 1)),
        fit_traces={1: fit_trace(), 2: fit_trace()},
        tracking=(tracking_row(names.BENCHMARK), tracking_row(names.LOCAL_OPTIMUM)),
        track_traces=(track_trace(names.BENCHMARK), track_trace(names.LOCAL_OPTIMUM)),
        surface=surface(),
        provenance=(("code", "0.1.0"), ("seed", "1")),
    )  # fmt: skip


_LOSSES = (
    "loss_av", "av_comfort", "av_efficiency", "loss_hv", "hv_comfort", "hv_efficiency", "loss_total",
    "loss_hv_increment", "loss_hv_in_view", "min_gap_m",
)  # fmt: skip


def infeasible_event() -> EventReport:
    """No plan under the primary accounting for the fixed form."""
    report = sample_event()

    def plan(row):
        if row["policy"] not in names.FIXED_POLICIES:
            return row
        nothing = {"T": np.nan, "x_final": np.nan, "v_end": np.nan, "status": names.INFEASIBLE}
        counts = {"jerk_y": 1200, "clearance_target_leader": 34}
        return {**row, **nothing, "candidates": 3888, "rejected_by": counts, "margins": {"jerk_y": -0.75}}

    def loss(row):
        if row["policy"] not in names.FIXED_POLICIES:
            return row
        numbers = {name: np.nan for name in _LOSSES}
        return {**row, **numbers, "loss_hv_each": [], "follower_weights": []}

    surface = report.surface
    assert surface is not None
    nothing = {accounting: np.zeros_like(mask) for accounting, mask in surface.feasible.items()}
    return replace(
        report,
        surface=replace(surface, feasible=nothing),
        plans=tuple(map(plan, report.plans)),
        losses=tuple(map(loss, report.losses)),
        plays=tuple(p for p in report.plays if p.policy not in names.FIXED_POLICIES),
    )


def unplanned_event() -> EventReport:
    """An event whose planning failed: nothing but what was recorded and fitted."""
    report = sample_event()
    recorded = tuple(p for p in report.plays if p.measured)
    return replace(report, plans=(), losses=(), tracking=(), plays=recorded, track_traces=(), surface=None)


def replanned_event() -> EventReport:
    """The event with a drive whose plan changes after 2 s."""
    report = sample_event()
    own = report.plays[-2]
    plans = ((0.0, own.ego.x[:61:5], own.ego.y[:61:5]), (2.0, own.ego.x[20:41:5], own.ego.y[20:41:5]))
    policy, only = names.LOCAL_OPTIMUM_REPLANNED, (names.PRIMARY_ACCOUNTING,)
    return replace(report, plays=(*report.plays, replace(own, policy=policy, accountings=only, plans=plans)))
