"""Columns of how followers are judged: models, prediction behind the recorded ego, dose-response, externality."""

from typing import Final

from highd_lc.vocab import names
from highd_lc.vocab.tables.columns import (
    ACCOUNTING,
    EVENT,
    RANK,
    RECORDING,
    VEHICLE,
    Column,
    Table,
    count,
    number,
    word,
)

RECORDED: Final = "recorded"
OBSERVED: Final = "observed"
CONTROL: Final = "control"
UNRELATED: Final = "unrelated"

FEW_RECORDINGS: Final = "fewer than five recordings"
FEW_EVENTS: Final = "fewer than five events"
OVER_RECORDINGS: Final = "recordings"
OVER_EVENTS: Final = "events"
AIMS: Final = {
    "skill_constant": (0.50, float("nan")),
    "skill_naive": (0.20, float("nan")),
    "recordings_below": (float("nan"), 0.0),
    "bias": (-0.1, 0.1),
    "dose_response": (0.75, float("nan")),
    "peak_decel": (float("nan"), float("nan")),
    "comfort": (float("nan"), float("nan")),
    "externality": (float("nan"), float("nan")),
    "contacts": (float("nan"), float("nan")),
}
"""What a model has to reach: the least and the largest value; NaN: none, or given by what was recorded.

dose_response: the share of classes within the band.
"""

_MODEL = word("model", "follower model (equations.md 3)")
_DENSITY = "Edie's density of the carriageway, 5 s before to 5 s after t_start, a lane"
_HORIZON = number("horizon_s", "time from t_start", "s", nullable=False, minimum=0)

_FAMILIES = (*names.FAMILIES, names.FUNCTION)

FOLLOWER_MODELS = Table(
    "follower_models",
    "event, follower and model: all that a simulation of that follower needs",
    ("recording_id", "event_id", "follower", "model"),
    (
        EVENT,
        RECORDING,
        RANK,
        VEHICLE,
        _MODEL,
        word("family", "equation of the command: none (0), lcm, idm, or the model's function", _FAMILIES),
        word("fold", "recordings or blocks of time that the constants come from; empty = not fitted so"),
        number("v_desire", "desired speed", "m/s"),
        number("A", "maximum acceleration", "m/s²"),
        number("b", "deceleration that the driver is willing to use (IDM: comfortable)", "m/s²"),
        number("B", "deceleration that the driver expects of the leader (LCM)", "m/s²"),
        number("tau", "perception-reaction time (LCM), desired time gap (IDM)", "s"),
        number("L", "spacing (LCM) or gap (IDM) at standstill behind the AV or the follower ahead", "m"),
        number("L_before", "the same behind the target leader", "m"),
        Column(
            "parameters", "map<string,float64>", "parameters of the model's function, in its order; else empty"
        ),
        Column("spread", "map<string,float64>", "standard deviation over drivers (population), else empty"),
        number("memory_s", "time constant with which the acceleration at t_start fades; 0 = none", "s", minimum=0),
        number("relaxation_s", "time in which the jump at a change of leader fades; 0 = none", "s", minimum=0),
        number(
            "moment",
            "share of the AV's lateral way from which it is the leader; 0 = start, 0.5 = crossing",
            minimum=0,
            maximum=1,
        ),
        number("need", "required deceleration from which the driver brakes at once; infinite = never", "m/s²"),
        number("a_0", "acceleration at t_start that persists", "m/s²"),
        number("drift", "carriageway's drift added to the command", "m/s²"),
    ),
)

