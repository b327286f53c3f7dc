"""Settings of a run: one frozen model a section of the TOML, every field with unit, bound and source."""

from typing import Annotated, Literal

from pydantic import ConfigDict, Field, model_validator

from highd_lc.vocab import names
from highd_lc.vocab.errors import SettingsError
from highd_lc.vocab.follower_names import parse
from highd_lc.vocab.safety import SafetySettings
from highd_lc.vocab.sections import (
    ClosedLoopSettings,
    ConstraintSettings,
    LossSettings,
    MultiverseSettings,
    RecorderSettings,
    RobustSettings,
    Section,
    StatisticsSettings,
    StudySettings,
    SumoSettings,
)
from highd_lc.vocab.tracking import TrackingSettings


class SyntheticSettings(Section):
    """Recordings made when no data folder is given."""

    recordings: Annotated[int, Field(ge=1, le=200, description="number of recordings")] = 3
    seconds: Annotated[float, Field(ge=5, le=3600, description="length of a recording [s]")] = 90.0
    seed: Annotated[int, Field(ge=0, description="seed of the recorder")] = 1
    recorder: RecorderSettings = RecorderSettings()


class IngestSettings(Section):
    """Reading recordings."""

    format: Annotated[
        Literal["auto", "highd", "ngsim", "tgsim", "exid"],
        Field(description="format of the recordings; auto: by what the folder holds (docs/data.md)"),
    ] = "auto"
    ngsim_smoothing: Annotated[
        Literal["auto", "always", "never"],
        Field(
            description="smooth NGSIM's positions, speeds and accelerations; auto: where they are too noisy "
            "(equations.md 16.13)"
        ),
    ] = "auto"
    trim_ends_m: Annotated[
        float,
        Field(
            ge=0,
            le=100,
            description="length at each end of the section kept out of calibration [m] (equations.md 16.3)",
        ),
    ] = 20.0
    remove_bias: Annotated[
        bool,
        Field(
            description="subtract each carriageway's mean forward acceleration, per recording (equations.md 16.4)"
        ),
    ] = False


class ExtractSettings(Section):
    """Finding lane changes (equations.md 11)."""

    smoothing_s: Annotated[
        float, Field(gt=0, le=5, description="width of the local quadratic that smooths lateral position [s]")
    ] = 1.0
    lateral_speed_mps: Annotated[
        float,
        Field(
            gt=0,
            le=1,
            description="lateral speed towards the target below which the vehicle keeps its lane [m/s]",
        ),
    ] = 0.22
    lateral_acceleration_mps2: Annotated[
        float,
        Field(gt=0, le=5, description="lateral acceleration below which it counts as near zero [m/s^2]"),
    ] = 0.8
    persistence_s: Annotated[
        float, Field(ge=0, le=3, description="how long the lateral speed has to stay near zero [s]")
    ] = 0.4
    clearance_m: Annotated[
        float,
        Field(ge=0, le=2, description="distance from the crossed marking that start and end need [m]"),
    ] = 0.5
    rest_s: Annotated[
        float,
        Field(ge=0, le=10, description="time in its lane between two changes that keeps them apart [s]"),
    ] = 1.0
    flicker_s: Annotated[
        float,
        Field(ge=0, le=5, description="lane ids that change back within this time are one crossing [s]"),
    ] = 1.0
    min_shift_m: Annotated[
        float, Field(ge=0, le=5, description="smallest lateral shift between start and end [m]")
    ] = 1.5
    max_followers: Annotated[
        int, Field(ge=1, le=10, description="p: followers walked upstream on the target lane")
    ] = 3
    max_link_m: Annotated[
        float, Field(gt=0, le=1000, description="largest spacing of a link of the follower chain [m]")
    ] = 150.0
    horizon_s: Annotated[
        float,
        Field(
            gt=0,
            le=60,
            description="recorded motion kept after the end of the lane change [s]; less than H: less is observed",
        ),
    ] = 15.0


