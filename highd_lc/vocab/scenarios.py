"""Settings of ``highd-lc scenarios``: the paper's scenarios and the named options of their conventions."""

from typing import Annotated, Literal

from pydantic import Field, ValidationError, model_validator

from highd_lc.vocab import names
from highd_lc.vocab.driver import TABLE3_MEANS
from highd_lc.vocab.policy import PAIRS, POLICIES
from highd_lc.vocab.published import RECTANGLE_DURATION, RECTANGLE_HEIGHT
from highd_lc.vocab.safety import SafetySettings
from highd_lc.vocab.sections import ConstraintSettings, LossSettings, Section
from highd_lc.vocab.settings import FollowerSettings, PlannerSettings, ValidateSettings
from highd_lc.vocab.tracking import TrackingSettings

Metres = Annotated[float, Field(gt=0, le=10000)]
Speed = Annotated[float, Field(gt=0, le=100)]


class ScenarioOptions(Section):
    """The conventions that the paper leaves open; every cell states all of them (equations.md 13.7)."""

    gap_reading: Annotated[
        Literal["centres", "bumpers"],
        Field(description="what the printed distance between AV and HV_1 is: of centres, or bumper to bumper"),
    ] = "centres"
    spacing_m: Annotated[
        float, Field(gt=5, le=500, description="spacing of the platoon, front to front [m] (behind Table 1: 44)")
    ] = 44.0
    pre_phase: Annotated[
        Literal["hold", "lcm"],
        Field(
            description="until the lane change: everybody holds speed and spacing, or drives by LCM from t = 0 "
            "(at v_desire no equilibrium exists, the platoon stretches then)"
        ),
    ] = "hold"
    aggregation: Annotated[
        Literal["sum", "weighted"], Field(description="followers' losses summed, or weighted by equation 17")
    ] = "sum"
    reference: Annotated[
        Literal["desired", "one-sided", "own"],
        Field(description="what a speed is compared with (equations.md 4.2)"),
    ] = "desired"
    v_ref_av: Annotated[Speed, Field(description="reference speed of the AV [m/s] (equations.md 4.2)")] = (
        TABLE3_MEANS.v_desire
    )
    v_desire: Annotated[
        Speed, Field(description="desired speed of the followers [m/s] (paper: 25; 29.13 has 44 m in equilibrium)")
    ] = 29.13
    horizon_s: Annotated[
        float, Field(ge=1, le=60, multiple_of=0.5, description="H: accounted time [s] (equations.md 4.6)")
    ] = 15.0
    platoon_leader: Annotated[
        Literal["none", "present"],
        Field(description="a leader at the platoon's speed, one spacing ahead of HV_1, or a free road"),
    ] = "present"
    leader_from: Annotated[
        Literal["start", "crossing"], Field(description="from when HV_1 follows the AV (equations.md 4.4)")
    ] = "start"
    ellipse: Annotated[
        Literal["circumscribed", "paper"], Field(description="semi-axes of the safety ellipses (equations.md 5.2)")
    ] = "circumscribed"
    planned_followers: Annotated[
        int, Field(ge=1, le=100, description="followers that the plan and the loss know (scenario 1 has 10)")
    ] = 10
    v_max: Annotated[Speed, Field(description="highest speed of a plan, scenarios 1 and 2 [m/s] (paper: 30)")] = (
        30.0
    )
    b_max: Annotated[
        float,
        Field(ge=0, le=20, description="hardest braking that any model may command [m/s^2]; 0 = unbounded"),
    ] = 9.0
    contacts: Annotated[
        Literal["all", "av"],
        Field(description="all: nobody may drive through the vehicle ahead; av: only the AV's ellipse counts"),
    ] = "all"


class VehicleSettings(Section):
    """The vehicles, all alike, and their lane (equations.md 13.1)."""

    length_m: Annotated[Metres, Field(description="l_a: length [m]")] = 5.0
    width_m: Annotated[Metres, Field(description="l_b: width [m]")] = 2.0
    wheelbase_m: Annotated[Metres, Field(description="of the AV [m] (multi-body set 2: 2.58)")] = 2.58
    lateral_shift_m: Annotated[Metres, Field(description="D: lateral shift of the lane change [m]")] = 3.5
    dt_s: Annotated[float, Field(gt=0, le=0.1, description="time step [s]")] = 0.1