PREDICTION = Table(
    "prediction",
    "event, follower, model and horizon in view",
    ("recording_id", "event_id", "follower", "model", "horizon_s"),
    (
        EVENT,
        RECORDING,
        RANK,
        _MODEL,
        _HORIZON,
        word("class", "Car or Truck", names.CLASSES),
        number("spacing_m", "front to front, from the follower to whom it gets as leader, at t_start", "m"),
        number("closing_mps", "speed over that leader's at t_start", "m/s"),
        number("speed_mps", "speed at t_start", "m/s"),
        number("density_vehpkm", _DENSITY, "veh/km", minimum=0),
        number("error_speed_mps", "simulated minus recorded speed at the horizon", "m/s"),
        number("error_position_m", "simulated minus recorded position at the horizon", "m"),
        number("rmse_speed_mps", "root mean square error of speed from 0 to the horizon", "m/s", minimum=0),
        number("change_simulated_mps", "simulated change of speed since t_start, drift taken out", "m/s"),
        number("change_recorded_mps", "recorded change of speed since t_start, drift taken out", "m/s"),
        number("peak_decel_simulated", "strongest braking of the 1 s-smoothed simulated speed", "m/s²", minimum=0),
        number("peak_decel_recorded", "strongest braking of the 1 s-smoothed recorded speed", "m/s²", minimum=0),
        number("comfort_simulated", "normalised comfort sum of the smoothed simulated motion", minimum=0),
        number("comfort_recorded", "the same of the recorded motion", minimum=0),
        number("loss_simulated", "loss of the smoothed simulated motion", minimum=0),
        number("loss_recorded", "loss of the recorded motion, smoothed alike, over the same samples", minimum=0),
        number("nrmse_spacing", "RMSE of spacing over the root mean square of the recorded one", minimum=0),
        number(
            "theil_u", "Theil's U of spacing: RMSE over the sum of both root mean squares", minimum=0, maximum=1
        ),
        number("paper_j", "the paper's J of the 1 s-smoothed accelerations, closed loop; null: none", minimum=0),
        Column(
            "contact",
            "bool",
            "whether the simulated front passes the rear bumper ahead by then",
        ),
        Column("contact_recorded", "bool", "the same of the recorded front and who is recorded ahead"),
    ),
)

PREDICTION_SUMMARY = Table(
    "prediction_summary",
    "model, stratum and horizon: how HV_1 is predicted behind the recorded ego",
    ("model", "stratum", "horizon_s"),
    (
        _MODEL,
        word("stratum", "all, a class of one stratification, or a recording"),
        _HORIZON,
        count("n_events", "events in view for that long"),
        *(
            number(f"{name}{end}", f"{meaning}{bound}", unit)
            for name, meaning, unit in (
                ("bias", "mean error of speed, simulated minus recorded", "m/s"),
                ("mae", "mean absolute error of speed", "m/s"),
                ("rmse", "root mean square error of speed", "m/s"),
                ("skill_constant", "1 - mae over that of constant speed", ""),
                ("skill_naive", "1 - mae over that of the best naive model", ""),
            )
            for end, bound in (("", ""), ("_low", ", lower end of the interval"), ("_high", ", upper end"))
        ),
        word("best_naive", "naive model with the least mean absolute error there"),
        number("peak_decel_simulated", "mean peak braking, simulated", "m/s²"),
        number("peak_decel_recorded", "mean peak braking, recorded", "m/s²"),
        number("comfort_simulated", "mean comfort sum, simulated"),
        number("comfort_recorded", "mean comfort sum, recorded"),
        number("nrmse_spacing", "mean RMSE of spacing over the root mean square of the recorded one"),
        number("theil_u", "mean Theil's U of spacing"),
        number("paper_j", "median of the paper's J of the smoothed accelerations, closed loop"),
        number("loss_error", "mean absolute difference of HV_1's loss, simulated minus recorded"),
        count("contacts", "events with a contact by then; part of no mean of braking, comfort and loss"),
        count("contacts_recorded", "events with a recorded contact by then"),
        word("interval", "units of the intervals: recordings, events (of one recording), or empty = none"),
        word("reason", "why there is no interval, else empty"),
        Column("default", "bool", "the model that plans"),
    ),
)

DOSE_RESPONSE = Table(
    "dose_response",
    "model or recorded, class of spacing and of closing speed, horizon",
    ("model", "spacing", "closing", "horizon_s"),
    (
        _MODEL,
        word("spacing", "class of the spacing to the ego at t_start [m]"),
        word("closing", "class of HV_1's speed over the ego's at t_start [m/s]"),
        _HORIZON,
        count("n_events", "events in view for that long, without contacts of the model"),
        count("left_out", "events left out because of a contact of the model"),
        number("change", "mean change of HV_1's speed since t_start, drift taken out", "m/s"),
        number("sd", "standard deviation of that change", "m/s", minimum=0),
        number("peak_decel", "mean peak braking of the 1 s-smoothed speed", "m/s²", minimum=0),
        number("peak_decel_95", "95 % quantile of it", "m/s²", minimum=0),
        number("change_recorded", "recorded mean change over the same events; null in the recorded rows", "m/s"),
        number("sd_recorded", "its standard deviation over them", "m/s", minimum=0),
        number("peak_decel_recorded", "recorded mean peak braking over them", "m/s²", minimum=0),
        Column("within", "bool", "whether change is within sd_recorded / sqrt(n); null below 5 events", "", True),
    ),
)