def _refuse_unknown(key: str, *models: str) -> None:
    """Raise ValueError, with the key, for a name that is no follower model."""
    for name in models:
        try:
            parse(name)
        except SettingsError as error:
            raise ValueError(f"{key}: {error}") from error


class CalibrateSettings(Section):
    """Fitting the LCM to each follower (equations.md 9)."""

    objective: Annotated[
        Literal["closed-loop", "paper"],
        Field(description="closed-loop simulation error, or the paper's one-step J"),
    ] = "closed-loop"
    delay: Annotated[
        Literal["none", "explicit"],
        Field(description="whether the command is applied tau later (equation 10)"),
    ] = "none"
    optimiser: Annotated[
        Literal["ga", "pymoo", "screen"],
        Field(description="compiled GA, pymoo's GA, or Sobol screening with Levenberg-Marquardt"),
    ] = "ga"
    polish: Annotated[
        bool,
        Field(description="Levenberg-Marquardt from the GA's best and from screened random points; both are kept"),
    ] = True
    population: Annotated[int, Field(ge=4, le=10000, description="GA population (paper: 200)")] = 200
    generations: Annotated[int, Field(ge=1, le=10000, description="GA generations (equations.md 9.5)")] = 200
    crossover_probability: Annotated[
        float, Field(ge=0, le=1, description="SBX probability a pair (paper: 0.95)")
    ] = 0.95
    mutation_probability: Annotated[
        float, Field(ge=0, le=1, description="polynomial mutation probability a variable (paper: 0.05)")
    ] = 0.05
    screened: Annotated[
        int, Field(ge=64, le=2**20, description="Sobol points that the screen looks at (equations.md 9.6)")
    ] = 2048
    pooling: Annotated[
        Literal["none", "penalised"],
        Field(description="whether fits are drawn towards the median of their class"),
    ] = "none"
    pooling_strength: Annotated[
        float, Field(ge=0, le=1, description="strength of that penalty; 0 = by cross-validation on the sample")
    ] = 0.0
    pool_election: Annotated[
        Literal["inside", "all"],
        Field(description="who may become a pool's driver: fits with the fewest parameters on bounds, or all"),
    ] = "inside"
    study_sample: Annotated[
        int, Field(ge=0, le=100000, description="fitted followers whose identifiability is studied")
    ] = 40
    models: Annotated[
        tuple[str, ...],
        Field(description="follower models whose prediction is judged, beside the one that plans"),
    ] = (
        "constant_speed",
        "decaying_acceleration",
        "drift",
        "own_fit",
        "own_fit@crossing",
        "own_fit@crossing+memory",
        "own_fit@crossing+memory+relaxation",
        "mean",
        "table3",
        "idm",
        "idm@crossing+memory",
        "population",
        "population-memory",
        "population-relaxation",
    )
    min_window_s: Annotated[
        float, Field(gt=0, le=60, description="shortest car-following window that is fitted [s]")
    ] = 3.0

    @model_validator(mode="after")
    def _known_models(self) -> "CalibrateSettings":
        """Every name means a model."""
        _refuse_unknown("models", *self.models)
        return self


class FollowerSettings(Section):
    """How everybody who follows by a model drives, in fits, plans and scores alike."""

    model: Annotated[
        str,
        Field(
            min_length=1,
            description="follower model that plans: population, own_fit, mean, table3, idm, naive ones, one of a "
            "researcher's own; @start, @crossing, @0.3, +memory, +relaxation follow it",
        ),
    ] = "population"
    also: Annotated[
        tuple[Annotated[str, Field(min_length=1)], ...],
        Field(description="follower models that plan a sample of the events as well"),
    ] = ("own_fit",)
    also_sample: Annotated[
        int, Field(ge=0, le=100000, description="events in that sample, stratified and seeded; 0 = none")
    ] = 500
    population: Annotated[
        str, Field(description="file of an exported population to use instead of fitting one; empty = fit")
    ] = ""
    b_max: Annotated[
        float,
        Field(
            ge=0,
            le=20,
            description="hardest braking that any model may command [m/s^2]; 0 = unbounded "
            "(Treiber and Kesting 2013: 9 on a dry road)",
        ),
    ] = 9.0

    @model_validator(mode="after")
    def _known_models(self) -> "FollowerSettings":
        """Every name means a model, and a population from a file has all of its parts."""
        _refuse_unknown("model", self.model)
        _refuse_unknown("also", *self.also)
        fitted = [name for name in (self.model, *self.also) if self.population and parse(name).removed]
        if fitted:
            raise ValueError(f"population = {self.population}: {fitted[0]} has to be fitted without a part")
        return self


