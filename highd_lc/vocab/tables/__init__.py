"""Every artefact's columns, once: name, type, unit, meaning. Schemas and data dictionary derive from it."""

from typing import Final

from highd_lc.vocab import names
from highd_lc.vocab.cross_checks import CROSS_CHECKS
from highd_lc.vocab.driver import PARAMETERS, UNITS
from highd_lc.vocab.tables.closed_loop import CLOSED_LOOP_TABLES
from highd_lc.vocab.tables.columns import ACCOUNTING, EVENT, POLICY, RANK, RECORDING, VEHICLE, Column, Table
from highd_lc.vocab.tables.columns import count as _count
from highd_lc.vocab.tables.columns import number as _number
from highd_lc.vocab.tables.columns import single as _single
from highd_lc.vocab.tables.columns import word as _word
from highd_lc.vocab.tables.fits import FIT_TABLES, TRUTH
from highd_lc.vocab.tables.prediction import PREDICTION_TABLES
from highd_lc.vocab.tables.robust import ROBUST_TABLES, SUMO_TABLES
from highd_lc.vocab.tables.scenarios import SCENARIO_TABLES
from highd_lc.vocab.tables.studies import STUDY_TABLES
from highd_lc.vocab.tables.summaries import (
    EVENT_PAGES,
    LEADERBOARD,
    OTHER_PLANS,
    SAFETY_COLUMNS,
    SAFETY_TABLES,
    SUMMARY_LOSSES,
    TRACKING,
    VALIDATION_MATRIX,
)

SCHEMA_VERSION: Final = 3
PARTITIONED: Final = {"ingest": "tracks", "validate": "trajectories"}
"""Of each stage that makes one, the artefact that is too large to combine and stays divided by recording."""

_FOLLOWER_MODEL = _word("followers", "follower model that planned and scored the row (equations.md 3)")

TRACKS = Table(
    "tracks",
    "vehicle and frame",
    ("vehicle_id", "frame"),
    (
        RECORDING,
        VEHICLE,
        Column("frame", "int64", "frame of the recording, 1 = first", minimum=1),
        _number("t", "time since the recording's frame 1", "s", nullable=False, minimum=0),
        _number("x", "box centre, forward from the entry end of the section", "m", nullable=False),
        _number("y", "box centre, left from the carriageway's right edge", "m", nullable=False),
        _single("vx", "forward speed", "m/s"),
        _single("vy", "lateral speed, left positive", "m/s"),
        _single("ax", "forward acceleration", "m/s²"),
        _single("ay", "lateral acceleration, left positive", "m/s²"),
        _number("length", "length of the vehicle's box", "m", nullable=False, minimum=0),
        _number("width", "width of the vehicle's box", "m", nullable=False, minimum=0),
        Column("lane", "int64", "1 = rightmost of its carriageway; null outside the markings", "", True, 1),
        Column("leader_id", "int64", "vehicle ahead on the same lane; null = none", "", True, 1),
        Column("follower_id", "int64", "vehicle behind on the same lane; null = none", "", True, 1),
    ),
)

VEHICLES = Table(
    "vehicles",
    "vehicle",
    ("recording_id", "vehicle_id"),
    (
        RECORDING,
        VEHICLE,
        Column("driving_direction", "int64", "1 = upper carriageway, 2 = lower", minimum=1, maximum=2),
        _word("class", "Car or Truck", names.CLASSES),
        _number("length", "length of the vehicle's box", "m", nullable=False, minimum=0),
        _number("width", "width of the vehicle's box", "m", nullable=False, minimum=0),
        _count("first_frame", "first frame in view"),
        _count("last_frame", "last frame in view"),
        _number("mean_acceleration", "change of forward speed from first to last row, over time in view", "m/s²"),
        Column(
            "recorded_id",
            "int64",
            "id in the file; another than vehicle_id for what follows a hole or a jump of that id",
            minimum=0,
        ),
    ),
)

