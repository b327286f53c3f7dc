"""Settings of the population's statistics and of the studies on samples of events."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field


class StatisticsSettings(BaseModel):
    """Population statistics (equations.md 12)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    bootstrap: Annotated[int, Field(ge=100, le=100000, description="bootstrap samples over recordings")] = 2000
    confidence: Annotated[float, Field(gt=0.5, lt=1, description="coverage of the intervals")] = 0.95
    tie_band: Annotated[float, Field(ge=0, lt=1, description="relative difference that counts as a tie")] = 0.001


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
