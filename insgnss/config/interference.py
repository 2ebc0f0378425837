"""The schema of interference along a path: the emitters, the receiver's loops, and their disturbances."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from insgnss.config.aiding import DEFAULT_SIGNALS
from insgnss.config.quantities import Constellation, NotNegative, Positive
from insgnss.config.strict import StrictModel


class Emitter(StrictModel):
    """Something that radiates, at a fixed place."""

    name: str = ""
    lat_deg: Annotated[float, Field(ge=-90.0, le=90.0)]
    lon_deg: Annotated[float, Field(ge=-360.0, le=360.0)]
    h_m: float = Field(description="of its antenna above the ellipsoid")
    eirp_dbw: Annotated[float, Field(ge=-150.0, le=100.0)] = Field(
        description="radiated towards the vehicle, with the gain of its antenna"
    )
    kind: Literal["broadband", "cw"] = Field("broadband", description="noise of a bandwidth, or one carrier")
    frequency_hz: Positive = Field(1575.42e6, description="its centre")
    bandwidth_hz: Positive | None = Field(None, description="of a broadband emitter, two-sided, flat inside")
    loss_db: NotNegative = Field(
        0.0, description="of its way: polarisation (3 dB for a linear one), foliage, walls"
    )
    from_s: float | None = Field(
        None, description="time it is switched on, seconds of the GPS week; from the beginning when left out"
    )
    until_s: float | None = Field(
        None, description="time it is switched off, seconds of the GPS week; to the end when left out"
    )

    @model_validator(mode="after")
    def _is_one_kind(self) -> Emitter:
        if (self.kind == "broadband") != (self.bandwidth_hz is not None):
            raise ValueError("a broadband emitter needs bandwidth_hz, a continuous wave (cw) has none")
        if self.from_s is not None and self.until_s is not None and self.until_s <= self.from_s:
            raise ValueError("until_s has to be later than from_s")
        return self


class LoopReceiver(StrictModel):
    """The receiver whose phase loops are studied."""

    signals: dict[Constellation, str] = Field(
        DEFAULT_SIGNALS, description="RINEX code tracked, per constellation"
    )
    # Minimum of GPS C/A at an antenna of 0 dBic [IS-GPS-200N, table 3-Va]; in fact up to 5 dB more
    signal_dbw: Annotated[float, Field(ge=-190.0, le=-120.0)] = Field(
        -158.5, description="a satellite's power at an antenna of 0 dBic"
    )
    cn0_dbhz: Annotated[float, Field(ge=0.0, le=70.0)] = Field(
        45.0, description="what an antenna of 0 dBic receives without interference"
    )
    front_end_hz: Positive = Field(20e6, description="two-sided bandwidth around each carrier")
    discriminator: str = Field("atan(Q/I)", description="'Q' for pilots alone; 'atan(Q/I)', 'sign(I)Q', 'IQ'")
    threshold_ratio: Annotated[float, Field(gt=0.0, lt=0.5)] | None = Field(
        None, description="rms of the phase error over the aperture at loss of lock; table 1 when left out"
    )
    accumulation_s: Positive | None = Field(None, description="coherent; a data symbol when left out")
    airframe_loss_db: NotNegative = Field(
        20.0, description="of an emitter that the airframe hides from every antenna"
    )


class LoopDynamics(StrictModel):
    """The motion that the loops have to follow."""

    oscillator_density: Positive | None = Field(
        None, description="one-sided [rad^2/s^3] at 1575.42 MHz; that of the run's oscillator when left out"
    )
    white_frequency_noise: bool = Field(
        False, description="count h0 too: that of clock models for navigation is 20 dB too large for a loop"
    )
    window_s: Positive = Field(
        10.0, description="over which the vehicle's acceleration is averaged for the loop without aiding"
    )
    manoeuvre_time_s: Positive = Field(5.0, description="correlation time of the vehicle's acceleration")
    aiding_time_s: Positive = Field(60.0, description="correlation time of the aiding's acceleration error")


class InterferenceConfig(StrictModel):
    """A file of emitters, receiver and dynamics."""

    lists_keys = "every key with its meaning: docs/emitters-file.md"

    name: str = ""
    emitter: tuple[Emitter, ...] = Field(min_length=1)
    receiver: LoopReceiver = LoopReceiver()
    dynamics: LoopDynamics = LoopDynamics()