RECORDINGS = Table(
    "recordings",
    "recording and carriageway with vehicles",
    ("recording_id", "driving_direction"),
    (
        RECORDING,
        Column("driving_direction", "int64", "1 = upper carriageway, 2 = lower", minimum=1, maximum=2),
        Column("location_id", "int64", "site of the recording"),
        _word("format", "format of its files", ("highd", "ngsim", "tgsim")),
        _number("frame_rate", "frames a second", "Hz", nullable=False, minimum=0),
        Column("markings", "list<float64>", "lane markings from the right edge, ascending, first 0 [m]"),
        _number("entry_m", "smallest x that a box of the recording reaches", "m", nullable=False),
        _number("exit_m", "largest x that a box of the recording reaches", "m", nullable=False),
        _count("n_vehicles", "ids; with n_holes and n_jumps the number of rows of vehicles"),
        _count("n_trucks", "trucks among them"),
        _count("n_rows", "rows of tracks"),
        _count("n_holes", "places where a track misses frames: it is another vehicle from there on"),
        _count("n_jumps", "places where a position jumps from one frame to the next: likewise"),
        _count("n_duplicates", "identical rows that were dropped"),
        _number("share_outside", "share of rows outside the markings", minimum=0, maximum=1),
        _number("share_lane_mismatch", "share of rows whose lane is not that of their centre", minimum=0),
        _number("mean_acceleration", "mean recorded forward acceleration: the bias", "m/s²"),
        _number("mean_speed_change", "change of speed from first to last row, over time in view", "m/s²"),
        Column("bias_removed", "bool", "whether mean_acceleration was subtracted from ax"),
        _number("disagreement_entry", "mean |dx/dt - vx| in the first trimmed metres", "m/s", minimum=0),
        _number("disagreement_inner", "mean |dx/dt - vx| between the trimmed ends", "m/s", minimum=0),
        _number("disagreement_exit", "mean |dx/dt - vx| in the last trimmed metres", "m/s", minimum=0),
        Column("disagreement_profile", "list<float64>", "mean dx/dt - vx in bins of 10 m from entry_m [m/s]"),
        *(
            _number(f"share_{c.name}", f"share of vehicles whose {c.column} agrees with: {c.against}", minimum=0)
            for c in CROSS_CHECKS.values()
        ),
        Column("failed_checks", "list<string>", "cross-checks that more vehicles fail than are let pass"),
    ),
)

CROSSINGS = Table(
    "crossings",
    "lane-id change (the funnel)",
    ("recording_id", "ego_id", "crossing_frame"),
    (
        EVENT,
        RECORDING,
        Column("ego_id", "int64", "the vehicle that changes lane", minimum=0),
        _word("ego_class", "Car or Truck", names.CLASSES),
        _word("direction", "left or right; empty when a side is outside the markings", ("left", "right", "")),
        _count("crossing_frame", "first frame with the box centre in the target lane"),
        _number("speed_mps", "forward speed at crossing_frame", "m/s"),
        Column("origin_lane", "int64", "lane before; null outside the markings", "", True, 1),
        Column("target_lane", "int64", "lane after; null outside the markings", "", True, 1),
        Column("start_frame", "int64", "start by the lateral rule; null if not in view", "", True, 1),
        Column("end_frame", "int64", "end by the lateral rule; null if not in view", "", True, 1),
        Column("usable", "bool", "whether it is an event"),
        _word("reason", "why it is not; empty when usable", ("", *names.REASONS)),
    ),
)

EVENTS = Table(
    "events",
    "usable lane change",
    ("recording_id", "ego_id", "crossing_frame"),
    (
        EVENT,
        RECORDING,
        Column("ego_id", "int64", "the vehicle that changes lane", minimum=0),
        _word("ego_class", "Car or Truck", names.CLASSES),
        _word("direction", "to which side", (names.LEFT, names.RIGHT)),
        Column("origin_lane", "int64", "lane before, 1 = rightmost", minimum=1),
        Column("target_lane", "int64", "lane after, 1 = rightmost", minimum=1),
        _count("start_frame", "start by the lateral rule"),
        _count("crossing_frame", "first frame with the box centre in the target lane"),
        _count("end_frame", "end by the lateral rule"),
        _number("frame_rate", "frames a second", "Hz", nullable=False, minimum=0),
        _number("duration_s", "end minus start", "s", nullable=False, minimum=0),
        _number("lateral_shift_m", "D: y at end_frame minus y at start_frame, left positive", "m", nullable=False),
        _number("peak_lateral_speed_mps", "largest smoothed lateral speed towards the target", "m/s"),
        Column("origin_leader_id", "int64", "ahead on the origin lane at t_start; null = none", "", True, 1),
        Column(
            "origin_follower_id",
            "int64",
            "behind on the origin lane at t_start, within max_link_m; null = none",
            "",
            True,
            1,
        ),
        Column("target_leader_id", "int64", "ahead on the target lane at t_start; null = none", "", True, 1),
        Column("follower_ids", "list<int64>", "followers on the target lane at t_start, nearest first"),
        _number("gap_ahead_m", "bumper to bumper, to the target leader at t_start; null without one", "m"),
        _number("gap_behind_m", "bumper to bumper, from the first target follower at t_start", "m"),
        Column("roles_confirmed", "bool", "whether the file's leader ids say the same of all roles"),
        _number(
            "leader_leaves_s",
            "when, from t_start, the target leader is first seen off the target lane (for longer than flicker_s); "
            "from then on the next vehicle ahead leads. Null: never while in view, or no leader",
            "s",
            minimum=0,
        ),
        Column(
            "leader_changes_s",
            "list<float64>",
            "when, from t_start, each leader of the target lane has left it; the first is leader_leaves_s [s]",
        ),
        Column(
            "later_leader_ids",
            "list<int64>",
            "who leads the target lane after each of these; one fewer: nobody after the last",
        ),
    ),
)

