"""Columns of the closed loop: what comes of plans that are made anew while the AV drives (equations.md 7.5)."""

from typing import Final

from highd_lc.vocab import names
from highd_lc.vocab.tables.columns import EVENT, RECORDING, Column, Table, count, number, word

RECORDED_DRIVE: Final = "recorded"
"""Status and followers of the human's row, beside the statuses of a drive and the follower models."""

_DRIVER = word(
    "policy", "who drives; human: as recorded, for contacts alone", (*names.REPLANNED_POLICIES, names.HUMAN)
)

CLOSED_LOOP = Table(
    "closed_loop",
    "event of the closed loop's sample and policy: the drive from t_start to H. Solve times differ from run to "
    "run: solve_ms_median and solve_ms_p99 of every drive stand in run.log beside the artefacts",
    ("recording_id", "event_id", "policy"),
    (
        EVENT,
        RECORDING,
        _DRIVER,
        word("followers", "follower model by which the AV predicts the followers"),
        word("world", "follower model that drives them; recorded: nobody does"),
        word("leaders", "how the AV predicts leaders; they move as recorded"),
        word("status", "what became of the lane change", (*names.DRIVE_STATUSES, RECORDED_DRIVE)),
        word("reason", "constraint that forbade a plan, where the lane change was given up or never begun"),
        count("contacts", "other vehicles touched, by box in a lane or by ellipse, up to seen_s"),
        Column("contact_cause", "list<string>", "who drives through whom; clearance_<role>: touched ellipse"),
        Column(
            "contact_reason",
            "list<string>",
            "of each of them: start: too near at t_start already; leaders, followers: they do otherwise than "
            "predicted; follower_model: where nobody changes lane too; foreseen: who knows all that comes has it "
            "too; recorded",
        ),
        Column("aborted", "bool", "whether the AV turned back to the lane that it came from"),
        count("replans", "decisions, the first plan included"),
        count("new_plans", "decisions for another plan than the one driven, the first one included"),
        count("freed", "decisions for a plan of another end speed, as no other was permitted"),
        count("relaxed", "decisions for a plan that keeps the ellipses, not the safety profile, as none does"),
        count("pressed", "decisions for the plan that touches somebody latest, as each touches somebody"),
        count("held", "decisions to drive the last plan on, as none is better"),
        number("delay_s", "from t_start to the start of the manoeuvre; null without one", "s", minimum=0),
        number("T", "duration of the manoeuvre as driven, the way back of one given up included", "s", minimum=0),
        number("seen_s", "time over which contacts could be seen: H; of the human while all are in view", "s"),
        number("loss_av", "loss of the AV as driven, accounting equal; null after a contact", minimum=0),
        number("loss_hv", "followers' loss behind it, accounting equal; null after a contact", minimum=0),
        number("loss_foresight", "loss of both under the plan of who knows what comes, driven alike", minimum=0),
        number("regret", "loss_av + loss_hv - loss_foresight; null where either did not change lane, or touched"),
        number("min_clearance_m", "smallest distance of the AV's ellipse to another; negative: overlap", "m"),
        number("min_gap_m", "smallest gap on the lane", "m"),
        number("min_ttc_s", "shortest time to collision", "s", minimum=0),
        number("max_drac", "largest deceleration rate to avoid a crash", "m/s²", minimum=0),
        number("max_lateral_m", "largest lateral tracking error; null where nothing was tracked", "m", minimum=0),
    ),
)

CLOSED_LOOP_REPLANS = Table(
    "closed_loop_replans",
    "event of the closed loop's sample, policy and decision: what the AV would drive from then on",
    ("recording_id", "event_id", "policy", "t"),
    (
        EVENT,
        RECORDING,
        word("policy", "who drives", names.REPLANNED_POLICIES),
        number("t", "time of the decision from t_start on", "s", nullable=False, minimum=0),
        word("verdict", "what was decided", names.VERDICTS),
        word("binding", "constraint that forbids a plan; empty where there is a permitted one"),
        number("T", "duration of the plan from now on; null while it waits", "s", minimum=0),
        number("x", "place of the planned point now, from its place at t_start", "m", nullable=False),
        number("y", "across; null while it waits, as all that follows", "m"),
        number("v", "forward speed now", "m/s"),
        number("ax", "forward acceleration now", "m/s²"),
        number("vy", "lateral speed now", "m/s"),
        number("ay", "lateral acceleration now", "m/s²"),
        number("x_final", "way of the plan along the lane", "m"),
        number("y_final", "y at its end: of the target lane, or 0 on the way back", "m"),
        number("v_end", "forward speed at its end", "m/s"),
        number("objective", "joint objective from now to H; null of a plan that is not permitted, or a way back"),
    ),
)

CLOSED_LOOP_MOTIONS = Table(
    "closed_loop_motions",
    "event of the closed loop's sample, policy and role that the drive moves: every 0.1 s from t_start to H",
    ("recording_id", "event_id", "policy", "role"),
    (
        EVENT,
        RECORDING,
        word("policy", "who drives", names.REPLANNED_POLICIES),
        word("role", "ego or target_follower_<rank>"),
        Column("x", "list<float64>", "box centre, from the ego's at t_start forward [m]"),
        Column("y", "list<float64>", "box centre, left of the ego's at t_start [m]"),
        Column("v", "list<float64>", "speed [m/s]"),
        Column("a", "list<float64>", "forward acceleration [m/s²]"),
        Column("jerk", "list<float64>", "|jx| + |jy| charged to the AV [m/s³]; empty of a follower"),
    ),
)

CLOSED_LOOP_TABLES: Final = (CLOSED_LOOP, CLOSED_LOOP_REPLANS, CLOSED_LOOP_MOTIONS)