EXTERNALITY = Table(
    "externality",
    "event, horizon and source: what the lane change costs HV_1",
    ("recording_id", "event_id", "horizon_s", "source"),
    (
        EVENT,
        RECORDING,
        _HORIZON,
        word("source", "observed, control (mean of the matched followers), or a follower model"),
        number("loss_change", "HV_1's loss from 0 to the horizon beyond that of keeping its speed of t_start"),
        count("n_controls", "matched followers that are not cut in on"),
    ),
)

EXTERNALITY_BALANCE = Table(
    "externality_balance",
    "covariate and horizon: how alike followers and matched controls are",
    ("covariate", "horizon_s"),
    (
        word("covariate", "what was matched"),
        _HORIZON,
        count("n", "matched events"),
        number("share_matched", "share of the events in view that have controls", minimum=0, maximum=1),
        number("mean_event", "mean over the events"),
        number("mean_control", "mean over their controls"),
        number("standardised_difference", "difference of the means over the events' standard deviation"),
    ),
)

PREDICTION_AIMS = Table(
    "prediction_aims",
    "model, aim and horizon: what followers of use have to reach, and whether they do",
    ("model", "aim", "horizon_s"),
    (
        _MODEL,
        word("aim", "skill, recordings below 0, bias, classes of dose-response, likeness, contacts", tuple(AIMS)),
        _HORIZON,
        number("value", "what the model reaches; of recordings, classes and contacts how many"),
        number("observed", "the recorded counterpart, over the same events"),
        number("low", "least value that meets the aim"),
        number("high", "largest value that meets it; braking, comfort, externality: the observed interval"),
        count("n", "events, recordings with an interval, classes of five events, or followers behind it"),
        word("interval", "units of the observed interval: recordings, or events where those are fewer than five"),
        Column("met", "bool", "whether the aim is met; null = not known", "", True),
        word("reason", "why it is not known, else empty"),
        Column("default", "bool", "the model that plans"),
    ),
)

RESPONSES = Table(
    "responses",
    "event and follower: its recorded motion from t_start on and that of whom it follows, on the 0.1 s grid",
    ("recording_id", "event_id", "follower"),
    (
        EVENT,
        RECORDING,
        RANK,
        VEHICLE,
        word("class", "Car or Truck", names.CLASSES),
        Column("location_id", "int64", "site of the recording"),
        number("time", "t_start in the recording", "s", nullable=False),
        count("n", "samples in which both are in view and the follower keeps its lane"),
        number("before_length", "length of the leader before the change", "m", nullable=False, minimum=0),
        number("ahead_length", "length of the leader after it", "m", nullable=False, minimum=0),
        number("a_0", "mean recorded acceleration over the 0.5 s before t_start", "m/s²", nullable=False),
        number("a_lasting", "the same over the 2 s before t_start, as far as in view", "m/s²", nullable=False),
        number("drift", "median acceleration of the carriageway's other vehicles", "m/s²", nullable=False),
        number("density", _DENSITY, "veh/km", minimum=0),
        Column("idm", "list<float64>", "IDM fitted before t_start: v_desire, A, b, T, s0; else empty"),
        number("time_gap", "time gap to the leader at t_start; null unless it was followed", "s"),
        *(
            Column(name, "list<float64>", meaning)
            for name, meaning in (
                ("x", "follower's front, ahead of the ego's centre at t_start [m]"),
                ("v", "follower's speed [m/s]"),
                ("before_x", "front of the leader before the change; 1e9 = none [m]"),
                ("before_v", "its speed [m/s]"),
                ("x_ahead", "front of the leader after it [m]"),
                ("v_ahead", "its speed [m/s]"),
                ("progress", "share of the ego's lateral way that it has made"),
            )
        ),
    ),
)

CONTROLS = Table(
    "controls",
    "event and horizon: followers alike that nobody cuts in on",
    ("recording_id", "event_id", "horizon_s"),
    (
        EVENT,
        RECORDING,
        _HORIZON,
        count("n_controls", "matched followers"),
        number("loss_change", "mean over them of the loss beyond that of keeping the speed; null without any"),
        *(
            number(f"{who}_{name}", f"{name} of the {word_} at the start")
            for who, word_ in (("event", "follower"), ("control", "controls, on average"))
            for name in ("speed", "acceleration", "spacing", "closing")
        ),
    ),
)

