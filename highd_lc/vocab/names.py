"""Every fixed word of the tables: roles, policies, accountings, statuses, reasons."""

from typing import Final

# Roles of the vehicles of an event (equations.md 11.3).
EGO: Final = "ego"
ORIGIN_LEADER: Final = "origin_leader"
ORIGIN_FOLLOWER: Final = "origin_follower"
TARGET_LEADER: Final = "target_leader"
TARGET_FOLLOWER: Final = "target_follower"


def target_follower(rank: int) -> str:
    """Role of the follower of that rank on the target lane, 1 = nearest to the ego."""
    return f"{TARGET_FOLLOWER}_{rank}"


def target_leader(rank: int) -> str:
    """Role of the leaders of the target lane in the order of time: 1 = at t_start, 2 = after that one left it."""
    return TARGET_LEADER if rank == 1 else f"{TARGET_LEADER}_{rank}"


def through(follower: str, leader: str) -> str:
    """A contact: the follower's front is past the rear bumper of its leader in the same lane. Both are roles."""
    return f"{follower}_through_{leader}"


# Policies (equations.md 6).
NO_LANE_CHANGE: Final = "no_lane_change"
CONSTANT: Final = "constant"
HUMAN: Final = "human"
BENCHMARK: Final = "benchmark"
LOCAL_OPTIMUM: Final = "local_optimum"
BENCHMARK_FREE: Final = "benchmark_free"
LOCAL_OPTIMUM_FREE: Final = "local_optimum_free"
BENCHMARK_START: Final = "benchmark_start"
LOCAL_OPTIMUM_START: Final = "local_optimum_start"
BENCHMARK_FREE_START: Final = "benchmark_free_start"
LOCAL_OPTIMUM_FREE_START: Final = "local_optimum_free_start"
LOCAL_OPTIMUM_ROBUST: Final = "local_optimum_robust"
LOCAL_OPTIMUM_ROBUST_FREE: Final = "local_optimum_robust_free"
REFERENCE_POLICIES: Final = (NO_LANE_CHANGE, CONSTANT, HUMAN)
FIXED_POLICIES: Final = (BENCHMARK, LOCAL_OPTIMUM)
FREE_POLICIES: Final = (BENCHMARK_FREE, LOCAL_OPTIMUM_FREE)
# The local optimum of who does not know the followers (equations.md 7.4), with a fixed and with a free end speed.
ROBUST_POLICIES: Final = (LOCAL_OPTIMUM_ROBUST, LOCAL_OPTIMUM_ROBUST_FREE)
POLICIES: Final = (
    *REFERENCE_POLICIES,
    *FIXED_POLICIES,
    *FREE_POLICIES,
    BENCHMARK_START,
    LOCAL_OPTIMUM_START,
    BENCHMARK_FREE_START,
    LOCAL_OPTIMUM_FREE_START,
    *ROBUST_POLICIES,
)

# Policies that plan anew while they drive (equations.md 7.5): they stand in the closed loop's tables alone.
BENCHMARK_REPLANNED: Final = "benchmark_replanned"
LOCAL_OPTIMUM_REPLANNED: Final = "local_optimum_replanned"
LOCAL_OPTIMUM_ROBUST_REPLANNED: Final = "local_optimum_robust_replanned"
REPLANNED_POLICIES: Final = (BENCHMARK_REPLANNED, LOCAL_OPTIMUM_REPLANNED, LOCAL_OPTIMUM_ROBUST_REPLANNED)

# Forms of the plan: end speed equal to the start speed, or free (equations.md 2.2).
FIXED: Final = "fixed"
FREE: Final = "free"
FORMS: Final = (FIXED, FREE)
# The same, with the moment of the start and the gap as further unknowns.
START: Final = "start"
FREE_START: Final = "free_start"
START_FORMS: Final = (START, FREE_START)
# The fixed and the free form as planned by who does not know the followers.
ROBUST: Final = "robust"
ROBUST_FREE: Final = "robust_free"
ROBUST_FORMS: Final = (ROBUST, ROBUST_FREE)

# Gaps on the target lane: the recorded one, behind a follower that passes, ahead of the target leader.
RECORDED_GAP: Final = "recorded"
GAP_AHEAD: Final = f"ahead_of_{TARGET_LEADER}"


def gap_behind(rank: int) -> str:
    """The gap behind the follower of that rank on the target lane."""
    return f"behind_{target_follower(rank)}"


# Accountings: over which time each side is charged (equations.md 4.6).
PAPER: Final = "paper"
FOLLOWER_HORIZON: Final = "follower_horizon"
EQUAL: Final = "equal"
ACCOUNTINGS: Final = (PAPER, FOLLOWER_HORIZON, EQUAL)
PRIMARY_ACCOUNTING: Final = EQUAL

