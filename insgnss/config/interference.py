"""The schema of interference along a path: the emitters, the receiver's loops, and their disturbances."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from insgnss.config.aiding import DEFAULT_SIGNALS
from insgnss.config.quantities import Constellation, NotNegative, Positive
from insgnss.config.strict import StrictModel


class Emitter(StrictModel):
    """A source of interference at a fixed place."""

    name: str = ""
    lat_deg: Annotated[float, Field(ge=-90.0, le=90.0)]
    lon_deg: Annotated[float, Field(ge=-360.0, le=360.0)]
    h_m: float = Field(description="height of its antenna above the ellipsoid")
    eirp_dbw: Annotated[float, Field(ge=-150.0, le=100.0)] = Field(
        description="power radiated towards the vehicle, antenna gain included"
    )
    kind: Literal["broadband", "cw"] = Field("broadband", description="band-limited noise, or one carrier")
    frequency_hz: Positive = Field(1575.42e6, description="centre frequency")
    bandwidth_hz: Positive | None = Field(
        None, description="two-sided bandwidth of a broadband emitter, with flat spectrum"
    )
    loss_db: NotNegative = Field(
        0.0, description="loss on the path: polarisation (3 dB if linear), foliage, walls"
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
        -158.5, description="power received from a satellite by an antenna of 0 dBic"
    )
    cn0_dbhz: Annotated[float, Field(ge=0.0, le=70.0)] = Field(
        45.0, description="C/N0 at an antenna of 0 dBic without interference"
    )
    front_end_hz: Positive = Field(20e6, description="two-sided bandwidth around each carrier")
    discriminator: str = Field("atan(Q/I)", description="'Q' for pilots only; 'atan(Q/I)', 'sign(I)Q', 'IQ'")
    threshold_ratio: Annotated[float, Field(gt=0.0, lt=0.5)] | None = Field(
        None,
        description="rms phase error over the aperture at loss of lock; left out: table 1 of Shatilov (2009)",
    )
    accumulation_s: Positive | None = Field(
        None, description="coherent integration time; left out: one data symbol"
    )
    airframe_loss_db: NotNegative = Field(
        20.0, description="attenuation of an emitter that the airframe hides from every antenna"
    )


class LoopDynamics(StrictModel):
    """The motion that the loops track."""

    oscillator_density: Positive | None = Field(
        None, description="one-sided [rad^2/s^3] at 1575.42 MHz; left out: that of the run's oscillator"
    )
    white_frequency_noise: bool = Field(
        False, description="include h0: in clock models for navigation it is 20 dB too large for a loop"
    )
    window_s: Positive = Field(
        10.0, description="averaging time of the vehicle's acceleration, for the loop without aiding"
    )
    manoeuvre_time_s: Positive = Field(5.0, description="correlation time of the vehicle's acceleration")
    aiding_time_s: Positive = Field(60.0, description="correlation time of the aiding's acceleration error")


class InterferenceConfig(StrictModel):
    """An emitters file."""

    lists_keys = "every key with its meaning: docs/emitters-file.md"

    name: str = ""
    emitter: tuple[Emitter, ...] = Field(min_length=1)
    receiver: LoopReceiver = LoopReceiver()
    dynamics: LoopDynamics = LoopDynamics()