class PlatoonSettings(Section):
    """A platoon into which the AV changes."""

    followers: Annotated[int, Field(ge=1, le=10000, description="vehicles in the platoon")]
    duration_s: Annotated[float, Field(gt=0, le=10000, description="simulated time [s]")]
    change_at_s: Annotated[float, Field(ge=0, le=10000, description="time of the lane change [s]")]
    platoon_speed: Annotated[Speed, Field(description="speed of the platoon before the lane change [m/s]")] = 25.0
    av_ahead_m: Annotated[Metres, Field(description="printed distance between AV and HV_1 [m]")] = 10.0
    av_speeds: Annotated[tuple[Speed, ...], Field(min_length=1, description="speed of the AV at t_start [m/s]")]


class SectionSettings(Section):
    """Where total travel time is counted, from the AV's front at t_start."""

    from_m: Annotated[float, Field(ge=-10000, le=10000, description="begin of the section [m]")] = 0.0
    length_m: Annotated[Metres, Field(description="length of the section [m] (paper: 200 m downstream)")] = 200.0


class RectangleSettings(Section):
    """The space-time rectangle of Tables 1 and 2, placed as the printed distances ask (equations.md 13.4)."""

    top_m: Annotated[
        float, Field(description="downstream border ahead of HV_1's front at t_start [m] (its 147 m in Table 1)")
    ] = 147.2
    height_m: Annotated[Metres, Field(description="length of road [m] (paper: 225)")] = RECTANGLE_HEIGHT
    duration_s: Annotated[float, Field(gt=0, le=1000, description="time from t_start on [s] (paper: 15)")] = (
        RECTANGLE_DURATION
    )


class MapSettings(Section):
    """Cells of the time-space speed maps."""

    before_s: Annotated[float, Field(ge=0, le=1000, description="time before the lane change [s]")] = 10.0
    after_s: Annotated[float, Field(gt=0, le=1000, description="time after it [s]")] = 110.0
    upstream_m: Annotated[Metres, Field(description="road upstream of the AV at t_start [m]")] = 1000.0
    downstream_m: Annotated[Metres, Field(description="road downstream [m]")] = 1500.0
    cell_s: Annotated[float, Field(gt=0, le=100, description="time of a cell [s]")] = 2.0
    cell_m: Annotated[Metres, Field(description="length of a cell [m]")] = 50.0


class RecordedSettings(Section):
    """Edie's measures around a lane change of the recordings, where a work folder has any."""

    before_s: Annotated[float, Field(gt=0, le=600, description="time before the crossing [s]")] = 12.0
    after_s: Annotated[float, Field(gt=0, le=600, description="time after it [s]")] = 12.0
    cell_s: Annotated[float, Field(gt=0, le=100, description="time of a cell [s]")] = 2.0
    cell_m: Annotated[Metres, Field(description="length of a cell [m]")] = 40.0


class PrintedState(Section):
    """Scenario 3: the printed initial state of one recorded event; the AV's speed is not printed."""

    spacings_m: tuple[Metres, ...] = (24.23, 59.73, 107.26)
    speed_differences: tuple[float, ...] = (5.27, 5.43, 4.56)
    origin_leader_ahead_m: Annotated[Metres, Field(description="spacing to the origin leader [m]")] = 43.13
    origin_leader_difference: Annotated[
        float, Field(description="speed of the AV over that of its leader [m/s] (sign not printed)")
    ] = 2.32
    target_gap_m: Annotated[Metres, Field(description="gap between target leader and HV_1 [m]")] = 91.07
    av_speeds: Annotated[tuple[Speed, ...], Field(min_length=1, description="free axis: speed of the AV [m/s]")]
    v_ref: Annotated[Speed, Field(description="reference speed and N_e [m/s]")] = TABLE3_MEANS.v_desire
    v_max: Annotated[Speed, Field(description="highest speed [m/s] (HighD: 50)")] = 50.0
    default_av_speed: Annotated[Speed, Field(description="speed of the AV in the ledger's default [m/s]")] = 25.0


class ScenarioConstraints(ConstraintSettings):
    """Limits of a plan in the scenarios (equations.md 5.1); what an option sets is taken from there."""

    v_max: Annotated[float, Field(gt=0, le=100, description="highest speed [m/s] (paper: 30)")] = 30.0