SHOCK_WAVES = Table(
    "shock_waves",
    "source and stratum: the wave from vehicle to vehicle behind recorded lane changes (equations.md 3.15)",
    ("source", "stratum"),
    (
        word("source", "observed, unrelated (pairs of two events: what chance makes), or the follower model"),
        word("stratum", "all, or a traffic state"),
        count("n_pairs", "pairs of follower and leader that are in view for 7 s"),
        count("n_recordings", "recordings that they are of"),
        count("contacts", "pairs left out of what follows: a contact under the model, or no other event"),
        count("passed", "pairs from one to the other of which a disturbance passes on"),
        number("share_passed", "those over all pairs", minimum=0, maximum=1),
        number("lag_s", "mean time after which it reaches the follower", "s"),
        number("displacement_m", "mean way along the road that it makes in that time", "m"),
        number("speed_mps", "speed of the wave along the road: sum of ways over sum of lags", "m/s"),
        number("speed_low", "lower end of its interval over recordings", "m/s"),
        number("speed_high", "upper end", "m/s"),
        number("correlation", "mean correlation at the best lag"),
        count("n_both", "pairs of which one passes on both as observed and here"),
        number("lag_difference_s", "mean of lag here minus observed lag over these", "s"),
        number("lag_difference_low", "lower end of its interval over recordings", "s"),
        number("lag_difference_high", "upper end", "s"),
        word("reason", "why there is no interval, else empty"),
    ),
)

WAVE_FIELD = Table(
    "wave_field",
    "source and cell of space and time behind recorded lane changes laid over each other (equations.md 3.15)",
    ("source", "x_from_m", "t_from_s"),
    (
        word("source", "observed, or the follower model"),
        number(
            "x_from_m",
            "upstream border, from the ego's centre at t_start, moving with its speed then",
            "m",
            nullable=False,
        ),
        number("x_to_m", "downstream border", "m", nullable=False),
        number("t_from_s", "begin, from t_start on", "s", nullable=False),
        number("t_to_s", "end", "s", nullable=False),
        number("time_s", "time of all followers in the cell", "s", nullable=False, minimum=0),
        number("speed_mps", "Edie's speed in it, relative to the ego's at t_start", "m/s", nullable=False),
    ),
)

TRAJECTORIES = Table(
    "trajectories",
    "event, accounting, policy, follower model, kind, role and sample of 0.1 s",
    ("event_id", "accounting", "policy", "followers", "kind", "role", "t"),
    (
        EVENT,
        ACCOUNTING,
        word("policy", "who planned the motion: a policy, somebody else's planner, or recorded"),
        word("followers", "follower model that simulated; empty for kind recorded"),
        word("kind", "recorded, simulated or tracked", ("recorded", "simulated", "tracked")),
        word("role", "role of the vehicle in the event"),
        *(
            Column(name, "float32", meaning, unit)
            for name, meaning, unit in (
                ("t", "time from t_start", "s"),
                ("x", "box centre ahead of the ego's centre at t_start", "m"),
                ("y", "box centre left of the ego's centre at t_start", "m"),
                ("vx", "forward speed", "m/s"),
                ("ax", "forward acceleration; commanded where simulated", "m/s²"),
            )
        ),
    ),
)

JUDGED: Final = tuple(
    table.name
    for table in (
        PREDICTION, PREDICTION_SUMMARY, PREDICTION_AIMS, DOSE_RESPONSE, EXTERNALITY, EXTERNALITY_BALANCE,
        SHOCK_WAVES, WAVE_FIELD,
    )
)  # fmt: skip
"""Tables that say how well followers are predicted: a run of before there were such has none of them."""

PREDICTION_TABLES: Final = (
    RESPONSES,
    CONTROLS,
    FOLLOWER_MODELS, PREDICTION, PREDICTION_SUMMARY, PREDICTION_AIMS, DOSE_RESPONSE, EXTERNALITY,
    EXTERNALITY_BALANCE, SHOCK_WAVES, WAVE_FIELD, TRAJECTORIES,
)  # fmt: skip