# Statuses of a plan.
SOLVED: Final = "solved"
REFERENCE: Final = "reference"
INFEASIBLE: Final = "infeasible"
INFEASIBLE_AT_START: Final = "infeasible_at_start"
CONTACT: Final = "contact"
# Of somebody else's planner that raised an error, or whose motion cannot be used.
FAULTY: Final = "faulty"
PLAN_STATUSES: Final = (SOLVED, REFERENCE, CONTACT, INFEASIBLE, INFEASIBLE_AT_START)

# What the AV does that may not change lane as a policy asks (equations.md 5.9): it waits, or stays in its lane.
WAIT: Final = "wait"
FALLBACKS: Final = ("", WAIT, NO_LANE_CHANGE)

# Outcomes of a closed loop: the lane change was made, given up on the way, or never begun.
CHANGED: Final = "changed_lane"
ABORTED: Final = "aborted"
NEVER_BEGUN: Final = "never_begun"
DRIVE_STATUSES: Final = (CHANGED, ABORTED, NEVER_BEGUN)
# What comes of planning anew (equations.md 7.5): another plan, or the one that is driven. Where none is permitted:
# back to the lane it came from, a plan of another end speed, one that keeps the ellipses alone, the one that
# touches somebody latest, the last one all the same. Before a manoeuvre has begun: not yet.
REPLANNED: Final = "new_plan"
KEPT: Final = "kept"
TURNED_BACK: Final = "turned_back"
FREED: Final = "freed_speed"
RELAXED: Final = "ellipses_alone"
LATEST: Final = "latest_contact"
HELD: Final = "held"
WAITED: Final = "waited"
VERDICTS: Final = (REPLANNED, KEPT, TURNED_BACK, FREED, RELAXED, LATEST, HELD, WAITED)

# Why there is a contact (equations.md 5.3). Of a tracked drive: only the car beside its plan has it; the model of
# the followers has it where nobody changes lane too; the plan has it as well. Of the closed loop: t_start is too
# near already; who knows all that comes has it too; leaders, or followers, do otherwise than predicted.
BY_TRACKING: Final = "tracking"
BY_FOLLOWER_MODEL: Final = "follower_model"
BY_PLAN: Final = "plan"
BY_START: Final = "start"
BY_FORESIGHT: Final = "foreseen"
BY_LEADERS: Final = "leaders"
BY_FOLLOWERS: Final = "followers"
BY_RECORDING: Final = "recorded"
TRACKING_CAUSES: Final = (BY_TRACKING, BY_FOLLOWER_MODEL, BY_PLAN)
LOOP_CAUSES: Final = (BY_START, BY_LEADERS, BY_FOLLOWERS, BY_FOLLOWER_MODEL, BY_FORESIGHT, BY_RECORDING)

# Statuses of a fit of the LCM (equations.md 9.8).
FITTED: Final = "fitted"
CLASS_POOL: Final = "class_pool"
POOL: Final = "pool"
TABLE3: Final = "table3"
FIT_STATUSES: Final = (FITTED, CLASS_POOL, POOL, TABLE3)

# Follower models (equations.md 3): nothing happens; the drivers' own fits and means; the population.
CONSTANT_SPEED: Final = "constant_speed"
DECAYING_ACCELERATION: Final = "decaying_acceleration"
DRIFT: Final = "drift"
NAIVE_MODELS: Final = (CONSTANT_SPEED, DECAYING_ACCELERATION, DRIFT)
OWN_FIT: Final = "own_fit"
MEAN: Final = "mean"
IDM: Final = "idm"
POPULATION: Final = "population"
# Nobody's here: SUMO's drivers, in whose traffic chosen events are replayed.
SUMO: Final = "sumo"
# Families of their commands.
NO_COMMAND: Final = "none"
LCM: Final = "lcm"
FAMILIES: Final = (NO_COMMAND, LCM, IDM)
FUNCTION: Final = "function"

# Vehicle classes as HighD writes them.
CAR: Final = "Car"
TRUCK: Final = "Truck"
CLASSES: Final = (CAR, TRUCK)

LEFT: Final = "left"
RIGHT: Final = "right"

# Reasons why a lane-id change is not a usable event; the order is the order in which they are tested.
OUTSIDE_MARKINGS: Final = "outside_markings"
NOT_ADJACENT: Final = "not_adjacent"
FLICKER: Final = "flicker"
RETURNED: Final = "returned"
CUT_BEFORE_START: Final = "cut_before_start"
CUT_AFTER_END: Final = "cut_after_end"
SECOND_CHANGE: Final = "second_change"
SMALL_SHIFT: Final = "small_shift"
TRACK_HOLE: Final = "track_hole"
FOLLOWER_AHEAD: Final = "follower_ahead"
NO_TARGET_FOLLOWER: Final = "no_target_follower"
REASONS: Final = (
    OUTSIDE_MARKINGS,
    NOT_ADJACENT,
    FLICKER,
    TRACK_HOLE,
    RETURNED,
    CUT_BEFORE_START,
    CUT_AFTER_END,
    SECOND_CHANGE,
    SMALL_SHIFT,
    FOLLOWER_AHEAD,
    NO_TARGET_FOLLOWER,
)
