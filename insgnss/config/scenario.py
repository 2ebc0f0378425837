"""The schema of a scenario file: satellites on given tracks, an outage, the aircraft that causes it, false locks."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, ValidationInfo, field_validator, model_validator

from insgnss.config.quantities import Elevation, GpsSatellite, NotNegative, Positive
from insgnss.config.search import Search
from insgnss.config.strict import StrictModel

Range = tuple[float, float]


class SatelliteTrack(StrictModel):
    """A satellite's direction at the start and at the end; azimuth and elevation change linearly between."""

    sv: GpsSatellite
    azimuth_deg: tuple[float, float]
    elevation_deg: tuple[Elevation, Elevation]


class ScenarioSite(StrictModel):
    """The point from which the tracks are seen; the user at rest is there, the flight begins there."""

    lat_deg: Annotated[float, Field(ge=-90.0, le=90.0)]
    lon_deg: Annotated[float, Field(ge=-360.0, le=360.0)]
    h_m: float = 0.0


class ScenarioMeasurements(StrictModel):
    """How often and how well the receiver measures; the same for every satellite."""

    range_variance_m2: Positive = Field(description="variance of a pseudorange")
    rate_variance_m2ps2: Positive = Field(description="variance of a range rate")
    rate_hz: Positive = 1.0
    cn0_dbhz: Positive = Field(45.0, description="C/N0 of each satellite in view")


class Equipment(StrictModel):
    """Inertial sensor and receiver clock, by their names in the model library."""

    imu: str = "tactical"
    oscillator: str = "tcxo"
    covariance_step_s: Annotated[float, Field(gt=0.0, le=1.0)] = Field(
        0.05, description="step of the covariance study"
    )


class StartSigmas(StrictModel):
    """The uncertainty at the start, one sigma; position and velocity of each axis."""

    sd_position_m: Positive
    sd_velocity_mps: Positive
    sd_roll_pitch_deg: Positive
    sd_heading_deg: Positive
    sd_clock_m: Positive
    sd_clock_drift_mps: Positive


class SatelliteOutage(StrictModel):
    """Which satellites are off, and when: from the first moment on, until before the second."""

    sv: tuple[GpsSatellite, ...] = Field(min_length=1)
    from_s: NotNegative
    until_s: Positive

    @model_validator(mode="after")
    def _ends_after_it_begins(self) -> SatelliteOutage:
        if self.until_s <= self.from_s:
            raise ValueError(f"until_s must be later than from_s; got {self.from_s} to {self.until_s}")
        return self


class ScenarioAntenna(StrictModel):
    """The antenna as the visibility stage models it, and the airframe's true obstruction."""

    pattern: str
    threshold_gain_dbic: float
    hysteresis_db: NotNegative = 1.0
    body_mask_deg: Elevation = Field(
        0.0,
        description="true mask: nothing is received below this elevation above the body's horizontal plane",
    )


class BankManoeuvre(StrictModel):
    """The attitude that hides the satellites."""

    roll_deg: Annotated[float, Field(gt=-90.0, lt=90.0)] = Field(description="right wing down is positive")
    heading_deg: float = Field(description="heading half-way through the outage")


class ScenarioFlight(StrictModel):
    """The flight behind the simulated logs: straight, a coordinated turn through the outage, straight."""

    duration_s: Positive
    speed_mps: Positive
    roll_s: Positive = Field(2.0, description="time from wings level to the bank")
    imu_rate_hz: Positive = 100.0
    clock_bias_m: float = 0.0
    clock_drift_mps: float = 0.0
    elevation_mask_deg: Annotated[float, Field(ge=-90.0, lt=90.0)] = 5.0


class FalseLockModel(StrictModel):
    """A channel's reports while its satellite is hidden; sizes are drawn evenly from their ranges."""

    name: Annotated[str, Field(min_length=1)]
    begins: Literal["at_loss", "in_search"] = Field(
        "in_search",
        description="when a false lock begins: with the loss, or when a sweep of the search hits it",
    )
    offset_m: Range = Field(description="pseudorange error at its start, least and most")
    growth_mps: Range = Field((0.0, 0.0), description="growth of that error, least and most")
    rate_follows: bool = Field(
        True, description="true: the range rate error is the growth; false: rate_error_mps"
    )
    rate_error_mps: Range = Field((0.0, 0.0), description="range rate error, least and most")
    cn0_dbhz: Range = Field(description="C/N0 that the channel reports, least and most")

    @model_validator(mode="after")
    def _ranges_are_in_order(self) -> FalseLockModel:
        for key in ("offset_m", "growth_mps", "rate_error_mps", "cn0_dbhz"):
            low, high = getattr(self, key)
            if high < low:
                raise ValueError(f"{key} of '{self.name}' must be [least, most]; got [{low}, {high}]")
        return self


class ReceiverChannels(StrictModel):
    """The receiver's channels."""

    release_s: NotNegative = Field(
        0.5,
        description="time after the signal's return at which a false lock beyond pull-in range is detected",
    )
    supervisor_rate_hz: Positive = Field(50.0, description="rate of the supervisor's decisions")


class ScenarioConfig(StrictModel):
    """A scenario file of the masking study."""

    lists_keys = "every key with its meaning: docs/scenario-file.md"

    name: str = ""
    duration_s: Positive
    satellites: tuple[SatelliteTrack, ...] = Field(min_length=4)
    place: ScenarioSite
    measurements: ScenarioMeasurements
    equipment: Equipment = Equipment()
    start: StartSigmas
    outage: SatelliteOutage
    antenna: ScenarioAntenna
    bank: BankManoeuvre
    flight: ScenarioFlight
    false_locks: tuple[FalseLockModel, ...] = ()
    channels: ReceiverChannels = ReceiverChannels()
    search: Search = Search()

    @property
    def sv_names(self) -> tuple[str, ...]:
        """Names of the satellites, in the file's order."""
        return tuple(track.sv for track in self.satellites)

    @field_validator("satellites")
    @classmethod
    def _differ(cls, satellites: tuple[SatelliteTrack, ...]) -> tuple[SatelliteTrack, ...]:
        names = [track.sv for track in satellites]
        twice = sorted({sv for sv in names if names.count(sv) > 1})
        if twice:
            raise ValueError(f"every satellite appears once; {', '.join(twice)} appears twice")
        return satellites

    @field_validator("outage")
    @classmethod
    def _is_of_the_satellites(cls, outage: SatelliteOutage, info: ValidationInfo) -> SatelliteOutage:
        names = {track.sv for track in info.data.get("satellites", ())}
        unknown = [sv for sv in outage.sv if names and sv not in names]
        if unknown:
            raise ValueError(f"sv must be among the satellites; {', '.join(unknown)} is not")
        if outage.until_s > info.data.get("duration_s", math.inf):
            raise ValueError("until_s must lie within the scenario (duration_s)")
        return outage

    @field_validator("flight")
    @classmethod
    def _has_room_for_the_outage(cls, flight: ScenarioFlight, info: ValidationInfo) -> ScenarioFlight:
        outage = info.data.get("outage")
        if outage is not None and not (
            flight.roll_s < outage.from_s and outage.until_s + flight.roll_s < flight.duration_s
        ):
            raise ValueError(
                "the flight must roll in before the outage and out of it afterwards (roll_s, duration_s)"
            )
        return flight
