"""Tables that ``highd-lc scenarios`` writes: cells, ledger, claims, arithmetic, space-time figures, waves."""

from typing import Final

from highd_lc.vocab import names
from highd_lc.vocab.published import RECORDED_FITS, TABLE_3
from highd_lc.vocab.tables.columns import ACCOUNTING, EVENT, Column, Table, count, number, word

VERDICTS: Final = ("holds", "fails", "unchanged", "no_plan", "not_valid")
"""Verdicts on a claim."""
REPRODUCED: Final = "reproduced"
NEAR: Final = "near"
NOT_REPRODUCED: Final = "not reproduced"
NO_PLAN: Final = "no plan"
NOT_VALID: Final = "not valid"
REPRODUCED_WITHIN: Final = 0.01
NEAR_WITHIN: Final = 0.10
NO_FITS: Final = "no recordings"
LEDGER_VERDICTS: Final = (REPRODUCED, NEAR, NOT_REPRODUCED, NO_PLAN, NOT_VALID, NO_FITS)
"""Verdicts on a published number: within 1 %, within 10 %, farther off, no plan, of a plan that says nothing
(``not_valid``), no drivers fitted."""

COLLISION: Final = "collision"
T_BOUND: Final = "T on its bound"
V_BOUND: Final = "v_max on its bound"

_SCENARIO = word("scenario", "1, 2_15, 2_20 (scenario 2 with the AV at 15 or 20 m/s), 3")
_POLICY = word("policy", "benchmark or local_optimum", names.POLICIES)
CELL_KEYS: Final = (
    _SCENARIO,
    word("variant", "name of the changed option, default = none"),
    word("form", "end speed of the plan", names.FORMS),
    ACCOUNTING,
    number("omega_av", "weight of the AV in the objective", nullable=False, minimum=0, maximum=1),
)
_OPTIONS = (
    word("gap_reading", "what the printed distance between AV and HV_1 is", ("centres", "bumpers")),
    number("spacing_m", "spacing of the platoon before the lane change, front to front", "m", nullable=False),
    word("pre_phase", "platoon held at its speed until the lane change, or driving by LCM", ("hold", "lcm")),
    word("aggregation", "followers' losses summed or weighted", ("sum", "weighted")),
    word("reference", "what a speed is compared with", ("desired", "one-sided", "own")),
    number("v_ref_av", "reference speed of the AV", "m/s", nullable=False),
    number("v_desire", "desired speed of the followers", "m/s", nullable=False),
    number("horizon_s", "H", "s", nullable=False),
    word("platoon_leader", "leader at the platoon's speed one spacing ahead of HV_1", ("none", "present")),
    word("leader_from", "from when HV_1 follows the AV", ("start", "crossing")),
    word("ellipse", "semi-axes of the safety ellipses", ("circumscribed", "paper")),
    count("planned_followers", "followers that the plan and the loss know"),
    number("v_max", "highest speed of a plan", "m/s", nullable=False),
    number(
        "b_max", "hardest braking that any model may command; 0 = unbounded", "m/s^2", nullable=False, minimum=0
    ),
    word("contacts", "whose contacts a plan may not have: all vehicles', or the AV's", ("all", "av")),
)
_OUTCOME = (
    number("v_start", "speed of the AV at t_start", "m/s", nullable=False),
    word("status", "of the plan", names.PLAN_STATUSES),
    number("T", "duration of the manoeuvre", "s"),
    number("x_final", "forward distance", "m"),
    number("v_end", "end speed", "m/s"),
    number("loss_av", "loss of the AV"),
    number("av_comfort", "its comfort, normalised"),
    number("av_efficiency", "its efficiency, normalised"),
    number("loss_hv", "loss of the followers"),
    number("hv_comfort", "their comfort, normalised"),
    number("hv_efficiency", "their efficiency, normalised"),
    number("loss_total", "loss_av + loss_hv"),
    number("loss_hv_unchanged", "loss of the followers over the same time without a lane change"),
    word(
        "not_valid", "why the cell says nothing: collision (its other numbers are left out), bound; empty = valid"
    ),
    number("av_v_max", "highest speed of the AV", "m/s"),
    number("av_v_end", "its speed after the manoeuvre", "m/s"),
    number("av_vy_max", "its highest lateral speed", "m/s"),
    number("av_ay_max", "its highest lateral acceleration", "m/s^2"),
    number("hv1_v_min", "lowest speed of HV_1", "m/s"),
    Column("hv_v_min", "list<float64>", "lowest speed of each follower that the plan knows [m/s]", nullable=True),
    number("min_gap_m", "smallest gap of a pair on the target lane, HV_1 behind the AV from t_start", "m"),
    number("min_time_headway_s", "smallest time headway of HV_1 behind the AV", "s"),
    number("ttt_difference_s", "total travel time over the section minus that without lane change", "s"),
    number("flow_veh_h", "Edie's flow in the rectangle", "veh/h"),
    number("speed_km_h", "Edie's speed in the rectangle", "km/h"),
    number("density_veh_km", "Edie's density in the rectangle", "veh/km"),
    Column("rectangle_time_s", "list<float64>", "time of each follower in the rectangle [s]", nullable=True),
    Column("rectangle_distance_m", "list<float64>", "distance of each follower in it [m]", nullable=True),
)