class PlannerSettings(Section):
    """Search and replay conventions of the planner (equations.md 2 to 7)."""

    T_min: Annotated[float, Field(ge=0.5, le=60, description="shortest manoeuvre [s]")] = 2.0
    T_max: Annotated[float, Field(ge=0.5, le=60, description="longest manoeuvre [s]")] = 10.0
    x_nodes: Annotated[int, Field(ge=5, le=1000, description="grid nodes over x_final at each T")] = 15
    v_nodes: Annotated[int, Field(ge=3, le=1000, description="grid nodes over v_end (free form)")] = 12
    T_nodes_free: Annotated[int, Field(ge=5, le=1000, description="durations on the free form's first grid")] = 27
    zoom_starts: Annotated[int, Field(ge=1, le=100, description="basins that are refined for each goal")] = 4
    zoom_levels: Annotated[int, Field(ge=2, le=20, description="refinements of x_final (fixed form)")] = 2
    zoom_levels_free: Annotated[int, Field(ge=2, le=20, description="refinements of x_final and v_end")] = 8
    free_form: Annotated[bool, Field(description="plan with a free end speed as well")] = True
    start: Annotated[
        Literal["none", "sample", "all"],
        Field(description="events whose start and gap are chosen as well (studies.start_sample)"),
    ] = "sample"
    max_delay_s: Annotated[float, Field(ge=0, le=30, description="longest wait before the manoeuvre [s]")] = 5.0
    waiting: Annotated[
        Literal["constant", "lcm"],
        Field(description="the waiting AV: constant speed, or LCM behind the origin leader (Table 3 means)"),
    ] = "constant"
    latest_end_s: Annotated[
        float,
        Field(
            ge=2,
            le=60,
            description="end of a delayed manoeuvre at the latest [s from t_start]: what follows it stays in view",
        ),
    ] = 10.0
    after: Annotated[
        Literal["lcm", "constant"],
        Field(description="the AV's drive after T: LCM behind the target leader, or constant"),
    ] = "lcm"
    leaders: Annotated[
        Literal["recorded", "lcm", "constant"],
        Field(description="leaders' motion: recorded while in view, then constant speed; LCM; constant speed"),
    ] = "recorded"
    leader_from: Annotated[Literal["start", "crossing"], Field(description="from when HV_1 follows the AV")] = (
        "start"
    )
    parameters: Annotated[
        Literal["fitted", "mean", "table3"],
        Field(description="of followers.model own_fit: fitted to each; mean, table3: that model instead"),
    ] = "fitted"
    human_smoothing_s: Annotated[
        float, Field(gt=0, le=5, description="Savitzky-Golay window over the recorded ego path [s]")
    ] = 1.5


