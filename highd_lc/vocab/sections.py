"""Sections of the settings: the synthetic recorder, the population's statistics, studies on samples of events.

The recorder's say what the road, the traffic and the camera of a recording are like.
"""

from typing import Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field

from highd_lc.vocab.driver import TABLE3_MEANS

Lanes = Annotated[int, Field(ge=2, le=5)]
Share = Annotated[float, Field(ge=0, le=1)]


class Section(BaseModel):
    """A section of the settings: immutable, unknown keys refused."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class RecorderSettings(BaseModel):
    """A synthetic recording apart from its length and seed. Defaults resemble HighD (equations.md 15).

    The defaults from ``drivers`` on are made to resemble published aggregates of how drivers respond to a cut-in
    (``benchmarks/dose_response.py`` prints both); no row of HighD was used.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    frame_rate: Annotated[float, Field(ge=5, le=100, description="frames a second [Hz] (HighD: 25)")] = 25.0
    upper_lanes: Annotated[Lanes, Field(description="lanes of direction 1 (HighD: 2, 3 or 4)")] = 3
    lower_lanes: Annotated[Lanes, Field(description="lanes of direction 2 (HighD: 2 or 3)")] = 3
    section_m: Annotated[float, Field(ge=100, le=5000, description="length of road in view [m]")] = 420.0
    flow_veh_per_h: Annotated[
        float, Field(ge=50, le=2200, description="mean inflow a lane [veh/h] (all of HighD: about 1250)")
    ] = 1250.0
    flow_spread: Annotated[
        float,
        Field(ge=0, le=0.9, description="each recording's flow is drawn within this share of the mean"),
    ] = 0.15
    truck_share: Annotated[
        float, Field(ge=0, le=0.3, description="share of trucks of all vehicles (HighD: 0.19)")
    ] = 0.19
    lane_change_rate: Annotated[
        float,
        Field(ge=0, le=5, description="how often a driver considers to change lane [1/s]"),
    ] = 1.0
    return_share: Annotated[
        float,
        Field(ge=0, le=1, description="share of lane changes that are broken off after the crossing (A-B-A)"),
    ] = 0.04
    wander_m: Annotated[
        float,
        Field(ge=0, le=0.5, description="lane keeping: standard deviation of the slow lateral motion [m]"),
    ] = 0.08
    position_noise_m: Annotated[
        float,
        Field(
            ge=0,
            le=0.5,
            description="standard deviation of the smooth error that a tracker leaves in x and in y [m]; "
            "recorded speeds and accelerations contain its derivatives",
        ),
    ] = 0.02
    detection_noise_m: Annotated[
        float,
        Field(ge=0, le=0.5, description="standard deviation of white noise in the positions alone [m]"),
    ] = 0.0
    end_speed_error_mps: Annotated[
        float,
        Field(ge=0, le=2, description="speeds read too low at the very ends of the section, up to 20 m [m/s]"),
    ] = 0.3
    acceleration_bias_mps2: Annotated[
        float,
        Field(
            ge=0,
            le=0.5,
            description="bound of each recording's bias of the forward acceleration, opposite on the two "
            "carriageways [m/s^2] (HighD: up to 0.3)",
        ),
    ] = 0.05
    drivers: Annotated[
        Literal["mixture", "lcm", "idm", "population"],
        Field(
            description="mixture: as the shares below say; lcm: all by the LCM near Table 3, at once, without "
            "drift (what follows does not count); idm: all by the IDM; "
            "population: all by the gentle LCM with memory"
        ),
    ] = "mixture"
    idm_share: Annotated[Share, Field(description="share of drivers of the mixture that follow by the IDM")] = 0.5
    gentle_share: Annotated[
        Share,
        Field(description="share by a gentle LCM with a memory of 6-7 s; the rest near Table 3"),
    ] = 0.25
    memory_s: Annotated[
        float,
        Field(ge=0, le=20, description="median time in which an acceleration fades after a change of leader [s]"),
    ] = 2.0
    relaxation_s: Annotated[
        float,
        Field(
            ge=0,
            le=60,
            description="median time in which the jumps of spacing and speed at a change of leader fade [s]",
        ),
    ] = 5.0
    start_share: Annotated[
        Share, Field(description="share of drivers who react to a cut-in from the start of its lateral path on")
    ] = 0.65
    crossing_share: Annotated[
        Share,
        Field(description="share who react from the crossing on; the rest from a share of the way on"),
    ] = 0.15
    reaction_strength: Annotated[
        float, Field(ge=0.1, le=1.5, description="median share of the model's acceleration that a driver applies")
    ] = 0.5
    reaction_spread: Annotated[
        float, Field(ge=0, le=1, description="standard deviation of that share's logarithm")
    ] = 0.4
    ignore_share: Annotated[Share, Field(description="share that ignores a cut-in for a while")] = 0.08
    ignore_s: Annotated[float, Field(ge=0, le=30, description="for how long on average [s]")] = 4.0
    room_share: Annotated[Share, Field(description="share that makes room before the crossing")] = 0.1
    room_mps2: Annotated[float, Field(ge=0, le=2, description="by how much braking on average [m/s^2]")] = 0.3
    unrest_mps2: Annotated[
        float,
        Field(ge=0, le=1, description="median deviation of a driver's acceleration that nothing explains [m/s^2]"),
    ] = 0.03
    unrest_spread: Annotated[
        float, Field(ge=0, le=1, description="standard deviation of its logarithm over the drivers")
    ] = 0.6
    drift_mps2: Annotated[
        float,
        Field(
            ge=0,
            le=0.5,
            description="bound of each carriageway's true acceleration in common, at 28 m/s [m/s^2] (HighD: "
            "-0.24 to 0.29)",
        ),
    ] = 0.32