EVENT_TRACKS = Table(
    "event_tracks",
    "event, role and native frame",
    ("recording_id", "event_id", "role", "t"),
    (
        EVENT,
        RECORDING,
        _word(
            "role",
            "ego, origin_leader, origin_follower, target_leader, target_follower_1 .. p; target_leader_2, ..: who "
            "leads the target lane after the target leader left it (events.leader_changes_s)",
        ),
        VEHICLE,
        _number("t", "(frame - start_frame) / frame rate", "s", nullable=False),
        _number("x", "box centre ahead of the ego's centre at start_frame", "m", nullable=False),
        _number("y", "box centre left of the ego's centre at start_frame", "m", nullable=False),
        _number("vx", "forward speed, raw", "m/s", nullable=False),
        _number("vy", "lateral speed, raw, left positive", "m/s", nullable=False),
        _number("ax", "forward acceleration, raw", "m/s²", nullable=False),
        _number("ay", "lateral acceleration, raw, left positive", "m/s²", nullable=False),
        Column("calibration", "bool", "whether the sample belongs to the follower's calibration window"),
    ),
)

FOLLOWERS = Table(
    "followers",
    "event and follower (one LCM fit)",
    ("recording_id", "event_id", "follower"),
    (
        EVENT,
        RECORDING,
        RANK,
        VEHICLE,
        _word("class", "Car or Truck", names.CLASSES),
        *(_number(p, f"LCM parameter {p}", UNITS[p], nullable=False) for p in PARAMETERS),
        _number("L_replay", "L moved behind the leader of the replay, within [2, 25]", "m", nullable=False),
        _number("leader_length_m", "length of the leader that L was fitted behind", "m"),
        _number("objective", "objective of the parameters kept", minimum=0),
        _number("objective_ga", "objective of the GA's best before the polish", minimum=0),
        _number("rmse_spacing_m", "closed-loop error of spacing", "m", minimum=0),
        _number("rmse_speed_mps", "closed-loop error of speed", "m/s", minimum=0),
        _number("rmse_acceleration", "closed-loop error of acceleration", "m/s²", minimum=0),
        _number("nrmse_spacing", "RMSE of spacing over its root mean square", minimum=0),
        _number("theil_u", "Theil's U of spacing", minimum=0, maximum=1),
        _number("paper_j", "the paper's one-step objective J of the parameters kept", minimum=0),
        _count("n_samples", "samples of 0.1 s in the calibration window"),
        Column("at_bound", "list<string>", "parameters that sit on a bound"),
        Column(
            "spread",
            "map<string,float64>",
            "standard deviation of each parameter over equally good starts, or over the pool's followers",
        ),
        _word("status", "where the parameters come from", names.FIT_STATUSES),
        _word("reason", "why the follower was not fitted; empty when fitted"),
        _word("method", "objective and optimiser"),
        Column("seed", "int64", "seed of this fit, from event and follower"),
    ),
)

PLANS = Table(
    "plans",
    "event, follower model, policy and accounting",
    ("recording_id", "event_id", "followers", "policy", "accounting"),
    (
        EVENT,
        RECORDING,
        _FOLLOWER_MODEL,
        POLICY,
        ACCOUNTING,
        _number("T", "duration of the manoeuvre, a multiple of 0.1 s; null when infeasible", "s"),
        _number("x_final", "forward distance from the manoeuvre's start to its end; null when infeasible", "m"),
        _number("v_end", "speed at the end of the manoeuvre; null when infeasible", "m/s"),
        _number("delay_s", "wait from t_start to the manoeuvre's start; null when infeasible", "s", minimum=0),
        _number("v_start", "speed at the manoeuvre's start; null when infeasible", "m/s"),
        _word("gap", "recorded, behind a follower that passes, ahead of the target leader; empty = infeasible"),
        _word("status", "outcome of the planner", names.PLAN_STATUSES),
        Column(
            "at_bound",
            "list<string>",
            "T or delay_s on a bound of the search; T of a reference that lasts longer than H and is cut there; "
            "constraints with no margin left",
        ),
        Column("rejected_by", "map<string,int64>", "candidates that each constraint rejected"),
        Column("candidates", "int64", "candidates looked at", minimum=0),
        _number("min_clearance_m", "smallest distance between ellipses over the accounted time", "m"),
        Column("margins", "map<string,float64>", "margin of each constraint; the closest one when infeasible"),
        Column(
            "moments",
            "map<string,float64>",
            "when the margin of a constraint of the safety profile is smallest [s from t_start]",
        ),
        _word(
            "fallback",
            "what the AV does instead where the policy's lane change is not allowed: wait, or stay in its lane",
            names.FALLBACKS,
        ),
        _word("binding", "the constraint that forbids it; empty without a fallback"),
        Column("violations", "list<string>", "constraints that a reference policy violates"),
        _word("contact", "who drives through whom, over the accounted time, as a_through_b; empty = nobody"),
        Column("contact_after_T", "bool", "whether ellipses overlap between T and H", "", True),
        _number(
            "braking_after_T", "strongest braking of the AV between T and H, positive; no limit holds it", "m/s²"
        ),
        _number("start_acceleration_jump", "recorded acceleration at t_start minus the plan's 0", "m/s²"),
        _number("objective", "joint objective that the policy minimised", minimum=0),
    ),
)

