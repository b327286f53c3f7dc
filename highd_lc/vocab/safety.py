"""Settings of what a car may be allowed to do: the safety profiles (equations.md 5.8)."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

PRACTICE = "practice"
PAPER = "paper"
PROFILES = (PRACTICE, PAPER)


class SafetySettings(BaseModel):
    """What a plan has to keep beside the ellipses, from the crossing to H (equations.md 5.8)."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    profile: Annotated[
        Literal["practice", "paper"],
        Field(description="practice: all that follows; paper: the ellipses alone, the drive after T unbounded"),
    ] = "practice"
    time_gap_s: Annotated[
        float,
        Field(
            ge=0, le=10, description="shortest time gap to the new leader, and of HV_1 to the AV [s] (a choice)"
        ),
    ] = 0.5
    time_gap_target_s: Annotated[
        float, Field(ge=0, le=10, description="time gap whose shortfall is reported, not asked [s] (a choice)")
    ] = 1.0
    braking: Annotated[
        float,
        Field(
            ge=0,
            le=20,
            description="braking asked of HV_1 when the manoeuvre starts, at most [m/s^2]; 0 = not asked "
            "(UN R79, ACSF C: 3)",
        ),
    ] = 3.0
    braking_delay_s: Annotated[
        float, Field(ge=0, le=10, description="t_B: before HV_1 brakes [s] (UN R79, ACSF C: 0.4)")
    ] = 0.4
    braking_gap_s: Annotated[
        float,
        Field(
            ge=0, le=10, description="t_G: time gap of the AV's speed that is left then [s] (UN R79, ACSF C: 1)"
        ),
    ] = 1.0
    drac: Annotated[
        float,
        Field(
            gt=0,
            le=50,
            description="largest deceleration rate to avoid a crash, AV and new leader, HV_1 and AV [m/s^2] "
            "(Archer 2005: 3.35)",
        ),
    ] = 3.35
    clearance_m: Annotated[
        float,
        Field(
            ge=0, le=10, description="margin between ellipses [m]: what tracking and prediction err by (a choice)"
        ),
    ] = 0.3
    lateral_acceleration: Annotated[
        float, Field(ge=0, le=50, description="limit of |a_y| [m/s^2]; 0 = none of its own (UN R79, ACSF C: 1)")
    ] = 0.0
    duration_s: Annotated[
        float,
        Field(ge=0, le=60, description="longest manoeuvre [s]; 0 = T_max alone (UN R79, ACSF C: 5 for cars)"),
    ] = 0.0
    steering: Annotated[
        float, Field(gt=0, le=1.2, description="wheels' angle that bounds the curvature [rad] (as tracking's)")
    ] = 0.6
    yaw_rate: Annotated[
        float,
        Field(gt=0, le=10, description="limit of the yaw rate [rad/s] (8 m/s^2 across at 40 km/h: a choice)"),
    ] = 0.7
    ttc_s: Annotated[float, Field(gt=0, le=60, description="TTC below which TET and TIT count [s] (a choice)")] = (
        3.0
    )
    rss_response_s: Annotated[
        float, Field(ge=0, le=10, description="RSS: response time rho [s] (a choice; Intel's library: 1 and 2)")
    ] = 0.5
    rss_acceleration: Annotated[
        float,
        Field(ge=0, le=20, description="RSS: acceleration during it [m/s^2] (a choice; Intel's library: 3.5)"),
    ] = 3.0
    rss_braking_min: Annotated[
        float, Field(gt=0, le=20, description="RSS: braking of the rear vehicle [m/s^2] (Intel's library: 4)")
    ] = 4.0
    rss_braking_max: Annotated[
        float, Field(gt=0, le=20, description="RSS: braking of the front vehicle [m/s^2] (Intel's library: 8)")
    ] = 8.0

    @property
    def asked(self) -> bool:
        """Whether more is asked of a plan than by the paper."""
        return self.profile == PRACTICE