CELLS = Table(
    "scenario_cells",
    "scenario, variant, form, accounting and weight of the AV",
    ("scenario", "variant", "form", "accounting", "omega_av"),
    (*CELL_KEYS, *_OPTIONS, *_OUTCOME),
)
SWEEP = Table(
    "scenario_sweep",
    "combination of the named options (all of them)",
    CELLS.order,
    (*CELL_KEYS, *_OPTIONS, *_OUTCOME),
)

LEDGER = Table(
    "ledger",
    "published number",
    ("place",),
    (
        count("place", "its place in the paper's order"),
        word("key", "scenario, policy and quantity"),
        word("scenario", f"as in scenario_cells, or {TABLE_3} (the paper's fits)"),
        word("policy", f"benchmark or local_optimum; {RECORDED_FITS}: of fits", (*names.POLICIES, RECORDED_FITS)),
        word("quantity", "what is measured, or what is compared: local optimum against benchmark"),
        word("unit", "its unit, empty = none"),
        number("published", "as printed", nullable=False),
        number("ours", "under the default options"),
        number("ratio", "ours over published"),
        number("paper_literal", "under the printed conventions"),
        *(number(accounting, f"under the accounting {accounting}") for accounting in names.ACCOUNTINGS),
        number("nearest", "of all cells the value nearest to the printed one"),
        word("nearest_cell", "that cell: variant, form, accounting"),
        number("nearest_ratio", "that value over the published one"),
        word("verdict", "on ours", LEDGER_VERDICTS),
        word("not_valid", "why ours says nothing; empty = it does, or there is no plan"),
        word("nearest_verdict", "on the nearest", LEDGER_VERDICTS),
        word("note", "what the reader must know"),
    ),
)

_CLAIM = (
    word("claim", "short name"),
    _SCENARIO,
    word("form", "end speed of the plan", names.FORMS),
    ACCOUNTING,
    word("statement", "the direction of change that the paper states"),
    word("printed", "the printed numbers behind it"),
    word("default_verdict", "under the default options", VERDICTS),
    count("cells", "variants in which both plans exist and are valid"),
    count("holds", "variants in which the claim holds"),
    count("fails", "variants in which the opposite happens"),
    count("unchanged", "variants in which nothing changes"),
    Column("holds_under", "list<string>", "those in which it holds"),
    Column("fails_under", "list<string>", "those in which the opposite happens or nothing changes"),
    Column("no_plan_under", "list<string>", "those in which one of the two plans does not exist"),
    Column("not_valid_under", "list<string>", "those in which a plan collides or sits on a bound of T or v_max"),
)
_CLAIM_ORDER = ("claim", "scenario", "form", "accounting")
CLAIMS = Table("claims", "claim of the paper, scenario, form and accounting", _CLAIM_ORDER, _CLAIM)
SWEEP_CLAIMS = Table("sweep_claims", "the same over all combinations of the sweep", _CLAIM_ORDER, _CLAIM)

CLOSEST = Table(
    "closest",
    "scenario",
    ("scenario",),
    (
        _SCENARIO,
        word("cell", "variant, form and accounting in which most printed numbers come out together"),
        count("numbers", "printed numbers on benchmark and local optimum, without Table 1"),
        count("reproduced", "those within 1 %"),
        count("near", "those within 10 %"),
        number("median_log", "median of |ln(ours / published)|; infinite if a number is missing"),
    ),
)

ARITHMETIC = Table(
    "arithmetic",
    "statement about the paper's own numbers",
    ("key",),
    (
        word("key", "short name"),
        word("statement", "what is compared"),
        word("computation", "the line of computation"),
        number("printed", "as printed"),
        number("computed", "as computed from the other printed numbers"),
        word("unit", "unit of both"),
        word("verdict", "consistent or inconsistent"),
    ),
)

CONTACTS = Table(
    "contacts",
    "gap reading, speed of the AV and motion",
    ("scenario", "gap_reading", "motion"),
    (
        _SCENARIO,
        word("gap_reading", "what the printed 10 m between AV and HV_1 are", ("centres", "bumpers")),
        number("v_av", "speed of the AV at t_start", "m/s", nullable=False),
        word("motion", "constant speed (the AV does not react), benchmark, local_optimum"),
        word("status", "of the plan"),
        number("gap_start_m", "gap between AV and HV_1 at t_start, bumper to bumper", "m"),
        number("min_gap_m", "smallest gap between AV and HV_1, negative = collision", "m"),
        number("min_gap_at_s", "when, from t_start on", "s"),
        number("min_clearance_m", "smallest distance of the safety ellipses to any follower", "m"),
        number("hv1_peak_decel", "strongest braking of HV_1", "m/s²"),
        Column("collision", "bool", "whether HV_1 drives into the AV lengthwise; null = no plan", "", True),
    ),
)