class ScenarioLosses(LossSettings):
    """Losses in the scenarios (equations.md 4); what an option sets is taken from there."""

    v_ref_hv: Annotated[float, Field(gt=0, le=100, description="reference speed of the followers [m/s]")] = 25.0
    handover: Annotated[
        Literal["uncounted", "counted"],
        Field(description="step of the AV's command onto its drive after T: not counted (paper), or from 0"),
    ] = "uncounted"
    efficiency_scale: Annotated[float, Field(gt=0, description="N_e: divides the efficiency sums [m/s]")] = 25.0


class ScenarioPlanner(PlannerSettings):
    """Search and replay in the scenarios (equations.md 13.1)."""

    after: Annotated[
        Literal["lcm", "constant"], Field(description="the AV's drive after T: at its end speed (paper), or LCM")
    ] = "constant"


Value = str | float | int
Changes = dict[str, Value]


class ScenarioSettings(Section):
    """All of ``highd-lc scenarios``."""

    name: Annotated[str, Field(min_length=1, max_length=80, description="name of the pipeline")] = "scenarios"
    seed: Annotated[int, Field(ge=0, le=2**63 - 1, description="seed of the intervals")] = 1
    accounting: Annotated[
        Literal["paper", "follower_horizon", "equal"], Field(description="default accounting (equations.md 13.1)")
    ] = "follower_horizon"
    form: Annotated[Literal["fixed", "free"], Field(description="default form: end speed = start speed")] = "fixed"
    omegas: Annotated[
        tuple[float, ...], Field(min_length=2, description="weights omega_AV of the sensitivity (figure 11)")
    ]
    options: ScenarioOptions = ScenarioOptions()
    vehicle: VehicleSettings = VehicleSettings()
    scenario_1: PlatoonSettings
    scenario_2: PlatoonSettings
    scenario_3: PrintedState
    section: SectionSettings = SectionSettings()
    rectangle: RectangleSettings = RectangleSettings()
    map: MapSettings = MapSettings()
    recorded: RecordedSettings = RecordedSettings()
    loss: ScenarioLosses = ScenarioLosses()
    constraints: ScenarioConstraints = ScenarioConstraints()
    planner: ScenarioPlanner = ScenarioPlanner()
    tracking: TrackingSettings = TrackingSettings()
    variants: Annotated[
        dict[str, Changes], Field(description="named variants: which options differ from the default")
    ]
    paper_literal: Annotated[Changes, Field(description="options as the paper prints them, accounting paper")]
    sweep: Annotated[
        dict[str, tuple[Value, ...]],
        Field(description="option -> its values, each of which `--sweep` combines with all others"),
    ]

    @model_validator(mode="after")
    def _options_exist(self) -> "ScenarioSettings":
        """Every variant and every value of the sweep makes valid options: found when the file is read."""
        named = {f"variants.{name}": change for name, change in self.variants.items()}
        named["paper_literal"] = self.paper_literal
        named |= {f"sweep.{key}": {key: value} for key, values in self.sweep.items() for value in values}
        for where, change in named.items():
            try:
                self.with_options(change)
            except ValidationError as error:
                first = error.errors()[0]
                raise ValueError(f"{where}.{first['loc'][0]} = {first['input']!r}: {first['msg']}") from error
        return self

    def with_options(self, changes: Changes) -> ScenarioOptions:
        """The default options with some changed. Raises pydantic's ValidationError if one is not allowed."""
        return ScenarioOptions.model_validate(self.options.model_dump() | changes)

    @property
    def weights(self) -> dict[str, float]:
        """omega_AV by policy: benchmark, local optimum."""
        return {policy: POLICIES[policy].omega_av(self.loss.omega_av) for policy in PAIRS[names.FIXED]}

    def planning(self, options: ScenarioOptions) -> ValidateSettings:
        """The planner's settings under these options."""
        loss = self.loss.model_dump() | {
            "aggregation": options.aggregation,
            "reference": options.reference,
            "v_ref_av": options.v_ref_av,
            "horizon_s": options.horizon_s,
        }
        return ValidateSettings(
            loss=LossSettings.model_validate(loss),
            constraints=ConstraintSettings.model_validate(
                self.constraints.model_dump()
                | {"ellipse": options.ellipse, "contacts": options.contacts, "v_max": options.v_max}
            ),
            safety=SafetySettings(profile="paper"),
            followers=FollowerSettings(b_max=options.b_max),
            planner=PlannerSettings.model_validate(
                self.planner.model_dump() | {"leader_from": options.leader_from}
            ),
            tracking=self.tracking,
        )