class StatisticsSettings(BaseModel):
    """Population statistics (equations.md 12)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    bootstrap: Annotated[int, Field(ge=100, le=100000, description="bootstrap samples over recordings")] = 2000
    confidence: Annotated[float, Field(gt=0.5, lt=1, description="coverage of the intervals")] = 0.95
    tie_band: Annotated[float, Field(ge=0, lt=1, description="relative difference that counts as a tie")] = 0.001
    interval: Annotated[
        Literal["bootstrap_t", "t", "percentile"],
        Field(
            description="how intervals are made (equations.md 12.2): bootstrap_t covers what it says from eight "
            "clusters on; t is Student's; percentile is too short below 30"
        ),
    ] = "bootstrap_t"
    clusters: Annotated[
        Literal["recording", "location"],
        Field(
            description="what stands and falls together in matrix, gain map and leave_one_out; all other tables "
            "vary over recordings"
        ),
    ] = "recording"
    traffic_states: Annotated[
        bool,
        Field(description="traffic state (free, dense, congested) as strata of the matrix, beside the speed"),
    ] = True


class RobustSettings(BaseModel):
    """The local optimum of who does not know the followers (equations.md 7.4)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    sample: Annotated[
        int, Field(ge=0, le=100000, description="events planned so, stratified and seeded; 0 = none")
    ] = 500
    draws: Annotated[
        int,
        Field(
            ge=1,
            le=100,
            description="K: whom the followers may be: the first as the model has them, common to all plans",
        ),
    ] = 8
    aggregate: Annotated[
        Literal["mean", "worst"],
        Field(description="what is minimised: the mean over the draws, or that of the worst of them"),
    ] = "mean"
    worst_share: Annotated[
        float, Field(gt=0, le=1, description="share of the draws that count as the worst of them")
    ] = 0.25

    contacts: Annotated[
        Literal["own", "any"],
        Field(
            description="contacts that reject a plan: with the model's own drivers, as elsewhere, or with any draw"
        ),
    ] = "own"

    @property
    def share(self) -> float:
        """Share of the draws whose losses count, the largest ones."""
        return 1.0 if self.aggregate == "mean" else self.worst_share


class SumoSettings(BaseModel):
    """Replays in SUMO, whose followers know none of our models (extra sumo)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    events: Annotated[
        int,
        Field(
            ge=0, le=100000, description="events replayed so, stratified and seeded; 0 = none, and no SUMO needed"
        ),
    ] = 0
    model: Annotated[
        Literal["EIDM", "Krauss"],
        Field(description="SUMO's car-following model of the cars; trucks drive by EIDM"),
    ] = "EIDM"


CONSTANT_SPEED: Final = "constant_speed"
BRAKING: Final = "braking"
FOLLOWER_MODEL: Final = "lcm"
RECORDED_LEADERS: Final = "recorded"
"""How the closed loop predicts leaders; ``RECORDED_LEADERS`` is perfect foresight."""


class ClosedLoopSettings(BaseModel):
    """Driving with plans that are made anew on the way (equations.md 7.5)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    events: Annotated[
        int, Field(ge=0, le=100000, description="events driven so, stratified and seeded; 0 = none")
    ] = 40
    every_s: Annotated[
        float, Field(ge=0.1, le=60, multiple_of=0.1, description="time from one plan to the next [s]")
    ] = 0.5
    leaders: Annotated[
        Literal["braking", "constant_speed", "constant_acceleration", "lcm", "recorded"],
        Field(
            description="leaders as the AV predicts them: at constant speed, after 1 s more of the braking of the "
            "last second; at constant speed at once; with the acceleration measured, for 2 s; by the LCM on a "
            "free road (Table 3 means); as recorded: perfect foresight"
        ),
    ] = "braking"
    followers: Annotated[
        str, Field(description="follower model by which the AV predicts them; empty = the one that plans")
    ] = ""
    world: Annotated[
        str, Field(description="follower model that drives them; empty = the one by which the AV predicts them")
    ] = ""
    tracker: Annotated[
        Literal["mpc", "none"],
        Field(description="mpc: the bicycle under the MPC drives; none: the AV is where it planned to be"),
    ] = "mpc"