LOSSES = Table(
    "losses",
    "event, follower model, policy and accounting",
    ("recording_id", "event_id", "followers", "policy", "accounting"),
    (
        EVENT,
        RECORDING,
        _FOLLOWER_MODEL,
        POLICY,
        ACCOUNTING,
        _word("contact", "who drives through whom (see plans): there are no losses then; empty = nobody"),
        _number("loss_av", "0.5 av_comfort + 0.5 av_efficiency", minimum=0),
        _number("av_comfort", "AV's jerk sum over N_c", minimum=0),
        _number("av_efficiency", "AV's speed-difference sum over N_e", minimum=0),
        _number("loss_hv", "followers' loss, aggregated", minimum=0),
        _number("hv_comfort", "followers' comfort, aggregated, over N_c", minimum=0),
        _number("hv_efficiency", "followers' efficiency, aggregated, over N_e", minimum=0),
        _number("loss_total", "loss_av + loss_hv, unweighted", minimum=0),
        _number("loss_av_dt", "loss_av times dt: free of the sampling step", "s", minimum=0),
        _number("loss_hv_dt", "loss_hv times dt: free of the sampling step", "s", minimum=0),
        _number("loss_hv_increment", "loss_hv minus that of no lane change over the same time"),
        Column(
            "loss_hv_each",
            "list<float64>",
            "loss of each follower, nearest first, unweighted; empty without a plan",
        ),
        Column("follower_weights", "list<float64>", "weights of equation 17, nearest first; empty without a plan"),
        _number("loss_hv_recorded", "followers' loss from their recorded motion, aggregated", minimum=0),
        _number("loss_hv_simulated", "simulated counterpart of loss_hv_recorded over the same samples", minimum=0),
        _number(
            "loss_hv_in_view",
            "followers' loss while filmed in their lanes behind the recorded ego, at most 8 s; smoothed comfort",
            minimum=0,
        ),
        _number("loss_hv_in_view_recorded", "the same of their recorded motion (human only)", minimum=0),
        _count("recorded_n_samples", "samples behind loss_hv_recorded: follower and ego both in view"),
        _count("follower_n_samples", "follower samples charged; 0 when infeasible"),
        _number("av_comfort_raw", "AV's comfort from the recorded, unsmoothed path (human only)", minimum=0),
        _number(
            "min_gap_m", "smallest gap of a target-lane pair; negative: side by side at the AV's crossing", "m"
        ),
        _number("min_time_headway_s", "smallest time headway of a target-lane pair", "s"),
        _number(
            "min_ttc_s", "smallest time to collision of a target-lane pair at a positive gap; null if none", "s"
        ),
        _number(
            "max_drac",
            "largest deceleration rate to avoid a crash, at a positive gap; null if none closes in",
            "m/s²",
        ),
        _number("peak_follower_decel", "strongest braking of a follower, positive", "m/s²"),
        *SAFETY_COLUMNS,
    ),
)


TABLES: Final = {
    table.name: table
    for table in (
        TRACKS, VEHICLES, RECORDINGS, CROSSINGS, EVENTS, EVENT_TRACKS, FOLLOWERS, PLANS, LOSSES,
        VALIDATION_MATRIX, TRACKING, SUMMARY_LOSSES, EVENT_PAGES, *FIT_TABLES, *PREDICTION_TABLES,
        *SAFETY_TABLES, *STUDY_TABLES, *ROBUST_TABLES, *CLOSED_LOOP_TABLES, *SUMO_TABLES,
        OTHER_PLANS, LEADERBOARD, *SCENARIO_TABLES, TRUTH,
    )
}  # fmt: skip