class ValidateSettings(Section):
    """Replaying each event through the planner and the MPC."""

    loss: LossSettings = LossSettings()
    constraints: ConstraintSettings = ConstraintSettings()
    safety: SafetySettings = SafetySettings()
    followers: FollowerSettings = FollowerSettings()
    planner: PlannerSettings = PlannerSettings()
    tracking: TrackingSettings = TrackingSettings()
    statistics: StatisticsSettings = StatisticsSettings()
    studies: StudySettings = StudySettings()
    robust: RobustSettings = RobustSettings()
    multiverse: MultiverseSettings = MultiverseSettings()
    closed_loop: ClosedLoopSettings = ClosedLoopSettings()
    sumo: SumoSettings = SumoSettings()
    planners: Annotated[
        tuple[Annotated[str, Field(min_length=1)], ...],
        Field(description="planners of others beside ours: module:function, or names of entry points"),
    ] = ()
    trajectories: Annotated[
        Literal["auto", "all", "sample", "none"],
        Field(description="events whose motions are written; auto = all up to 1,000 events, then a sample of 500"),
    ] = "auto"

    @property
    def search(self) -> PlannerSettings:
        """The planner's settings, its longest manoeuvre narrowed by the safety profile where that limits it."""
        longest = self.safety.duration_s if self.safety.asked else 0.0
        if not 0.0 < longest < self.planner.T_max:
            return self.planner
        return self.planner.model_copy(update={"T_max": longest})

    @property
    def follower_models(self) -> tuple[str, ...]:
        """Follower models that plan: the default, for every event, then those for a sample."""
        default, parameters = self.followers.model, self.planner.parameters
        if default == names.OWN_FIT and parameters != "fitted":
            default = parameters
        return tuple(dict.fromkeys((default, *(self.followers.also if self.followers.also_sample else ()))))

    @model_validator(mode="after")
    def _known_drivers(self) -> "ValidateSettings":
        """Every name of the closed loop means a follower model."""
        given = self.closed_loop.followers, self.closed_loop.world
        _refuse_unknown("closed_loop", *(name for name in given if name))
        return self

    @model_validator(mode="after")
    def _one_default_model(self) -> "ValidateSettings":
        """Parameters of everybody alike are a model of their own, and only one of them can plan."""
        parameters, model = self.planner.parameters, self.followers.model
        if parameters != "fitted" and model not in (names.OWN_FIT, parameters):
            raise ValueError(f"planner.parameters = {parameters}: only with followers.model = {names.OWN_FIT}")
        return self

    @model_validator(mode="after")
    def _within_the_horizon(self) -> "ValidateSettings":
        """No manoeuvre and no horizon of a study lasts longer than H."""
        H, default = self.loss.horizon_s, StudySettings.model_fields["horizons_s"].default
        if self.studies.horizons_s != default and max(self.studies.horizons_s, default=H) > H:
            longest = max(self.studies.horizons_s)
            raise ValueError(f"studies.horizons_s = {longest:g}: at most loss.horizon_s = {H:g}")
        if self.planner.T_min > H:
            raise ValueError(f"planner.T_min = {self.planner.T_min:g}: at most loss.horizon_s = {H:g}")
        return self


class ReportSettings(Section):
    """Pages and figures."""

    png: Annotated[
        Literal["auto", "all", "top", "none"],
        Field(description="PNG an event: all of them, the top ones, none; auto = all up to 500 events, then top"),
    ] = "auto"
    top: Annotated[int, Field(ge=1, description="how many events count as top")] = 50
    raw: Annotated[
        bool, Field(description="draw raw coordinates: such pages may not be shared (HighD's licence)")
    ] = False


class Settings(Section):
    """A whole run."""

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)

    name: Annotated[str, Field(min_length=1, max_length=80, description="name of the pipeline")] = "highd"
    stages: Annotated[
        tuple[Literal["ingest", "extract", "calibrate", "validate", "report"], ...],
        Field(min_length=1, description="stages; highd-lc run ends with the last of them, after all before it"),
    ] = ("ingest", "extract", "calibrate", "validate", "report")
    seed: Annotated[int, Field(ge=0, le=2**63 - 1, description="seed from which every random draw derives")] = 1
    synthetic: SyntheticSettings = SyntheticSettings()
    ingest: IngestSettings = IngestSettings()
    extract: ExtractSettings = ExtractSettings()
    calibrate: CalibrateSettings = CalibrateSettings()
    validation: Annotated[ValidateSettings, Field(alias="validate")] = ValidateSettings()
    report: ReportSettings = ReportSettings()

    @property
    def validation_alone(self) -> ValidateSettings:
        """What validate reads: all of its section but the multiverse, which no other choice hangs on."""
        return self.validation.model_copy(update={"multiverse": MultiverseSettings()})