class MultiverseSettings(BaseModel):
    """Events planned anew under every defensible choice (equations.md 12.7)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    sample: Annotated[
        int, Field(ge=0, le=100000, description="events planned so, stratified and seeded; 0 = none")
    ] = 60
    choices: Annotated[str, Field(min_length=1, description="table of the choices: TOML file or shipped name")] = (
        "multiverse"
    )


class StudySettings(BaseModel):
    """Scores under what was not optimised, and studies on a stratified, seeded sample (equations.md 12)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    sample: Annotated[
        int, Field(ge=0, le=100000, description="events in the sample: Pareto, uncertainty, horizon; 0 = none")
    ] = 50
    chosen: Annotated[
        tuple[str, ...], Field(description="ids of events to study instead of a sample; empty = sample")
    ] = ()
    start_sample: Annotated[
        int, Field(ge=0, le=100000, description="events in the sample whose start is chosen; 0 = none")
    ] = 500
    foresight_sample: Annotated[
        int, Field(ge=0, le=100000, description="events of it planned with predicted leaders as well; 0 = none")
    ] = 25
    multibody_sample: Annotated[
        int, Field(ge=0, le=100000, description="events whose plans the multi-body car drives too; 0 = none")
    ] = 50
    safety_sample: Annotated[
        int, Field(ge=0, le=100000, description="events planned under both safety profiles; 0 = none")
    ] = 200
    draws: Annotated[
        int, Field(ge=1, le=1000, description="K: parameter draws within each follower's spread (all events)")
    ] = 20
    replans: Annotated[
        int, Field(ge=1, le=1000, description="draws with which an event of the sample is planned again")
    ] = 10
    horizons_s: Annotated[
        tuple[Annotated[float, Field(ge=2, le=60, multiple_of=0.5)], ...],
        Field(
            description="H of the sensitivity [s], each at most loss.horizon_s (equations.md 4.6); "
            "of the default those that are"
        ),
    ] = (5.0, 8.0, 10.0)
    omegas: Annotated[
        tuple[Annotated[float, Field(ge=0, le=1)], ...],
        Field(
            min_length=2, description="weights of the AV in the sweep beside the Pareto front (equations.md 7.3)"
        ),
    ] = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
    population: Annotated[int, Field(ge=8, le=10000, description="NSGA-II population")] = 80
    generations: Annotated[int, Field(ge=1, le=10000, description="NSGA-II generations")] = 50
    solver_sample: Annotated[
        int, Field(ge=0, le=100000, description="events in the sample on which SLSQP is compared; 0 = none")
    ] = 12
    solver_starts: Annotated[int, Field(ge=1, le=1000, description="starts of SLSQP")] = 5


class LossSettings(Section):
    """Losses (equations.md 4)."""

    v_ref_av: Annotated[float, Field(gt=0, le=100, description="reference speed of the AV [m/s]")] = (
        TABLE3_MEANS.v_desire
    )
    v_ref_hv: Annotated[float, Field(gt=0, le=100, description="reference speed of the followers [m/s]")] = (
        TABLE3_MEANS.v_desire
    )
    comfort_scale: Annotated[float, Field(gt=0, description="N_c: divides the comfort sums [m/s^3]")] = 8.0
    efficiency_scale: Annotated[float, Field(gt=0, description="N_e: divides the efficiency sums [m/s]")] = (
        TABLE3_MEANS.v_desire
    )
    reference: Annotated[
        Literal["desired", "one-sided", "own"],
        Field(description="|v - v_ref|; only below v_ref; v_ref = speed at t_start"),
    ] = "desired"
    aggregation: Annotated[
        Literal["weighted", "sum"], Field(description="followers' losses weighted by equation 17, or summed")
    ] = "weighted"
    handover: Annotated[
        Literal["uncounted", "counted"],
        Field(
            description="step of the AV's command onto its drive by LCM: not counted, or from 0 (equations.md 4.7)"
        ),
    ] = "counted"
    omega_av: Annotated[
        float, Field(gt=0, lt=1, description="weight of the AV in the local optimum (paper: 0.5)")
    ] = 0.5
    horizon_s: Annotated[
        float,
        Field(
            ge=2,
            le=60,
            multiple_of=0.5,
            description="H: accounted time of follower_horizon and equal; no manoeuvre lasts longer [s]",
        ),
    ] = 15.0


class ConstraintSettings(Section):
    """Limits of a plan (equations.md 5.1)."""

    v_min: Annotated[float, Field(ge=0, le=50, description="lowest speed [m/s]; 0.8 v0 where that is lower")] = 5.0
    v_max: Annotated[float, Field(gt=0, le=100, description="highest speed [m/s]")] = 50.0
    acceleration: Annotated[float, Field(gt=0, le=50, description="limit of |a_x| and |a_y| [m/s^2]")] = 8.0
    jerk: Annotated[float, Field(gt=0, le=200, description="limit of |j_x| and |j_y| [m/s^3]")] = 8.0
    ellipse: Annotated[
        Literal["circumscribed", "paper"],
        Field(description="semi-axes: box over sqrt 2, or the paper's 2.5 m and 1.0 m"),
    ] = "circumscribed"
    contacts: Annotated[
        Literal["all", "av"],
        Field(description="all: nobody may drive through the vehicle ahead; av: only the AV's ellipse counts"),
    ] = "all"