RECTANGLE = Table(
    "rectangle",
    "scenario, policy, follower",
    ("scenario", "policy", "follower"),
    (
        _SCENARIO,
        _POLICY,
        count("follower", "rank behind the AV, 1 = nearest"),
        number("time_s", "time spent in the rectangle", "s"),
        number("distance_m", "distance driven in it", "m"),
        number("published_time_s", "Table 1 of the paper", "s"),
        number("published_distance_m", "Table 1 of the paper", "m"),
    ),
)

TRAFFIC_STATE = Table(
    "traffic_state",
    "scenario, policy and measure (Table 2)",
    ("scenario", "policy", "measure"),
    (
        _SCENARIO,
        _POLICY,
        word("measure", "flow, speed, density", ("flow", "speed", "density")),
        word("unit", "its unit"),
        number("published", "Table 2 of the paper"),
        number("from_table_1", "Edie applied to the printed totals of Table 1"),
        number("ours", "Edie applied to our trajectories, clipped exactly"),
    ),
)

WAVES = Table(
    "waves",
    "scenario and policy, or event of a recording",
    ("scenario", "policy"),
    (
        word("scenario", "scenario, or event id of a recording"),
        word("policy", "who planned the motion, or recorded"),
        number("speed_mps", "speed of the shock wave along the road, negative = upstream", "m/s"),
        number("low_mps", "lower end of its interval", "m/s"),
        number("high_mps", "upper end of its interval", "m/s"),
        count("pairs", "pairs of positions that were correlated"),
        number("correlation", "mean correlation at the best lag"),
        word("status", "estimated, or why not; collision: somebody drives into the vehicle ahead"),
    ),
)

GROWTH = Table(
    "growth",
    "drivers, scenario, policy and follower",
    ("drivers", "scenario", "policy", "follower"),
    (
        word("drivers", "whose LCM parameters the platoon has"),
        _SCENARIO,
        word("policy", "benchmark, local_optimum, no_lane_change", names.POLICIES),
        count("follower", "rank behind the AV"),
        number("dip_mps", "largest drop below the speed without lane change", "m/s"),
        number("undershoot_mps", "largest drop below the speed that lasts, the AV's at the end", "m/s"),
        number("delay_s", "delay against no lane change at the end of the run", "s"),
        Column("collision", "bool", "whether somebody drives into the vehicle ahead: nothing else is told then"),
    ),
)

STRING_STABILITY = Table(
    "string_stability",
    "drivers and speed",
    ("drivers", "speed_mps"),
    (
        word("drivers", "whose LCM parameters"),
        number("speed_mps", "equilibrium speed", "m/s", nullable=False),
        number("spacing_m", "equilibrium spacing", "m"),
        number("gain", "largest amplification of a speed oscillation from leader to follower"),
        number("frequency_hz", "frequency of that amplification, 0 = none amplified", "Hz"),
        Column("stable", "bool", "whether no frequency is amplified"),
    ),
)

RECORDED_STATE = Table(
    "recorded_state",
    "cell in space and time around a recorded lane change, on the target lane",
    ("event_id", "x_from_m", "t_from_s"),
    (
        EVENT,
        number("x_from_m", "upstream border, from the entry end of the section", "m", nullable=False),
        number("x_to_m", "downstream border", "m", nullable=False),
        number("t_from_s", "begin, from the crossing on", "s", nullable=False),
        number("t_to_s", "end", "s", nullable=False),
        number("distance_m", "distance of all vehicles in the cell", "m", nullable=False),
        number("time_s", "time of all vehicles in the cell", "s", nullable=False, minimum=0),
        number("flow_veh_h", "Edie's flow; null = nobody", "veh/h"),
        number("speed_km_h", "Edie's speed; null = nobody", "km/h"),
        number("density_veh_km", "Edie's density; null = nobody", "veh/km"),
    ),
)

TRACKED = Table(
    "scenario_tracking",
    "policy and plant",
    ("policy", "plant"),
    (
        _POLICY,
        word("plant", "planned, kinematic, multi_body"),
        word("status", "of the closed loop"),
        number("max_lateral_m", "largest lateral error", "m"),
        number("max_longitudinal_m", "largest longitudinal error", "m"),
        number("loss_av", "loss of the AV over 0..T, by finite differences"),
        number("loss_hv", "loss of the followers behind it over 0..H"),
        number("loss_total", "their sum"),
        number("hv1_v_min", "lowest speed of HV_1", "m/s"),
    ),
)

SCENARIO_TABLES: Final = (
    CELLS,
    SWEEP,
    LEDGER,
    CLAIMS,
    SWEEP_CLAIMS,
    CLOSEST,
    ARITHMETIC,
    CONTACTS,
    RECTANGLE,
    TRAFFIC_STATE,
    WAVES,
    GROWTH,
    STRING_STABILITY,
    RECORDED_STATE,
    TRACKED,
)
