"""The schema of faults on command: ``[[fault]]`` entries of a scenario file, times in seconds from its beginning."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from insgnss.config.quantities import GpsSatellite, NotNegative
from insgnss.config.strict import StrictModel


class TimedFault(StrictModel):
    """A fault that begins and may end."""

    from_s: NotNegative
    to_s: NotNegative | None = Field(None, description="until the end when left out")

    @model_validator(mode="after")
    def _goes_forward(self) -> TimedFault:
        if self.to_s is not None and self.to_s <= self.from_s:
            raise ValueError(f"to_s = {self.to_s:g} is not after from_s = {self.from_s:g}")
        return self

    @property
    def end_s(self) -> float:
        """Where the window ends."""
        return float("inf") if self.to_s is None else self.to_s


class RangeStep(TimedFault):
    """A pseudorange that is wrong by a constant."""

    kind: Literal["range_step"]
    sv: GpsSatellite
    size_m: float


class RangeRamp(TimedFault):
    """A pseudorange that drifts away; its Doppler stays correct."""

    kind: Literal["range_ramp"]
    sv: GpsSatellite
    rate_mps: float


class Outage(TimedFault):
    """Satellites that are not received; all of them when none is named."""

    kind: Literal["outage"]
    sv: tuple[GpsSatellite, ...] = ()


class ClockJump(StrictModel):
    """A step of the receiver's clock."""

    kind: Literal["clock_jump"]
    at_s: NotNegative
    size_m: float


class FalseLock(TimedFault):
    """A carrier loop locked to a wrong frequency: the Doppler is off by a multiple of half the data rate."""

    kind: Literal["false_lock"]
    sv: GpsSatellite
    offset_hz: float = 25.0
    cn0_drop_db: Annotated[float, Field(ge=0.0)] = 6.0


class CycleSlip(StrictModel):
    """A step of the carrier by whole cycles."""

    kind: Literal["cycle_slip"]
    sv: tuple[GpsSatellite, ...] = Field(min_length=1)
    at_s: NotNegative
    cycles: float
    indicated: bool = False


class HalfCycle(TimedFault):
    """A carrier that is half a cycle off."""

    kind: Literal["half_cycle"]
    sv: tuple[GpsSatellite, ...] = Field(min_length=1)
    flagged: bool = True


class MissingMessage(StrictModel):
    """Satellites whose broadcast message is not in the navigation file."""

    kind: Literal["missing_message"]
    sv: tuple[GpsSatellite, ...] = Field(min_length=1)


class ReversedRangeRate(StrictModel):
    """A log whose Doppler has the wrong sign."""

    kind: Literal["reversed_range_rate"]


SignalFault = (
    RangeStep
    | RangeRamp
    | Outage
    | ClockJump
    | FalseLock
    | CycleSlip
    | HalfCycle
    | MissingMessage
    | ReversedRangeRate
)
